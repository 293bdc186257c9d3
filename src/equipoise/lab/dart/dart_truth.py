"""Ground truth of a robot in DART, computed by DART without code of the estimators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from dartpy import dynamics

from equipoise.conventions import FloatArray
from equipoise.lab.dart.dart_model import SimulatedDartRobot
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.simulation.ground_truth_view import GroundTruth
from equipoise.simulation.leg_errors import in_frame_of_hips


def dart_truth(robot: RobotModel, simulated: SimulatedDartRobot, joint_position: FloatArray) -> RobotInertia:
    """Compute the true inertial parameters at a stance, including payload and leg errors, in the frame of the hips.

    `robot` is only used for the names of the knee joints.

    Args:
        joint_position: (nj,) true joint positions of the stance [rad].
    """
    skeleton = simulated.skeleton.clone()
    positions = np.zeros(skeleton.getNumDofs())
    positions[simulated.dofs] = joint_position
    skeleton.setPositions(positions)
    composite = _frozen(skeleton)
    for leg in robot.legs.values():
        skeleton.getJoint(leg.joint_names[-1]).getChildBodyNode().remove()
    stance_effective = _frozen(skeleton)
    base = skeleton.getRootBodyNode()
    while base.getNumChildBodyNodes():
        base.getChildBodyNode(0).remove()
    bodies = (composite, _frozen(skeleton), stance_effective)
    return RobotInertia(*(in_frame_of_hips(body, simulated.errors) for body in bodies))


def _frozen(skeleton: dynamics.Skeleton) -> InertialParameters:
    """Return all bodies as one, in the base frame at the world's origin, where the mass matrix contains their inertia."""
    mass, com = skeleton.getMass(), np.array(skeleton.getCOM())
    about_origin = np.array(skeleton.getMassMatrix())[:3, :3]
    return InertialParameters(mass, com, about_origin - mass * (com @ com * np.eye(3) - np.outer(com, com)))


def ground_truth_of(simulated: SimulatedDartRobot) -> Callable[[], GroundTruth]:
    """Return a function for the true state of the simulated robot at the present moment, for evaluation only."""
    up = -np.array(simulated.errors.gravity_direction)
    radii = np.array([foot.getShape().getRadius() for foot in simulated.feet])

    def look() -> GroundTruth:
        feet = np.array([foot.getWorldTransform().translation() for foot in simulated.feet])
        cosine = float(simulated.base.getTransform().rotation()[:, 2] @ up)
        return GroundTruth(
            float(simulated.world.getTime()),
            feet,
            feet[:, 2] - radii,
            np.array(simulated.skeleton.getCOM()),
            up,
            float(np.arccos(np.clip(cosine, -1, 1))),
        )

    return look
