"""Crawl of a simulated robot for logs: one foot after the other, with the body over the other three.

The foot order is that of the creeping gait (McGhee and Frank 1968, On the stability properties of quadruped creeping gaits).
The motion is open-loop. Forward speed, sidestep and turning rate vary slowly.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.lab.gaits.gait_log import logged
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.recording.recording import Recording
from equipoise.robot.floor import over_three_feet
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import inverse_kinematics_best_effort
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.simulated import SimulatedPlatform

# On an A1; lengths and times are multiplied by those of the stance's scale.
STANDING = 1.0  # [s] before the first step
ORDER = ("RL", "FL", "RR", "FR")
SHIFT, SWING, HEIGHT = 0.9, 0.7, 0.05  # durations of body shift and foot swing [s], swing height [m]
SPEED, SIDESTEP, TURN = 0.03, 0.01, 0.06  # [m/s], [m/s], [rad/s], largest
_CHANGES = (17.0, 11.0, 23.0)  # [s], periods of these
_OVER = 0.9  # of the way from the middle of four feet to that of the three standing feet


class Crawl:
    """Command of each control period."""

    def __init__(self, robot: RobotModel, phase: float = 0.0) -> None:
        self._robot, self._stance, self._phase = robot, nominal_stance(robot), phase
        self._joint_position = np.array(self._stance.joint_position)
        self._com = composite_parameters(robot, self._stance.joint_position).com[:2]
        # In the world: footholds, centre and heading of the next footholds, and position of the body.
        self._footholds = self._stance.feet_in_base[:, :2].copy()
        self._place, self._heading = np.zeros(2), 0.0
        self._body = self._from = self._to = np.zeros(2)
        self._facing = self._faced = 0.0
        self._begun, self._landing = -1, np.zeros(2)

    def command(self, time: float, state: RobotState) -> JointCommand:
        """Return the command at a time since the beginning [s]."""
        since = time / self._stance.scale.time - STANDING
        raised = np.zeros(4)
        footholds = self._footholds.copy()
        if since > 0:
            number, within = divmod(since, SHIFT + SWING)
            leg = LEG_NAMES.index(ORDER[int(number) % 4])
            if int(number) > self._begun:
                self._begin(int(number), leg)
            part = _smooth(within / SHIFT)
            self._body = (1 - part) * self._from + part * self._to
            self._facing = (1 - part) * self._faced + part * self._heading
            way = (within - SHIFT) / SWING
            over = _smooth(2 * way - 0.5)
            footholds[leg] = (1 - over) * self._footholds[leg] + over * self._landing
            raised[leg] = HEIGHT * self._stance.scale.length * _smooth(3 * min(way, 1 - way))
        feet = np.column_stack(
            [(footholds - self._body) @ _turn(self._facing), self._stance.feet_in_base[:, 2] + raised]
        )
        self._joint_position = inverse_kinematics_best_effort(self._robot, feet, self._joint_position)
        return JointCommand(position=self._joint_position)

    def _begin(self, number: int, leg: int) -> None:
        """Plan the next step: foothold, and position of the body during the swing."""
        scale, step = self._stance.scale, (SHIFT + SWING) * self._stance.scale.time
        if number > 0:
            self._footholds[LEG_NAMES.index(ORDER[(number - 1) % 4])] = self._landing
        self._begun, self._from, self._faced = number, self._body, self._facing
        waves = np.sin(
            2 * np.pi * number * (SHIFT + SWING) / np.array(_CHANGES) + self._phase + np.array([1.0, 2.0, 3.0])
        )
        forward, left = scale.length / scale.time * np.array([SPEED * (2 + waves[0]) / 3, SIDESTEP * waves[1]])
        turning = TURN / scale.time * waves[2]
        self._heading += turning * step
        self._place = self._place + _turn(self._heading) @ (forward, left) * step
        # A foot stands for three of four steps: it lands at its position in the middle of them.
        ahead = self._heading + 1.5 * step * turning
        place = self._place + 1.5 * step * (_turn(ahead) @ (forward, left))
        self._landing = place + _turn(ahead) @ self._stance.feet_in_base[leg, :2]
        self._to = over_three_feet(self._footholds, leg, _OVER) - _turn(self._heading) @ self._com


def _smooth(part: float) -> float:
    """Return a smooth transition from zero to one."""
    return float(0.5 - 0.5 * np.cos(np.pi * np.clip(part, 0.0, 1.0)))


def _turn(angle: float) -> FloatArray:
    """Return the (2, 2) rotation to the left."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def crawl(platform: SimulatedPlatform, robot: RobotModel, duration: float, phase: float = 0.0) -> Recording:
    """Return the log of a robot that stands for a second and then crawls, without events.

    Args:
        duration: total time [s].
        phase: initial phase of the variation of speed, sidestep and turn [rad].

    Raises:
        FallError: the simulation became unstable.
    """
    return logged(platform, robot, Crawl(robot, phase).command, duration)
