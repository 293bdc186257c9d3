"""Predicted course of a Bayesian run."""

from __future__ import annotations

from equipoise.bayesian.excitation import excitation_time
from equipoise.bayesian.lift_design import lift_feet, lift_settings
from equipoise.bayesian.plan import Plan
from equipoise.bayesian.planning.candidates import describe
from equipoise.bayesian.settings import BayesianSettings
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.posture import feet_in_posture
from equipoise.method.rehearsal import Course, RehearsedPosture, excitation_postures, held_posture
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance


def rehearse(robot: RobotModel, stance: Stance, settings: BayesianSettings, plan: Plan) -> Course:
    """Return the description, duration and postures of a run with this plan."""
    postures, time = _planned_postures(robot, stance, plan), plan.robot_time
    search, excitation = (4, settings.excitation) if settings.prior_run is None else (2, False)
    if excitation:
        time += excitation_time(stance)
        postures += excitation_postures(robot, stance, ExcitationSettings())
    doing = (
        f"moves its body through {len(plan.visits)} postures with all feet on the floor, lifts two diagonal feet "
        f"{plan.lifts + search} times{', is turned by hand half-way, joints damped' if settings.rotate_halfway else ''}"
        f"{', oscillates its body about all axes' if excitation else ''}"
    )
    return Course(doing, time, tuple(postures))


def _planned_postures(robot: RobotModel, stance: Stance, plan: Plan) -> list[RehearsedPosture]:
    com, height = composite_parameters(robot, stance.joint_position).com, lift_settings(stance).height
    found: list[RehearsedPosture] = []
    for visit in plan.visits:
        name = describe(visit.posture)
        found.append(held_posture(robot, name, feet_in_posture(stance, com, visit.posture), stance.joint_position))
        for lift in visit.lifts:
            _, lifted = lift_feet(stance, com, lift, height)
            lift_name = f"{name}: two feet up, on {lift.diagonal}"
            ends = (0.0,) if lift.passive else (lift.amplitude(stance), -lift.amplitude(stance))
            for times, amount in zip((1, 0), ends, strict=False):
                feet = lift.feet(lifted, com, amount)
                found.append(
                    held_posture(robot, lift_name, feet, stance.joint_position, DIAGONALS[lift.diagonal], times)
                )
    return found
