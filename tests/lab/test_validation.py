"""Lifts played again in simulation."""

import json
from dataclasses import replace

import numpy as np
import pytest
from robots import load_text

from equipoise.calibration.run_folder import RunFolder
from equipoise.cli import main
from equipoise.errors import NotEstimatedError, SettingsError
from equipoise.lab.replay.in_mujoco import MujocoReplay
from equipoise.lab.replay.replayed_motion import TwoFootMotion
from equipoise.lab.replay.validation import validate
from equipoise.result.body import Body
from equipoise.result.held_out import FOUND, MODEL
from equipoise.robot.inertial import InertialParameters, base_parameters
from equipoise.robot.stance import nominal_stance

STEP, SAMPLES = 0.01, 25


def still(robot):
    """A robot with two legs bent more that moves no joint, a little off its balance."""
    position = np.tile(nominal_stance(robot).joint_position, (SAMPLES, 1))
    for leg in ("FR", "RL"):
        position[:, robot.legs[leg].joints] *= 1.2
    up = np.array([0.03, 0.02, 1.0]) / np.linalg.norm([0.03, 0.02, 1.0])
    return TwoFootMotion((0, 3), STEP, position, np.zeros_like(position), up, np.array([0.0, 0.05, 0.0]))


def tilt(robot, base=None):
    """(n, 3) what the base turns by [rad], roughly."""
    return STEP * np.cumsum(MujocoReplay(robot, base).play(still(robot)).angular_velocity_base_in_base, axis=0)


@pytest.fixture(scope="module")
def played(precise_run):
    return validate(precise_run.result)


@pytest.fixture(scope="module")
def run(a1, precise_run, tmp_path_factory):
    """The folder of that run."""
    with RunFolder.create(tmp_path_factory.mktemp("runs") / "run", a1, precise_run.settings, {}) as folder:
        for recording in precise_run.recordings:
            folder.keep(recording)
    return folder.path


def test_the_body_found_tips_as_the_robot_did_and_the_model_files_does_not(played):
    assert played.ratio(MODEL) > 7
    assert 1000 * played.error(FOUND) < 1
    assert "the body found is nearer the robot's" in played.message
    assert max(played.joint_errors.values()) < 2e-3


def test_the_truth_is_hardly_told_from_what_was_found(precise_run):
    """Both tip as the robot did, to what the legs of the file are off; the file's body does not."""
    result, truth = precise_run.result, precise_run.truth.composite
    true = replace(result, composite=Body.known(truth, np.eye(10), np.ones(10), result.nominal.composite))
    played = validate(result, {"truth": true})
    assert 1000 * played.error("truth") < 1.5
    assert played.error("truth") < played.error(MODEL) / 4


def test_an_own_base_put_in_again_changes_nothing(skewed):
    """With links fixed to it, an arm among them, and a frame that is not the CoM's."""
    np.testing.assert_allclose(tilt(skewed, base_parameters(skewed)), tilt(skewed), atol=1e-6)


def test_it_tips_the_way_its_mass_is_moved(a1):
    base = base_parameters(a1)
    ahead = InertialParameters(base.mass, base.com + [0.03, 0, 0], base.inertia)
    assert tilt(a1, ahead)[-1, 1] > tilt(a1)[-1, 1] + 0.01


def test_joints_between_samples_are_a_cubic():
    time = 0.1 * np.arange(6)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 3.0, 4.0])
    motion = TwoFootMotion((0, 3), 0.1, cubic(time)[:, None], cubic.deriv()(time)[:, None], np.ones(3), np.zeros(3))
    between = np.linspace(0, 0.5, 23)
    position, velocity = motion.joints_at(between)
    np.testing.assert_allclose(position[:, 0], cubic(between), atol=1e-12)
    np.testing.assert_allclose(velocity[:, 0], cubic.deriv()(between), atol=1e-11)


def test_other_bodies_are_played_beside_them(a1, precise_run):
    played = validate(precise_run.result, {"again": precise_run.result, "file": a1})
    assert played.error("again") == played.error(FOUND)
    assert played.error("file") == played.error(MODEL)
    assert played.to_dict()["bodies"]["file"]["ratio"] == played.ratio(MODEL)


def test_other_robots_are_refused(a1, a1_urdf, precise_run, tmp_path):
    other = load_text(tmp_path, a1_urdf.replace("FL_calf_joint", "FL_shank_joint"))
    with pytest.raises(SettingsError, match="--against other: its leg joints are not those of 'unitree_a1': FL_calf"):
        validate(precise_run.result, {"other": other})
    moved = replace(precise_run.result, model={**precise_run.result.model, "sha256": "0"})
    with pytest.raises(SettingsError, match="--against run: it is of 'unitree_a1', by another model file"):
        validate(precise_run.result, {"run": moved})


def test_a_result_without_recordings_is_refused(precise_run):
    with pytest.raises(NotEstimatedError, match="has no lift to play again; validate takes runs and logs in which"):
        validate(replace(precise_run.result, evidence=None))


def test_the_verb_writes_numbers_and_page_into_the_run(run, played, capsys):
    assert main(["lab", "validate", str(run), "--against", "unitree_a1"]) == 0
    assert f"unitree_a1: {len(played.lifts)} lifts played again" in " ".join(capsys.readouterr().out.split())
    table = json.loads((run / "validation.json").read_text(encoding="utf-8"))
    assert table["bodies"]["unitree_a1"] == table["bodies"][MODEL]
    assert f"{len(played.lifts)} lifts replayed" in (run / "validation.html").read_text(encoding="utf-8")
