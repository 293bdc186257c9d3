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
    pieces: list[Piece] = []
    start, before, missing = -np.inf, None, ""
    for gap_start, gap_end, stream in gaps:
        _append(
            pieces, recording, start, max(gap_start + _JUST_BEHIND, np.nextafter(gap_start, np.inf)), before, missing
        )
        # Overlapping gaps of the two streams become one.
        overlapping = before is not None and gap_start < before[1]
        before = (before[0], max(before[1], gap_end)) if overlapping and before is not None else (gap_start, gap_end)
        missing = f"{missing} and {stream}" if overlapping and stream != missing else stream
        start = before[1]
    _append(pieces, recording, start, np.inf, before, missing)
    return pieces


def _append(
    pieces: list[Piece], recording: Recording, start: float, end: float, gap: tuple[float, float] | None, missing: str
) -> None:
    if end <= start:
        return
    part = recording.between(start, end)
    if part.joints.time.size > 1 and part.imu.time.size > 1:
        pieces.append(Piece(part, gap, missing))


def _gaps(recording: Recording) -> list[tuple[float, float, str]]:
    found: list[tuple[float, float, str]] = []
    for name, time in (("joint", recording.joints.time), ("IMU", recording.imu.time)):
        if len(time) < 2:
            continue
        steps = np.diff(time)
        longest = max(LONGEST_GAP, _PERIODS * float(np.median(steps)))
        found += [(float(time[k]), float(time[k + 1]), name) for k in np.flatnonzero(steps > longest)]
    return found
