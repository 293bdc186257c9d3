"""Support planes of lifts, at the nominal stance in the base frame."""

from __future__ import annotations

from collections.abc import Sequence

from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.reading import planes_through_com
from equipoise.method.reading import LiftPlane
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration


def lift_planes(result: Calibration) -> Sequence[LiftPlane]:
    """Return the support planes of `paper` lifts, or the planes through the CoM from `bayesian` lifts.

    The result is empty without evidence, as from a JSON file.
    """
    evidence, robot = result.evidence, result.robot_model
    if isinstance(evidence, SearchEvidence):
        lifts = [(index, trial) for index, trial in enumerate(result.trials) if trial.kind == "lift"]
        return [
            LiftPlane(index, lift.about, tried.plane, lift.verdict)
            for (index, lift), tried in zip(lifts, evidence.lifts, strict=True)
            if tried.plane is not None
        ]
    if isinstance(evidence, PosteriorEvidence) and robot is not None:
        return planes_through_com(robot, result.nominal.composite.com, evidence.posterior.motions)
    return []
