"""What legs say of themselves that swing in the air: evidence that the motors' method hands over."""

from __future__ import annotations

from dataclasses import dataclass

from equipoise.conventions import FloatArray
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
