"""Body: mass, centre of mass and inertia of one body, each number a quantity, and the arrays of them."""

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
from equipoise.result.statistics import verdict_of
from equipoise.robot.inertial import COMPONENTS, InertialParameters, RobotInertia, components

BODIES = tuple(field.name for field in dataclasses.fields(RobotInertia))
"""Names of the bodies of a result; its attributes."""

_UNITS = ("kg", *3 * ("m",), *6 * ("kg m2",))


class _Group:
    """Quantities that belong together: in a loop, or as arrays with nan for what is not known."""

    def __iter__(self) -> Iterator[Quantity]:
        """The quantities, in the order of the fields."""
        return iter(vars(self).values())

    def _array(self, attribute: str) -> FloatArray:
        known = (getattr(quantity, attribute) for quantity in self)
        return np.array([np.nan if value is None else value for value in known])

    @property
    def values(self) -> FloatArray:
        """Estimates."""
        return self._array("value")

    @property
    def stds(self) -> FloatArray:
        """Posterior standard deviations."""
        return self._array("std")

    @property
    def errors(self) -> FloatArray:
        """Estimates less truth."""
        return self._array("error")


@dataclass(frozen=True)
class CentreOfMass(_Group):
    """A centre of mass; arrays are (3,) [m].

    Attributes:
        x, y, z: coordinates [m].
    """

    x: Quantity
    y: Quantity
    z: Quantity


@dataclass(frozen=True)
class InertiaTensor(_Group):
    """An inertia tensor about a centre of mass; arrays are (3, 3) [kg m2].

    Attributes:
        Ixx, Iyy, Izz: moments of inertia [kg m2].
        Ixy, Ixz, Iyz: entries off the diagonal [kg m2].
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
        """Ixx, Iyy, Izz."""
        return self.Ixx, self.Iyy, self.Izz


@dataclass(frozen=True, eq=False)
class Body(_Group):
    """One body's inertial parameters; in a loop the ten quantities in the order of COMPONENTS, arrays are (10,).

    Attributes:
        mass: mass of the body [kg].
        com_in_base: centre of mass in the base frame [m].
        inertia: inertia tensor about the CoM in base axes [kg m2].
        covariance: (10, 10) covariance of the ten quantities, SI units; None: the method gives none.
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
        """From arrays; nan stands for what is not known.

        Args:
            values: (10,) estimates in the order of COMPONENTS, SI units.
            covariance: (10, 10) covariance of the values.
            compared_with: (10,) sizes that the standard deviations are compared with, in the values' units.
            model: body by the model file.
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
    def known(
        cls,
        parameters: InertialParameters,
        covariance: FloatArray | None = None,
        compared_with: ArrayLike | None = None,
        model: InertialParameters | None = None,
    ) -> Body:
        """With everything estimated; the arguments of `of`."""
        return cls.of(components(parameters), covariance, compared_with, model)

    @classmethod
    def partly(
        cls,
        model: InertialParameters | None = None,
        mass: float | None = None,
        com_in_base: Sequence[float | None] = (None, None, None),
    ) -> Body:
        """With a mass [kg] and coordinates of the CoM [m] estimated at most, and no intervals."""
        return cls.of(_with_nan([mass, *com_in_base, *6 * [None]]), model=model)

    @classmethod
    def _of(cls, ten: Sequence[Quantity], covariance: FloatArray | None) -> Body:
        return cls(ten[0], CentreOfMass(*ten[1:4]), InertiaTensor(*ten[4:]), covariance)

    def __iter__(self) -> Iterator[Quantity]:
        """The ten, in the order of COMPONENTS."""
        return iter((self.mass, *self.com_in_base, *self.inertia))

    def _with(self, **columns: Sequence[Any] | FloatArray) -> Body:
        """Return the body with other attributes of its ten quantities, by column; nan stands for None."""
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        ten = [
            dataclasses.replace(quantity, **{name: _without_nan(value) for name, value in row.items()})
            for quantity, row in zip(self, rows, strict=True)
        ]
        return self._of(ten, self.covariance)

    def with_sure_zeros(self, sizes: FloatArray) -> Body:
        """Return differences with the verdict "no change" where zero lies in an interval that is narrow enough.

        Args:
            sizes: (10,) halves of intervals that are narrow enough.
        """

        def verdict(one: Quantity, size: float) -> str | None:
            sure = one.value is not None and one.half_width is not None and abs(one.value) <= one.half_width <= size
            return "no change" if sure else one.verdict

        return self._with(verdict=[verdict(one, float(size)) for one, size in zip(self, sizes, strict=True)])

    def with_truth(self, truth: InertialParameters | None) -> Body:
        """Return the body with the ground truth; None removes it."""
        return self._with(truth=10 * [None] if truth is None else components(truth))

    def with_model(self, model: InertialParameters) -> Body:
        """Return the body with another body of the model file."""
        return self._with(model=components(model))

    @property
    def model(self) -> InertialParameters | None:
        """The body by the model file."""
        return _parameters(self._array("model"))

    @property
    def truth(self) -> InertialParameters | None:
        """The simulated body."""
        return _parameters(self._array("truth"))

    def parameters(self) -> InertialParameters:
        """Return the inertial parameters; raises NotEstimatedError if one is missing, and names it."""
        missing = ["mass"] if self.mass.value is None else []
        missing += ["inertia"] if any(quantity.value is None for quantity in self.inertia) else []
        missing += [
            f"com_in_base.{axis}" for axis, one in zip("xyz", self.com_in_base, strict=True) if one.value is None
        ]
        if missing:
            raise NotEstimatedError(
                f"this calibration does not know {', '.join(missing)}; its method does not estimate it"
            )
        return InertialParameters.from_components(self.values)

    def doubted(self, least: FloatArray | float = 0.0) -> Body:
        """Return the body as a run gives it of which a check failed.

        Args:
            least: (10,) smallest standard deviations, in the order of COMPONENTS; correlations stay.
        """
        factor = np.maximum(1.0, least / self.stds)
        covariance = None if self.covariance is None else _read_only(self.covariance * np.outer(factor, factor))
        wider = self._with(std=factor * self.stds)
        return self._of([one.doubted() for one in wider], covariance)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, with `uncertainty`; None: the method gives none."""
        intervals = self.intervals()
        covariance = None if self.covariance is None else self.covariance.tolist()
        uncertainty = {"intervals": intervals, "covariance": covariance} if intervals else None
        return {**self.numbers(), "uncertainty": uncertainty}

    def intervals(self) -> dict[str, Any]:
        """JSON form of deviation, 95 % interval and verdict, by name, of the quantities that have them."""
        return {
            one.name: {"std": one.std, "lower": one.lower, "upper": one.upper, "verdict": one.verdict}
            for one in self
            if one.std is not None
        }

    def numbers(self, attribute: str = "value") -> dict[str, Any]:
        """JSON form of one attribute of the ten: `mass`, `com_in_base` as a list, `inertia` as 3 rows of 3 or None."""
        mass, *com = (getattr(quantity, attribute) for quantity in (self.mass, *self.com_in_base))
        rows = self.inertia._array(attribute)  # pyright: ignore[reportPrivateUsage]
        return {"mass": mass, "com_in_base": com, "inertia": rows.tolist() if np.isfinite(rows).all() else None}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Body:
        """Return the body of a JSON form."""
        body = cls.of(_components_of(table))
        uncertainty = table["uncertainty"]
        if uncertainty is None:
            return body
        known = uncertainty["intervals"]
        body = body._with(
            std=[known[name]["std"] if name in known else None for name in COMPONENTS],
            verdict=[known[name]["verdict"] if name in known else None for name in COMPONENTS],
        )
        covariance = uncertainty["covariance"]
        return body if covariance is None else dataclasses.replace(body, covariance=_read_only(covariance))


def _components_of(table: Mapping[str, Any]) -> FloatArray:
    """(10,) in the order of COMPONENTS, from the JSON form."""
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
        raise ValueError(f"a covariance is (10, 10), not {array.shape}")
    array.setflags(write=False)
    return array
