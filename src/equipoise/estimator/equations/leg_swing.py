"""Leg swings in the air: information of the motor fit on leg links and torque gains, as rows of the estimate.

All swings of a run are fitted together (motors/fit.py): their recordings are the samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.linalg import LinAlgError

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import Equation, MotionSamples, RunContext
from equipoise.estimator.motors.fit import fit_swings, last_swings
from equipoise.estimator.motors.legs import legs_in_swing
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial


class LegSwings(Equation[Recording]):
    """Whitened rows of the last swings of all legs; all rows belong to the last recording."""

    depends_on = (*INERTIAL, "torque_gain_common", "torque_gain")
    name = "swings"
    kind = Recording
    source = "noise of legs that swing in the air"
    remedy = "a longer swing (--motor-time)"

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[Recording]:
        """Return the recording itself."""
        return (recording,) if isinstance(recording.trial, MotorTrial) and recording.complete else ()

    @classmethod
    def of(cls, unknowns: Unknowns, motions: Sequence[MotionSamples]) -> Equation[Recording] | None:
        """Return the rows of all swings; None if a leg did not swing or torques are not reported."""
        try:
            return super().of(unknowns, motions)
        except (RecordingError, LinAlgError):
            return None

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, Recording]]) -> None:
        """Fit the swings; raises RecordingError."""
        robot, stance = unknowns.robot, unknowns.stance
        swings = tuple(last_swings([recording for _, recording in samples]))
        self._swung, self._target = legs_in_swing(fit_swings(robot, stance, swings))
        super().__init__(unknowns, samples[-1:])

    def _rows_in(self, sample: Recording) -> int:
        return len(self._target)

    def residual(self, x: FloatArray) -> FloatArray:
        values = self.unknowns.values(x)
        gains = values["torque_gain_common"] + values["torque_gain"]
        return self._swung @ np.concatenate([self.unknowns.inertial(x)[10:], gains]) - self._target

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        of_links, of_gains = np.split(self._swung, [len(self.unknowns.model_links)], axis=1)
        by = {
            "inertial": np.hstack([np.zeros((len(of_links), 10)), of_links]),
            "torque_gain_common": of_gains.sum(axis=1, keepdims=True),
            "torque_gain": of_gains,
        }
        return self.residual(x), self._by_unknowns(x, by)
