"""A real robot as a platform: one deadline loop over whatever link carries its samples and commands."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.checkup import CheckupFinding, foretold
from equipoise.drivers.foreign import translated
from equipoise.errors import CommunicationError, MotionError, OverrunError
from equipoise.platform.platform import JointCommand, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import Recording

# [s], and least and most of a control period, before a deadline: there `step` hands the state over, so that its caller can
# think, and a thread that holds the robot gets Python's lock in time, several times, from one that computes.
_LEAD, _LEAD_SHARES = 1.2e-3, (0.1, 0.6)
_SPIN = 0.15e-3  # [s] of waiting that is not left to the scheduler
_ON_TIME = 1e-3  # [s] after its deadline at which a command still counts as on time
_LOST = 5  # control periods behind after which the deadlines begin anew
_KEPT_TIME = 0.25  # [s] of samples kept while nobody reads
_TURN = 0.05e-3  # [s] that another thread may compute before it must let the loop go on
_ASLEEP = 0.25  # [s] without a command after which the robot may have sunk: nothing is sent as if it had not


class Link(Protocol):
    """What a driver is: samples in, commands out, all joint vectors in the order of `joint_names`.

    One thread at a time calls it, not always the same one.

    Attributes:
        name: name in messages, as in "unitree-go2 on eth0".
        joint_names: names of the robot model's leg joints, in its order; the driver knows which motor each is.
        accepts: kinds of feed-forward and gains that it heeds, as a platform's.
        control_period: time between commands [s].
    """

    @property
    def name(self) -> str: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...

    @property
    def accepts(self) -> frozenset[str]: ...

    @property
    def control_period(self) -> float: ...

    def receive(self) -> list[RobotState]:
        """Samples that arrived since the last call, in order of arrival, each with `received`; never waits.

        What arrived damaged (a wrong checksum, a cut packet) is left out. What arrived twice or late is not: the guard looks.

        Raises:
            CommunicationError: the link is gone.
        """
        ...

    def send(self, command: JointCommand) -> None:
        """Send a command; what the robot does not accept is left aside. Gains that are None are the robot's own.

        The first may take seconds: a controller on board has to let go of the motors before.
        """
        ...

    def release(self) -> None:
        """Leave the motors without torque, or as the robot's own controller wants them. May be called twice."""
        ...

    def close(self) -> None:
        """Give the connection back. May be called twice."""
        ...


class LoopTiming:
    """How late commands were sent, after the deadlines that a control loop sets itself.

    Attributes:
        lateness: (n,) lateness of every command so far [s].
        overruns: number of commands more than a millisecond late.
        lost: number of deadlines that passed without a command; they are skipped, not caught up with.
        paused: whether the robot is only held, while this computer has other things to do: such commands are counted apart.
        held, held_late: numbers of commands that held the robot, and of those more than a millisecond late.
    """

    def __init__(self) -> None:
        self._lateness = np.zeros(4096)
        self._count = 0
        self.overruns = 0
        self.lost = 0
        self.held = self.held_late = 0
        self.paused = False

    @property
    def lateness(self) -> FloatArray:
        return self._lateness[: self._count]

    def add(self, late: float, lost: int) -> None:
        """Note one command, and how often deadlines passed without one before."""
        if self.paused:
            self.held += 1
            self.held_late += late > _ON_TIME
            return
        self.lost += lost
        if self._count == len(self._lateness):
            self._lateness = np.concatenate([self._lateness, np.zeros(len(self._lateness))])
        self._lateness[self._count] = late
        self._count += 1
        self.overruns += late > _ON_TIME


class HardwarePlatform:
    """A robot behind a link. Never use it bare: the guard is what makes it safe, and holds the robot while nobody steps.

    Commands leave at absolute deadlines, a control period apart from when the first one left. As long as the platform is open,
    Python's threads take turns more often.

    Args:
        link: link to the robot.
        patience: longest time to wait for the first sample [s].

    Attributes:
        timing: timing of the control loop.
        commanded: whether a command was sent.
    """

    def __init__(self, link: Link, patience: float = 5.0) -> None:
        self._link = link
        self._patience = patience
        self._newest: RobotState | None = None
        self.commanded = False
        self._deadline = 0.0
        least, most = (share * link.control_period for share in _LEAD_SHARES)
        self._lead = min(max(_LEAD, least), most)
        self._stepped = time.monotonic()
        self._closed = False
        self._turn = sys.getswitchinterval()
        sys.setswitchinterval(_TURN)
        self.timing = LoopTiming()

    @property
    def name(self) -> str:
        return self._link.name

    @property
    def control_period(self) -> float:
        return self._link.control_period

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._link.joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return self._link.accepts

    def read(self) -> RobotState:
        return self._sense(self._patience if self._newest is None else 2 * self.control_period)

    def foretell(self) -> list[CheckupFinding]:
        """What the link knows of what its first command will meet; commands nothing."""
        return foretold(self._link)

    def step(self, command: JointCommand) -> RobotState:
        """Send a command at its deadline, wait for the next one, and sense shortly before.

        Raises:
            CommunicationError: the link is gone, or not a single sample has arrived.
            OverrunError: this program was stopped before the command could leave.
            MotionError: the platform is closed.
        """
        now, lost = time.monotonic(), 0
        if now - self._deadline > _LOST * self.control_period:
            lost += self._deadline > self._stepped
            self._deadline = now
        _wait_until(self._deadline)
        if (late := time.monotonic() - self._deadline) > _ASLEEP:
            raise OverrunError(f"this program stood still for {late * 1000:.0f} ms while the robot moved")
        first = not self.commanded
        self._send(command)
        self._stepped = time.monotonic()
        if first:
            self._deadline = self._stepped
        late = self._stepped - self._deadline
        missed = int(late / self.control_period)  # deadlines that are skipped: commands in a burst would be a jerk
        self.timing.add(late, lost + (missed > 0))
        self._deadline += (1 + missed) * self.control_period
        _wait_until(self._deadline - self._lead)
        return replace(self._sense(0.0), commanded=self._stepped)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        return play_by_stepping(self, trajectory, stop)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        try:
            if self.commanded:  # who only looked has nothing to give back
                translated(self.name, "release", self._link.release)
        finally:
            sys.setswitchinterval(self._turn)
            translated(self.name, "close", self._link.close)

    def __enter__(self) -> HardwarePlatform:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _send(self, command: JointCommand) -> None:
        if self._closed:
            raise MotionError(f"{self.name} is closed; open it again to move it")
        translated(self.name, "send", lambda: self._link.send(command))
        self.commanded = True

    def _receive(self) -> list[RobotState]:
        return translated(self.name, "receive", self._link.receive)

    def _sense(self, patience: float) -> RobotState:
        """The newest sample, the others that arrived in `earlier`; waits for one if none has arrived.

        The newest is the one that was taken last: a sample that others overtook on the way is no news.
        """
        arrived = self._receive()
        until = time.monotonic() + patience
        while not arrived and time.monotonic() < until:
            time.sleep(0.5e-3)
            arrived = self._receive()
        if arrived:
            known = () if self._newest is None else (self._newest,)
            newest = max((*reversed(arrived), *known), key=lambda sample: sample.time)
            since = (arrived[-1].received or 0.0) - _KEPT_TIME
            kept = tuple(sample for sample in arrived if sample is not newest and (sample.received or 0.0) >= since)
            self._newest = replace(newest, earlier=kept) if kept or newest.earlier else newest
        elif self._newest is not None and self._newest.earlier:
            self._newest = replace(self._newest, earlier=())
        if self._newest is None:
            raise CommunicationError(
                f"{self.name} sent nothing for {self._patience:g} s: is the robot on, is the cable in, is this the right "
                "network interface?"
            )
        return self._newest


def _wait_until(moment: float) -> None:
    """Wait until a moment of the monotonic clock: asleep for most of it, awake at the end."""
    left = moment - time.monotonic()
    if left > _SPIN:
        time.sleep(left - _SPIN)
    while time.monotonic() < moment:
        pass
