"""How far a robot may tip on two feet, so that it stays on the four that it stands on once the others are down.

On two feet the robot is an inverted pendulum. With a the lean of its CoM from above the line between the feet, h the CoM's
height over that line and I the moment of inertia about it,

    a'' = w^2 a,    w^2 = m g h / I,    x = a + a' / w,    x(t) = x(0) e^(w t).

x is where the CoM is on its way to (its capture point, over h). With four feet down the floor can push no farther out than
the edge of the feet, at a distance r from the line: the robot comes to rest on them if h x < r when the feet come down. Legs
that give way push late, so that less is safe:

    h x_down = SAFE r.                                                                              (1)

A robot that tips from rest comes down with a = x / 2, nearly. Then a foot at a distance b from the line is on the floor once
it hangs lower than b (x_down / 2 - |a_0|): of a lift of height H that is lowered along a smooth step s within T,

    s(t / T) = 1 - b (x_down / 2 - |a_0|) / H.                                                      (2)

The stop, its delay d before, is at x_stop = x_down e^(-w (t + d)), less what is not known of the CoM; and from rest at a_0 a
robot gets there in ln(x_stop / |a_0|) / w. Without a stop a robot lands at the latest with a = |a_0| + H / b.
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
"""Of the room between a support line and the edge of the feet: how much of it a robot may be on its way to when they come
down. Simulated robots of the catalogue fell from 0.73 of it on, with drives 30 % softer from 0.69 on, and from 0.53 on where
they tipped onto a foot that was still held up: lifts end before."""
_STEP = np.concatenate([[0.0], smooth_step(100)])


@dataclass(frozen=True, eq=False)
class Pendulum:
    """A robot on two feet, as it would tip from rest at a posture. Pairs are for tipping backward and forward.

    Attributes:
        lean: angle of the CoM, positive forward [rad].
        along: place of the CoM along the line, to the left of its middle [m].
        height: height of the CoM over the line [m].
        rate: rate w at which it tips [1/s].
        spin: share of the moment of inertia about the line that is about the CoM.
        room: distance from the line to the edge of the feet, where the CoM would pass it [m].
        arm: distance of the foot that is lifted there from the line [m].
        normal_in_base: (3,) horizontal unit vector forward across the line, in base axes.
        axis_in_base: (3,) axis in base axes along which the base's rotation adds to the lean.
        joints: (nj,) share of each joint's motion in the lean.
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
        """Of a robot as it is believed to be.

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
        half = float(np.abs(places[standing, 0]).max())
        sides = [_side(places[~np.array(standing)], side, along, half) for side in (-1, 1)]
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
        """Of the CoM from over the line [m]."""
        return self.lean * self.height

    def from_rest(self, more: float) -> float:
        """What x is once the robot leans by so much more, to the side that it leans to [rad]."""
        return _from_rest(abs(self.lean), abs(self.lean) + more)

    def landing(self, lift_height: float) -> tuple[float, float]:
        """What x is when the lifted foot lands, if nothing stops the robot before, on either side [rad]."""
        return self._sides(lambda lean, room, arm: _from_rest(lean, lean + lift_height / arm))

    def stop(self, lift_height: float, lower_time: float, delay: float, doubt: float = 0.0) -> tuple[float, float]:
        """What x is where the feet must come down, on either side [rad]; infinite where they always come down in time.

        Args:
            lift_height: height H of the lift [m].
            lower_time: time T of lowering [s].
            delay: delay d from the stop's moment until the feet move [s].
            doubt: distance by which the CoM may be farther from the line [m].
        """

        def side(lean: float, room: float, arm: float) -> float:
            down, unsure = SAFE * room / self.height, doubt / self.height
            lean = lean + unsure
            if _from_rest(lean, lean + lift_height / arm) <= down:
                return np.inf
            lowered = 1 - arm * (down / 2 - lean) / lift_height  # (2)
            time = lower_time * float(np.interp(lowered, _STEP, np.linspace(0, 1, len(_STEP))))
            return down * float(np.exp(-self.rate * (time + delay))) - unsure

        return self._sides(side)

    def time_until(self, stop: tuple[float, float]) -> float:
        """How long it takes the robot from rest to x [s]."""
        reached = stop[self.lean > 0]
        return float(np.log(max(reached, 1e-9) / max(abs(self.lean), 1e-9)) / self.rate)

    def _sides(self, of: Callable[[float, float, float], float]) -> tuple[float, float]:
        """A function of lean to a side, room and arm, for both sides."""
        back, ahead = (
            of(max(sign * self.lean, 0.0), *pair)
            for sign, pair in zip((-1, 1), zip(self.room, self.arm, strict=True), strict=True)
        )
        return back, ahead


def _from_rest(start: float, lean: float) -> float:
    """The x of a pendulum at a lean that it reached from rest at another."""
    return lean + float(np.sqrt(lean**2 - start**2))


def _side(lifted: FloatArray, side: int, along: float, half: float) -> tuple[float, float]:
    """Room and arm on a side of the line.

    Args:
        lifted: (2, 2) places of the lifted feet along the line and ahead of it, from its middle [m].
        along: place of the CoM along the line [m].
        half: half of the distance between the standing feet [m].
    """
    foot_along, ahead = lifted[int(np.argmax(side * lifted[:, 1]))]
    arm = float(side * ahead)
    share = (half + along) / (half + foot_along) if along < foot_along else (half - along) / (half - foot_along)
    return arm * float(share), arm
