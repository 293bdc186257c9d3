"""Recordings that come in pieces, as even steps: what is drawn needs fewer samples than what is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from equipoise.conventions import FloatArray
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel

STEP = 0.01
"""[s]: every second of them is a picture."""


@dataclass(frozen=True, eq=False)
class SensedSteps:
    """n even steps.

    Attributes:
        time: (n,) ends of the steps [s].
        joint_position, joint_torque: (n, nj) values at those times [rad], [Nm]; a torque that is not known is zero.
        angular_velocity_in_base: (n, 3) mean over the step [rad/s].
        specific_force_in_base: (n, 3) mean over the step [m/s2].
    """

    time: FloatArray
    joint_position: FloatArray
    joint_torque: FloatArray
    angular_velocity_in_base: FloatArray
    specific_force_in_base: FloatArray


class EvenSteps:
    """Turns pieces of a recording into even steps; what is left of a piece goes into the next."""

    def __init__(self, robot: RobotModel) -> None:
        self._to_base = np.array(robot.imu_in_base.rotation).T
        self._joints: tuple[FloatArray, FloatArray] | None = None  # times, and positions with torques beside them
        self._imu: tuple[FloatArray, FloatArray] | None = None  # times, and both sensors beside each other
        self._edge: float | None = None

    def take(self, piece: Recording) -> SensedSteps | None:
        """The steps that are complete now; None if none is."""
        joints, imu = piece.joints, piece.imu
        torque = np.zeros_like(joints.position) if joints.torque is None else joints.torque
        self._joints = _joined(self._joints, joints.time, np.hstack([joints.position, torque]))
        sensed = np.hstack([imu.angular_velocity @ self._to_base, imu.acceleration @ self._to_base])
        self._imu = _joined(self._imu, imu.time, sensed)
        (joint_time, values), (imu_time, sensed) = self._joints, self._imu
        if not (len(joint_time) > 1 and len(imu_time) > 1):
            return None
        if self._edge is None:
            self._edge = max(float(joint_time[0]), float(imu_time[0]))
        count = int((min(joint_time[-1], imu_time[-1]) - self._edge) / STEP + 1e-6)
        if count < 1:
            return None
        edges: FloatArray = np.asarray(self._edge + STEP * np.arange(count + 1), dtype=float)
        integral = np.asarray(cumulative_trapezoid(sensed, imu_time, axis=0, initial=0), dtype=float)
        means = np.diff(_at(edges, imu_time, integral), axis=0) / STEP
        position, torque = np.hsplit(_at(edges[1:], joint_time, values), 2)
        self._edge = float(edges[-1])
        self._joints, self._imu = _since(self._edge, self._joints), _since(self._edge, self._imu)
        return SensedSteps(edges[1:], position, torque, means[:, :3], means[:, 3:])


def _joined(
    before: tuple[FloatArray, FloatArray] | None, time: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return (time, values) if before is None else (np.append(before[0], time), np.vstack([before[1], values]))


def _since(start: float, stream: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """The part from the last sample before a time on."""
    first = max(0, int(np.searchsorted(stream[0], start, side="right")) - 1)
    return stream[0][first:], stream[1][first:]


def _at(time: FloatArray, sampled: FloatArray, values: FloatArray) -> FloatArray:
    """(n, k) columns of values at n times: linear in between."""
    return np.column_stack([np.interp(time, sampled, values[:, column]) for column in range(values.shape[1])])
