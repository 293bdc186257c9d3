"""Guarded platform in this process: the robot loop in lockstep with a simulated robot, or with a stepped platform.

The robot process runs the same loop for a real robot: see `remote_robot`.
"""

from __future__ import annotations

from equipoise.errors import MotionError
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.robot_loop import MotionOrder, RobotLoop
from equipoise.platform.platform import TURNS, JointCommand, MotionInterrupted, Platform, RobotState, Trajectory
from equipoise.platform.stepping import Recorder
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel

PUT_DOWN = "the robot was put down and released; start again to move it"


class Guard:
    """A guarded platform. Use it as a context manager; leaving it is the safe ending.

    Args:
        platform: platform to be guarded; the guard closes it.
        robot: model of the robot.
        limits: limits of motions.
    """

    def __init__(self, platform: Platform, robot: RobotModel, limits: Limits | None = None) -> None:
        self.control_period, self.joint_names = platform.control_period, platform.joint_names
        self.accepts = platform.accepts - {TURNS}
        self._loop = RobotLoop(platform, robot, limits)
        self._recorder = Recorder(platform.joint_names, platform.control_period)
        self._number = 0

    @property
    def phase(self) -> str:
        """Name of the phase of the current motion."""
        return self._loop.phase

    def read(self) -> RobotState:
        """Return the state without commanding; raise the errors of `step`."""
        self._require_going()
        if self._loop.context is None:
            self._tick()
            self._raise_trouble()
        assert self._loop.state is not None
        return self._loop.state

    def step(self, command: JointCommand) -> RobotState:
        """Run one control period.

        Raises:
            MotionError: a joint, a motor or a command exceeds its limits, or a joint does not follow its target.
            FallError: the base tilts.
            CommunicationError: no samples arrive.
            StoppedError: a motor is hot or the battery empty; the operator stopped the robot.
        """
        self._move(Trajectory.of(command))
        self._recorder.restart()
        assert self._loop.state is not None
        return self._loop.state

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play a motion; raise the errors of `step`, with the recording so far."""
        try:
            self._move(trajectory, stop)
        except KeyboardInterrupt as interrupt:
            raise MotionInterrupted(self._recorder.recorded(trajectory.events)) from interrupt
        except MotionError as error:
            if (recorded := self._recorder.recorded(trajectory.events)) is not None and not error.recordings:
                error.recordings = (recorded,)
            raise
        return self._recorder.recording(trajectory.events)

    def close(self) -> None:
        """Put the robot down and release it; raise the error if that fails. May be called twice."""
        self._end(None)

    def report(self) -> GuardReport:
        """Return the report of the run so far."""
        return self._loop.report()

    def __enter__(self) -> Guard:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._end(error)

    def _move(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> None:
        self._require_going()
        try:
            self._loop.look_ahead(trajectory)
            self._recorder.begin()
            self._number += 1
            self._loop.move(MotionOrder(self._number, trajectory, stop))
            while self._loop.motion is not None:
                if stop is not None and stop.stop_requested is not None and stop.stop_requested():
                    self._loop.stop_motion()
                else:
                    self._tick()
        except BaseException as error:
            self._end(error)
            raise
        self._raise_trouble()

    def _tick(self) -> None:
        tick = self._loop.tick()
        self._recorder.take(tick.target if tick.motion else None, tick.sent, tick.samples)

    def _require_going(self) -> None:
        if self._loop.ending is not None:
            raise MotionError(PUT_DOWN) from self._loop.trouble

    def _raise_trouble(self) -> None:
        if self._loop.ending is not None:
            self._end(None)
            raise self._loop.trouble or MotionError(PUT_DOWN)

    def _end(self, error: BaseException | None) -> None:
        """Put the robot down; a second Ctrl-C skips lowering it."""
        if self._loop.over:
            return
        while not self._loop.over:
            try:
                if self._loop.ending is None:
                    self._loop.end(error)
                else:
                    self._loop.tick()
            except KeyboardInterrupt:
                self._loop.end(error, urgent=True)
        if error is None and self._loop.trouble is not None:
            raise self._loop.trouble
