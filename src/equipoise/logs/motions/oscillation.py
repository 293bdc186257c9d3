"""Steady oscillations of a base: their axes, frequencies and times."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import AXES, Axis, FloatArray
from equipoise.recording.runs import true_runs

# On an A1; times are multiplied by the robot's scale.
_ENVELOPE = 0.8  # [s] over which the strength of the motion is averaged
_STEADY = 0.5  # of the strongest
_SHORTEST, _FEWEST_PERIODS = 1.5, 3  # [s]
_DOMINANT = 0.5  # of an axis' power within two bins of its peak: a hand-held wiggle has less
_WEAKEST = 0.25  # of the strongest axis
_LEAST = 0.03  # [rad/s] rms
_BINS = 2  # on either side of a peak: as wide as a Hann window makes a sinusoid's


def find_oscillation(
    time: FloatArray, angular_velocity_in_base: FloatArray, time_scale: float
) -> tuple[float, float, dict[Axis, float]] | None:
    """Return start and end [s] of the longest steady part, and its frequencies by the axes that a sinusoid dominates [Hz].

    None if a sinusoid dominates no axis.

    Args:
        time: (n,) evenly spaced times [s].
        angular_velocity_in_base: (n, 3) angular velocity of the base, in its own axes [rad/s].
        time_scale: factor on times, of the robot's scale; one on an A1.
    """
    if len(time) < 8 or time[-1] - time[0] < _SHORTEST * time_scale:
        return None
    step = float(np.diff(time).mean())
    window = np.ones(max(1, round(_ENVELOPE * time_scale / step)))
    strength = np.convolve((angular_velocity_in_base**2).sum(axis=1), window / len(window), mode="same") ** 0.5
    steady = true_runs(strength > _STEADY * strength.max())
    first, last = max(steady, key=lambda run: run[1] - run[0], default=(0, 0))
    if (last - first) * step < _SHORTEST * time_scale:
        return None
    found = _dominant(angular_velocity_in_base[first:last], step)
    return (float(time[first]), float(time[last - 1]), found) if found else None


def _dominant(angular_velocity_in_base: FloatArray, step: float) -> dict[Axis, float]:
    """Return the frequencies of the axes that a sinusoid dominates [Hz]."""
    centred = angular_velocity_in_base - angular_velocity_in_base.mean(axis=0)
    size = centred.std(axis=0)
    power = np.abs(np.fft.rfft(centred * np.hanning(len(centred))[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(centred), step)
    found: dict[Axis, float] = {}
    for index, axis in enumerate(AXES):
        peak = int(np.argmax(power[:, index]))
        near = power[max(0, peak - _BINS) : peak + _BINS + 1, index].sum() / max(power[:, index].sum(), 1e-30)
        strong = size[index] > max(_LEAST, _WEAKEST * size.max())
        if strong and near > _DOMINANT and frequency[peak] * len(centred) * step >= _FEWEST_PERIODS:
            found[axis] = float(frequency[peak])
    return found
