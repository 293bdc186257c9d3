"""Conversion of engine values to the samples of a platform: filters, delays, errors, noise, stamps, lost samples."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.platform.platform import RobotState
from equipoise.simulation.drawn_errors import DrawnErrors

_LARGEST_JITTER = 0.4  # of a control period: samples keep their order
_DRIFT_TIME = 120.0  # [s] in which the gyroscope's bias changes by its drift
_ORDER = 2  # of the IMU's low pass
_NEWEST = -1 + 1e-6  # engine steps from the present to the newest past values


class Samples:
    """Sensors of a simulated robot. Rows hold 3 nj + 6 values: positions, velocities, torques, gyroscope, accelerometer.

    Args:
        errors: errors of the sensors.
        joints: number of joints.
        timestep: time step of the engine [s].
        substeps: engine steps per control period.
    """

    def __init__(self, errors: DrawnErrors, joints: int, timestep: float, substeps: int) -> None:
        self._errors, self._joints, self._timestep, self._substeps = errors, joints, timestep, substeps
        sizes = errors.sizes
        self._per_period = sizes.sample_rate * substeps * timestep
        self._complete = not (0 < self._per_period < 1 or sizes.lost_samples)  # each control period has a sample
        half = substeps // 2
        self._around, self._mean = np.arange(-half, half + 1)[:, None], _mean_over(substeps)[:, None, None]
        self._joint_steps = -sizes.sensor_delay / timestep  # engine steps from the present to a sample
        self._imu_steps = self._joint_steps + (sizes.imu_clock_offset - sizes.imu_latency) / timestep
        self._sections = _low_pass(sizes.imu_filter, timestep)
        self._filter_state: FloatArray | None = None
        self._newest: RobotState | None = None
        self._newest_sample: FloatArray = np.zeros(0)

    @cached_property
    def past_steps(self) -> int:
        """Number of past engine steps that samples may need."""
        sizes = self._errors.sizes
        longest = sizes.sensor_delay + abs(sizes.imu_clock_offset) + sizes.imu_latency + sizes.gyro_lag
        return int(np.ceil(longest / self._timestep)) + 2 + self._substeps // 2

    @cached_property
    def late(self) -> bool:
        """True if every sample is older than the newest engine step, so that past values determine it."""
        return max(self._joint_steps, self._imu_steps + self._substeps // 2) <= _NEWEST

    def filtered(self, raw: FloatArray, keep: bool = True) -> FloatArray:
        """Return raw values (n, 3 nj + 6) at consecutive engine steps, with the IMU's after its filter.

        Args:
            keep: whether the filter state is kept; False for predicted steps.
        """
        if self._sections is None:
            return raw
        from scipy import signal  # noqa: PLC0415 - only robots with a filter need it

        imu = raw[:, -6:]
        if self._filter_state is None:
            at_rest = signal.sosfilt_zi(self._sections)
            self._filter_state = np.asarray(at_rest[..., None] * imu[0])
        passed, state = signal.sosfilt(self._sections, imu, axis=0, zi=self._filter_state)
        if keep:
            self._filter_state = np.asarray(state)
        return np.hstack([raw[:, :-6], passed])

    def sensed(self, raw: FloatArray, first: int, count: int, period: int) -> FloatArray:
        """Convert raw values at every engine step to samples at every control period: delay, clock offset, bias, noise.

        Args:
            first: row of the first sample's moment.
            count: number of samples.
            period: number of the first sample's control period, which its noise is keyed by.
        """
        errors, sizes, joints = self._errors, self._errors.sizes, 3 * self._joints
        samples = np.empty((count, raw.shape[1]))
        ticks = first + self._substeps * np.arange(count)
        samples[:, :joints] = _at(raw[:, :joints], ticks, self._joint_steps)
        samples[:, joints:-3] = _at(raw[:, joints:-3], ticks, self._imu_steps - sizes.gyro_lag / self._timestep)
        # The mean over a centred control period filters contact transients, as an IMU's sampling at 1 kHz or more does.
        samples[:, -3:] = (self._mean * _at(raw[:, -3:], ticks + self._around, self._imu_steps)).sum(axis=0)
        if sizes.encoder_eccentricity:
            position = samples[:, : self._joints].copy()
            samples[:, self._joints : 2 * self._joints] *= 1 + errors.encoder_error_slope(position)
            samples[:, : self._joints] += errors.encoder_error(position)
        samples[:, : self._joints] += errors.drawn["joint_offset"]
        if sizes.gyro_gain or sizes.gyro_misalignment or sizes.gyro_turn:
            samples[:, -6:-3] = samples[:, -6:-3] @ errors.gyro_matrix.T
        samples[:, -6:-3] += errors.drawn["gyro_bias"]
        if sizes.gyro_drift:
            runs = self.time(period + np.arange(count)) / _DRIFT_TIME
            samples[:, -6:-3] += runs[:, None] * errors.drawn["gyro_drift"]
        samples[:, -3:] *= 1 + errors.drawn["accelerometer_gain"]
        samples[:, -3:] += errors.drawn["accelerometer_bias"]
        return samples + errors.noise(period, count)

    def time(self, period: NDArray[np.intp]) -> FloatArray:
        """Return (n,) times at which control periods begin [s]."""
        return np.asarray(period, dtype=np.float64) * (self._substeps * self._timestep)

    def stamps(self, period: int, count: int) -> FloatArray:
        """Return (count,) time stamps of the samples of consecutive control periods [s]."""
        times = self.time(period + np.arange(count))
        if not self._errors.sizes.jitter:
            return times
        largest = _LARGEST_JITTER * self._substeps * self._timestep
        jitter = self._errors.jitter(period, count)
        return np.asarray(times + np.minimum(np.maximum(jitter, -largest), largest), dtype=float)

    def arrived(self, period: int, count: int) -> NDArray[np.bool_]:
        """Return (count,) whether consecutive control periods have a sample; the first one always has.

        At a lower rate, the first control period after each due time has a sample.
        """
        periods = period + np.arange(count)
        there = np.ones(count, dtype=bool)
        if 0 < self._per_period < 1:
            due = np.floor(self._per_period * np.arange(period - 1, period + count) + 1e-9)
            there = due[1:] > due[:-1]
        if self._errors.sizes.lost_samples:
            there &= ~self._errors.lost(period, count) | (periods == 0)
        return there

    def state(self, sample: FloatArray, period: int) -> RobotState:
        """Return the state in a control period for a (3 nj + 6,) sample, or the last one if the sample is lost."""
        if self._newest is None or self._complete or self.arrived(period, 1)[0]:
            return self._keep(sample, period)
        return self._newest

    def shown(self, samples: FloatArray, period: int) -> FloatArray:
        """Return (n, 3 nj + 6) samples of consecutive control periods as a loop receives them: a lost one repeats the last."""
        there = self.arrived(period, len(samples))
        latest = np.maximum.accumulate(np.where(there, np.arange(len(samples)), -1))
        seen = samples if there.all() else samples[np.maximum(latest, 0)]
        if self._newest is not None and not there[0]:
            seen[latest < 0] = self._newest_sample
        if latest[-1] >= 0:
            self._keep(samples[latest[-1]], period + int(latest[-1]))
        return seen

    def _keep(self, sample: FloatArray, period: int) -> RobotState:
        """Keep a sample as the newest one, and return it as a state."""
        position, velocity, torque = sample[: 3 * self._joints].reshape(3, self._joints)
        stamp = float(self.stamps(period, 1)[0])
        self._newest = RobotState(stamp, position, velocity, torque, sample[-6:-3], sample[-3:])
        self._newest_sample = sample
        return self._newest


def _low_pass(frequency: float, timestep: float) -> FloatArray | None:
    """Return the sections of the IMU's filter; None without one, or with a cut-off beyond the engine's sample rate."""
    if not frequency or frequency >= 0.5 / timestep:
        return None
    from scipy import signal  # noqa: PLC0415 - its import takes a second; only robots with the filter need it

    return np.asarray(signal.butter(_ORDER, frequency, fs=1 / timestep, output="sos"))


def _mean_over(steps: int) -> FloatArray:
    """Return the weights of a centred mean over a number of engine steps; with an even number the ends count half."""
    weights = np.full(2 * (steps // 2) + 1, 1.0 / steps)
    if steps % 2 == 0:
        weights[[0, -1]] /= 2
    return weights


def _at(raw: FloatArray, ticks: NDArray[np.intp], offset: float) -> FloatArray:
    """Return rows (..., n) of raw values (m, n) at ticks (...) + offset engine steps, linear in between, constant outside."""
    whole = math.floor(offset + 1e-9)  # rounding: a delay of four steps may be 3.9999999999
    fraction = offset - whole
    before = raw.take(ticks + whole, axis=0, mode="clip")
    if fraction < 1e-6:
        return before
    return (1 - fraction) * before + fraction * raw.take(ticks + whole + 1, axis=0, mode="clip")
