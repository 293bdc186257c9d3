"""Every limit of the guard, its ending and the watchdog, from both sides: what is just allowed, and what is not by little.

Looser by half, each would let something through here: `make mutants` tries that. Time is a count where it can be.
"""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from guarded import PERIOD, MemoryLink, at_rest, look

from equipoise import nominal_stance
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.errors import (
    CommunicationError,
    EquipoiseError,
    HungError,
    LimitError,
    OverrunError,
    SensorError,
    TrackingError,
)
from equipoise.experiments.legs_up import legs_up as turned_up
from equipoise.guard import guard as guard_module
from equipoise.guard import held_robot, safe_ending, watchdog
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.footing import feet_are_lifted, legs_are_up
from equipoise.guard.guard import Guard
from equipoise.guard.held_robot import HeldRobot
from equipoise.guard.joint_checks import JointChecks, StuckDetector
from equipoise.guard.known import Known
from equipoise.guard.limits import Limits
from equipoise.guard.safe_ending import SafeEnding
from equipoise.guard.sample_filter import SampleFilter
from equipoise.guard.soft_start import soft_start
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand
from equipoise.robot.kinematics import Kinematics, foot_positions, inverse_kinematics
from equipoise.robot.stance import lying_posture

KNEE, THIGH = 2, 1  # of the front left leg


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture(scope="module")
def home(stance):
    return stance.joint_position


@pytest.fixture(scope="module")
def gains(a1, stance):
    kp, kd = a1.gains(stance.hip_height)
    return np.full(12, kp), np.full(12, kd)


@pytest.fixture
def joints(a1, stance):
    return JointChecks(Limits(), a1, stance.hip_height, PERIOD, knows_gains=True)


class Clock:
    """A time that passes where somebody sleeps."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


def with_one(values, joint, value):
    values = np.array(values)
    values[joint] = value
    return values


def passes(act, error=EquipoiseError):
    """Whether something is let through."""
    try:
        act()
    except error:
        return False
    return True


# --- joints and motors


def test_an_encoder_beyond_its_joints_limits(a1, joints, home):
    def at(beyond):
        position = with_one(home, KNEE, a1.upper_limit[KNEE] + beyond)
        look(joints.at_rest, JointCommand(home), at_rest(a1, joint_position=position))

    at(0.14)
    with pytest.raises(LimitError, match="its limits are"):
        at(0.17)


def test_a_torque_that_is_missing(a1, joints, home):
    def lasts(torque):
        command = JointCommand(home, torque=with_one(np.zeros(12), KNEE, torque))
        for index in range(1000):
            look(joints.in_motion, command, at_rest(a1, index, joint_position=home))

    lasts(3.7)
    with pytest.raises(TrackingError, match="is it on, are its gains"):
        lasts(4.6)


def test_a_joint_that_runs_away(a1, joints, home):
    def away(angle, checks):
        look(checks, JointCommand(home), at_rest(a1, joint_position=with_one(home, THIGH, home[THIGH] + angle)))

    away(0.97, joints.in_motion)
    with pytest.raises(TrackingError):
        away(1.1, joints.in_motion)
    away(0.48, joints.held)
    with pytest.raises(TrackingError):
        away(0.6, joints.held)


@pytest.mark.parametrize(
    ("sent", "moved", "stuck"), [(0.11, 0.0, False), (0.15, 0.0, True), (0.2, 0.055, False), (0.2, 0.04, True)]
)
def test_a_joint_that_does_not_go_where_it_is_sent(sent, moved, stuck):
    detector = StuckDetector(1, 0, 10)
    ways = [(np.array([share * sent]), np.array([share * moved])) for share in np.tile(np.linspace(0, 1, 10), 2)]
    assert any(detector.feel(*way) is not None for way in ways) == stuck


def test_a_stuck_joint_is_noticed_within_two_half_seconds(a1, joints, home):
    def noticed(index):
        command = JointCommand(with_one(home, 7, home[7] + 0.1 * np.sin(6 * index * PERIOD)))
        return not passes(lambda: look(joints.in_motion, command, replace(at_rest(a1, index), joint_torque=None)))

    assert next(index for index in range(1000) if noticed(index)) * PERIOD < 1.2


# --- commands


def test_targets_beyond_limits_and_first_jumps(a1, stance, home):
    checks = CommandChecks(Limits(), a1, a1.gains(stance.hip_height), PERIOD)

    def sent(target, checks):
        look(checks, JointCommand(target), at_rest(a1), JointCommand(target))

    sent(with_one(home, KNEE, a1.upper_limit[KNEE] + 0.9e-3), checks.in_motion)
    with pytest.raises(LimitError):
        sent(with_one(home, KNEE, a1.upper_limit[KNEE] + 1.2e-3), checks.in_motion)
    sent(with_one(home, KNEE, home[KNEE] + 0.097), checks.at_rest)
    with pytest.raises(LimitError, match="motions start where the robot is"):
        sent(with_one(home, KNEE, home[KNEE] + 0.12), checks.at_rest)


@pytest.mark.parametrize(("height", "lifted"), [(2.6e-3, False), (3.6e-3, True)])
def test_feet_that_count_as_lifted(a1, stance, home, height, lifted):
    feet = stance.feet_in_base + np.array([height, 0, 0, height])[:, None] * [0, 0, 1]
    assert feet_are_lifted(a1, stance, inverse_kinematics(a1, feet, home)) == lifted


# --- samples


def believed(robot, states, target=None):
    """How many samples pass before one does not, and the error."""
    sieve = SampleFilter(robot, PERIOD, Limits().silence)
    for count, state in enumerate(states):
        try:
            sieve.accept(state, state.joint_position if target is None else target(count))
        except EquipoiseError as error:
            return count, error
    return len(states), None


def test_a_sensor_that_says_nothing_new(a1):
    count, error = believed(a1, [at_rest(a1)] * 500)
    assert isinstance(error, CommunicationError)
    assert 0.1 <= count * PERIOD < 0.13


def with_frozen_knee(state, home):
    return replace(state, joint_position=with_one(state.joint_position, KNEE, home[KNEE]))


@pytest.mark.parametrize(
    ("step", "through", "noticed"), [(1.5e-3, 0.042, False), (1.5e-3, 0.06, True), (0, 0.17, False), (0, 0.2, True)]
)
def test_an_encoder_that_is_frozen_among_coarse_ones(a1, home, step, through, noticed):
    """A step of 0: none has read a step so far, so that all may be coarse."""
    states = [
        with_frozen_knee(replace(at_rest(a1, index), joint_position=home + step * (index % 2)), home)
        for index in range(110)
    ]
    _, error = believed(a1, states, lambda count: home + min(count * PERIOD / 0.1, 1) * through)
    assert isinstance(error, SensorError) == noticed


@pytest.mark.parametrize(("through", "noticed"), [(0.028, False), (0.04, True)])
def test_an_encoder_that_is_frozen(a1, home, through, noticed):
    states = [with_frozen_knee(at_rest(a1, index), home) for index in range(110)]
    _, error = believed(a1, states, lambda count: home + min(count * PERIOD / 0.1, 1) * through)
    assert isinstance(error, SensorError) == noticed


def test_a_frozen_encoder_is_noticed_in_time(a1, home):
    states = [with_frozen_knee(at_rest(a1, index), home) for index in range(500)]
    count, _ = believed(a1, states, lambda count: home + count * PERIOD)
    assert 0.14 < count * PERIOD < 0.2


@pytest.mark.parametrize(
    ("speed_limit", "jump", "noticed"),
    [(21.0, 0.13, False), (21.0, 0.145, True), (1e9, 0.14, False), (1e9, 0.17, True)],
)
def test_an_encoder_that_jumps(a1, home, speed_limit, jump, noticed):
    robot = replace(a1, velocity_limit=np.full(12, speed_limit))
    _, error = believed(robot, [at_rest(a1), at_rest(a1, 1, joint_position=with_one(home, KNEE, home[KNEE] + jump))])
    assert (error is not None) == noticed


def test_which_way_is_up(a1):
    lean = 0.3

    def felt(acceleration):
        up = TiltFilter(np.eye(3))
        for index in range(251):
            direction = np.array([0.0, 0.0, 1.0]) if index == 0 else np.array([np.sin(lean), 0.0, np.cos(lean)])
            size = 9.81 if index == 0 else acceleration
            up.feel(
                SimpleNamespace(
                    time=index * PERIOD, acceleration_in_imu=size * direction, angular_velocity_in_imu=np.zeros(3)
                )
            )
        return up.tilt

    assert 0.17 < felt(9.81) < 0.21  # half a second
    assert felt(9.81 + 2.4) > 0.1
    assert felt(9.81 + 2.9) == pytest.approx(0, abs=1e-6)


# --- while nothing moves, and at the beginning


@pytest.mark.parametrize(
    ("silent", "stepped", "error"),
    [(1.25, 0.0, None), (1.5, 0.0, HungError), (0.0, 0.19, None), (0.0, 0.25, OverrunError)],
)
def test_a_program_that_gives_no_sign_of_life(monkeypatch, silent, stepped, error):
    loop, clock = SimpleNamespace(hold=lambda: None), Clock()
    monkeypatch.setattr(held_robot, "time", clock)
    monkeypatch.setattr(held_robot, "last_sign", lambda thread: clock.now - silent)
    held = HeldRobot(loop, PERIOD, Limits().stall, lambda trouble: None)
    held._sent = clock.now - stepped
    if error is None:
        held._repeat()
    else:
        with pytest.raises(error):
            held._repeat()


@pytest.mark.parametrize(("gap", "allowed"), [(0.19, True), (0.25, False)])
@pytest.mark.parametrize("left_in", ["between", "during"])
def test_a_step_after_a_gap(monkeypatch, gap, allowed, left_in):
    """Whoever steps looks by itself: what keeps the interpreter keeps the thread that holds from looking, too."""
    clock = Clock()
    held = HeldRobot(SimpleNamespace(step=clock.sleep), PERIOD, Limits().stall, lambda trouble: None)
    monkeypatch.setattr(held_robot, "time", clock)
    monkeypatch.setattr(threading.Thread, "start", lambda thread: None)
    held.step(10.0)  # the first may take long
    held.begin(None)
    held.step(gap if left_in == "during" else 0.0)
    clock.sleep(gap if left_in == "between" else 0.0)
    assert passes(lambda: held.step(0.0), OverrunError) == allowed
    held.stop()
    clock.sleep(10.0)
    held.step(0.0)  # the ending has looked where the robot is


def test_before_it_is_moved_a_robot_is_looked_at(a1, home, monkeypatch):
    class LookedError(Exception):
        pass

    def end(state, first):
        raise LookedError

    clock = Clock()
    guard = Guard(HardwarePlatform(MemoryLink(a1)), a1)
    monkeypatch.setattr(guard_module.time, "sleep", clock.sleep)
    monkeypatch.setattr(guard._loop, "take_over", end)
    with pytest.raises(LookedError):
        guard._begin(JointCommand(home))
    assert 0.29 < clock.now - 100.0 < 0.4
    waited = []
    monkeypatch.setattr(guard._held, "lock", SimpleNamespace(acquire=lambda timeout: waited.append(timeout) or False))
    with guard._alone() as alone:
        assert not alone
    assert 0.8 < waited[0] < 1.2


def test_a_soft_start_takes_a_second(a1, home, gains):
    commands = list(
        soft_start(JointCommand(home), at_rest(a1), gains, True, PERIOD, np.array([[-9.0], [9.0]]) * np.ones(12))
    )
    assert 0.95 < len(commands) * PERIOD < 1.05


# --- the ending


class Ending:
    """A safe ending whose robot is where `here(count)` says after so many commands."""

    def __init__(self, robot, gains, here, fails=False):
        self.robot, self.sent, self._here, self._fails = robot, [], here, fails
        held = SimpleNamespace(step=self._step, push=self._step)
        self.ending = SafeEnding(held, robot, nominal_stance(robot), gains, PERIOD, lambda: False)

    def _step(self, command):
        self.sent.append(command)
        if self._fails:
            raise CommunicationError("nothing gets through")
        return at_rest(self.robot, joint_position=self._here(len(self.sent)))

    def put_down(self, last, tilt=0.0, **how):
        known = Known(at_rest(self.robot, joint_position=self._here(0)), last, last, SimpleNamespace(tilt=tilt), **how)
        self.ending.put_down(known, None)
        return self.ending.done

    def times(self, select):
        """How long commands of a kind were sent [s]."""
        return sum(1 for command in self.sent if select(command)) * PERIOD


def is_limp(command):
    return command.kp is not None and not command.kp.any()


def test_a_robot_that_is_well_is_given_its_time(a1, home, gains):
    ending = Ending(a1, gains, lambda count: home)
    assert ending.put_down(JointCommand(home)) == ["lying down", "damped"]
    assert 2.4 < ending.times(lambda command: command.kp is None) < 2.7
    assert 0.45 < ending.times(lambda command: command.kp is not None and command.kp.any()) < 0.55
    assert 0.25 < ending.times(is_limp) < 0.35  # it was still


@pytest.mark.parametrize(
    ("off", "follows", "centred"),
    [(0.23, True, False), (0.27, True, True), (-0.27, True, True), (0.27, False, False)],
)
def test_a_body_far_from_the_middle_of_its_feet_is_brought_back_before_it_is_damped(
    a1, home, gains, off, follows, centred
):
    """If its legs follow; a fault keeps it from lying down."""
    feet, sent = nominal_stance(a1).feet_in_base.copy(), home
    for _ in range(9):  # the legs' own CoM goes with the feet
        feet[:, 0] += Kinematics(a1).com(sent)[0] - feet[:, 0].mean() - off * np.ptp(feet[:, 0]) / 2
        sent = inverse_kinematics(a1, feet, home)
    ending = Ending(a1, gains, lambda count: sent + 0.3)
    if follows:
        ending = Ending(a1, gains, lambda count: ending.sent[-1].position if count else sent)
    assert ending.put_down(JointCommand(sent), well=False) == [*["centred"] * centred, "damped"]
    assert (0.5 < ending.times(lambda command: command.kp is None) < 0.7) == centred
    if centred:
        np.testing.assert_allclose([one for one in ending.sent if one.kp is None][-1].position, home, atol=1e-6)


@pytest.mark.parametrize(("speed", "believed", "duration"), [(0.078, True, 4.0), (0.05, True, 0.3), (0.0, False, 4.0)])
def test_it_is_damped_until_it_is_still(a1, home, gains, speed, believed, duration):
    """By 0.02 rad in 0.3 s; or for four seconds."""
    ending = Ending(a1, gains, lambda count: home + speed * count * PERIOD)
    ending.put_down(JointCommand(home), well=False, believed=believed)
    assert ending.times(is_limp) == pytest.approx(duration, abs=0.1)


def test_a_robot_that_is_not_where_it_was_sent_does_not_lie_down_and_is_not_pulled(a1, home, gains):
    """With two legs: with more it has sunk."""
    for away, stages in ((0.28, ["lying down", "damped"]), (0.35, ["damped"])):
        there = home.copy()
        there[a1.leg_joints[:2]] += away
        ending = Ending(a1, gains, lambda count, there=there: there)
        assert ending.put_down(JointCommand(home)) == stages
    pull = np.abs([command.position - there for command in ending.sent if not is_limp(command)]).max()
    assert 0.14 < pull < 0.16


@pytest.mark.parametrize(("tilt", "caught"), [(0.75, True), (0.85, False)])
def test_feet_are_put_down_if_that_is_sensible(a1, home, stance, gains, tilt, caught):
    feet = stance.feet_in_base + np.array([0.02, 0, 0, 0.02])[:, None] * [0, 0, 1]
    raised = inverse_kinematics(a1, feet, home)
    ending = Ending(a1, gains, lambda count: raised)
    assert (ending.put_down(JointCommand(raised), tilt, well=False)[0] == "feet down") == caught
    stiff = ending.times(lambda command: not is_limp(command))
    assert stiff == pytest.approx(0.8 if caught else 0.5, abs=0.03)


def test_lying_down_keeps_to_half_of_the_joints_speeds(a1, home, gains):
    slow = replace(a1, velocity_limit=np.full(12, 0.4))
    ending = Ending(slow, gains, lambda count: home)
    ending.put_down(JointCommand(home), well=True)
    positions = np.array([command.position for command in ending.sent if command.kp is None])
    assert 0.15 < np.abs(np.diff(positions, axis=0)).max() / PERIOD < 0.21


@pytest.mark.parametrize(("slept", "tries"), [(PERIOD, 26), (0.1, 4)])
def test_feet_that_nothing_reaches_are_given_up_and_damped_all_the_same(a1, home, gains, monkeypatch, slept, tries):
    """A robot whose state stream is silent may still hear: it sinks for as long as one that answers may take."""
    clock = Clock()
    monkeypatch.setattr(
        safe_ending, "time", SimpleNamespace(monotonic=clock.monotonic, sleep=lambda _: clock.sleep(slept))
    )
    feet = nominal_stance(a1).feet_in_base.copy()
    feet[0, 2] += 0.05
    raised = inverse_kinematics(a1, feet, home)
    ending = Ending(a1, gains, lambda count: raised, fails=True)
    down, damped = ending.put_down(JointCommand(raised), well=False)
    assert down == "feet down, stopped: nothing gets through"
    assert damped == "damped, stopped: nothing gets through"
    assert sum(command.kp is None for command in ending.sent) == tries
    assert sum(command.kp is not None for command in ending.sent) * slept == pytest.approx(4.05, abs=0.2)
    assert sum(is_limp(command) for command in ending.sent) * slept == pytest.approx(3.5, abs=0.2)


@pytest.mark.parametrize("legs", [4, 3, 2])
def test_a_robot_that_somebody_else_let_down_is_not_pulled_up_again(a1, stance, gains, legs):
    """Its joints are far from where they were sent, with three legs at least."""
    there, _ = lying_posture(a1, stance)
    there[a1.leg_joints[legs:]] = stance.joint_position[a1.leg_joints[legs:]]
    ending = Ending(a1, gains, lambda count: there)
    done = ending.put_down(JointCommand(stance.joint_position), well=False)
    if legs == 2:
        assert any(not is_limp(command) for command in ending.sent)
    else:
        assert done == ["damped"]
        assert all(is_limp(command) for command in ending.sent)


# --- the watchdog


def let_down(robot, monkeypatch, link, legs_up=False):
    """What the watchdog does, in which time, and how often it connects."""
    clock, opened = Clock(), []
    monkeypatch.setattr(watchdog, "time", clock)
    monkeypatch.setattr("equipoise.drivers.catalog.open_beside", lambda *what: opened.append(what) or link)
    said = watchdog._Hand("unitree-a1", robot, {}).let_down(legs_up)
    return said, clock.now - 100.0, len(opened)


@pytest.mark.parametrize(("legs_up", "seconds"), [(False, 4.05), (True, 10.1)])
def test_the_watchdog_damps_until_a_body_has_sunk_or_legs_are_down(a1, stance, monkeypatch, legs_up, seconds):
    link = MemoryLink(a1)
    said, took, _ = let_down(a1, monkeypatch, link, legs_up)
    assert said == f"its joints were damped ({len(link.sent)} commands)"
    assert took == pytest.approx(seconds, abs=0.1)
    assert link.sent[0].kd == pytest.approx(a1.gains(stance.hip_height)[1])


def test_the_watchdog_remembers_what_it_was_told_of_legs_last(monkeypatch):
    said = iter([b"md..u", b".", b"..", b"ud.", b"d", b".u.", b""])
    monkeypatch.setattr(watchdog, "select", SimpleNamespace(select=lambda *_: ([0], [], [])))
    seen = []
    monkeypatch.setattr(watchdog, "os", SimpleNamespace(read=lambda pipe, size: seen.append(next(said)) or seen[-1]))
    assert watchdog._watch(0) == ("the program is gone", True)
    said = iter([b"mu", b"d", b"...", b""])
    assert watchdog._watch(0) == ("the program is gone", False)


def test_a_foot_a_tenth_of_a_leg_above_where_it_lies_is_up(a1, stance):
    up = turned_up(a1, stance)
    way = up.folded + np.linspace(0.0, 1.0, 400)[:, None] * (up.joint_position - up.folded)
    lying = foot_positions(a1, up.folded)[:, 2]
    height = np.array([(foot_positions(a1, position)[:, 2] - lying).max() for position in way]) / a1.leg_length
    below, above = way[np.flatnonzero(height < 0.09)[-1]], way[np.flatnonzero(height > 0.11)[0]]
    assert not legs_are_up(a1, stance, below)
    assert legs_are_up(a1, stance, above)
    assert not legs_are_up(a1, stance, stance.joint_position)


def test_the_watchdog_tries_for_fifteen_seconds_and_connects_anew_every_second(a1, monkeypatch):
    def refuse(count):
        raise OSError("no")

    said, took, opened = let_down(a1, monkeypatch, MemoryLink(a1, act=refuse))
    assert said == "the robot could not be damped: no"
    assert 14.5 < took < 15.5
    assert 13 <= opened - 1 <= 15


def test_the_watchdogs_patience(monkeypatch):
    waited, ready = [], iter([[0], []])

    def select(reading, writing, failing, timeout):
        waited.append(timeout)
        return next(ready), [], []

    monkeypatch.setattr(watchdog, "select", SimpleNamespace(select=select))
    monkeypatch.setattr(watchdog, "os", SimpleNamespace(read=lambda pipe, size: b"m"))
    assert watchdog._watch(0) == ("the program gave no sign of life for 2 s", False)
    assert waited == [2.0, 2.0]
    ready = iter([[]])
    dog = object.__new__(watchdog.Watchdog)
    dog._process = SimpleNamespace(stdout=0, stdin=None)
    with pytest.raises(CommunicationError, match="did not start within 60 s"):
        dog.wait()
    assert waited[-1] == 60.0
