"""Score tests of fixed parameters."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from test_added_errors import another_model, estimating, gained, posterior_of, with_drive_train, with_gyroscope

from equipoise import BayesianMethod
from equipoise.estimator.diagnostics import checks, score
from equipoise.estimator.diagnostics.checks import run_checks
from equipoise.estimator.diagnostics.score import score_tests
from equipoise.estimator.unknowns import Priors


def check_of(posterior):
    return next(check for check in run_checks(posterior) if check.name == "fixed-parameter score test")


def drifting(recordings, gyroscope, accelerometer):
    """Return recordings whose biases change linearly from the first start to the last end."""
    begin, end = recordings[0].imu.time[0], recordings[-1].imu.time[-1]

    def seen(recording):
        imu = recording.imu
        part = ((imu.time - begin) / (end - begin) - 0.5)[:, None]
        return replace(
            recording,
            imu=replace(
                imu,
                angular_velocity_in_imu=imu.angular_velocity_in_imu + part * gyroscope,
                acceleration_in_imu=imu.acceleration_in_imu + part * accelerometer,
            ),
        )

    return [seen(recording) for recording in recordings]


def eccentric(recordings, sine, cosine):
    """Return recordings of encoders with off-centre magnets."""

    def seen(recording):
        joints = recording.joints
        q, v = joints.position, joints.velocity
        return replace(
            recording,
            joints=replace(
                joints,
                position=q + sine * np.sin(q) + cosine * np.cos(q),
                velocity=v + (sine * np.cos(q) - cosine * np.sin(q)) * v,
            ),
        )

    return [seen(recording) for recording in recordings]


@pytest.mark.parametrize(
    "combined_priors",
    [
        BayesianMethod(cable="none").combined_priors,
        estimating(),
        BayesianMethod(leg_prior="narrow", cable="none").combined_priors,
    ],
    ids=["no cable", "all fixed", "narrow"],
)
def test_a_robot_within_its_priors_passes(a1, bayesian_run, combined_priors):
    found = posterior_of(a1, bayesian_run, bayesian_run.recordings, combined_priors)
    tests = score_tests(found)
    held = {row.name for row in Priors.rows() if getattr(combined_priors, row.name) == 0}
    assert {test.row.name for test in tests} == held
    deviates = [test.deviate for test in tests]
    assert deviates == sorted(deviates, reverse=True)
    assert deviates[0] < 2
    check = check_of(found)
    assert check.passed
    assert tests[0].row.name in check.message


def with_error(a1, recordings):
    """Return recordings with an error of a fixed parameter, and the model for their estimate."""
    shorter = another_model(a1)
    for leg in shorter.legs.values():
        calf = shorter.pinocchio.jointPlacements[leg.joint_ids[-1]]
        calf.translation = calf.translation * (1 + 4e-3 / np.linalg.norm(calf.translation))
    play = np.array([6e-3, 6e-3, 0.0])
    return {
        "backlash": (with_drive_train(recordings, np.zeros(3), play), a1),
        "link_length_common": (recordings, shorter),
        "gyro_drift": (drifting(recordings, np.array([6e-3, -6e-3, 6e-3]), 0.0), a1),
    }


@pytest.mark.parametrize("name", ["backlash", "link_length_common", "gyro_drift"])
def test_the_wrong_parameter_is_named_first_with_its_remedy(a1, bayesian_run, name):
    recordings, model = with_error(a1, bayesian_run.recordings)[name]
    found = posterior_of(model, bayesian_run, recordings, estimating())
    tests = score_tests(found)
    assert tests[0].row.name == name
    check = check_of(found)
    assert not check.passed
    assert check.message.startswith(Priors.row(name).cause)
    assert f"{name} = {Priors.row(name).usual:g} in --priors" in check.message
    assert ("--leg-prior wide" in check.message.split(";")[1]) == (name == "link_length_common")
    # Once it is estimated, the other scores are smaller.
    opened = estimating().__class__(**{**estimating().__dict__, name: Priors.row(name).usual})
    after = score_tests(posterior_of(model, bayesian_run, recordings, opened))
    assert name not in {test.row.name for test in after}
    assert after[0].deviate < tests[0].deviate - 1


def test_values_are_right_to_first_order(a1, bayesian_run):
    gains = np.array([0.012, -0.01, 0.008])
    recordings = with_gyroscope(bayesian_run.recordings, np.diag(gains))
    plain, found = (
        next(
            test
            for test in score_tests(posterior_of(a1, bayesian_run, read, estimating()))
            if test.row.name == "gyro_gain"
        )
        for read in (bayesian_run.recordings, recordings)
    )
    np.testing.assert_allclose(found.values - plain.values, gains, atol=4e-3)


def test_eccentric_encoders_are_detected_and_can_be_estimated(a1, bayesian_run):
    """Such errors resemble those of hip positions and lengths, which narrow leg priors exclude."""
    sine, cosine = 0.03 * np.random.default_rng(0).standard_normal((2, 12))
    recordings = eccentric(bayesian_run.recordings, sine, cosine)
    combined_priors = BayesianMethod(leg_prior="narrow").combined_priors.holding("eccentricity")
    clean, eccentric_deviate = (
        score_tests(posterior_of(a1, bayesian_run, read, combined_priors))[0].deviate
        for read in (bayesian_run.recordings, recordings)
    )
    assert clean < 1.5 < eccentric_deviate - 1
    opened = replace(estimating(), eccentricity=0.03)
    plain, found = (posterior_of(a1, bayesian_run, read, opened) for read in (bayesian_run.recordings, recordings))
    off = gained(found, plain, "eccentricity") - np.column_stack([sine, cosine]).ravel()
    assert np.abs(off / found.std("eccentricity")).max() < 2.5


def test_larger_drifts_are_not_hidden_by_the_noise_that_they_raise(a1, bayesian_run):
    recordings = drifting(bayesian_run.recordings, 0.0, np.array([0.4, -0.4, 0.0]))
    tests = score_tests(posterior_of(a1, bayesian_run, recordings, Priors().holding("accelerometer_drift")))
    assert tests[0].row.name == "accelerometer_drift"
    assert tests[0].deviate > 5


def test_without_fixed_rows_there_are_no_tests(a1, bayesian_run):
    found = posterior_of(a1, bayesian_run, bayesian_run.recordings, Priors().all_open)
    assert score_tests(found) == []
    check = check_of(found)
    assert check.passed
    assert check.message == "the run is not sensitive to any fixed parameter"


def test_deviates_under_the_prior_are_normal():
    """The cube root of Wilson and Hilferty is accurate in the tails; directions without information are left out."""
    generator = np.random.default_rng(3)
    for seen in (1, 3, 12):
        sizes = np.concatenate([np.geomspace(0.2, 500, seen), [0.05]])
        turn = np.linalg.qr(generator.standard_normal((seen + 1, seen + 1)))[0]
        scores = (np.sqrt(sizes) * generator.standard_normal((20_000, seen + 1))) @ turn.T
        deviates = np.array([score.deviate(turn @ np.diag(sizes) @ turn.T, drawn, 0.1) for drawn in scores])
        for share in (0.5, 0.05, 0.001):
            assert np.quantile(deviates, 1 - share) == pytest.approx(NormalDist().inv_cdf(1 - share), abs=0.25)
    assert score.deviate(0.05 * np.eye(2), np.ones(2), 0.1) == -np.inf


def test_the_limit_is_the_false_alarm_probability_over_all_tests(a1, bayesian_run, monkeypatch):
    found = posterior_of(a1, bayesian_run, bayesian_run.recordings, estimating())
    tests = [test for test in score_tests(found) if test.deviate > -np.inf]
    share = len(tests) * (1 - NormalDist().cdf(tests[0].deviate))
    for chance, passed in ((0.9 * share, True), (1.1 * share, False)):
        monkeypatch.setattr(checks, "_SCORE_FALSE_ALARM", chance)
        assert check_of(found).passed == passed
