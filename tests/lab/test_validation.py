"""Validation by replay of lifts in simulation."""

import json
from dataclasses import replace

import numpy as np
import pytest
from robots import load_text

from equipoise.calibration.run_folder import RunFolder
from equipoise.cli import main
from equipoise.errors import NotEstimatedError, SettingsError
from equipoise.estimator.measurements.tilt_invariant import SensedLift
from equipoise.lab.replay.in_mujoco import MujocoReplay
from equipoise.lab.replay.validation import validate
from equipoise.result.body import Body
from equipoise.result.held_out import FOUND, MODEL
from equipoise.robot.inertial import InertialParameters, base_parameters
from equipoise.robot.stance import nominal_stance

STEP, SAMPLES = 0.01, 25


def motion(robot):
    """Return a motion with constant joint positions, two lifted feet and a small tilt from balance."""
    position = np.tile(nominal_stance(robot).joint_position, (SAMPLES, 1))
    for leg in ("FR", "RL"):
        position[:, robot.legs[leg].joints] *= 1.2
    up = np.array([0.03, 0.02, 1.0]) / np.linalg.norm([0.03, 0.02, 1.0])
    turning = np.tile([0.0, 0.05, 0.0], (SAMPLES, 1))
    return SensedLift(position, np.zeros_like(position), np.tile(up, (SAMPLES, 1)), turning, np.zeros((SAMPLES, 3)))


def tilt(robot, base=None):
    """Return the (n, 3) approximate rotation of the base [rad]."""
    return STEP * np.cumsum(MujocoReplay(robot, base).play((0, 3), STEP, motion(robot))[0], axis=0)


@pytest.fixture(scope="module")
def validation(bayesian_run):
    return validate(bayesian_run.result)


@pytest.fixture(scope="module")
def run(a1, bayesian_run, tmp_path_factory):
    with RunFolder.create(tmp_path_factory.mktemp("runs") / "run", a1, bayesian_run.settings, {}) as folder:
        for recording in bayesian_run.recordings:
            folder.keep(recording)
    return folder.path


def test_the_estimated_body_tips_as_the_robot_and_the_model_files_does_not(validation):
    assert validation.ratio(MODEL) > 7
    assert 1000 * validation.error(FOUND) < 1
    assert "the estimated body is closer to the robot's" in validation.message
    assert max(validation.joint_errors.values()) < 2e-3


def test_the_true_body_tips_as_the_robot(bayesian_run):
    """The remaining error is from the model file's legs."""
    result, truth = bayesian_run.result, bayesian_run.truth.composite
    true = replace(result, composite=Body.complete(truth, np.eye(10), np.ones(10), result.nominal.composite))
    validation = validate(result, {"truth": true})
    assert 1000 * validation.error("truth") < 1.5
    assert validation.error("truth") < validation.error(MODEL) / 4


def test_a_base_replaced_by_itself_does_not_change_the_motion(skewed):
    """The base has fixed links, such as an arm, and a frame that is not the CoM's."""
    np.testing.assert_allclose(tilt(skewed, base_parameters(skewed)), tilt(skewed), atol=1e-6)


def test_a_robot_tips_in_the_direction_in_which_its_com_is_shifted(a1):
    base = base_parameters(a1)
    ahead = InertialParameters(base.mass, base.com + [0.03, 0, 0], base.inertia)
    assert tilt(a1, ahead)[-1, 1] > tilt(a1)[-1, 1] + 0.01


def test_other_bodies_are_replayed_as_well(a1, bayesian_run):
    validation = validate(bayesian_run.result, {"again": bayesian_run.result, "file": a1})
    assert validation.error("again") == validation.error(FOUND)
    assert validation.error("file") == validation.error(MODEL)
    assert validation.to_dict()["bodies"]["file"]["ratio"] == validation.ratio(MODEL)


def test_other_robots_raise_an_error(a1, a1_urdf, bayesian_run, tmp_path):
    other = load_text(tmp_path, a1_urdf.replace("FL_calf_joint", "FL_shank_joint"))
    with pytest.raises(SettingsError, match="--against other: its leg joints differ from those of 'unitree_a1': FL"):
        validate(bayesian_run.result, {"other": other})
    moved = replace(bayesian_run.result, model={**bayesian_run.result.model, "sha256": "0"})
    with pytest.raises(SettingsError, match="--against run: it is a result of 'unitree_a1' with another model file"):
        validate(bayesian_run.result, {"run": moved})


def test_a_result_without_recordings_raises_an_error(bayesian_run):
    with pytest.raises(NotEstimatedError, match="has no lift to replay; validate needs a run or log with lifts"):
        validate(replace(bayesian_run.result, evidence=None))


def test_the_verb_writes_numbers_and_page_into_the_run(run, validation, capsys):
    assert main(["lab", "validate", str(run), "--against", "unitree_a1"]) == 0
    assert f"error of {len(validation.lifts)} replayed lifts" in " ".join(capsys.readouterr().out.split())
    table = json.loads((run / "validation.json").read_text(encoding="utf-8"))
    assert table["bodies"]["unitree_a1"] == table["bodies"][MODEL]
    assert f"{len(validation.lifts)} lifts replayed" in (run / "validation.html").read_text(encoding="utf-8")
