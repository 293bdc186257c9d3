"""Stribeck friction, simulated with another law than the estimator's."""

import dataclasses
from copy import copy

import numpy as np
import pytest

from equipoise import Calibration, calibrate, nominal_stance, simulate
from equipoise.estimator.motors.equations import motor_samples
from equipoise.estimator.motors.fit import fit_motors, fit_swings
from equipoise.estimator.motors.legs import legs_in_swing
from equipoise.estimator.motors.stribeck import is_significant
from equipoise.exports.parameters import MOTORS, columns_of
from equipoise.figures.parts import parts_of
from equipoise.motors.method import Motors

pytestmark = pytest.mark.usefixtures("fine_engine")


@pytest.fixture(scope="module")
def swung(a1):
    """Result and recording of an A1 whose joints have 30 % more friction at rest."""
    kept = []
    with simulate(a1, "realistic", seed=5, effects={"stribeck": 0.3}) as simulation:
        result = calibrate(simulation.platform, a1, Motors(motor_time=5.0), keep=kept.append)
        return result.with_truth_of_parts(simulation.truth_of_parts), kept[-1]


def test_stribeck_friction_is_identified_without_bias_of_other_parameters(a1, swung, monkeypatch):
    result, recording = swung
    joints = result.joints.values()
    assert np.mean([one.stribeck_friction.missed for one in joints]) < 0.15
    shares = [one.stribeck_friction.value / one.stribeck_friction.truth for one in joints]
    assert np.mean(shares) == pytest.approx(1.0, abs=0.6)  # 0.9 to 1.8 in other seeds, all intervals hold
    monkeypatch.setattr("equipoise.estimator.motors.fit.is_significant", lambda *_: False)
    fit_swings.cache_clear()
    without = Motors().estimate(a1, [recording], nominal_stance(a1)).joints
    assert without["FL_hip_joint"].stribeck_friction.value is None
    mean = [np.mean([of[name].viscous_friction.value for name in of]) for of in (result.joints, without)]
    truth = np.mean([one.viscous_friction.truth for one in joints])
    assert np.mean([one.viscous_friction.missed for one in joints]) < 0.15
    assert mean[0] == pytest.approx(truth, rel=0.04)  # 0.2 to 3.5 % too low in seeds 3 to 8; without the term 9 to 11 %
    assert mean[1] < 0.94 * truth


def test_robots_without_stribeck_friction_get_none(a1):
    motor = {"coulomb_friction": 0.3, "viscous_friction": 0.05, "armature": 0.01}
    for noise, effects in (("realistic", {}), ("ideal", motor)):
        with simulate(a1, noise, seed=6, effects=effects) as simulation:
            result = calibrate(simulation.platform, a1, Motors(motor_time=5.0))
        assert all(joint.stribeck_friction.value is None for joint in result.joints.values())
        (motors,) = parts_of(result)
        assert "stribeck_friction" not in {one.name for one in motors.columns}


def test_one_joint_suffices_and_noise_does_not():
    """Twelve joints with unit noise, so that normalized amounts are exact."""
    rng = np.random.default_rng(0)
    terms = rng.normal(size=(6, 400, 12))
    design, covariance = np.zeros((400, 12, 1)), np.eye(1)
    noise = rng.normal(size=(400, 12))

    def found(stds):
        left = noise.copy()
        left[:, 4] += stds / 20.0 * terms[2, :, 4]  # 400 averages: the deviation of an amount is a twentieth
        return is_significant(terms, design, left, covariance, 10.0)

    assert not found(0.0)
    assert not found(3.5)
    assert found(10.0)
    assert not found(-10.0)  # friction that falls toward rest is none


def test_a_term_that_another_parameter_explains_is_not_significant():
    """A parameter with the term's column and a narrow or wide prior takes its share of the torque."""
    term = np.ones((400, 1))
    for information, wanted in ((4e6, True), (4.0, False)):
        left = 0.5 * information / (400 + information) * term
        covariance = np.array([[1 / (400 + information)]])
        assert is_significant(term[None], term[..., None], left, covariance, 10.0) == wanted


def test_legs_in_swing_eliminates_stribeck_friction(a1, swung):
    scale = nominal_stance(a1).scale
    samples = motor_samples(a1, [swung[1]], scale.time)
    fit = fit_motors(a1, samples, scale)
    assert fit.problem.stribeck_speed is not None
    assert "stribeck" in fit.problem.terms
    with_it, _ = legs_in_swing(fit)
    kept = copy(fit.problem)
    kept.prior = np.where(np.isin(np.arange(kept.prior.size), np.r_[kept.of("stribeck")]), 0.0, kept.prior)
    without, _ = legs_in_swing(dataclasses.replace(fit, problem=kept))
    assert np.linalg.norm(with_it) < np.linalg.norm(without)


def test_stribeck_friction_is_saved_shown_and_exported(swung, tmp_path):
    result, _ = swung
    result.save(tmp_path / "result.json")
    assert Calibration.load(tmp_path / "result.json").motors == result.motors
    (motors,) = parts_of(result)
    assert "Stribeck [Nm]" in {one.label for one in motors.columns}
    (column,) = (one for one in columns_of(result, MOTORS) if one.name == "stribeck_friction")
    assert column.number("FL_hip_joint") == result.joints["FL_hip_joint"].stribeck_friction.value


@pytest.mark.filterwarnings("error")
def test_a_term_equal_to_a_column_of_the_fit_is_not_significant():
    rng = np.random.default_rng(1)
    term = rng.normal(size=(1, 300, 1))
    covariance = np.array([[(1 + 1e-6) / (term**2).sum()]])
    design = np.moveaxis(term, 0, -1)
    assert not is_significant(term, design, 100 * rng.normal(size=(300, 1)), covariance, prior=np.inf)
