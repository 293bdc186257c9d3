"""Endings of a run: a robot that follows its targets is lowered under control; any other is damped at once.

    it follows      feet down   lifted feet return to their last positions on the floor
                    lowered     the robot lies down, its base at 0.2 m/s or less; checked like any motion
                    damped      stiffness fades, then joints only resist motion
    it does not     damped      joints only resist motion, from the next command on

A robot does not follow if it falls, misses its targets, or its sensors or its connection fail. It is damped until it is at
rest. The ending is reported as not confirmed if no sample shows the robot at rest. A robot whose gains cannot be set cannot
be damped: it is lowered instead, unless it has fallen.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.guard.footing import damping_time, feet_are_lifted, legs_are_up
from equipoise.guard.soft_start import softened
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.ramp import smooth_step
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import LEG_NAMES
from equipoise.robot.stance import lies, lying_posture
from equipoise.robot.statics import static_torques

if TYPE_CHECKING:
    from equipoise.guard.robot_loop import RobotLoop

FEET_DOWN, LIE_DOWN, FADE = 0.3, 2.5, 0.5  # [s] on an A1; a longer path takes longer
_LOWERING = 0.2  # [m/s] of the base, at most
_SPEED_SHARE, _PEAK = 0.5, 1.875  # of a joint's speed limit, at most; peak over mean speed of a smooth ramp
_FALLEN = 1.0  # [rad] of tilt beyond which a robot that cannot be damped is not lowered either
_FAR = 0.3  # [rad] from its target: the joint no longer follows, or the robot has sunk meanwhile
_MOVED = 0.1  # [rad] by which stiff joints move once they are damped
DAMPED_TIME = 1.5  # [s] of damping, at least
STILL_TIME, STILL = 0.3, 0.02  # [s], [rad]: largest motion of a joint at rest in that time
_SILENT = 0.1  # [s] without an accepted sample: the state of the robot is not known
_LONGEST = 3  # times the usual damping, if the robot does not come to rest
NOT_CONFIRMED = "NOT CONFIRMED: it may be stiff; cut the battery"


def append_ending(path: str, text: str) -> None:
    """Append the steps of an ending to a file; do nothing if the path is empty."""
    with contextlib.suppress(OSError):
        if path:
            with open(path, "a", encoding="utf-8") as file:
                print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}", file=file)


class Ending:
    """An ending that has begun.

    Args:
        loop: loop of the robot.
        controllable: whether the robot stands and follows its targets.
        urgent: whether to skip lowering it.
        done: steps of an earlier ending that failed.

    Attributes:
        urgent: whether to skip lowering it; may be set at any time.
        controllable: as the argument, until the robot is damped; otherwise commands and samples are not checked.
        done: steps in order, from their beginning; the text of one that did not complete states it.
    """

    def __init__(self, loop: RobotLoop, controllable: bool, urgent: bool, done: Sequence[str]) -> None:
        self._loop = loop
        self.urgent, self.controllable = urgent, controllable
        self.done = list(done)
        self._silence = np.inf  # [s] without an accepted sample
        self._here: FloatArray | None = None

    def observe(self, samples: Sequence[RobotState]) -> None:
        """Record the samples of one control period."""
        self._silence = 0.0 if samples else self._silence + self._loop.period
        if samples:
            self._here = samples[-1].joint_position

    def commands(self) -> Iterator[JointCommand]:
        """Yield the commands of the ending, one per control period."""
        loop = self._loop
        assert loop.context is not None
        self._here = loop.context.state.joint_position
        # A robot that cannot be damped is lowered: lying is better than falling.
        stiff = loop.own_gains is None and loop.context.up.tilt < _FALLEN
        if stiff or (self.controllable and not self._has_sunk()):
            yield from self._feet_down(loop.context.sent, loop.context.standing)
            yield from self._lowered()
            yield from self._faded()
        self.controllable = False
        yield from self._damped()

    def _feet_down(self, sent: JointCommand, standing: JointCommand) -> Iterator[JointCommand]:
        loop = self._loop
        if lies(loop.robot, loop.stance, sent.position) or not feet_are_lifted(loop.robot, loop.stance, sent.position):
            return
        self.done.append("feet down")
        yield from self._way_to(standing.position, standing.torque, FEET_DOWN * loop.stance.scale.time)

    def _lowered(self) -> Iterator[JointCommand]:
        loop = self._loop
        if self.urgent or lies(loop.robot, loop.stance, self._position()):
            return
        self.done.append("lowered")
        position, _ = lying_posture(loop.robot, loop.stance)
        way = foot_positions(loop.robot, position) - foot_positions(loop.robot, self._sent.position)
        height = float(np.abs(way[:, 2]).max())
        duration = max(LIE_DOWN * loop.stance.scale.time, _PEAK * height / _LOWERING)
        torque = static_torques(loop.robot, position, LEG_NAMES)  # the legs carry the robot until it lies
        for command in self._way_to(position, torque, duration):
            if self.urgent:
                self.done[-1] += ", cut short"
                return
            yield command

    def _faded(self) -> Iterator[JointCommand]:
        """Yield commands of fading stiffness, so that a robot that was not lowered sinks gently."""
        loop = self._loop
        if loop.own_gains is None:
            return
        last = self._sent.held()
        torque = np.zeros_like(last.position) if last.torque is None else last.torque
        for share in 1 - smooth_step(self._periods(FADE)):
            yield softened(replace(last, torque=share * torque), loop.own_gains, share)

    def _damped(self) -> Iterator[JointCommand]:
        """Yield damping commands until the robot is at rest; without samples, for as long as it takes to sink."""
        loop = self._loop
        if loop.own_gains is None:
            self.done.append("left to its own controller")
            return
        stiff = self._position()
        limp = JointCommand.damping(self._sent.position, loop.own_gains[1])
        self.done.append("damped")
        usual = max(DAMPED_TIME, damping_time(loop.stance, legs_are_up(loop.robot, loop.stance, self._sent.position)))
        was, still = stiff, 0.0
        for count in range(self._periods(_LONGEST * usual)):
            yield limp
            still += loop.period
            if np.abs(self._position() - was).max() > STILL:
                was, still = self._position(), 0.0
            damped, observed = count * loop.period, self._silence < _SILENT
            if observed and still > STILL_TIME and damped > DAMPED_TIME:
                moved = np.abs(self._position() - stiff).max() > _MOVED
                if moved or lies(loop.robot, loop.stance, self._position()) or damped > usual:
                    break
            if not observed and damped > usual:
                break
        if self._silence >= _SILENT or still <= STILL_TIME:
            self.done[-1] = f"damping commands were sent; {NOT_CONFIRMED}"

    @property
    def _sent(self) -> JointCommand:
        assert self._loop.context is not None
        return self._loop.context.sent

    def _position(self) -> FloatArray:
        assert self._here is not None
        return self._here

    def _has_sunk(self) -> bool:
        """Return whether at most one leg is near its targets: returned to them, the legs would lift the robot."""
        away = np.abs(self._sent.position - self._position())[self._loop.robot.leg_joints].max(axis=1)
        return int((away > _FAR).sum()) >= len(away) - 1

    def _way_to(self, end: FloatArray, torque: FloatArray | None, duration: float) -> Iterator[JointCommand]:
        """Yield commands from the last one to (nj,) joint positions, over a time [s] that joint speeds may lengthen."""
        start, zeros = self._sent, np.zeros_like(end)
        way = np.abs(end - start.position) / self._loop.robot.velocity_limit
        duration = max(duration, _PEAK * float(way.max()) / _SPEED_SHARE)
        torques = [zeros if each is None else each for each in (start.torque, torque)]
        for share in smooth_step(self._periods(duration)):
            position = start.position + share * (end - start.position)
            yield JointCommand(position, torque=torques[0] + share * (torques[1] - torques[0]))

    def _periods(self, duration: float) -> int:
        return max(1, round(duration / self._loop.period))
