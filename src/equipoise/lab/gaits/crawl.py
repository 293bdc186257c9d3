"""A crawl of a simulated robot: one foot after the other, the body over the three that stand. For logs, as the trot is.

The classic creeping gait (McGhee and Frank 1968, On the stability properties of quadruped creeping gaits): rear left, front
left, rear right, front right. All is planned; nothing is felt. Speed, sidestep and turn change slowly.
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
SHIFT, SWING, HEIGHT = 0.9, 0.7, 0.05  # [s] in which the body moves, in which a foot does, [m]
SPEED, SIDESTEP, TURN = 0.03, 0.01, 0.06  # [m/s], [m/s], [rad/s], at most
_CHANGES = (17.0, 11.0, 23.0)  # [s] in which these come and go
_OVER = 0.9  # of the way from the middle of four feet to that of the three that will stand


class Crawl:
    """The command of each control period."""

    def __init__(self, robot: RobotModel, phase: float = 0.0) -> None:
        self._robot, self._stance, self._phase = robot, nominal_stance(robot), phase
        self._joint_position = np.array(self._stance.joint_position)
        self._com = composite_parameters(robot, self._stance.joint_position).com[:2]
        # In the room: footholds, the place and the heading that the feet are put around, and the body's place over them.
        self._footholds = self._stance.feet_in_base[:, :2].copy()
        self._place, self._heading = np.zeros(2), 0.0
        self._body = self._from = self._to = np.zeros(2)
        self._facing = self._faced = 0.0
        self._begun, self._landing = -1, np.zeros(2)

    def command(self, time: float, state: RobotState) -> JointCommand:
        """At a time since the beginning [s]."""
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
        """The next step: where the foot lands, and where the body is while it is up."""
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
        # A foot stands for three steps of four: it lands where it will be in the middle of them.
        ahead = self._heading + 1.5 * step * turning
        place = self._place + 1.5 * step * (_turn(ahead) @ (forward, left))
        self._landing = place + _turn(ahead) @ self._stance.feet_in_base[leg, :2]
        self._to = over_three_feet(self._footholds, leg, _OVER) - _turn(self._heading) @ self._com


def _smooth(part: float) -> float:
    """From zero to one, without a jerk at either end."""
    return float(0.5 - 0.5 * np.cos(np.pi * np.clip(part, 0.0, 1.0)))


def _turn(angle: float) -> FloatArray:
    """(2, 2) rotation to the left."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def crawl(platform: SimulatedPlatform, robot: RobotModel, duration: float, phase: float = 0.0) -> Recording:
    """What a robot that stands for a second, and crawls from then on, would log; without events.

    Args:
        duration: time of all [s].
        phase: where in their waves speed, sidestep and turn begin [rad].

    Raises:
        FallError: the simulation is no longer one.
    """
    return logged(platform, robot, Crawl(robot, phase), duration)
