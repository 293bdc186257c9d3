"""Position of the IMU from an excitation: encoders measure how the base moves, the accelerometer how the IMU moves.

With R the attitude by the gyroscope and b the base's origin by the legs, the IMU at r in the base frame feels

    R f = g up + b'' + (R r)''.

Nothing is differentiated: both sides are multiplied by test functions that vanish at both ends, and integrated by parts. No
mass, inertia or law of friction is in it, so that it checks the lifts, in which that position and inertia look alike.
Feet roll; what they, the springs and the gyroscope's gain add goes with the base's rotation, as r does, and is allowed for.
Lengths of legs that are off look like an IMU that is as far off its height.
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
# By a radian of the base's rotation, what the attitude is off by [rad], and what feet and springs add to a shift of the base
# on an A1 [m]: a gain of the gyroscope that is 0.5 % off, a millimetre.
_TURNED, _SHIFTED = 5e-3, 1e-3
_LONGEST = 60.0  # [s] on an A1: the longest part of an excitation that is read; waves take memory for every sample
_FITS = 3  # in which the noise is found that residuals show
# [m] on an A1, by which lengths of legs and feet that give put an excitation's IMU elsewhere. 28 development runs, 24 of them
# in
# `stress`, were then 0.6 standard deviations rms from the tilts' word, 1.8 at most.
_ASTRAY = 1.5e-3


@dataclass(frozen=True, eq=False)
class ExcitationSamples:
    """An excitation over planted feet, all at the times of the IMU's samples.

    Attributes:
        time: (n,) times [s].
        angular_velocity_in_imu: (n, 3) gyroscope less its bias [rad/s].
        acceleration_in_imu: (n, 3) accelerometer [m/s2].
        joint_position: (n, nj) as read [rad].
        joint_velocity: (n, nj) as read [rad/s].
        joint_torque: (n, nj) as reported; zero where none are [Nm].
    """

    time: FloatArray
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    joint_position: FloatArray
    joint_velocity: FloatArray
    joint_torque: FloatArray

    @classmethod
    def of(cls, swaying: Recording, gyro_bias: FloatArray) -> ExcitationSamples:
        """Read a recording of an excitation."""
        joints, imu = swaying.joints, swaying.imu
        torque = np.zeros_like(joints.position) if joints.torque is None else joints.torque
        read = (at_times(imu.time, joints.time, part) for part in (joints.position, joints.rates, torque))
        return cls(imu.time, imu.angular_velocity_in_imu - gyro_bias, imu.acceleration_in_imu, *read)

    def first(self, duration: float) -> ExcitationSamples:
        """Return the samples of the first seconds [s]."""
        count = np.count_nonzero(self.time <= self.time[0] + duration)
        return ExcitationSamples(**{name: values[:count] for name, values in vars(self).items()})


def imu_by_excitation(
    robot: RobotModel, legs: LegChains, excitation: ExcitationSamples, values: Values, scale: Scale
) -> tuple[FloatArray, FloatArray]:
    """Where the IMU sits in the base frame, less where the model has it [m].

    Args:
        values: values of the unknowns, by which encoders and mounting of the IMU are corrected.
        scale: the robot's, over an A1.

    Returns:
        (3,) and (3,) standard deviations, by what residuals show and by how far lengths of legs may be off.
    """
    excitation = excitation.first(_LONGEST * scale.time)
    time, mounted = excitation.time, mounting(np.array(robot.imu_in_base.rotation), values["imu_tilt"])
    turning = at_times(time, time - values["gyro_lag"], excitation.angular_velocity_in_imu) @ mounted.T
    felt = excitation.acceleration_in_imu @ mounted.T
    attitude = attitudes(time, turning)
    level, _ = Rotation.align_vectors(_UP[None], attitude.apply(felt).mean(axis=0)[None])
    attitude = level * attitude
    rotation, turned = attitude.as_matrix(), attitude.as_rotvec()
    base = _base(legs, excitation, values, turning, rotation) + rotation @ robot.imu_in_base.translation
    force = np.einsum("tij,tj->ti", rotation, felt) - GRAVITY * _UP

    by_turn = np.zeros((len(time), 3, 6))  # a horizontal vector that goes with the rotation, whose size is not known
    by_turn[:, 0, :3] = by_turn[:, 1, 3:] = turned - turned.mean(axis=0)
    test, test_rate_rate = _test_functions(time, scale.time)
    unexplained = test @ force - test_rate_rate @ base
    columns = [
        np.tensordot(test_rate_rate, rotation, 1),
        _TURNED * GRAVITY * np.tensordot(test, by_turn, 1),
        _SHIFTED * scale.length * np.tensordot(test_rate_rate, by_turn, 1),
    ]
    place, std = _fit(np.concatenate(columns, axis=-1).reshape(unexplained.size, -1), unexplained.ravel())
    return place, np.hypot(std, _ASTRAY * scale.length)


def _base(
    legs: LegChains, excitation: ExcitationSamples, values: Values, turning: FloatArray, rotation: FloatArray
) -> FloatArray:
    """(n, 3) the base's origin by the legs, as if the floor were level, up to a constant [m]."""
    readings = JointReadings.of(legs, excitation.joint_position, excitation.joint_velocity, excitation.joint_torque)
    given = inputs_of(values, (*DRIVE_TRAIN, "clock_offset"), len(excitation.time))
    position, _ = readings.later(given)
    feet = legs.motion(position.value.T, excitation.joint_velocity, turning)
    spin = np.einsum("tij,tlj->tli", rotation, feet.foot_angular_velocity)
    rolling = legs.foot_radius[:, None] * cross(spin, _UP)
    rolled = np.cumsum(rolling * np.gradient(excitation.time)[:, None, None], axis=0)
    return (rolled - np.einsum("tij,tlj->tli", rotation, feet.foot)).mean(axis=1)


def _test_functions(time: FloatArray, time_scale: float) -> tuple[FloatArray, FloatArray]:
    """(m, n) weights of sums over samples: integrals with waves in a Hann window, and with their second derivatives."""
    since, whole = time - time[0], time[-1] - time[0]
    frequency = 2 * np.pi * np.arange(*_FREQUENCIES) / time_scale
    # The window's half and its own wave make three of each wave.
    share, aside = np.array([0.5, -0.25, -0.25]), 2 * np.pi / whole * np.array([0.0, 1.0, -1.0])
    at = (frequency[:, None] + aside)[..., None]
    waves = share[:, None] * np.cos(at * since + np.array([0.0, np.pi / 2])[:, None, None, None])
    weights = np.gradient(time)
    summed = (np.sum(part, axis=-2) * weights for part in (waves, -(at**2) * waves))
    value, rate_rate = (np.asarray(part, dtype=float).reshape(-1, len(time)) for part in summed)
    return value, rate_rate


def _fit(columns: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A place within a metre, others of the size of one beside it, and a noise that is not known: estimate and deviations."""
    size = columns.shape[1]
    noise, found, rows = float(values.std()), np.zeros(size), columns
    for _ in range(_FITS):
        rows = np.vstack([columns / noise, np.eye(size)])
        found = np.linalg.lstsq(rows, np.concatenate([values / noise, np.zeros(size)]), rcond=None)[0]
        noise = max(float((values - columns @ found).std()), np.finfo(float).eps)
    stds: FloatArray = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    return np.asarray(found[:3], dtype=float), stds[:3]


class ImuPosition(Equation[ExcitationSamples]):
    """Return the IMU's position minus that from each excitation. It depends a little on joint offsets and mounting."""

    depends_on = ("imu_position",)
    name = "excitation"
    kind = ExcitationSamples
    source = "position of the IMU by the excitation"
    remedy = "the IMU's measured position, in the robot's description"

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[ExcitationSamples]:
        """An excitation about all axes."""
        if not isinstance(recording.trial, ExcitationTrial) or not recording.complete:
            return ()
        return (ExcitationSamples.of(recording.phase(Phase.EXCITATION), run.gyro_bias),)

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, ExcitationSamples]]) -> None:
        super().__init__(unknowns, samples)
        self._place, self._noise = np.zeros((len(samples), 3)), np.ones((len(samples), 3))

    @classmethod
    def of(cls, unknowns: Unknowns, motions: Sequence[MotionSamples]) -> Equation[ExcitationSamples] | None:
        """Return the rows of all samples; None if there are none, or the position is held at the model's."""
        return super().of(unknowns, motions) if unknowns.estimates("imu_position") else None

    def _rows_in(self, sample: ExcitationSamples) -> int:
        return 3

    def prepare(self, x: FloatArray) -> None:
        values, unknowns = self.unknowns.values(x), self.unknowns
        found = [
            imu_by_excitation(unknowns.robot, unknowns.legs, excitation, values, unknowns.stance.scale)
            for excitation in self.samples
        ]
        self._place, self._noise = (np.array(part) for part in zip(*found, strict=True))

    def residual(self, x: FloatArray) -> FloatArray:
        return ((self.unknowns.value(x, "imu_position") - self._place) / self._noise).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        unit = np.diag(self.unknowns.scale[self.unknowns["imu_position"]])
        return self.residual(x), (unit / self._noise[..., None]).reshape(-1, 3)
