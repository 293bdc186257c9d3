"""Held-out prediction of lifts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from equipoise import Calibration
from equipoise.bayesian.estimate import _refuse_worse_than_file
from equipoise.errors import RecordingError
from equipoise.estimator.diagnostics.checks import HELD_OUT_CHECK, run_checks
from equipoise.estimator.diagnostics.held_out import folds_of, tilt_errors
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.equations.torque_balance import TorqueBalance
from equipoise.estimator.motions import read_motions
from equipoise.estimator.problem import MapProblem
from equipoise.estimator.solve import descend
from equipoise.recording.phases import Phase
from equipoise.result.findings import Check
from equipoise.result.held_out import FOUND, MODEL, HeldOut
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.posture import BodyPosture


@pytest.fixture(scope="module")
def evidence(a1, bayesian_run):
    return read_motions(a1, bayesian_run.stance, bayesian_run.recordings)


@pytest.fixture(scope="module")
def predictions(bayesian_run):
    return bayesian_run.result.evidence.predictions


@pytest.fixture(scope="module")
def posterior(bayesian_run):
    return bayesian_run.result.evidence.posterior


def refit_without(posterior, evidence, motions):
    """Return the estimate without some motions, at the noise levels of the whole run."""
    left = tuple(motion for motion in evidence if motion.index not in motions)
    whole, unknowns = posterior.problem, posterior.unknowns
    problem = MapProblem(unknowns.robot, unknowns.stance, left, unknowns.priors, whole.mass, lifts_needed=True)
    for equation, of_all in zip(problem.equations, whole.equations, strict=True):
        if isinstance(equation, TorqueBalance):
            equation.normalized_residual = of_all.normalized_residual
        else:
            equation.scale = of_all.scale[[index not in motions for index, _ in of_all.motions]]
    return descend(problem, posterior.x)[0]


def test_full_estimates_without_a_lift_predict_it_nearly_the_same(evidence, posterior, predictions):
    """Within a third of the prediction's standard deviation: first order, and lift noise depends on the body."""
    equation = posterior.problem.equation(TiltEquation)
    motions = [motion for motion, _ in equation.motions]

    def missed(of):
        x = refit_without(posterior, evidence, [of.motion])
        errors = tilt_errors(equation, posterior.unknowns, np.tile(x, (len(motions), 1)))
        return (errors[motions.index(of.motion)][-1] - of.errors[FOUND][-1]) / of.std[-1]

    assert np.sqrt(np.mean([missed(lift) ** 2 for lift in predictions[::3]])) < 0.33


def test_motions_in_one_posture_are_left_out_together_unless_that_is_much_of_the_run(evidence, posterior):
    alone = folds_of(evidence, posterior)
    assert alone == [[index] for index in sorted(posterior.information)]
    lift = next(motion for motion in evidence if motion.lift is not None)
    leaning = [
        replace(lift, index=index, trial=replace(lift.trial, posture=BodyPosture(roll=0.1 * (index // 2))))
        for index in range(10)
    ]
    without_information = replace(posterior, information=dict.fromkeys(range(10), np.zeros((0, 0))))
    assert folds_of(leaning, without_information) == [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]]


def test_a_payload_is_predicted_and_the_model_file_predicts_worse(bayesian_run):
    found = bayesian_run.result.held_out
    assert found.error(MODEL) > 10 * found.error(FOUND)
    assert found.inside(FOUND) >= 0.9 * len(found.lifts)
    assert found.inside(MODEL) <= 0.4 * len(found.lifts)


def test_the_tilt_is_the_measured_one(bayesian_run, predictions):
    for lift in predictions:
        imu = bayesian_run.recordings[lift.motion].phase(Phase.REST, until=Phase.LOWER).imu
        turned = np.linalg.norm(np.cumsum(imu.angular_velocity_in_imu, axis=0) * np.diff(imu.time).mean(), axis=1).max()
        assert abs(lift.tilt[-1]) < turned
        assert lift.tilt[0] == lift.errors[FOUND][0] == lift.std[0] == 0


def test_the_check_has_its_false_alarm_probability(posterior, bayesian_run):
    found = bayesian_run.result.held_out
    limit = np.sqrt(chi2.isf(0.01, found.folds) / found.folds)

    def verdict(sizes):
        lifts = [replace(lift, intervals={**lift.intervals, FOUND: sizes / NORMAL_95}) for lift in found.lifts]
        checks = run_checks(posterior, HeldOut(tuple(lifts)))
        return next(check for check in checks if check.name == "held-out prediction").passed

    assert verdict(0.98 * limit)
    assert not verdict(1.02 * limit)


def test_an_estimate_that_predicts_worse_than_the_model_file_is_refused(bayesian_run):
    predicted = bayesian_run.result.held_out
    exchanged = HeldOut(
        tuple(replace(lift, errors={MODEL: lift.errors[FOUND], FOUND: lift.errors[MODEL]}) for lift in predicted.lifts)
    )
    found, file = (f"{1000 * exchanged.error(body):.2f}" for body in (FOUND, MODEL))
    passed, failed = (Check(HELD_OUT_CHECK, passes, "predicted badly") for passes in (True, False))
    _refuse_worse_than_file(predicted, [failed])
    _refuse_worse_than_file(exchanged, [passed])  # worse by chance
    with pytest.raises(
        RecordingError, match=f"the estimate is rejected.*within {found} mm rms, the model file within {file}"
    ):
        _refuse_worse_than_file(exchanged, [failed])
    with pytest.raises(
        RecordingError, match="Checks that failed: lift residuals: bad; held-out prediction: predicted badly"
    ):
        _refuse_worse_than_file(
            exchanged, [Check("lift residuals", False, "bad"), failed, Check("change during the run", True, "fine")]
        )


def test_it_is_in_the_json_form(bayesian_run, tmp_path):
    bayesian_run.result.save(tmp_path / "found.json")
    assert Calibration.load(tmp_path / "found.json").held_out == bayesian_run.result.held_out
