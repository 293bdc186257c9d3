"""Mass, centre of mass and inertia of one body, as quantities and as arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import NORMAL_95, verdict_of
from equipoise.robot.inertial import COMPONENTS, InertialParameters, RobotInertia, components

BODIES = tuple(field.name for field in dataclasses.fields(RobotInertia))
"""Names of the bodies of a result, which are attributes of `Calibration`."""

_UNITS = ("kg", *3 * ("m",), *6 * ("kg m2",))


class _Group:
    """Group of quantities, iterable, with arrays in which nan stands for a missing value."""

    def __iter__(self) -> Iterator[Quantity]:
        """Iterate over the quantities in the order of the fields."""
        return iter(vars(self).values())

    def _array(self, attribute: str) -> FloatArray:
        entries = (getattr(quantity, attribute) for quantity in self)
        return np.array([np.nan if value is None else value for value in entries])

    @property
    def values(self) -> FloatArray:
        """Estimates, in SI units."""
        return self._array("value")

    @property
    def stds(self) -> FloatArray:
        """Posterior standard deviations, in SI units."""
        return self._array("std")

    @property
    def errors(self) -> FloatArray:
        """Estimates minus ground truth, in SI units."""
        return self._array("error")


@dataclass(frozen=True)
class CentreOfMass(_Group):
    """Centre of mass in the base frame; arrays are (3,) [m].

    Attributes:
        x, y, z: coordinates [m].
    """

    x: Quantity
    y: Quantity
    z: Quantity


@dataclass(frozen=True)
class InertiaTensor(_Group):
    """Inertia tensor about the CoM in base axes; arrays are (3, 3) [kg m2].

    Attributes:
        Ixx, Iyy, Izz: moments of inertia [kg m2].
        Ixy, Ixz, Iyz: off-diagonal entries (not negated) [kg m2].
    """

    Ixx: Quantity
    Iyy: Quantity
    Izz: Quantity
    Ixy: Quantity
    Ixz: Quantity
    Iyz: Quantity

    def _array(self, attribute: str) -> FloatArray:
        xx, yy, zz, xy, xz, yz = super()._array(attribute)
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def moments(self) -> tuple[Quantity, Quantity, Quantity]:
        """Moments of inertia Ixx, Iyy, Izz [kg m2]."""
        return self.Ixx, self.Iyy, self.Izz


@dataclass(frozen=True, eq=False)
class Body(_Group):
    """Inertial parameters of one body.

    Iteration yields its ten quantities in the order of COMPONENTS; arrays are (10,).

    Attributes:
        mass: mass of the body [kg].
        com_in_base: centre of mass in the base frame [m].
        inertia: inertia tensor about the CoM in base axes [kg m2].
        covariance: (10, 10) covariance of the ten quantities, SI units; None if the method does not compute it.
    """

    mass: Quantity
    com_in_base: CentreOfMass
    inertia: InertiaTensor
    covariance: FloatArray | None = None

    @classmethod
    def of(
        cls,
        values: ArrayLike,
        covariance: FloatArray | None = None,
        compared_with: ArrayLike | None = None,
        model: InertialParameters | None = None,
    ) -> Body:
        """Return a body from arrays, in which nan stands for a missing value.

        Args:
            values: (10,) estimates in the order of COMPONENTS, SI units.
            covariance: (10, 10) covariance of the values.
            compared_with: (10,) references for the verdicts on the standard deviations, SI units.
            model: body of the model file.
        """
        table: dict[str, Any] = {"value": np.asarray(values, dtype=float)}
        if covariance is not None:
            table["std"] = np.sqrt(np.diag(covariance))
        if model is not None:
            table["model"] = components(model)
        unknown = cls._of([Quantity(name, unit) for name, unit in zip(COMPONENTS, _UNITS, strict=True)], None)
        body = unknown._with(**table)
        if compared_with is not None:
            sizes = np.asarray(compared_with, dtype=float)
            verdicts = [
                None if quantity.std is None else verdict_of(quantity.std, float(size))
                for quantity, size in zip(body, sizes, strict=True)
            ]
            body = body._with(verdict=verdicts)
        if covariance is None or not np.isfinite(covariance).all():
            return body
        return dataclasses.replace(body, covariance=_read_only(covariance))

    @classmethod
    def complete(
        cls,
        parameters: InertialParameters,
        covariance: FloatArray | None = None,
        compared_with: ArrayLike | None = None,
        model: InertialParameters | None = None,
    ) -> Body:
        """Return a body with all ten parameters estimated; arguments as in `of`."""
        return cls.of(components(parameters), covariance, compared_with, model)

    @classmethod
    def partial(
        cls, model: InertialParameters | None = None, com_in_base: Sequence[float | None] = (None, None, None)
    ) -> Body:
        """Return a body without mass, inertia or intervals, from CoM coordinates in the base frame [m]."""
        return cls.of(_with_nan([None, *com_in_base, *6 * [None]]), model=model)

    @classmethod
    def _of(cls, ten: Sequence[Quantity], covariance: FloatArray | None) -> Body:
        return cls(ten[0], CentreOfMass(*ten[1:4]), InertiaTensor(*ten[4:]), covariance)

    def __iter__(self) -> Iterator[Quantity]:
        """Iterate over the ten quantities in the order of COMPONENTS."""
        return iter((self.mass, *self.com_in_base, *self.inertia))

    def _with(self, **columns: Sequence[Any] | FloatArray) -> Body:
        """Return the body with the given attributes of its ten quantities replaced; nan becomes None."""
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        ten = [
            dataclasses.replace(quantity, **{name: _without_nan(value) for name, value in row.items()})
            for quantity, row in zip(self, rows, strict=True)
        ]
        return self._of(ten, self.covariance)

    def with_sure_zeros(self, sizes: FloatArray) -> Body:
        """Return differences with the verdict "no change" for those with zero in a sufficiently narrow interval.

        Args:
            sizes: (10,) largest half widths for this verdict, SI units.
        """
        half_widths = NORMAL_95 * self.stds
        sure = (np.abs(self.values) <= half_widths) & (half_widths <= sizes)  # nan: no interval
        return self._with(verdict=["no change" if zero else one.verdict for one, zero in zip(self, sure, strict=True)])

    def with_truth(self, truth: InertialParameters | None) -> Body:
        """Return the body with the ground truth; None removes it."""
        return self._with(truth=10 * [None] if truth is None else components(truth))

    def with_model(self, model: InertialParameters) -> Body:
        """Return the body with other model values."""
        return self._with(model=components(model))

    @property
    def model(self) -> InertialParameters | None:
        """Body of the model file; None if incomplete."""
        return _parameters(self._array("model"))

    @property
    def truth(self) -> InertialParameters | None:
        """Ground truth of the simulation; None without one."""
        return _parameters(self._array("truth"))

    def parameters(self) -> InertialParameters:
        """Return the inertial parameters; raises NotEstimatedError if one is missing."""
        missing = ["mass"] if self.mass.value is None else []
        missing += ["inertia"] if any(quantity.value is None for quantity in self.inertia) else []
        missing += [
            f"com_in_base.{axis}" for axis, one in zip("xyz", self.com_in_base, strict=True) if one.value is None
        ]
        if missing:
            raise NotEstimatedError(
                f"this calibration does not estimate {', '.join(missing)}; use --method bayesian, with base in --parameters"
            )
        return InertialParameters.from_components(self.values)

    def doubted(self, least: FloatArray | float = 0.0) -> Body:
        """Return the body with the verdict "doubtful", for a run with a failed check.

        Args:
            least: (10,) lower bounds of the standard deviations, in the order of COMPONENTS; correlations are kept.
        """
        factor = np.maximum(1.0, least / self.stds)
        covariance = None if self.covariance is None else _read_only(self.covariance * np.outer(factor, factor))
        wider = self._with(std=factor * self.stds)
        return self._of([one.doubted() for one in wider], covariance)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form; its `uncertainty` is None if the method computes no intervals."""
        intervals = self.intervals()
        covariance = None if self.covariance is None else self.covariance.tolist()
        uncertainty = {"intervals": intervals, "covariance": covariance} if intervals else None
        return {**self.numbers(), "uncertainty": uncertainty}

    def intervals(self) -> dict[str, Any]:
        """Return the JSON form of standard deviation, 95 % interval and verdict, by quantity, where available."""
        return {
            one.name: {"std": one.std, "lower": one.lower, "upper": one.upper, "verdict": one.verdict}
            for one in self
            if one.std is not None
        }

    def numbers(self, attribute: str = "value") -> dict[str, Any]:
        """Return the JSON form of one attribute: `mass`, `com_in_base` (3,) and `inertia` (3, 3) or None."""
        mass, *com = (getattr(quantity, attribute) for quantity in (self.mass, *self.com_in_base))
        rows = self.inertia._array(attribute)  # pyright: ignore[reportPrivateUsage]
        return {"mass": mass, "com_in_base": com, "inertia": rows.tolist() if np.isfinite(rows).all() else None}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Body:
        """Return a body from its JSON form."""
        body = cls.of(_components_of(table))
        uncertainty = table["uncertainty"]
        if uncertainty is None:
            return body
        intervals = uncertainty["intervals"]
        body = body._with(
            std=[intervals[name]["std"] if name in intervals else None for name in COMPONENTS],
            verdict=[intervals[name]["verdict"] if name in intervals else None for name in COMPONENTS],
        )
        covariance = uncertainty["covariance"]
        return body if covariance is None else dataclasses.replace(body, covariance=_read_only(covariance))


def _components_of(table: Mapping[str, Any]) -> FloatArray:
    """Return (10,) values in the order of COMPONENTS from the JSON form."""
    x, y, z = table["com_in_base"]
    rows = table["inertia"]
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = 3 * [3 * [None]] if rows is None else rows
    return _with_nan([table["mass"], x, y, z, xx, yy, zz, xy, xz, yz])


def _parameters(ten: FloatArray) -> InertialParameters | None:
    return InertialParameters.from_components(ten) if np.isfinite(ten).all() else None


def _with_nan(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _without_nan(value: Any) -> Any:
    if value is None or isinstance(value, str):
        return value
    return None if np.isnan(value) else float(value)


def _read_only(rows: ArrayLike) -> FloatArray:
    array = np.array(rows, dtype=float)
    if array.shape != (len(COMPONENTS), len(COMPONENTS)):
        raise ValueError(f"the covariance has shape {array.shape}; it must be (10, 10)")
    array.setflags(write=False)
    return array
