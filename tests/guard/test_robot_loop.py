"""One control period of the robot loop, on a platform that answers with fixed states: what it names, and what it sends."""

import contextlib
import time
from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, Clock, at_rest, is_damped

from equipoise import nominal_stance
from equipoise.errors import (
    CommunicationError,
    FallError,
    MotionError,
    StoppedError,
)
from equipoise.guard import endings, footing, robot_loop
from equipoise.guard.check_context import CheckContext
from equipoise.guard.endings import NOT_CONFIRMED
from equipoise.guard.limits import Limits
from equipoise.guard.robot_loop import MotionOrder, RobotLoop
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand, Trajectory

AT_ONCE = Limits(patience=1e-3)  # less than a control period


@pytest.fixture(autouse=True)
def _soon_down(monkeypatch):
    """An ending takes as long as it does; test_limits.py counts that."""
    for module, name, value in ((endings, "LIE_DOWN", 0.2), (endings, "_LOWERING", 2.0), (footing, "_SUNK", 0.3)):
        monkeypatch.setattr(module, name, value)


class Robot:
    """A platform whose state after so many commands is `state(count)`; `act(count)` is called before each, and may raise.

    One that follows has its joints where they were sent last.
    """

    control_period = PERIOD

    def __init__(self, robot, state, act=lambda count: None, accepts=ACCEPTS_EVERYTHING, follows=False):
        self.joint_names, self.accepts, self.follows = robot.joint_names, accepts, follows
        self.state, self.act, self.sent, self.closed = state, act, [], 0

    def read(self):
        state = self.state(len(self.sent))
        if not (self.follows and self.sent):
            return state
        there = next((command.position for command in reversed(self.sent) if not command.limp), state.joint_position)
        return replace(state, joint_position=there + 1e-6 * (len(self.sent) % 7), joint_torque=None)

    def step(self, command):
        self.act(len(self.sent))
        self.sent.append(command)
        return self.read()

    def close(self):
        self.closed += 1


def sound(robot):
    return lambda count: at_rest(robot, count)


def commanded(platform, robot, limits=None, count=1000):
    """A loop whose robot was taken over, and is to stay where it is for so many control periods."""
    loop = RobotLoop(platform, robot, limits)
    loop.tick()
    hold = JointCommand(loop.state.joint_position)
    loop.context = CheckContext(loop.state, hold, hold, hold, loop._tilt_filter)
    loop.move(MotionOrder(1, Trajectory(np.repeat(hold.position[None], count, axis=0))))
    return loop


def run(loop, count=100_000):
    """Tick until the robot was put down and released."""
    ticks = []
    while not loop.over and len(ticks) < count:
        ticks.append(loop.tick())
    return ticks


def with_one(name, joint, value):
    """A change of one joint's number in a state or a command."""

    def change(whole):
        values = np.array(getattr(whole, name))
        values[joint] = value
        return replace(whole, **{name: values})

    return change


def broken(state):
    return replace(state, health=Health(fault="motor 3 lost"))


IN_MOTION = [
    ("is not finite", MotionError, with_one("joint_velocity", 0, np.nan)),
    ("'FL_calf_joint' is at 0.500 rad; its limits are", MotionError, with_one("joint_position", 2, 0.5)),
    ("'FR_thigh_joint' turns at -30.0 rad/s", MotionError, with_one("joint_velocity", 4, -30.0)),
    ("'FL_thigh_joint' is 1.28 rad from its target", MotionError, with_one("joint_position", 1, 2.0)),
    ("'RR_calf_joint' gives 45.0 Nm; its limit is", MotionError, with_one("joint_torque", 11, 45.0)),
    ("the motor of joint 'RR_hip_joint' gives 30.0 Nm; its position", MotionError, with_one("joint_torque", 9, 30.0)),
    (
        "the base leans by 90 deg",
        FallError,
        lambda state: replace(state, acceleration_in_imu=np.array([9.81, 0.0, 0.0])),
    ),
    ("the robot reports a fault: motor 3 lost", StoppedError, broken),
]


@pytest.mark.parametrize("first", range(len(IN_MOTION)), ids=lambda first: IN_MOTION[first][0])
def test_of_several_faults_in_motion_one_is_named_and_only_the_robots_own_ends_soundly(a1, first):
    state = at_rest(a1, 500)
    for _, _, change in IN_MOTION[first:]:
        state = change(state)
    loop = commanded(Robot(a1, lambda count: state if count else at_rest(a1)), a1, AT_ONCE)
    loop.tick()
    message, kind, _ = IN_MOTION[first]
    assert type(loop.trouble) is kind
    assert message in str(loop.trouble)
    assert loop.ending.controllable == (kind is StoppedError)


def test_a_command_that_is_refused_is_not_sent_and_the_robot_is_lowered(a1):
    platform = Robot(a1, sound(a1), follows=True)
    loop = commanded(platform, a1)
    home = nominal_stance(a1).joint_position
    loop.move(MotionOrder(2, Trajectory(home[None] + 0.3)))
    assert loop.tick().target is None
    assert str(loop.trouble).startswith("the target of joint 'FL_thigh_joint' jumps by")
    assert platform.sent == []
    assert loop.ending.controllable
    loop.tick()
    assert loop.ending.done == ["lowered"]


@pytest.mark.parametrize(
    ("moves", "error", "message"),
    [
        (lambda index: {"time": 0.0}, MotionError, "samples are repeated: no fresh sample for 10"),
        (lambda index: {"imu_time": 0.0}, CommunicationError, "no IMU sample has arrived for 10"),
        (lambda index: {"angular_velocity_in_imu": np.zeros(3)}, MotionError, "the IMU is frozen"),
    ],
)
def test_sensors_that_stop_are_noticed(a1, moves, error, message):
    platform = Robot(a1, lambda count: at_rest(a1, count, **moves(count)))
    loop = commanded(platform, a1)
    home = nominal_stance(a1).joint_position
    way = home + 1e-3 * np.abs(np.arange(200) % 100 - 50)[:, None]
    loop.context.sent = JointCommand(way[0])
    loop.move(MotionOrder(2, Trajectory(way)))
    while loop.ending is None:
        loop.tick()
    assert type(loop.trouble) is error
    assert str(loop.trouble).startswith(message)
    assert not loop.ending.controllable
    assert len(platform.sent) < 110


def test_a_robot_that_is_only_observed_may_give_the_same_sample_for_good(a1):
    loop = RobotLoop(Robot(a1, sound(a1)), a1)
    for _ in range(200):
        loop.tick()
    assert loop.trouble is None


AT_REST = [
    ("the first command would move joint 'FL_hip_joint'", with_one("joint_position", 0, 0.3)),
    ("'FL_calf_joint' is at -2.850 rad", with_one("joint_position", 2, -2.85)),
    ("the robot reports a fault: motor 3 lost", broken),
    (
        "the accelerometer reads 13.7 m/s2",
        lambda state: replace(state, acceleration_in_imu=state.acceleration_in_imu * 1.4),
    ),
    ("the base leans by 90 deg", lambda state: replace(state, acceleration_in_imu=np.array([9.81, 0.0, 0.0]))),
]


@pytest.mark.parametrize("first", range(len(AT_REST)), ids=lambda first: AT_REST[first][0])
def test_a_robot_with_a_fault_is_not_taken_over(a1, first):
    stance = nominal_stance(a1)
    state, target = at_rest(a1), stance.joint_position
    for message, change in reversed(AT_REST[first:]):
        state = change(state)
        if "first command" not in message:
            target = state.joint_position
    platform = Robot(a1, lambda count: state)
    loop = RobotLoop(platform, a1, AT_ONCE)
    loop.move(MotionOrder(1, Trajectory(target[None])))
    run(loop)
    assert isinstance(loop.trouble, MotionError)
    assert AT_REST[first][0] in str(loop.trouble)
    assert loop.context is None
    assert (platform.sent, platform.closed, loop.ending.done) == ([], 1, ["released"])


# --- between motions


def test_between_motions_the_last_command_is_repeated_without_its_velocity(a1):
    platform = Robot(a1, lambda count: replace(at_rest(a1, count), received=time.monotonic()))
    loop = commanded(platform, a1)
    home = nominal_stance(a1).joint_position
    loop.move(MotionOrder(2, Trajectory(np.repeat(home[None], 2, axis=0), velocity=np.full((2, 12), 0.5))))
    assert [loop.tick().motion for _ in range(4)] == [2, 2, 0, 0]
    assert loop.motion is None
    assert [command.velocity is None for command in platform.sent] == [False, False, True, True]
    assert all(np.array_equal(command.position, home) for command in platform.sent)


def test_a_motion_that_is_stopped_ends_where_it_is(a1):
    platform = Robot(a1, lambda count: replace(at_rest(a1, count), received=time.monotonic()))
    loop = commanded(platform, a1)
    home = nominal_stance(a1).joint_position
    loop.move(MotionOrder(2, Trajectory(home + 1e-3 * np.arange(100)[:, None])))
    loop.context.sent = JointCommand(home)
    for _ in range(5):
        loop.tick()
    loop.stop_motion()
    loop.tick()
    assert loop.motion is None
    assert np.array_equal(platform.sent[-1].position, home + 4e-3)


def test_a_motion_stopped_in_its_soft_start_leaves_the_next_one_its_number(a1):
    loop = RobotLoop(Robot(a1, sound(a1)), a1)
    home = nominal_stance(a1).joint_position
    loop.move(MotionOrder(1, Trajectory(home[None])))
    for _ in range(20):
        loop.tick()
    loop.stop_motion()
    loop.move(MotionOrder(2, Trajectory(home[None])))
    assert loop.tick().motion == 2


# --- time


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(robot_loop, "time", clock)
    return clock


def at_clock(robot, clock, step=PERIOD):
    """States of a robot on which a control period takes a time [s]."""

    def state(count):
        clock.sleep(step)
        return replace(at_rest(robot, count), received=clock.monotonic())

    return state


def test_a_robot_that_was_left_alone_is_lowered_from_where_it_is_now(a1, clock):
    """It is sensed again first: it may have sunk, and then it is not pulled up."""
    asleep = []

    def state(count):
        clock.sleep(PERIOD)
        lies = {"joint_position": at_rest(a1).joint_position + 0.35} if asleep else {}
        return replace(at_rest(a1, count, **lies), time=clock.monotonic(), received=clock.monotonic())

    platform = Robot(a1, state)
    loop = commanded(platform, a1)
    loop.tick()
    asleep.append(clock.sleep(5.0))
    sent = len(platform.sent)
    loop.tick()
    assert (type(loop.trouble), loop.trouble.exit_code) == (StoppedError, 4)
    assert "no command was sent for 500" in str(loop.trouble)
    assert len(platform.sent) == sent
    run(loop)
    assert loop.ending.done == ["damped", "released"]
    assert all(map(is_damped, platform.sent[sent:]))


def test_commands_that_fail_at_once_do_not_use_up_the_ending(a1, clock, monkeypatch):
    """The bus may come back: for as long as a robot takes to sink, damping commands are tried."""
    tried = []
    monkeypatch.setattr(footing, "_SUNK", 4.0)

    def fail(count):
        tried.append(clock.monotonic())
        raise CommunicationError("the network is unreachable")

    platform = Robot(a1, at_clock(a1, clock))
    loop = commanded(platform, a1)
    loop.tick()
    platform.act = fail
    run(loop)
    assert tried[-1] - tried[0] == pytest.approx(4.05, abs=0.1)
    assert loop.ending.done == [f"damping commands were sent; {NOT_CONFIRMED}", "released"]
    assert str(loop.trouble) == "the network is unreachable"


def test_a_bus_that_fails_while_a_robot_is_damped_confirms_nothing(a1):
    """The last samples before showed a robot at rest."""
    platform = Robot(a1, sound(a1))
    loop = commanded(platform, a1)
    loop.end(FallError("it falls"), controllable=False)
    for _ in range(300):
        loop.tick()

    def fail(count):
        raise CommunicationError("the cable is out")

    platform.act = fail
    run(loop)
    assert loop.ending.done == [f"damping commands were sent; {NOT_CONFIRMED}", "released"]


# --- requests, and other programs


@pytest.mark.parametrize(("request_", "done"), [("damp", ["damped"]), ("lie down", ["lowered", "damped"])])
@pytest.mark.parametrize("hot", [False, True])
def test_the_remote_control_is_obeyed_also_while_a_hot_motor_is_lowered(a1, request_, done, hot):
    def state(count):
        health = Health(motor_temperature=np.full(12, 90.0)) if hot else None
        return at_rest(a1, count, health=health, request=request_ if count == 40 else "")

    platform = Robot(a1, state, follows=True)
    loop = commanded(platform, a1, AT_ONCE)
    for _ in range(40):
        loop.tick()
    assert (type(loop.trouble), loop.trouble.exit_code) == (StoppedError, 12 if hot else 13)
    assert is_damped(loop._upcoming) == (request_ == "damp")
    run(loop)
    action = "damp" if request_ == "damp" else "lower"
    stopped = f"lowered, stopped: the run ended because the remote control asked to {action} the robot"
    expected = [stopped, "damped"] if hot and request_ == "damp" else done
    assert loop.ending.done == [*expected, "released"]


def test_nothing_is_sent_against_another_program(a1):
    def noticed(count):
        if count == 10:
            raise MotionError("another program commands the robot", other_commander=True)

    platform = Robot(a1, sound(a1), noticed)
    loop = commanded(platform, a1)
    run(loop)
    assert len(platform.sent) == 10
    assert (loop.ending.done, platform.closed) == (["left to the other program", "released"], 1)


# --- the ending


@pytest.mark.parametrize("error", [MotionError("frozen"), MotionError("too fast"), ValueError("a defect of ours")])
def test_an_error_while_the_robot_is_lowered_damps_it(a1, error):
    errors = [error]

    def fail(count):
        if count == 60 and errors:
            raise errors.pop()

    platform = Robot(a1, sound(a1), follows=True)
    loop = commanded(platform, a1)
    loop.tick()
    platform.act = fail
    loop.end(None)
    run(loop)
    assert loop.trouble is error
    assert loop.ending.done == [f"lowered, stopped: {error}", "damped", "released"]
    assert all(map(is_damped, platform.sent[60:]))


@pytest.mark.parametrize("error", [ArithmeticError, KeyboardInterrupt])
def test_an_ending_that_cannot_be_computed_damps_the_robot(a1, monkeypatch, error):
    def fail(*given):
        raise error("no lying posture")

    platform = Robot(a1, sound(a1), follows=True)
    loop = commanded(platform, a1)
    loop.tick()
    monkeypatch.setattr("equipoise.guard.endings.lying_posture", fail)
    with pytest.raises(error) if error is KeyboardInterrupt else contextlib.nullcontext():
        loop.end(None)
    run(loop)
    assert loop.ending.done == ["lowered, stopped: no lying posture", "damped", "released"]
    assert is_damped(platform.sent[-1])


def test_a_motor_that_stays_hot_is_lowered_all_the_same(a1):
    platform = Robot(a1, lambda count: at_rest(a1, count, health=Health(battery_charge=0.05)), follows=True)
    loop = commanded(platform, a1)
    run(loop)
    assert (type(loop.trouble), loop.trouble.exit_code) == (StoppedError, 12)
    assert loop.ending.done == ["lowered", "damped", "released"]
