"""What a robot felt while it was put down: noted on the way, and logged once it has been let go of."""

from __future__ import annotations

from collections.abc import Callable

from equipoise.guard.safe_ending import WatchedSteps
from equipoise.platform.piece_log import MotionLog
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.stepping import Steps
from equipoise.recording.event import PHASE, Event
from equipoise.recording.phases import Phase


class NotedSteps:
    """A watched robot whose steps are noted from `begin` on.

    Args:
        watched: the robot.
    """

    def __init__(self, watched: WatchedSteps) -> None:
        self._watched = watched
        self.footing, self.own_gains = watched.footing, watched.own_gains
        self._steps: Steps | None = None

    def begin(self, steps: Steps) -> None:
        """What follows are these steps."""
        self._steps = steps

    def step(self, command: JointCommand) -> RobotState:
        """As the watched robot's; raises when a limit is passed."""
        return self._note(command, self._watched.step)

    def push(self, command: JointCommand) -> RobotState:
        """As the watched robot's; raises only if the link does."""
        return self._note(command, self._watched.push)

    def keep(self, log: MotionLog) -> None:
        """Log what was noted, as a motion of one phase, `ending`; raises what the log raises, or RecordingError."""
        if self._steps is not None and self._steps.count:
            log.begin(self._steps.count)
            log.add(self._steps.recording((Event(0.0, PHASE, {"name": Phase.ENDING}),)))

    def _note(self, command: JointCommand, act: Callable[[JointCommand], RobotState]) -> RobotState:
        if self._steps is None:
            return act(command)
        return self._steps.add(command.position, lambda: act(command))
