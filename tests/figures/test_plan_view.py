"""Contents of the plan view."""

import dataclasses

import numpy as np
import pytest

from equipoise.experiments.tilt import SupportPlane
from equipoise.figures.plan_view import PlanLine, _ellipse, lift_planes, plan_view
from equipoise.robot.model import DIAGONALS


@pytest.fixture(scope="module")
def bayesian(bayesian_run):
    return bayesian_run.result.with_truth(bayesian_run.truth)


@pytest.fixture(scope="module")
def paper(paper_result):
    return paper_result


def test_the_ellipse_holds_95_percent():
    covariance = np.array([[2.0, 1.2], [1.2, 1.5]])
    outline, information = _ellipse(np.array([0.3, -0.2]), covariance) - [0.3, -0.2], np.linalg.inv(covariance)
    level = np.einsum("ni,ij,nj->n", outline, information, outline)
    np.testing.assert_allclose(level, level[0])
    points = np.random.default_rng(1).multivariate_normal([0, 0], covariance, 40_000)
    inside = np.einsum("ni,ij,nj->n", points, information, points) <= level[0]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.005)


def test_a_cut_lies_in_its_plane():
    normal = np.array([0.8, 0.5, 0.3]) / np.linalg.norm([0.8, 0.5, 0.3])
    plane = SupportPlane(np.array([0.01, -0.02, -0.3]), normal)
    line = PlanLine.cut("FL_RR", plane, 0.02)
    for x, y in [line.point, *line.piece(np.array([0.3, -0.1]), 0.2)]:
        assert plane.distance_to(np.array([x, y, 0.02])) == pytest.approx(0, abs=1e-12)


def test_a_piece_of_a_line_is_around_its_point_nearest_to_a_place():
    line = PlanLine("FL_RR", np.array([1.0, 1.0]), np.array([0.6, 0.8]))
    place = np.array([2.0, 0.0])
    start, end = line.piece(place, 0.5)
    assert (start - place) @ line.direction == pytest.approx(-0.5)
    assert (end - place) @ line.direction == pytest.approx(0.5)
    np.testing.assert_allclose((start + end) / 2, line.nearest_to(place))


def test_the_planes_of_the_lifts_pass_near_the_com(bayesian):
    lifts = lift_planes(bayesian)
    assert len(lifts) == sum(motion.lift is not None for motion in bayesian.evidence.posterior.motions)
    com = bayesian.composite.com_in_base.values
    assert np.median([abs(lift.plane.distance_to(com)) for lift in lifts]) < 3e-3


def test_the_papers_lifts_have_their_verdicts(paper):
    view = plan_view({"a1": paper})
    trials = [trial for trial in paper.trials if trial.kind == "lift"]
    assert [(line.diagonal, line.verdict) for line in view.lifts] == [(trial.about, trial.verdict) for trial in trials]
    assert view.balanced
    for line in view.support_lines:
        np.testing.assert_allclose(line.nearest_to(view.found[0].position), view.found[0].position, atol=1e-9)


def test_a_method_that_finds_no_lines_has_those_through_the_feet(bayesian):
    view = plan_view({"a1": bayesian})
    assert not view.balanced
    at = view.feet
    for line in view.support_lines:
        for leg in DIAGONALS[line.diagonal]:
            np.testing.assert_allclose(line.nearest_to(at[leg]), at[leg], atol=1e-12)


def test_an_error_of_many_centimetres_stays_in_the_close_up(paper):
    composite = paper.truth.composite
    far = dataclasses.replace(composite, com=composite.com + [0.09, 0.02, 0.0])
    view = plan_view({"a1": paper.with_truth(dataclasses.replace(paper.truth, composite=far))})
    for mark in view.marks:
        assert np.abs(mark.position - view.centre).max() < view.half_width


def test_of_several_results_only_the_coms_are_compared(bayesian, paper):
    view = plan_view({"before": bayesian, "after": paper})
    assert [(mark.kind, mark.label) for mark in view.marks] == [("found", "before"), ("found", "after")]
    assert [mark.ellipse is None for mark in view.marks] == [False, True]
    assert view.lifts == ()
