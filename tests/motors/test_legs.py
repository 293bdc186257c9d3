"""Estimation of leg links from swings of a simulated robot whose legs differ from the file."""

import dataclasses
from copy import copy

import numpy as np
import pytest

from equipoise import BayesianMethod, nominal_stance, simulate
from equipoise.calibration.routine import perform
from equipoise.estimator.equations.equation import LEFT_OUT
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.motors.equations import motor_samples
from equipoise.estimator.motors.fit import fit_motors, fit_swings
from equipoise.estimator.motors.legs import legs_in_swing
from equipoise.method.combined import CombinedMethod, base_recordings
from equipoise.motors.method import Motors
from equipoise.recording.trials import MotorTrial
from equipoise.robot.links import link_names

HEAVY = {"leg_mass_common": 0.15, "leg_com_common": 4e-3, "cable": 0.0}


@pytest.fixture(scope="module")
def run(a1):
    """Recordings, truth and settings of a short run for base, legs and motors."""
    with simulate(a1, "realistic", seed=5, effects=HEAVY) as simulation:
        mass = simulation.truth.composite.mass
        both = CombinedMethod(
            BayesianMethod(duration=45.0, mass=mass, cable="none", swings=True, excitation=False),
            Motors(motor_time=5.0),
        )
        kept = perform(simulation.platform, a1, both).recordings
        return kept, simulation.truth, simulation.truth_of_parts, both


@pytest.fixture(scope="module")
def on_three_feet(a1):
    """Recordings of the same robot swinging one leg after the other."""
    with simulate(a1, "realistic", seed=5, effects=HEAVY) as simulation:
        return perform(simulation.platform, a1, Motors(motor_time=20.0, motor_stance="three-feet")).recordings


@pytest.mark.parametrize("lying", [True, False], ids=["lying", "on three feet"])
def test_only_the_true_legs_fit(a1, run, on_three_feet, lying):
    kept, _, parts, _ = run
    swings = [one for one in kept if isinstance(one.trial, MotorTrial)] if lying else on_three_feet
    scale = nominal_stance(a1).scale
    samples = motor_samples(a1, swings, scale.time)
    found, target = legs_in_swing(fit_motors(a1, samples, scale))
    names, factors, moments = link_names(a1.full_pinocchio), [], []
    for joint in [joint for leg in a1.legs.values() for joint in leg.joint_names]:
        true = parts["links"][names[a1.full_pinocchio.getJointId(joint)]]
        body = a1.pinocchio.inertias[a1.pinocchio.getJointId(joint)]
        factors.append(true["mass"] / body.mass)
        moments.append([true[f"moment_{axis}"] for axis in "xyz"] - true["mass"] * body.lever)
    by_the_file = np.concatenate([np.ones(len(factors)), np.zeros(3 * len(factors))])

    def normalized_residual(links):
        """Root mean square residual, with the gains that fit best: they go with the links."""
        rows, left = found[:, len(links) :], target - found[:, : len(links)] @ links
        gains = np.linalg.solve(rows.T @ rows + np.eye(rows.shape[1]) / 0.03**2, rows.T @ left)
        return np.sqrt(np.mean((left - rows @ gains) ** 2))

    true = normalized_residual(np.concatenate([factors, np.ravel(moments)]))
    assert true < 1.0
    assert normalized_residual(by_the_file) > 1.15 * true


def test_swings_improve_the_legs_estimate(a1, run):
    kept, truth, parts, both = run
    lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
    alone, together = (
        method.estimate(a1, recordings, nominal_stance(a1)).with_truth(truth).with_truth_of_parts(parts)
        for method, recordings in ((both.base, lifts), (both, kept))
    )
    for leg in a1.legs:
        less, more = alone.links[f"{leg}_calf"].moment_z, together.links[f"{leg}_calf"].moment_z
        assert more.std < 0.5 * less.std
        assert abs(more.error) < 3 * more.std
    less, more = (next(one for one in of.composite if one.name == "com_z") for of in (alone, together))
    assert more.std < 0.95 * less.std
    assert abs(more.error) < 3 * more.std
    assert [trial.kind for trial in together.trials].count(MotorTrial.kind) == 1
    assert any("swing in the air" in source.name for source in together.uncertainty_budget)


def test_the_plan_predicts_the_swings_standard_deviations_of_legs(a1, run):
    kept, _, _, both = run
    stance = nominal_stance(a1)
    swings = both.motors.predicted_recordings(a1, stance), (kept[-1],)
    links = 4 * len(a1.joint_names)

    def stds(rows):
        prior = np.repeat([0.1, 0.02, 0.03], [links // 4, 3 * links // 4, rows.shape[1] - links])
        return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows + np.diag(prior**-2))))

    predicted, actual = (stds(legs_in_swing(fit_swings(a1, stance, swing))[0]) for swing in swings)
    assert (actual / predicted > 1 / 1.3).all()
    assert (actual / predicted < 1.3).all()
    plan, lifts = both.forecast(a1, stance), both.base.forecast(a1, stance)
    assert plan.visits == lifts.visits
    assert (plan.std <= lifts.std).all()
    assert plan.links["FL_calf"].moment_x.std < 0.5 * lifts.links["FL_calf"].moment_x.std
    alone = CombinedMethod(both.base.having({"swings": False}), both.motors)
    assert (alone.forecast(a1, stance).std == alone.base.forecast(a1, stance).std).all()


def test_an_interrupted_swing_affects_only_the_motors(a1, run):
    kept, _, _, both = run
    lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
    found = both.estimate(a1, lifts, nominal_stance(a1))
    assert not found.motors
    assert found.composite.mass.value == both.base.estimate(a1, lifts, nominal_stance(a1)).composite.mass.value
    assert any("no complete swing" in warning and "--resume" in warning for warning in found.warnings)


def test_compare_ignores_swings(run):
    kept, _, _, _ = run
    assert [one.trial for one in base_recordings(kept)] == [one.trial for one in kept[:-1]]


def test_a_joint_that_never_slides_does_not_stop_the_fit(a1, run):
    kept, _, _, _ = run
    scale = nominal_stance(a1).scale
    samples = motor_samples(a1, [kept[-1]], scale.time)
    slides = samples.slides.copy()
    slides[:, 4] = 0.0
    stuck = dataclasses.replace(samples, slides=slides)
    fit = fit_motors(a1, stuck, scale)
    assert np.isfinite(fit.values).all()
    assert np.isfinite(legs_in_swing(fit)[0]).all()


def test_noise_of_stance_motions_has_a_lower_limit(a1, run):
    kept, _, _, both = run
    lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
    posterior = both.base.estimate(a1, lifts, nominal_stance(a1)).evidence.posterior
    moves = posterior.problem.equation(StanceMotions)
    allowed = moves.scale / moves._noise_factor
    loose = np.zeros_like(posterior.covariance)  # no degrees of freedom are subtracted
    quiet = moves.at_residual_noise(posterior.x, loose)
    assert (quiet.scale <= allowed).all()
    assert (quiet.scale >= 0.3 * allowed - 1e-12).all()
    for again in (quiet.at_residual_noise(posterior.x), moves.at_residual_noise(posterior.x)):
        assert (again.scale >= 0.3 * allowed - 1e-12).all()
    assert moves.at_residual_noise(posterior.x, 1e6 * np.eye(len(posterior.x))).scale == pytest.approx(moves.scale)
    partly = copy(moves)
    partly.scale = np.where(np.arange(len(moves.scale)) == 0, LEFT_OUT, moves.scale)
    assert [one.used for one in partly.at_residual_noise(posterior.x, loose).normalized_residuals(posterior.x)][:2] == [
        False,
        True,
    ]


def test_without_leg_parameters_swings_do_not_change_the_base(a1, run):
    kept, _, _, both = run
    lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
    base = both.base.having({"swings": False})
    together = CombinedMethod(base, both.motors).estimate(a1, kept, nominal_stance(a1))
    alone = base.estimate(a1, lifts, nominal_stance(a1))
    assert [one.value for one in together.composite] == [one.value for one in alone.composite]
