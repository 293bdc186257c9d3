"""Uncertainty budget: the shares of all sources add up to one."""

import json

import numpy as np
import pytest

from equipoise import Calibration
from equipoise.figures.uncertainty_budget import remedies, uncertainty_table
from equipoise.robot.inertial import COMPONENTS
from equipoise.terminal.results import print_budget


def test_shares_are_positive_and_add_up(bayesian_run):
    shares = np.array([source.shares for source in bayesian_run.result.uncertainty_budget])
    assert (shares > -1e-9).all()
    assert shares.sum(axis=0) == pytest.approx(np.ones(10), abs=1e-9)


def test_a_share_is_the_effect_of_an_error_of_the_source(bayesian_run):
    """Compare with estimates in which the prior mean of one parameter at a time is off by one standard deviation."""
    posterior = bayesian_run.result.evidence.posterior
    problem, unknowns = posterior.problem, posterior.unknowns
    names = ("link_length", "link_length_common", "hip_position", "foot_radius", "foot_radius_each")
    equations = problem.normal_equations(posterior.x)
    moved = []
    for column in unknowns.columns(*names):
        gradient = equations.gradient.copy()
        gradient[column] -= 1.0  # of 1/2 (x - 1)^2 in place of 1/2 x^2
        x = posterior.x - np.linalg.solve(equations.information, gradient - equations.gradient)
        moved.append(unknowns.robot_body(x).com - posterior.robot_body.com)
    (source,) = (one for one in bayesian_run.result.uncertainty_budget if one.name.startswith("lengths of the legs"))
    variance = np.diag(posterior.robot_covariance)[1:4]
    assert np.square(moved).sum(axis=0) / variance == pytest.approx(source.shares[1:4], rel=0.05)


def test_it_is_saved_read_and_shown(bayesian_run, tmp_path, capsys):
    result = bayesian_run.result
    result.save(tmp_path / "a1.json")
    again = Calibration.load(tmp_path / "a1.json")
    assert [source.name for source in again.uncertainty_budget] == [source.name for source in result.uncertainty_budget]
    assert again.uncertainty_budget[0].shares == pytest.approx(result.uncertainty_budget[0].shares, abs=1e-4)
    saved = json.loads((tmp_path / "a1.json").read_text(encoding="utf-8"))["uncertainty_budget"]
    assert list(saved[0]["variance_shares"]) == list(COMPONENTS)
    print_budget(again)
    shown = " ".join(capsys.readouterr().out.split())
    assert "masses and CoMs of the legs" in shown
    assert "CoM z [mm]: +- " in shown
    assert len(uncertainty_table(again).rows) == len(result.uncertainty_budget)
    assert len(remedies(again)) == 7


def test_a_method_without_a_budget_prints_this(paper_result, capsys):
    print_budget(paper_result)
    assert "has no uncertainty budget" in capsys.readouterr().out
