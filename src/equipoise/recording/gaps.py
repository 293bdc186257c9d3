"""Gaps in a long recording: it is cut where a stream pauses, so that nothing is integrated over what was not sensed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.recording.recording import Recording

LONGEST_GAP = 0.06
"""[s] without a sample that a recording is not cut at: dropped packets."""
_JUST_BEHIND = 1e-9  # [s], to which recordings round their times
_PERIODS = 3.5  # of a slow stream: that much longer than usual is a gap


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a recording without gaps.

    Attributes:
        recording: the part's recording.
        gap: start and end of the gap before it [s], or None.
        missing: name of the samples that were missing there.
    """

    recording: Recording
    gap: tuple[float, float] | None = None
    missing: str = ""


def split_at_gaps(recording: Recording) -> list[Piece]:
    """The parts between gaps of either stream, in order; the recording itself if there is none."""
    gaps = sorted(_gaps(recording))
    if not gaps and min(recording.joints.time.size, recording.imu.time.size) > 1:
        return [Piece(recording)]
    pieces: list[Piece] = []
    start, before, missing = -np.inf, None, ""
    for gap_start, gap_end, stream in gaps:
        _append(
            pieces, recording, start, max(gap_start + _JUST_BEHIND, np.nextafter(gap_start, np.inf)), before, missing
        )
        # A gap of the other stream that overlaps this one makes one gap of the two.
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
