"""Checks of robots in a sling or with feet that are not spheres: they fail and name possible causes."""

from dataclasses import replace

import numpy as np
import pytest

from equipoise import BayesianMethod, calibrate, simulate
from equipoise.estimator.diagnostics import checks
from equipoise.estimator.diagnostics.checks import half_difference
from equipoise.estimator.problem import body_jacobian


def run_with(robot, effect, budget=None):
    with simulate(robot, "realistic", "1,0.03,0.02,0.08", seed=21, effects={effect: None}) as simulation:
        settings = BayesianMethod(duration=budget, mass=simulation.truth.composite.mass)
        return calibrate(simulation.platform, robot, settings).with_truth(simulation.truth)


@pytest.fixture(scope="module")
def in_a_sling(a1):
    return run_with(a1, "sling", budget=60)


def failed(result):
    return {check.name: check.message for check in result.checks if not check.passed}


def test_failed_checks_name_a_safety_sling(in_a_sling):
    messages = failed(in_a_sling)
    assert messages
    assert all("a safety sling, hose or cable carries load" in message for message in messages.values())


@pytest.mark.parametrize("body", ["composite", "base", "stance_effective"])
def test_no_standard_deviation_of_a_failed_run_is_below_the_difference_of_its_halves(in_a_sling, body):
    posterior = in_a_sling.evidence.posterior
    of = {"composite": "robot_body", "base": "base_body"}.get(body, "stance_effective_body")
    body_at = getattr(posterior.unknowns, of)
    jacobian = body_jacobian(posterior.unknowns, posterior.x, body_at)
    difference = np.abs(jacobian @ half_difference(posterior))
    found = getattr(in_a_sling, body)
    assert np.all(found.stds >= difference - 1e-12)
    assert np.allclose(np.sqrt(np.diag(found.covariance)), found.stds)
    assert (difference > 1.5 * np.sqrt(np.diag(posterior.covariance_of(body_at)))).any()
    assert {one.verdict for one in found} <= {"doubtful", "not identified"}


def test_cylindrical_feet_are_found(a1):
    """With spheres as the model the CoM is 13 mm too low, five standard deviations."""
    result = run_with(a1, "foot_width")
    across, along = (next(one for one in result.sensors if one.name.endswith(what)) for what in ("across", "along"))
    assert abs(across.value - 6e-3) < 3 * across.std < 1e-3
    assert abs(along.value) < 3 * along.std
    assert np.abs(result.composite.errors / result.composite.stds).max() < 3


def test_a_negative_backlash_is_a_failed_check_from_three_standard_deviations_on(bayesian_run):
    posterior = bayesian_run.result.evidence.posterior
    column = posterior.unknowns["backlash"].start
    std = np.sqrt(posterior.covariance[column, column])

    def check_at(size):
        x = posterior.x.copy()
        x[column] = size * std
        return checks._physical_parameters(replace(posterior, x=x))

    assert check_at(-2.9).passed
    assert not check_at(-3.1).passed
    assert "(-3.1 standard deviations)" in check_at(-3.1).message
    assert check_at(8.0).passed
