"""Recorded lifts played again in the simulator, with one body and with another: which tips as the robot did?

The joints do what the encoders measured, less the errors that the run found of them; the base begins as the sensors had it
when both feet were off the floor, and is free. Sensors and start are the same whichever body is played, and legs are a model
file's own: a result is the base with which the file's robot has the composite that was found, as an export writes it.

Only the time on two feet is played: a robot on four stands however its mass is distributed, and one on two topples, so that
what differs by a little soon differs by much.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, NotEstimatedError, SettingsError
from equipoise.estimator.diagnostics.held_out import LiftPrediction
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.tilt_invariant import SensedLift, integral
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.lab.replay.replayed_motion import TwoFootMotion
from equipoise.result.calibration import Calibration
from equipoise.result.held_out import FOUND, MODEL
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

SCHEMA = "equipoise.validation/1"
_ALIKE = 2.0  # times the other's error: legs that are not the file's, and the start, which has noise, make as much


@dataclass(frozen=True, eq=False)
class ReplayedLift:
    """One lift over time.

    Attributes:
        seen: the lift as it was measured: `motion`, `height`, `time` and `tilt`.
        about: diagonal, turn and posture, in words.
        errors: (n,) measured less simulated tilt, by whose body was played [rad].
    """

    seen: LiftPrediction
    about: str
    errors: Mapping[str, FloatArray]

    def error(self, body: str) -> float:
        """Error at the end, as a way of the CoM about the line [m]."""
        return self.seen.height * float(self.errors[body][-1])

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "motion": self.seen.motion,
            "about": self.about,
            "height": self.seen.height,
            "time": np.round(self.seen.time, 4).tolist(),
            "tilt": np.round(self.seen.tilt, 6).tolist(),
            "errors": {body: np.round(error, 6).tolist() for body, error in self.errors.items()},
        }


@dataclass(frozen=True, eq=False)
class Validation:
    """All lifts of a run, played again.

    Attributes:
        robot: name of the robot.
        lifts: lifts in order.
        joint_errors: largest difference of any joint from what was measured, by whose body was played [rad].
    """

    robot: str
    lifts: tuple[ReplayedLift, ...]
    joint_errors: Mapping[str, float]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Whose bodies were played: FOUND, MODEL and the others."""
        return tuple(self.lifts[0].errors)

    def error(self, body: str) -> float:
        """Root mean square over lifts of the error at the end [m]."""
        return float(np.sqrt(np.mean([lift.error(body) ** 2 for lift in self.lifts])))

    def ratio(self, body: str) -> float:
        """Error with a body over that with the one found."""
        return self.error(body) / self.error(FOUND)

    @property
    def message(self) -> str:
        """The answer in one line."""
        ratio, found, model = self.ratio(MODEL), 1000 * self.error(FOUND), 1000 * self.error(MODEL)
        said = f"{self.robot}: {len(self.lifts)} lifts played again tip as measured to {found:.2f} mm with the body found, "
        said += f"and to {model:.2f} mm with the model file's, {ratio:.1f} times as much"
        if ratio > _ALIKE:
            return f"{said}: the body found is nearer the robot's"
        if ratio < 1 / _ALIKE:
            return f"{said}: the model file's is nearer the robot's"
        return f"{said}: the lifts hardly tell the two apart"

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
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
    """Play the lifts of a run or a log again with the body found, with the model file's, and with others.

    Args:
        result: result of the method `bayesian`, with its recordings, as `RunFolder.estimate` and `estimate_log` have it.
        against: other models of the robot, or results of other runs of it, by the names to show.

    Raises:
        NotEstimatedError: the result has no lift that was used, or comes from a JSON file.
        SettingsError: another model or result is not of this robot.
        FallError: the simulation became unstable.
        MissingDependencyError: MuJoCo is not installed.
    """
    evidence, robot = result.evidence, result.robot_model
    lifted = isinstance(evidence, PosteriorEvidence) and any(one.kind == "lift" for one in evidence.predictions)
    if not isinstance(evidence, PosteriorEvidence) or not lifted or robot is None:
        raise NotEstimatedError(
            f"the result of {result.robot!r} by {result.method!r} has no lift to play again; validate takes runs and logs in "
            "which the method 'bayesian' found lifts"
        )
    players = _players(robot, {FOUND: result, MODEL: robot, **(against or {})})
    lifts: list[ReplayedLift] = []
    largest = dict.fromkeys(players, 0.0)
    for prediction, lift, sensed in _sensed(evidence):
        errors: dict[str, FloatArray] = {}
        for name, player in players.items():
            errors[name], missed = player.play(lift, sensed)
            largest[name] = max(largest[name], missed)
        lifts.append(ReplayedLift(prediction, result.trials[prediction.motion].about, errors))
    return Validation(result.robot, tuple(lifts), largest)


class _Player:
    """A body that lifts are played with.

    Args:
        joint_names: names of the recorded joint columns.
        robot: model that is simulated.
        base: base that it has instead of its own.
    """

    def __init__(self, joint_names: Sequence[str], robot: RobotModel, base: InertialParameters | None) -> None:
        try:
            from equipoise.lab.replay.in_mujoco import MujocoReplay  # noqa: PLC0415 - what estimates needs no engine
        except ModuleNotFoundError as error:
            raise MissingDependencyError(
                "to play lifts again needs MuJoCo: pip install 'equipoise[simulation]'"
            ) from error
        self._replay = MujocoReplay(robot, base)
        self._columns = [joint_names.index(name) for name in robot.joint_names]

    def play(self, lift: LiftSamples, sensed: SensedLift) -> tuple[FloatArray, float]:
        """(n,) measured less simulated tilt [rad], and the largest error of a joint [rad]."""
        done = self._replay.play(
            TwoFootMotion(
                lift.stance_feet, lift.step, sensed.joint_position[:, self._columns],
                sensed.joint_velocity[:, self._columns], sensed.up_in_base[0], sensed.angular_velocity_base_in_base[0],
            )
        )  # fmt: skip
        missed = sensed.angular_velocity_base_in_base - done.angular_velocity_base_in_base
        about_line = np.einsum("ni,ni->n", sensed.line_in_base, missed)
        return np.asarray(integral(len(missed), lift.step) @ about_line, dtype=float), done.joint_error


def _players(robot: RobotModel, bodies: Mapping[str, RobotModel | Calibration]) -> dict[str, _Player]:
    players: dict[str, _Player] = {}
    for name, body in bodies.items():
        if isinstance(body, Calibration):
            players[name] = _Player(robot.joint_names, robot, _base_of(name, robot, body))
        elif set(body.joint_names) != set(robot.joint_names):
            strange = sorted(set(body.joint_names) ^ set(robot.joint_names))
            raise SettingsError(
                f"--against {name}: its leg joints are not those of {robot.name!r}: {', '.join(strange[:4])}; give another "
                "model of the same robot"
            )
        else:
            players[name] = _Player(robot.joint_names, body, None)
    return players


def _base_of(name: str, robot: RobotModel, result: Calibration) -> InertialParameters:
    """The base with which the model file's robot has the composite of a result."""
    stance = nominal_stance(robot).joint_position
    same_stance = [result.joint_position.get(joint, np.inf) for joint in robot.joint_names]
    if result.model["sha256"] != robot.source.sha256 or not np.allclose(same_stance, stance):
        raise SettingsError(
            f"--against {name}: it is of {result.robot!r}, by another model file or at another stance than {robot.name!r} "
            "here; give the model file that it was exported to"
        )
    return InertialParameters.from_vector(result.base_for_model_legs)


def _sensed(evidence: PosteriorEvidence) -> Iterator[tuple[LiftPrediction, LiftSamples, SensedLift]]:
    """Every lift that the estimate uses; not the steps of a walk, of which each is too short to tell."""
    posterior = evidence.posterior
    tilts = posterior.problem.equation(TiltEquation)
    assert tilts is not None
    used = {prediction.motion: prediction for prediction in evidence.predictions if prediction.kind == "lift"}
    sensed = tilts.equation.sensed(posterior.unknowns.values(posterior.x))
    for (motion, _), lift, seen in zip(tilts.motions, tilts.samples, sensed, strict=True):
        if motion in used:
            yield used[motion], lift, seen
