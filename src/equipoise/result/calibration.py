"""Calibration: what was found, on what evidence, and how it compares with the truth where that is known.

The JSON form is versioned by its `schema`. What a method does not estimate is null there and None here, never a guess.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pinocchio as pin

from equipoise._version import __version__
from equipoise.conventions import AXES, FloatArray
from equipoise.errors import NotEstimatedError, RecordingError
from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.equations import AxisFit
from equipoise.precise.measurements.evidence import MotionReading
from equipoise.precise.parameters import COMPONENTS
from equipoise.precise.posterior import Posterior
from equipoise.recording.recording import Recording
from equipoise.result.findings import Check, SensorFinding
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.user_file import write_file

Maybe = float | None

SCHEMA = "equipoise.calibration/2"
NORMAL_95 = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution."""
PLANAR_95 = 2.4477
"""The same in the plane: the half axes of an ellipse."""
SPATIAL_95 = 2.7955
"""The same in space: the half axes of an ellipsoid."""
# Standard deviation up to which a quantity counts as identified, and as weak; over what it is compared with.
_IDENTIFIED, _WEAK = 0.1, 0.5


@dataclass(frozen=True)
class BodyEstimate:
    """What is known of one body's inertial parameters. None: not estimated.

    Attributes:
        mass: [kg].
        com_in_base: x, y, z in the base frame [m].
        inertia: 3 rows of 3, about the CoM in base axes [kg m2].
    """

    mass: Maybe = None
    com_in_base: tuple[Maybe, Maybe, Maybe] = (None, None, None)
    inertia: tuple[tuple[float, float, float], ...] | None = None

    @classmethod
    def known(cls, parameters: InertialParameters) -> BodyEstimate:
        """With everything known."""
        x, y, z = (float(value) for value in parameters.com)
        rows = tuple((float(a), float(b), float(c)) for a, b, c in parameters.inertia)
        return cls(parameters.mass, (x, y, z), rows)

    def by_name(self) -> dict[str, Maybe]:
        """Mass, com_x, com_y, com_z, Ixx, Iyy, Izz, Ixy, Ixz, Iyz: the names that intervals have; SI units."""
        table: dict[str, Maybe] = {"mass": self.mass, **dict(zip(COMPONENTS[1:4], self.com_in_base, strict=True))}
        for name in COMPONENTS[4:]:
            row, column = ("xyz".index(axis) for axis in name[1:])
            table[name] = None if self.inertia is None else self.inertia[row][column]
        return table

    def parameters(self) -> InertialParameters:
        """As inertial parameters; raises NotEstimatedError naming what is missing."""
        missing = [name for name, value in (("mass", self.mass), ("inertia", self.inertia)) if value is None]
        missing += [f"com_in_base.{axis}" for axis, value in zip("xyz", self.com_in_base, strict=True) if value is None]
        if missing or self.mass is None:
            raise NotEstimatedError(
                f"this calibration does not know {', '.join(missing)}; its method does not estimate it"
            )
        return InertialParameters(self.mass, np.array(self.com_in_base, dtype=float), np.array(self.inertia))

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        inertia = None if self.inertia is None else [list(row) for row in self.inertia]
        return {"mass": self.mass, "com_in_base": list(self.com_in_base), "inertia": inertia}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> BodyEstimate:
        """From the JSON form."""
        x, y, z = table["com_in_base"]
        inertia = table["inertia"]
        return cls(table["mass"], (x, y, z), None if inertia is None else tuple((a, b, c) for a, b, c in inertia))

    def minus(self, truth: BodyEstimate) -> BodyEstimate:
        """Estimate less truth, for what both know."""
        x, y, z = (_difference(a, b) for a, b in zip(self.com_in_base, truth.com_in_base, strict=True))
        inertia = None
        if self.inertia is not None and truth.inertia is not None:
            inertia = tuple((a, b, c) for a, b, c in (np.array(self.inertia) - np.array(truth.inertia)).tolist())
        return BodyEstimate(_difference(self.mass, truth.mass), (x, y, z), inertia)


@dataclass(frozen=True)
class SwayEstimate:
    """The paper's I and C about one axis (equation 2).

    Attributes:
        moment: I [kg m2].
        damping: C [Nm s/rad].
        frequency: of the sway, as found [Hz].
        amplitude: of the base's rotation, as found [rad].
        note: why there is no estimate, or what speaks against it; None if nothing does.
    """

    moment: Maybe
    damping: Maybe
    frequency: Maybe = None
    amplitude: Maybe = None
    note: str | None = None


@dataclass(frozen=True)
class Interval:
    """How sure a quantity is.

    Attributes:
        deviation: posterior standard deviation.
        lower, upper: 95 % interval.
        verdict: "identified", "weak" or "not identified": how much the run told beyond what was believed before.
    """

    deviation: float
    lower: float
    upper: float
    verdict: str

    @classmethod
    def of(cls, value: float, deviation: float, compared_with: float) -> Interval:
        """About a value.

        Args:
            compared_with: what a standard deviation is small or large beside: the one before the run, or the quantity's size.
        """
        small, half = deviation <= _IDENTIFIED * compared_with, NORMAL_95 * deviation
        verdict = "identified" if small else "weak" if deviation <= _WEAK * compared_with else "not identified"
        return cls(deviation, value - half, value + half, verdict)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How sure one body's parameters are.

    Attributes:
        intervals: by name: mass, com_x, com_y, com_z, Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
        covariance: 10 rows of 10 in that order.
    """

    intervals: Mapping[str, Interval]
    covariance: tuple[tuple[float, ...], ...]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        intervals = {name: dataclasses.asdict(interval) for name, interval in self.intervals.items()}
        return {"intervals": intervals, "covariance": [list(row) for row in self.covariance]}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Uncertainty:
        """From the JSON form."""
        intervals = {name: Interval(**interval) for name, interval in table["intervals"].items()}
        return cls(intervals, tuple(tuple(row) for row in table["covariance"]))


@dataclass(frozen=True)
class Trial:
    """One motion and what it showed.

    Attributes:
        kind: "lift", "sway", "posture" or "stand".
        about: the diagonal of a lift, the axis of a sway, a posture in words.
        offset: of the support line, for a lift [m].
        lift_height: commanded [m].
        tilt: of the CoM about the line, positive forward [rad].
        verdict: "forward", "backward" or "balanced".
        duration: [s].
        misfit: root mean square of its residual over what its noise explains.
        note: why it was left out, or None.
    """

    kind: str
    about: str
    offset: Maybe
    lift_height: Maybe
    tilt: Maybe
    verdict: str | None
    duration: float
    misfit: Maybe = None
    note: str | None = None


@dataclass(frozen=True)
class SupportLine:
    """Where one diagonal's search ended.

    Attributes:
        offset: at which the robot balances [m].
        lower, upper: the last bounds [m].
        point, normal: of the support plane, carried to the nominal stance, in the base frame [m].
    """

    offset: float
    lower: float
    upper: float
    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {**dataclasses.asdict(self), "point": list(self.point), "normal": list(self.normal)}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> SupportLine:
        """From the JSON form."""
        point, normal = ((x, y, z) for x, y, z in (table["point"], table["normal"]))
        return cls(table["offset"], table["lower"], table["upper"], point, normal)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the pictures show: too large for the JSON file, and made again from the recordings.

    Attributes:
        trial_planes: support plane of every lift trial, in order.
        fits: by axis.
        feet_in_base: (4, 3) of the nominal stance [m].
        recordings: all that were estimated from, in order.
        motions: what was read from each; `precise` only.
        posterior: the estimate with its information by motion; `precise` only.
    """

    trial_planes: tuple[SupportPlane, ...]
    fits: Mapping[str, AxisFit]
    feet_in_base: FloatArray
    recordings: tuple[Recording, ...] = ()
    motions: tuple[MotionReading, ...] = ()
    posterior: Posterior | None = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of a calibration.

    Attributes:
        robot: its name.
        method: "precise", "paper" or "static".
        feet: "measured" or "commanded".
        joint_position: the nominal stance that all refers to, by joint name [rad].
        model: format, hash and base link of the model file.
        composite: the whole robot at the stance.
        base: the base link with all that is fixed to it.
        sways: the paper's I and C, by axis.
        support_lines: by diagonal; `paper` only.
        stance_effective: the paper's body: base, hips and thighs about their own CoM.
        uncertainty: of "composite", "base" and "stance_effective"; `precise` only.
        sensors: what was found wrong with the sensors; `precise` only.
        checks: what the result says about itself, failed ones first.
        trials: every motion, in order.
        settings: as JSON values.
        provenance: version, time, and in simulation seed, noise and payload.
        warnings: what speaks against the result, worst first.
        truth: in simulation.
        nominal: what the model file says.
        evidence: not in the JSON form.
        robot_model: the model that was used; not in the JSON form.
        timings: seconds that each stage of the estimate took; not in the JSON form.
    """

    robot: str
    method: str
    feet: str
    joint_position: Mapping[str, float]
    model: Mapping[str, str]
    composite: BodyEstimate
    base: BodyEstimate
    sways: Mapping[str, SwayEstimate]
    support_lines: Mapping[str, SupportLine]
    trials: tuple[Trial, ...]
    settings: Mapping[str, Any]
    nominal: RobotInertia
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    warnings: tuple[str, ...] = ()
    truth: RobotInertia | None = None
    evidence: Evidence | None = None
    robot_model: RobotModel | None = None
    stance_effective: BodyEstimate = field(default_factory=BodyEstimate)
    uncertainty: Mapping[str, Uncertainty] = field(default_factory=dict[str, Uncertainty])
    sensors: tuple[SensorFinding, ...] = ()
    checks: tuple[Check, ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def trustworthy(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    def with_truth(self, truth: RobotInertia) -> Calibration:
        """The same with the truth joined to it."""
        return dataclasses.replace(self, truth=truth)

    def with_provenance(self, **facts: Any) -> Calibration:
        """The same with more facts about where it came from."""
        return dataclasses.replace(self, provenance={**self.provenance, **facts})

    def to_pinocchio(self) -> pin.Model:
        """The user's own Pinocchio model with the base inertia found.

        Raises:
            NotEstimatedError: the method does not estimate the whole base, or the model is not at hand.
        """
        if self.robot_model is None:
            raise NotEstimatedError("the robot model is not at hand: open the run folder instead of its JSON file")
        base = self.base.parameters().to_pinocchio()
        robot = self.robot_model
        model = robot.full_pinocchio.copy()
        held = robot.pinocchio.inertias[1] - robot.full_pinocchio.inertias[1]
        model.inertias[1] = base - held if robot.held else base
        return model

    def moment_errors(self) -> dict[str, dict[str, float]]:
        """Relative errors of the paper's I against both truths, by axis. Empty without a truth."""
        if self.truth is None:
            return {}
        errors: dict[str, dict[str, float]] = {}
        for index, axis in enumerate(AXES):
            moment = self.sways[axis].moment if axis in self.sways else None
            if moment is not None:
                errors[axis] = {
                    "against_stance_effective": moment / self.truth.stance_effective.inertia[index, index] - 1,
                    "against_composite": moment / self.truth.composite.inertia[index, index] - 1,
                }
        return errors

    def errors(self) -> dict[str, Any] | None:
        """Estimate less truth, in the shape of the estimates; None without a truth."""
        if self.truth is None:
            return None
        return {
            "composite": self.composite.minus(BodyEstimate.known(self.truth.composite)).to_dict(),
            "base": self.base.minus(BodyEstimate.known(self.truth.base)).to_dict(),
            "stance_effective": self.stance_effective.minus(BodyEstimate.known(self.truth.stance_effective)).to_dict(),
            "moments_relative": self.moment_errors(),
        }

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "method": self.method,
            "feet": self.feet,
            "model": dict(self.model),
            "stance": {"joint_position": dict(self.joint_position)},
            "composite": self.composite.to_dict(),
            "base": self.base.to_dict(),
            "stance_effective": self.stance_effective.to_dict(),
            "uncertainty": {body: uncertainty.to_dict() for body, uncertainty in self.uncertainty.items()},
            "sensors": [dataclasses.asdict(finding) for finding in self.sensors],
            "checks": [dataclasses.asdict(check) for check in self.checks],
            "sways": {axis: dataclasses.asdict(sway) for axis, sway in self.sways.items()},
            "support_lines": {name: line.to_dict() for name, line in self.support_lines.items()},
            "trials": [dataclasses.asdict(trial) for trial in self.trials],
            "settings": dict(self.settings),
            "provenance": dict(self.provenance),
            "warnings": list(self.warnings),
            "nominal": inertia_to_dict(self.nominal),
            "truth": None if self.truth is None else inertia_to_dict(self.truth),
            "errors": self.errors(),
        }

    def to_json(self) -> str:
        """The JSON form as text."""
        return json.dumps(self.to_dict(), indent=2) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the JSON form; raises OutputError if it cannot be written. The file is there when it is complete."""
        write_file(Path(path), self.to_json())

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read the JSON form.

        Raises:
            RecordingError: the file is missing, is not JSON, or has another schema.
        """
        try:
            table = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise RecordingError(f"cannot read the result {str(path)!r}: {error.strerror}") from error
        except ValueError as error:
            raise RecordingError(f"the result {str(path)!r} is not JSON: {error}") from error
        found = cast("dict[str, Any]", table).get("schema") if isinstance(table, dict) else type(table).__name__
        if found != SCHEMA:
            raise RecordingError(f"the result {str(path)!r} has the schema {found!r}; this version reads {SCHEMA!r}")
        try:
            return cls._from_dict(cast("dict[str, Any]", table))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise RecordingError(f"the result {str(path)!r} is damaged: {error!r}") from error

    @classmethod
    def _from_dict(cls, table: Mapping[str, Any]) -> Calibration:
        truth = table["truth"]
        return cls(
            robot=table["robot"],
            method=table["method"],
            feet=table["feet"],
            joint_position=table["stance"]["joint_position"],
            model=table["model"],
            composite=BodyEstimate.from_dict(table["composite"]),
            base=BodyEstimate.from_dict(table["base"]),
            sways={axis: SwayEstimate(**sway) for axis, sway in table["sways"].items()},
            support_lines={name: SupportLine.from_dict(line) for name, line in table["support_lines"].items()},
            trials=tuple(Trial(**trial) for trial in table["trials"]),
            settings=table["settings"],
            nominal=inertia_from_dict(table["nominal"]),
            provenance=table["provenance"],
            warnings=tuple(table["warnings"]),
            truth=None if truth is None else inertia_from_dict(truth),
            stance_effective=BodyEstimate.from_dict(table["stance_effective"]),
            uncertainty={body: Uncertainty.from_dict(value) for body, value in table["uncertainty"].items()},
            sensors=tuple(SensorFinding(**finding) for finding in table["sensors"]),
            checks=tuple(Check(**check) for check in table["checks"]),
        )


def library_versions() -> dict[str, str]:
    """What an estimate was made with."""
    return {"equipoise": __version__, "pinocchio": pin.__version__}


def model_facts(robot: RobotModel, joint_position: FloatArray) -> dict[str, Any]:
    """What every result says of the model and the stance it refers to: arguments of `Calibration`."""
    return {
        "robot": robot.name,
        "joint_position": {name: float(q) for name, q in zip(robot.joint_names, joint_position, strict=True)},
        "model": {"format": robot.source.format, "sha256": robot.source.sha256, "base_link": robot.base_link},
        "robot_model": robot,
        "provenance": library_versions(),
    }


def inertia_to_dict(inertia: RobotInertia) -> dict[str, Any]:
    """JSON form of the three bodies."""
    return {
        field.name: BodyEstimate.known(getattr(inertia, field.name)).to_dict() for field in dataclasses.fields(inertia)
    }


def inertia_from_dict(table: Mapping[str, Any]) -> RobotInertia:
    """From the JSON form."""
    bodies = {field.name: BodyEstimate.from_dict(table[field.name]) for field in dataclasses.fields(RobotInertia)}
    return RobotInertia(**{name: body.parameters() for name, body in bodies.items()})


def _difference(a: Maybe, b: Maybe) -> Maybe:
    return None if a is None or b is None else a - b
