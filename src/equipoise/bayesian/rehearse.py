"""Predicted course of a Bayesian run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from equipoise.bayesian.excitation import ALL_AXES_SETTINGS
from equipoise.bayesian.lift_design import LiftDesign, lift_feet, lift_settings
from equipoise.bayesian.plan import SEARCH, Plan
from equipoise.bayesian.planning.candidates import describe
from equipoise.bayesian.settings import BayesianSettings
from equipoise.conventions import FloatArray
from equipoise.experiments.posture import feet_in_posture
from equipoise.method.rehearsal import Course, RehearsedPosture, excitation_postures, held_posture
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance


def rehearse(robot: RobotModel, stance: Stance, settings: BayesianSettings, plan: Plan) -> Course:
    """Return the description, duration and postures of a run with this plan."""
    postures, lifts = _planned_postures(robot, stance, plan), plan.lifts + plan.search * len(DIAGONALS)
    if plan.excitation:
        postures += excitation_postures(robot, stance, ALL_AXES_SETTINGS)
    doing = (
        f"moves its body through {len(plan.visits)} postures with all feet on the floor, lifts two diagonal feet {lifts} times"
        f"{', is turned by hand half-way, joints damped' if settings.rotate_halfway else ''}"
        f"{', oscillates its body about every axis within reach' if plan.excitation else ''}"
    )
    return Course(doing, plan.robot_time, tuple(postures), lies=settings.rotate_halfway, replans=True)


def _planned_postures(robot: RobotModel, stance: Stance, plan: Plan) -> list[RehearsedPosture]:
    com = composite_parameters(robot, stance.joint_position).com
    search = [LiftDesign(BodyPosture(), diagonal, side) for diagonal in DIAGONALS for side in range(plan.search)]
    found: list[RehearsedPosture] = []
    for index, visit in enumerate(plan.visits):
        if index == plan.before_search:
            found += _lift_postures(robot, stance, com, SEARCH, search)
        name = describe(visit.posture)
        found.append(held_posture(robot, name, feet_in_posture(stance, com, visit.posture), stance.joint_position))
        found += _lift_postures(robot, stance, com, name, visit.lifts)
    return found


def _lift_postures(
    robot: RobotModel, stance: Stance, com: FloatArray, name: str, lifts: Sequence[LiftDesign]
) -> Iterator[RehearsedPosture]:
    for lift in lifts:
        _, lifted = lift_feet(stance, com, lift, lift_settings(stance).height)
        lift_name = f"{name}: two feet up, on {lift.diagonal}"
        ends = (0.0,) if lift.passive else (lift.amplitude(stance), -lift.amplitude(stance))
        # The other end of an oscillation counts as the same lift.
        for times, amount in zip((1, 0), ends, strict=False):
            feet = lift.feet(lifted, com, amount)
            yield held_posture(robot, lift_name, feet, stance.joint_position, DIAGONALS[lift.diagonal], times)
