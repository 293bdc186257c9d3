"""Result of a calibration, with its evidence and, in simulation, its ground truth.

The JSON form is versioned by its `schema`. Parameters that a method does not estimate are null there and None here.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pinocchio as pin

from equipoise._version import __version__
from equipoise.conventions import AXES, Axis, FloatArray
from equipoise.errors import NotEstimatedError, RecordingError, reason
from equipoise.json_form import from_json, to_json
from equipoise.recording.recording import Recording
from equipoise.result.body import BODIES, Body
from equipoise.result.findings import Check, JointFindings, Link, Motor, SensorFinding
from equipoise.result.held_out import HeldOut
from equipoise.result.mass_comparison import MassComparison
from equipoise.result.quantity import Quantity
from equipoise.result.requirements import verdicts
from equipoise.result.uncertainty import UncertaintySource
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.user_file import check_schema, json_value, kind_of, read_text, write_file

Maybe = float | None

SCHEMA = "equipoise.calibration/1"
_WRITTEN = (
    "sensors", "motors", "links", "checks", "uncertainty_budget", "held_out", "mass_comparison", "excitations",
    "support_lines", "trials",
    "settings", "provenance", "warnings", "assumptions",
)  # fmt: skip
"""Fields of a calibration that its JSON form contains under the same names."""


@dataclass(frozen=True)
class ExcitationEstimate:
    """Moment of inertia I and damping C of the paper about one axis (equation 2).

    Attributes:
        moment: moment of inertia I about the excitation's axis [kg m2].
        damping: damping C about the excitation's axis [Nm s/rad].
        frequency: estimated frequency of the excitation [Hz].
        amplitude: estimated amplitude of the base's rotation [rad].
        note: reason for a missing estimate, or an objection to it; None without either.
    """

    moment: Maybe
    damping: Maybe
    frequency: Maybe = None
    amplitude: Maybe = None
    note: str | None = None


@dataclass(frozen=True)
class Trial:
    """One motion and its results.

    Attributes:
        kind: kind of trial, as `RecordedTrial.kind`, for example "lift"; "motion" without a trial.
        about: diagonal of a lift, axis of an excitation, number of steps, or description of a posture.
        offset: offset of the support line along the base's x axis, for a lift [m].
        lift_height: commanded height of the lifted feet [m].
        tilt: rotation of the CoM about the support line, positive forward [rad].
        verdict: direction in which the robot tipped: "forward", "backward" or "balanced".
        duration: duration of the recording [s].
        normalized_residual: root mean square of the trial's residual, divided by its expected noise; dimensionless.
        note: reason for the exclusion of the trial, or None.
    """

    kind: str
    about: str
    offset: Maybe
    lift_height: Maybe
    tilt: Maybe
    verdict: str | None
    duration: float
    normalized_residual: Maybe = None
    note: str | None = None


@dataclass(frozen=True)
class SupportLine:
    """Result of the search on one diagonal.

    Attributes:
        offset: offset along the base's x axis at which the robot balances [m].
        lower, upper: final bounds of that offset [m].
        point, normal: point [m] and unit normal of the support plane at the nominal stance, in the base frame.
    """

    offset: float
    lower: float
    upper: float
    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data for figures, computed from the recordings and not stored in the JSON file; methods subclass it.

    Attributes:
        recordings: recordings used by the estimate, in order.
    """

    recordings: tuple[Recording, ...]

    def keepsake(self, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return data for the next run of this robot, as JSON values; None without any.

        Args:
            settings: settings of the method, as JSON values.
        """
        del settings
        return None


PartsTruth = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Ground truth of simulated "motors" and "links": kind, part name, quantity name, value in SI units."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a calibration.

    Every number of a body is a `Quantity` in SI units, with interval, verdict, model value and, in simulation, ground truth.
    Example: `result.composite.com_in_base.x`. CoMs are in the base frame, inertias about the CoM in base axes.

    Attributes:
        robot: name of the robot.
        method: name of the method.
        joint_position: joint positions of the nominal stance, by joint name [rad]; all results refer to this stance.
        locked_joints: positions of locked joints outside the legs, such as those of an arm, by joint name [rad].
        model: format, hash and base link of the model file, and a description of the IMU's pose.
        composite: whole robot, rigid at the nominal stance.
        base: base link with everything fixed to it.
        stance_effective: body of the paper: base, hips and thighs.
        excitations: moments of inertia I and damping C of the paper, by axis; `paper` only.
        support_lines: support lines of the search, by diagonal; `paper` only.
        sensors: estimated sensor errors; `bayesian` only.
        checks: checks of the result, failed ones first.
        trials: all motions, in order.
        settings: settings of the method, as JSON values; "method" is its name.
        provenance: version, time, and in simulation seed, noise and payload.
        warnings: objections to the result, most severe first.
        assumptions: assumptions of the intervals: those that the user stated, and model values that the data contradict or
            cannot check.
        evidence: data for figures; not in the JSON form.
        robot_model: robot model of the estimate; not in the JSON form.
        motors: estimates of each joint's motor, by joint name; only if `motors` are estimated.
        links: estimates of each moving leg link, by the model file's name; only if `legs` are estimated.
        uncertainty_budget: sources of the uncertainty of the whole robot's parameters, the largest first; `bayesian` only.
        held_out: predictions of lifts and steps by estimates without them; `bayesian` only.
        mass_comparison: given mass and mass from the joint torques [kg]; None unless both exist.
        timings: duration of each stage of the estimate, by name [s]; not in the JSON form.
    """

    robot: str
    method: str
    joint_position: Mapping[str, float]
    model: Mapping[str, str]
    composite: Body
    base: Body
    stance_effective: Body
    excitations: Mapping[str, ExcitationEstimate]
    support_lines: Mapping[str, SupportLine]
    trials: tuple[Trial, ...]
    settings: Mapping[str, Any]
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    warnings: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    evidence: Evidence | None = None
    robot_model: RobotModel | None = None
    sensors: tuple[SensorFinding, ...] = ()
    checks: tuple[Check, ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict[str, float])
    locked_joints: Mapping[str, float] = field(default_factory=dict[str, float])
    motors: Mapping[str, Motor] = field(default_factory=dict[str, Motor])
    links: Mapping[str, Link] = field(default_factory=dict[str, Link])
    uncertainty_budget: tuple[UncertaintySource, ...] = ()
    held_out: HeldOut | None = None
    mass_comparison: MassComparison | None = None

    @property
    def trustworthy(self) -> bool:
        """True if every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def feet(self) -> str | None:
        """Source of the foot positions of the support lines, "measured" or "commanded"; None without lines."""
        return self.settings.get("feet") if self.support_lines else None

    @property
    def has_intervals(self) -> bool:
        """True if any parameter of the whole robot has an interval."""
        return any(quantity.std is not None for quantity in self.composite)

    @property
    def nominal(self) -> RobotInertia:
        """The three bodies of the model file."""
        return RobotInertia(**{name: _given(getattr(self, name).model, name) for name in BODIES})

    @property
    def truth(self) -> RobotInertia | None:
        """Ground truth of the three bodies; None on a real robot."""
        if self.composite.truth is None:
            return None
        return RobotInertia(**{name: _given(getattr(self, name).truth, name) for name in BODIES})

    @property
    def base_for_model_legs(self) -> FloatArray:
        """(10,) base parameters that give the estimated composite with the model file's legs.

        In Pinocchio's order, about the base's origin, SI units; they may be physically inconsistent.
        """
        nominal = self.nominal
        return nominal.base.vector + self.composite.parameters().vector - nominal.composite.vector

    @property
    def moments(self) -> dict[Axis, Quantity]:
        """Moments of inertia I of the paper by axis [kg m2], with the model and true values of its body."""
        moments: dict[Axis, Quantity] = {}
        for axis, letter, of_body in zip(AXES, "xyz", self.stance_effective.inertia.moments, strict=True):
            if axis in self.excitations and self.excitations[axis].moment is not None:
                value = self.excitations[axis].moment
                moments[axis] = Quantity(f"I_{letter}", of_body.unit, value, model=of_body.model, truth=of_body.truth)
        return moments

    @property
    def joints(self) -> dict[str, JointFindings]:
        """Findings about each joint, by the model's joint names."""
        found = {finding.name: finding for finding in self.sensors}
        return {name: JointFindings.of(name, found, self.motors.get(name)) for name in self.joint_position}

    def with_truth(self, truth: RobotInertia | None) -> Calibration:
        """Return the result with the ground truth; None removes it."""
        bodies = {
            name: getattr(self, name).with_truth(None if truth is None else getattr(truth, name)) for name in BODIES
        }
        return dataclasses.replace(self, **bodies)

    def with_truth_of_parts(self, truth: PartsTruth) -> Calibration:
        """Return the result with the ground truth of motors and links."""
        motors = {name: motor.with_truth(truth.get("motors", {}).get(name, {})) for name, motor in self.motors.items()}
        links = {name: link.with_truth(truth.get("links", {}).get(name, {})) for name, link in self.links.items()}
        return dataclasses.replace(self, motors=motors, links=links)

    def with_provenance(self, **facts: Any) -> Calibration:
        """Return the result with further facts in its provenance."""
        return dataclasses.replace(self, provenance={**self.provenance, **facts})

    def to_pinocchio(self) -> pin.Model:
        """Return the user's Pinocchio model with the estimated base inertia.

        Raises:
            NotEstimatedError: the method does not estimate all base parameters, or the model is not available.
        """
        if self.robot_model is None:
            raise NotEstimatedError("the robot model is not available: open the run folder instead of its JSON file")
        base = self.base.parameters().to_pinocchio()
        robot = self.robot_model
        model = robot.full_pinocchio.copy()
        locked = robot.pinocchio.inertias[1] - robot.full_pinocchio.inertias[1]
        model.inertias[1] = base - locked if robot.locked_joints else base
        return model

    def moment_errors(self) -> dict[Axis, dict[str, float]]:
        """Return the relative errors of the paper's I against both true bodies, by axis; empty without a truth."""
        truth = self.truth
        if truth is None:
            return {}
        return {
            axis: {
                "against_stance_effective": float(moment / truth.stance_effective.inertia[index, index] - 1),
                "against_composite": float(moment / truth.composite.inertia[index, index] - 1),
            }
            for index, axis in enumerate(AXES)
            if axis in self.moments and (moment := self.moments[axis].value) is not None
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "method": self.method,
            "model": dict(self.model),
            "stance": self.stance_dict(),
            **{name: to_json(getattr(self, name)) for name in (*BODIES, *_WRITTEN)},
            "verdicts": verdicts(self.composite, self.checks),
            "nominal": to_json(self.nominal),
            "truth": to_json(self.truth),
            "errors": None if self.truth is None else self._errors(),
        }

    def stance_dict(self) -> dict[str, Any]:
        """Return the JSON form of the nominal stance: joint positions [rad]."""
        return {"joint_position": dict(self.joint_position), "locked_joints": dict(self.locked_joints)}

    def _errors(self) -> dict[str, Any]:
        """Return the JSON form of the estimates minus the truth."""
        bodies = {name: getattr(self, name).numbers("error") for name in BODIES}
        return {**bodies, "moments_relative": self.moment_errors()}

    def to_json(self) -> str:
        """Return the JSON form as text."""
        return json.dumps(self.to_dict(), indent=2) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the JSON form atomically; raises OutputError if it cannot be written."""
        write_file(Path(path), self.to_json())

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read the JSON form.

        Raises:
            RecordingError: the file is missing, is of another kind, or has another schema.
        """
        remedy = "name the run folder of a calibration, or its calibration.json"
        if (kind := kind_of(path)) not in ("is a JSON file", "is the result of a calibration"):
            raise RecordingError(f"{str(path)!r} {kind}; {remedy}")
        try:
            table = json_value(read_text(path))
        except OSError as error:
            raise RecordingError(f"cannot read the result {str(path)!r}: {error.strerror}") from error
        except ValueError as error:
            raise RecordingError(f"the result {str(path)!r} is not valid JSON ({error}); {remedy}") from error
        found = cast("dict[str, Any]", table).get("schema") if isinstance(table, dict) else None
        if found is None:
            raise RecordingError(f"{str(path)!r} {kind} of another kind; {remedy}")
        check_schema(found, SCHEMA, f"the result {str(path)!r}")
        try:
            return cls._from_dict(cast("dict[str, Any]", table))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise RecordingError(f"the result {str(path)!r} is damaged: {reason(error)}") from error

    @classmethod
    def _from_dict(cls, table: Mapping[str, Any]) -> Calibration:
        fields = {name: table[name] for name in ("robot", "method", "model", *BODIES, *_WRITTEN)}
        result = from_json(cls, {**fields, **table["stance"]})
        nominal = from_json(RobotInertia, table["nominal"], "nominal")
        bodies = {name: getattr(result, name).with_model(getattr(nominal, name)) for name in BODIES}
        truth = None if table["truth"] is None else from_json(RobotInertia, table["truth"], "truth")
        return dataclasses.replace(result, **bodies).with_truth(truth)


def _given(body: InertialParameters | None, name: str) -> InertialParameters:
    """Return a body of the model file or of the truth; raises NotEstimatedError if it is None."""
    if body is None:
        raise NotEstimatedError(f"the body {name!r} is not available from a model file or a simulation")
    return body


def model_facts(robot: RobotModel, joint_position: FloatArray) -> dict[str, Any]:
    """Return model and stance of a result, as arguments of `Calibration`."""
    return {
        "robot": robot.name,
        "joint_position": {name: float(q) for name, q in zip(robot.joint_names, joint_position, strict=True)},
        "locked_joints": dict(robot.locked_joints),
        "model": {
            "format": robot.source.format,
            "sha256": robot.source.sha256,
            "base_link": robot.base_link,
            "forward": robot.source.forward,
            "imu": robot.imu.message,
        },
        "robot_model": robot,
        "provenance": {"equipoise": __version__, "pinocchio": pin.__version__},
    }
