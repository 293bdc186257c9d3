"""Algorithms 1 and 2 on the simulated robot."""

import numpy as np
import pytest

from equipoise import ComSearchSettings, RobotDescription, load_robot, nominal_stance, simulate
from equipoise.errors import MotionError, ReachError, SettingsError
from equipoise.experiments.stand import stand_up
from equipoise.experiments.tilt import tilt_of
from equipoise.paper.bracket import Bracket
from equipoise.paper.com_search import find_com, find_support_vector
from equipoise.paper.lift_trial import lift_trial, read_lift_trial
from equipoise.paper.trial_runner import TrialRunner, shifted_feet

DIAGONALS = ("FL_RR", "FR_RL")


def runner_on(simulation, robot, **settings):
    stance = nominal_stance(robot)
    standing, _ = stand_up(simulation.platform, robot, stance)
    recordings = []
    standing.keep = recordings.append
    return TrialRunner(standing, stance, ComSearchSettings(**settings)), recordings


@pytest.fixture(scope="module")
def trials(a1):
    """Lift trials on both diagonals with the line clearly behind or ahead of the CoM; ideal preset."""
    stance = nominal_stance(a1)
    found = {}
    with simulate(a1, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1)
        for diagonal in DIAGONALS:
            for offset in (-0.05, 0.03):
                feet = shifted_feet(stance, offset)
                recording = lift_trial(runner.standing, diagonal, offset, feet, runner.settings.lift(stance))
                found[diagonal, offset] = read_lift_trial(a1, recording, stance.joint_position)
        return found, simulation.truth


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_a_line_behind_the_com_tips_the_robot_forward_and_one_ahead_backward(trials, diagonal):
    found, _ = trials
    assert found[diagonal, -0.05].tilt.verdict == "forward"
    assert found[diagonal, 0.03].tilt.verdict == "backward"


def test_the_tilt_is_about_the_line_and_hardly_across_it(trials):
    found, _ = trials
    for trial in found.values():
        assert trial.tilt.across_line < 0.3 * abs(trial.tilt.about_line)


def test_the_measured_plane_is_on_the_side_of_the_com_to_which_the_robot_tips(trials):
    found, truth = trials
    for trial in found.values():
        distance = trial.plane.distance_to(truth.composite.com)
        assert np.sign(distance) == (1 if trial.tilt.verdict == "forward" else -1)


def test_the_verdict_depends_on_the_recording_alone(trials, a1):
    for trial in trials[0].values():
        assert tilt_of(a1, trial.recording, trial.recording.trial) == trial.tilt


def test_a_trial_goes_through_its_phases_in_order(trials):
    for trial in trials[0].values():
        names = [event.data["name"] for event in trial.recording.events if event.name == "phase"]
        assert names == ["replant", "move", "settle", "rest", "unload", "lift", "watch", "lower"]


@pytest.mark.parametrize("tolerance", [0.02, 0.005])
def test_the_last_bounds_are_within_the_tolerance_and_hold_the_balance(a1, tolerance):
    with simulate(a1, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1, tolerance=tolerance)
        bracket, lifts = find_support_vector(runner, "FL_RR", 0.06, -0.06)
        lower, upper = bracket.lower, bracket.upper
        assert 0 <= upper - lower <= tolerance
        forward = [lift.trial.offset for lift in lifts if lift.tilt.verdict == "forward"]
        backward = [lift.trial.offset for lift in lifts if lift.tilt.verdict == "backward"]
        assert max(forward) == lower
        assert min(backward) == upper
        assert lower <= bracket.middle <= upper
    # The line is 0.9 mm off without the correction of the tipping onset, a quarter of the width in the bracket's middle.
    assert abs(bracket.plane.distance_to(simulation.truth.composite.com)) < 0.4e-3


def test_halvings_follow_the_bracket(a1):
    with simulate(a1, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1, tolerance=0.005)
        _, lifts = find_support_vector(runner, "FR_RL", 0.06, -0.06)
    offsets = list(dict.fromkeys(lift.trial.offset for lift in lifts))
    assert len(offsets) <= 6  # 120 mm to 5 mm takes five, as the paper's Fig. 3 shows about six
    assert offsets[0] == 0


def test_a_bracket_that_misses_the_balance_is_widened_once(a1):
    with simulate(a1, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1, tolerance=0.01)
        bracket, lifts = find_support_vector(runner, "FL_RR", 0.06, 0.005)
    assert -0.05 < bracket.middle < 0.005
    assert any(lift.trial.offset == 0.005 for lift in lifts)  # the end was tried before widening


def test_a_com_beyond_the_widened_bracket_is_an_error_that_carries_the_trials(a1):
    with simulate(a1, "ideal") as simulation:
        runner, recordings = runner_on(simulation, a1, tolerance=0.01)
        with pytest.raises(MotionError, match=r"on FL_RR the robot tips the same way at every support line") as caught:
            find_support_vector(runner, "FL_RR", 0.08, 0.06)
    assert "behind all of them" in str(caught.value)
    assert len(caught.value.recordings) == len(recordings) >= 3
    assert caught.value.exit_code == 4


def test_a_wrong_imu_yaw_is_detected_from_tilts_at_both_ends(a1):
    turned = load_robot("unitree_a1", RobotDescription(imu_rpy=(0.0, 0.0, np.pi)))
    with simulate(turned, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1, tolerance=0.02)
        with pytest.raises(MotionError, match="the orientation of the IMU is wrong"):
            find_com(runner)


def test_an_imu_mounted_upside_down_is_detected_before_a_foot_lifts(a1):
    turned = load_robot("unitree_a1", RobotDescription(imu_rpy=(np.pi, 0.0, 0.0)))
    with simulate(turned, "ideal") as simulation:
        runner, recordings = runner_on(simulation, a1)
        with pytest.raises(Exception, match=r"leans by 180 deg .* imu_rpy") as caught:
            find_com(runner)
    assert caught.value.exit_code == 4
    assert not recordings


def test_bounds_the_wrong_way_round_raise_an_error():
    with pytest.raises(SettingsError, match="wrong way round"):
        ComSearchSettings(lower=0.01, upper=-0.01)


def test_a_tolerance_wider_than_the_bracket_raises_an_error(a1):
    with simulate(a1, "ideal") as simulation:
        runner, _ = runner_on(simulation, a1, tolerance=0.5)
        with pytest.raises(SettingsError, match="tolerance"):
            find_com(runner)


def test_bounds_out_of_reach_raise_an_error_before_the_robot_moves(a1):
    with simulate(a1, "ideal") as simulation:
        runner, recordings = runner_on(simulation, a1, lower=-0.5, upper=0.5)
        with pytest.raises(ReachError, match="foot misses its place"):
            find_com(runner)
    assert not recordings


def test_a_lift_grows_only_when_no_tilt_is_measured(a1):
    grown, offsets = 0, np.linspace(-0.012, -0.002, 6)
    with simulate(a1, "ideal") as simulation:
        # A quarter of a second is too short to tip far near the balance (at -7 to -6 mm), and long enough beyond.
        for offset in offsets:
            runner, _ = runner_on(simulation, a1, lift_height=0.0035, t_thres=0.25)
            lifts = []
            start = Bracket(-0.06, 0.06, 0.005, runner.heights[-1])
            verdict = runner.tilt_at("FL_RR", float(offset), start, lifts).verdict
            heights = [lift.trial.lift_height for lift in lifts]
            assert heights == pytest.approx(runner.heights[: len(heights)])
            assert all(lift.tilt.verdict == "balanced" for lift in lifts[:-1])
            assert verdict == lifts[-1].tilt.verdict
            assert verdict != "balanced" or len(lifts) == 3
            grown += len(lifts) > 1
    assert 0 < grown < len(offsets)
