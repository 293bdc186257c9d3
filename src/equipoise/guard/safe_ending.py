"""The safe ending: what is done with a robot when a run is over, whatever ended it.

    feet down   two feet in the air go back to where they stood            if the link lives and the base is upright enough
    lie down    under control, watched as any motion                       if nothing is wrong with the robot
    damp        stiffness fades, then joints only resist being moved       where gains can be sent; at once if the link is bad

until nothing moves any more. Then the guard releases the motors. No stage keeps the next from being tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.guard.footing import Footing
from equipoise.guard.soft_start import softened
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.ramp import smooth_step
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lies, lying_posture

FEET_DOWN, LIE_DOWN, FADE = 0.3, 2.5, 0.5  # [s] on an A1; a longer way takes longer
_SPEED_SHARE, _PEAK = 0.5, 1.875  # of a joint's speed limit, at most; peak over mean speed of a smooth ramp
_HOPELESS = 0.8  # [rad] of tilt beyond which putting feet down catches nobody
_PULL = 0.15  # [rad] from where a joint is to where it is sent: an A1's knee gives 15 Nm for it, and needs 8 to stand
_FAR = 0.3  # [rad] from where it was sent: the joint obeys no longer, or the robot has sunk meanwhile
# Damped robots of the catalogue sink to the floor in 0.9 to 2.3 s (HyQ; over its scale of time), at 0.2 to 0.9 m/s (B1: what a
# drop of 4 cm ends with). Twice the damping takes twice as long, and HyQ rolled over.
_LONGEST = 4.0  # [s] on an A1
_STILL_TIME, _STILL = 0.3, 0.02  # [s], [rad] that no joint moved by meanwhile
_FAILURES, _FAILING_TIME = 25, 0.25  # in a row, [s]: nothing gets through


@dataclass(frozen=True, eq=False)
class Situation:
    """What is known of a robot when its run ends.

    Attributes:
        sent: the last command.
        planted: the last one with all feet on the floor.
        here: (nj,) where the joints were when that was last believed [rad].
        tilt: of the base from upright [rad].
        well: whether nothing is wrong with the robot itself.
        heard: whether the link lives.
        believed: whether sensors can be believed.
    """

    sent: JointCommand
    planted: JointCommand
    here: FloatArray
    tilt: float
    well: bool
    heard: bool
    believed: bool


class WatchedSteps(Protocol):
    """What the ending needs of a watched robot."""

    footing: Footing
    own_gains: tuple[FloatArray, FloatArray] | None

    def step(self, command: JointCommand) -> RobotState: ...
    def push(self, command: JointCommand) -> RobotState: ...


class SafeEnding:
    """Puts a robot down.

    Args:
        watched: the robot: its steps raise when a limit is passed, its pushes do not.
        period: of control [s].
        asked: whether somebody wants it to be over now.

    Attributes:
        done: what was done, in order.
    """

    def __init__(
        self,
        watched: WatchedSteps,
        robot: RobotModel,
        stance: Stance,
        period: float,
        asked: Callable[[], bool],
    ) -> None:
        self._robot, self._stance, self._period = robot, stance, period
        self._watched, self._footing, self._own_gains = watched, watched.footing, watched.own_gains
        self._asked = asked
        self._failures, self._failing_since = 0, 0.0
        self._last = JointCommand(stance.joint_position)
        self._here: FloatArray = stance.joint_position
        self.done: list[str] = []

    def put_down(self, found: Situation) -> None:
        """All stages that make sense."""
        self._last, self._here = found.sent, found.here
        for stage in (self._put_feet_down, self._lie_down, self._damp):
            count = len(self.done)
            try:
                stage(found)
            except BaseException as failure:  # whatever it is: the next stage is tried all the same
                if len(self.done) > count:
                    self.done[-1] += f", stopped: {failure}"

    def _put_feet_down(self, found: Situation) -> None:
        if not (found.heard and found.tilt < _HOPELESS and self._footing.lifted(self._last.position)):
            return
        if lies(self._robot, self._stance, self._last.position):  # wherever it has its feet
            return
        self.done.append("feet down")
        end = JointCommand(found.planted.position, torque=found.planted.torque)
        for command in self._way_to(end, FEET_DOWN * self._stance.scale.time):
            self._send(self._gentle(command, found), found)

    def _lie_down(self, found: Situation) -> None:
        """A robot that is not well is not trusted to do this; one whose stiffness cannot fade has no other way down."""
        sound = found.heard and found.believed and (found.well or self._own_gains is None)
        near = np.abs(self._last.position - self._here).max() < _FAR
        if not (sound and near) or self._asked() or lies(self._robot, self._stance, self._here):
            return
        self.done.append("lying down")
        position, _ = lying_posture(self._robot, self._stance)
        for command in self._way_to(JointCommand(position), LIE_DOWN * self._stance.scale.time):
            if self._asked():
                self.done[-1] += ", cut short"
                return
            self._here = self._watched.step(command).joint_position
            self._last = command

    def _damp(self, found: Situation) -> None:
        if self._own_gains is None:
            self.done.append("left to its own controller")
            return
        self.done.append("damped")
        if found.heard:
            last = self._gentle(self._last, found)
            torque = np.zeros_like(last.position) if last.torque is None else last.torque
            for share in 1 - smooth_step(self._periods(FADE)):
                fading = replace(last, velocity=None, torque=share * torque)
                self._send(softened(fading, self._own_gains, share), found)
        zeros = np.zeros_like(self._last.position)
        limp = JointCommand(self._last.position, kp=zeros, kd=self._own_gains[1])
        was = self._here
        for count in range(1, self._periods(_LONGEST * self._stance.scale.time) + 1):
            self._send(limp, found)
            if count % self._periods(_STILL_TIME) == 0:
                if found.believed and found.heard and np.abs(self._here - was).max() < _STILL:
                    return
                was = self._here

    def _way_to(self, end: JointCommand, duration: float) -> list[JointCommand]:
        """Commands from the last one to another, over a time [s] or as much longer as joints need."""
        start, zeros = self._last, np.zeros_like(self._last.position)
        way = np.abs(end.position - start.position) / self._robot.velocity_limit
        duration = max(duration, _PEAK * float(way.max()) / _SPEED_SHARE)
        torques = [zeros if command.torque is None else command.torque for command in (start, end)]
        return [
            JointCommand(
                start.position + share * (end.position - start.position),
                torque=torques[0] + share * (torques[1] - torques[0]),
            )
            for share in smooth_step(self._periods(duration))
        ]

    def _periods(self, duration: float) -> int:
        return max(1, round(duration / self._period))

    def _gentle(self, command: JointCommand, found: Situation) -> JointCommand:
        """A command that pulls no joint far from where it is, if that is known: it may have gone limp meanwhile."""
        if not found.believed:
            return command
        return replace(command, position=self._here + np.clip(command.position - self._here, -_PULL, _PULL))

    def _send(self, command: JointCommand, found: Situation) -> None:
        """Unwatched. One command that fails is no reason not to send the next."""
        try:
            position = self._watched.push(command).joint_position
        except Exception:
            now = time.monotonic()
            self._failures, self._failing_since = self._failures + 1, self._failing_since or now
            if self._failures > _FAILURES or now - self._failing_since > _FAILING_TIME:
                raise
            time.sleep(self._period)
            return
        self._failures, self._failing_since, self._last = 0, 0.0, command
        if found.believed and np.isfinite(position).all():
            self._here = position
