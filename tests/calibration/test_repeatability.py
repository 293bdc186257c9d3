"""Repeated calibrations of one robot."""

import numpy as np
import pytest

from equipoise import calibrate, simulate
from equipoise.calibration.repeatability import repeatability, to_dict
from equipoise.errors import SettingsError
from equipoise.lab.static.method import Static

SETTINGS = Static()


@pytest.fixture(scope="module")
def results(a1):
    with simulate(a1, "realistic", seed=4) as simulation:
        return [calibrate(simulation.platform, a1, SETTINGS) for _ in range(3)]


def test_the_spread_is_that_of_the_results(results):
    by_name = {one.quantity.name: one for one in repeatability(results)}
    assert set(by_name) == {"mass", "com_x", "com_y"}
    masses = [result.composite.mass.value for result in results]
    assert by_name["mass"].quantity.value == pytest.approx(np.mean(masses))
    assert by_name["mass"].spread == pytest.approx(np.std(masses, ddof=1))
    assert by_name["mass"].spread > 0
    stds = [result.composite.mass.std for result in results]
    assert by_name["mass"].ratio == pytest.approx(by_name["mass"].spread / np.sqrt(np.mean(np.square(stds))), rel=0.01)


def test_the_spread_is_compared_with_the_std(bayesian_run):
    repeated = repeatability([bayesian_run.result, bayesian_run.result])
    assert len(repeated) == 10
    assert all(one.ratio == 0 and one.quantity.std > 0 for one in repeated)
    assert to_dict(repeated, 2)["parameters"]["Ixx"]["ratio"] == 0


def test_one_calibration_has_no_repeatability(results):
    with pytest.raises(SettingsError, match="repeatability needs two or more calibrations, not 1; repeat"):
        repeatability(results[:1])
