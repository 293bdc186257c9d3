"""Posterior of a run as the prior of the next run of the same robot.

Sensors, legs and friction keep their posterior, widened by possible changes (`drift` and `switched` of the parameter table).
The clock and the floor get their usual priors, and so does the base, which may carry a payload.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError, RecordingError, SettingsError, reason
from equipoise.estimator.unknowns import ROBOT, SCALE, Priors, Unknown, Values, unknown
from equipoise.json_form import from_json
from equipoise.user_file import check_schema, json_value, kind_of, read_text, typed

if TYPE_CHECKING:  # flags are read without an estimator
    from equipoise.estimator.parameters import PriorDistribution, Unknowns
    from equipoise.estimator.problem import Posterior
    from equipoise.robot.inertial import InertialParameters
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance

POSTERIOR = "posterior.json"
SCHEMA = "equipoise.posterior/1"
SCALE_GAIN, SCALE_NOISE = 0.005, 0.001
"""Standard deviations of a scale's gain, and of a single reading without it, as fractions."""
_SCALE = "scale_gain"
# Prior of the base's inertia, which short runs hardly determine: 2.5 kg at a distance of 0.1 m add half of it.
_INERTIA = 0.5


@dataclass(frozen=True)
class PriorsWithScale(Priors):
    """Priors of a robot that is weighed again on the same scale."""

    scale_gain: float = unknown(
        SCALE_GAIN, "reading of the scale over the robot's mass, less one", "", ROBOT,
        "assumed: scales for tens of kilograms are accurate within half a percent", SCALE,
        label="gain of the scale", checked=False,
    )  # fmt: skip


def is_kept(row: Unknown) -> bool:
    """Return True if a row keeps its posterior for the next run."""
    return row.drift is not None


@dataclass(frozen=True)
class PriorRun:
    """Posterior of a prior run, as JSON values.

    Attributes:
        robot: name of the robot.
        model: hash of its model file and robot configuration.
        leg_prior: prior of the leg parameters in that run, "wide" or "narrow".
        weighed: mass of the whole robot from a scale in that run [kg]; None: it was not weighed.
        priors: prior standard deviations of the rows that were not fixed, by name, in order.
        x: (size,) posterior mode, in the layout of `Unknowns`.
        covariance: lower triangle of the (size, size) covariance of x, row by row.
        shown: lower triangle of the covariance at the noise of stance motions that their residuals show. Model errors beyond
            this noise, such as sagging springs, repeat in the next run and do not hide a change.
        run: folder of that run.
        schema: version of this form.
    """

    robot: str
    model: str
    leg_prior: str
    weighed: float | None
    priors: Mapping[str, float]
    x: Sequence[float]
    covariance: Sequence[Sequence[float]]
    shown: Sequence[Sequence[float]]
    run: str = field(default="", compare=False)
    schema: str = SCHEMA

    def __post_init__(self) -> None:
        size = len(self.x)
        if not np.isfinite(np.asarray(self.x, dtype=float)).all():
            raise SettingsError("its parameters are not finite")
        for rows in (self.covariance, self.shown):
            if size < 10 or [len(row) for row in rows] != [*range(1, size + 1)]:
                raise SettingsError(f"its covariance of {size} parameters does not have rows of 1 to {size} numbers")
        try:
            np.linalg.cholesky(self.spread)
            np.linalg.cholesky(self.shown_spread)
        except np.linalg.LinAlgError as error:
            raise SettingsError(f"its covariance is not positive definite: {error}") from error

    @classmethod
    def of(cls, posterior: Posterior, settings: Mapping[str, Any], run: str = "") -> PriorRun:
        """Return the prior run of an estimate.

        Args:
            settings: settings of the method, as JSON values.
        """
        unknowns = posterior.unknowns
        before: Mapping[str, Any] = settings.get("prior_run") or {}
        return cls(
            unknowns.robot.name, model_hash(unknowns.robot), before.get("leg_prior") or settings["leg_prior"],
            settings["mass"], {row.name: getattr(unknowns.priors, row.name) for row in unknowns.rows}, posterior.x.tolist(),
            _lower_triangle(posterior.covariance), _lower_triangle(_at_shown_noise(posterior)), run,
        )  # fmt: skip

    @classmethod
    def read(cls, path: Path) -> PriorRun:
        """Read a run folder.

        Raises:
            RecordingError: the folder is not a run, or the run has no result, is damaged, or is of another version.
            SettingsError: the run is of another method.
        """
        try:
            table = json_value(read_text(path / POSTERIOR))
            check_schema(table["schema"], SCHEMA, f"--prior-run {path}: its {POSTERIOR}")
            return replace(from_json(cls, table), run=str(path))
        except (FileNotFoundError, NotADirectoryError) as error:
            raise _no_posterior_error(path) from error
        except OSError as error:
            raise RecordingError(f"--prior-run {path}: its {POSTERIOR} cannot be read: {error.strerror}") from error
        except RecordingError:
            raise
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(
                f"--prior-run {path}: its {POSTERIOR} is damaged ({reason(error)}); delete it, and create it again with: "
                f"equipoise estimate {typed(path)}"
            ) from error

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return asdict(self)

    @property
    def name(self) -> str:
        """Name in reports."""
        return self.run or "the prior run"

    @property
    def reference(self) -> dict[str, Any]:
        """Identification of the run among settings, with a hash of its estimate."""
        digest = hashlib.sha256(json.dumps([*self.x]).encode()).hexdigest()
        return {"run": self.run, "robot": self.robot, "leg_prior": self.leg_prior, "sha256": digest}

    @cached_property
    def spread(self) -> FloatArray:
        """(size, size) covariance of x."""
        return _whole(self.covariance)

    @cached_property
    def shown_spread(self) -> FloatArray:
        """(size, size) covariance of x at the noise that residuals show."""
        return _whole(self.shown)

    def check(self, robot: RobotModel) -> None:
        """Raise SettingsError for a robot with another model file or configuration."""
        if self.model != model_hash(robot):
            raise SettingsError(
                f"--prior-run {self.run or 'run'} is of {self.robot!r}, with another model file or robot configuration than "
                f"{robot.name!r} here; use a run of the same robot, or leave --prior-run out"
            )

    @property
    def base_body(self) -> InertialParameters:
        """Base in the prior run."""
        from equipoise.estimator.parameters import base_vector  # noqa: PLC0415
        from equipoise.robot.inertial import InertialParameters  # noqa: PLC0415

        return InertialParameters.from_vector(base_vector(np.array(self.x[:10])))

    def priors_of(self, priors: Priors, weighed_again: bool) -> Priors:
        """Return the priors of a later run: kept rows have those of this run, and are fixed if it fixed them.

        Args:
            priors: priors of the other rows.
            weighed_again: True if the robot is weighed on the same scale, or its mass is known relative to this run's.
        """
        kept = {row.name: self.priors.get(row.name, 0.0) for row in Priors.rows() if is_kept(row)}
        combined = replace(priors, **kept, inertia=min(priors.inertia, _INERTIA))
        if not weighed_again:
            return combined
        return PriorsWithScale(**{each.name: getattr(combined, each.name) for each in fields(Priors)})

    def earlier(self, unknowns: Unknowns, shown: bool = False) -> tuple[FloatArray, FloatArray, Unknowns]:
        """Return mode, covariance and layout of the prior run, with the gain of the scale if `unknowns` has it.

        Args:
            shown: True for the covariance at the noise that residuals show.
        """
        from equipoise.estimator.parameters import Unknowns  # noqa: PLC0415
        from equipoise.estimator.problem import total_mass  # noqa: PLC0415

        base = PriorsWithScale if _SCALE in self.priors else Priors
        fixed = dict.fromkeys((row.name for row in base.rows()), 0.0)
        layout = Unknowns(unknowns.robot, unknowns.stance, base(**{**fixed, **self.priors}))
        x, spread = np.array(self.x), self.shown_spread if shown else self.spread
        if _SCALE in self.priors or not unknowns.has(_SCALE):
            return x, spread, layout
        # The gain of the scale is its reading over the estimated mass.
        total, derivative = total_mass(layout, x)
        weighed = float(self.weighed or total)
        by_x = np.vstack([np.eye(len(x)), -weighed / total**2 * derivative / SCALE_GAIN])
        spread = by_x @ spread @ by_x.T
        spread[-1, -1] += (SCALE_NOISE / SCALE_GAIN) ** 2
        both = Unknowns(unknowns.robot, unknowns.stance, PriorsWithScale(**{**fixed, **self.priors}))
        return np.append(x, (weighed / total - 1) / SCALE_GAIN), spread, both

    def values(self, robot: RobotModel, stance: Stance) -> Values:
        """Return the parameters of sensors, legs and friction, by name."""
        x, _, layout = self._own(robot, stance)
        return layout.values(x)

    def mass(self, robot: RobotModel, stance: Stance) -> float:
        """Return the mass of the whole robot: the scale's reading, or without one the estimate [kg]."""
        from equipoise.estimator.problem import total_mass  # noqa: PLC0415

        x, _, layout = self._own(robot, stance)
        return self.weighed or total_mass(layout, x)[0]

    def _own(self, robot: RobotModel, stance: Stance) -> tuple[FloatArray, FloatArray, Unknowns]:
        """Return mode, covariance and layout of this run."""
        from equipoise.estimator.parameters import Unknowns  # noqa: PLC0415

        return self.earlier(Unknowns(robot, stance, Priors()))

    def torque_gains(self, robot: RobotModel, stance: Stance) -> tuple[FloatArray, float]:
        """Return the (nj,) true over reported torques of all joints, and the standard deviation of their mean."""
        x, spread, layout = self._own(robot, stance)
        values = layout.values(x)
        gains = 1 + values["torque_gain_common"] + values["torque_gain"]
        mean = np.zeros(layout.size)
        for name in ("torque_gain_common", "torque_gain"):
            mean[layout[name]] = layout.scale[layout[name]] / max(1, layout[name].stop - layout[name].start)
        return gains, float(np.sqrt(mean @ spread @ mean))

    def distribution(
        self, unknowns: Unknowns, changed: Mapping[int, float] | None = None, shown: bool = False
    ) -> PriorDistribution:
        """Return the prior of a later run.

        Args:
            changed: variance to add for a changed parameter, by its index.
            shown: as in `earlier`.
        """
        from equipoise.estimator.parameters import PriorDistribution  # noqa: PLC0415

        x, spread, layout = self.earlier(unknowns, shown)
        mean, covariance = np.zeros(unknowns.size), np.eye(unknowns.size)
        here, there = shared_places(unknowns, layout)
        mean[here], covariance[np.ix_(here, here)] = x[there], spread[np.ix_(there, there)]
        covariance[here, here] += [change**2 for change in _changes(unknowns, here)]
        for place, variance in (changed or {}).items():
            covariance[place, place] += variance
        rows = unknowns.tabled
        return PriorDistribution(mean[rows], covariance[rows, rows])


def _at_shown_noise(posterior: Posterior) -> FloatArray:
    """Return the (size, size) covariance at the noise that residuals show."""
    shown = posterior.problem.at_residual_noise(posterior.x)
    return np.asarray(np.linalg.inv(shown.normal_equations(posterior.x).information), dtype=float)


def _lower_triangle(rows: FloatArray) -> list[list[float]]:
    return [row[: index + 1] for index, row in enumerate(rows.tolist())]


def _whole(rows: Sequence[Sequence[float]]) -> FloatArray:
    lower = np.zeros((len(rows), len(rows)))
    lower[np.tril_indices(len(rows))] = np.concatenate([np.asarray(row, dtype=float) for row in rows])
    return lower + np.tril(lower, -1).T


def shared_places(unknowns: Unknowns, layout: Unknowns) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of kept parameters in a run's layout and in that of its prior run."""
    names = [row.name for row in unknowns.rows if is_kept(row) and layout.has(row.name) and layout.estimates(row.name)]
    return unknowns.columns(*names), layout.columns(*names)


def _changes(unknowns: Unknowns, places: NDArray[np.intp]) -> FloatArray:
    """Return the standard deviations of the changes of kept parameters between two runs, in units of their priors."""
    of_all = np.zeros(unknowns.size)
    for row in unknowns.rows:
        of_all[unknowns[row.name]] = np.hypot(row.drift or 0.0, row.switched)
    return of_all[places]


def model_hash(robot: RobotModel) -> str:
    """Return the hash of a robot's model file and configuration."""
    return hashlib.sha256(f"{robot.source.xml}\0{robot.description!r}".encode()).hexdigest()


def _no_posterior_error(path: Path) -> EquipoiseError:
    """Return the error for a folder without a posterior."""
    try:
        header = json_value(read_text(path / "run.json"))
        method = header["settings"]["method"]
    except (OSError, ValueError, KeyError, TypeError):
        return RecordingError(f"--prior-run {path}: it {kind_of(path)}; name the run folder of a calibration")
    if method != "bayesian":
        return SettingsError(
            f"--prior-run {path}: this run is of the method {method!r}; use a run of 'bayesian', which estimates sensor errors"
        )
    if not (path / "calibration.json").exists():
        return RecordingError(
            f"--prior-run {path}: this run has no result; continue it with: equipoise calibrate --resume {typed(path)}"
        )
    return RecordingError(
        f"--prior-run {path}: this run has no {POSTERIOR}; create it with: equipoise estimate {typed(path)}"
    )
