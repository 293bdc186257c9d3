"""Support planes of lifts, all at the nominal stance in the base frame: where each lift says that the CoM is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.evidence import SearchEvidence
from equipoise.precise.measurements.support_planes import centre_shift
from equipoise.precise.posterior_evidence import PosteriorEvidence
from equipoise.result.calibration import Calibration

Planes = Sequence[tuple[str, SupportPlane]]
"""By diagonal, in the order of the lifts."""


def support_planes(result: Calibration) -> Planes:
    """The planes that the paper's lifts stood on, or those that the precise ones put the CoM in.

    Empty for a result from a JSON file.
    """
    evidence, robot = result.evidence, result.robot_model
    if isinstance(evidence, SearchEvidence):
        lifts = [trial.about for trial in result.trials if trial.kind == "lift"]
        return list(zip(lifts, evidence.trial_planes, strict=True))
    if not isinstance(evidence, PosteriorEvidence) or robot is None:
        return []
    found: list[tuple[str, SupportPlane]] = []
    com = result.nominal.composite.com
    for motion in evidence.motions:
        if motion.lift is not None:
            shift = centre_shift(robot, motion.lift)
            normal = shift.normal / np.linalg.norm(shift.normal)
            found.append((motion.lift.diagonal, SupportPlane(com + shift.distance * normal, normal)))
    return found
