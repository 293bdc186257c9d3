"""Mass and planar CoM of a robot that stands still, from its joint torques."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from equipoise.errors import RecordingError
from equipoise.experiments.lift import LiftSettings, come_to_rest
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import StandTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, Trial, model_facts
from equipoise.robot.inertial import composite_parameters, nominal_inertia
from equipoise.robot.kinematics import foot_forces_from_torques, foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import torques_of_legs

_REST_TIME = 2.0  # [s]


def stand_still(standing: StandingRobot, stance: Stance, report: Callable[[Progress], None] | None) -> None:
    """Stand still for a while; arguments are those of `Method.run`."""
    if report is not None:
        report(Progress("standing still", 0, 1))
    motion = standing.motion().begin(StandTrial()).phase(Phase.MOVE)
    at_rest = LiftSettings(height=0.0, rest_time=_REST_TIME)
    come_to_rest(standing, motion.move_feet(stance.feet_in_base, 0.2), at_rest, "standing")
    standing.finish()


def estimate_standing(
    robot: RobotModel, recordings: Sequence[Recording], stance: Stance, settings: Mapping[str, Any]
) -> Calibration:
    """Estimate the planar CoM from the centre of pressure and the mass from the sum of foot forces.

    Raises:
        RecordingError: no recording of a standing robot, or no joint torques in it.
    """
    standing = [r for r in recordings if isinstance(r.trial, StandTrial) and r.complete]
    if not standing:
        raise RecordingError("the recordings contain no standing robot")
    rest = standing[-1].phase(Phase.REST).joints
    if rest.torque is None:
        raise RecordingError("the recording has no joint torques; the method 'static' needs them")
    position, torque = rest.position.mean(axis=0), rest.torque.mean(axis=0)
    lift = foot_forces_from_torques(robot, position, torque - torques_of_legs(robot, position))[:, 2]
    feet = foot_positions(robot, position)
    centre = lift @ feet[:, :2] / lift.sum()
    moved = composite_parameters(robot, stance.joint_position).com - composite_parameters(robot, position).com
    x, y = centre + moved[:2]
    mass = float(lift.sum() / np.linalg.norm(robot.pinocchio.gravity.linear))
    nominal = nominal_inertia(robot, stance.joint_position)
    return Calibration(
        **model_facts(robot, stance.joint_position),
        method=str(settings["method"]),
        composite=Body.partial(nominal.composite, mass, (float(x), float(y), None)),
        base=Body.partial(nominal.base),
        stance_effective=Body.partial(nominal.stance_effective),
        excitations={},
        support_lines={},
        trials=tuple(Trial(StandTrial.kind, "four feet", None, None, None, None, r.duration) for r in standing),
        settings=settings,
    )
