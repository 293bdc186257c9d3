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
from equipoise.result.notebook import notebook_table
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
"""Fields of a calibration that stand in its JSON form as they are."""


@dataclass(frozen=True)
class ExcitationEstimate:
    """The paper's I and C about one axis (equation 2).

    Attributes:
        moment: moment of inertia I about the excitation's axis [kg m2].
        damping: damping C about the excitation's axis [Nm s/rad].
        frequency: frequency of the excitation, as found [Hz].
        amplitude: amplitude of the base's rotation, as found [rad].
        note: reason why there is no estimate, or an objection to it; None without either.
    """

    moment: Maybe
    damping: Maybe
    frequency: Maybe = None
    amplitude: Maybe = None
    note: str | None = None


@dataclass(frozen=True)
class Trial:
    """One motion and what it showed.

    Attributes:
        kind: kind of trial: "lift", "excitation", "posture" or "stand".
        about: diagonal of a lift, axis of an excitation, or posture, in words.
        offset: offset of the support line along the base's x axis, for a lift [m].
        lift_height: commanded height of the lifted feet [m].
        tilt: rotation of the CoM about the support line, positive forward [rad].
        verdict: direction in which the robot tipped: "forward", "backward" or "balanced".
        duration: duration of the recording [s].
        normalized_residual: normalised residual: root mean square of the trial's residual over what its noise explains.
        note: reason why the trial was left out, or None.
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
        lower, upper: last bounds of that offset [m].
        point, normal: point [m] and unit normal of the support plane at the nominal stance, in the base frame.
    """

    offset: float
    lower: float
    upper: float
    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data of the figures: too large for the JSON file, and made again from the recordings. Methods add theirs.

    Attributes:
        recordings: recordings that were estimated from, in order.
    """

    recordings: tuple[Recording, ...]

    def keepsake(self, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return what the next run of the robot uses of this one, as JSON values; None: nothing.

        Args:
            settings: settings of the method, as JSON values.
        """
        del settings
        return None


PartsTruth = Mapping[str, Mapping[str, Mapping[str, float]]]
"""True values by name of each of a simulated robot's "motors" and "links", by name."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of a calibration.

    Every number of a body is a `Quantity`: `result.composite.com_in_base.x` has its value, interval, verdict, the model
    file's value, and in simulation the truth.

    Attributes:
        robot: name of the robot.
        method: name of the method.
        joint_position: joint positions of the nominal stance that all refers to, by joint name [rad].
        locked_joints: positions of joints that do not belong to legs and were held still, as an arm's, by joint name [rad].
        model: format, hash and base link of the model file, and a sentence on the IMU's pose.
        composite: body of the whole robot, frozen at the stance.
        base: body of the base link with all that is fixed to it.
        stance_effective: body of the paper: base, hips and thighs about their own CoM.
        excitations: moments of inertia I and damping C of the paper, by axis; `paper` only.
        support_lines: support lines that were found, by diagonal; `paper` only.
        sensors: errors of the sensors that were found; `bayesian` only.
        checks: checks of the result, failed ones first.
        trials: all motions, in order.
        settings: settings of the method, as JSON values; "method" is its name.
        provenance: version, time, and in simulation seed, noise and payload.
        warnings: objections to the result, worst first.
        assumptions: what the intervals rest on: what the user said to be so, what of the model file the run contradicts, and
            what it cannot.
        evidence: data that pictures show; not in the JSON form.
        robot_model: model that was used; not in the JSON form.
        motors: what was found about each joint's motor, by the model's joint names; of runs with `motors` only.
        links: what was found about each moving link of the legs, by the model file's names; of runs with `legs` only.
        uncertainty_budget: sources of the uncertainty of the whole robot's parameters, the largest first; `bayesian` only.
        held_out: lifts predicted by estimates that have not seen them; `bayesian` only.
        mass_comparison: given mass and mass that the joint torques carry; None without one of them.
        timings: time that each stage of the estimate took, by its name [s]; not in the JSON form.
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
        """Feet that the support lines run through, "measured" or "commanded"; None without support lines."""
        return self.settings.get("feet") if self.support_lines else None

    @property
    def has_intervals(self) -> bool:
        """True if the method gives intervals for the whole robot."""
        return any(quantity.std is not None for quantity in self.composite)

    @property
    def nominal(self) -> RobotInertia:
        """The three bodies by the model file."""
        return RobotInertia(**{name: _given(getattr(self, name).model, name) for name in BODIES})

    @property
    def truth(self) -> RobotInertia | None:
        """The three bodies as simulated; None on a real robot."""
        if self.composite.truth is None:
            return None
        return RobotInertia(**{name: _given(getattr(self, name).truth, name) for name in BODIES})

    @property
    def base_for_model_legs(self) -> FloatArray:
        """(10,) base with which the model file's legs make the composite that was found, which a run determines best.

        In Pinocchio's order, about the base's origin; perhaps of no body that can exist.
        """
        nominal = self.nominal
        return nominal.base.vector + self.composite.parameters().vector - nominal.composite.vector

    @property
    def moments(self) -> dict[Axis, Quantity]:
        """The paper's I by axis [kg m2], for axes with an estimate, with the model's and the true value of its body."""
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
        """Return the result with the true values of motors and links."""
        motors = {name: motor.with_truth(truth.get("motors", {}).get(name, {})) for name, motor in self.motors.items()}
        links = {name: link.with_truth(truth.get("links", {}).get(name, {})) for name, link in self.links.items()}
        return dataclasses.replace(self, motors=motors, links=links)

    def with_provenance(self, **facts: Any) -> Calibration:
        """Return the result with further facts in its provenance."""
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
        model.inertias[1] = base - held if robot.locked_joints else base
        return model

    def moment_errors(self) -> dict[Axis, dict[str, float]]:
        """Relative errors of the paper's I against both truths, by axis. Empty without a truth."""
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

    def _repr_html_(self) -> str:
        """Return the table for a notebook: the whole robot, and warnings."""
        return notebook_table(self.robot, self.method, self.composite, self.warnings)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
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
        """JSON form of the posture that all refers to."""
        return {"joint_position": dict(self.joint_position), "locked_joints": dict(self.locked_joints)}

    def _errors(self) -> dict[str, Any]:
        """JSON form of the estimates less the truth, in the shape of the estimates."""
        bodies = {name: getattr(self, name).numbers("error") for name in BODIES}
        return {**bodies, "moments_relative": self.moment_errors()}

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
    """A body of the model file or of the truth; raises NotEstimatedError if it was never given."""
    if body is None:
        raise NotEstimatedError(f"neither the model file nor a simulation says what the body {name!r} is")
    return body


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries that made an estimate."""
    return {"equipoise": __version__, "pinocchio": pin.__version__}


def model_facts(robot: RobotModel, joint_position: FloatArray) -> dict[str, Any]:
    """Return the facts of the model and of the stance that a result refers to: arguments of `Calibration`."""
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
        "provenance": library_versions(),
    }
