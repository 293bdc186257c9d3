"""Second connection to a robot: the calibration process damps the robot over it when the robot process cannot."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from equipoise.drivers.hardware import RobotConnection
from equipoise.guard.endings import DAMPED_TIME, NOT_CONFIRMED, STILL, STILL_TIME
from equipoise.guard.footing import damping_time
from equipoise.platform.platform import JointCommand
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_REACHED = 15.0  # [s] in which a command must be sent
_AGAIN = 1.0  # [s] after which a connection that sends nothing is reopened


class SecondConnection:
    """Second connection to the robot of the robot process.

    Args:
        robot: model of the robot.
        connect: function that opens it; it returns None if the platform has none.

    Attributes:
        ready: whether it is open and accepts damping commands.
    """

    def __init__(self, robot: RobotModel, connect: Callable[[], RobotConnection | None]) -> None:
        self._robot, self._connect = robot, connect
        self._connection: RobotConnection | None = None
        self._stance = nominal_stance(robot)  # computed before it is needed
        kd = robot.gains(self._stance.hip_height)[1]
        self._limp = JointCommand.damping(np.zeros(len(robot.joint_names)), kd)
        self.ready = False

    def open(self) -> None:
        """Open it; raise the errors of the driver."""
        self._connection = self._connect()
        self.ready = self._connection is not None and "gains" in self._connection.accepts

    def damp(self) -> str:
        """Damp the joints until the robot is at rest; return the result in words.

        Without samples, damp for as long as raised legs take to come down.
        """
        if not self.ready:
            return f"no second connection accepts damping commands: {NOT_CONFIRMED}"
        sent, failure, began = 0, "no command was sent", time.monotonic()
        tried, until = began, began + _REACHED
        recent: deque[tuple[float, np.ndarray]] = deque()
        while (now := time.monotonic()) < until and not self._at_rest(recent, now - began):
            try:
                if self._connection is None:
                    self._connection = self._connect()
                assert self._connection is not None
                self._connection.send(self._limp)
                recent += [(now, state.joint_position) for state in self._connection.receive()]
                while recent and recent[0][0] < now - STILL_TIME:
                    recent.popleft()
                if not sent:
                    began, until = now, now + damping_time(self._stance, legs_up=True)
                sent, tried = sent + 1, now
                time.sleep(self._connection.control_period)
            except Exception as error:
                failure = str(error)
                if now - tried > _AGAIN:
                    self.close()
                    tried = now
                time.sleep(2e-3)
        with contextlib.suppress(Exception):
            if self._connection is not None:
                self._connection.release()
        if not sent:
            return f"the robot was not damped: {failure}. {NOT_CONFIRMED}"
        confirmed = self._at_rest(recent, time.monotonic() - began)
        return f"damped ({sent} commands)" if confirmed else f"{sent} damping commands were sent; {NOT_CONFIRMED}"

    @staticmethod
    def _at_rest(recent: deque[tuple[float, np.ndarray]], damped: float) -> bool:
        """Return whether samples show that a robot is at rest after a time of damping [s]."""
        if damped < DAMPED_TIME or len(recent) < 2 or recent[-1][0] - recent[0][0] < 0.8 * STILL_TIME:
            return False
        return bool(np.ptp([position for _, position in recent], axis=0).max() < STILL)

    def close(self) -> None:
        """Close the connection. May be called twice."""
        if self._connection is not None:
            with contextlib.suppress(Exception):
                self._connection.close()
        self._connection = None
