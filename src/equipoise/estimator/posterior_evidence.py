"""What the Bayesian method leaves beside its result."""

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
    """Of a run of this method.

    Attributes:
        posterior: estimate with its information by motion.
        changes: what changed since the earlier run that is known.
        predictions: every lift predicted without the motions in its posture.
    """

    posterior: Posterior
    changes: tuple[Change, ...] = ()
    predictions: tuple[LiftPrediction, ...] = ()

    def keepsake(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        return PriorRun.of(self.posterior, settings).to_dict()
