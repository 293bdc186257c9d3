"""Statistics of a study: bias, spread, coverage, and the effect of each error source.

A failed calibration counts everywhere: it is not within 5 mm, and its error is larger than any other.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.conventions import AXES, FloatArray
from equipoise.lab.study.rows import SUCCEEDED, Table, column, having, texts
from equipoise.lab.study.study import SOURCES
from equipoise.result.statistics import NORMAL
from equipoise.robot.inertial import COMPONENTS

WITHIN = 5e-3
"""Planar error that the paper claims, and that its balance controller needs [m]."""

LEVELS = (50, 90, 95)
"""Nominal levels of the intervals [%]."""

_TRIALS_PER_SLOPE = 10  # least number


@dataclass(frozen=True)
class Rate:
    """Fraction of cases.

    Attributes:
        count, of: number of positive cases, and of all cases.
    """

    count: int
    of: int

    @property
    def value(self) -> float:
        """Fraction; nan without cases."""
        return self.count / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval, also valid near 0 and 1; from 0 to 1 without cases."""
        if not self.of:
            return 0.0, 1.0
        z, n = NORMAL[95], self.of
        middle = (self.value + z**2 / (2 * n)) / (1 + z**2 / n)
        half_width = z / (1 + z**2 / n) * np.sqrt(self.value * (1 - self.value) / n + z**2 / (4 * n**2))
        return max(0.0, float(middle - half_width)), min(1.0, float(middle + half_width))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {"count": self.count, "of": self.of, "rate": self.value, "interval_95": list(self.interval)}


@dataclass(frozen=True)
class ErrorStatistics:
    """Errors of one quantity, estimate minus truth.

    Attributes:
        quantity: name of a component, "planar CoM", or a moment of the paper's excitations.
        unit: unit of the errors.
        count: number of calibrations with an estimate.
        bias, rms: mean and root mean square of the error over those.
        percentile_95: 95th percentile of the absolute error over all calibrations; infinite if more than 5 % failed.
        coverage: fraction of intervals that contain the truth, by nominal level; empty without intervals.
    """

    quantity: str
    unit: str
    count: int
    bias: float
    rms: float
    percentile_95: float
    coverage: dict[int, Rate]


@dataclass(frozen=True)
class MethodSummary:
    """Results of a method over all trials.

    Attributes:
        method: name of the method.
        trials: number of trials.
        failures: number of failures, by kind.
        reasons: message of the first failure of each kind.
        within_5_mm: calibrations within 5 mm of the true planar CoM; failures count as outside.
        errors: statistics of the errors, by quantity.
        robot_time, cpu_time: medians over successful calibrations [s].
    """

    method: str
    trials: int
    failures: dict[str, int]
    reasons: dict[str, str]
    within_5_mm: Rate
    errors: tuple[ErrorStatistics, ...]
    robot_time: float
    cpu_time: float

    def error(self, quantity: str) -> ErrorStatistics | None:
        """Return the statistics of a quantity, or None."""
        return next((error for error in self.errors if error.quantity == quantity), None)


@dataclass(frozen=True)
class Slope:
    """Effect of one error source on the planar CoM: rms error = slope x size, without the shares of other sources.

    Attributes:
        method: name of the method.
        source: name of the column of the source's size.
        slope: slope of the error over the source's size [m per unit of the source].
        std: standard error of the slope, by bootstrap.
    """

    method: str
    source: str
    slope: float
    std: float


def summarize(rows: Table) -> list[MethodSummary]:
    """Return a summary of each method, in order of appearance."""
    return [_summary(method, having(rows, "method", method)) for method in dict.fromkeys(texts(rows, "method"))]


def planar_errors(rows: Table) -> FloatArray:
    """Return the (n,) distance of the planar CoM from the truth [m]; nan without an estimate."""
    errors = [column(rows, f"estimated_{name}") - column(rows, f"true_{name}") for name in ("com_x", "com_y")]
    return np.hypot(*errors)


def _summary(method: str, rows: Table) -> MethodSummary:
    succeeded = having(rows, "status", SUCCEEDED)
    failures = Counter(status for status in texts(rows, "status") if status != SUCCEEDED)
    planar = planar_errors(rows)
    errors: list[ErrorStatistics] = []
    if np.isfinite(planar).any():
        errors.append(_statistics("planar CoM", "mm", 1000 * planar, failures.total(), None))
    for name in COMPONENTS:
        unit, factor = _unit_of(name, rows)
        error = column(rows, f"estimated_{name}") - column(rows, f"true_{name}")
        if np.isfinite(error).any():
            relative = error / column(rows, f"std_{name}")
            errors.append(_statistics(name, unit, error * factor, failures.total(), relative))
    for axis, name in zip(AXES, ("Ixx", "Iyy", "Izz"), strict=True):
        moment = column(rows, f"moment_{axis}")
        if np.isfinite(moment).any():
            for body, truth in (("whole", f"true_{name}"), ("no shanks", f"true_stance_effective_{axis}")):
                relative = 100 * (moment / column(rows, truth) - 1)
                errors.append(_statistics(f"I {axis}, {body}", "%", relative, failures.total(), None))
    return MethodSummary(
        method,
        rows.num_rows,
        dict(failures.most_common()),
        {kind: _reason(having(rows, "status", kind)) for kind, _ in failures.most_common()},
        Rate(int(np.sum(planar <= WITHIN)), rows.num_rows),
        tuple(errors),
        _median(column(succeeded, "robot_time")),
        _median(column(succeeded, "cpu_time")),
    )


def _reason(rows: Table) -> str:
    """Return number and message of the first failed trial, with the last line of a traceback."""
    trial, message = rows["trial"][0].as_py(), rows["message"][0].as_py()
    return f"trial {trial}: {((message or '').splitlines() or ['no message'])[-1]}"


def _unit_of(component: str, rows: Table) -> tuple[str, FloatArray | float]:
    """Return unit and factor of an error: mm, or percent of the component, or of Ixx for products of inertia."""
    if component.startswith("com"):
        return "mm", 1000.0
    if component in ("Ixy", "Ixz", "Iyz"):
        return "% of Ixx", 100 / column(rows, "true_Ixx")
    return "%", 100 / column(rows, f"true_{component}")


def _statistics(
    quantity: str, unit: str, error: FloatArray, failed: int, relative: FloatArray | None
) -> ErrorStatistics:
    finite = error[np.isfinite(error)]
    sizes = np.concatenate([np.abs(finite), np.full(failed, np.inf)])
    return ErrorStatistics(
        quantity,
        unit,
        len(finite),
        float(finite.mean()),
        float(np.sqrt(np.mean(finite**2))),
        float(np.quantile(sizes, 0.95, method="inverted_cdf")),
        {} if relative is None else _coverage(relative[np.isfinite(relative)]),
    )


def _coverage(relative: FloatArray) -> dict[int, Rate]:
    if not relative.size:
        return {}
    return {level: Rate(int(np.sum(np.abs(relative) <= NORMAL[level])), relative.size) for level in LEVELS}


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else float("nan")


def varied_sources(rows: Table) -> list[str]:
    """Return the columns of sources with different sizes between trials, with a varied payload mass if there are any."""
    varied = [f"size_{name}" for name in SOURCES if np.ptp(column(rows, f"size_{name}")) > 0]
    payload = column(rows, "payload_mass")
    return [*varied, "payload_mass"] if varied and np.ptp(payload) > 0 else varied


def slopes(rows: Table, method: str, resamples: int = 200) -> list[Slope]:
    """Fit the slope of the planar CoM error over the size of each varied source.

    Independent errors add in squares: the mean squared error is a constant plus the sum of (slope x size) squared. Slopes
    are from non-negative least squares, their standard errors from a bootstrap over trials.
    """
    chosen = having(having(rows, "method", method), "status", SUCCEEDED)
    sources = varied_sources(chosen) if chosen.num_rows else []
    if not sources or chosen.num_rows < _TRIALS_PER_SLOPE * len(sources):
        return []
    sizes = np.column_stack([column(chosen, source) for source in sources])
    errors = planar_errors(chosen)
    generator = np.random.default_rng(0)
    picks = (generator.choice(len(chosen), len(chosen)) for _ in range(resamples))
    drawn = np.array([lines_in_squares(sizes[picked], errors[picked])[1] for picked in picks])
    return [
        Slope(method, source, float(slope), float(std))
        for source, slope, std in zip(sources, lines_in_squares(sizes, errors)[1], drawn.std(axis=0), strict=True)
    ]


def lines_in_squares(sizes: FloatArray, errors: FloatArray) -> tuple[float, FloatArray]:
    """Fit floor and (k,) slopes of rms error = root of (floor squared + the sum of (slope x size) squared).

    The fit is weighted, because the scatter of squared errors is proportional to their size.

    Args:
        sizes: (n, k) sizes of the k sources in n trials.
        errors: (n,) errors of the trials.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 - a third of a second to import

    units, scale = np.sqrt(np.mean(sizes**2, axis=0)), float(np.mean(errors**2))
    design, squares = np.column_stack([(sizes / units) ** 2, np.ones(len(errors))]), errors**2 / scale
    expected = np.maximum(design @ nnls(design, squares)[0], 1e-3)
    shares = np.sqrt(nnls(design / expected[:, None], squares / expected)[0] * scale)
    return float(shares[-1]), shares[:-1] / units
