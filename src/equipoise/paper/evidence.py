"""Intermediate results of the paper's search and excitations, for figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from equipoise.paper.bracket import TriedOffset
from equipoise.paper.equations import AxisFit
from equipoise.result.calibration import Evidence


@dataclass(frozen=True, eq=False)
class SearchEvidence(Evidence):
    """Evidence of a run of the paper's method.

    Attributes:
        fits: fits of equations 2 to 5, by axis.
        lifts: results of all lift trials, in order.
    """

    fits: Mapping[str, AxisFit]
    lifts: tuple[TriedOffset, ...]
