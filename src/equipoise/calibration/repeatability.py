"""Calibrations of one robot, one after the other: how much they differ, against how much they say they may."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.errors import NotEstimatedError, SettingsError
from equipoise.result.calibration import Calibration

SCHEMA = "equipoise.repeatability/1"


@dataclass(frozen=True)
class Repeated:
    """One parameter of the whole robot, over the repetitions; SI units.

    Attributes:
        name: as in a result's intervals.
        mean: over the repetitions.
        spread: their standard deviation.
        deviation: that they say they have, the median; None: the method gives none.
    """

    name: str
    mean: float
    spread: float
    deviation: float | None

    @property
    def ratio(self) -> float | None:
        """Spread over deviation: at most about one for an honest interval.

        Less is no sign of caution: an interval also covers what is the same each time, as joint zeros and a scale's error.
        """
        return None if self.deviation is None or self.deviation == 0 else self.spread / self.deviation


def repeatability(results: Sequence[Calibration]) -> list[Repeated]:
    """How well calibrations of one robot repeat themselves.

    Raises:
        SettingsError: fewer than two.
        NotEstimatedError: they share no parameter.
    """
    if len(results) < 2:
        raise SettingsError(f"{len(results)} calibrations show no spread; repeat at least twice")
    bodies = [result.composite.by_name() for result in results]
    found: list[Repeated] = []
    for name in bodies[0]:
        known = [value for body in bodies if (value := body[name]) is not None]
        if len(known) < len(results):
            continue
        intervals = [result.uncertainty["composite"].intervals for result in results if result.uncertainty]
        deviations = [interval[name].deviation for interval in intervals if name in interval]
        spread = float(np.std(known, ddof=1))
        found.append(
            Repeated(name, float(np.mean(known)), spread, float(np.median(deviations)) if deviations else None)
        )
    if not found:
        raise NotEstimatedError("no parameter was estimated in every repetition")
    return found


def to_dict(repeated: Sequence[Repeated], count: int) -> dict[str, Any]:
    """JSON form."""
    return {
        "schema": SCHEMA,
        "repetitions": count,
        "parameters": {
            r.name: {"mean": r.mean, "spread": r.spread, "deviation": r.deviation, "ratio": r.ratio} for r in repeated
        },
    }
