"""Simulated robots whose joints or IMU are not connected as in their models."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from equipoise.platform.platform import Platform, TiltLimit, Trajectory
from equipoise.platform.stepped import PlatformWrapper
from equipoise.robot.model import LEG_NAMES

EXCHANGES = {
    "none": (0, 1, 2, 3),
    "left and right": (1, 0, 3, 2),
    "front and rear": (2, 3, 0, 1),
    "across both diagonals": (3, 2, 1, 0),
}


def wiring(robot, exchange="none", hips: Sequence[str] = ()):
    """Indices of the robot's joints in the order of the model's, and their signs, with legs exchanged and hips reversed."""
    order, sign = np.arange(len(robot.joint_names)), np.ones(len(robot.joint_names))
    for leg, source in enumerate(EXCHANGES[exchange]):
        order[robot.leg_joints[source]] = robot.leg_joints[leg]
        if LEG_NAMES[leg] in hips:
            sign[robot.leg_joints[source][0]] = -1
    return order, sign


class Miswired(PlatformWrapper):
    """Robot whose joint order[j] executes the command of the model's joint j, times its sign.

    Args:
        sensed: whether encoders are connected like the motors; False: as in the model.
        imu: (3, 3) rotation matrix from the axes of the robot's IMU to those of the mounted one.
    """

    def __init__(self, inner: Platform, order=None, sign=None, sensed=True, imu=None) -> None:
        super().__init__(inner)
        joints = len(inner.joint_names)
        self._order = np.arange(joints) if order is None else np.array(order)
        self._sign = np.ones(joints) if sign is None else np.array(sign)
        self._sensed, self._imu = sensed, np.eye(3) if imu is None else imu

    def read(self):
        return self._wired(super().read())

    def _wired(self, state):
        vectors = {
            name: self._out(getattr(state, name)) for name in ("joint_position", "joint_velocity", "joint_torque")
        }
        turned = {
            name: getattr(state, name) @ self._imu.T for name in ("angular_velocity_in_imu", "acceleration_in_imu")
        }
        return replace(state, **vectors, **turned)

    def step(self, command):
        vectors = {name: self._in(getattr(command, name)) for name in ("position", "velocity", "torque")}
        gains = {name: self._in(getattr(command, name), np.ones_like(self._sign)) for name in ("kp", "kd")}
        return self._wired(self._inner.step(replace(command, **vectors, **gains)))

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None):
        vectors = {name: self._in(getattr(trajectory, name)) for name in ("position", "velocity", "torque")}
        gains = {name: self._in(getattr(trajectory, name), np.ones_like(self._sign)) for name in ("kp", "kd")}
        if stop is not None:
            stop = replace(
                stop, axis_in_imu=tuple(self._imu.T @ stop.axis_in_imu), joints=tuple(self._in(np.array(stop.joints)))
            )
        recording = self._inner.play(replace(trajectory, **vectors, **gains), stop)
        joints, imu, commands = recording.joints, recording.imu, recording.commands
        return replace(
            recording,
            joints=replace(
                joints, **{name: self._out(getattr(joints, name)) for name in ("position", "velocity", "torque")}
            ),
            imu=replace(
                imu,
                angular_velocity_in_imu=imu.angular_velocity_in_imu @ self._imu.T,
                acceleration_in_imu=imu.acceleration_in_imu @ self._imu.T,
            ),
            commands=commands and replace(commands, position=commands.position[:, self._order] * self._sign),
        )

    def _in(self, values, sign=None):
        """Convert values of the model's joints to the robot's."""
        if values is None:
            return None
        connected = np.empty_like(values)
        connected[..., self._order] = values * (self._sign if sign is None else sign)
        return connected

    def _out(self, values):
        """Convert values of the robot's joints to the model's."""
        return values if values is None or not self._sensed else values[..., self._order] * self._sign
