"""Repeatability: spread of repeated calibrations of one robot, compared with their standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from equipoise.errors import NotEstimatedError, SettingsError
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity

SCHEMA = "equipoise.repeatability/1"


@dataclass(frozen=True)
class Repeated:
    """Parameter of the whole robot over the repetitions, in SI units.

    Attributes:
        quantity: mean value over the repetitions, with the median of their standard deviations.
        spread: standard deviation of the values over the repetitions.
    """

    quantity: Quantity
    spread: float

    @property
    def ratio(self) -> float | None:
        """Ratio of spread to standard deviation: at most about one for a valid interval.

        It is often smaller, because an interval also covers errors common to all runs, such as joint offsets.
        """
        return self.spread / self.quantity.std if self.quantity.std else None


def repeatability(results: Sequence[Calibration]) -> list[Repeated]:
    """Compare the spread of several calibrations of one robot with their intervals.

    Raises:
        SettingsError: there are fewer than two calibrations.
        NotEstimatedError: no parameter is estimated in all of them.
    """
    if len(results) < 2:
        raise SettingsError(f"repeatability needs two or more calibrations, not {len(results)}; repeat at least twice")
    found: list[Repeated] = []
    for same in zip(*(result.composite for result in results), strict=True):
        values = [quantity.value for quantity in same if quantity.value is not None]
        if len(values) < len(results):
            continue
        stds = [quantity.std for quantity in same if quantity.std is not None]
        mean = replace(
            same[0],
            value=float(np.mean(values)),
            std=float(np.median(stds)) if stds else None,
            verdict=None,
        )
        found.append(Repeated(mean, float(np.std(values, ddof=1))))
    if not found:
        raise NotEstimatedError("no parameter was estimated in every repetition")
    return found


def to_dict(repeated: Sequence[Repeated], count: int) -> dict[str, Any]:
    """Return the JSON form."""
    return {
        "schema": SCHEMA,
        "repetitions": count,
        "parameters": {
            one.quantity.name: {
                "mean": one.quantity.value,
                "spread": one.spread,
                "std": one.quantity.std,
                "ratio": one.ratio,
            }
            for one in repeated
        },
    }
