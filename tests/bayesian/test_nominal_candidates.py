"""What is computed once for a model is found again, for that model alone, and computed again if it is damaged."""

import dataclasses

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.planning import nominal as kept
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.errors import ReachError
from equipoise.estimator.unknowns import Priors
from equipoise.robot.inertial import composite_parameters
from equipoise.user_cache import VARIABLE


def asked(robot, priors=None, swings=False):
    """As another process would ask."""
    kept.nominal_candidates.cache_clear()
    return kept.nominal_candidates(robot, priors or Priors(), swings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, a1):
    """A cache with the A1's candidates in it."""
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("kept") / "cache"
        patch.setenv(VARIABLE, str(path))
        asked(a1)
        yield path


@pytest.fixture
def forbidden(monkeypatch):
    """Nobody may compute."""

    def refuse(*_, **__):
        raise ReachError("computed again")

    monkeypatch.setattr(Candidates, "of", refuse)


def test_what_was_kept_gives_the_same_plan(a1, folder, forbidden):
    found = asked(a1)
    plan = make_plan(found, 120.0)
    stance = nominal_stance(a1)
    np.testing.assert_array_equal(found.predictor.com, composite_parameters(a1, stance.joint_position).com)
    assert plan.lifts > 15
    assert len(list(folder.iterdir())) == 1


def test_what_is_kept_is_what_was_computed(a1, folder):
    (file,) = folder.iterdir()
    stance = nominal_stance(a1)
    computed = Candidates.of(a1, stance, composite_parameters(a1, stance.joint_position).com, Priors())
    found = asked(a1)
    assert (found.lifts, found.postures, found.left_out) == (computed.lifts, computed.postures, computed.left_out)
    for mine, theirs in zip(found.rows, computed.rows, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert file.stat().st_size < 4e6


def test_another_robot_other_priors_and_other_words_on_it_are_computed(a1, folder, forbidden):
    heavier = a1.with_base(a1.pinocchio.inertias[1] + a1.pinocchio.inertias[2])
    stronger = dataclasses.replace(a1, description=dataclasses.replace(a1.description, kp=77.0))
    for robot, priors in ((heavier, None), (stronger, None), (a1, Priors(joint_offset=0.03))):
        with pytest.raises(ReachError, match="computed again"):
            asked(robot, priors)
    with pytest.raises(ReachError, match="computed again"):
        asked(a1, swings=True)


def test_other_code_computes(a1, folder, forbidden, monkeypatch):
    monkeypatch.setattr(kept, "_code", lambda: "of tomorrow")
    with pytest.raises(ReachError, match="computed again"):
        asked(a1)


@pytest.mark.parametrize(
    "damage", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: data[:-40] + bytes(40)]
)
def test_a_damaged_file_is_computed_and_written_again(a1, folder, monkeypatch, damage):
    (file,) = folder.iterdir()
    whole, good = file.read_bytes(), asked(a1)
    file.write_bytes(damage(whole))
    computed = []
    monkeypatch.setattr(Candidates, "of", lambda *_, **__: computed.append(1) or good)
    asked(a1)
    assert computed == [1]
    assert file.read_bytes() == whole
