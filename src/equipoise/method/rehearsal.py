"""Motions of a method, from the model alone: postures, torques, duration, and the predicted accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from equipoise.conventions import AXES, FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.excitation import extreme_feet, why_unreachable
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.posture import check_clear
from equipoise.result.findings import Link
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import static_torques


@dataclass(frozen=True, eq=False)
class RehearsedPosture:
    """Posture of a rehearsal.

    Attributes:
        what: description of the posture.
        joint_position: (nj,) joint positions [rad].
        torque: (nj,) joint torques that hold the model's posture [Nm].
        times: number of times it is reached; 0 at the far end of a rotation or excitation, counted at the near end.
    """

    what: str
    joint_position: FloatArray
    torque: FloatArray
    times: int = 1


@dataclass(frozen=True, eq=False)
class Course:
    """Motions of a method between standing up and lying down.

    Attributes:
        doing: description of the motions, for "the robot stands up, ... and ends where it began".
        duration: robot time [s].
        postures: postures in order, without the nominal stance.
        lies: True if the robot lies down in between.
        replans: True if postures are planned again from measurements.
    """

    doing: str
    duration: float
    postures: tuple[RehearsedPosture, ...] = ()
    lies: bool = False
    replans: bool = False


class Forecast(Protocol):
    """Predicted accuracy of a result, and its trials.

    Attributes:
        robot_time: expected robot time [s].
        body: (10,) assumed mass [kg], CoM in the base frame [m] and inertia about it [kg m2] of the whole robot.
        std: (10,) predicted standard deviations of these.
        left_out: motions that the robot cannot do, with reasons.
        std_without_prior_run: (10,) the same without the prior run, in the same duration; None: no prior run.
        links: leg links by name, with predicted standard deviations; empty unless the method estimates them.
    """

    @property
    def links(self) -> Mapping[str, Link]: ...
    @property
    def std_without_prior_run(self) -> FloatArray | None: ...
    @property
    def robot_time(self) -> float: ...
    @property
    def body(self) -> FloatArray: ...
    @property
    def std(self) -> FloatArray: ...
    @property
    def left_out(self) -> tuple[str, ...]: ...

    def trials(self) -> Sequence[tuple[str, Mapping[str, str]]]:
        """Return the postures in order, each with descriptions of its lifts by diagonal."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        ...


def held_posture(
    robot: RobotModel,
    what: str,
    feet: FloatArray,
    guess: FloatArray,
    legs: Sequence[str] = LEG_NAMES,
    times: int = 1,
) -> RehearsedPosture:
    """Return a posture with the torques that hold it.

    Args:
        feet: (4, 3) centres of the feet in the base frame [m].
        guess: (nj,) joint positions near the posture [rad].
        legs: names of the standing legs.

    Raises:
        ReachError: the posture is out of reach, or links touch.
    """
    position = inverse_kinematics(robot, feet, guess)
    check_clear(robot, position)
    return RehearsedPosture(what, position, static_torques(robot, position, tuple(legs)), times)


def excitation_postures(robot: RobotModel, stance: Stance, settings: ExcitationSettings) -> list[RehearsedPosture]:
    """Return the postures at both ends of the excitation about each reachable axis."""
    found: list[RehearsedPosture] = []
    for axis in AXES:
        if why_unreachable(robot, stance, axis, settings) is not None:
            continue
        for times, feet in zip((1, 0), extreme_feet(robot, stance, axis, settings), strict=True):
            try:
                found.append(held_posture(robot, f"excitation about {axis}", feet, stance.joint_position, times=times))
            except ReachError:
                continue
    return found
