"""Quantity: one number that was found, how sure it is, and what it is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace

from equipoise.result.statistics import NORMAL_95


@dataclass(frozen=True)
class Quantity:
    """One number, in SI units. None stands for what is not known.

    Attributes:
        name: name of the quantity: "mass", "com_x", "Ixx", ...
        unit: SI unit of the numbers below: "kg", "m", "kg m2", ...
        value: estimate; None: the method does not estimate it.
        std: posterior standard deviation of the value; None: the method gives none.
        verdict: "identified", "weak" or "not identified": how much the run told beyond what was believed before; "doubtful"
            where a check of the run failed; "no change" of a difference that is surely zero.
        model: value by the model file.
        truth: value of the simulated robot.
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
        """Half the 95 % interval."""
        return None if self.std is None else NORMAL_95 * self.std

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lower and upper end of the 95 % interval."""
        return (
            None
            if self.value is None or self.half_width is None
            else (self.value - self.half_width, self.value + self.half_width)
        )

    @property
    def lower(self) -> float | None:
        """Lower end of the 95 % interval."""
        return None if self.interval is None else self.interval[0]

    @property
    def upper(self) -> float | None:
        """Upper end of the 95 % interval."""
        return None if self.interval is None else self.interval[1]

    @property
    def error(self) -> float | None:
        """Estimate less truth."""
        return _difference(self.value, self.truth)

    @property
    def change(self) -> float | None:
        """Estimate less the model file's value."""
        return _difference(self.value, self.model)

    def doubted(self) -> Quantity:
        """Return the quantity as a run gives it of which a check failed."""
        return replace(self, verdict="doubtful") if self.verdict in ("identified", "weak") else self

    @property
    def missed(self) -> bool:
        """True if the ground truth is known and outside the interval."""
        return self.error is not None and self.half_width is not None and abs(self.error) > self.half_width


def _difference(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a - b
