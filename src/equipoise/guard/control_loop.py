"""The control loop of a guarded robot: check a command, send it, and check what the robot makes of it, in this order."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from equipoise.drivers.hardware import LoopTiming
from equipoise.errors import (
    CommunicationError,
    FallError,
    HungError,
    MotionError,
    OverrunError,
    SensorError,
    TrackingError,
)
from equipoise.guard.base_checks import BaseChecks
from equipoise.guard.clearance_checks import ClearanceChecks
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.joint_checks import JointChecks
from equipoise.guard.known import Check, Known
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.sample_filter import SampleFilter
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand, Platform, RobotState, Trajectory
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


class ControlLoop:
    """A platform that is stepped, with everything that is checked on the way.

    Attributes:
        known: knowledge of the robot; None: nobody has taken it over yet.
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of commands that say none; None: gains cannot be sent.
    """

    def __init__(self, platform: Platform, robot: RobotModel, stance: Stance, limits: Limits) -> None:
        self._platform, self._silence = platform, limits.silence
        gains = robot.gains(stance.hip_height)
        kp, kd = np.full((2, len(robot.joint_names)), np.array(gains)[:, None])
        self.own_gains = (kp, kd) if "gains" in platform.accepts else None
        self._samples = SampleFilter(robot, platform.control_period, limits.silence)
        self._up = TiltFilter(np.array(robot.imu_in_base.rotation))
        self._report = GuardReport(self._samples.counts)
        self.known: Known | None = None

        commands = self._commands = CommandChecks(limits, robot, gains, platform.control_period)
        joints = JointChecks(limits, robot, stance.hip_height, platform.control_period, self.own_gains is not None)
        base = BaseChecks(limits, robot, stance)
        self._clear = ClearanceChecks(robot, stance)
        self._at_rest: tuple[Check, ...] = (*commands.at_rest, *joints.at_rest, *base.at_rest, *self._clear.at_rest)
        self._before: tuple[Check, ...] = (*commands.in_motion, *self._clear.in_motion)
        self._after: tuple[Check, ...] = (*joints.in_motion, *base.in_motion)
        self._held: tuple[Check, ...] = joints.held

    def take_over(self, state: RobotState, first: JointCommand) -> None:
        """Before the first command.

        Args:
            state: state that `read` gave.
            first: command that will be sent when the robot has been taken over.

        Raises:
            LimitError, SensorError, FallError: it must not be sent.
        """
        _check(self._at_rest, first, Known(state, first, first, self._up))
        here = JointCommand(state.joint_position)
        self.known = Known(state, here, here, self._up)

    def look_ahead(self, trajectory: Trajectory) -> None:
        """Before a motion's first command; raises LimitError, or SettingsError, if it must not be made."""
        self._commands.check_shape(trajectory.position[0])
        self._clear.check_ahead(trajectory)

    def read(self) -> RobotState:
        """Sense without commanding; before the robot was taken over, perhaps after a while in which nobody looked.

        Raises:
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
            TrackingError: the robot is not where it was sent to hold.
        """
        if self.known is None:
            self._samples.forgive()
        state = self._platform.read()
        silent = 0.0 if state.received is None else time.monotonic() - state.received
        if silent > self._silence:
            raise CommunicationError(
                f"no sample has arrived for {silent:.1f} s: is the robot still on, is the cable in?"
            )
        state = self._samples.accept(state, None)
        self._up.feel(state)
        if self.known is not None:
            self.known.state = state
            _check(self._held, self.known.sent, self.known)
        return state

    def step(self, command: JointCommand) -> RobotState:
        """One control period, with everything that is checked in it; `take_over` comes first.

        Raises:
            LimitError: a joint, a motor or the command is beyond its limits; such a command is not sent.
            TrackingError: a joint does not follow.
            FallError: the base tilts.
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
        """
        assert self.known is not None
        _check(self._before, command, self.known)
        self.known.sent = command
        try:
            self.known.state = self._samples.accept(self._platform.step(command), command.position)
            self._report.note(self.known.state)
            _check(self._after, command, self.known)
        except MotionError:
            self.known.well = False
            raise
        return self.known.state

    def hold(self) -> RobotState:
        """`step` with the last command again, but nothing pushes on, and how late it is does not count."""
        assert self.known is not None
        timing = self._timing
        if timing is not None:
            timing.paused = True
        try:
            return self.step(replace(self.known.sent, velocity=None))
        finally:
            if timing is not None:
                timing.paused = False

    def push(self, command: JointCommand) -> RobotState:
        """One control period of the ending, in which nothing is checked."""
        assert self.known is not None
        state = self._platform.step(command)
        self.known.sent = command
        if np.isfinite(state.acceleration_in_imu).all() and np.isfinite(state.angular_velocity_in_imu).all():
            self._up.feel(state)
        return state

    def known_after(self, error: BaseException | None) -> Known | None:
        """What is known when a run ends, by an error or without; None if nothing was ever sent: a link may have refused to."""
        if self.known is None or not getattr(self._platform, "commanded", True):
            return None
        heard = not isinstance(error, CommunicationError)
        believed = heard and not isinstance(error, SensorError)
        ill = FallError, TrackingError, HungError, OverrunError
        well = self.known.well and believed and not isinstance(error, ill)
        state = self.known.state
        if believed:
            with contextlib.suppress(Exception):
                now = self._platform.read()
                state = now if np.isfinite(now.joint_position).all() else state
        return replace(self.known, state=state, well=well, heard=heard, believed=believed)

    def report(self, ending: list[str]) -> GuardReport:
        """What the run was like so far."""
        return self._report.with_end(self._timing, self._up.largest, tuple(ending))

    @property
    def _timing(self) -> LoopTiming | None:
        """None in simulation, where nothing is late."""
        timing = getattr(self._platform, "timing", None)
        return timing if isinstance(timing, LoopTiming) else None


def _check(checks: Iterable[Check], command: JointCommand, known: Known) -> None:
    for check in checks:
        check(command, known)
