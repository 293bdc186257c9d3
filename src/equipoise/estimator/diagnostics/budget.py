"""Uncertainty budget of a result (Guide to the Expression of Uncertainty in Measurement).

Sources k are the priors of groups of parameters, the scale, and the noise of each kind of measurement. Their information
adds up, L = sum of L_k, so the covariance is C = L^-1 = sum of C L_k C: each term is the contribution of one source.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.problem import Posterior, body_jacobian, body_prior_rows
from equipoise.estimator.unknowns import MORE_TIME, USE_SCALE
from equipoise.result.uncertainty import UncertaintySource


def uncertainty_budget(posterior: Posterior) -> tuple[UncertaintySource, ...]:
    """Return the share of each source in the variance of the whole robot's parameters, the largest sum first."""
    jacobian = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    reach = jacobian @ posterior.covariance
    variance = np.diag(posterior.robot_covariance)
    found = [
        UncertaintySource(name, np.einsum("ij,jk,ik->i", reach, information, reach) / variance, remedy)
        for name, information, remedy in _sources(posterior, {USE_SCALE: MORE_TIME} if posterior.problem.mass else {})
    ]
    return tuple(sorted(found, key=lambda source: -float(source.shares.sum())))


def _sources(posterior: Posterior, instead: Mapping[str, str]) -> Iterator[tuple[str, FloatArray, str]]:
    """Yield the name, (size, size) information and remedy of each source.

    Args:
        instead: replacements of the remedies that this run used already.
    """
    unknowns, x, mass = posterior.unknowns, posterior.x, posterior.problem.mass
    of_base = _information(body_prior_rows(unknowns, x, None)[1])
    yield "prior of the base", of_base, MORE_TIME
    if mass is not None:
        yield "scale", _information(body_prior_rows(unknowns, x, mass)[1]) - of_base, "a better scale (--mass-std)"
    if unknowns.run_prior is not None:
        information = np.zeros((unknowns.size, unknowns.size))
        information[unknowns.tabled, unknowns.tabled] = unknowns.run_prior.information
        yield "uncertainty of the prior run, and changes since", information, MORE_TIME
    groups = {row.group: None for row in unknowns.rows} if unknowns.run_prior is None else {}
    for group in groups:
        columns = unknowns.columns(*(row.name for row in unknowns.rows if row.group == group))
        information = np.zeros((unknowns.size, unknowns.size))
        information[columns, columns] = 1.0
        yield group.name, information, instead.get(group.remedy, group.remedy)
    for equation, information in posterior.information_by_equation.items():
        yield equation.source, information, instead.get(equation.remedy, equation.remedy)


def _information(jacobian: FloatArray) -> FloatArray:
    return np.asarray(jacobian.T @ jacobian, dtype=float)
