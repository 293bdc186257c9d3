"""Orientation of the IMU by Wahba's problem, from rotations of the base with four feet on the floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.recording.event import PHASE
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

REST_TIME = 0.15
"""Time at the end of each rest over which samples are averaged [s]."""
_FLOOR_STD = np.radians(0.5)  # of gravity in the base frame: floor slope, joint offsets, accelerometer bias
_TURN_STD = np.radians(0.1)  # of a rotation, across its axis: rolling and compliant feet, misaligned gyroscope
_EXCHANGES = {
    "": (0, 1, 2, 3),
    "left and right legs are exchanged": (1, 0, 3, 2),
    "front and rear legs are exchanged": (2, 3, 0, 1),
    "legs are exchanged across both diagonals": (3, 2, 1, 0),
}


@dataclass(frozen=True, eq=False)
class Wiring:
    """Hypothesis on how the model's joints are connected to the robot's.

    Attributes:
        cause: description of the difference from the model; "" if there is none.
        legs: index of the model's leg that each leg FL FR RL RR is connected as.
        hips: (4,) signs of the hips of the legs FL FR RL RR.
    """

    cause: str
    legs: tuple[int, ...]
    hips: tuple[float, ...]

    def applied(self, robot: RobotModel, joint_position: FloatArray) -> FloatArray:
        """Return the (n, nj) actual joint positions from the (n, nj) reported ones [rad]."""
        actual = joint_position.copy()
        for leg, source, sign in zip(robot.leg_joints, self.legs, self.hips, strict=True):
            actual[:, leg] = joint_position[:, robot.leg_joints[source]]
            actual[:, leg[0]] *= sign
        return actual


@dataclass(frozen=True, eq=False)
class Orientation:
    """Orientation of the IMU that fits best under one hypothesis.

    Attributes:
        wiring: hypothesis.
        rotation: (3, 3) rotation matrix from IMU axes to base axes.
        residual: difference between predicted and measured rotations, RMS, as a fraction of the rotations.
        std: standard deviation about the least certain axis [rad].
    """

    wiring: Wiring
    rotation: FloatArray
    residual: float
    std: float


def wirings(robot: RobotModel) -> Iterator[Wiring]:
    """Generate all hypotheses, the model's own first, then those with the fewest differences."""
    signs = [(1.0,) * 4] if robot.leg_joints.shape[1] < 3 else product((1.0, -1.0), repeat=4)
    for hips, (exchange, legs) in sorted(product(signs, _EXCHANGES.items()), key=_differences):
        flipped = [leg for leg, sign in zip(LEG_NAMES, hips, strict=True) if sign < 0]
        sign = f"the signs of the hips {', '.join(flipped)} are wrong" if flipped else ""
        yield Wiring(" and ".join(filter(None, (exchange, sign))), legs, hips)


def _differences(candidate: tuple[tuple[float, ...], tuple[str, tuple[int, ...]]]) -> tuple[int, int]:
    hips, (exchange, _) = candidate
    flipped = hips.count(-1.0)
    return bool(exchange) + bool(flipped), flipped % 4


def fit_orientation(robot: RobotModel, recording: Recording, wiring: Wiring) -> Orientation:
    """Fit the rotation from IMU to base under a hypothesis on the joints.

    The encoders and the integral of the gyroscope each measure the base's rotation between two rests, independent of
    delays. Gravity in the first rest is one more vector.

    Args:
        recording: recording with phases "rest", the first one before the base turns.
    """
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - a third of a second to import

    times, positions, measured, gravity = _between_rests(recording)
    predicted, up = _turns_of_base(robot, wiring.applied(robot, positions))
    weights = np.array([_TURN_STD**-2] * len(measured) + [_FLOOR_STD**-2])
    rotation, bias = Rotation.identity(), np.zeros(3)
    for _ in range(3):  # the bias depends on the rotation, and the rotation on the bias
        turned = measured - np.diff(times)[:, None] * bias
        rotation = Rotation.align_vectors(np.vstack([predicted, up]), np.vstack([turned, gravity]), weights)[0]
        bias = (measured - rotation.inv().apply(predicted)).sum(axis=0) / (times[-1] - times[0])
    difference = rotation.apply(measured - np.diff(times)[:, None] * bias) - predicted
    # Differences along the rotation axis are due to gains and compliance, and do not depend on the orientation.
    across = np.cross(difference, predicted) / np.linalg.norm(predicted, axis=1, keepdims=True)
    std = max(_TURN_STD, float(np.sqrt((across**2).sum() / (2 * len(across) - 3))))
    vectors = np.vstack([predicted / std, up / _FLOOR_STD])
    information = (vectors**2).sum() * np.eye(3) - vectors.T @ vectors
    residual = float(np.linalg.norm(difference) / np.linalg.norm(predicted))
    return Orientation(wiring, rotation.as_matrix(), residual, float(np.linalg.eigvalsh(information)[0] ** -0.5))


def _turns_of_base(robot: RobotModel, joint_position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Predict rotations of the base over spherical feet that roll without slipping.

    Args:
        joint_position: (n, nj) joint positions in n rests [rad].

    Returns:
        (n - 1, 3) rotation vectors from each rest to the next, in base axes [rad], and (1, 3) the floor's upward unit normal
        in the first rest, in base axes.
    """
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - a third of a second to import

    kinematics, legs = Kinematics(robot), robot.legs.values()
    radii = np.array([[leg.foot_radius] for leg in legs])
    feet = np.array([kinematics.foot_positions(row) for row in joint_position])
    poses = [kinematics.joint_poses(row) for row in joint_position]
    shanks = [Rotation.from_matrix(np.array([pose[leg.joint_ids[-1]].rotation for leg in legs])) for pose in poses]
    normals, centred = floor_normals_by_fit(feet)[0], feet - feet.mean(axis=1, keepdims=True)
    turns: list[FloatArray] = []
    for k in range(len(feet) - 1):
        turn, rolled = Rotation.identity(), np.zeros((4, 3))
        for _ in range(2):  # the rolling of the feet depends on the base's rotation
            turn = Rotation.align_vectors(centred[k] + rolled - rolled.mean(axis=0), centred[k + 1])[0]
            rolled = np.cross((turn * shanks[k + 1] * shanks[k].inv()).as_rotvec(), radii * normals[k])
        turns.append(turn.as_rotvec())
    return np.array(turns), normals[:1]


def _between_rests(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the joint positions in the n rests, the rotations between them, and gravity.

    Returns:
        (n,) times [s], (n, nj) joint positions [rad], (n - 1, 3) integrals of the gyroscope in between [rad], and (1, 3) unit
        vector upward in the IMU frame in the first rest.
    """
    phases = [event for event in recording.events if event.name == PHASE]
    ends = [event.time for event in phases[1:]] + [float(recording.joints.time[-1])]
    rests = [
        recording.between(end - REST_TIME, end)
        for event, end in zip(phases, ends, strict=True)
        if event.data["name"] == Phase.REST
    ]
    positions = np.array([rest.joints.position.mean(axis=0) for rest in rests])
    times = np.array([rest.imu.time.mean() for rest in rests])
    imu = recording.imu
    rate, step = imu.angular_velocity_in_imu, np.diff(imu.time)[:, None]
    turned = np.vstack([np.zeros(3), np.cumsum((rate[1:] + rate[:-1]) / 2 * step, axis=0)])
    columns: list[FloatArray] = [np.interp(times, imu.time, column) for column in turned.T]
    gravity = rests[0].imu.acceleration_in_imu.mean(axis=0)
    return times, positions, np.diff(np.array(columns).T, axis=0), gravity[None] / np.linalg.norm(gravity)
