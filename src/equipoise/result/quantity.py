"""Estimate of one number with its uncertainty, model value and ground truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

from equipoise.result.statistics import NORMAL_95


@dataclass(frozen=True)
class Quantity:
    """Scalar estimate in SI units; missing values are None.

    Scalars of a body are in the base frame: CoM from the base's origin, inertia about the CoM in base axes.

    Attributes:
        name: name of the quantity: "mass", "com_x", "Ixx", ...
        unit: SI unit of all its numbers: "kg", "m", "kg m2", ...
        value: estimate; None if the method does not estimate it.
        std: posterior standard deviation; None if the method does not compute it.
        verdict: "identified", "weak" or "not identified", from the ratio of posterior to prior std; "doubtful" if a check
            failed; "no change" for a difference whose narrow interval contains zero.
        model: value of the model file.
        truth: ground truth of the simulation.
    """

    name: str
    unit: str
    value: float | None = None
    std: float | None = None
    verdict: str | None = None
    model: float | None = None
    truth: float | None = None

    @property
    def half_width(self) -> float | None:
        """Half width of the 95 % interval."""
        return None if self.std is None else NORMAL_95 * self.std

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lower and upper bound of the 95 % interval."""
        if self.value is None or self.half_width is None:
            return None
        return self.value - self.half_width, self.value + self.half_width

    @property
    def lower(self) -> float | None:
        """Lower bound of the 95 % interval."""
        return None if self.interval is None else self.interval[0]

    @property
    def upper(self) -> float | None:
        """Upper bound of the 95 % interval."""
        return None if self.interval is None else self.interval[1]

    @property
    def error(self) -> float | None:
        """Estimate minus ground truth."""
        return _difference(self.value, self.truth)

    @property
    def change(self) -> float | None:
        """Estimate minus model value."""
        return _difference(self.value, self.model)

    def doubted(self) -> Quantity:
        """Return the quantity with "doubtful" in place of "identified" or "weak", for a run with a failed check."""
        return replace(self, verdict="doubtful") if self.verdict in ("identified", "weak") else self

    @property
    def missed(self) -> bool:
        """True if the ground truth is known and outside the interval."""
        return self.error is not None and self.half_width is not None and abs(self.error) > self.half_width


def _difference(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a - b
