"""Geometric CoM estimate: every lift determines the CoM's distance from a support plane, and three planes meet in a point.

One lift gives a Newton step of the search. Lifts in tilted postures have inclined planes, which together determine the CoM in
three dimensions. This estimate neglects sensor biases and uses the model's inertia. It is accurate to a few millimetres only,
but independent of the more accurate posterior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.momenta import model_parameters
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.unknowns import model_values
from equipoise.robot.model import RobotModel

_FEWEST_PLANES = 6


@dataclass(frozen=True, eq=False)
class CentreShift:
    """CoM shift from one lift, with all other parameters from the model.

    Attributes:
        normal: (3,) normal of the support plane at rest, in the base frame, pointing forward.
        distance: shift of the CoM along the normal, relative to the model [m].
    """

    normal: FloatArray
    distance: float


@dataclass(frozen=True, eq=False)
class PlaneReading:
    """CoM from support planes.

    Attributes:
        com: (3,) CoM at the nominal stance, in the base frame [m].
        std: (3,) standard deviations, from the residuals of the planes [m].
    """

    com: FloatArray
    std: FloatArray


def com_by_planes(robot: RobotModel, com: FloatArray, lifts: Sequence[LiftSamples]) -> PlaneReading | None:
    """Return the point nearest to all support planes (least squares), or None with fewer than six lifts.

    Args:
        robot: model with the assumed CoM.
        com: (3,) CoM of that model at the nominal stance, in the base frame [m].
        lifts: lifts in tilted postures.
    """
    shifts = centre_shifts(robot, lifts)
    if len(shifts) < _FEWEST_PLANES:
        return None
    normals = np.array([shift.normal for shift in shifts])
    distances = np.array([shift.distance for shift in shifts])
    solution = np.linalg.lstsq(normals, distances, rcond=None)[0]
    residuals = distances - normals @ solution
    variance = float(residuals @ residuals) / max(1, len(residuals) - 3)
    covariance = variance * np.linalg.pinv(normals.T @ normals)
    return PlaneReading(com + solution, np.sqrt(np.diag(covariance)))


def centre_shift(robot: RobotModel, lift: LiftSamples) -> CentreShift:
    """Return the `centre_shifts` of one lift."""
    return centre_shifts(robot, [lift])[0]


def centre_shifts(robot: RobotModel, lifts: Sequence[LiftSamples]) -> list[CentreShift]:
    """Solve the tilt equation of each lift for a shift of the CoM along the support plane's normal.

    Args:
        robot: model with the assumed CoM.
        lifts: passive lifts.
    """
    if not lifts:
        return []
    legs = LegChains(robot)
    equation = TiltInvariant(robot, legs, lifts)
    rows, _ = equation.rows(model_values(robot))
    inertial, rotation = model_parameters(robot), np.array(robot.imu_in_base.rotation)
    found: list[CentreShift] = []
    for lift, trial in zip(lifts, equation.trials, strict=True):
        left_foot, right_foot = lift.stance_feet
        feet = legs.feet(lift.joint_position[:1])[0]
        normal = np.cross(feet[left_foot] - feet[right_foot], rotation @ lift.up_in_imu[0])
        normal /= np.linalg.norm(normal)
        own = rows[trial]
        design = np.column_stack([own[:, 1:4] @ normal * robot.mass, np.ones(len(own))])
        solution = np.linalg.lstsq(design, -own @ inertial, rcond=None)[0]
        found.append(CentreShift(normal, float(solution[0])))
    return found
