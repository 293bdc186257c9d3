"""Convergence of a search: results of its lifts, and the planar CoM after every halving (Fig. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import cast

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.experiments.tilt import SupportPlane, Verdict
from equipoise.paper.bracket import Bracket, TriedOffset, step
from equipoise.paper.equations import find_intersection
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration
from equipoise.robot.model import DIAGONALS


def tried_offsets(calibration: Calibration, diagonal: str) -> list[TriedOffset]:
    """Return the results of the lifts on a diagonal in order, with their planes if the calibration has its evidence."""
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]
    evidence = calibration.evidence
    if isinstance(evidence, SearchEvidence):
        return [tried for trial, tried in zip(lifts, evidence.lifts, strict=True) if trial.about == diagonal]
    return [
        TriedOffset(trial.offset or 0.0, trial.lift_height or 0.0, cast(Verdict, trial.verdict))
        for trial in lifts
        if trial.about == diagonal
    ]


def com_by_iteration(calibration: Calibration, start: Bracket) -> FloatArray:
    """Compute the (n, 2) planar CoM [m] after each halving of both brackets (Fig. 3).

    If an end of a bracket was not tried, the plane of the other end is shifted along x to the bracket's middle.

    Args:
        calibration: result of this method, with its evidence.
        start: bracket that the search began with.

    Raises:
        NotEstimatedError: the calibration came from a JSON file, which does not contain planes.
    """
    if not isinstance(calibration.evidence, SearchEvidence):
        raise NotEstimatedError("the JSON file does not contain the support planes; open the run folder instead")
    by_diagonal = [_planes_by_iteration(tried_offsets(calibration, diagonal), start) for diagonal in DIAGONALS]
    count = max(len(planes) for planes in by_diagonal)
    height = float(calibration.nominal.composite.com[2])
    return np.array(
        [
            find_intersection([planes[min(index, len(planes) - 1)] for planes in by_diagonal], height)
            for index in range(count)
        ]
    )


def _planes_by_iteration(tried: Sequence[TriedOffset], start: Bracket) -> list[SupportPlane]:
    """Return the plane within a diagonal's bracket after each offset. Repeated lifts at one offset count once."""
    brackets = list(accumulate(tried, step, initial=start))
    return [_plane_within(after) for before, after in pairwise(brackets) if after is not before]


def _plane_within(bracket: Bracket) -> SupportPlane:
    if bracket.plane is not None:
        return bracket.plane
    (plane, offset), *_ = [
        (end.plane, end.offset) for end in (bracket.at_lower, bracket.at_upper) if end is not None and end.plane
    ]
    return SupportPlane(plane.point + [bracket.middle - offset, 0.0, 0.0], plane.normal)
