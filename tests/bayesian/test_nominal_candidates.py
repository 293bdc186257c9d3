"""Cache of the candidates of a plan."""

import dataclasses

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.planning import nominal
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.errors import ReachError
from equipoise.estimator.unknowns import Priors
from equipoise.robot.inertial import composite_parameters
from equipoise.user_cache import VARIABLE


def cached(robot, priors=None, swings=False):
    """Return the candidates as a new process would."""
    nominal.nominal_candidates.cache_clear()
    return nominal.nominal_candidates(robot, priors or Priors(), swings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, a1):
    """Cache folder with the A1's candidates."""
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("kept") / "cache"
        patch.setenv(VARIABLE, str(path))
        cached(a1)
        yield path


@pytest.fixture
def forbidden(monkeypatch):
    """Make every computation raise ReachError."""

    def refuse(*_, **__):
        raise ReachError("computed again")

    monkeypatch.setattr(Candidates, "of", refuse)


def test_cached_candidates_give_a_plan(a1, folder, forbidden):
    found = cached(a1)
    plan = make_plan(found, 120.0)
    stance = nominal_stance(a1)
    np.testing.assert_array_equal(found.predictor.com, composite_parameters(a1, stance.joint_position).com)
    assert plan.lifts > 15
    assert len(list(folder.iterdir())) == 1


def test_cached_candidates_equal_computed_ones(a1, folder):
    (file,) = folder.iterdir()
    stance = nominal_stance(a1)
    computed = Candidates.of(a1, stance, composite_parameters(a1, stance.joint_position).com, Priors())
    found = cached(a1)
    assert (found.lifts, found.postures, found.left_out) == (computed.lifts, computed.postures, computed.left_out)
    for row, expected in zip(found.rows, computed.rows, strict=True):
        np.testing.assert_array_equal(row, expected)
    assert file.stat().st_size < 4e6


def test_other_robots_priors_and_configurations_are_not_cached(a1, folder, forbidden):
    heavier = a1.with_base(a1.pinocchio.inertias[1] + a1.pinocchio.inertias[2])
    stronger = dataclasses.replace(a1, description=dataclasses.replace(a1.description, kp=77.0))
    for robot, priors in ((heavier, None), (stronger, None), (a1, Priors(joint_offset=0.03))):
        with pytest.raises(ReachError, match="computed again"):
            cached(robot, priors)
    with pytest.raises(ReachError, match="computed again"):
        cached(a1, swings=True)


def test_other_code_invalidates_the_cache(a1, folder, forbidden, monkeypatch):
    monkeypatch.setattr(nominal, "_code", lambda: "other")
    with pytest.raises(ReachError, match="computed again"):
        cached(a1)


@pytest.mark.parametrize(
    "damage", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: data[:-40] + bytes(40)]
)
def test_a_damaged_file_is_computed_and_written_again(a1, folder, monkeypatch, damage):
    (file,) = folder.iterdir()
    whole, good = file.read_bytes(), cached(a1)
    file.write_bytes(damage(whole))
    computed = []
    monkeypatch.setattr(Candidates, "of", lambda *_, **__: computed.append(1) or good)
    cached(a1)
    assert computed == [1]
    assert file.read_bytes() == whole
