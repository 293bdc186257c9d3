"""Causes of a lean, from a short run of a realistic simulated robot that carries a payload."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from equipoise import BayesianMethod
from equipoise.errors import NotEstimatedError
from equipoise.estimator.diagnostics.causes import diagnose
from equipoise.recording.trials import PostureTrial
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_forces_from_torques, foot_positions
from equipoise.robot.statics import static_torques

FAULT = 0.03  # [rad]


@pytest.fixture(scope="module")
def found(bayesian_run):
    return diagnose(bayesian_run.result)


def by_kind(found, kind):
    return [cause for cause in found.causes if cause.kind == kind]


def test_the_payload_comes_first_and_nothing_else_is_significant(found, bayesian_run, a1):
    assert [cause.verdict == "significant" for cause in found.causes] == [True] + [False] * (len(found.causes) - 1)
    payload, com = found.causes[0], bayesian_run.result.composite.com_in_base
    assert payload.name == "payload"
    assert payload.shift == pytest.approx([com.x.change, com.y.change])
    true = bayesian_run.truth.composite.com - composite_parameters(a1, bayesian_run.stance.joint_position).com
    assert np.linalg.norm(payload.shift - true[:2]) < 2 * payload.bound
    assert "'trunk'" in payload.change


def test_causes_have_an_order(found):
    order = ["significant", "possible", "ruled out"]
    keys = [(order.index(cause.verdict), -cause.deviate) for cause in found.causes]
    assert keys == sorted(keys)
    assert {len(by_kind(found, kind)) for kind in ("joint_offset", "torque_gain")} == {12}


def test_a_joint_offset_turns_and_moves_the_base_until_the_feet_fit(found, a1, bayesian_run):
    q = bayesian_run.stance.joint_position
    places, com, small = foot_positions(a1, q), composite_parameters(a1, q).com, 1e-5
    for cause in by_kind(found, "joint_offset"):
        away = small * (np.array(a1.joint_names) == cause.name.partition(" ")[0])
        feet = foot_positions(a1, q - away)
        turn, _ = Rotation.align_vectors(places - places.mean(axis=0), feet - feet.mean(axis=0))
        moved = turn.apply(com - feet.mean(axis=0)) + places.mean(axis=0) - com
        per_offset = 1 / cause.values[0].value
        assert cause.lean * per_offset == pytest.approx(turn.as_rotvec()[:2] / small, abs=2e-3)
        assert cause.shift * per_offset == pytest.approx(moved[:2] / small, abs=2e-3)


def test_a_level_imu_turns_the_robot_by_its_error(found, a1, bayesian_run):
    (cause,) = by_kind(found, "imu_level")
    q = bayesian_run.stance.joint_position
    height = (composite_parameters(a1, q).com - foot_positions(a1, q).mean(axis=0))[2]
    roll, pitch = cause.lean
    assert [quantity.value for quantity in cause.values] == pytest.approx([-roll, -pitch])
    assert cause.shift == pytest.approx([height * pitch, -height * roll])


def test_a_torque_gain_moves_the_centre_of_pressure(found, a1, bayesian_run):
    q = bayesian_run.stance.joint_position
    torques, feet = static_torques(a1, q, a1.legs), foot_positions(a1, q)
    for cause in by_kind(found, "torque_gain"):
        gained = torques * (1 + 0.1 * (np.array(a1.joint_names) == cause.name.partition(" ")[0]))
        extra = foot_forces_from_torques(a1, q, gained)[:, 2] - foot_forces_from_torques(a1, q, torques)[:, 2]
        pressed = -extra @ (feet - feet.mean(axis=0))[:, :2] / (9.81 * a1.mass)
        assert 0.1 * cause.shift / cause.values[0].value == pytest.approx(pressed, abs=1e-6)


@pytest.mark.parametrize("index", [1, 8])
def test_a_faulty_joint_is_found_with_its_whole_offset(bayesian_run, a1, index):
    def misread(recording):
        position = recording.joints.position + FAULT * (np.arange(len(a1.joint_names)) == index)
        return replace(recording, joints=replace(recording.joints, position=position))

    faulty = [misread(recording) for recording in bayesian_run.recordings]
    result = bayesian_run.settings.estimate(a1, faulty, bayesian_run.stance)
    name = a1.joint_names[index]
    cause = next(cause for cause in diagnose(result).causes if cause.name == f"{name} offset")
    before = next(one for one in by_kind(diagnose(bayesian_run.result), "joint_offset") if one.name == cause.name)
    assert cause.verdict == "significant"
    assert before.verdict != "significant"
    assert abs(cause.values[0].value - before.values[0].value - FAULT) < 3 * cause.values[0].std
    # Without the jump, its prior of 5 mrad hides a third of it or more.
    assert result.joints[name].offset.value < 0.7 * cause.values[0].value
    assert f"set {name} to {cause.values[0].value:.4f}" in cause.change


def test_without_lifts_a_payload_is_not_separated_from_the_torque_gain_of_a_calf(bayesian_run, a1):
    moves = [one for one in bayesian_run.recordings if isinstance(one.trial, PostureTrial)]
    found = diagnose(BayesianMethod().estimate(a1, moves, bayesian_run.stance, lifts_needed=False))
    pairs = {frozenset(names) for *names, _ in found.inseparable}
    assert any({"payload", f"{leg}_calf_joint torque gain"} in pairs for leg in ("FL", "FR", "RL", "RR"))
    assert all(0.7 < correlation <= 1 for *_, correlation in found.inseparable)
    assert not any("payload" in names for *names, _ in diagnose(bayesian_run.result).inseparable)


def test_parameters_that_the_user_fixes_are_no_causes(bayesian_run, a1):
    priors = bayesian_run.settings.priors.holding("joint_offset", "imu_tilt", "accelerometer_bias")
    settings = replace(bayesian_run.settings, priors=priors)
    found = diagnose(settings.estimate(a1, bayesian_run.recordings, bayesian_run.stance))
    assert {cause.kind for cause in found.causes} == {"payload", "torque_gain"}


def test_a_result_without_a_posterior_is_refused(paper_result):
    with pytest.raises(NotEstimatedError, match=r"'paper' has no posterior.*--method bayesian"):
        diagnose(paper_result)
