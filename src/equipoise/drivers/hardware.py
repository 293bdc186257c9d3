"""Platform of a real robot: a deadline loop over the connection of its samples and commands."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Protocol

from equipoise.drivers.checkup import CheckupFinding, takeover_findings
from equipoise.drivers.plugin_errors import translated
from equipoise.errors import CommunicationError, MotionError, StoppedError
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.stepped import SteppedPlatform

_LEAD, _LEAD_SHARES = 0.8e-3, (0.1, 0.4)  # [s] before a deadline at which samples are taken; least and most of a period
_SPIN = 0.15e-3  # [s] of busy waiting
_ON_TIME = 1e-3  # [s] of lateness at which a command still counts as on time
_LOST = 5  # control periods of delay after which the deadlines restart
_ASLEEP = 0.25  # [s] of lateness at which a command is no longer sent: the robot may have sunk


class RobotConnection(Protocol):
    """Driver: samples in, commands out, all joint vectors in the order of `joint_names`. One thread uses it.

    Attributes:
        name: name in messages, as in "unitree-go2 on eth0".
        joint_names: names of the robot model's leg joints, in its order; the driver maps them to motors.
        accepts: kinds of feed-forward and gains that it sends, as a platform's.
        control_period: time between commands [s].
        rejected: number of rejected samples: wrong checksum, length or sender.
    """

    @property
    def name(self) -> str: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...

    @property
    def accepts(self) -> frozenset[str]: ...

    @property
    def control_period(self) -> float: ...

    @property
    def rejected(self) -> int: ...

    def receive(self) -> list[RobotState]:
        """Return the samples that arrived since the last call, in order of arrival, each with `received`; never wait.

        Damaged samples (wrong checksum, truncated packet) are rejected and counted. Repeated and late ones are returned:
        the guard checks for those.

        Raises:
            CommunicationError: the robot is not reachable.
            MotionError: another program commands the robot.
        """
        ...

    def send(self, command: JointCommand) -> None:
        """Send the values of a command that the robot accepts. Gains that are None are the robot's own.

        The first command may take seconds: an on-board controller must release the motors first.
        """

    def release(self) -> None:
        """Leave the motors without torque, or to the robot's own controller. May be called twice."""

    def close(self) -> None:
        """Close the connection. May be called twice."""


class HardwarePlatform(SteppedPlatform):
    """Platform of a robot behind a connection. The guard makes it safe to move.

    Commands are sent at absolute deadlines, one control period apart, that start at the first command.

    Args:
        connection: connection to the robot.
        patience: longest time to wait for the first sample [s].

    Attributes:
        lateness: lateness of every command after its deadline [s].
        work: processor time of every control period, without waiting [s].
        overruns: number of commands more than a millisecond late.
        stalls: number of deadlines without a command; they are skipped.
        commanded: whether a command was sent.
        arrived: samples that arrived since the previous state, oldest first.
        sent_at: time at which the last command was sent, on the monotonic clock [s].
    """

    def __init__(self, connection: RobotConnection, patience: float = 5.0) -> None:
        self._connection, self._patience = connection, patience
        self.name, self.joint_names, self.accepts = connection.name, connection.joint_names, connection.accepts
        self.control_period = connection.control_period
        self._newest: RobotState | None = None
        self.arrived: list[RobotState] = []
        self.commanded = False
        self._deadline = self.sent_at = time.monotonic()
        self._worked = 0.0
        least, most = (share * connection.control_period for share in _LEAD_SHARES)
        self._lead = min(max(_LEAD, least), most)
        self._closed = False
        self.lateness: list[float] = []
        self.work: list[float] = []
        self.overruns = self.stalls = 0

    @property
    def rejected(self) -> int:
        return self._connection.rejected

    @property
    def unchecked(self) -> bool:
        """Return whether samples with wrong checksums are accepted."""
        return getattr(self._connection, "unchecked", False)

    def read(self) -> RobotState:
        return self._sense(self._patience if self._newest is None else 2 * self.control_period)

    def learn(self) -> Mapping[str, Any]:
        """Return the detected settings, for the second connection; wait for the robot's answer if necessary."""
        learn = getattr(self._connection, "learn", None)
        return {} if learn is None else translated(self.name, "learn", learn)

    def check_takeover(self) -> list[CheckupFinding]:
        """Return the connection's findings about its first command; send no command."""
        return takeover_findings(self._connection)

    def step(self, command: JointCommand) -> RobotState:
        """Send a command at its deadline, wait for the next one, and return the state shortly before it.

        Raises:
            CommunicationError: the robot is not reachable, or no sample has arrived.
            StoppedError: this program was stopped before the command was sent.
            MotionError: the platform is closed.
        """
        work = time.thread_time() - self._worked if self.commanded else 0.0
        now, lost = time.monotonic(), 0
        if now - self._deadline > _LOST * self.control_period:
            lost += self._deadline > self.sent_at
            self._deadline = now
        _wait_until(self._deadline)
        if (late := time.monotonic() - self._deadline) > _ASLEEP:
            raise StoppedError(f"no command was sent for {late * 1000:.0f} ms: this program was stopped")
        first = not self.commanded
        began = time.thread_time()
        self._send(command)
        self.sent_at = time.monotonic()
        work += time.thread_time() - began
        if first:
            self._deadline = self.sent_at
        late = self.sent_at - self._deadline
        missed = int(late / self.control_period)  # skipped deadlines: a burst of commands would jerk the robot
        self.lateness.append(late)
        self.work.append(work)
        self.overruns += late > _ON_TIME
        self.stalls += lost + (missed > 0)
        self._deadline += (1 + missed) * self.control_period
        time.sleep(max(0.0, self._deadline - self._lead - time.monotonic()))  # busy waiting would gain nothing here
        self._worked = time.thread_time()
        return self._sense(0.0)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        try:
            if self.commanded:  # a robot that was only observed has nothing to release
                translated(self.name, "release", self._connection.release)
        finally:
            translated(self.name, "close", self._connection.close)

    def _send(self, command: JointCommand) -> None:
        if self._closed:
            raise MotionError(f"{self.name} is closed; open it again to move it")
        translated(self.name, "send", lambda: self._connection.send(command))
        self.commanded = True

    def _sense(self, patience: float) -> RobotState:
        """Return the sample that was measured last, whatever the order of arrival; wait for the first one."""
        arrived = translated(self.name, "receive", self._connection.receive)
        until = time.monotonic() + patience
        while not arrived and time.monotonic() < until:
            time.sleep(0.5e-3)
            arrived = translated(self.name, "receive", self._connection.receive)
        self.arrived = arrived
        if arrived:
            newest = max(reversed(arrived), key=lambda sample: sample.time)
            self._newest = newest if self._newest is None or newest.time >= self._newest.time else self._newest
        if self._newest is None:
            raise CommunicationError(
                f"{self.name} sent nothing for {self._patience:g} s: is the robot on, is the cable plugged in, and is this "
                "the right network interface?"
            )
        return self._newest


def _wait_until(moment: float) -> None:
    """Wait until a time on the monotonic clock: sleep first, then busy waiting."""
    left = moment - time.monotonic()
    if left > _SPIN:
        time.sleep(left - _SPIN)
    while time.monotonic() < moment:
        pass
