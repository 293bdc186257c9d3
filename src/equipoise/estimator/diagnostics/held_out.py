"""Held-out prediction: each lift or step of a walk is predicted from other motions.

Motions in one posture are left out together; one by one in short runs, of which a posture is a large part. Without motions of
information H_k and gradient g_k, the estimate x of information H becomes, to first order,

    x_k = x + (H - H_k)^-1 g_k.

The tilt equation is then evaluated at x_k. Its residual is the measured less the predicted angular velocity about the support
line, up to a constant. Its integral from the first sample on is an error of the tilt.

The body of the model file, or of a prior run, is compared likewise. Sensors and floor are those of x_k in all cases, so
only the bodies differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples, StepSamples
from equipoise.estimator.measurements.tilt_invariant import integral
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.estimator.prior_runs.prior_run import PriorRun, shared_places
from equipoise.estimator.problem import Posterior
from equipoise.recording.trials import DesignedLift, PostureTrial
from equipoise.result.held_out import FOUND, MODEL, PRIOR_RUN, HeldOut, HeldOutLift
from equipoise.result.statistics import NORMAL_95

_LARGEST = 0.3  # of all lifts, in one posture: first order is not valid where more are left out


@dataclass(frozen=True, eq=False)
class LiftPrediction:
    """One lift over time, predicted without the motions in its posture.

    Attributes:
        motion: index of the recording.
        fold: index of the motions that were left out together.
        height: height of the CoM above the support line [m].
        time: (n,) time since the first sample with two feet up [s].
        tilt: (n,) measured rotation about the support line since then; positive forward [rad].
        errors: (n,) measured less predicted tilt, by name of the predicting body [rad].
        std: (n,) standard deviation of this error for the estimated body [rad].
        kind: kind of motion, "lift" or "step".
    """

    motion: int
    fold: int
    height: float
    time: FloatArray
    tilt: FloatArray
    errors: Mapping[str, FloatArray]
    std: FloatArray
    kind: str

    def summary(self) -> HeldOutLift:
        """Return the values at the last sample, which a result states."""
        ends = {body: float(error[-1]) for body, error in self.errors.items()}
        half_width = NORMAL_95 * float(self.std[-1])
        return HeldOutLift(
            self.motion, self.fold, float(self.tilt[-1]), {body: self.height * end for body, end in ends.items()},
            {body: abs(end) / half_width for body, end in ends.items()}, self.kind,
        )  # fmt: skip


def held_out(predictions: Sequence[LiftPrediction]) -> HeldOut | None:
    """Return the summary of the predictions; None if there are none."""
    return HeldOut(tuple(prediction.summary() for prediction in predictions)) if predictions else None


def predict_held_out(posterior: Posterior, prior_run: PriorRun | None = None) -> tuple[LiftPrediction, ...]:
    """Predict every used lift without the motions in its posture.

    Args:
        prior_run: prior run of the estimate, whose body predicts too.
    """
    tilts = posterior.problem.equation(TiltEquation)
    if tilts is None:
        return ()
    unknowns, x = posterior.unknowns, posterior.x
    folds = folds_of(posterior.motions, posterior)
    of_lifts = [next(index for index, fold in enumerate(folds) if motion in fold) for motion, _ in tilts.motions]
    without = [posterior.without(fold) for fold in folds]
    estimates = x + np.array([without[fold][0] for fold in of_lifts])
    errors = {
        name: tilt_errors(tilts, unknowns, at) for name, at in _with_each_body(unknowns, estimates, prior_run).items()
    }
    stds = _stds(tilts, x, [without[fold][1] for fold in of_lifts])
    heights = tilts.equation.levers(unknowns.values(x), unknowns.inertial(x))[1] / posterior.robot_body.mass
    legs, normalized_residuals = unknowns.legs, posterior.residuals_of(TiltEquation)
    return tuple(
        LiftPrediction(
            motion, of_lifts[index], float(heights[index]),
            np.asarray(lift.step * np.arange(lift.rows), dtype=float), _tilt(unknowns, legs, lift),
            {name: error[index] for name, error in errors.items()}, stds[index],
            "step" if isinstance(lift, StepSamples) else "lift",
        )
        for index, (residual, (motion, _), lift) in enumerate(
            zip(normalized_residuals, tilts.motions, tilts.samples, strict=True)
        )
        if residual.used
    )  # fmt: skip


def folds_of(motions: Sequence[MotionSamples], posterior: Posterior) -> list[list[int]]:
    """Return the groups of motion indices that are left out together.

    A group holds the motions of one posture, or one motion of unknown posture. If a posture has too many of the lifts, each
    motion is a group of its own.
    """
    used = [motion for motion in motions if motion.index in posterior.information]
    folds: dict[object, list[MotionSamples]] = {}
    for motion in used:
        posture = motion.trial.posture if isinstance(motion.trial, DesignedLift | PostureTrial) else None
        folds.setdefault(motion.index if posture is None else posture, []).append(motion)
    most = max(sum(len(motion.of(LiftSamples)) for motion in fold) for fold in folds.values())
    if most > _LARGEST * sum(len(motion.of(LiftSamples)) for motion in used):
        return [[motion.index] for motion in used]
    return [[motion.index for motion in fold] for fold in folds.values()]


def _with_each_body(unknowns: Unknowns, estimates: FloatArray, prior_run: PriorRun | None) -> dict[str, FloatArray]:
    """Return (lifts, size) estimates with each compared body, legs included."""
    bodies = {MODEL: unknowns.start()}
    if prior_run is not None:  # the model's values where the prior run has none
        mean, _, layout = prior_run.earlier(unknowns)
        here, there = shared_places(unknowns, layout)
        bodies[PRIOR_RUN] = unknowns.start()
        bodies[PRIOR_RUN][unknowns["base"]], bodies[PRIOR_RUN][here] = mean[layout["base"]], mean[there]
    inertial = np.isin(np.arange(unknowns.size), unknowns.columns(*INERTIAL))
    return {name: np.where(inertial, body, estimates) for name, body in bodies.items()} | {FOUND: estimates}


def tilt_errors(tilts: TiltEquation, unknowns: Unknowns, estimates: FloatArray) -> list[FloatArray]:
    """Return the (n,) measured less predicted tilt of each lift, each from its own estimate [rad]."""
    y, inertia = tilts.equation.evaluate_each(
        [unknowns.values(x) for x in estimates], [unknowns.inertial(x) for x in estimates]
    )
    return [
        _since_the_start(lift) @ y[rows] / about
        for lift, rows, about in zip(tilts.samples, tilts.equation.trials, inertia, strict=True)
    ]


def _stds(tilts: TiltEquation, x: FloatArray, covariances: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the (n,) standard deviation of each lift's error, from its noise and from the estimate's covariance [rad]."""
    own = np.ix_(tilts.columns, tilts.columns)
    found: list[FloatArray] = []
    for lift, covariance, (derivative, noise) in zip(tilts.samples, covariances, tilts.unwhitened(x), strict=True):
        since = _since_the_start(lift)
        variance = np.diag(since @ (noise + derivative @ covariance[own] @ derivative.T) @ since.T)
        found.append(np.sqrt(np.maximum(variance, 0.0)))
    return found


def _since_the_start(lift: LiftSamples) -> FloatArray:
    """Return the (n, n) matrix from angular velocities, less the first, to the rotation since the first sample."""
    since = np.eye(lift.rows)
    since[:, 0] -= 1.0
    return np.asarray(integral(len(since), lift.step) @ since, dtype=float)


def _tilt(unknowns: Unknowns, legs: LegChains, lift: LiftSamples) -> FloatArray:
    """Return the (n,) rotation about the support line since the first sample, from the gyroscope [rad]."""
    feet, (left, right) = legs.feet(lift.joint_position), lift.stance_feet
    line = feet[:, left] - feet[:, right]
    angular_velocity = lift.angular_velocity_in_imu @ np.array(unknowns.robot.imu_in_base.rotation).T
    rate = np.einsum("ni,ni->n", line, angular_velocity) / np.linalg.norm(line, axis=1)
    return np.asarray(integral(lift.rows, lift.step) @ lift.means(rate), dtype=float)
