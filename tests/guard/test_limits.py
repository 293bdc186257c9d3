"""Every limit of the guard, its endings and the second connection from both sides: just allowed, and just not.

Looser by half, each would let something through here: `make mutants` tries that. Time is a count where it can be.
"""

import signal
import socket
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from guarded import PERIOD, Clock, MemoryConnection, at_rest, is_damped, look

from equipoise import nominal_stance
from equipoise.conventions import GRAVITY
from equipoise.errors import (
    CommunicationError,
    EquipoiseError,
    FallError,
    MotionError,
    StoppedError,
)
from equipoise.experiments.legs_up import legs_up as turned_up
from equipoise.guard import endings, robot_loop, second_connection
from equipoise.guard.check_context import CheckContext
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.endings import NOT_CONFIRMED
from equipoise.guard.footing import feet_are_lifted, legs_are_up
from equipoise.guard.force_limit import ForceLimit
from equipoise.guard.joint_checks import JointChecks, StuckDetector
from equipoise.guard.limits import Limits
from equipoise.guard.pipe import Pipe, Setup
from equipoise.guard.robot_loop import MotionOrder, RobotLoop
from equipoise.guard.robot_process import RobotProcess
from equipoise.guard.sample_filter import SampleFilter
from equipoise.guard.second_connection import SecondConnection
from equipoise.guard.soft_start import soft_start
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand, Trajectory
from equipoise.robot.kinematics import foot_jacobians, foot_positions, inverse_kinematics
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
    return JointChecks(Limits(), a1, stance.hip_height, PERIOD, uses_gains=True)


def with_one(values, joint, value):
    values = np.array(values)
    values[joint] = value
    return values


def passes(act, error=EquipoiseError):
    """Return whether a check passes."""
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
    with pytest.raises(MotionError, match="its limits are"):
        at(0.17)


def test_a_torque_that_is_missing(a1, joints, home):
    def lasts(torque):
        command = JointCommand(home, torque=with_one(np.zeros(12), KNEE, torque))
        for index in range(1000):
            look(joints.in_motion, command, at_rest(a1, index, joint_position=home))

    lasts(3.7)
    with pytest.raises(MotionError, match="is the motor on, and does it use"):
        lasts(4.6)


def test_a_joint_that_runs_away(a1, joints, home):
    def away(angle, checks):
        look(checks, JointCommand(home), at_rest(a1, joint_position=with_one(home, THIGH, home[THIGH] + angle)))

    away(0.97, joints.in_motion)
    with pytest.raises(MotionError, match="from its target"):
        away(1.1, joints.in_motion)


@pytest.mark.parametrize(
    ("sent", "moved", "stuck"), [(0.11, 0.0, False), (0.15, 0.0, True), (0.2, 0.055, False), (0.2, 0.04, True)]
)
def test_a_joint_that_does_not_go_where_it_is_sent(sent, moved, stuck):
    detector = StuckDetector(1, 0, 10)
    ways = [(np.array([share * sent]), np.array([share * moved])) for share in np.tile(np.linspace(0, 1, 10), 2)]
    assert any(detector.update(*way) is not None for way in ways) == stuck


def test_a_stuck_joint_is_noticed_within_two_half_seconds(a1, joints, home):
    def noticed(index):
        command = JointCommand(with_one(home, 7, home[7] + 0.1 * np.sin(6 * index * PERIOD)))
        return not passes(lambda: look(joints.in_motion, command, replace(at_rest(a1, index), joint_torque=None)))

    assert next(index for index in range(1000) if noticed(index)) * PERIOD < 1.2


@pytest.mark.parametrize(("charge", "goes_on"), [(0.11, True), (0.09, False)])
def test_a_battery_that_is_nearly_empty(a1, joints, home, charge, goes_on):
    state = at_rest(a1, health=Health(battery_charge=charge))
    for checks in (joints.at_rest, joints.health):
        assert passes(lambda checks=checks: look(checks, JointCommand(home), state), StoppedError) == goes_on


# --- commands


def test_targets_beyond_limits_and_first_jumps(a1, stance, home):
    checks = CommandChecks(Limits(), a1, a1.gains(stance.hip_height), PERIOD)

    def sent(target, checks):
        look(checks, JointCommand(target), at_rest(a1), JointCommand(target))

    sent(with_one(home, KNEE, a1.upper_limit[KNEE] + 0.9e-3), checks.in_motion)
    with pytest.raises(MotionError, match="its limits are"):
        sent(with_one(home, KNEE, a1.upper_limit[KNEE] + 1.2e-3), checks.in_motion)
    sent(with_one(home, KNEE, home[KNEE] + 0.097), checks.at_rest)
    with pytest.raises(MotionError, match="begin the motion at"):
        sent(with_one(home, KNEE, home[KNEE] + 0.12), checks.at_rest)


@pytest.mark.parametrize(("height", "lifted"), [(2.6e-3, False), (3.6e-3, True)])
def test_feet_that_count_as_lifted(a1, stance, home, height, lifted):
    feet = stance.feet_in_base + np.array([height, 0, 0, height])[:, None] * [0, 0, 1]
    assert feet_are_lifted(a1, stance, inverse_kinematics(a1, feet, home)) == lifted


# --- samples


def accepted(robot, states, target=None):
    """Return the number of accepted samples before the first error, and the error."""
    sieve = SampleFilter(robot, PERIOD, Limits().silence)
    for count, state in enumerate(states):
        try:
            sieve.accept([state], state.joint_position if target is None else target(count))
        except EquipoiseError as error:
            return count, error
    return len(states), None


def test_a_sensor_that_reports_nothing_new(a1):
    count, error = accepted(a1, [at_rest(a1)] * 500)
    assert type(error) in (MotionError, CommunicationError)
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
    _, error = accepted(a1, states, lambda count: home + min(count * PERIOD / 0.1, 1) * through)
    assert (type(error) is MotionError) == noticed


@pytest.mark.parametrize(("through", "noticed"), [(0.028, False), (0.04, True)])
def test_an_encoder_that_is_frozen(a1, home, through, noticed):
    states = [with_frozen_knee(at_rest(a1, index), home) for index in range(110)]
    _, error = accepted(a1, states, lambda count: home + min(count * PERIOD / 0.1, 1) * through)
    assert (type(error) is MotionError) == noticed


def test_a_frozen_encoder_is_noticed_in_time(a1, home):
    states = [with_frozen_knee(at_rest(a1, index), home) for index in range(500)]
    count, _ = accepted(a1, states, lambda count: home + count * PERIOD)
    assert 0.14 < count * PERIOD < 0.2


@pytest.mark.parametrize(
    ("speed_limit", "jump", "noticed"),
    [(21.0, 0.13, False), (21.0, 0.145, True), (1e9, 0.14, False), (1e9, 0.17, True)],
)
def test_an_encoder_that_jumps(a1, home, speed_limit, jump, noticed):
    robot = replace(a1, velocity_limit=np.full(12, speed_limit))
    _, error = accepted(robot, [at_rest(a1), at_rest(a1, 1, joint_position=with_one(home, KNEE, home[KNEE] + jump))])
    assert (error is not None) == noticed


def test_which_way_is_up(a1):
    lean = 0.3

    def filtered_tilt(acceleration):
        up = TiltFilter(np.eye(3))
        for index in range(251):
            direction = np.array([0.0, 0.0, 1.0]) if index == 0 else np.array([np.sin(lean), 0.0, np.cos(lean)])
            size = 9.81 if index == 0 else acceleration
            up.update(
                SimpleNamespace(
                    time=index * PERIOD, acceleration_in_imu=size * direction, angular_velocity_in_imu=np.zeros(3)
                )
            )
        return up.tilt

    assert 0.17 < filtered_tilt(9.81) < 0.21  # half a second
    assert filtered_tilt(9.81 + 2.4) > 0.1
    assert filtered_tilt(9.81 + 2.9) == pytest.approx(0, abs=1e-6)


# --- time


@pytest.mark.parametrize(("gap", "allowed"), [(0.19, True), (0.25, False)])
def test_a_command_after_a_gap(a1, home, monkeypatch, gap, allowed):
    clock, platform = Clock(), Robot(a1, lambda count: home)
    monkeypatch.setattr(robot_loop, "time", clock)
    platform.received = clock.monotonic
    loop = taken_over(platform, a1, JointCommand(home))
    loop.tick()
    clock.sleep(gap)
    loop.tick()
    assert (loop.trouble is None) == allowed
    assert allowed or (type(loop.trouble), loop.trouble.exit_code) == (StoppedError, 4)


@pytest.mark.parametrize("moved", [False, True])
def test_a_robot_that_nothing_moves_is_put_down_after_ten_minutes(a1, home, moved):
    """One that was never commanded is only observed, for as long as the operator likes."""
    before = signal.getsignal(signal.SIGTERM)
    ours, theirs = map(Pipe, socket.socketpair())
    try:
        setup = Setup("", {}, a1.name, a1.source, a1.description, Limits())
        process = RobotProcess(theirs, setup, Robot(a1, lambda count: home), a1)
    finally:
        signal.signal(signal.SIGTERM, before)
        ours.close()
        theirs.close()
    process._loop.context = object() if moved else None
    ended, count = [], 0
    process._loop.end = lambda error: ended.append((error, count * PERIOD))
    while not ended and count < 450_000:
        process._post_batch()
        count += 1
    assert [599 < time < 660 for _, time in ended] == [True] * moved
    assert all((type(error), error.exit_code) == (StoppedError, 4) for error, _ in ended)


def test_before_it_is_moved_a_robot_is_observed(a1, home, monkeypatch):
    clock, platform = Clock(), Robot(a1, lambda count: home)
    monkeypatch.setattr(robot_loop, "time", clock)
    platform.received = clock.monotonic
    loop = RobotLoop(platform, a1)
    loop.move(MotionOrder(1, Trajectory(home[None])))
    while not platform.sent:
        loop.tick()
    assert 0.29 < clock.now - 100.0 < 0.4


def test_a_soft_start_takes_a_second(a1, home, gains):
    commands = list(
        soft_start(JointCommand(home), at_rest(a1), gains, True, PERIOD, np.array([[-9.0], [9.0]]) * np.ones(12))
    )
    assert 0.95 < len(commands) * PERIOD < 1.05


# --- forces


def bounded(robot, stance, gains, limits, position, target, lifted=False, count=1):
    """Return a bounded command after so many of them, and the torque that it adds to its feed-forward [Nm]."""
    force = ForceLimit(limits, robot, stance, gains, PERIOD)
    command = JointCommand(target, torque=np.ones(12))
    for _ in range(count):
        sent = force.bounded(command, at_rest(robot, joint_position=position), lifted)
    kp = gains[0] if sent.kp is None else sent.kp
    return sent, kp * (sent.position - position)


def test_torque_beyond_the_feed_forward_is_bounded_by_the_motor_and_by_the_force_at_the_foot(a1, stance, home, gains):
    """30 % of the motor's, or 60 N; a command within that is not touched."""
    lever = np.linalg.norm(foot_jacobians(a1, stance.joint_position), axis=1).ravel()
    strong = replace(a1, effort_limit=np.full(12, 200.0))
    for robot, most in ((a1, np.minimum(0.3 * a1.effort_limit, 60 * lever)), (strong, 60 * lever)):
        for side in (1, -1):
            sent, excess = bounded(robot, stance, gains, Limits(), home, home + side * 0.4)
            assert excess == pytest.approx(side * most, rel=1e-6)
            assert (sent.torque == 1).all()
    command, excess = bounded(a1, stance, gains, Limits(), home, home + 0.9 * most.min() / gains[0])
    assert command.position == pytest.approx(home + excess / gains[0])


def test_a_heavy_robot_may_exert_a_quarter_of_its_weight_at_a_foot(a1, stance, home, gains):
    heavy = replace(a1, effort_limit=np.full(12, 10.0))  # for its motors
    lever = np.linalg.norm(foot_jacobians(a1, stance.joint_position), axis=1).ravel()
    _, excess = bounded(heavy, stance, gains, Limits(), home, home + 0.9)
    assert excess == pytest.approx(0.25 * a1.mass * GRAVITY * lever, rel=1e-6)


def test_the_first_two_lifts_are_at_half_stiffness(a1, stance, home, gains):
    """It goes there and back by 5 a second."""
    force, shares = ForceLimit(Limits(), a1, stance, gains, PERIOD), []
    state, command = at_rest(a1, joint_position=home), JointCommand(home, torque=np.zeros(12))
    for lifted in np.repeat([False, True, False, True, False, True, False], 100):
        kp = force.bounded(command, state, bool(lifted)).kp
        shares.append(1.0 if kp is None else kp[0] / gains[0][0])
    assert np.array(shares)[[99, 199, 299, 399, 499, 599, 699]] == pytest.approx([1, 0.5, 1, 0.5, 1, 1, 1])
    assert np.abs(np.diff(shares)).max() == pytest.approx(5 * PERIOD)


def test_gains_that_a_command_sets_are_kept_in_the_first_lifts(a1, stance, home, gains):
    force, state = ForceLimit(Limits(), a1, stance, gains, PERIOD), at_rest(a1, joint_position=home)
    command = JointCommand(home, torque=np.zeros(12), kp=0.4 * gains[0], kd=gains[1])
    assert all(force.bounded(command, state, True) is command for _ in range(100))


# --- the endings


class Robot:
    """A platform whose joints are at `here(count)` after so many commands; None: where they were sent last."""

    control_period = PERIOD

    def __init__(self, robot, here, fails=lambda count: False, accepts=ACCEPTS_EVERYTHING):
        self.robot, self.joint_names, self.accepts = robot, robot.joint_names, accepts
        self.here, self.fails, self.sent, self.received = here, fails, [], lambda: None

    def read(self):
        count = len(self.sent)
        position = self.here(count) + 1e-6 * (count % 7)
        return at_rest(self.robot, count, joint_position=position, joint_torque=None, received=self.received())

    def step(self, command):
        self.sent.append(command)
        if self.fails(len(self.sent)):
            raise CommunicationError("nothing gets through")
        return self.read()

    def close(self):
        pass

    def follow(self, start):
        """Its joints are where they were sent last, and stay there when they are damped."""
        stiff = [start]

        def here(count):
            stiff[:] = [self.sent[-1].position] if self.sent and not self.sent[-1].limp else stiff
            return stiff[0]

        self.here = here
        return self


def taken_over(platform, robot, sent, standing=None):
    loop = RobotLoop(platform, robot)
    loop.tick()
    loop.context = CheckContext(loop.state, sent, sent, standing or sent, loop._tilt_filter)
    return loop


def put_down(platform, robot, sent, controllable=True, standing=None, urgent=False, tilt=None):
    """The steps of the ending of a robot that was sent somewhere last."""
    loop = taken_over(platform, robot, sent, standing)
    if tilt is not None:
        loop.context.up = SimpleNamespace(tilt=tilt, lean=lambda floor: 0.0, update=lambda sample: None)
    loop.end(None if controllable else FallError("it falls"), urgent, controllable)
    while not loop.over:
        loop.tick()
    return loop.ending.done[:-1]


def duration(platform, select):
    """Return the time for which commands of a kind were sent [s]."""
    return sum(1 for command in platform.sent if select(command)) * PERIOD


def is_stiff(command):
    return command.kp is None


def test_a_sound_robot_is_given_its_time(a1, home):
    platform = Robot(a1, None).follow(home)
    assert put_down(platform, a1, JointCommand(home)) == ["lowered", "damped"]
    assert 2.4 < duration(platform, is_stiff) < 2.7
    assert 0.45 < duration(platform, lambda command: not is_stiff(command) and command.kp.any()) < 0.55
    assert 1.45 < duration(platform, is_damped) < 1.6  # it was still


def test_a_robot_is_lowered_at_a_fifth_of_a_metre_a_second(a1, home, monkeypatch):
    """A tall one takes longer than the usual time."""
    monkeypatch.setattr(endings, "LIE_DOWN", 0.1)
    fast = replace(a1, velocity_limit=np.full(12, 1e3))
    platform = Robot(fast, None).follow(home)
    put_down(platform, fast, JointCommand(home))
    height = np.array([foot_positions(a1, command.position)[:, 2].mean() for command in platform.sent])
    assert 0.17 < np.abs(np.diff(height)).max() / PERIOD < 0.215


@pytest.mark.parametrize(
    ("speed", "lies", "seconds"),
    [(0.078, False, 12.1), (0.05, True, 1.5), (0.0, True, 1.5), (0.0, False, 4.05)],
)
def test_it_is_damped_until_it_is_at_rest(a1, stance, home, speed, lies, seconds):
    """By 0.02 rad in 0.3 s, for one and a half seconds at least; one that does not lie for as long as it may take to sink."""
    there = lying_posture(a1, stance)[0] if lies else home
    platform = Robot(a1, lambda count: there + speed * min(count, 6000) * PERIOD * (np.arange(12) == KNEE))
    robot = replace(a1, upper_limit=a1.upper_limit + 10)
    done = put_down(platform, robot, JointCommand(there), controllable=False)
    assert duration(platform, is_damped) == pytest.approx(seconds, abs=0.12)
    assert done == ["damped" if speed < 0.06 else f"damping commands were sent; {NOT_CONFIRMED}"]


@pytest.mark.parametrize(("moved", "seconds"), [(0.09, 4.05), (0.13, 1.5)])
def test_a_stiff_robot_whose_joints_have_not_given_way_is_damped_longer(a1, home, moved, seconds):
    platform = Robot(a1, lambda count: home + moved * min(count / 300, 1) * (np.arange(12) == THIGH))
    assert put_down(platform, a1, JointCommand(home), controllable=False) == ["damped"]
    assert duration(platform, is_damped) == pytest.approx(seconds, abs=0.1)


@pytest.mark.parametrize(("gap", "confirmed"), [(45, True), (60, False)])
def test_a_robot_that_is_silent_confirms_nothing(a1, stance, gap, confirmed):
    """No sample for a tenth of a second: the silence begins so many control periods before the damping may end."""
    lying, _ = lying_posture(a1, stance)
    begins = round(1.5 / PERIOD) - gap
    platform = Robot(a1, lambda count: lying, lambda count: count > begins)
    done = put_down(platform, a1, JointCommand(lying), controllable=False)
    assert done == ["damped" if confirmed else f"damping commands were sent; {NOT_CONFIRMED}"]
    assert duration(platform, is_damped) == pytest.approx(1.5 if confirmed else 4.05, abs=0.1)


@pytest.mark.parametrize(("away", "legs", "done"), [
    (0.27, 4, ["lowered", "damped"]), (0.35, 4, ["damped"]), (0.35, 3, ["damped"]), (0.35, 2, ["lowered", "damped"]),
])  # fmt: skip
def test_a_robot_that_has_sunk_meanwhile_is_not_pulled_up_again(a1, home, away, legs, done):
    """Its joints are far from where they were sent, with three legs at least."""
    off = np.zeros(12)
    off[a1.leg_joints[:legs].ravel()] = away
    platform = Robot(a1, None)
    platform.here = lambda count: (platform.sent[-1].position if platform.sent else home) + off
    found = put_down(platform, a1, JointCommand(home))
    assert found == done or found[0].startswith("lowered, stopped")
    assert found[0].startswith(done[0])
    assert any(map(is_stiff, platform.sent)) == (done[0] == "lowered")


@pytest.mark.parametrize("urgent", [False, True])
def test_feet_in_the_air_are_put_down_first(a1, stance, home, urgent):
    feet = stance.feet_in_base + np.array([0.02, 0, 0, 0.02])[:, None] * [0, 0, 1]
    raised = inverse_kinematics(a1, feet, home)
    platform = Robot(a1, None).follow(raised)
    done = put_down(platform, a1, JointCommand(raised), standing=JointCommand(home), urgent=urgent)
    assert done == ["feet down", *["lowered"] * (not urgent), "damped"]
    assert np.allclose(platform.sent[149].position, home)
    if urgent:
        assert duration(platform, lambda command: not is_damped(command)) == pytest.approx(0.8, abs=0.02)


def test_lowering_keeps_to_half_of_the_joints_speeds(a1, home):
    slow = replace(a1, velocity_limit=np.full(12, 0.4))
    platform = Robot(slow, None).follow(home)
    put_down(platform, slow, JointCommand(home))
    positions = np.array([command.position for command in platform.sent if is_stiff(command)])
    assert 0.15 < np.abs(np.diff(positions, axis=0)).max() / PERIOD < 0.21


@pytest.mark.parametrize(("tilt", "lowered"), [(0.97, True), (1.05, False)])
def test_a_robot_that_cannot_be_damped_is_lowered_unless_it_has_fallen(a1, home, tilt, lowered):
    platform = Robot(a1, None, accepts=frozenset()).follow(home)
    done = put_down(platform, a1, JointCommand(home), controllable=False, tilt=tilt)
    assert done == [*["lowered"] * lowered, "left to its own controller"]


def test_a_foot_a_tenth_of_a_leg_above_where_it_lies_is_up(a1, stance):
    up = turned_up(a1, stance)
    way = up.folded + np.linspace(0.0, 1.0, 400)[:, None] * (up.joint_position - up.folded)
    lying = foot_positions(a1, up.folded)[:, 2]
    height = np.array([(foot_positions(a1, position)[:, 2] - lying).max() for position in way]) / a1.leg_length
    below, above = way[np.flatnonzero(height < 0.09)[-1]], way[np.flatnonzero(height > 0.11)[0]]
    assert not legs_are_up(a1, stance, below)
    assert legs_are_up(a1, stance, above)
    assert not legs_are_up(a1, stance, stance.joint_position)


# --- the second connection


def damp(robot, monkeypatch, link):
    """Return the result of a second connection, its time, and its number of connections."""
    clock, opened = Clock(), []
    monkeypatch.setattr(second_connection, "time", clock)
    second = SecondConnection(robot, lambda: opened.append(link) or link)
    second.open()
    return second.damp(), clock.now - 100.0, len(opened)


class Still(MemoryConnection):
    """A link that answers for so many commands."""

    answers = 10**9

    def receive(self):
        return super().receive() if len(self.sent) <= self.answers else []


@pytest.mark.parametrize(("answers", "seconds"), [(10**9, 1.5), (0, 10.1)])
def test_the_second_connection_damps_until_the_robot_is_at_rest_or_its_legs_are_down(
    a1, stance, monkeypatch, answers, seconds
):
    link = Still(a1)
    link.answers = answers
    done, took, _ = damp(a1, monkeypatch, link)
    assert took == pytest.approx(seconds, abs=0.1)
    count = len(link.sent)
    assert done == (
        f"{count} damping commands were sent; {NOT_CONFIRMED}" if answers == 0 else f"damped ({count} commands)"
    )
    assert all(map(is_damped, link.sent))
    assert link.sent[0].kd == pytest.approx(a1.gains(stance.hip_height)[1])
    assert link.released == 1


def test_the_second_connection_tries_for_fifteen_seconds_and_connects_again_every_second(a1, monkeypatch):
    def refuse(count):
        raise OSError("no")

    done, took, opened = damp(a1, monkeypatch, MemoryConnection(a1, act=refuse))
    assert done == f"the robot was not damped: no. {NOT_CONFIRMED}"
    assert 14.5 < took < 15.5
    assert 13 <= opened - 1 <= 15
