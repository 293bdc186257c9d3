"""Estimates of the CoM during a run: one after each trial, and the plane that each lift adds."""

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
        plane: plane in the base frame at the nominal stance, that holds the CoM, or, with a verdict, the support line.
        verdict: direction in which the robot tipped, so the side that the CoM is on; None: the plane holds the CoM.
    """

    trial: int
    diagonal: str
    plane: SupportPlane
    verdict: str | None = None


@dataclass(frozen=True, eq=False)
class ComEstimate:
    """Estimate of the CoM after a number of trials.

    Attributes:
        trials: number of complete recordings that it is from.
        com: (3,) CoM of the whole robot at the nominal stance, in the base frame [m].
        half_width: (3,) half width of the 95 % interval, or of the bracket [m]; nan where the method does not estimate it.
        covariance: (3, 3) covariance of the CoM [m2], or None.
        brackets: bounds of the offset, by diagonal [m], where the method has them.
    """

    trials: int
    com: FloatArray
    half_width: FloatArray
    covariance: FloatArray | None = None
    brackets: dict[str, tuple[float, float]] = field(default_factory=dict[str, "tuple[float, float]"])


class Reading(Protocol):
    """A method's reading of the trials so far."""

    def planes(self) -> list[LiftPlane]:
        """Return the planes of all lifts, in order."""
        ...

    def estimate(self, trials: int) -> ComEstimate:
        """After the first trials; raises EquipoiseError where they do not tell."""
        ...
