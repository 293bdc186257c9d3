"""What the paper's search and excitations leave beside their result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from equipoise.paper.bracket import TriedOffset
from equipoise.paper.equations import AxisFit
from equipoise.result.calibration import Evidence


@dataclass(frozen=True, eq=False)
class ExcitationEvidence(Evidence):
    """Of a run with excitations.

    Attributes:
        fits: fits of equations 2 to 5, by axis.
    """

    fits: Mapping[str, AxisFit]


@dataclass(frozen=True, eq=False)
class SearchEvidence(ExcitationEvidence):
    """Of a run with the paper's search.

    Attributes:
        lifts: every lift trial as the bracket takes it, in order.
    """

    lifts: tuple[TriedOffset, ...]
