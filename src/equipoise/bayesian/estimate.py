"""Estimation of a run's result from its recordings: read, estimate, check."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from equipoise.bayesian.settings import BayesianSettings
from equipoise.bayesian.trial_rows import trial_row
from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.diagnostics.budget import uncertainty_budget
from equipoise.estimator.diagnostics.checks import HELD_OUT_CHECK, half_difference, run_checks
from equipoise.estimator.diagnostics.held_out import held_out, predict_held_out
from equipoise.estimator.diagnostics.imu_position_check import contradicts_imu_position
from equipoise.estimator.diagnostics.link_findings import link_findings
from equipoise.estimator.diagnostics.prior_conflict import (
    assumed_imu_position,
    conflicting_parameters,
    resolve_prior_conflicts,
)
from equipoise.estimator.diagnostics.screening import screen
from equipoise.estimator.diagnostics.sensor_findings import sensor_findings
from equipoise.estimator.diagnostics.torque_mass import assumed_mass, compare_estimate
from equipoise.estimator.equations.equation import Equation, MotionSamples
from equipoise.estimator.equations.table import EQUATIONS
from equipoise.estimator.motions import read_motions
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.prior_runs.changes import Change, estimate_with_prior_run, prior_run_check
from equipoise.estimator.problem import Posterior, body_jacobian, estimate_posterior
from equipoise.estimator.unknowns import Priors
from equipoise.method.combined import base_recordings
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, model_facts
from equipoise.result.findings import Check
from equipoise.result.held_out import FOUND, MODEL, HeldOut
from equipoise.robot.inertial import InertialParameters, nominal_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


def estimate_run(
    settings: BayesianSettings,
    table: Mapping[str, Any],
    robot: RobotModel,
    recordings: Sequence[Recording],
    stance: Stance,
    lifts_needed: bool = True,
) -> Calibration:
    """Estimate the inertial parameters from the recordings of a Bayesian run.

    Args:
        table: method and settings as JSON values, stored in the result.
        lifts_needed: True to reject recordings without a usable lift; False to estimate from joint torques then.

    Raises:
        RecordingError: no recording can be used, sensors contradict each other, or the estimate predicts
            held-out motions worse than the model file does.
    """
    timings: dict[str, float] = {}
    with _timed(timings, "screen the sensors"):
        velocities = screen(robot, base_recordings(recordings))
    with _timed(timings, "read the recordings"):
        motions = read_motions(robot, stance, recordings)
    with _timed(timings, "estimate"):
        posterior, changes = _posterior(settings, robot, stance, motions, lifts_needed)
    with _timed(timings, "check"):
        predictions = predict_held_out(posterior, settings.prior_run)
        predicted = held_out(predictions)
        masses = compare_estimate(posterior, settings.scale, settings.prior_run)
        unsorted = [velocities, *run_checks(posterior, predicted, masses)]
        unsorted += [] if settings.prior_run is None else [prior_run_check(changes, settings.prior_run)]
        checks = tuple(sorted(unsorted, key=lambda check: check.passed))
        _refuse_worse_than_file(predicted, checks)
        findings = (*map(Change.finding, changes), *sensor_findings(posterior))
    nominal = nominal_inertia(robot, stance.joint_position)
    unknowns = posterior.unknowns
    passed = all(check.passed for check in checks)
    difference = None if passed else half_difference(posterior)

    def body(of: Callable[[FloatArray], InertialParameters], model: InertialParameters) -> Body:
        """Return a body of the result, with wider intervals if a check failed."""
        found = Body.complete(of(posterior.x), posterior.covariance_of(of), posterior.std_before(of), model)
        if difference is None:
            return found
        return found.doubted(np.abs(body_jacobian(unknowns, posterior.x, of) @ difference))

    links = link_findings(unknowns, posterior.x, posterior.covariance) if settings.swings else {}

    return Calibration(
        **model_facts(robot, stance.joint_position),
        method=table["method"],
        composite=body(unknowns.robot_body, nominal.composite),
        base=body(unknowns.base_body, nominal.base),
        stance_effective=body(unknowns.stance_effective_body, nominal.stance_effective),
        sensors=findings,
        checks=checks,
        excitations={},
        support_lines={},
        trials=tuple(trial_row(motion, posterior) for motion in motions if not isinstance(motion.trial, MotorTrial)),
        settings=table,
        warnings=tuple(f"{check.name}: {check.message}" for check in checks if not check.passed),
        assumptions=(
            *assumed_mass(settings.scale, masses),
            *settings.assumptions,
            *conflicting_parameters(posterior),
            *assumed_imu_position(posterior),
        ),
        evidence=PosteriorEvidence(tuple(recordings), posterior, changes, predictions),
        held_out=predicted,
        mass_comparison=masses,
        uncertainty_budget=uncertainty_budget(posterior),
        links=links if passed else {name: link.doubted() for name, link in links.items()},
        timings=timings,
    )


def _posterior(
    settings: BayesianSettings, robot: RobotModel, stance: Stance, motions: Sequence[MotionSamples], lifts_needed: bool
) -> tuple[Posterior, tuple[Change, ...]]:
    if settings.prior_run is None:

        def estimate(priors: Priors, equations: Sequence[type[Equation[Any]]] | None = None) -> Posterior:
            # Leg lengths are estimated from stance motions, so these determine the foot noise if legs are estimated.
            return estimate_posterior(
                robot, stance, motions, priors, settings.scale,
                lifts_needed=lifts_needed, quiet_feet=settings.swings, equations=equations,
            )  # fmt: skip

        with_excitation = partial(estimate, equations=EQUATIONS)
        # An apparent IMU position error is due to wrong leg lengths, unless their prior is narrow.
        if settings.leg_prior == "narrow":
            return resolve_prior_conflicts(with_excitation, settings.combined_priors), ()
        posterior = resolve_prior_conflicts(estimate, settings.combined_priors)
        if contradicts_imu_position(posterior):
            posterior = resolve_prior_conflicts(with_excitation, settings.combined_priors)
        return posterior, ()
    return estimate_with_prior_run(
        robot, stance, motions, settings.combined_priors, settings.scale, settings.prior_run, lifts_needed
    )


def _refuse_worse_than_file(predicted: HeldOut | None, checks: Sequence[Check]) -> None:
    """Raise RecordingError if the model file predicts unseen motions significantly better than the estimate."""
    if predicted is None or all(check.passed for check in checks if check.name == HELD_OUT_CHECK):
        return
    found, file = (1000 * predicted.error(body) for body in (FOUND, MODEL))
    if found > file:
        failed = "; ".join(f"{check.name}: {check.message}" for check in checks if not check.passed)
        raise RecordingError(
            f"the estimate is rejected: it predicts {predicted.counted} from {predicted.others} within {found:.2f} mm rms, "
            f"the model file within {file:.2f} mm. An unmodelled force acted on the robot, or sensors, joint order or "
            f"model file are wrong. Checks that failed: {failed}"
        )


@contextmanager
def _timed(timings: dict[str, float], stage: str) -> Generator[None]:
    """Measure the duration of a stage [s]."""
    start = time.perf_counter()
    yield
    timings[stage] = time.perf_counter() - start
