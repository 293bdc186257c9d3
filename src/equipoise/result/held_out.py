"""Held-out prediction: errors of lifts and steps predicted by estimates without them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.json_form import from_json, to_json

MODEL, PRIOR_RUN, FOUND = "model file", "prior run", "this run"
"""Names of the predicting bodies."""


@dataclass(frozen=True)
class HeldOutLift:
    """One lift or step, predicted by an estimate without it.

    Attributes:
        motion: index of the recording.
        fold: index of the group of motions held out together.
        tilt: measured rotation about the support line during the lift or step, positive forward [rad].
        errors: measured minus predicted tilt, times the height of the CoM above the line, by predicting body [m].
        intervals: absolute error over the half width of its 95 % interval, by predicting body.
        kind: kind of motion, "lift" or "step".
    """

    motion: int
    fold: int
    tilt: float
    errors: Mapping[str, float]
    intervals: Mapping[str, float]
    kind: str = "lift"


@dataclass(frozen=True)
class HeldOut:
    """All lifts and steps of a run, each predicted by an estimate without it.

    Attributes:
        lifts: lifts and steps in order.
    """

    lifts: tuple[HeldOutLift, ...]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the predicting bodies: MODEL, PRIOR_RUN if there is a prior run, FOUND."""
        return tuple(self.lifts[0].errors)

    @property
    def folds(self) -> int:
        """Number of estimates, each without one group of motions."""
        return len({lift.fold for lift in self.lifts})

    def error(self, body: str) -> float:
        """Root mean square error over lifts [m]."""
        return float(np.sqrt(np.mean([lift.errors[body] ** 2 for lift in self.lifts])))

    def relative_error(self, body: str) -> float:
        """Root mean square over lifts of the error over the half width of its interval."""
        return float(np.sqrt(np.mean([lift.intervals[body] ** 2 for lift in self.lifts])))

    def inside(self, body: str) -> int:
        """Number of lifts whose error is inside its 95 % interval."""
        return sum(lift.intervals[body] <= 1 for lift in self.lifts)

    @property
    def left_out(self) -> str:
        """Description of the motions held out for one prediction."""
        return "its walk" if self.lifts[0].kind == "step" else "the lift's posture"

    @property
    def others(self) -> str:
        """Description of the motions used for the prediction of a lift or step."""
        if any(lift.kind == "step" for lift in self.lifts):
            return "other motions"
        return "other postures" if self.folds < len(self.lifts) else "all other motions"

    @property
    def counted(self) -> str:
        """Number of lifts and steps, as "12 lifts and 30 steps"."""
        counts = Counter(lift.kind for lift in self.lifts)
        return " and ".join(f"{count} {kind}s" for kind, count in counts.items())

    def message(self) -> str:
        """Return a summary of the predictions and of the errors with each body."""
        others = "; ".join(
            f"with the {body}'s body off by {1000 * self.error(body):.2f} mm" for body in self.bodies if body != FOUND
        )
        return (
            f"{self.counted} predicted from {self.others}: off by {1000 * self.error(FOUND):.2f} mm rms, "
            f"{self.inside(FOUND)} within their intervals; {others}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        errors = {body: self.error(body) for body in self.bodies}
        inside = {body: self.inside(body) for body in self.bodies}
        return {"folds": self.folds, "errors": errors, "inside": inside, "lifts": to_json(self.lifts)}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> HeldOut:
        """Return the predictions from their JSON form."""
        return from_json(cls, {"lifts": table["lifts"]})
