"""Validation of a result by simulated replay of recorded lifts, with the estimated body and with others.

The joints follow the encoders, corrected by the estimated joint offsets. The base starts in the measured state when both
feet are off the floor, and is free. Only the body differs between replays. A result keeps the model file's legs and has the
base that gives the estimated composite, as in exports.

Only the time on two feet is replayed: the unstable motion on two feet amplifies small differences of the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, NotEstimatedError, SettingsError
from equipoise.estimator.diagnostics.held_out import LiftPrediction
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.tilt_invariant import SensedLift
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.result.calibration import Calibration
from equipoise.result.held_out import FOUND, MODEL
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

if TYPE_CHECKING:
    from equipoise.lab.replay.in_mujoco import MujocoReplay

SCHEMA = "equipoise.validation/1"
_ALIKE = 2.0  # ratio of errors that errors of the legs and noise of the start can cause


@dataclass(frozen=True, eq=False)
class ReplayedLift:
    """Replayed lift over time.

    Attributes:
        measured: measured lift: `motion`, `height`, `time` and `tilt`.
        about: description of diagonal, turn and posture.
        errors: (n,) measured minus simulated tilt, by body [rad].
    """

    measured: LiftPrediction
    about: str
    errors: Mapping[str, FloatArray]

    def error(self, body: str) -> float:
        """Return the tilt error at the end, as a displacement of the CoM about the line [m]."""
        return self.measured.height * float(self.errors[body][-1])

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "motion": self.measured.motion,
            "about": self.about,
            "height": self.measured.height,
            "time": np.round(self.measured.time, 4).tolist(),
            "tilt": np.round(self.measured.tilt, 6).tolist(),
            "errors": {body: np.round(error, 6).tolist() for body, error in self.errors.items()},
        }


@dataclass(frozen=True, eq=False)
class Validation:
    """Replay of all lifts of a run.

    Attributes:
        robot: name of the robot.
        lifts: lifts in order.
        joint_errors: largest joint position error, by body [rad].
    """

    robot: str
    lifts: tuple[ReplayedLift, ...]
    joint_errors: Mapping[str, float]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies: FOUND, MODEL and the others."""
        return tuple(self.lifts[0].errors)

    def error(self, body: str) -> float:
        """Return the root mean square over lifts of the error at the end [m]."""
        return float(np.sqrt(np.mean([lift.error(body) ** 2 for lift in self.lifts])))

    def ratio(self, body: str) -> float:
        """Return the error with a body over the error with the estimated one."""
        return self.error(body) / self.error(FOUND)

    @property
    def message(self) -> str:
        """Conclusion in one line."""
        ratio, estimated, model = self.ratio(MODEL), 1000 * self.error(FOUND), 1000 * self.error(MODEL)
        text = f"{self.robot}: the tilt error of {len(self.lifts)} replayed lifts is {estimated:.2f} mm with the estimated "
        text += f"body and {model:.2f} mm with the model file's, {ratio:.1f} times as much"
        if ratio > _ALIKE:
            return f"{text}: the estimated body is closer to the robot's"
        if ratio < 1 / _ALIKE:
            return f"{text}: the model file's body is closer to the robot's"
        return f"{text}: the lifts do not distinguish the two"

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "message": self.message,
            "ratio": self.ratio(MODEL),
            "bodies": {
                body: {
                    "tilt_error": self.error(body),
                    "ratio": self.ratio(body),
                    "joint_error": self.joint_errors[body],
                }
                for body in self.bodies
            },
            "lifts": [lift.to_dict() for lift in self.lifts],
        }


def validate(result: Calibration, against: Mapping[str, RobotModel | Calibration] | None = None) -> Validation:
    """Replay the lifts of a run or a log with the estimated body, the model file's, and others.

    Args:
        result: result of the method `bayesian` with its recordings, from `RunFolder.estimate` or `estimate_log`.
        against: other models of the robot, or results of its other runs, by display name.

    Raises:
        NotEstimatedError: the result has no lift, or comes from a JSON file.
        SettingsError: another model or result is not of this robot.
        FallError: the simulation became unstable.
        MissingDependencyError: MuJoCo is not installed.
    """
    evidence, robot = result.evidence, result.robot_model
    lifted = isinstance(evidence, PosteriorEvidence) and any(one.kind == "lift" for one in evidence.predictions)
    if not isinstance(evidence, PosteriorEvidence) or not lifted or robot is None:
        raise NotEstimatedError(
            f"the result of {result.robot!r} with the method {result.method!r} has no lift to replay; validate needs a run or "
            "log with lifts, estimated with the method 'bayesian'"
        )
    replays = _replays(robot, {FOUND: result, MODEL: robot, **(against or {})})
    lifts: list[ReplayedLift] = []
    largest = dict.fromkeys(replays, 0.0)
    for prediction, lift, sensed in _sensed(evidence):
        errors: dict[str, FloatArray] = {}
        for name, replay in replays.items():
            errors[name], joint_error = replay.tilt_error(robot.joint_names, lift, sensed)
            largest[name] = max(largest[name], joint_error)
        lifts.append(ReplayedLift(prediction, result.trials[prediction.motion].about, errors))
    return Validation(result.robot, tuple(lifts), largest)


def _replays(robot: RobotModel, bodies: Mapping[str, RobotModel | Calibration]) -> dict[str, MujocoReplay]:
    try:
        from equipoise.lab.replay.in_mujoco import MujocoReplay  # noqa: PLC0415 - estimation does not need an engine
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the replay of lifts needs MuJoCo: pip install 'equipoise[simulation]'") from error
    replays: dict[str, MujocoReplay] = {}
    for name, body in bodies.items():
        if isinstance(body, Calibration):
            replays[name] = MujocoReplay(robot, _base_of(name, robot, body))
        elif set(body.joint_names) != set(robot.joint_names):
            different = sorted(set(body.joint_names) ^ set(robot.joint_names))
            raise SettingsError(
                f"--against {name}: its leg joints differ from those of {robot.name!r}: {', '.join(different[:4])}; pass a "
                "model of the same robot"
            )
        else:
            replays[name] = MujocoReplay(body)
    return replays


def _base_of(name: str, robot: RobotModel, result: Calibration) -> InertialParameters:
    """Return the base that gives the model file's robot the composite of a result."""
    stance = nominal_stance(robot).joint_position
    same_stance = [result.joint_position.get(joint, np.inf) for joint in robot.joint_names]
    if result.model["sha256"] != robot.source.sha256 or not np.allclose(same_stance, stance):
        raise SettingsError(
            f"--against {name}: it is a result of {result.robot!r} with another model file or stance than {robot.name!r} "
            "here; pass its exported model file"
        )
    return InertialParameters.from_vector(result.base_for_model_legs)


def _sensed(evidence: PosteriorEvidence) -> Iterator[tuple[LiftPrediction, LiftSamples, SensedLift]]:
    """Yield every lift that the estimate uses, without the steps of a walk, which are too short."""
    posterior = evidence.posterior
    tilts = posterior.problem.equation(TiltEquation)
    assert tilts is not None
    used = {prediction.motion: prediction for prediction in evidence.predictions if prediction.kind == "lift"}
    measured = tilts.equation.sensed(posterior.unknowns.values(posterior.x))
    for (motion, _), lift, sensed in zip(tilts.motions, tilts.samples, measured, strict=True):
        if motion in used:
            yield used[motion], lift, sensed
