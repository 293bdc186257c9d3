"""Position of the IMU from an excitation: encoders measure the base's motion, the accelerometer the IMU's.

R is the attitude from the gyroscope, b the base's origin from the legs. The IMU at r in the base frame measures

    R f = g up + b'' + (R r)''.

Instead of differentiating, both sides are multiplied by test functions that vanish at both ends, and integrated by parts.
No mass, inertia or friction model is involved. The result therefore checks the lifts, which hardly separate this position
from inertia. Errors of rolling feet, springs and gyroscope gain are proportional to the base's rotation, like r, and are
part of the fit. Errors of leg lengths shift the estimated height of the IMU by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.equations.equation import Equation, MotionSamples, RunContext
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.imu_frame import mounting
from equipoise.estimator.measurements.leg_motion import LegChains, cross
from equipoise.estimator.measurements.lift_samples import at_times, attitudes
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Values, inputs_of
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import ExcitationTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

_UP = np.array([0.0, 0.0, 1.0])
_FREQUENCIES = (0.3, 4.0, 0.15)  # [Hz] on an A1: first, last, step, of test functions; an excitation has 1.5 to 2.3
# Standard deviations per radian of the base's rotation: attitude error [rad], from a gyroscope gain error of 0.5 %, and
# shift of the base by feet and springs on an A1 [m].
_ATTITUDE_ERROR, _BASE_SHIFT = 5e-3, 1e-3
_LONGEST = 60.0  # [s] on an A1: the longest part of an excitation that is read; test functions take memory per sample
_SAMPLES_AT_ONCE = 4096  # to save memory
_FITS = 3  # iterations that determine the noise from the residuals
# [m] on an A1: standard deviation of the IMU position due to leg lengths and foot compliance. In 28 development runs, 24 of
# them in `stress`, the difference from the lifts was then 0.6 standard deviations rms, 1.8 at most.
_LEG_LENGTH_ERROR = 1.5e-3


@dataclass(frozen=True, eq=False)
class ExcitationSamples:
    """Samples of an excitation, all at the times of the IMU's samples.

    Attributes:
        time: (n,) times [s].
        angular_velocity_in_imu: (n, 3) gyroscope readings minus their bias [rad/s].
        acceleration_in_imu: (n, 3) accelerometer readings [m/s2].
        joint_position: (n, nj) joint position readings [rad].
        joint_velocity: (n, nj) joint velocity readings [rad/s].
        joint_torque: (n, nj) reported joint torques; zero without any [Nm].
    """

    time: FloatArray
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    joint_position: FloatArray
    joint_velocity: FloatArray
    joint_torque: FloatArray

    @classmethod
    def of(cls, excitation: Recording, gyro_bias: FloatArray, time_scale: float) -> ExcitationSamples:
        """Read the first minute of a recording of an excitation; `time_scale` is that of the robot, relative to an A1."""
        used = excitation.between(-np.inf, excitation.imu.time[0] + _LONGEST * time_scale)
        joints, imu, time = used.joints, used.imu, used.imu.time
        torque = np.zeros_like(joints.position) if joints.torque is None else joints.torque
        read = (at_times(time, joints.time, part) for part in (joints.position, joints.rates, torque))
        return cls(time, imu.angular_velocity_in_imu - gyro_bias, imu.acceleration_in_imu, *read)


def imu_by_excitation(
    robot: RobotModel, legs: LegChains, excitation: ExcitationSamples, values: Values, scale: Scale
) -> tuple[FloatArray, FloatArray]:
    """Estimate the IMU's position in the base frame minus that of the model [m].

    Args:
        values: values of the parameters that correct the encoders and the IMU's mounting.
        scale: scale of the robot, relative to an A1.

    Returns:
        (3,) position and (3,) standard deviations, from the residuals and the uncertainty of leg lengths.
    """
    time, mounted = excitation.time, mounting(np.array(robot.imu_in_base.rotation), values["imu_tilt"])
    turning = at_times(time, time - values["gyro_lag"], excitation.angular_velocity_in_imu) @ mounted.T
    acceleration = excitation.acceleration_in_imu @ mounted.T
    attitude = attitudes(time, turning)
    level, _ = Rotation.align_vectors(_UP[None], attitude.apply(acceleration).mean(axis=0)[None])
    attitude = level * attitude
    rotation, turned = attitude.as_matrix(), attitude.as_rotvec()
    base = _base(legs, excitation, values, turning, rotation) + rotation @ robot.imu_in_base.translation
    force = np.einsum("tij,tj->ti", rotation, acceleration) - GRAVITY * _UP

    test, test_rate_rate = tests = _test_functions(time, scale.time)
    by_turn = np.zeros((2, len(test), 3, 6))  # horizontal vectors proportional to the rotation
    by_turn[:, :, 0, :3] = by_turn[:, :, 1, 3:] = tests @ (turned - turned.mean(axis=0))
    unexplained = test @ force - test_rate_rate @ base
    columns = [
        np.tensordot(test_rate_rate, rotation, 1),
        _ATTITUDE_ERROR * GRAVITY * by_turn[0],
        _BASE_SHIFT * scale.length * by_turn[1],
    ]
    position, std = _fit(np.concatenate(columns, axis=-1).reshape(unexplained.size, -1), unexplained.ravel())
    return position, np.hypot(std, _LEG_LENGTH_ERROR * scale.length)


def _base(
    legs: LegChains, excitation: ExcitationSamples, values: Values, turning: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return the (n, 3) base's origin from leg kinematics on a level floor, up to a constant [m]."""
    parts = [slice(first, first + _SAMPLES_AT_ONCE) for first in range(0, len(turning), _SAMPLES_AT_ONCE)]
    feet = [_feet(legs, excitation, values, turning, part) for part in parts]
    foot, foot_angular_velocity = (np.concatenate(arrays) for arrays in zip(*feet, strict=True))
    spin = np.einsum("tij,tlj->tli", rotation, foot_angular_velocity)
    rolling = legs.foot_radius[:, None] * cross(spin, _UP)
    rolled = np.cumsum(rolling * np.gradient(excitation.time)[:, None, None], axis=0)
    return (rolled - np.einsum("tij,tlj->tli", rotation, foot)).mean(axis=1)


def _feet(
    legs: LegChains, excitation: ExcitationSamples, values: Values, turning: FloatArray, part: slice
) -> tuple[FloatArray, FloatArray]:
    """Return (n, 4, 3) positions [m] and angular velocities [rad/s] of the feet in the base frame, in a part."""
    position, velocity = excitation.joint_position[part], excitation.joint_velocity[part]
    readings = JointReadings.of(legs, position, velocity, excitation.joint_torque[part])
    given = inputs_of(values, (*DRIVE_TRAIN, "clock_offset"), len(position))
    corrected, _ = readings.later(given)
    motion = legs.motion(corrected.value.T, velocity, turning[part])
    return motion.foot, motion.foot_angular_velocity


def _test_functions(time: FloatArray, time_scale: float) -> FloatArray:
    """Return (2, m, n) weights of integrals over samples, with Hann-windowed waves and with their second derivatives."""
    since, whole = time - time[0], time[-1] - time[0]
    frequency = 2 * np.pi * np.arange(*_FREQUENCIES) / time_scale
    weights, tests = np.gradient(time), np.zeros((2, 2, len(frequency), len(time)))
    # The product with the window is a sum of three waves. One phase at a time, to save memory.
    for share, aside in ((0.5, 0.0), (-0.25, 1.0), (-0.25, -1.0)):
        at = (frequency + 2 * np.pi / whole * aside)[:, None]
        for number, phase in enumerate((0.0, np.pi / 2)):
            wave = share * weights * np.cos(at * since + phase)
            tests[0, number] += wave
            tests[1, number] -= at**2 * wave
    return tests.reshape(2, -1, len(time))


def _fit(columns: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit a position and its nuisance parameters, all of prior std 1, and the noise; return the position and its std."""
    size = columns.shape[1]
    noise, found, rows = float(values.std()), np.zeros(size), columns
    for _ in range(_FITS):
        rows = np.vstack([columns / noise, np.eye(size)])
        found = np.linalg.lstsq(rows, np.concatenate([values / noise, np.zeros(size)]), rcond=None)[0]
        noise = max(float((values - columns @ found).std()), np.finfo(float).eps)
    stds: FloatArray = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    return np.asarray(found[:3], dtype=float), stds[:3]


class ImuPosition(Equation[ExcitationSamples]):
    """Rows of the IMU position minus its excitation estimate, which hardly depends on joint offsets and mounting."""

    depends_on = ("imu_position",)
    name = "excitation"
    kind = ExcitationSamples
    source = "IMU position from the excitation"
    remedy = "the IMU's measured position, in the robot's description"

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[ExcitationSamples]:
        """Return the samples of an excitation."""
        if not isinstance(recording.trial, ExcitationTrial) or not recording.complete:
            return ()
        clock = run.stance.scale.time
        return (ExcitationSamples.of(recording.phase(Phase.EXCITATION), run.gyro_bias, clock),)

    @classmethod
    def of(cls, unknowns: Unknowns, motions: Sequence[MotionSamples]) -> Equation[ExcitationSamples] | None:
        """Return the rows of all samples; None if there are none or the IMU position is fixed."""
        return super().of(unknowns, motions) if unknowns.estimates("imu_position") else None

    def _rows_in(self, sample: ExcitationSamples) -> int:
        return 3

    def prepare(self, x: FloatArray) -> None:
        values, unknowns = self.unknowns.values(x), self.unknowns
        found = [
            imu_by_excitation(unknowns.robot, unknowns.legs, excitation, values, unknowns.stance.scale)
            for excitation in self.samples
        ]
        self._measured, self._noise = (np.array(part) for part in zip(*found, strict=True))

    def residual(self, x: FloatArray) -> FloatArray:
        return ((self.unknowns.value(x, "imu_position") - self._measured) / self._noise).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        unit = np.diag(self.unknowns.scale[self.unknowns["imu_position"]])
        return self.residual(x), (unit / self._noise[..., None]).reshape(-1, 3)
