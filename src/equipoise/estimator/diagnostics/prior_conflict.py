"""Prior-data conflicts: parameters whose values in the model file are not those of this robot.

A drawing is accurate to millimetres; a file of another robot is off by centimetres. A narrow prior hides such an error: the
estimate splits it between the parameter and the inertia, and every equation still fits. So each run is tested for a conflict
with the prior, and conflicting parameters get a wide one.

A wrong prior also hides its own conflict, because residuals raise the noise levels or become outliers. So all suspected
parameters are estimated with wide priors first, and their values are then tested against the narrow ones. Wrong lengths make
hip positions suspect too; with wide priors for both, the test separates them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from equipoise.estimator.diagnostics.held_out import held_out, predict_held_out
from equipoise.estimator.diagnostics.score import deviate
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.problem import Posterior, body_jacobian
from equipoise.estimator.unknowns import Priors, Unknown
from equipoise.result.held_out import FOUND
from equipoise.robot.inertial import COMPONENTS, components

_SUSPECTED = 1.0  # normal deviate: one of six robots whose errors are drawn from the prior
_CONTRADICTED = NormalDist().inv_cdf(0.99)
_ALONE = NormalDist().inv_cdf(0.975)  # of one parameter of a walk, with wide priors for all suspected ones
_INFORMATIVE = 0.02  # least variance that a run removes in a tested direction, in units of the prior
_UNDETERMINED = 0.8  # share of the prior variance that remains, above which a run hardly determines a parameter
_CENTIMETRE = 0.01  # [m]
_IXX = COMPONENTS.index("Ixx")
# Factor by which held-out errors of a walk may grow: a real walk, whose steps fit badly, came to 1.09 to 1.35.
_WORSE = 1.1
_ROUNDS = 3  # one conflict may hide another


def resolve_prior_conflicts(estimate: Callable[[Priors], Posterior], priors: Priors) -> Posterior:
    """Return an estimate with priors that the run does not contradict: these, or wider ones.

    Wider priors fit every run better. A walk hardly determines these parameters, and other model errors shift them. Its
    priors are therefore widened only for parameters that are contradicted on their own, and if held-out steps are predicted
    as well. (With suspected ones, a trot of 60 s of a robot with leg lengths in error raised the IMU by 0.1 m.)
    """
    posterior = estimate(priors)
    walks = _only_walks(posterior)
    limit = _ALONE if walks else _SUSPECTED
    for _ in range(_ROUNDS):
        suspected = [row for row in _tested(posterior) if _conflict(posterior, [row]) > _SUSPECTED]
        if not suspected:
            break
        before = posterior.unknowns.priors
        wider = estimate(_widened(before, suspected))
        if _conflict(wider, suspected) < _CONTRADICTED:
            break
        conflicting = [row for row in suspected if _conflict(wider, [row]) > limit]
        if 0 < len(conflicting) < len(suspected):
            wider = estimate(_widened(before, conflicting))
        if walks and (not conflicting or _error(wider) > _WORSE * _error(posterior)):
            break
        posterior = wider
    return posterior


def _only_walks(posterior: Posterior) -> bool:
    """Return True if no motion on two feet is a lift."""
    return all(posterior.motions[lift.motion].lift is None for lift in posterior.residuals_of(TiltEquation))


def _error(posterior: Posterior) -> float:
    """Return the root mean square error of held-out steps [m]."""
    predicted = held_out(predict_held_out(posterior))
    return 0.0 if predicted is None else predicted.error(FOUND)


def _widened(priors: Priors, rows: Sequence[Unknown]) -> Priors:
    return replace(priors, **{row.name: row.wide for row in rows})


def _tested(posterior: Posterior) -> list[Unknown]:
    """Return the rows with a wide prior that have their usual prior now; a prior that the user gave is not tested."""
    priors = posterior.unknowns.priors
    return [row for row in posterior.unknowns.rows if row.wide and getattr(priors, row.name) == row.usual]


def _conflict(posterior: Posterior, rows: Sequence[Unknown]) -> float:
    """Return the normal deviate as unlikely as the estimate of some rows under their usual priors.

    Under the prior the estimate is normal about zero with the variance that the run removes. That is I - P in units of the
    usual prior, with P the posterior covariance. A large deviate is a prior-data conflict (Evans, Moshonov, Bayesian Analysis
    1, 2006). An estimate with a wide prior is converted to the usual one, to first order.
    """
    unknowns = posterior.unknowns
    at = unknowns.columns(*(row.name for row in rows))
    shrunk = np.concatenate(
        [np.full(len(unknowns.columns(row.name)), row.usual / getattr(unknowns.priors, row.name)) for row in rows]
    )
    precision = np.linalg.inv(posterior.covariance[np.ix_(at, at)])
    data = np.outer(shrunk, shrunk) * (precision - np.eye(len(at)))
    covariance = np.linalg.inv(data + np.eye(len(at)))
    return deviate(np.eye(len(at)) - covariance, covariance @ (shrunk * (precision @ posterior.x[at])), _INFORMATIVE)


def conflicting_parameters(posterior: Posterior) -> tuple[str, ...]:
    """Return a message for each parameter whose value in the model file the run contradicts."""
    return tuple(f"the run contradicts the model file: {row.cause}" for row in posterior.unknowns.priors.widened)


def assumed_imu_position(posterior: Posterior) -> tuple[str, ...]:
    """State that the height of the IMU comes from the model file, where the run hardly determines it, as in all walks.

    An error d of the file, in prior standard deviations, shifts another estimate by C d, with C their posterior covariance.
    """
    unknowns = posterior.unknowns
    if unknowns.run_prior is not None or not any(row.name == "imu_position" for row in _tested(posterior)):
        return ()
    height = unknowns["imu_position"].stop - 1
    if posterior.covariance[height, height] < _UNDETERMINED and not _only_walks(posterior):
        return ()
    moved = body_jacobian(unknowns, posterior.x, unknowns.robot_body) @ posterior.covariance[:, height]
    share = abs(moved[_IXX] / components(posterior.robot_body)[_IXX]) * _CENTIMETRE / unknowns.scale[height]
    return (
        f"the height of the IMU in the model file is right within {1000 * unknowns.scale[height]:.0f} mm (standard "
        f"deviation): the run hardly determines it, and an error of 10 mm changes Ixx by {share:.0%}",
    )
