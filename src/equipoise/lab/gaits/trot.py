"""Trot of a simulated robot for logs. It is not a controller for real robots.

Footholds depend on the body's speed (Raibert 1986, Legged Robots That Balance), and the heights of the standing feet level the
body. Forward speed, sidestep and turning rate vary slowly.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.lab.gaits.gait_log import logged
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.recording.recording import Recording
from equipoise.robot.kinematics import Kinematics, inverse_kinematics_best_effort
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.simulated import SimulatedPlatform

# On an A1; lengths and times are multiplied by those of the stance's scale.
STANDING = 1.0  # [s] before the first step
PERIOD, SWING, HEIGHT = 0.6, 0.45, 0.06  # period [s], fraction with two feet up, swing height [m]
SPEED, SIDESTEP, TURN = 0.25, 0.12, 0.4  # [m/s], [m/s], [rad/s], largest
_CHANGES = (7.0, 5.0, 9.0)  # [s], periods of these
_STARTING = 1.5  # [s]
_LEVELLING, _STRETCHING = 0.4, 0.08  # fraction of a foot's height error, and time constant [s]
_CAPTURE, _FARTHEST = 0.5, 0.1  # fraction of the step that would stop the body, and largest step [m]
_SENSING, _VERTICAL = 0.05, 2.5  # [s], time constants of speed and of roll and pitch


class Trot:
    """Command of each control period, from the measured state."""

    def __init__(self, robot: RobotModel, period: float, phase: float = 0.0) -> None:
        self._robot, self._stance, self._period, self._phase = robot, nominal_stance(robot), period, phase
        self._kinematics, self._to_base = Kinematics(robot), np.array(robot.imu_in_base.rotation)
        self._joint_position = np.array(self._stance.joint_position)
        self._shift, self._left_at = np.zeros((4, 3)), np.zeros((4, 3))
        self._swung = np.zeros(4, dtype=bool)
        self._roll = self._pitch = 0.0
        self._velocity = np.zeros(2)

    def command(self, time: float, state: RobotState) -> JointCommand:
        """Return the command at a time since the beginning [s]."""
        scale = self._stance.scale
        turning = self._update_tilt(state)
        since = time / scale.time - STANDING
        if since > 0:
            phases = (since / PERIOD + np.array([0.0, 0.5, 0.5, 0.0])) % 1.0
            self._step(phases, state, turning, self._target_velocity(since))
        self._joint_position = inverse_kinematics_best_effort(
            self._robot, self._stance.feet_in_base + self._shift, self._joint_position
        )
        return JointCommand(position=self._joint_position)

    def _target_velocity(self, since: float) -> FloatArray:
        """Return the (3,) velocity forward and to the left [m/s], and turning rate to the left [rad/s]."""
        scale, begun = self._stance.scale, min(1.0, since / _STARTING)
        waves = np.sin(2 * np.pi * since / np.array(_CHANGES) + self._phase + np.array([0.0, 1.0, 2.0]))
        speed = scale.length / scale.time
        return begun * waves * np.array([SPEED * speed, SIDESTEP * speed, TURN / scale.time])

    def _update_tilt(self, state: RobotState) -> FloatArray:
        """Update roll and pitch from gyroscope and accelerometer; return the angular velocity in base axes."""
        turning = self._to_base @ state.angular_velocity_in_imu
        force = self._to_base @ state.acceleration_in_imu
        step = self._period / (_VERTICAL * self._stance.scale.time)
        self._roll += turning[0] * self._period + step * (np.arctan2(force[1], force[2]) - self._roll)
        self._pitch += turning[1] * self._period + step * (np.arctan2(-force[0], force[2]) - self._pitch)
        return turning

    def _step(self, phases: FloatArray, state: RobotState, turning: FloatArray, target: FloatArray) -> None:
        scale, swings = self._stance.scale, phases < SWING
        if not swings.all():
            self._velocity += (
                self._period / (_SENSING * scale.time) * (self._speed_over(~swings, state, turning) - self._velocity)
            )
        for leg, foot in enumerate(self._stance.feet_in_base):
            back = -target[:2] - target[2] * np.array([-foot[1], foot[0]])
            if swings[leg]:
                if not self._swung[leg]:
                    self._left_at[leg] = self._shift[leg]
                self._swing(leg, phases[leg] / SWING, back, target[:2])
            else:
                self._shift[leg, :2] += back * self._period
                level = -_LEVELLING * (self._pitch * foot[0] - self._roll * foot[1])
                self._shift[leg, 2] += self._period / (_STRETCHING * scale.time) * (level - self._shift[leg, 2])
        self._swung = swings

    def _swing(self, leg: int, way: float, back: FloatArray, target: FloatArray) -> None:
        scale = self._stance.scale
        stopping = np.sqrt(self._stance.hip_height / GRAVITY) * (self._velocity - target)
        ahead = -back * 0.5 * (1 - SWING) * PERIOD * scale.time + _CAPTURE * stopping
        ahead = np.clip(ahead, -_FARTHEST * scale.length, _FARTHEST * scale.length)
        part = 0.5 - 0.5 * np.cos(np.pi * way)
        self._shift[leg, :2] = (1 - part) * self._left_at[leg, :2] + part * ahead
        self._shift[leg, 2] = (1 - part) * self._left_at[leg, 2] + HEIGHT * scale.length * np.sin(np.pi * way) ** 2

    def _speed_over(self, standing: np.ndarray, state: RobotState, turning: FloatArray) -> FloatArray:
        """Return the (2,) velocity of the base over the standing feet, forward and to the left [m/s]."""
        feet, jacobians = self._kinematics.feet_and_jacobians(state.joint_position)
        assert state.joint_velocity is not None  # a simulated robot measures it
        joints = state.joint_velocity[self._robot.leg_joints]
        moving = np.einsum("lij,lj->li", jacobians, joints) + np.cross(turning, feet)
        return -moving[standing, :2].mean(axis=0)


def trot(platform: SimulatedPlatform, robot: RobotModel, duration: float, phase: float = 0.0) -> Recording:
    """Return the log of a robot that stands for a second and then trots, without events.

    Args:
        duration: total time [s].
        phase: initial phase of the variation of speed, sidestep and turn [rad].

    Raises:
        FallError: the simulation became unstable.
    """
    return logged(platform, robot, Trot(robot, platform.control_period, phase).command, duration)
