"""Largest tilt of a robot on two feet from which it can come to rest on four.

On two feet the robot is an inverted pendulum. Let a be the lean of its CoM from the vertical over the line between the
feet, h the CoM's height over that line, and I the moment of inertia about it. Then

    a'' = w^2 a,    w^2 = m g h / I,    x = a + a' / w,    x(t) = x(0) e^(w t).

h x is the capture point of the CoM. With four feet down, the centre of pressure is within the edge of the feet, at a
distance r from the line: the robot comes to rest on them if h x < r when the feet touch down. Compliant legs push late,
so the safe limit is smaller:

    h x_down = SAFE r.                                                                              (1)

A robot that tips from rest touches down with a = x / 2, nearly. A foot at a distance b from the line is then on the floor
once it is lower than b (x_down / 2 - |a_0|). For a lift of height H that is lowered along a smooth step s within T,

    s(t / T) = 1 - b (x_down / 2 - |a_0|) / H.                                                      (2)

With the delay d, the stop is at x_stop = x_down e^(-w (t + d)), minus the uncertainty of the CoM. From rest at a_0 a robot
reaches it after ln(x_stop / |a_0|) / w. Without a stop a robot lands at the latest with a = |a_0| + H / b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.experiments.tilt import line_axes
from equipoise.platform.ramp import smooth_step
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

SAFE = 0.6
"""Largest capture point at touchdown, as a fraction of the distance from the support line to the edge of the feet.
Simulated robots of the catalogue fell above 0.73, with drives 30 % softer above 0.69, and above 0.53 if they tipped onto
a foot that was still up: lifts end before."""
_STEP = np.concatenate([[0.0], smooth_step(100)])


@dataclass(frozen=True, eq=False)
class Pendulum:
    """Inverted pendulum of a robot on two feet. Pairs are for tipping backward and forward.

    Attributes:
        lean: angle of the CoM, positive forward [rad].
        along: position of the CoM along the line, to the left of its middle [m].
        height: height of the CoM over the line [m].
        rate: exponential rate w of the tipping [1/s].
        spin: ratio of the moment of inertia about the CoM to that about the line.
        room: distance from the line to the edge of the feet, along the path of the CoM [m].
        arm: distance of the lifted foot on that side from the line [m].
        normal_in_base: (3,) horizontal unit vector forward across the line, in base axes.
        axis_in_base: (3,) axis in base axes along which the base's rotation adds to the lean.
        joints: (nj,) derivatives of the lean with respect to the joint positions.
    """

    lean: float
    along: float
    height: float
    rate: float
    spin: float
    room: tuple[float, float]
    arm: tuple[float, float]
    normal_in_base: FloatArray
    axis_in_base: FloatArray
    joints: FloatArray

    @classmethod
    def of(cls, robot: RobotModel, joint_position: FloatArray, up_in_base: FloatArray, diagonal: str) -> Pendulum:
        """Return the pendulum of an assumed robot model.

        Args:
            joint_position: (nj,) joint positions with four feet on the floor [rad].
            up_in_base: (3,) unit vector against gravity in base axes.
            diagonal: diagonal to stand on.
        """
        left, normal, middle = line_axes(robot, joint_position, up_in_base, diagonal)
        body = composite_parameters(robot, joint_position)
        arm = body.com - middle
        height, along = float(arm @ up_in_base), float(arm @ left)
        about_com = float(left @ body.inertia @ left)
        about_line = about_com + robot.mass * float(np.sum(np.cross(left, arm) ** 2))
        kinematics = Kinematics(robot)
        feet, jacobians = kinematics.feet_and_jacobians(joint_position)
        standing = [leg in DIAGONALS[diagonal] for leg in LEG_NAMES]
        places = np.column_stack([(feet - middle) @ left, (feet - middle) @ normal])
        half_length = float(np.abs(places[standing, 0]).max())
        sides = [_side(places[~np.array(standing)], side, along, half_length) for side in (-1, 1)]
        com_moves = kinematics.com_jacobian(joint_position)
        for index in np.flatnonzero(standing):
            com_moves[:, robot.leg_joints[index]] -= jacobians[index] / 2
        return cls(
            float(arm @ normal) / height,
            along,
            height,
            float(np.sqrt(robot.mass * GRAVITY * height / about_line)),
            about_com / about_line,
            (sides[0][0], sides[1][0]),
            (sides[0][1], sides[1][1]),
            normal,
            np.cross(arm, normal) / height,
            normal @ com_moves / height,
        )

    @property
    def ahead(self) -> float:
        """Horizontal distance of the CoM ahead of the line [m]."""
        return self.lean * self.height

    def from_rest(self, more: float) -> float:
        """Return x after the lean has increased by `more`, to the side of the lean [rad]."""
        return _from_rest(abs(self.lean), abs(self.lean) + more)

    def landing(self, lift_height: float) -> tuple[float, float]:
        """Return x at the landing of the lifted foot without a stop, on either side [rad]."""
        return self._sides(lambda lean, room, arm: _from_rest(lean, lean + lift_height / arm))

    def stop(self, lift_height: float, lower_time: float, delay: float, doubt: float = 0.0) -> tuple[float, float]:
        """Return x at which lowering must start, on either side [rad]; infinite if the feet always touch down in time.

        Args:
            lift_height: height H of the lift [m].
            lower_time: time T of lowering [s].
            delay: delay d from the stop until the feet move [s].
            doubt: uncertainty of the CoM's distance from the line [m].
        """

        def side(lean: float, room: float, arm: float) -> float:
            down, margin = SAFE * room / self.height, doubt / self.height
            lean = lean + margin
            if _from_rest(lean, lean + lift_height / arm) <= down:
                return np.inf
            lowered = 1 - arm * (down / 2 - lean) / lift_height  # (2)
            time = lower_time * float(np.interp(lowered, _STEP, np.linspace(0, 1, len(_STEP))))
            return down * float(np.exp(-self.rate * (time + delay))) - margin

        return self._sides(side)

    def time_until(self, stop: tuple[float, float]) -> float:
        """Return the time from rest to x [s]."""
        reached = stop[self.lean > 0]
        return float(np.log(max(reached, 1e-9) / max(abs(self.lean), 1e-9)) / self.rate)

    def _sides(self, of: Callable[[float, float, float], float]) -> tuple[float, float]:
        """Evaluate a function of lean to a side, room and arm for both sides."""
        back, ahead = (
            of(max(sign * self.lean, 0.0), *pair)
            for sign, pair in zip((-1, 1), zip(self.room, self.arm, strict=True), strict=True)
        )
        return back, ahead


def _from_rest(start: float, lean: float) -> float:
    """Return x of a pendulum at `lean` that started at rest at `start` [rad]."""
    return lean + float(np.sqrt(lean**2 - start**2))


def _side(lifted: FloatArray, side: int, along: float, half_length: float) -> tuple[float, float]:
    """Return room and arm on a side of the line [m].

    Args:
        lifted: (2, 2) positions of the lifted feet along the line and ahead of it, from its middle [m].
        along: position of the CoM along the line [m].
        half_length: half of the distance between the standing feet [m].
    """
    foot_along, ahead = lifted[int(np.argmax(side * lifted[:, 1]))]
    arm = float(side * ahead)
    sign = 1 if along < foot_along else -1
    share = (half_length + sign * along) / (half_length + sign * foot_along)
    return arm * float(share), arm
