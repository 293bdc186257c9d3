"""The deadline loop over a link, and the guard over that: in real time, with a simulated robot on the other side."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest, hold, is_damped

from equipoise import nominal_stance, simulate
from equipoise.errors import CommunicationError, MotionError, OverrunError
from equipoise.platforms import hardware
from equipoise.platforms.guard import Guard
from equipoise.platforms.hardware import HardwarePlatform
from equipoise.platforms.platform import ACCEPTS_EVERYTHING, JointCommand


class MemoryLink:
    """A link to a robot that moves on by a control period with every command; without a robot, to one at rest.

    `act(count)` is called before the command of that number is sent.
    """

    name, accepts, control_period = "a robot in memory", ACCEPTS_EVERYTHING, PERIOD

    def __init__(self, robot, platform=None, act=lambda count: None):
        self._robot, self._platform, self.act = robot, platform, act
        self.joint_names = robot.joint_names
        self.sent, self.released, self.closed = [], 0, 0
        self._arrived: list = []

    @property
    def commands(self):
        return self.sent

    def receive(self):
        """What commands brought about; a robot that nobody commands says again and again that it is there."""
        arrived, self._arrived = self._arrived or [self._sample()], []
        return arrived

    def send(self, command):
        self.act(len(self.sent))
        self.sent.append(command)
        if self._platform is not None:
            self._platform.step(command)
        self._arrived.append(self._sample())

    def release(self):
        self.released += 1

    def close(self):
        self.closed += 1

    def _sample(self):
        state = at_rest(self._robot, len(self.sent)) if self._platform is None else self._platform.read()
        return replace(state, received=time.monotonic())


class Dog:
    """A watchdog that only counts."""

    def __init__(self):
        self.dismissed = 0

    def moves(self): ...

    def beat(self): ...

    def dismiss(self):
        self.dismissed += 1


@pytest.fixture
def link(a1):
    return MemoryLink(a1)


@pytest.fixture
def dog():
    return Dog()


@pytest.fixture
def platform(link, dog):
    with HardwarePlatform(link, watchdog=lambda: dog) as platform:
        yield platform


@pytest.fixture(scope="module")
def stand(a1):
    position = nominal_stance(a1).joint_position
    return JointCommand(position, velocity=np.full(12, 0.5), torque=np.ones(12))


def wait_until(condition):
    until = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(2e-3)


def test_while_nobody_steps_the_last_command_is_repeated_but_nothing_is_pushed_on(platform, link, stand):
    platform.step(stand)
    wait_until(lambda: len(link.sent) > 20)
    again = link.sent[-1]
    assert again.position is stand.position
    assert again.torque is stand.torque
    assert again.velocity is None


def test_the_repeating_outlives_whatever_a_link_raises(platform, link, stand):
    platform.step(stand)
    failures = []

    def fail(count):
        if len(failures) < 5:
            failures.append(count)
            raise ValueError("of a driver")

    link.act = fail
    wait_until(lambda: len(failures) == 5)
    sent = len(link.sent)
    wait_until(lambda: len(link.sent) > sent + 5)


def test_a_program_that_slept_repeats_nothing_until_somebody_steps(platform, link, stand):
    """The robot may lie by then."""
    platform.step(stand)
    wait_until(lambda: len(link.sent) > 5)
    with platform._sending:
        platform._sent -= 1.0
    sent = len(link.sent)
    time.sleep(0.1)
    assert len(link.sent) == sent
    platform.step(stand)
    wait_until(lambda: len(link.sent) > sent + 5)


def test_a_command_that_slept_on_its_way_is_not_sent(platform, link, stand, monkeypatch):
    platform.step(stand)
    sent = link.sent[-1]
    monkeypatch.setattr(hardware, "_wait_until", lambda moment: time.sleep(0.3))
    with pytest.raises(OverrunError, match=r"^this program stood still for \d{3} ms while the robot moved$"):
        platform.step(replace(stand, kp=np.ones(12)))
    assert link.sent[-1].kp is sent.kp is None


def test_closing_releases_once_and_sends_no_more(platform, link, dog, stand):
    platform.step(stand)
    platform.close()
    platform.close()
    sent = len(link.sent)
    time.sleep(0.05)
    assert (link.released, link.closed, dog.dismissed, len(link.sent)) == (1, 1, 1, sent)
    with pytest.raises(MotionError, match="a robot in memory is closed; open it again to move it"):
        platform.step(stand)


def test_who_only_looked_has_nothing_to_release(platform, link):
    platform.read()
    platform.close()
    assert (link.released, link.closed) == (0, 1)


def test_a_sender_that_hangs_does_not_keep_the_motors_from_being_released(platform, link, stand):
    platform.step(stand)
    gate = threading.Event()
    link.act = lambda count: gate.wait(30.0)
    time.sleep(0.05)  # the repeating hangs in the link now
    platform.close()
    assert (link.released, link.closed) == (1, 1)
    gate.set()


def test_the_watchdog_goes_on_watching_a_robot_that_could_not_be_released(platform, link, dog, stand):
    platform.step(stand)

    def fail():
        raise CommunicationError("no route")

    link.release = fail
    with pytest.raises(CommunicationError, match="no route"):
        platform.close()
    assert (link.closed, dog.dismissed) == (1, 0)


def test_a_computer_that_stalls_ends_the_run_and_the_robot_lies_down(a1):
    """What the link sees: the motion, nothing for a while, nothing that continues the motion, and the ending."""
    link = MemoryLink(a1, simulate(a1, "realistic", seed=3).platform)
    guard = Guard(HardwarePlatform(link), a1)
    hold(guard, link, 0.1)
    stall = len(link.sent) + 20
    link.act = lambda count: time.sleep(0.4) if count == stall else None
    with pytest.raises(OverrunError) as caught:
        hold(guard, link, 0.5)
    assert str(caught.value).startswith("this computer sent nothing for ")
    assert str(caught.value).endswith(
        " ms while the robot moved: end other programs, or give this one a core of its own"
    )
    report = guard.report()
    assert report.ending == ("lying down", "damped", "released")
    assert is_damped(link.sent[-1])
    assert (link.released, link.closed) == (1, 1)
    assert report.overruns >= 1
    assert report.late_999 > 0
    assert len(caught.value.recordings[0].commands.time) >= 20
