"""What a run keeps for the next one of the same robot: its posterior, which becomes a prior.

Sensors, legs and friction of the earlier run are believed, wider by what can change in between: the table of unknowns says
how much (`drift`, `switched`). The clock and the floor begin anew, and so does the base: something may lie on it.
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
from equipoise.estimator.unknown import ROBOT, SCALE, Unknown, unknown
from equipoise.estimator.unknowns import Priors
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
"""Standard deviations of a scale's factor, and of a reading beside it, as fractions."""
_SCALE = "scale_gain"
# Prior of the base's inertia, which half a minute tells little of: two and a half kilograms a decimetre off add half of this.
_INERTIA = 0.5


@dataclass(frozen=True)
class PriorsWithScale(Priors):
    """Priors of a robot that the same scale weighs again."""

    scale_gain: float = unknown(
        SCALE_GAIN, "reading of the scale over the robot's mass, less one", "", ROBOT,
        "assumed: scales of some tens of kilograms are right to half a percent", SCALE,
        label="gain of the scale", judged=False,
    )  # fmt: skip


def is_kept(row: Unknown) -> bool:
    """Whether anything of an unknown is kept until the next run."""
    return row.drift is not None


@dataclass(frozen=True)
class PriorRun:
    """The posterior of an earlier run, as JSON values.

    Attributes:
        robot: name of the robot.
        model: hash of its model file and of what was said of it.
        leg_prior: prior of the leg parameters in that run, "wide" or "narrow".
        weighed: mass that a scale gave the whole robot then [kg]; None: it was not weighed.
        priors: standard deviations of the priors of the unknowns that were not held, by their rows' names, in order.
        x: (size,) most probable unknowns, as of `Unknowns`.
        covariance: lower triangle of the (size, size) covariance of x, row by row.
        shown: the same at the noise that feet on the floor showed: what an estimate allows for beside that, as springs that
            sag, is the same in the next run, and hides nothing that changed.
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
            raise SettingsError("its unknowns are no numbers")
        for rows in (self.covariance, self.shown):
            if size < 10 or [len(row) for row in rows] != [*range(1, size + 1)]:
                raise SettingsError(f"a covariance of {size} unknowns has rows of 1 to {size} numbers")
        try:
            np.linalg.cholesky(self.spread)
            np.linalg.cholesky(self.shown_spread)
        except np.linalg.LinAlgError as error:
            raise SettingsError(f"no numbers can have its covariance: {error}") from error

    @classmethod
    def of(cls, posterior: Posterior, settings: Mapping[str, Any], run: str = "") -> PriorRun:
        """Of an estimate.

        Args:
            settings: settings of the method, as JSON values.
        """
        unknowns = posterior.unknowns
        known: Mapping[str, Any] = settings.get("prior_run") or {}
        return cls(
            unknowns.robot.name, model_hash(unknowns.robot), known.get("leg_prior") or settings["leg_prior"], settings["mass"],
            {row.name: getattr(unknowns.priors, row.name) for row in unknowns.rows}, posterior.x.tolist(),
            _lower_triangle(posterior.covariance), _lower_triangle(_at_shown_noise(posterior)), run,
        )  # fmt: skip

    @classmethod
    def read(cls, path: Path) -> PriorRun:
        """From a run folder.

        Raises:
            RecordingError: it is none, or came to no result, or is damaged, or of another version.
            SettingsError: it is a run of another method.
        """
        try:
            table = json_value(read_text(path / POSTERIOR))
            check_schema(table["schema"], SCHEMA, f"--prior-run {path}: its {POSTERIOR}")
            return replace(from_json(cls, table), run=str(path))
        except (FileNotFoundError, NotADirectoryError) as error:
            raise _why_none(path) from error
        except OSError as error:
            raise RecordingError(f"--prior-run {path}: its {POSTERIOR} cannot be read: {error.strerror}") from error
        except RecordingError:
            raise
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(
                f"--prior-run {path}: its {POSTERIOR} is damaged ({reason(error)}); remove it, and make it again with: "
                f"equipoise estimate {typed(path)}"
            ) from error

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return asdict(self)

    @property
    def name(self) -> str:
        """What it is called in a report."""
        return self.run or "the earlier run"

    @property
    def reference(self) -> dict[str, Any]:
        """What is said of it among settings: its run, and what tells it from others."""
        digest = hashlib.sha256(json.dumps([*self.x]).encode()).hexdigest()
        return {"run": self.run, "robot": self.robot, "leg_prior": self.leg_prior, "sha256": digest}

    @cached_property
    def spread(self) -> FloatArray:
        """(size, size) covariance of x."""
        return _whole(self.covariance)

    @cached_property
    def shown_spread(self) -> FloatArray:
        """(size, size) the same at the noise that was shown."""
        return _whole(self.shown)

    def check(self, robot: RobotModel) -> None:
        """Refuse another robot (SettingsError)."""
        if self.model != model_hash(robot):
            raise SettingsError(
                f"--prior-run {self.run or 'run'} is of {self.robot!r}, by another model file or description than "
                f"{robot.name!r} "
                "here: what is known of one robot says nothing of another"
            )

    @property
    def base_body(self) -> InertialParameters:
        """Base that the earlier run found."""
        from equipoise.estimator.parameters import base_vector  # noqa: PLC0415
        from equipoise.robot.inertial import InertialParameters  # noqa: PLC0415

        return InertialParameters.from_vector(base_vector(np.array(self.x[:10])))

    def priors_of(self, priors: Priors, weighed_again: bool) -> Priors:
        """Priors of a run after it: what is kept has the earlier run's, and is held where that run held it.

        Args:
            priors: priors of what is not kept.
            weighed_again: whether the same scale weighs the robot.
        """
        kept = {row.name: self.priors.get(row.name, 0.0) for row in Priors.rows() if is_kept(row)}
        believed = replace(priors, **kept, inertia=min(priors.inertia, _INERTIA))
        if not (weighed_again and self.weighed):
            return believed
        return PriorsWithScale(**{each.name: getattr(believed, each.name) for each in fields(Priors)})

    def earlier(self, unknowns: Unknowns, shown: bool = False) -> tuple[FloatArray, FloatArray, Unknowns]:
        """The earlier run's unknowns, their covariance and their layout, with the gain of the scale where that is shared.

        Args:
            shown: whether the covariance is that at the noise that was shown.
        """
        from equipoise.estimator.parameters import Unknowns  # noqa: PLC0415
        from equipoise.estimator.problem import total_mass  # noqa: PLC0415

        base = PriorsWithScale if _SCALE in self.priors else Priors
        held = dict.fromkeys((row.name for row in base.rows()), 0.0)
        layout = Unknowns(unknowns.robot, unknowns.stance, base(**{**held, **self.priors}))
        x, spread = np.array(self.x), self.shown_spread if shown else self.spread
        if _SCALE in self.priors or not unknowns.has(_SCALE):
            return x, spread, layout
        # The scale's factor is what it read over the mass that was found.
        total, derivative = total_mass(layout, x)
        weighed = float(self.weighed or total)
        by_x = np.vstack([np.eye(len(x)), -weighed / total**2 * derivative / SCALE_GAIN])
        spread = by_x @ spread @ by_x.T
        spread[-1, -1] += (SCALE_NOISE / SCALE_GAIN) ** 2
        both = Unknowns(unknowns.robot, unknowns.stance, PriorsWithScale(**{**held, **self.priors}))
        return np.append(x, (weighed / total - 1) / SCALE_GAIN), spread, both

    def torque_gains(self, robot: RobotModel, stance: Stance) -> tuple[FloatArray, float]:
        """Return the (nj,) true over reported torques of all joints, and the standard deviation of their mean."""
        from equipoise.estimator.parameters import Unknowns  # noqa: PLC0415

        x, spread, layout = self.earlier(Unknowns(robot, stance, Priors()))
        values = layout.values(x)
        gains = 1 + values["torque_gain_common"] + values["torque_gain"]
        mean = np.zeros(layout.size)
        for name in ("torque_gain_common", "torque_gain"):
            mean[layout[name]] = layout.scale[layout[name]] / max(1, layout[name].stop - layout[name].start)
        return gains, float(np.sqrt(mean @ spread @ mean))

    def belief(
        self, unknowns: Unknowns, begun_anew: Mapping[int, float] | None = None, shown: bool = False
    ) -> PriorDistribution:
        """What is believed of the unknowns of a run after it.

        Args:
            begun_anew: variance that is added to an unknown that changed since, by its place.
            shown: as of `earlier`.
        """
        from equipoise.estimator.parameters import PriorDistribution  # noqa: PLC0415

        x, spread, layout = self.earlier(unknowns, shown)
        mean, covariance = np.zeros(unknowns.size), np.eye(unknowns.size)
        here, there = shared_places(unknowns, layout)
        mean[here], covariance[np.ix_(here, here)] = x[there], spread[np.ix_(there, there)]
        covariance[here, here] += [change**2 for change in _changes(unknowns, here)]
        for place, variance in (begun_anew or {}).items():
            covariance[place, place] += variance
        rows = unknowns.tabled
        return PriorDistribution(mean[rows], covariance[rows, rows])


def _at_shown_noise(posterior: Posterior) -> FloatArray:
    """(size, size) covariance."""
    shown = posterior.problem.at_residual_noise(posterior.x)
    return np.asarray(np.linalg.inv(shown.normal_equations(posterior.x).information), dtype=float)


def _lower_triangle(rows: FloatArray) -> list[list[float]]:
    return [row[: index + 1] for index, row in enumerate(rows.tolist())]


def _whole(rows: Sequence[Sequence[float]]) -> FloatArray:
    lower = np.zeros((len(rows), len(rows)))
    lower[np.tril_indices(len(rows))] = np.concatenate([np.asarray(row, dtype=float) for row in rows])
    return lower + np.tril(lower, -1).T


def shared_places(unknowns: Unknowns, layout: Unknowns) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Places of what is kept, in a run's unknowns and in those of the run before it."""
    names = [row.name for row in unknowns.rows if is_kept(row) and layout.has(row.name) and layout.estimates(row.name)]
    return unknowns.columns(*names), layout.columns(*names)


def _changes(unknowns: Unknowns, places: NDArray[np.intp]) -> FloatArray:
    """Standard deviations of what is kept, of its change between two runs; in units of its prior."""
    of_all = np.zeros(unknowns.size)
    for row in unknowns.rows:
        of_all[unknowns[row.name]] = np.hypot(row.drift or 0.0, row.switched)
    return of_all[places]


def model_hash(robot: RobotModel) -> str:
    """Hash of a robot's model file and of what was said of it."""
    return hashlib.sha256(f"{robot.source.xml}\0{robot.description!r}".encode()).hexdigest()


def _why_none(path: Path) -> EquipoiseError:
    """Why a folder holds no posterior."""
    try:
        header = json_value(read_text(path / "run.json"))
        method = header["settings"]["method"]
    except (OSError, ValueError, KeyError, TypeError):
        return RecordingError(f"--prior-run {path}: it {kind_of(path)}; name the run folder of a calibration")
    if method != "bayesian":
        return SettingsError(
            f"--prior-run {path}: this run is of the method {method!r}; only runs of 'bayesian' know a robot's sensors"
        )
    if not (path / "calibration.json").exists():
        return RecordingError(
            f"--prior-run {path}: this run came to no result; go on with: equipoise calibrate --resume {typed(path)}"
        )
    return RecordingError(
        f"--prior-run {path}: this run has no {POSTERIOR}, which the next one needs; make it with: "
        f"equipoise estimate {typed(path)}"
    )
