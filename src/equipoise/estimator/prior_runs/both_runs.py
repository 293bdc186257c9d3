"""Joint estimate of a run and its prior run, from the posterior of the prior run.

The prior run has x1 ~ N(m, P). Its kept parameters k enter the later run's prior with the covariance S = P_kk + drift.
The later run depends on the prior run through k alone:

    x1 = m + G (k - m_k) + e,    G = P_1k S^-1,    e ~ N(0, P - G P_k1),

the backward step of a smoother (Rauch, Tung and Striebel 1965).
"""

from __future__ import annotations

import numpy as np

from equipoise.estimator.prior_runs.changes import Change
from equipoise.estimator.prior_runs.prior_run import PriorRun, shared_places
from equipoise.estimator.prior_runs.two_runs import TwoRuns
from equipoise.estimator.problem import Posterior


def both_runs(prior_run: PriorRun, posterior: Posterior, changes: tuple[Change, ...] = ()) -> TwoRuns:
    """Return the joint estimate of the prior run and the later run.

    Args:
        posterior: estimate of the later run, with the prior run.
        changes: changes between the runs, which are not common to both.
    """
    unknowns, later, covariance = posterior.unknowns, posterior.x, posterior.covariance
    mean, spread, layout = prior_run.earlier(unknowns)
    here, there = shared_places(unknowns, layout)
    prior = prior_run.distribution(unknowns, {change.place: _UNCORRELATED for change in changes})
    kept = here - unknowns.tabled.start
    gain = spread[:, there] @ np.linalg.inv(prior.covariance[np.ix_(kept, kept)])
    first = mean + gain @ (later[here] - mean[there])
    own = spread - gain @ spread[there] + gain @ covariance[np.ix_(here, here)] @ gain.T
    joint = gain @ covariance[here]
    # In the layout of the later run; rows that the prior run fixed or did not keep are left out.
    into = np.zeros((unknowns.size, len(mean)))
    names = ["base", *(row.name for row in unknowns.rows if layout.has(row.name) and layout.estimates(row.name))]
    into[unknowns.columns(*names), layout.columns(*names)] = 1.0
    whole = np.block([[into @ own @ into.T, into @ joint], [joint.T @ into.T, covariance]])
    return TwoRuns(unknowns, into @ first, later, np.asarray(whole, dtype=float), posterior.converged)


_UNCORRELATED = 1e6  # variance in units of the prior
