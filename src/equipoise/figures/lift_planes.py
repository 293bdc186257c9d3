"""Support planes of lifts, all at the nominal stance in the base frame: where each lift says that the CoM is."""

from __future__ import annotations

from collections.abc import Sequence

from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.reading import planes_through_com
from equipoise.method.reading import LiftPlane
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration

LiftPlanes = Sequence[LiftPlane]
"""In the order of the lifts."""


def lift_planes(result: Calibration) -> LiftPlanes:
    """The planes that the paper's lifts stood on, or those that the precise ones put the CoM in.

    Empty for a result from a JSON file.
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
