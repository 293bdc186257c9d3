"""Support planes of lifts, all at the nominal stance in the base frame: where each lift says that the CoM is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.evidence import SearchEvidence
from equipoise.precise.measurements.support_planes import centre_shift
from equipoise.precise.posterior_evidence import PosteriorEvidence
from equipoise.result.calibration import Calibration


class PlaneOfLift(NamedTuple):
    """What one lift says of the CoM.

    Attributes:
        diagonal: diagonal that the robot stood on.
        plane: plane that holds the CoM, or, with a verdict, the support line.
        verdict: "forward", "backward" or "balanced": the CoM's side of the plane; None: the CoM is in it.
    """

    diagonal: str
    plane: SupportPlane
    verdict: str | None = None


LiftPlanes = Sequence[PlaneOfLift]
"""In the order of the lifts."""


def lift_planes(result: Calibration) -> LiftPlanes:
    """The planes that the paper's lifts stood on, or those that the precise ones put the CoM in.

    Empty for a result from a JSON file.
    """
    evidence, robot = result.evidence, result.robot_model
    if isinstance(evidence, SearchEvidence):
        lifts = [trial for trial in result.trials if trial.kind == "lift"]
        return [
            PlaneOfLift(lift.about, plane, lift.verdict)
            for lift, plane in zip(lifts, evidence.trial_planes, strict=True)
        ]
    if not isinstance(evidence, PosteriorEvidence) or robot is None:
        return []
    found: list[PlaneOfLift] = []
    com = result.nominal.composite.com
    for motion in evidence.motions:
        if motion.lift is not None:
            shift = centre_shift(robot, motion.lift)
            normal = shift.normal / np.linalg.norm(shift.normal)
            found.append(PlaneOfLift(motion.lift.diagonal, SupportPlane(com + shift.distance * normal, normal)))
    return found
