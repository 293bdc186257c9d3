"""The safe ending: what is done with a robot when a run is over, whatever ended it.

    feet down   feet in the air go back to where they stood                if the link lives and the base is upright enough
    centre      a body over three feet goes back over all four             likewise
    lie down    under control, watched as any motion                       if nothing is wrong with the robot
    damp        stiffness fades, then joints only resist being moved       where gains can be sent; at once if the link is bad

until nothing moves any more. Then the guard releases the motors. No stage keeps the next from being tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.guard.footing import damping_time, feet_are_lifted, legs_are_up
from equipoise.guard.held_robot import HeldRobot
from equipoise.guard.known import Known
from equipoise.guard.soft_start import softened
from equipoise.platform.piece_log import PieceLog
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.ramp import smooth_step
from equipoise.platform.stepping import StepLog
from equipoise.recording.event import PHASE, Event
from equipoise.recording.phases import Phase
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance, lies, lying_posture
from equipoise.robot.statics import static_torques

FEET_DOWN, CENTRE, LIE_DOWN, FADE = 0.3, 0.6, 2.5, 0.5  # [s] on an A1; a longer way takes longer
# Of half the length or width of the feet, by which the CoM is off their middle. Over three it is a third: HyQ, damped there,
# rolled over.
_OFF_CENTRE = 0.25
_SPEED_SHARE, _PEAK = 0.5, 1.875  # of a joint's speed limit, at most; peak over mean speed of a smooth ramp
_HOPELESS = 0.8  # [rad] of tilt beyond which putting feet down catches nobody
_PULL = 0.15  # [rad] from where a joint is to where it is sent: an A1's knee gives 15 Nm for it, and needs 8 to stand
_FAR = 0.3  # [rad] from where it was sent: the joint obeys no longer, or the robot has sunk meanwhile
_STILL_TIME, _STILL = 0.3, 0.02  # [s], [rad] that no joint moved by meanwhile
_FAILURES, _FAILING_TIME = 25, 0.25  # in a row, [s]: nothing gets through


class SafeEnding:
    """Puts a robot down.

    Args:
        held: the robot: its steps raise when a limit is passed, its pushes do not.
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of commands that say none; None: gains cannot be sent.
        period: control period [s].
        asked: function that says whether somebody wants it to be over now.

    Attributes:
        done: steps that were done, in order.
    """

    def __init__(
        self,
        held: HeldRobot,
        robot: RobotModel,
        stance: Stance,
        own_gains: tuple[FloatArray, FloatArray] | None,
        period: float,
        asked: Callable[[], bool],
    ) -> None:
        self._robot, self._stance, self._period = robot, stance, period
        self._held, self._own_gains = held, own_gains
        self._asked = asked
        self._failures, self._failing_since = 0, 0.0
        self._last = JointCommand(stance.joint_position)
        self._here: FloatArray = stance.joint_position
        self._steps: StepLog | None = None
        self._sunk = False
        self.done: list[str] = []

    def put_down(self, found: Known, steps: StepLog | None) -> None:
        """All stages that make sense, noted as these steps."""
        self._last, self._here, self._steps = found.sent, found.state.joint_position, steps
        self._sunk = found.believed and self._has_sunk()
        for stage in (self._damp,) if self._sunk else (self._put_feet_down, self._centre, self._lie_down, self._damp):
            count = len(self.done)
            self._failures, self._failing_since = 0, 0.0
            try:
                stage(found)
            except BaseException as failure:  # whatever it is: the next stage is tried all the same
                if len(self.done) > count:
                    self.done[-1] += f", stopped: {failure}"

    def keep(self, log: PieceLog) -> None:
        """Log what was noted, as a motion of one phase, `ending`; raises RecordingError."""
        if self._steps is not None and self._steps.count:
            log.add(self._steps.count, self._steps.recording((Event(0.0, PHASE, {"name": Phase.ENDING}),)))

    def _put_feet_down(self, found: Known) -> None:
        if not (found.heard and found.up.tilt < _HOPELESS):
            return
        if not feet_are_lifted(self._robot, self._stance, self._last.position):
            return
        if lies(self._robot, self._stance, self._last.position):  # wherever it has its feet
            return
        self.done.append("feet down")
        end = JointCommand(found.planted.position, torque=found.planted.torque)
        for command in self._way_to(end, FEET_DOWN * self._stance.scale.time):
            self._send(self._gentle(command, found), found)

    def _centre(self, found: Known) -> None:
        """Legs of which some carry much more than others do not sink alike. One that is limp or stuck is not leant on."""
        upright = found.heard and found.up.tilt < _HOPELESS
        if not upright or self._asked() or self._may_lie_down(found):
            return
        if lies(self._robot, self._stance, self._last.position) or not self._is_off_centre():
            return
        torque = static_torques(self._robot, self._stance.joint_position, LEG_NAMES)
        end = JointCommand(self._stance.joint_position, torque=torque)
        way = (found.planted, *self._way_to(end, CENTRE * self._stance.scale.time))
        for count, command in enumerate(way):
            if found.believed and np.abs(command.position - self._here).max() > _PULL:
                return
            if count == 1:
                self.done.append("centred")
            self._send(command, found)

    def _is_off_centre(self) -> bool:
        """Whether the CoM was sent far from the middle of the feet."""
        kinematics = Kinematics(self._robot)
        feet = kinematics.foot_positions(self._last.position)[:, :2]
        off = kinematics.com(self._last.position)[:2] - feet.mean(axis=0)
        return bool((np.abs(off) > _OFF_CENTRE * np.ptp(feet, axis=0) / 2).any())

    def _may_lie_down(self, found: Known) -> bool:
        """A robot that is not well is not trusted to do this; one whose stiffness cannot fade has no other way down."""
        sound = found.heard and found.believed and (found.well or self._own_gains is None)
        near = np.abs(self._last.position - self._here).max() < _FAR
        return bool(sound and near)

    def _lie_down(self, found: Known) -> None:
        if not self._may_lie_down(found) or self._asked() or lies(self._robot, self._stance, self._here):
            return
        self.done.append("lying down")
        position, _ = lying_posture(self._robot, self._stance)
        for command in self._way_to(JointCommand(position), LIE_DOWN * self._stance.scale.time):
            if self._asked():
                self.done[-1] += ", cut short"
                return
            self._here = self._note(command, self._held.step).joint_position
            self._last = command

    def _damp(self, found: Known) -> None:
        if self._own_gains is None:
            self.done.append("left to its own controller")
            return
        self.done.append("damped")
        longest = damping_time(self._stance, legs_are_up(self._robot, self._stance, self._last.position))
        if found.heard and not self._sunk:
            last = self._gentle(self._last, found)
            torque = np.zeros_like(last.position) if last.torque is None else last.torque
            for share in 1 - smooth_step(self._periods(FADE)):
                fading = replace(last, velocity=None, torque=share * torque)
                self._send(softened(fading, self._own_gains, share), found, longest)
                if self._failing() > FADE:  # each takes long to fail
                    break
        zeros = np.zeros_like(self._last.position)
        limp = JointCommand(self._last.position, kp=zeros, kd=self._own_gains[1])
        was = self._here
        for count in range(1, self._periods(longest) + 1):
            self._send(limp, found, longest)
            if count % self._periods(_STILL_TIME) == 0:
                felt = found.believed and found.heard and not self._failures
                if felt and np.abs(self._here - was).max() < _STILL:
                    return
                was = self._here

    def _has_sunk(self) -> bool:
        """Whether the robot is no longer where it was sent, with nearly all its legs: somebody else has let it down meanwhile.

        Whatever pulls joints on their way then would lift the robot, from where people may be.
        """
        away = np.abs(self._last.position - self._here)[self._robot.leg_joints].max(axis=1)
        return int((away > _FAR).sum()) >= len(away) - 1

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

    def _gentle(self, command: JointCommand, found: Known) -> JointCommand:
        """A command that pulls no joint far from where it is, if that is known: it may have gone limp meanwhile."""
        if not found.believed:
            return command
        return replace(command, position=self._here + np.clip(command.position - self._here, -_PULL, _PULL))

    def _send(self, command: JointCommand, found: Known, patience: float | None = None) -> None:
        """Unwatched. One command that fails is no reason not to send the next.

        Args:
            patience: time for which all may fail [s]: a robot that says nothing may still hear. None: a stage that is not the
                last one gives way to the next when nothing gets through.
        """
        try:
            position = self._note(command, self._held.push).joint_position
        except Exception:
            self._failures, self._failing_since = self._failures + 1, self._failing_since or time.monotonic()
            if self._failing() > (patience or _FAILING_TIME) or (patience is None and self._failures > _FAILURES):
                raise
            time.sleep(self._period)
            return
        self._failures, self._failing_since, self._last = 0, 0.0, command
        if found.believed and np.isfinite(position).all():
            self._here = position

    def _failing(self) -> float:
        """For how long everything has failed [s]."""
        return time.monotonic() - self._failing_since if self._failures else 0.0

    def _note(self, command: JointCommand, act: Callable[[JointCommand], RobotState]) -> RobotState:
        return act(command) if self._steps is None else self._steps.add(command.position, lambda: act(command))
