"""Estimates of the CoM during a run, after each trial, and the plane from each lift."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import SupportPlane


@dataclass(frozen=True, eq=False)
class LiftPlane:
    """Constraint on the CoM from one lift.

    Attributes:
        trial: index of the lift's recording.
        diagonal: diagonal that the robot stood on.
        plane: plane in the base frame at the nominal stance; it contains the CoM, or, with a verdict, the support line.
        verdict: direction in which the robot tipped, and so the side of the CoM; None: the plane contains the CoM.
    """

    trial: int
    diagonal: str
    plane: SupportPlane
    verdict: str | None = None


@dataclass(frozen=True, eq=False)
class ComEstimate:
    """Estimate of the CoM after a number of trials.

    Attributes:
        trials: number of complete recordings used.
        com: (3,) CoM of the whole robot at the nominal stance, in the base frame [m].
        half_width: (3,) half width of the 95 % interval, or of the bracket [m]; nan if not estimated.
        covariance: (3, 3) covariance of the CoM [m2], or None.
        brackets: bounds of the offset by diagonal [m], if the method has them.
    """

    trials: int
    com: FloatArray
    half_width: FloatArray
    covariance: FloatArray | None = None
    brackets: dict[str, tuple[float, float]] = field(default_factory=dict[str, "tuple[float, float]"])


class Reading(Protocol):
    """Interface to a method's estimates during a run."""

    def planes(self) -> list[LiftPlane]:
        """Return the planes of all lifts, in order."""
        ...

    def estimate(self, trials: int) -> ComEstimate:
        """Return the estimate from the first `trials` trials; raises EquipoiseError if they are not sufficient."""
        ...
