"""Geometric CoM estimate: every lift determines the CoM's distance from a support plane, and three planes meet in a point.

One lift gives a Newton step of the search. Lifts in tilted postures have inclined planes, which together determine the CoM in
three dimensions. This estimate neglects sensor biases and uses the model's inertia. It is accurate to a few millimetres only,
but independent of the more accurate posterior.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.momenta import model_parameters
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.unknowns import model_values
from equipoise.experiments.tilt import SupportPlane
from equipoise.robot.model import RobotModel

_FEWEST_PLANES = 6


def com_by_planes(robot: RobotModel, com: FloatArray, lifts: Sequence[LiftSamples]) -> FloatArray | None:
    """Return the (3,) point nearest to all support planes (least squares), or None with fewer than six lifts [m].

    Args:
        robot: model with the assumed CoM.
        com: (3,) CoM of that model at the nominal stance, in the base frame [m].
        lifts: lifts in tilted postures.
    """
    planes = support_planes(robot, com, lifts)
    if len(planes) < _FEWEST_PLANES:
        return None
    normals = np.array([plane.normal for plane in planes])
    distances = np.array([plane.distance_to(com) for plane in planes])
    return np.asarray(com - np.linalg.lstsq(normals, distances, rcond=None)[0], dtype=float)


def support_planes(robot: RobotModel, com: FloatArray, lifts: Sequence[LiftSamples]) -> list[SupportPlane]:
    """Solve the tilt equation of each lift for a shift of the CoM along the support plane's normal.

    Args:
        robot: model with the assumed CoM, from which all other parameters are taken.
        com: (3,) CoM of that model at the nominal stance, in the base frame [m].
        lifts: passive lifts.

    Returns:
        plane through the shifted CoM of each lift.
    """
    if not lifts:
        return []
    legs = LegChains(robot)
    equation = TiltInvariant(robot, legs, lifts)
    rows, _ = equation.rows(model_values(robot))
    inertial, rotation = model_parameters(robot), np.array(robot.imu_in_base.rotation)
    found: list[SupportPlane] = []
    for lift, trial in zip(lifts, equation.trials, strict=True):
        left_foot, right_foot = lift.stance_feet
        feet = legs.feet(lift.joint_position[:1])[0]
        normal = np.cross(feet[left_foot] - feet[right_foot], rotation @ lift.up_in_imu[0])
        normal /= np.linalg.norm(normal)
        own = rows[trial]
        design = np.column_stack([own[:, 1:4] @ normal * robot.mass, np.ones(len(own))])
        solution = np.linalg.lstsq(design, -own @ inertial, rcond=None)[0]
        found.append(SupportPlane(com, normal).moved(float(solution[0])))
    return found
