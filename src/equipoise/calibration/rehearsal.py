"""A calibration thought through before anything moves: which postures, how far the joints go, what torques that takes.

From the model alone. A robot that carries what its model does not know needs more torque than is foretold here.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.calibration.settings import CalibrationSettings
from equipoise.conventions import AXES, FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.posture import feet_in_posture
from equipoise.experiments.sway import SwaySettings, extreme_feet, why_unreachable
from equipoise.paper.trial_runner import lift_heights, shifted_feet
from equipoise.precise.lift_design import AMPLITUDES, lift_feet, lift_settings, turned_feet
from equipoise.precise.plan import Plan, describe
from equipoise.precise.routine import plan_ahead
from equipoise.precise.sway import sway_time
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance, lying_posture, nominal_stance
from equipoise.robot.statics import static_torques

_AROUND = 12.0  # [s] on an A1: looking, standing up, lying down, damping
_LIFT_TIME = 4.6  # [s] of one trial of the search, on an A1
_SWAYS_TIME = 17.0  # [s] of the paper's three sways, on an A1


@dataclass(frozen=True, eq=False)
class RehearsedPosture:
    """One posture.

    Attributes:
        what: it is, in words.
        joint_position: (nj,) [rad].
        torque: (nj,) that holds it, by the model [Nm].
        times: how often it is taken; 0 at the far end of a turn or a sway, which is counted at the near one.
    """

    what: str
    joint_position: FloatArray
    torque: FloatArray
    times: int = 1


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """What a calibration would do.

    Attributes:
        robot: the robot.
        method: of the calibration.
        postures: in order; lying first.
        duration: of all of it, on the robot [s].
        plan: of the method `precise`.
    """

    robot: RobotModel
    method: str
    postures: tuple[RehearsedPosture, ...]
    duration: float
    plan: Plan | None

    @property
    def joint_range(self) -> FloatArray:
        """(2, nj) lowest and highest joint positions, lying included [rad]."""
        positions = np.array([posture.joint_position for posture in self.postures])
        return np.array([positions.min(axis=0), positions.max(axis=0)])

    @property
    def largest_torque(self) -> FloatArray:
        """(nj,) largest torque either way [Nm]."""
        return np.abs([posture.torque for posture in self.postures]).max(axis=0)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        names, (lower, upper) = self.robot.joint_names, self.joint_range.tolist()
        torques, limits = self.largest_torque.tolist(), self.robot.effort_limit.tolist()
        rows = zip(names, lower, upper, torques, limits, strict=True)
        return {
            "robot": self.robot.name,
            "method": self.method,
            "duration": self.duration,
            "joints": {
                name: {"from": low, "to": high, "torque": torque, "torque_limit": limit if np.isfinite(limit) else None}
                for name, low, high, torque, limit in rows
            },
            "postures": [
                {"what": posture.what, "times": posture.times, "joint_position": posture.joint_position.tolist(),
                 "torque": posture.torque.tolist()}
                for posture in self.postures
            ],
        }  # fmt: skip


def rehearse(robot: RobotModel, settings: CalibrationSettings) -> Rehearsal:
    """Think a calibration through; moves nothing.

    Raises:
        SettingsError: a setting does not fit the robot.
        ReachError: something is out of reach.
    """
    stance = nominal_stance(robot)
    lying, _ = lying_posture(robot, stance)
    ends = [
        RehearsedPosture("lying", lying, np.zeros_like(lying)),
        _held(robot, "nominal stance", stance.feet_in_base, stance.joint_position),
    ]
    plan = plan_ahead(robot, stance, settings.precise) if settings.method == "precise" else None
    if plan is not None:
        postures, time = list(_of_plan(robot, stance, plan)), plan.robot_time
        if settings.precise.sway:
            time += sway_time(stance)
            postures += _of_sways(robot, stance, settings.sway)
    elif settings.method == "paper":
        postures, time = _of_search(robot, stance, settings)
        postures += _of_sways(robot, stance, settings.sway)
    else:
        postures, time = [], 3.0
    return Rehearsal(robot, settings.method, (*ends, *postures), time + _AROUND * stance.scale.time, plan)


def _held(
    robot: RobotModel,
    what: str,
    feet: FloatArray,
    guess: FloatArray,
    legs: tuple[str, ...] = LEG_NAMES,
    times: int = 1,
) -> RehearsedPosture:
    position = inverse_kinematics(robot, feet, guess)
    return RehearsedPosture(what, position, static_torques(robot, position, legs), times)


def _of_plan(robot: RobotModel, stance: Stance, plan: Plan) -> Generator[RehearsedPosture]:
    com, height = composite_parameters(robot, stance.joint_position).com, lift_settings(stance).height
    for visit in plan.visits:
        where = describe(visit.posture)
        yield _held(robot, where, feet_in_posture(stance, com, visit.posture), stance.joint_position)
        for lift in visit.lifts:
            _, lifted = lift_feet(stance, com, lift, height)
            what = f"{where}: two feet up, on {lift.diagonal}"
            ends = (0.0,) if lift.turn is None else (AMPLITUDES[lift.turn], -AMPLITUDES[lift.turn])
            for times, angle in zip((1, 0), ends, strict=False):
                feet = turned_feet(lifted, com, lift.turn, angle)
                yield _held(robot, what, feet, stance.joint_position, DIAGONALS[lift.diagonal], times)


def _of_search(
    robot: RobotModel, stance: Stance, settings: CalibrationSettings
) -> tuple[list[RehearsedPosture], float]:
    lower, upper = settings.com_search.bounds(stance)
    height = lift_heights(settings.com_search.lift(stance))[-1]
    halvings = int(np.ceil(np.log2((upper - lower) / settings.com_search.tolerance)))
    found: list[RehearsedPosture] = []
    for diagonal, legs in DIAGONALS.items():
        for offset in (lower, upper):
            feet = shifted_feet(stance, offset)
            feet[[leg not in legs for leg in LEG_NAMES], 2] += height
            what = f"lines at {offset * 1000:+.0f} mm: two feet up by up to {height * 1000:.0f} mm, on {diagonal}"
            found.append(_held(robot, what, feet, stance.joint_position, legs, halvings))
    return (
        found,
        2 * halvings * _LIFT_TIME * stance.scale.time / settings.com_search.speed + _SWAYS_TIME * stance.scale.time,
    )


def _of_sways(robot: RobotModel, stance: Stance, settings: SwaySettings) -> list[RehearsedPosture]:
    found: list[RehearsedPosture] = []
    for axis in AXES:
        if why_unreachable(robot, stance, axis, settings) is not None:
            continue
        for times, feet in zip((1, 0), extreme_feet(robot, stance, axis, settings), strict=True):
            try:
                found.append(_held(robot, f"sway about {axis}", feet, stance.joint_position, times=times))
            except ReachError:
                continue
    return found
