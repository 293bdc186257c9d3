"""A search as it closed in: the bracket after every lift, and the planar CoM after every halving (Fig. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import cast

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.experiments.tilt import SupportPlane, Verdict
from equipoise.paper.bracket import Bracket, TriedOffset, step
from equipoise.paper.equations import between, find_intersection
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration
from equipoise.robot.model import DIAGONALS


def tried_offsets(calibration: Calibration, diagonal: str) -> list[TriedOffset]:
    """What the lifts on a diagonal showed, in order; with their planes, if the calibration has its evidence."""
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]
    evidence = calibration.evidence
    known = isinstance(evidence, SearchEvidence)
    planes: Sequence[SupportPlane | None] = evidence.trial_planes if known else [None] * len(lifts)
    return [
        TriedOffset(trial.offset or 0.0, trial.lift_height or 0.0, cast(Verdict, trial.verdict), plane)
        for trial, plane in zip(lifts, planes, strict=True)
        if trial.about == diagonal
    ]


def com_by_iteration(calibration: Calibration, start: Bracket) -> FloatArray:
    """(n, 2) the planar CoM [m] as it would have been found after each halving of both brackets (Fig. 3).

    While a bracket's end has not been tried, the plane in its middle is the nearest one tried, shifted along x.

    Args:
        calibration: result of this method, with its evidence.
        start: bracket that the search began with.

    Raises:
        NotEstimatedError: the calibration came from a JSON file, which holds no planes.
    """
    if not isinstance(calibration.evidence, SearchEvidence):
        raise NotEstimatedError("the support planes are not at hand: open the run folder instead of its JSON file")
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
    """The plane in the middle of a diagonal's bracket after each offset; lifts that were repeated higher make no step."""
    brackets = list(accumulate(tried, step, initial=start))
    return [_middle_plane(after) for before, after in pairwise(brackets) if after is not before]


def _middle_plane(bracket: Bracket) -> SupportPlane:
    ends = [end for end in (bracket.at_lower, bracket.at_upper) if end is not None]
    planes = [end.plane for end in ends if end.plane is not None]
    if len(planes) == 2:
        return between(planes)
    return SupportPlane(planes[0].point + [bracket.middle - ends[0].offset, 0.0, 0.0], planes[0].normal)
