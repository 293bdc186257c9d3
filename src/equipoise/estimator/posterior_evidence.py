"""Posterior of the Bayesian method as evidence of its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from equipoise.estimator.diagnostics.held_out import LiftPrediction
from equipoise.estimator.prior_runs.changes import Change
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.problem import Posterior
from equipoise.result.calibration import Evidence


@dataclass(frozen=True, eq=False)
class PosteriorEvidence(Evidence):
    """Evidence of a run of the Bayesian method.

    Attributes:
        posterior: estimate with its information by motion.
        changes: changes since the prior run.
        predictions: held-out predictions of the lifts.
    """

    posterior: Posterior
    changes: tuple[Change, ...] = ()
    predictions: tuple[LiftPrediction, ...] = ()

    def keepsake(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        return PriorRun.of(self.posterior, settings).to_dict()
