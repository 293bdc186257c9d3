"""Recordings as the peers that read accelerations and torques want them: low-passed without delay, and differentiated.

All signals go through the same filter (Butterworth of fourth order, forwards and backwards), so that none lags another. The
body's acceleration, less gravity, is either the accelerometer's or that of the planted feet: contact points that do not
move, J_c v = 0, give the base's velocity from joints and gyroscope, and the gyroscope gives the direction of gravity from a
rest on. The second is there in the peers' favour: MuJoCo's accelerometer, which shows the constrained acceleration at the
beginning of a step, is off by up to a quarter in vigorous motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import attitudes, read_lift
from equipoise.recording.event import TRIAL
from equipoise.recording.recording import Recording
from equipoise.recording.trials import LiftTrial
from equipoise.robot.model import LEG_NAMES, PAIRS, RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]
Acceleration = Literal["accelerometer", "kinematic"]
Motions = Literal["shake", "planted", "all"]

_GRAVITY = 9.81
_STICTION_SPEED = 0.03  # [rad/s], below which Coulomb friction is not yet its full size
_STRIDE = 2  # of the samples before differentiating; 250 Hz are left
_KEPT = 2  # of those, one in two is kept afterwards
_MARGIN = 0.15  # [s] cut off both ends of a recording, where a filter has not all it needs
_REST_OF = {"shake": "rest", "posture": "before", "excitation": "settle", "lift": "rest", "stand": "rest"}


def kind_of(recording: Recording) -> str:
    """What a recording says that it is: a trial of a calibration, or a shake; empty if it does not say."""
    return next((str(event.data["kind"]) for event in recording.events if event.name == TRIAL), "")


@dataclass(frozen=True, eq=False)
class Filtered:
    """Samples of a robot on some of its feet.

    Attributes:
        position, velocity, acceleration, torque: (n, nj) [rad], [rad/s], [rad/s2], [Nm].
        friction: (n, nj) direction of Coulomb friction, from -1 to 1.
        turning, turning_rate: (n, 3) in base axes [rad/s], [rad/s2].
        felt: (n, 3) acceleration of the base's origin less gravity, in base axes [m/s2].
        up: (n, 3) against gravity, in base axes.
        standing: (n, 4) which feet are planted: the contact schedule.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    friction: FloatArray
    turning: FloatArray
    turning_rate: FloatArray
    felt: FloatArray
    up: FloatArray
    standing: NDArray[np.bool_]

    @property
    def count(self) -> int:
        return len(self.position)

    @classmethod
    def joined(cls, parts: Sequence[Filtered]) -> Filtered:
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def read_all(
    robot: RobotModel,
    recordings: Sequence[Recording],
    stance: Stance,
    cutoff: float,
    acceleration: Acceleration,
    motions: Motions,
) -> Filtered:
    """Samples of all recordings that a peer is to be given.

    Args:
        cutoff: of the filter, on a robot of an A1's size [Hz].
        motions: "shake" alone, "planted": with every rest, move and excitation of the Bayesian run, or "all": with the time on
            two feet of its lifts too.
    """
    legs = LegChains(robot)
    chosen = [(kind_of(r), r) for r in recordings if motions != "shake" or kind_of(r) == "shake"]
    rests = [r.phase(_REST_OF[kind]) for kind, r in chosen if kind in ("shake", "posture", "lift")]
    gyro_bias = np.median([rest.imu.angular_velocity_in_imu.mean(axis=0) for rest in rests], axis=0)
    parts: list[Filtered] = []
    for kind, recording in chosen:
        if kind not in _REST_OF or not recording.has_phase(_REST_OF[kind]):
            continue
        four = np.ones(4, dtype=bool)
        rest = recording.phase(_REST_OF[kind])
        windows = [(float(rest.joints.time[0]), float(recording.joints.time[-1]), four)]
        if isinstance(trial := recording.trial, LiftTrial):
            windows = [(float(rest.joints.time[0]), float(rest.joints.time[-1]), four)]
            whole = motions == "all" and recording.complete
            lift = read_lift(robot, legs, recording, trial.diagonal, stance, gyro_bias) if whole else ""
            if not isinstance(lift, str):
                two = np.array([leg in PAIRS[lift.pair] for leg in LEG_NAMES])
                windows.append((lift.start, lift.start + lift.step * (len(lift.joint_position) - 1), two))
        parts += read(robot, recording, rest, windows, gyro_bias, cutoff / stance.scale.time, acceleration)
    return Filtered.joined(parts)


def read(
    robot: RobotModel,
    recording: Recording,
    rest: Recording,
    windows: Sequence[tuple[float, float, NDArray[np.bool_]]],
    gyro_bias: FloatArray,
    cutoff: float,
    acceleration: Acceleration,
) -> list[Filtered]:
    """Samples of one recording, between some of its times.

    Args:
        rest: the part of it in which the robot stands still first.
        windows: start and end [s], and which of the four feet stand.
        cutoff: [Hz].
    """
    joints, imu = recording.joints, recording.imu
    assert joints.torque is not None
    period = float(np.median(np.diff(joints.time)))
    sos = butter(4, cutoff, fs=1 / period, output="sos")

    def smooth(values: FloatArray, factor: float = 1.0) -> FloatArray:
        design = sos if factor == 1.0 else butter(4, factor * cutoff, fs=1 / period, output="sos")
        return np.asarray(sosfiltfilt(design, values, axis=0, padlen=min(len(values) - 1, round(3 / cutoff / period))))

    time = joints.time[::_STRIDE]
    rotation = np.array(robot.imu_in_base.rotation)
    turning_raw = (imu.angular_velocity_in_imu - gyro_bias) @ rotation.T
    up = _up(imu.time, turning_raw, rest, rotation)[::_STRIDE]
    turning = smooth(turning_raw)[::_STRIDE]
    turning_rate = np.gradient(turning, time, axis=0)
    position = smooth(joints.position)[::_STRIDE]
    velocity = np.gradient(position, time, axis=0)
    brisk = np.gradient(smooth(joints.position, 2.0), joints.time, axis=0)
    friction = smooth(np.tanh(brisk / _STICTION_SPEED))[::_STRIDE]
    columns = (
        position, velocity, np.gradient(velocity, time, axis=0), smooth(joints.torque)[::_STRIDE], friction, turning,
        turning_rate,
    )  # fmt: skip
    arm = np.array(robot.imu_in_base.translation)
    sensed = smooth(imu.acceleration_in_imu)[::_STRIDE] @ rotation.T
    at_base = sensed - np.cross(turning_rate, arm) - np.cross(turning, np.cross(turning, arm))
    parts: list[Filtered] = []
    for start, end, standing in windows:
        inside = (time >= max(start, time[0] + _MARGIN)) & (time <= min(end, time[-1] - _MARGIN))
        if inside.sum() < 2 * _KEPT:
            continue
        felt = at_base[inside]
        if acceleration == "kinematic":
            felt = _felt_by_feet(
                robot, time[inside], position[inside], velocity[inside], turning[inside], up[inside], standing
            )
        kept = slice(None, None, _KEPT)
        feet = np.tile(standing, (len(felt[kept]), 1))
        parts.append(Filtered(*(column[inside][kept] for column in columns), felt[kept], up[inside][kept], feet))
    return parts


def contact_jacobians(robot: RobotModel, position: FloatArray, up: FloatArray) -> FloatArray:
    """(12, 6 + nj) of the points in which the feet touch the floor, in base axes."""
    model, data = robot.pinocchio, robot.pinocchio.createData()
    pin.computeJointJacobians(model, data, robot.configuration(position))
    pin.updateFramePlacements(model, data)
    rows = np.empty((12, 6 + len(position)))
    for number, leg in enumerate(robot.legs.values()):
        jacobian = pin.getFrameJacobian(model, data, leg.foot_frame_id, pin.LOCAL_WORLD_ALIGNED)
        rows[3 * number : 3 * number + 3] = jacobian[:3] + leg.foot_radius * pin.skew(up) @ jacobian[3:]
    return rows


def _up(time: FloatArray, turning: FloatArray, rest: Recording, rotation: FloatArray) -> FloatArray:
    """(n, 3) against gravity in base axes: the accelerometer's mean at rest, carried on by the gyroscope."""
    at_rest = rest.imu.acceleration_in_imu.mean(axis=0) @ rotation.T
    path = attitudes(time, turning)
    middle = int(np.searchsorted(time, rest.imu.time.mean()))
    level = path[middle].apply(at_rest / np.linalg.norm(at_rest))
    return np.asarray(path.inv().apply(level))


def _felt_by_feet(
    robot: RobotModel,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    turning: FloatArray,
    up: FloatArray,
    standing: NDArray[np.bool_],
) -> FloatArray:
    """(n, 3) acceleration of the base's origin less gravity, if the standing feet's contact points do not move."""
    base = np.empty((len(time), 3))
    rows = np.repeat(standing, 3)
    for index in range(len(time)):
        jacobian = contact_jacobians(robot, position[index], up[index])[rows]
        moved = jacobian[:, 3:] @ np.concatenate([turning[index], velocity[index]])
        base[index] = -moved.reshape(-1, 3).mean(axis=0)
    return np.gradient(base, time, axis=0) + np.cross(turning, base) + _GRAVITY * up
