"""IMU position from an excitation, for any position in the file and any mass of the robot."""

import re

import numpy as np
import pytest

from equipoise import BayesianMethod, load_robot, nominal_stance, simulate
from equipoise.calibration.routine import perform
from equipoise.estimator.equations import imu_position
from equipoise.estimator.equations.imu_position import ExcitationSamples, imu_by_excitation
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors
from equipoise.recording.phases import Phase
from equipoise.recording.trials import ExcitationTrial
from equipoise.robot.description import RobotDescription


@pytest.fixture(scope="module")
def swaying(a1):
    """Return recordings of a short run with an excitation: a realistic A1 with a payload."""
    with simulate(a1, "realistic", "2,0.1,0,0.1", seed=5) as simulation:
        return perform(simulation.platform, a1, BayesianMethod(duration=60)).recordings


@pytest.fixture(scope="module")
def expected(swaying):
    """Return the result with the correct IMU position in the file."""
    robot = with_imu_at((0.0, 0.0, 0.0))
    return BayesianMethod(duration=60).estimate(robot, swaying, nominal_stance(robot))


def with_imu_at(shift):
    place = np.array(load_robot("unitree_a1").imu_in_base.translation) + shift
    return load_robot("unitree_a1", RobotDescription(imu_position=tuple(place.tolist())))


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.02), (-0.03, 0.015, -0.01)])
def test_the_position_is_found(swaying, shift):
    robot = with_imu_at(shift)
    stance = nominal_stance(robot)
    motions = read_motions(robot, stance, swaying)
    (excitation,) = (excitation for motion in motions for excitation in motion.of(ExcitationSamples))
    unknowns = Unknowns(robot, stance, Priors())
    values = unknowns.values(unknowns.start())
    place, std = imu_by_excitation(robot, LegChains(robot), excitation, values, stance.scale)
    assert place == pytest.approx(-np.array(shift), abs=4e-3)
    assert np.all(std < 2e-3)


def test_only_the_first_minute_of_a_long_excitation_is_read(swaying, monkeypatch):
    (recording,) = (one for one in swaying if isinstance(one.trial, ExcitationTrial))
    recording = recording.phase(Phase.EXCITATION)
    whole = ExcitationSamples.of(recording, np.zeros(3), 1.0)
    assert np.array_equal(whole.time, recording.imu.time)
    longest = (whole.time[-1] - whole.time[0]) / 2
    monkeypatch.setattr(imu_position, "_LONGEST", longest / 2)
    half = ExcitationSamples.of(recording, np.zeros(3), 2.0)
    assert 2 * len(half.time) == pytest.approx(len(whole.time), abs=2)
    assert np.array_equal(half.joint_position, whole.joint_position[: len(half.time)])


@pytest.mark.parametrize("up", [0.01, 0.02])
def test_a_wrong_height_in_the_file_is_corrected(swaying, expected, up):
    """Lifts alone confuse the height with inertia. With the excitation the result equals that of a correct file."""
    wrong = with_imu_at((0.0, 0.0, up))
    found = BayesianMethod(duration=60).estimate(wrong, swaying, nominal_stance(wrong))
    assert found.trustworthy
    assert "the run contradicts the model file: the position of the IMU differs from the file" in found.assumptions
    (height,) = (finding.value for finding in found.sensors if finding.name == "IMU position z")
    assert height == pytest.approx(-up, abs=4e-3)
    apart = found.composite.values - expected.composite.values
    assert np.all(np.abs(apart) < 0.7 * expected.composite.stds)
    assert sum(source.name == "IMU position from the excitation" for source in found.uncertainty_budget) == 1
    assert sum(source.shares for source in found.uncertainty_budget) == pytest.approx(np.ones(10))


def test_an_excitation_that_agrees_with_the_tilts_is_only_a_check(expected):
    (check,) = (check for check in expected.checks if check.name == "IMU position")
    assert check.passed
    assert all(source.name != "IMU position from the excitation" for source in expected.uncertainty_budget)


def test_narrow_leg_priors_always_include_the_excitation(swaying):
    """No other parameter resembles the IMU position then, so moments depend less on its prior."""
    robot = with_imu_at((0.0, 0.0, 0.0))
    shares, stds = [], []
    for legs in ("wide", "narrow"):
        result = BayesianMethod(duration=60, mass=14.5, leg_prior=legs).estimate(robot, swaying, nominal_stance(robot))
        shares.append([source.name for source in result.uncertainty_budget].count("IMU position from the excitation"))
        (height,) = (finding.std for finding in result.sensors if finding.name == "IMU position z")
        stds.append(height)
    assert shares == [0, 1]
    assert stds[1] < 0.9 * stds[0]


def test_a_wrong_fixed_position_fails_the_check(swaying):
    robot = with_imu_at((0.0, 0.0, 0.02))
    fixed = BayesianMethod(duration=60, priors=Priors().holding("imu_position"))
    result = fixed.estimate(robot, swaying, nominal_stance(robot))
    (check,) = (check for check in result.checks if check.name == "IMU position")
    assert not check.passed
    assert not result.trustworthy
    away = re.search(r"The excitation places it x \S+, y \S+, z (-\d+\.\d) mm from the model's position", check.message)
    assert away is not None
    assert float(away[1]) == pytest.approx(-20, abs=4)
    assert "imu_position" in check.message


def test_the_check_needs_an_excitation(bayesian_run):
    (check,) = (check for check in bayesian_run.result.checks if check.name == "IMU position")
    assert check.passed
    assert check.message == "not tested: the run has no excitation about all axes"
