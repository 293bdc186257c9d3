"""Splitting of a long recording at gaps of its streams, so that no motion is integrated across missing samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.recording.recording import Recording

LONGEST_GAP = 0.06
"""Longest time without a sample at which a recording is not split [s]: dropped packets."""
_JUST_BEHIND = 1e-9  # [s], to which recordings round their times
_PERIODS = 3.5  # of a slow stream: a longer interval is a gap


@dataclass(frozen=True, eq=False)
class Piece:
    """Part of a recording without gaps.

    Attributes:
        recording: recording of the part.
        gap: start and end of the gap before it [s], or None.
        missing: name of the samples that were missing there.
    """

    recording: Recording
    gap: tuple[float, float] | None = None
    missing: str = ""


def split_at_gaps(recording: Recording) -> list[Piece]:
    """Return the parts between gaps of either stream, in order; the recording itself if there is none."""
    gaps = sorted(_gaps(recording))
    if not gaps and min(recording.joints.time.size, recording.imu.time.size) > 1:
        return [Piece(recording)]
    merged: list[tuple[float, float, str]] = []
    for start, end, stream in gaps:
        if merged and start < merged[-1][1]:  # overlapping gaps of the two streams
            first, last, missing = merged.pop()
            missing = missing if stream == missing else f"{missing} and {stream}"
            merged.append((first, max(last, end), missing))
        else:
            merged.append((start, end, stream))
    pieces: list[Piece] = []
    begin, before, missing = -np.inf, None, ""
    for start, end, stream in [*merged, (np.inf, np.inf, "")]:
        part = recording.between(begin, max(start + _JUST_BEHIND, np.nextafter(start, np.inf)))
        if part.joints.time.size > 1 and part.imu.time.size > 1:
            pieces.append(Piece(part, before, missing))
        begin, before, missing = end, (start, end), stream
    return pieces


def _gaps(recording: Recording) -> list[tuple[float, float, str]]:
    found: list[tuple[float, float, str]] = []
    for name, time in (("joint", recording.joints.time), ("IMU", recording.imu.time)):
        if len(time) < 2:
            continue
        steps = np.diff(time)
        longest = max(LONGEST_GAP, _PERIODS * float(np.median(steps)))
        found += [(float(time[k]), float(time[k + 1]), name) for k in np.flatnonzero(steps > longest)]
    return found
