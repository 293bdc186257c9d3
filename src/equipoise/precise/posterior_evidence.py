"""What the precise method leaves beside its result."""

from __future__ import annotations

from dataclasses import dataclass

from equipoise.precise.measurements.evidence import MotionReading
from equipoise.precise.posterior import Posterior
from equipoise.result.calibration import Evidence


@dataclass(frozen=True, eq=False)
class PosteriorEvidence(Evidence):
    """Of a run of this method.

    Attributes:
        motions: readings of the recordings, in order.
        posterior: estimate with its information by motion.
    """

    motions: tuple[MotionReading, ...]
    posterior: Posterior
