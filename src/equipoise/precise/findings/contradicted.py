"""Rows of which a run says that the model's number is not of this robot at all.

A drawing is good to millimetres; a file made from none, or of another robot, is off by centimetres. A prior that is right for
the first hides the second: what the run says is split between the row and the inertia, and no equation is left unfit. So a
run is asked whether it contradicts the prior, and where it does the row is believed as nobody's number is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from equipoise.precise.findings.score import deviate
from equipoise.precise.posterior import Posterior
from equipoise.precise.unknown import Unknown
from equipoise.precise.unknowns import Priors

_BY_CHANCE = 0.01  # of the runs of robots whose errors are drawn from the priors
_TOLD = 0.02  # variance that a run took away at least, in units of the prior: of what it hardly tells it says nothing
_ROUNDS = 3  # lengths of legs may hide where the hips are


def estimate_uncontradicted(estimate: Callable[[Priors], Posterior], priors: Priors) -> Posterior:
    """An estimate with priors that the run does not contradict: these, or wider ones."""
    posterior = estimate(priors)
    for _ in range(_ROUNDS):
        wider = {row.name: row.otherwise for row in contradicted(posterior)}
        if not wider:
            break
        priors = replace(priors, **wider)
        posterior = estimate(priors)
    return posterior


def contradicted(posterior: Posterior) -> list[Unknown]:
    """Rows that a run contradicts, of those that have another prior for that.

    The estimate of a row is, before the run, normal about zero with the covariance that the run takes away, I - P in units of
    the prior, with P its posterior covariance. Prior and data are in conflict where it lies far out there (Evans, Moshonov,
    Bayesian Analysis 1, 2006). A prior that somebody gave is not doubted.
    """
    unknowns, found, most = posterior.unknowns, list[Unknown](), NormalDist().inv_cdf(1 - _BY_CHANCE)
    for row in unknowns.rows:
        if row.otherwise and getattr(unknowns.priors, row.name) == row.usual:
            block = unknowns[row.name]
            taken_away = np.eye(block.stop - block.start) - posterior.covariance[block, block]
            if deviate(taken_away, posterior.x[block], _TOLD) > most:
                found.append(row)
    return found


def not_believed(posterior: Posterior) -> tuple[str, ...]:
    """What an estimate takes to be otherwise than in the model file, a sentence each."""
    unknowns = posterior.unknowns
    return tuple(
        f"{row.cause}, which the run contradicts"
        for row in unknowns.rows
        if row.otherwise and getattr(unknowns.priors, row.name) == row.otherwise
    )
