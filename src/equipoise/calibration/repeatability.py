"""Calibrations of one robot, one after the other: how much they differ, against how much they say they may."""

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
    """One parameter of the whole robot, over the repetitions; SI units.

    Attributes:
        quantity: quantity whose value is the mean over the repetitions, with the median of the standard deviations that
            they state.
        spread: standard deviation of the values over the repetitions.
    """

    quantity: Quantity
    spread: float

    @property
    def ratio(self) -> float | None:
        """Spread over deviation: at most about one for an honest interval.

        Less is not a sign of caution: an interval also covers what is the same each time, as joint offsets and a scale's
        error.
        """
        return self.spread / self.quantity.std if self.quantity.std else None


def repeatability(results: Sequence[Calibration]) -> list[Repeated]:
    """Compare the spread of several calibrations of one robot with their intervals.

    Raises:
        SettingsError: fewer than two.
        NotEstimatedError: they share no parameter.
    """
    if len(results) < 2:
        raise SettingsError(f"{len(results)} calibrations show no spread; repeat at least twice")
    found: list[Repeated] = []
    for same in zip(*(result.composite for result in results), strict=True):
        known = [quantity.value for quantity in same if quantity.value is not None]
        if len(known) < len(results):
            continue
        stds = [quantity.std for quantity in same if quantity.std is not None]
        mean = replace(
            same[0],
            value=float(np.mean(known)),
            std=float(np.median(stds)) if stds else None,
            verdict=None,
        )
        found.append(Repeated(mean, float(np.std(known, ddof=1))))
    if not found:
        raise NotEstimatedError("no parameter was estimated in every repetition")
    return found


def to_dict(repeated: Sequence[Repeated], count: int) -> dict[str, Any]:
    """JSON form."""
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
