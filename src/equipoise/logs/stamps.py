"""Clock of a bag's messages: their own stamps if those are plausible, else the receive times.

Stamps are whole nanoseconds since 1970, too long for a float: the first is subtracted before they become seconds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.logs.bag_streams import GatheredTopic
from equipoise.logs.finding import LogFinding

IntArray = NDArray[np.int64]

_INCREASING = 0.95  # of the stamps
_SPAN = 0.2  # by which the stamps' span may differ from that of the receive times
_TICK_MISS = 0.02  # [s] by which a steady clock may miss receive times: delays of the connection
_OVERLAP = 0.5  # of the shorter stream that must lie within the other


def common_times(
    streams: Sequence[GatheredTopic], needed: Sequence[str], findings: list[LogFinding]
) -> tuple[dict[str, FloatArray], str]:
    """Return the times of all topics after the earliest sample [s], and the name of their clock.

    Args:
        needed: names of the topics that decide, those of joints and IMU.
    """
    sensed = [stream for stream in streams if stream.topic in needed]
    reasons = [f"{stream.topic}: {why}" for stream in sensed if (why := _why_not_header(stream)) is not None]
    if not reasons and not _overlap([stream.header for stream in sensed]):
        reasons.append("the stamps of joints and IMU are from different clocks")
    if not reasons:
        origin = min(int(stream.header[0]) for stream in sensed)
        clocks = {stream.topic: stream.header if stream.header.size else stream.received for stream in streams}
        return {topic: _seconds(clock, origin) for topic, clock in clocks.items()}, "the messages' own stamps"
    if any(stream.header.size for stream in sensed):
        message = f"{'; '.join(reasons)}: receive times are used, which include the delays of the connection"
        findings.append(LogFinding("stamps", message))
    times: dict[str, FloatArray] = {}
    origin, kind = min(int(stream.received[0]) for stream in sensed), "receive times"
    for stream in streams:
        steady = _by_ticks(stream)
        if steady is None:
            times[stream.topic] = _seconds(stream.received, origin)
        else:
            times[stream.topic] = np.asarray((steady + float(stream.received[0] - origin)) * 1e-9, dtype=float)
            kind = "receive times, smoothed by the robot's tick"
    return times, kind


def _why_not_header(stream: GatheredTopic) -> str | None:
    """Return why the messages' own stamps are not used, or None."""
    if not stream.header.size:
        return "its messages have no stamps"
    if not stream.header.any():  # the first may well be: simulated clocks start there
        return "its stamps are zero"
    if stream.header.size > 1 and (np.diff(stream.header) > 0).mean() < _INCREASING:
        return "its stamps do not increase"
    span, received = np.ptp(stream.header), np.ptp(stream.received)
    if abs(float(span) - float(received)) > _SPAN * max(float(received), 1e8):
        return f"its stamps span {span * 1e-9:.1f} s, its receive times {received * 1e-9:.1f} s"
    return None


def _by_ticks(stream: GatheredTopic) -> FloatArray | None:
    """Return receive times without their jitter, from a steady onboard clock [ns after the first]."""
    if stream.ticks.size < 10 or (np.diff(stream.ticks) <= 0).any():
        return None
    ticks, received = ((times - times[0]).astype(float) for times in (stream.ticks, stream.received))
    slope, start = (float(value) for value in np.asarray(np.polyfit(ticks, received, 1), dtype=float))
    steady = slope * ticks + start
    return steady if float(np.quantile(np.abs(steady - received), 0.95)) < _TICK_MISS * 1e9 else None


def _seconds(nanoseconds: IntArray, origin: int) -> FloatArray:
    return np.asarray((nanoseconds - origin) * 1e-9, dtype=float)


def _overlap(clocks: Sequence[IntArray]) -> bool:
    start, end = max(int(clock.min()) for clock in clocks), min(int(clock.max()) for clock in clocks)
    return end - start > _OVERLAP * min(int(np.ptp(clock)) for clock in clocks)
