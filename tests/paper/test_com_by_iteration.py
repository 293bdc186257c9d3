"""Planar CoM after each halving of the paper's brackets (its Fig. 3)."""

from dataclasses import replace

import numpy as np
import pytest

from equipoise import ComSearchSettings, ExcitationSettings, PaperMethod, calibrate, nominal_stance, simulate
from equipoise.errors import NotEstimatedError
from equipoise.paper.iterations import com_by_iteration
from equipoise.robot.model import DIAGONALS

SETTINGS = PaperMethod(com_search=ComSearchSettings(tolerance=0.004), excitation=ExcitationSettings(duration=1.0))


def calibrated(robot, payload, tolerance=SETTINGS.com_search.tolerance):
    """Return the result of a `realistic` run, its first bracket and the true CoM."""
    settings = replace(SETTINGS, com_search=replace(SETTINGS.com_search, tolerance=tolerance))
    with simulate(robot, "realistic", payload=payload, seed=3) as simulation:
        result = calibrate(simulation.platform, robot, settings)
    return result, settings.com_search.bracket(nominal_stance(robot)), simulation.truth.composite.com


@pytest.fixture(scope="module")
def usual(a1):
    return calibrated(a1, "1,0.05,0.02,0.08")


@pytest.fixture(scope="module")
def widened(a1):
    """Run with the CoM beyond the first bounds, so that the search widens them."""
    return calibrated(a1, "3,0.4,0,0.08")


@pytest.fixture(params=["usual", "widened"])
def run(request):
    return request.getfixturevalue(request.param)


def test_the_last_iteration_is_the_result(run):
    result, start, _ = run
    path = com_by_iteration(result, start)
    assert np.allclose(path[-1], result.composite.com_in_base.values[:2], atol=1e-12)


def test_there_is_a_point_for_each_offset_tried(run):
    result, start, _ = run
    path = com_by_iteration(result, start)
    offsets = {
        about: {trial.offset for trial in result.trials if trial.kind == "lift" and trial.about == about}
        for about in DIAGONALS
    }
    assert len(path) == max(map(len, offsets.values()))
    assert len(path) >= np.ceil(np.log2(start.width / SETTINGS.com_search.tolerance))


def test_the_bracket_halves_at_every_step(usual):
    """The point moves by a quarter, an eighth ... of the bounds, within the errors of feet and sensors."""
    result, start, truth = usual
    path = com_by_iteration(result, start)
    width = start.width
    for index, step in enumerate(np.abs(np.diff(path[:, 0]))):
        assert step <= width / 2 ** (index + 2) + 1.5e-3
    errors = np.linalg.norm(path - truth[:2], axis=1)
    assert errors[-1] < 5e-3
    assert errors[-1] < errors[0]


def test_a_coarser_search_is_the_beginning_of_a_finer_one(a1, usual):
    coarse, start, _ = calibrated(a1, "1,0.05,0.02,0.08", tolerance=0.02)
    short, whole = (com_by_iteration(each, start) for each in (coarse, usual[0]))
    assert len(short) < len(whole)
    assert np.allclose(short[:, 0], whole[: len(short), 0], atol=3e-3)


def test_a_widened_bracket_ends_beyond_the_first_bounds(widened):
    result, start, _ = widened
    path = com_by_iteration(result, start)
    assert path[0, 0] < start.upper < max(path[:, 0])


def test_a_result_without_planes_raises_an_error_that_names_the_run_folder(usual):
    result, start, _ = usual
    with pytest.raises(NotEstimatedError, match="open the run folder"):
        com_by_iteration(replace(result, evidence=None), start)
