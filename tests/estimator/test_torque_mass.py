"""Comparison of the given mass with the mass that the joint torques carry, before a run and in its result."""

from dataclasses import replace

import numpy as np
import pytest

from equipoise import BayesianMethod, Calibration, calibrate, nominal_stance, simulate
from equipoise.calibration.payload_measurement import measure_payload
from equipoise.calibration.routine import perform
from equipoise.errors import SettingsError
from equipoise.estimator.diagnostics.torque_mass import _DIFFERENCE, _compared, compare_at_rest
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.experiments.dip import dip
from equipoise.experiments.stand import stand_up
from equipoise.recording.phases import Phase
from equipoise.result.legend import doubt_message
from equipoise.result.mass_comparison import MassComparison

LIFTS = {Phase.UNLOAD, Phase.LIFT}


def comparisons(robot, preset, seed, start="standing", payload=None, known=None):
    """Return the comparison of the true mass on one simulated robot, and this mass [kg]."""
    stance = nominal_stance(robot)
    with simulate(robot, preset, payload, seed, start) as simulation:
        standing, _ = stand_up(simulation.platform, robot, stance)
        mass = simulation.truth.composite.mass
        return compare_at_rest(robot, stance, (mass, 0.005 * mass), dip(standing, stance), known), mass


@pytest.mark.parametrize(("preset", "spread"), [("ideal", 0.005), ("realistic", 0.03), ("stress", 0.13)])
def test_the_true_mass_raises_no_question(a1, preset, spread):
    """Half of the robots lie at the start: friction alone carries 10 to 30 % after they have risen."""
    found = []
    for seed in range(8):
        start, payload = ("lying", None) if seed % 2 else ("standing", "5,0.05,0.02,0.08")
        compared, _ = comparisons(a1, preset, seed, start, payload)
        assert not compared.disagrees
        found.append(compared.difference)
    assert np.abs(found).max() < spread


def test_a_wrong_mass_is_refused_before_a_foot_is_lifted(a1):
    kept, asked = [], []
    with simulate(a1, "realistic", "4.5,0,0,0.08", 3) as simulation:
        with pytest.raises(SettingsError) as caught:
            calibrate(simulation.platform, a1, BayesianMethod(mass=12.0), kept.append)
        asleep = calibrate_asking(simulation.platform, a1, BayesianMethod(mass=12.0), asked)
    carried = caught.value.details["mass_comparison"]["from_torques"]
    assert carried == pytest.approx(16.95, rel=0.03)
    assert str(caught.value) == (
        f"the given mass is 12 kg, and the joint torques carry {carried:.2f} kg ({12 / carried - 1:+.0%}, limit 15%); no "
        "foot was lifted. Weigh the robot again, or omit the mass; if the mass is correct (torque constants may be "
        "this wrong), confirm it: --confirm-mass (in Python confirm_mass=True)"
    )
    assert caught.value.details["mass_comparison"]["given"] == 12.0
    assert caught.value.exit_code == 2
    assert not any(recording.has_phase(phase) for recording in kept for phase in LIFTS)
    assert isinstance(asleep, SettingsError)
    assert "the given mass is 12 kg, and the joint torques carry 1" in asked[0]


def calibrate_asking(platform, robot, method, asked):
    """Return the error of a run whose operator answers no; `asked` receives the question."""
    try:
        calibrate(platform, robot, method, confirm=lambda message: asked.append(message) or False)
    except SettingsError as error:
        return error
    return None


def test_a_robot_without_torque_sensors_is_not_compared(a1, bayesian_run):
    silent = [replace(one, joints=replace(one.joints, torque=None)) for one in bayesian_run.recordings]
    result = BayesianMethod(duration=60, mass=9.0).estimate(a1, silent, bayesian_run.stance)
    assert result.mass_comparison is None
    assert result.assumptions[0] == (
        "the given mass of 9 kg is right (standard deviation 0.045 kg): mass and inertia scale with it, and there are no "
        "joint torques to compare it with"
    )


@pytest.fixture(scope="module")
def confirmed(a1, bayesian_run):
    """Return the result of a robot of 13.96 kg with a confirmed mass of 10 kg."""
    return BayesianMethod(duration=60, mass=10.0, confirm_mass=True).estimate(
        a1, bayesian_run.recordings, bayesian_run.stance
    )


def test_a_confirmed_mass_stays_doubtful_and_the_headline_has_both(confirmed):
    carried = confirmed.mass_comparison.from_torques
    assert carried == pytest.approx(13.96, rel=0.04)
    failed = [check.name for check in confirmed.checks if not check.passed]
    assert "torque-mass consistency" in failed
    assert {quantity.verdict for quantity in confirmed.composite} == {"doubtful"}
    assert doubt_message(confirmed) == (
        f"Doubtful: the given mass is 10 kg, and the joint torques carry {carried:.2f} kg ({10 / carried - 1:+.0%}, "
        f"limit 15%); {len(failed)} of {len(confirmed.checks)} checks failed."
    )
    assert confirmed.assumptions[0] == (
        "the given mass of 10 kg is right (standard deviation 0.05 kg): mass and inertia scale with it"
    )


def test_both_masses_are_kept_with_the_result(confirmed, tmp_path):
    confirmed.save(tmp_path / "calibration.json")
    assert Calibration.load(tmp_path / "calibration.json").mass_comparison == confirmed.mass_comparison
    assert confirmed.to_dict()["mass_comparison"]["disagrees"] is True


def test_the_right_mass_is_not_doubtful(a1, bayesian_run):
    mass = bayesian_run.truth.composite.mass
    result = BayesianMethod(duration=60, mass=mass).estimate(a1, bayesian_run.recordings, bayesian_run.stance)
    assert result.trustworthy
    assert not result.mass_comparison.disagrees
    assert doubt_message(result) == ""


def test_without_a_given_mass_there_is_no_comparison(bayesian_run):
    assert bayesian_run.result.mass_comparison is None
    assert not any("given mass" in assumption for assumption in bayesian_run.result.assumptions)


def known_with_scale(robot, bayesian_run, mass):
    method = BayesianMethod(duration=60, mass=mass, confirm_mass=True)
    result = method.estimate(robot, bayesian_run.recordings, bayesian_run.stance)
    return PriorRun.of(result.evidence.posterior, result.settings, "runs/last")


def test_torque_constants_of_a_weighed_run_narrow_the_limit(a1, bayesian_run):
    known = known_with_scale(a1, bayesian_run, bayesian_run.truth.composite.mass)
    compared, mass = comparisons(a1, "realistic", bayesian_run.seed, "lying", known=known)
    assert compared.limit == 0.05
    assert not compared.disagrees
    assert "with the torque constants of runs/last" in compared.message
    assert replace(compared, given=1.08 * mass).disagrees
    assert not replace(compared, given=1.08 * mass, limit=0.15).disagrees


def test_torque_constants_of_a_run_without_a_scale_do_not_narrow_the_limit(a1, bayesian_run):
    known = PriorRun.of(bayesian_run.result.evidence.posterior, bayesian_run.result.settings, "runs/last")
    compared, _ = comparisons(a1, "realistic", bayesian_run.seed, known=known)
    assert compared.limit == 0.15


def test_torque_constants_from_a_confirmed_mass_are_used(a1, bayesian_run):
    """With a correct scale and torque constants 28 % off, one confirmation is enough."""
    known = known_with_scale(a1, bayesian_run, 10.0)
    compared, mass = comparisons(a1, "realistic", bayesian_run.seed, known=known)
    assert compared.from_torques == pytest.approx(mass * 10.0 / 13.96, rel=0.05)


def test_a_payload_measured_with_a_wrong_mass_is_doubtful_in_its_answer(a1, bayesian_run):
    known = known_with_scale(a1, bayesian_run, bayesian_run.truth.composite.mass)
    method = BayesianMethod(prior_run=known, duration=26)
    with simulate(a1, "realistic", seed=4, noise_seed=104) as simulation:
        recordings = perform(simulation.platform, a1, method).recordings
    result = replace(method, mass=11.2).estimate(a1, recordings, nominal_stance(a1))
    found = measure_payload(a1, known, result)
    assert result.mass_comparison.limit == 0.05
    assert found.message.startswith("Doubtful: the given mass is 11.2 kg, and the joint torques carry 12.")
    assert found.to_dict()["mass_comparison"]["disagrees"] is True


@pytest.mark.parametrize(
    ("given", "std", "disagrees"),
    [
        (11.4, 0.05, False),
        (11.6, 0.05, True),
        (8.6, 0.05, False),
        (8.4, 0.05, True),
        (11.6, 1.0, False),
        (13.0, 1.0, True),
    ],
)
def test_the_limit_is_15_percent_or_two_standard_deviations(given, std, disagrees):
    compared = _compared((given, std), 10.0, _DIFFERENCE, None)
    assert compared.disagrees == disagrees


def test_torques_that_carry_nothing_disagree():
    assert MassComparison(12.0, -3.0, 0.15).disagrees
