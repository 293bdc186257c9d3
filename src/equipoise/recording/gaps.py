"""Splitting of a long recording at gaps of its streams, so that no motion is integrated across missing samples."""

from __future__ import annotations

import numpy as np

from equipoise.recording.recording import Recording

Gap = tuple[float, float, str]
"""Start and end of a gap [s], and the name of the samples that are missing in it."""

LONGEST_GAP = 0.06
"""Longest time without a sample at which a recording is not split [s]: dropped packets."""
_JUST_BEHIND = 1e-9  # [s], to which recordings round their times
_PERIODS = 3.5  # of a slow stream: a longer interval is a gap


def split_at_gaps(recording: Recording) -> list[tuple[Recording, Gap | None]]:
    """Return the parts between gaps of either stream, in order, each with the gap before it.

    A recording without a gap is its own part.
    """
    gaps = sorted(_gaps(recording))
    if not gaps and min(recording.joints.time.size, recording.imu.time.size) > 1:
        return [(recording, None)]
    merged: list[Gap] = []
    for start, end, stream in gaps:
        if merged and start < merged[-1][1]:  # overlapping gaps of the two streams
            first, last, missing = merged.pop()
            missing = missing if stream == missing else f"{missing} and {stream}"
            merged.append((first, max(last, end), missing))
        else:
            merged.append((start, end, stream))
    parts: list[tuple[Recording, Gap | None]] = []
    begin, before = -np.inf, None
    for gap in [*merged, (np.inf, np.inf, "")]:
        part = recording.between(begin, max(gap[0] + _JUST_BEHIND, np.nextafter(gap[0], np.inf)))
        if part.joints.time.size > 1 and part.imu.time.size > 1:
            parts.append((part, before))
        begin, before = gap[1], gap
    return parts


def _gaps(recording: Recording) -> list[Gap]:
    found: list[Gap] = []
    for name, time in (("joint", recording.joints.time), ("IMU", recording.imu.time)):
        if len(time) < 2:
            continue
        steps = np.diff(time)
        longest = max(LONGEST_GAP, _PERIODS * float(np.median(steps)))
        found += [(float(time[k]), float(time[k + 1]), name) for k in np.flatnonzero(steps > longest)]
    return found
