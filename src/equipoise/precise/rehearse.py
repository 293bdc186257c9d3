"""What a run of the precise method does, before it is done."""

from __future__ import annotations

from equipoise.experiments.posture import feet_in_posture
from equipoise.experiments.sway_settings import SwaySettings
from equipoise.method.rehearsal import Course, RehearsedPosture, held_posture, sway_postures
from equipoise.precise.lift_design import lift_feet, lift_settings
from equipoise.precise.plan import Plan
from equipoise.precise.planning.candidates import describe
from equipoise.precise.settings import PreciseSettings
from equipoise.precise.sway import sway_time
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance


def rehearse(robot: RobotModel, stance: Stance, settings: PreciseSettings, plan: Plan) -> Course:
    """Return what a run does by its plan: in words, how long, and through which postures."""
    postures, time = _planned_postures(robot, stance, plan), plan.robot_time
    search, sway = (4, settings.sway) if settings.known is None else (2, False)
    if sway:
        time += sway_time(stance)
        postures += sway_postures(robot, stance, SwaySettings())
    doing = (
        f"moves its body over planted feet through {len(plan.visits)} postures, lifts two diagonal feet "
        f"{plan.lifts + search} times{', is turned by hand half-way, lying limp' if settings.turn else ''}"
        f"{', sways' if sway else ''}"
    )
    return Course(doing, time, tuple(postures))


def _planned_postures(robot: RobotModel, stance: Stance, plan: Plan) -> list[RehearsedPosture]:
    com, height = composite_parameters(robot, stance.joint_position).com, lift_settings(stance).height
    found: list[RehearsedPosture] = []
    for visit in plan.visits:
        where = describe(visit.posture)
        found.append(held_posture(robot, where, feet_in_posture(stance, com, visit.posture), stance.joint_position))
        for lift in visit.lifts:
            _, lifted = lift_feet(stance, com, lift, height)
            what = f"{where}: two feet up, on {lift.diagonal}"
            ends = (0.0,) if lift.passive else (lift.amplitude(stance), -lift.amplitude(stance))
            for times, amount in zip((1, 0), ends, strict=False):
                feet = lift.feet(lifted, com, amount)
                found.append(held_posture(robot, what, feet, stance.joint_position, DIAGONALS[lift.diagonal], times))
    return found
