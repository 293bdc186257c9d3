"""What legs say of themselves that swing in the air: evidence that the motors' method hands over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import Equation
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.recording.trials import RecordedTrial
from equipoise.result.calibration import Evidence


@dataclass(frozen=True, eq=False)
class LegSwing:
    """A linear system in what the legs' links are and what the motors' torques are worth; whitened.

    Attributes:
        rows: (r, 4 links + nj) of the links' inertial parameters, as of `momenta`, and of the gain of each joint: true over
            reported torque, less one.
        target: (r,) what they add up to.
        trial: trial that it is of.
        duration: duration of its recordings [s].
    """

    rows: FloatArray
    target: FloatArray
    trial: RecordedTrial
    duration: float


@dataclass(frozen=True, eq=False)
class SwingEvidence(Evidence):
    """What the motors' method leaves beside its result.

    Attributes:
        legs: what the swing says of the legs' links; None where torques are not reported.
    """

    legs: LegSwing | None


class LegSwings(Equation[LegSwing]):
    """Rows of legs that swung in the air. Whitened as they come; no recording of the method's own holds them."""

    depends_on = (*INERTIAL, "torque_gain_common", "torque_gain")
    kind = LegSwing
    source = "noise of legs that swing in the air"
    remedy = "a longer swing (--motor-time)"

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, LegSwing]]) -> None:
        super().__init__(unknowns, samples)
        self._rows = np.concatenate([swing.rows for swing in self.samples])
        self._target = np.concatenate([swing.target for swing in self.samples])

    def _rows_in(self, sample: LegSwing) -> int:
        return len(sample.target)

    def residual(self, x: FloatArray) -> FloatArray:
        values = self.unknowns.values(x)
        gains = values["torque_gain_common"] + values["torque_gain"]
        return self._rows @ np.concatenate([self.unknowns.inertial(x)[10:], gains]) - self._target

    def information(self, x: FloatArray) -> FloatArray:
        """(size, size) information on all unknowns."""
        rows = np.zeros((len(self._target), self.unknowns.size))
        rows[:, self.columns] = self.linearise(x)[1]
        return rows.T @ rows

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        of_links, of_gains = np.split(self._rows, [len(self.unknowns.model_links)], axis=1)
        by = {
            "inertial": np.hstack([np.zeros((len(of_links), 10)), of_links]),
            "torque_gain_common": of_gains.sum(axis=1, keepdims=True),
            "torque_gain": of_gains,
        }
        return self.residual(x), self._by_unknowns(x, by)
