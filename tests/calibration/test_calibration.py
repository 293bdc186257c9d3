"""Calibration routine on simulated robots."""

import dataclasses

import numpy as np
import pytest

from equipoise import (
    ComSearchSettings,
    ExcitationSettings,
    PaperMethod,
    RobotDescription,
    calibrate,
    estimate,
    load_robot,
    simulate,
)
from equipoise.errors import MissingDependencyError, MotionError, RecordingError, SettingsError
from equipoise.method.table import method_named
from equipoise.robot.inertial import composite_parameters

PAPER = PaperMethod()
QUICK = PaperMethod(com_search=ComSearchSettings(tolerance=0.02), excitation=ExcitationSettings(duration=1.0))


def planar_error_mm(result):
    return 1000 * float(np.hypot(*result.composite.com_in_base.errors[:2]))


@pytest.fixture(scope="module")
def ideal(a1):
    recordings = []
    with simulate(a1, "ideal", timestep=0.5e-3) as simulation:
        result = calibrate(simulation.platform, a1, PAPER, keep=recordings.append).with_truth(simulation.truth)
    return result, recordings


@pytest.fixture(scope="module")
def realistic(a1):
    """Run with realistic sensors and seed 5."""
    with simulate(a1, "realistic", seed=5) as simulation:
        return calibrate(simulation.platform, a1, QUICK).with_truth(simulation.truth)


def test_the_com_of_an_a1_is_found_within_five_millimetres_in_at_most_six_halvings(ideal):
    result, _ = ideal
    assert planar_error_mm(result) < 5
    for diagonal in ("FL_RR", "FR_RL"):
        assert len({trial.offset for trial in result.trials if trial.about == diagonal}) <= 6


def test_a_finer_tolerance_finds_it_within_two_millimetres(a1):
    settings = PaperMethod(com_search=ComSearchSettings(tolerance=0.001), excitation=ExcitationSettings(duration=1.0))
    with simulate(a1, "ideal") as simulation:
        result = calibrate(simulation.platform, a1, settings).with_truth(simulation.truth)
    assert np.abs(result.composite.com_in_base.errors[:2]).max() < 2e-3


def test_moments_are_of_the_size_of_the_truths(ideal):
    for errors in ideal[0].moment_errors().values():
        assert abs(errors["against_stance_effective"]) < 0.4
    assert all(excitation.damping > 0 for excitation in ideal[0].excitations.values())


def test_parameters_outside_the_paper_are_none(ideal):
    result, _ = ideal
    assert result.composite.mass.value is None
    assert all(quantity.value is None for quantity in result.composite.inertia)
    assert result.composite.com_in_base.z.value is None
    assert result.base.mass.value is None


def test_repeated_estimates_are_equal(ideal, a1):
    result, recordings = ideal
    again = estimate(a1, recordings, PAPER).with_truth(result.truth)
    assert again.to_dict() == result.to_dict()


def test_a_payload_moves_the_estimate_as_it_moves_the_truth(ideal, a1):
    with simulate(a1, "ideal", payload="1.5,0.12,-0.06,0.05") as simulation:
        loaded = calibrate(simulation.platform, a1, PAPER).with_truth(simulation.truth)
    assert planar_error_mm(loaded) < 5
    moved = (loaded.composite.values - ideal[0].composite.values)[1:3]
    truly = (loaded.truth.composite.com - ideal[0].truth.composite.com)[:2]
    assert np.linalg.norm(truly) > 0.01
    assert moved == pytest.approx(truly, abs=5e-3)


def test_realistic_sensors_do_not_stop_the_routine(realistic):
    assert planar_error_mm(realistic) < 15


def test_a_seed_gives_the_same_result_and_another_seed_another(a1, realistic):
    found = []
    for seed in (5, 4):
        with simulate(a1, "realistic", seed=seed) as simulation:
            found.append(calibrate(simulation.platform, a1, QUICK).composite.com_in_base.values)
    first = realistic.composite.com_in_base.values
    assert np.array_equal(found[0], first, equal_nan=True)
    assert not np.array_equal(found[1], first, equal_nan=True)


def test_a_lying_robot_lies_again_at_the_end(a1):
    with simulate(a1, "ideal", start="lying") as simulation:
        before = simulation.platform.read().joint_position
        result = calibrate(simulation.platform, a1, QUICK).with_truth(simulation.truth)
        after = simulation.platform.read().joint_position
    assert np.abs(after - before).max() < 0.25
    assert planar_error_mm(result) < 15


def test_an_interrupted_run_is_estimated_from_complete_recordings(ideal, a1):
    result, recordings = ideal
    broken = recordings[-1].between(0, recordings[-1].joints.time[50])
    partial = estimate(a1, [*recordings[:-1], broken], PAPER)
    assert partial.composite.to_dict() == result.composite.to_dict()
    assert partial.excitations["yaw"].moment is None
    assert partial.excitations["yaw"].note == "not recorded"


def test_a_run_without_a_complete_search_is_rejected(ideal, a1):
    with pytest.raises(RecordingError, match="no complete search on FR_RL"):
        estimate(a1, [recording for recording in ideal[1] if recording.trial.about != "FR_RL"], PAPER)


def test_both_readings_of_the_feet_come_from_the_same_trials(ideal, a1):
    commanded = estimate(a1, ideal[1], PaperMethod(feet="commanded"))
    read, found = commanded.composite.com_in_base.values[:2], ideal[0].composite.com_in_base.values[:2]
    assert read == pytest.approx(found, abs=5e-3)
    assert (read != found).any()


def test_a_search_that_did_not_converge_is_rejected(ideal, a1):
    lifts = [recording for recording in ideal[1] if recording.trial.kind == "lift"]
    without_the_last = [recording for recording in lifts if recording is not lifts[4]]
    with pytest.raises(RecordingError, match="no complete search on FL_RR"):
        estimate(a1, without_the_last, PAPER)


def test_an_excitation_without_a_fit_does_not_affect_the_com(ideal, a1):
    result, recordings = ideal
    roll = next(r for r in recordings if r.trial.about == "roll")
    start = roll.phase("excitation").joints.time[0]
    broken = type(roll).concatenate([roll.between(0, start + 0.01), roll.phase("end")])
    again = estimate(a1, [broken if recording is roll else recording for recording in recordings], PAPER)
    assert again.composite.to_dict() == result.composite.to_dict()
    assert again.excitations["roll"].moment is None
    assert "needs at least 8" in again.excitations["roll"].note


def test_feet_that_do_not_rise_are_not_balanced(a1):
    stuck = load_robot("unitree_a1", RobotDescription(kd=1e9))
    with simulate(stuck, "ideal") as simulation, pytest.raises(MotionError):
        calibrate(simulation.platform, stuck, QUICK)


def test_a_payload_seen_by_the_torques_is_reported(a1, realistic):
    with simulate(a1, "ideal", payload="4,0.05,0,0.05") as simulation:
        heavy = calibrate(simulation.platform, a1, QUICK)
    assert heavy.warnings[0].startswith("the joint torques give a mass of about 16.")
    assert not realistic.warnings


def test_lifts_grow_to_a_bound(a1):
    settings = PaperMethod(com_search=ComSearchSettings(tolerance=1e-4), excitation=ExcitationSettings(duration=1.0))
    with simulate(a1, "realistic", seed=1) as simulation:
        result = calibrate(simulation.platform, a1, settings)
    heights = [trial.lift_height for trial in result.trials if trial.kind == "lift"]
    assert max(heights) <= 1.6**2 * heights[0] * 1.001


def test_unknown_settings_are_rejected():
    with pytest.raises(SettingsError, match="method 'magic' is unknown"):
        method_named("magic")
    with pytest.raises(SettingsError, match="'measured' or 'commanded'"):
        PaperMethod(feet="guessed")


def test_progress_names_the_trial_and_the_bracket(a1):
    progresses = []
    with simulate(a1, "ideal") as simulation:
        calibrate(simulation.platform, a1, QUICK, report=progresses.append)
    assert progresses[0].doing.startswith("lift on FL_RR: offset +0.0 mm, bracket -61.5 to +61.5 mm")
    *_, roll, pitch, yaw, last = (progress.doing for progress in progresses)
    assert [roll, pitch, yaw, last] == [
        "excitation about roll",
        "excitation about pitch",
        "excitation about yaw",
        "estimating",
    ]
    assert all(progress.done < progress.expected for progress in progresses)


def test_progress_counts_repeated_lifts(a1):
    """The robot is balanced in the middle of these bounds on the first diagonal."""
    progresses, bounds = [], ComSearchSettings(lower=-0.0666, upper=0.0534)
    with simulate(a1, "ideal") as simulation:
        result = calibrate(
            simulation.platform, a1, dataclasses.replace(QUICK, com_search=bounds), report=progresses.append
        )
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    assert len(lifts) > sum(progress.doing.startswith("lift") for progress in progresses)
    done = [progress.done for progress in progresses]
    assert done == sorted(set(done))
    assert done[-1] == len(result.trials)
    assert all(progress.done < progress.expected for progress in progresses)


def calibrated_unattended(name, recwarn):
    try:
        robot = load_robot(name)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    with simulate(robot, "ideal") as simulation:
        result = calibrate(simulation.platform, robot, QUICK).with_truth(simulation.truth)
    recwarn.clear()
    # Half the tolerance is the bracket's; the rest scales with the robot.
    assert planar_error_mm(result) < (10 / 0.58 + 5) * max(1.0, robot.leg_length / 0.4)
    nominal = composite_parameters(robot, np.array(list(result.joint_position.values())))
    assert nominal.com == pytest.approx(result.truth.composite.com, abs=1e-9)
    return result


# One robot of each shape: size and knees. The results page `robots` has all robots.
@pytest.mark.parametrize("name", ["go2", "b1", "anymal_c", "hyq", "solo12", "mini_cheetah"])
def test_robots_of_the_catalogue_are_calibrated_unattended(name, recwarn):
    calibrated_unattended(name, recwarn)


def test_unreachable_excitation_axes_are_skipped_with_the_reason(recwarn):
    result = calibrated_unattended("solo8", recwarn)
    for axis in ("roll", "yaw"):
        assert result.excitations[axis].moment is None
        assert "not possible with all feet on the floor" in result.excitations[axis].note
    assert result.excitations["pitch"].moment > 0
