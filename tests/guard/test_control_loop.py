"""One control period of a guarded robot: of all that is wrong at once, what is said first."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest

from equipoise import nominal_stance
from equipoise.errors import CommunicationError, MotionError, SensorError
from equipoise.guard.control_loop import ControlLoop
from equipoise.guard.limits import Limits
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand

AT_ONCE = Limits(patience=1e-3)  # less than a control period


class Robot:
    """Answers every command with the same state."""

    accepts, control_period = ACCEPTS_EVERYTHING, PERIOD

    def __init__(self, before, after):
        self._before, self._after, self.sent = before, after, []

    def read(self):
        return self._before

    def step(self, command):
        self.sent.append(command)
        return self._after


def with_one(name, joint, value):
    """A change of one joint's number in a state or a command."""

    def change(whole):
        values = np.array(getattr(whole, name))
        values[joint] = value
        return replace(whole, **{name: values})

    return change


IN_MOTION = [
    ("says what is no number", with_one("joint_velocity", 0, np.nan)),
    ("'FL_calf_joint' is at 0.500 rad; its limits are", with_one("joint_position", 2, 0.5)),
    ("'FR_thigh_joint' turns at -30.0 rad/s", with_one("joint_velocity", 4, -30.0)),
    ("'FL_thigh_joint' is 1.28 rad from where it was sent", with_one("joint_position", 1, 2.0)),
    ("'RR_calf_joint' gives 45.0 Nm; its limit is", with_one("joint_torque", 11, 45.0)),
    ("the motor of joint 'RR_hip_joint' gives 30.0 Nm where", with_one("joint_torque", 9, 30.0)),
    ("the robot says: motor 3 lost", lambda state: replace(state, health=Health(fault="motor 3 lost"))),
    ("the base leans by 90 deg", lambda state: replace(state, acceleration_in_imu=np.array([9.81, 0.0, 0.0]))),
]


@pytest.mark.parametrize("first", range(len(IN_MOTION)), ids=lambda first: IN_MOTION[first][0])
def test_of_all_that_is_wrong_in_motion_one_thing_is_said_first(a1, first):
    stance = nominal_stance(a1)
    state = at_rest(a1, 500)
    for _, change in IN_MOTION[first:]:
        state = change(state)
    loop = ControlLoop(Robot(at_rest(a1), state), a1, stance, AT_ONCE)
    hold = JointCommand(stance.joint_position)
    loop.take_over(loop.read(), hold)
    with pytest.raises(MotionError) as caught:
        loop.step(hold)
    assert IN_MOTION[first][0] in str(caught.value)
    assert not loop.known_after(None).well


def test_a_command_that_is_refused_is_not_sent_and_says_nothing_of_the_robot(a1):
    stance = nominal_stance(a1)
    robot = Robot(at_rest(a1), at_rest(a1, 1))
    loop = ControlLoop(robot, a1, stance, Limits())
    hold = JointCommand(stance.joint_position)
    loop.take_over(loop.read(), hold)
    with pytest.raises(MotionError, match="was sent a jump of"):
        loop.step(JointCommand(stance.joint_position + 0.3))
    assert robot.sent == []
    assert loop.known_after(None).well


@pytest.mark.parametrize(
    ("moves", "error", "message"),
    [
        (lambda index: {"time": 0.0}, CommunicationError, "no sample has arrived for 10"),
        (lambda index: {"imu_time": 0.0}, CommunicationError, "no sample of the IMU has arrived for 10"),
        (lambda index: {"angular_velocity_in_imu": np.zeros(3)}, SensorError, "the IMU is frozen"),
    ],
)
def test_who_reads_before_every_step_is_told_as_anybody(a1, moves, error, message):
    stance = nominal_stance(a1)
    states = [at_rest(a1, index, **moves(index)) for index in range(200)]
    robot = Robot(states[0], states[0])
    loop = ControlLoop(robot, a1, stance, Limits())
    hold = JointCommand(stance.joint_position)
    loop.take_over(loop.read(), hold)

    def run():
        for index, state in enumerate(states):
            robot._before = robot._after = state
            loop.read()
            loop.step(replace(hold, position=stance.joint_position + 1e-3 * (index % 100)))

    with pytest.raises(error, match=message):
        run()
    assert len(robot.sent) < 110


def test_no_time_passes_for_who_reads_again_and_again(a1):
    stance = nominal_stance(a1)
    loop = ControlLoop(Robot(at_rest(a1), at_rest(a1, 1)), a1, stance, Limits())
    hold = JointCommand(stance.joint_position)
    loop.take_over(loop.read(), hold)
    for _ in range(200):
        loop.read()
    loop.step(hold)


AT_REST = [
    ("the first command would move joint 'FL_hip_joint'", with_one("joint_position", 0, 0.3)),
    ("'FL_calf_joint' is at -2.850 rad", with_one("joint_position", 2, -2.85)),
    ("the robot says: motor 3 lost", lambda state: replace(state, health=Health(fault="motor 3 lost"))),
    (
        "the accelerometer reads 13.7 m/s2",
        lambda state: replace(state, acceleration_in_imu=state.acceleration_in_imu * 1.4),
    ),
    ("the base leans by 90 deg", lambda state: replace(state, acceleration_in_imu=np.array([9.81, 0.0, 0.0]))),
]


@pytest.mark.parametrize("first", range(len(AT_REST)), ids=lambda first: AT_REST[first][0])
def test_of_all_that_is_wrong_before_anything_moves_one_thing_is_said_first(a1, first):
    stance = nominal_stance(a1)
    state, command = at_rest(a1), JointCommand(stance.joint_position)
    for message, change in reversed(AT_REST[first:]):
        state = change(state)
        if "first command" not in message:
            command = JointCommand(state.joint_position)
    robot = Robot(state, state)
    loop = ControlLoop(robot, a1, stance, AT_ONCE)
    with pytest.raises(MotionError) as caught:
        loop.take_over(loop.read(), command)
    assert AT_REST[first][0] in str(caught.value)
    assert loop.known is None
    assert robot.sent == []
