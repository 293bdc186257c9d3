"""A run and the one before it as one estimate, from what the earlier one kept: posterior and covariance are enough.

With x1 ~ N(m, P) of the earlier run, and what is kept of it, k, in the later one's prior with the covariance S = P_kk + drift,
the later run tells of the earlier one through k alone:

    x1 = m + G (k - m_k) + e,    G = P_1k S^-1,    e ~ N(0, P - G P_k1),

as a smoother's backward step has it (Rauch, Tung and Striebel 1965).
"""

from __future__ import annotations

import numpy as np

from equipoise.estimator.prior_runs.changes import Change
from equipoise.estimator.prior_runs.prior_run import PriorRun, shared_places
from equipoise.estimator.prior_runs.two_runs import TwoRuns
from equipoise.estimator.problem import Posterior


def both_runs(known: PriorRun, posterior: Posterior, changes: tuple[Change, ...] = ()) -> TwoRuns:
    """The earlier run and the later one, errors that both have in common in both.

    Args:
        posterior: estimate of the later run, with the earlier one known.
        changes: what changed in between: it is not common to both.
    """
    unknowns, later, covariance = posterior.unknowns, posterior.x, posterior.covariance
    mean, spread, layout = known.earlier(unknowns)
    here, there = shared_places(unknowns, layout)
    usual = known.belief(unknowns, {change.place: _ANEW for change in changes})
    kept = here - unknowns.tabled.start
    gain = spread[:, there] @ np.linalg.inv(usual.covariance[np.ix_(kept, kept)])
    first = mean + gain @ (later[here] - mean[there])
    own = spread - gain @ spread[there] + gain @ covariance[np.ix_(here, here)] @ gain.T
    joint = gain @ covariance[here]
    # In the later run's unknowns: what the earlier one held or did not keep is not asked for.
    into = np.zeros((unknowns.size, len(mean)))
    names = ["base", *(row.name for row in unknowns.rows if layout.has(row.name) and layout.estimates(row.name))]
    into[unknowns.columns(*names), layout.columns(*names)] = 1.0
    whole = np.block([[into @ own @ into.T, into @ joint], [joint.T @ into.T, covariance]])
    return TwoRuns(unknowns, into @ first, later, np.asarray(whole, dtype=float), posterior.converged)


_ANEW = 1e6  # variance in units of the prior
