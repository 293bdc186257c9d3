"""Logs of a robot that trots: detection of steps, estimates, and errors."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_logs import columns_of, estimated, shifted, write_csv
from scipy.spatial.transform import Rotation

from equipoise import BayesianMethod, load_robot, nominal_stance, simulate
from equipoise.cli import main
from equipoise.errors import MotionError, RecordingError, SettingsError
from equipoise.estimator.diagnostics import prior_conflict
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import StepSamples
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.measurements.walking import MARGIN, gyro_bias_of_walks, up_between_steps
from equipoise.estimator.problem import MapProblem
from equipoise.estimator.solve import solve
from equipoise.lab.gaits.trot import trot
from equipoise.logs.joint_names import JointMap
from equipoise.logs.motions import gyroscope
from equipoise.logs.motions.gyroscope import compare_gyroscope
from equipoise.logs.motions.segments import find_segments
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import Log
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.recording.trials import Step, WalkTrial, read_trial
from equipoise.report.contents import run_contents
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import components
from equipoise.robot.model import DIAGONALS

PAYLOAD = "1.2,0.06,0.02,0.08"
DURATION = 11.0  # [s]


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture(scope="module")
def trotted(a1):
    """Log of a trotting robot, and its true parameters."""
    with simulate(a1, "realistic", PAYLOAD, seed=7) as simulation:
        return SimpleNamespace(log=trot(simulation.platform, a1, DURATION), truth=simulation.truth.composite)


@pytest.fixture(scope="module")
def found(a1, trotted):
    return estimated(a1, trotted)


def test_the_steps_of_a_trot_are_on_both_diagonals_in_turn(a1, stance, trotted):
    walks = [one.recording.trial for one in find_segments(a1, stance, trotted.log) if one.kind == "walk"]
    steps = [step for walk in walks for step in walk.steps]
    assert {step.pair for step in steps} == {*DIAGONALS}
    assert len(steps) > 25  # of 33
    assert np.mean([one.pair != other.pair for one, other in itertools.pairwise(steps)]) > 0.7
    assert all(0.09 < step.end - step.start < 0.3 for step in steps)


def test_a_walk_after_a_long_rest_determines_the_clock_offset(a1, stance, trotted, monkeypatch):
    """The log is read piece by piece; a piece of 8 s ends before this robot walks."""
    monkeypatch.setattr(gyroscope, "_PIECE", 800)
    first = trotted.log.joints.time[0]
    kept = {"commands": None, "events": ()}
    walk = replace(trotted.log, joints=shifted(trotted.log.joints, 10.0), imu=shifted(trotted.log.imu, 10.03), **kept)
    time = first + np.arange(0.0, 9.9, 0.002)
    rest = replace(
        walk,
        joints=JointStream(time, np.tile(stance.joint_position, (len(time), 1)), np.zeros((len(time), 12)), None),
        imu=ImuStream(time, np.zeros((len(time), 3)), np.tile([0.0, 0.0, 9.81], (len(time), 1))),
    )
    walk = replace(walk, joints=replace(walk.joints, torque=None))
    found = compare_gyroscope(a1, stance, Recording.concatenate([rest, walk]))
    assert found.agrees
    assert found.motion == "steps"
    assert found.offset == pytest.approx(compare_gyroscope(a1, stance, trotted.log).offset - 0.03, abs=3e-3)


def steps_in(a1, stance, recording):
    walks = [one.recording.trial for one in find_segments(a1, stance, recording) if one.kind == "walk"]
    return [step for walk in walks for step in walk.steps]


def test_torques_leave_the_steps_of_a_trot_as_they_are(a1, stance, trotted):
    joints = replace(trotted.log.joints, torque=None)
    assert steps_in(a1, stance, trotted.log) == steps_in(a1, stance, replace(trotted.log, joints=joints))


def test_a_foot_that_seems_up_and_carries_is_a_step_less(a1, stance, trotted):
    """The torques of FL in one swing are made those of its stance."""
    steps, joints = steps_in(a1, stance, trotted.log), trotted.log.joints
    dragged = next(step for step in steps[10:] if step.pair == "FR_RL")
    stood = next(step for step in steps if step.pair == "FL_RR")
    own, torque = list(a1.legs["FL"].joints), np.array(joints.torque)
    standing = torque[(joints.time > stood.start) & (joints.time < stood.end)][:, own].mean(axis=0)
    for joint, carried in zip(own, standing, strict=True):
        torque[(joints.time > dragged.start - 0.02) & (joints.time < dragged.end + 0.02), joint] = carried
    dragging = replace(trotted.log, joints=replace(joints, torque=torque))
    assert steps_in(a1, stance, dragging) == [step for step in steps if step != dragged]


def test_a_walk_determines_the_com(trotted, found):
    true, whole = components(trotted.truth), found.result.composite
    assert found.result.trustworthy, [check for check in found.result.checks if not check.passed]
    errors, model = np.abs(whole.values - true), np.abs([one.model for one in whole] - true)
    assert (errors[1:4] < (0.005, 0.004, 0.012)).all()
    assert (errors[1:4] < model[1:4]).sum() >= 2  # the file does not know the payload
    assert sum(one.lower <= value <= one.upper for one, value in zip(whole, true, strict=True)) >= 9
    assert {one.verdict for one in [*whole][:3]} == {"identified"}


@pytest.mark.parametrize("seed", range(3))
def test_the_estimate_does_not_depend_on_the_start(a1, stance, found, seed):
    """Starts whose CoMs are up to a centimetre and whose root moments are up to a fifth off the file's."""
    before = found.result.evidence.posterior
    motions, weighed = before.motions, before.problem.mass
    problem = MapProblem(a1, stance, motions, before.unknowns.priors, weighed, lifts_needed=False)
    start = problem.unknowns.start()
    start[:10] += np.random.default_rng(seed).uniform(-0.2, 0.2, 10) * ([1.0] * 4 + [0.1] * 6)
    x, converged = solve(problem, start, 2)
    assert converged
    apart = components(problem.unknowns.robot_body(x)) - components(before.robot_body)
    assert np.abs(apart / np.sqrt(np.diag(before.robot_covariance))).max() < 0.2


@pytest.fixture(scope="module")
def elsewhere():
    """Return an A1 whose model file has its IMU in another place."""
    return load_robot("unitree_a1", RobotDescription(imu_position=(0.08, 0.0, 0.0)))


@pytest.fixture(scope="module")
def first_steps(trotted):
    """Return the first 6 s of the log, whose estimate takes half the time."""
    return trotted.log.between(-np.inf, trotted.log.joints.time[0] + 6.0)


def test_a_walk_widens_priors_only_where_unseen_steps_are_predicted_as_well(
    elsewhere, trotted, first_steps, monkeypatch
):
    def contradicts():
        return any(
            one.startswith("the run contradicts the model file")
            for one in estimated(elsewhere, trotted, first_steps).result.assumptions
        )

    assert contradicts()
    monkeypatch.setattr(prior_conflict, "_WORSE", 0.0)
    assert not contradicts()


def test_rows_of_a_step_are_means_of_the_terms(a1, found):
    posterior = found.result.evidence.posterior
    (step, *_) = (sample for motion in posterior.motions for sample in motion.of(StepSamples))
    at_readings = np.eye(len(step.joint_position))
    each = replace(step, average=None, step=step.reading_step, acceleration_noise=at_readings)
    values, inertial = posterior.unknowns.values(posterior.x), posterior.unknowns.inertial(posterior.x)
    rows, terms = (TiltInvariant(a1, LegChains(a1), [one]).evaluate(values, inertial)[0] for one in (step, each))
    assert len(rows) == step.rows < len(terms)
    assert step.average.sum(axis=1) == pytest.approx(1.0)
    assert rows == pytest.approx(step.average @ terms, abs=1e-12)


def test_a_walk_widens_priors_only_of_parameters_that_are_contradicted_on_their_own(
    elsewhere, trotted, first_steps, monkeypatch
):
    """Leg lengths in error made the position of the IMU suspect, and a wide prior raised it by 0.1 m."""
    conflict = prior_conflict._conflict

    def hardly_on_its_own(posterior, rows):
        return 1.5 if len(rows) == 1 else conflict(posterior, rows)

    monkeypatch.setattr(prior_conflict, "_conflict", hardly_on_its_own)
    assumptions = " ".join(estimated(elsewhere, trotted, first_steps).result.assumptions)
    assert "the run contradicts the model file" not in assumptions


def test_every_walk_states_that_the_height_of_the_imu_is_assumed(found):
    assert "hardly determines it, and an error of 10 mm changes Ixx by" in " ".join(found.result.assumptions)


def test_limitations_of_a_walk_are_reported(found):
    limitations = " ".join(found.report.limitations)
    assert "does not separate joint offsets and the IMU's mounting" in limitations
    assert "Record lifts, or stance motions from rest to rest." in limitations


def test_steps_are_predicted_without_their_walk(found):
    predicted = found.result.held_out
    assert {lift.kind for lift in predicted.lifts} == {"step"}
    assert predicted.folds == sum(trial.kind == "walk" for trial in found.result.trials) > 3
    assert predicted.inside("this run") > 0.9 * len(predicted.lifts)
    assert predicted.error("this run") < predicted.error("model file")


def test_the_page_shows_steps(found):
    sections = run_contents(found.result).sections
    assert "Held-out steps" in sections
    names = [trace["name"] for figure in sections["Residuals"] for trace in figure.data]
    assert names == ["walk (its worst step)"]


def test_a_walk_needs_no_rest(a1, trotted):
    log = trotted.log.between(2.0, np.inf)
    imu = replace(log.imu, angular_velocity_in_imu=log.imu.angular_velocity_in_imu + (0.02, -0.01, 0.0))
    result = estimated(a1, trotted, replace(log, imu=imu)).result
    assert not any(trial.kind == "stand" for trial in result.trials)
    errors = np.abs(result.composite.values - components(trotted.truth))
    assert (errors[1:4] < (0.006, 0.005, 0.015)).all()


def test_clocks_are_compared_over_steps(a1, trotted):
    late = replace(trotted.log, imu=shifted(trotted.log.imu, 0.04))
    (finding,) = [one for one in estimated(a1, trotted, late).report.findings if one.about == "clocks"]
    assert "of steps; the estimate corrects them" in finding.message
    assert 36 <= float(finding.message.split(" ms late")[0].split()[-1]) <= 46


@pytest.mark.parametrize("late", [0.7, 1.2])
def test_clocks_that_are_more_than_a_step_apart_are_not_taken_for_the_next_steps(a1, stance, trotted, late):
    found = compare_gyroscope(a1, stance, replace(trotted.log, imu=shifted(trotted.log.imu, late)))
    assert found.offset == pytest.approx(-late, abs=5e-3)


@pytest.mark.parametrize("turn", [(0, 0, 90), (0, 0, 180), (180, 0, 0), (90, 0, 0)])
def test_an_imu_that_is_mounted_turned_is_named(a1, stance, trotted, turn):
    """The robot never rests, or too seldom to detect it there."""
    mounting, imu = Rotation.from_euler("xyz", turn, degrees=True), trotted.log.imu
    sensed = {
        name: mounting.inv().apply(np.array(getattr(imu, name)))
        for name in ("angular_velocity_in_imu", "acceleration_in_imu")
    }
    angles = "roll {}, pitch {}, yaw {} deg".format(*turn)
    message = f"in steps the gyroscope differs from .* by {angles} relative to the base; set imu_rpy"
    with pytest.raises(MotionError, match=message):
        compare_gyroscope(a1, stance, replace(trotted.log, imu=replace(imu, **sensed)))


@pytest.mark.parametrize(("factor", "message"), [(180 / np.pi, "degrees per second"), (-1.0, "wrong sign")])
def test_a_gyroscope_with_a_wrong_unit_or_sign_is_named(a1, trotted, factor, message):
    turned = replace(trotted.log.imu, angular_velocity_in_imu=factor * trotted.log.imu.angular_velocity_in_imu)
    with pytest.raises((RecordingError, RecordingError), match=message):
        estimated(a1, trotted, replace(trotted.log, imu=turned))


def test_degrees_per_second_are_named_where_steps_are_found_by_chance(a1, stance):
    """The wrong vertical of this walk has three long steps; an offset of the clocks moves them out of the log."""
    with simulate(a1, "realistic", seed=9) as simulation:
        walk = trot(simulation.platform, a1, 6.0)
    assert compare_gyroscope(a1, stance, walk).agrees
    turned = replace(walk.imu, angular_velocity_in_imu=np.degrees(walk.imu.angular_velocity_in_imu))
    message = r'\(is it in degrees per second\?\)\. For a table in deg/s, write units.gyro = "deg/s" into a file'
    with pytest.raises(RecordingError, match=message):
        compare_gyroscope(a1, stance, replace(walk, imu=turned))


def test_offsets_that_leave_few_steps_are_not_compared():
    turning = np.random.default_rng(0).standard_normal((100, 3))
    assert gyroscope._unexplained(turning, turning, np.arange(100) < 51) == pytest.approx(0.0)
    assert gyroscope._unexplained(turning, turning, np.arange(100) < 49) == 1.0


def test_the_command_reads_a_walk(a1, trotted, tmp_path, capsys):
    file = write_csv(tmp_path / "trot.csv", columns_of(trotted.log))
    assert main(["estimate", str(file), "--robot", "unitree_a1", "--mass", "13.6"]) == 0
    shown = capsys.readouterr().out
    assert "walking steps" in shown
    assert "0 lifts" not in shown


def test_a_walk_is_written_and_read():
    trial = WalkTrial(steps=(Step(("FL", "RR"), 1.0, 1.2), Step(("FL", "RL"), 1.3, 1.5)), heading=0.5, found_at=1.0)
    assert read_trial(trial.to_data()) == trial
    with pytest.raises(RecordingError, match="are not two or three legs"):
        read_trial({**trial.to_data(), "steps": [{"standing": ["RR", "FL"], "start": 0, "end": 1}]})
    with pytest.raises(RecordingError, match="are not two or three legs"):
        read_trial({**trial.to_data(), "steps": [{"standing": ["FL"], "start": 0, "end": 1}]})
    with pytest.raises(RecordingError, match="a walk has steps on 2 feet"):
        read_trial({**trial.to_data(), "steps": [{"standing": ["FL", "FR", "RL"], "start": 0, "end": 1}]})


def swaying(bias=(0.0, 0.0, 0.0), seconds=20.0):
    """An IMU that rolls to and fro and turns slowly, pushed forward and back."""
    time = np.arange(round(seconds * 100)) / 100
    roll, rate = 0.1 * np.sin(4 * time), 0.4 * np.cos(4 * time)
    turning = 0.3
    up = np.column_stack([0 * time, np.sin(roll), np.cos(roll)])
    gyro = np.column_stack([rate, turning * np.sin(roll), turning * np.cos(roll)]) + bias
    push = np.column_stack([2 * np.sin(12 * time), 0 * time, 0 * time])
    return ImuStream(time, gyro, 9.81 * up + push), up, turning


def test_up_is_the_mean_specific_force():
    imu, up, turning = swaying()
    found, turned = up_between_steps(imu.time, imu.angular_velocity_in_imu, imu.acceleration_in_imu, 0.5)
    assert np.abs(found - up)[150:-150].max() < 0.01
    np.testing.assert_allclose(turned, turning * imu.time, atol=0.02)


def test_slow_accelerations_hardly_tilt_the_vertical_that_steps_are_read_with():
    time = np.arange(0, 30, 0.005)
    force = np.column_stack([0.2 * np.sin(2 * np.pi * time / 7), 0 * time, 9.81 + 0 * time])
    tilts = []
    for reach in (0.5, MARGIN / 2):
        up, _ = up_between_steps(time, np.zeros((len(time), 3)), force, reach)
        tilts.append(np.abs(up[1000:-1000, 0]).max())
    assert tilts[0] > 0.8 * 0.2 / 9.81
    assert tilts[1] < 0.3 * 0.2 / 9.81


def test_the_bias_rotates_gravity():
    bias = np.array([0.02, -0.015, 0.01])
    imu, _, _ = swaying(bias)
    found = gyro_bias_of_walks([(imu.time, imu.angular_velocity_in_imu, imu.acceleration_in_imu)])
    assert np.abs(found - bias)[:2].max() < 2e-3


def test_another_robots_mass_is_refused(a1, trotted):
    with pytest.raises(SettingsError, match="does not match the model file"):
        estimate_log(a1, Log(trotted.log, JointMap(()), {}, ()), BayesianMethod(mass=200.0))
