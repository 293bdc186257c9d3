"""Rows of which a run says that the model's number is not of this robot at all.

A drawing is good to millimetres; a file made from none, or of another robot, is off by centimetres. A prior that is right for
the first hides the second: what the run says is split between the row and the inertia, and no equation is left unfit. So a
run is asked whether it contradicts the prior, and where it does the row is believed as nobody's number is.

A prior that is false hides that, too: what does not fit it raises the noise levels, or is left out. Rows that are suspected
are estimated as nobody's number, and what the run says of them then is judged by their priors. Wrong lengths make hips
suspect; once all may be wrong it is seen which are.
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
from equipoise.estimator.unknown import Unknown
from equipoise.estimator.unknowns import Priors
from equipoise.result.held_out import FOUND
from equipoise.robot.inertial import COMPONENTS, components

_SUSPECTED = 1.0  # normal deviate: one of six robots whose errors are drawn from the prior
_CONTRADICTED = NormalDist().inv_cdf(0.99)
_TOLD = 0.02  # variance that a run took away at least, in units of the prior: of what it hardly tells it says nothing
_UNTOLD = 0.8  # share of a prior's variance that a run leaves, beyond which it says next to nothing
_CENTIMETRE = 0.01  # [m]
_IXX = COMPONENTS.index("Ixx")
# Factor by which held-out errors of a walk may grow: a real one, whose steps fit badly, came to 1.09 to 1.35.
_WORSE = 1.1
_ROUNDS = 3  # what is wrong may hide something else


def resolve_prior_conflicts(estimate: Callable[[Priors], Posterior], priors: Priors) -> Posterior:
    """Return an estimate with priors that the run does not contradict: these, or wider ones.

    Wider priors fit every run better. A walk hardly determines these rows, and whatever does not fit it moves them: there
    wider priors are kept only if they predict held-out steps as well.
    """
    posterior = estimate(priors)
    for _ in range(_ROUNDS):
        suspected = [row for row in _asked(posterior) if _conflict(posterior, [row]) > _SUSPECTED]
        if not suspected:
            break
        before = posterior.unknowns.priors
        wider = estimate(_otherwise(before, suspected))
        if _conflict(wider, suspected) < _CONTRADICTED:
            break
        conflicting = [row for row in suspected if _conflict(wider, [row]) > _SUSPECTED]
        if 0 < len(conflicting) < len(suspected):
            wider = estimate(_otherwise(before, conflicting))
        if _only_walks(posterior) and _error(wider) > _WORSE * _error(posterior):
            break
        posterior = wider
    return posterior


def _only_walks(posterior: Posterior) -> bool:
    """Return whether no motion on two feet is a lift."""
    return all(posterior.motions[lift.motion].lift is None for lift in posterior.residuals_of(TiltEquation))


def _error(posterior: Posterior) -> float:
    """Return the root mean square error of held-out steps [m]."""
    predicted = held_out(predict_held_out(posterior))
    return 0.0 if predicted is None else predicted.error(FOUND)


def _otherwise(priors: Priors, rows: Sequence[Unknown]) -> Priors:
    return replace(priors, **{row.name: row.otherwise for row in rows})


def _asked(posterior: Posterior) -> list[Unknown]:
    """Rows that have another prior for robots that are not the file's. One that somebody gave is not doubted."""
    priors = posterior.unknowns.priors
    return [row for row in posterior.unknowns.rows if row.otherwise and getattr(priors, row.name) == row.usual]


def _conflict(posterior: Posterior, rows: Sequence[Unknown]) -> float:
    """Normal deviate as unlikely as what the run says of rows, if their errors are of the usual size.

    The estimate is then normal about zero with the covariance that the run takes away, I - P in units of the usual prior, with
    P the posterior covariance. Prior and data are in conflict where it lies far out there (Evans, Moshonov, Bayesian Analysis
    1, 2006). An estimate by another prior is brought to the usual one, to first order.
    """
    unknowns = posterior.unknowns
    at = unknowns.columns(*(row.name for row in rows))
    shrunk = np.concatenate(
        [np.full(len(unknowns.columns(row.name)), row.usual / getattr(unknowns.priors, row.name)) for row in rows]
    )
    precision = np.linalg.inv(posterior.covariance[np.ix_(at, at)])
    data = np.outer(shrunk, shrunk) * (precision - np.eye(len(at)))
    covariance = np.linalg.inv(data + np.eye(len(at)))
    return deviate(np.eye(len(at)) - covariance, covariance @ (shrunk * (precision @ posterior.x[at])), _TOLD)


def conflicting_parameters(posterior: Posterior) -> tuple[str, ...]:
    """What an estimate takes to be otherwise than in the model file, a sentence each."""
    return tuple(f"{row.cause}, which the run contradicts" for row in posterior.unknowns.priors.not_of_this_robot)


def assumed_imu_position(posterior: Posterior) -> tuple[str, ...]:
    """State that the height of the IMU is taken from the model file, where the run hardly determines it; walks never do.

    An error d of the file, in standard deviations of its prior, moves the estimate of what depends on it by C d, with C the
    posterior's covariance of both, in the same unit.
    """
    unknowns = posterior.unknowns
    if unknowns.belief is not None or not any(row.name == "imu_position" for row in _asked(posterior)):
        return ()
    height = unknowns["imu_position"].stop - 1
    if posterior.covariance[height, height] < _UNTOLD and not _only_walks(posterior):
        return ()
    moved = body_jacobian(unknowns, posterior.x, unknowns.robot_body) @ posterior.covariance[:, height]
    share = abs(moved[_IXX] / components(posterior.robot_body)[_IXX]) * _CENTIMETRE / unknowns.scale[height]
    return (
        f"the IMU is where the model file has it, within {1000 * unknowns.scale[height]:.0f} mm (standard deviation): the run "
        f"hardly determines its height, and an error of 10 mm changes Ixx by {share:.0%}",
    )
