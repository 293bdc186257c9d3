"""How far the CoM is from where it is thought to be, by one lift: a Newton step of the search, from momentum alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.estimation.leg_motion import LegChains
from equipoise.estimation.lift_samples import LiftSamples
from equipoise.estimation.tilt_equation import SensorBiases, TiltEquation
from equipoise.robot.inertial import base_parameters
from equipoise.robot.model import RobotModel

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CentreShift:
    """What one lift says of the CoM, with everything else by the model.

    Attributes:
        normal: (3,) of the support plane at rest, in the base frame, pointing forward.
        distance: by how much the CoM is farther along the normal than the model has it [m].
    """

    normal: FloatArray
    distance: float


def centre_shift(robot: RobotModel, lift: LiftSamples) -> CentreShift:
    """Solve the tilt equation of one lift for a shift of the CoM along the support plane's normal.

    Args:
        robot: its base is what the CoM is thought to be.
        lift: a passive lift.
    """
    legs = LegChains(robot)
    rotation = np.array(robot.imu_in_base.rotation)
    equation = TiltEquation(legs, rotation, [lift])
    rows, _ = equation.rows(SensorBiases.none(len(robot.joint_names)))
    inertial = np.concatenate([base_parameters(robot).to_pinocchio().toDynamicParameters(), np.ones(legs.links)])
    up = rotation @ lift.rest_acceleration / np.linalg.norm(lift.rest_acceleration)
    left_foot, right_foot = lift.stance_feet
    feet = legs.feet(lift.joint_position[:1])[0]
    normal = np.cross(feet[left_foot] - feet[right_foot], up)
    normal /= np.linalg.norm(normal)
    design = np.column_stack([rows[:, 1:4] @ normal * robot.mass, np.ones(len(rows))])
    solution = np.linalg.lstsq(design, -rows @ inertial, rcond=None)[0]
    return CentreShift(normal, float(solution[0]))
