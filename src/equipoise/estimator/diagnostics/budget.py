"""Where the uncertainty of a result comes from: a budget, as the Guide to the Expression of Uncertainty in Measurement has it.

With the information L = sum of L_k of all sources (priors of groups of unknowns, the scale, the noise of each kind of
measurement), the covariance C = L^-1 = sum of C L_k C: each term is what the errors of one source do to the estimate, and
they add up to all of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.problem import Posterior, body_jacobian, body_prior_rows
from equipoise.estimator.unknown import A_SCALE, MORE_TIME
from equipoise.result.uncertainty import UncertaintySource


def budget_of(posterior: Posterior) -> tuple[UncertaintySource, ...]:
    """Shares of each source in the variance of the whole robot's parameters, the largest sum first."""
    jacobian = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    reach = jacobian @ posterior.covariance
    variance = np.diag(posterior.robot_covariance)
    found = [
        UncertaintySource(name, np.einsum("ij,jk,ik->i", reach, information, reach) / variance, remedy)
        for name, information, remedy in _sources(posterior, {A_SCALE: MORE_TIME} if posterior.problem.mass else {})
    ]
    return tuple(sorted(found, key=lambda source: -float(source.shares.sum())))


def _sources(posterior: Posterior, instead: Mapping[str, str]) -> Iterator[tuple[str, FloatArray, str]]:
    """Name, (size, size) information and remedy of each source that there is.

    Args:
        instead: remedies that were taken already, and what else there is.
    """
    unknowns, x, mass = posterior.unknowns, posterior.x, posterior.problem.mass
    believed = _information(body_prior_rows(unknowns, x, None)[1])
    yield "what was believed of the base", believed, MORE_TIME
    if mass is not None:
        yield "the scale", _information(body_prior_rows(unknowns, x, mass)[1]) - believed, "a better scale (--mass-std)"
    if unknowns.belief is not None:
        information = np.zeros((unknowns.size, unknowns.size))
        information[unknowns.tabled, unknowns.tabled] = unknowns.belief.information
        yield "what the earlier run left open, and what may have changed since", information, MORE_TIME
    groups = {row.group: None for row in unknowns.rows} if unknowns.belief is None else {}
    for group in groups:
        columns = unknowns.columns(*(row.name for row in unknowns.rows if row.group == group))
        information = np.zeros((unknowns.size, unknowns.size))
        information[columns, columns] = 1.0
        yield group.name, information, instead.get(group.remedy, group.remedy)
    for equation, information in posterior.information_by_equation.items():
        yield equation.source, information, instead.get(equation.remedy, equation.remedy)


def _information(jacobian: FloatArray) -> FloatArray:
    return np.asarray(jacobian.T @ jacobian, dtype=float)
