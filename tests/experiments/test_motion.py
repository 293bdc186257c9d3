"""Motions under construction."""

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.errors import ReachError
from equipoise.experiments.motion import Motion, Target
from equipoise.platform.ramp import smooth_step
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.statics import static_torques

PERIOD = 2e-3


@pytest.fixture
def motion(a1):
    return Motion(a1, PERIOD, Target.standing(a1, nominal_stance(a1).joint_position))


def test_feet_move_on_straight_lines_between_knots(a1, motion):
    start = motion.target.feet_in_base
    end = start + np.array([0.05, 0.02, 0.03])
    trajectory = motion.move_feet(end, 0.6).build()
    feet = np.array([foot_positions(a1, position) for position in trajectory.position])
    progress = (feet - start) @ (end - start)[0] / np.sum((end - start)[0] ** 2)
    off_line = feet - start - progress[:, :, None] * (end - start)
    assert np.abs(off_line).max() < 20e-6
    assert np.allclose(feet[-1], end, atol=1e-6)


def test_a_motion_begins_and_ends_at_rest(motion):
    position = motion.move_feet(motion.target.feet_in_base + [0.03, 0, 0], 0.5).build().position
    speed = np.abs(np.diff(position, axis=0)).max(axis=1) / PERIOD
    assert speed[0] < 0.01 * speed.max()
    assert speed[-1] < 0.01 * speed.max()


def test_smooth_step_runs_from_zero_to_one_without_overshoot():
    step = smooth_step(100)
    assert step[-1] == 1
    assert (np.diff(step) > 0).all()
    assert step[0] < 1e-4


def test_shifting_the_load_ends_with_the_torques_of_two_legs(a1, motion):
    trajectory = motion.shift_load(("FL", "RR"), 0.2).build()
    assert np.allclose(trajectory.torque[-1], static_torques(a1, trajectory.position[-1], ("FL", "RR")))
    assert np.ptp(trajectory.position, axis=0).max() == 0


def test_a_hold_keeps_the_torques_of_the_standing_legs(a1, motion):
    trajectory = motion.shift_load(("FR", "RL"), 0.1).hold(0.1).shift_load(LEG_NAMES, 0.1).build()
    assert len(trajectory.position) == 150
    assert np.allclose(trajectory.torque[60], trajectory.torque[99])
    assert np.allclose(trajectory.torque[-1], static_torques(a1, trajectory.position[-1], LEG_NAMES))


def test_phases_are_noted_when_they_begin(motion):
    trajectory = motion.phase("one").hold(0.1).phase("two").hold(0.1).build()
    assert [(event.time, event.data["name"]) for event in trajectory.events] == [
        (0, "one"),
        (pytest.approx(0.1), "two"),
    ]


def test_a_foot_out_of_reach_is_rejected_with_leg_and_distance(motion):
    with pytest.raises(ReachError, match=r"the (FL|FR|RL|RR) foot misses its place by \d+\.\d mm"):
        motion.move_feet(motion.target.feet_in_base - [0, 0, 0.2], 1.0)


def test_a_motion_above_a_speed_limit_is_slowed_on_the_same_path(a1, motion):
    up = motion.target.feet_in_base + [0, 0, 0.05]
    usual = motion.move_feet(up, 0.5).build().position
    fast = Motion(a1, PERIOD, Target.standing(a1, nominal_stance(a1).joint_position)).phase("move").move_feet(up, 0.03)
    fast.phase("there")
    position, events = fast.build().position, fast.build().events
    speed = np.abs(np.diff(position, axis=0)).max() / PERIOD
    assert 0.7 * 21 < speed <= 0.8 * 21
    assert events[1].time == pytest.approx(len(position) * PERIOD)
    assert fast.slowed == pytest.approx(len(position) * PERIOD / 0.03)
    np.testing.assert_allclose(position[-1], usual[-1], atol=1e-5)
    farthest = np.abs(position[:, None] - usual[None]).max(axis=2).min(axis=1).max()
    assert farthest < 0.01  # rad: both paths have nearly the same postures


def test_times_within_a_path_that_was_slowed_are_slowed_too(motion):
    begin = motion.hold(0.1).time
    feet = motion.target.feet_in_base
    motion.follow(lambda share: feet + [0, 0, 0.05 * share], 5, smooth_step(15)).phase_at("half", begin + 0.015)
    assert motion.slowed > 1
    (half,) = motion.build().events
    assert half.time == pytest.approx((begin + motion.time) / 2)


def test_a_motion_far_above_a_speed_limit_is_rejected(motion):
    motion.move_feet(motion.target.feet_in_base + [0, 0, 0.1], 0.004)
    with pytest.raises(
        ReachError, match=r"would have to turn at .* rad/s; plans use at most 80% of its limit of 21.00"
    ):
        motion.build()
