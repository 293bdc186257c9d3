"""One control period of a guarded robot: what is checked before a command is sent, and when a sample has arrived."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace

import numpy as np

from equipoise.drivers.hardware import LoopTiming
from equipoise.errors import (
    CommunicationError,
    FallError,
    HungError,
    LimitError,
    MotionError,
    SensorError,
    TrackingError,
)
from equipoise.guard.command_check import CommandCheck
from equipoise.guard.footing import Footing
from equipoise.guard.joint_watch import JointWatch
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport, Vitals
from equipoise.guard.safe_ending import Situation
from equipoise.guard.sample_watch import SampleWatch
from equipoise.guard.tilt_watch import TiltWatch
from equipoise.platform.platform import JointCommand, Platform, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_FIRST_JUMP = 0.1  # [rad] between where a joint is and where it is first sent
_COMING_DOWN = 1.0  # [s] after feet were up in which the base may still lean as in a lift


class WatchedRobot:
    """A platform that is stepped, and everything that is known of it from that.

    Attributes:
        footing: where its feet are.
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] that commands mean which say none; None: gains cannot be sent.
        sent: the last command, or None.
    """

    def __init__(self, platform: Platform, robot: RobotModel, stance: Stance, limits: Limits) -> None:
        self._platform, self._robot, self._limits = platform, robot, limits
        period, joints = platform.control_period, len(robot.joint_names)
        kp, kd = robot.gains(stance.hip_height)
        self.own_gains = (np.full(joints, kp), np.full(joints, kd)) if "gains" in platform.accepts else None
        self.footing = Footing(robot, stance)
        self._commands = CommandCheck(limits, robot, (kp, kd), period)
        self._samples = SampleWatch(robot, period, limits.silence)
        self._joints = JointWatch(limits, robot, stance.hip_height, period, self.own_gains is not None)
        self._tilt = TiltWatch(np.array(robot.imu_in_base.rotation))
        self._vitals = Vitals()
        self.sent: JointCommand | None = None
        self._planted: JointCommand | None = None
        self._state: RobotState | None = None
        self._lifted = -np.inf  # when feet were up last [s]
        self._well = True

    def take_over(self, state: RobotState, first: JointCommand) -> None:
        """Before the first command.

        Args:
            state: what `read` said.
            first: what will be sent when the robot has been taken over.

        Raises:
            LimitError, SensorError, FallError: it must not be sent.
        """
        here = state.joint_position
        self._commands.check(first, first.position, here)
        jump = np.abs(first.position - here)
        if jump.max() > _FIRST_JUMP:
            joint = int(np.argmax(jump))
            raise LimitError(
                f"the first command would move joint {self._robot.joint_names[joint]!r} at once from {here[joint]:.3f} to "
                f"{first.position[joint]:.3f} rad; motions start where the robot is"
            )
        self._joints.check_at_rest(state)
        if self._tilt.tilt > self._limits.lean:
            raise FallError(
                f"the base leans by {np.degrees(self._tilt.tilt):.0f} deg before anything has moved: the robot has fallen, or "
                "the IMU is mounted turned (give its pose under imu_rpy in a robot description)"
            )
        self.sent = self._planted = JointCommand(here)

    def read(self) -> RobotState:
        """Sense without commanding, perhaps after a while in which nobody looked.

        Raises:
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
            TrackingError: the robot is not where it was sent to hold.
        """
        self._samples.forgive()
        state = self._platform.read()
        silent = 0.0 if state.received is None else time.monotonic() - state.received
        if silent > self._limits.silence:
            raise CommunicationError(
                f"no sample has arrived for {silent:.1f} s: is the robot still on, is the cable in?"
            )
        self._state = state = self._samples.check(state, None)
        self._tilt.feel(state)
        if self.sent is not None:
            self._joints.check_held(state.joint_position, self.sent)
        return state

    def step(self, command: JointCommand) -> RobotState:
        """One control period, with everything that is checked in it; `take_over` comes first.

        Raises:
            LimitError: a joint, a motor or the command is beyond its limits; such a command is not sent.
            TrackingError: a joint does not follow.
            FallError: the base tilts.
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
        """
        before, state = self.sent, self._state
        assert before is not None
        assert state is not None
        self._commands.check(command, before.position, state.joint_position)
        self.sent = command
        try:
            state = self._state = self._samples.check(self._platform.step(command), command.position)
            self._vitals.note(state)
            self._joints.check(state, command)
            self._check_lean(state, command)
        except MotionError:
            self._well = False
            raise
        return state

    def hold(self) -> RobotState:
        """`step` with the last command again, but nothing pushes on, and how late it is does not count."""
        assert self.sent is not None
        self._pause_timing(True)
        try:
            return self.step(replace(self.sent, velocity=None))
        finally:
            self._pause_timing(False)

    def _pause_timing(self, paused: bool) -> None:
        timing = getattr(self._platform, "timing", None)
        if isinstance(timing, LoopTiming):
            timing.paused = paused

    def push(self, command: JointCommand) -> RobotState:
        """One control period of the ending, in which nothing is checked."""
        state = self._platform.step(command)
        self.sent = command
        if np.isfinite(state.acceleration).all() and np.isfinite(state.angular_velocity).all():
            self._tilt.feel(state)
        return state

    def situation(self, error: BaseException | None) -> Situation | None:
        """What is known when a run ends, by an error or without; None if nothing was ever sent: a link may have refused to."""
        if self.sent is None or self._planted is None or self._state is None:
            return None
        if not getattr(self._platform, "commanded", True):
            return None
        heard = not isinstance(error, CommunicationError)
        believed = heard and not isinstance(error, SensorError)
        well = self._well and believed and not isinstance(error, (FallError, TrackingError, HungError))
        here = self._state.joint_position
        if believed:
            with contextlib.suppress(Exception):
                now = self._platform.read().joint_position
                here = now if np.isfinite(now).all() else here
        return Situation(self.sent, self._planted, here, self._tilt.tilt, well, heard, believed)

    def report(self, ending: list[str]) -> GuardReport:
        """What the run was like so far."""
        return self._vitals.report(self._platform, self._samples.counts, self._tilt.largest, tuple(ending))

    def _check_lean(self, state: RobotState, command: JointCommand) -> None:
        for sample in state.earlier:
            self._tilt.feel(sample)
        self._tilt.feel(state)
        lifted, floor = self.footing.look(command.position)
        if lifted:
            self._lifted = state.time
        else:
            self._planted = command
        coming_down = state.time - self._lifted < _COMING_DOWN
        lean = self._tilt.lean(floor)
        if lean > (self._limits.lean_in_lift if coming_down else self._limits.lean):
            raise FallError(
                f"the base leans by {np.degrees(lean):.0f} deg from the posture that it was sent to take: the robot is falling"
            )
