"""What becomes of a guarded robot while nobody moves it: in real time, with a robot at rest on the other side."""

import ctypes
import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, Dog, MemoryLink, at_rest, hold, is_damped

from equipoise import nominal_stance, simulate
from equipoise.alive import alive
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.errors import (
    CommunicationError,
    FallError,
    HungError,
    LimitError,
    MotionError,
    OverrunError,
    SettingsError,
)
from equipoise.guard import held_robot
from equipoise.guard.guard import Guard
from equipoise.guard.limits import Limits
from equipoise.platform.platform import Health, JointCommand, Trajectory

pytestmark = pytest.mark.realtime
BUSY = Limits(silence=5.0, stall=5.0)  # for a machine that has other things to do, too


@pytest.fixture
def link(a1):
    return MemoryLink(a1)


@pytest.fixture
def dog():
    return Dog()


@pytest.fixture
def guard(link, dog, a1):
    with Guard(HardwarePlatform(link), a1, BUSY, watchdog=lambda: dog) as guard:
        yield guard


def wait_until(condition, thinking=True):
    """Wait, as a program that thinks, or as one that hangs."""
    until = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(2e-3)
        if thinking:
            alive()


def sampled(link, **changes):
    """From now on the robot says something else."""
    link._sample = lambda: replace(at_rest(link._robot, len(link.sent)), received=time.monotonic(), **changes)


def test_the_last_command_is_repeated_but_nothing_is_pushed_on(guard, link):
    hold(guard, link, 0.1)
    here = link.sent[-1]
    guard.step(JointCommand(here.position, velocity=np.full(12, 0.1), torque=np.ones(12)))
    sent = len(link.sent)
    wait_until(lambda: len(link.sent) > sent + 20)
    again = link.sent[-1]
    assert np.array_equal(again.position, here.position)
    assert np.array_equal(again.torque, np.ones(12))
    assert again.velocity is None


def test_a_program_that_thinks_for_long_may_go_on(guard, link, dog):
    hold(guard, link, 0.1)
    beats, until = dog.beats, time.monotonic() + 2.2
    wait_until(lambda: time.monotonic() > until)
    assert dog.beats > beats
    hold(guard, link, 0.1)
    assert guard.report().ending == ()


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"health": Health(motor_temperature=np.full(12, 90.0))}, LimitError),
        ({"health": Health(fault="a motor is off")}, LimitError),
        ({"acceleration_in_imu": np.array([9.81, 0.0, 0.0])}, FallError),
        ({"time": 0.2}, MotionError),  # its clock stands still
    ],
    ids=lambda value: "" if isinstance(value, dict) else value.__name__,
)
def test_what_goes_wrong_meanwhile_ends_the_run_and_is_told_at_the_next_call(link, dog, a1, changes, error):
    with Guard(HardwarePlatform(link), a1, replace(BUSY, silence=0.3), watchdog=lambda: dog) as guard:
        hold(guard, link, 0.1)
        sampled(link, **changes)
        wait_until(lambda: link.closed)
        for call in (guard.read, lambda: hold(guard, link, 0.1)):
            with pytest.raises(error) as caught:
                call()
        assert "start again to move it" not in str(caught.value)
    assert guard.report().ending[-1] == "released"
    assert guard.report().trouble == str(caught.value)
    assert is_damped(link.sent[-1])
    assert dog.dismissed == 1


def test_ctrl_c_while_the_holding_thread_puts_the_robot_down_is_heard_once_it_is_down(guard, link):
    hold(guard, link, 0.1)
    link.act = lambda count: os.kill(os.getpid(), signal.SIGINT) if is_damped(link.sent[-1]) else None
    sampled(link, health=Health(fault="a motor is off"))
    with pytest.raises(KeyboardInterrupt):
        wait_until(lambda: False)
    assert (link.released, link.closed) == (1, 1)


def test_a_motion_that_is_prepared_when_the_run_ends_is_told_why(guard, link, dog, monkeypatch):
    """Not that the link or the watchdog is gone: they are because of that."""
    begin = guard._begin

    def end_meanwhile(first):
        begin(first)
        sampled(link, health=Health(fault="a motor is off"))
        wait_until(lambda: dog.dismissed)
        link.receive = dog.check = fail

    def fail():
        raise CommunicationError("it is closed")

    hold(guard, link, 0.1)
    monkeypatch.setattr(guard, "_begin", end_meanwhile)
    with pytest.raises(LimitError, match="a motor is off"):
        hold(guard, link, 0.1)


def test_a_link_that_fails_meanwhile_ends_the_run(guard, link):
    hold(guard, link, 0.1)
    sent = len(link.sent)

    def fail(count):
        if count > sent + 20:
            raise CommunicationError("no route")

    link.act = fail
    wait_until(lambda: link.closed)
    with pytest.raises(CommunicationError, match="no route"):
        hold(guard, link, 0.1)


def test_a_program_that_hangs_lets_the_robot_down_before_the_watchdog_must(guard, link, dog):
    """Stiff for so long as a program may think, then feet down and damped, and never stiff again."""
    hold(guard, link, 0.1)
    begun, stiff = time.monotonic(), len(link.sent)
    wait_until(lambda: is_damped(link.sent[-1]), thinking=False)
    took = time.monotonic() - begun
    assert len(link.sent) - stiff < 2.5 / link.control_period
    assert took > held_robot._PATIENCE
    wait_until(lambda: link.closed, thinking=False)
    assert dog.dismissed == 1
    with pytest.raises(HungError, match=r"gave no sign of life for 1\.\d s, and the robot was let down: a loop"):
        hold(guard, link, 0.1)


def test_another_threads_signs_of_life_do_not_count(guard, link):
    hold(guard, link, 0.1)
    over = threading.Event()

    def draw():
        while not over.wait(0.05):
            alive()

    thread = threading.Thread(target=draw)
    thread.start()
    try:
        wait_until(lambda: link.closed, thinking=False)
    finally:
        over.set()
        thread.join()
    with pytest.raises(HungError):
        guard.read()


def test_a_hung_program_sends_no_beats(guard, link, dog):
    """The thread that holds has none of its own: if it, too, hung, the watchdog must know."""
    hold(guard, link, 0.1)
    time.sleep(3 * held_robot._BEAT)
    beats = dog.beats
    time.sleep(3 * held_robot._BEAT)
    assert dog.beats == beats


def test_a_program_that_was_stopped_does_not_go_on_holding(link, a1):
    """The robot may lie by then."""
    with Guard(HardwarePlatform(link), a1) as guard:
        hold(guard, link, 0.1)
        stopped = len(link.sent) + 20
        link.act = lambda count: time.sleep(0.4) if count == stopped else None
        wait_until(lambda: link.closed)
        with pytest.raises(OverrunError, match=r"^this computer sent nothing for"):
            guard.read()


def test_a_call_that_keeps_the_interpreter_for_long_ends_the_run(link, a1):
    """Neither thread sends meanwhile; whichever comes next, looks."""
    with Guard(HardwarePlatform(link), a1) as guard:
        hold(guard, link, 0.1)
        ctypes.PyDLL(None).usleep(400_000)
        with pytest.raises(OverrunError, match=r"^this computer sent nothing for 4\d\d ms"):
            guard.step(JointCommand(link.sent[-1].position))
    assert is_damped(link.sent[-1])


def test_a_robot_whose_sender_hangs_is_left_to_the_watchdog_and_not_dropped(link, dog, a1):
    guard = Guard(HardwarePlatform(link), a1, BUSY, watchdog=lambda: dog)
    hold(guard, link, 0.1)
    hanging, gate = threading.Event(), threading.Event()

    def hang(count):
        hanging.set()
        gate.wait(30.0)

    link.act = hang
    wait_until(hanging.is_set)
    with pytest.raises(CommunicationError, match="is left to the watchdog"):
        guard.close()
    assert (link.released, link.closed, dog.dismissed) == (0, 0, 0)
    assert guard.report().ending == ("left to the watchdog",)
    gate.set()


def test_the_watchdog_goes_on_watching_a_robot_that_could_not_be_released(link, dog, a1):
    guard = Guard(HardwarePlatform(link), a1, BUSY, watchdog=lambda: dog)
    hold(guard, link, 0.1)

    def fail():
        raise CommunicationError("no route")

    link.release = fail
    with pytest.raises(CommunicationError, match="no route"):
        guard.close()
    assert (link.closed, dog.dismissed) == (1, 0)


def test_a_robot_whose_link_refuses_the_first_command_is_left_as_it_is(guard, link, dog):
    """It was never told to move: there is nothing to watch, and nothing to damp."""

    def refuse(count):
        raise MotionError("it stands, and another controller holds it")

    link.act = refuse
    with pytest.raises(MotionError, match="another controller holds it"):
        hold(guard, link, 0.1)
    assert (link.sent, link.released, link.closed) == ([], 0, 1)
    assert (dog.moving, dog.dismissed) == (0, 1)
    assert guard.report().ending == ("released",)


def test_a_watchdog_that_does_not_start_keeps_the_robot_from_being_moved(link, dog, a1):
    def fail():
        raise CommunicationError("the watchdog did not start")

    dog.wait = fail
    with (
        Guard(HardwarePlatform(link), a1, BUSY, watchdog=lambda: dog) as guard,
        pytest.raises(CommunicationError, match="did not start"),
    ):
        hold(guard, link, 0.1)
    assert link.sent == []


def test_a_simulated_robot_waits_for_nobody(a1):
    """Its time does not pass while a program thinks, or hangs."""
    with simulate(a1, "ideal") as simulation, Guard(simulation.platform, a1) as guard:
        guard.step(JointCommand(guard.read().joint_position))
        before = guard.read().time
        time.sleep(0.2)
        assert guard.read().time == before


def test_settings_errors_are_no_motion(guard, link):
    def refuse(count):
        raise SettingsError("commands for 3 joints")

    link.act = refuse
    with pytest.raises(SettingsError):
        hold(guard, link, 0.1)
    assert link.released == 0


def test_between_two_motions_the_robot_is_held_at_once_and_no_sample_is_lost(guard, link, a1):
    """A few milliseconds of planning are no pause for the robot, nor for what it feels."""
    standing = Trajectory(np.repeat(nominal_stance(a1).joint_position[None], 20, axis=0))
    first = guard.play(standing)
    sent = len(link.sent)
    wait_until(lambda: len(link.sent) > sent + 2)
    second = guard.play(standing)
    together = np.concatenate([first.joints.time, second.joints.time])
    assert len(together) > 42
    assert np.diff(together) == pytest.approx(PERIOD)


def test_a_pause_for_long_is_in_no_recording(guard, link, a1):
    standing = Trajectory(np.repeat(nominal_stance(a1).joint_position[None], 20, axis=0))
    first = guard.play(standing)
    until = time.monotonic() + 2 * held_robot._PAUSE
    wait_until(lambda: time.monotonic() > until)
    second = guard.play(standing)
    assert len(second.joints.time) < 30
    assert second.joints.time[2] - first.joints.time[-1] > held_robot._PAUSE / 2


def test_nobody_holds_a_robot_that_is_stepped(guard, link, a1):
    """A feedback loop that follows on a motion sends its own commands, and no other."""
    here = JointCommand(nominal_stance(a1).joint_position)
    guard.play(Trajectory(np.repeat(here.position[None], 20, axis=0)))
    guard.step(here)
    counts = []
    for _ in range(50):
        sent = len(link.sent)
        guard.step(here)
        counts.append(len(link.sent) - sent)
    assert np.median(counts) == 1
