"""Simple shapes on a robot's links: those of its model file, and stand-ins for links without any.

Meshes are not read: they are made for display, and may be missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import coal  # the collision library of Pinocchio
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.clearance.stand_ins import BASE_JOINT, LIMB_RADIUS_RATIO, capsule, leg_limbs, trunk_box
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import body_frame_of, read_shapes

_SIMPLE = ("Box", "Sphere", "Cylinder", "Capsule")
_ARM_SHARE = 0.6  # of a limb's radius


def robot_shapes(robot: RobotModel) -> pin.GeometryModel:
    """Return shapes on the joints of `robot.pinocchio`, each named by its link and a number."""
    locked = _locked_configuration(robot)
    of_file, shapes = _of_the_file(robot, locked), pin.GeometryModel()
    for link, shape in (*of_file, *_stand_ins(robot, locked, of_file)):
        shape.name = f"{link} {shapes.ngeoms}"
        shapes.addGeometryObject(shape)
    return shapes


def link_of(shape: pin.GeometryObject) -> str:
    """Return the name of the link of a shape from `robot_shapes`."""
    return shape.name.rpartition(" ")[0]


@dataclass(frozen=True, eq=False)
class Spheres:
    """Bounding spheres of shapes, for fast rejection of pairs.

    Attributes:
        joint: (n,) id of the parent joint of each shape.
        centre: (n, 3) centres in the parent joints' frames [m].
        radius: (n,) radii [m].
    """

    joint: NDArray[np.intp]
    centre: FloatArray
    radius: FloatArray

    @classmethod
    def around(cls, shapes: Iterable[pin.GeometryObject]) -> Spheres:
        """Return the bounding spheres of shapes."""
        joints, centres, radii = zip(*((shape.parentJoint, *_sphere(shape)) for shape in shapes), strict=True)
        return cls(np.array(joints), np.array(centres), np.array(radii))

    def placed(self, joint_poses: Sequence[pin.SE3]) -> FloatArray:
        """Return the (n, 3) centres in the frame of `joint_poses`, which are indexed by joint id [m]."""
        used = [int(joint) for joint in np.unique(self.joint)]
        rotation, translation = np.zeros((used[-1] + 1, 3, 3)), np.zeros((used[-1] + 1, 3))
        for joint in used:
            rotation[joint], translation[joint] = joint_poses[joint].rotation, joint_poses[joint].translation
        return (rotation[self.joint] @ self.centre[:, :, None])[:, :, 0] + translation[self.joint]


def _sphere(shape: pin.GeometryObject) -> tuple[FloatArray, float]:
    geometry: coal.CollisionGeometry = shape.geometry
    geometry.computeLocalAABB()
    return shape.placement.act(geometry.aabb_center), geometry.aabb_radius


def locked_links(robot: RobotModel) -> set[str]:
    """Return the names of links behind locked joints, such as an arm's, which are fixed to the base but not to the trunk."""
    model = robot.full_pinocchio
    joints = {model.getJointId(name) for name in robot.locked_joints}
    return {str(f.name) for f in model.frames if f.parentJoint in joints and f.type == pin.FrameType.BODY}


Named = tuple[str, pin.GeometryObject]


def _locked_configuration(robot: RobotModel) -> FloatArray:
    """Return the configuration of the full model with its base at the origin and locked joints at their angles."""
    model = robot.full_pinocchio
    configuration = pin.neutral(model)
    for name, angle in robot.locked_joints.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            configuration[joint.idx_q] = angle
    return configuration


def _of_the_file(robot: RobotModel, locked: FloatArray) -> list[Named]:
    model, shapes = read_shapes(robot.source)
    to_lock = [model.getJointId(name) for name in robot.locked_joints]
    if to_lock:
        model, (shapes,) = pin.buildReducedModel(model, [shapes], to_lock, locked)
    simple = (shape for shape in shapes.geometryObjects if type(shape.geometry).__name__ in _SIMPLE)
    return [(str(model.frames[shape.parentFrame].name), shape) for shape in simple]


def _stand_ins(robot: RobotModel, locked: FloatArray, of_file: list[Named]) -> Iterator[Named]:
    """Generate stand-ins for feet, and for the base, leg links and locked links without shapes in the file."""
    solid = [(link, shape) for link, shape in of_file if not isinstance(shape.geometry, coal.Sphere)]
    shown = {shape.parentJoint for _, shape in solid}
    if not any(shape.parentJoint == BASE_JOINT for _, shape in of_file):
        edges, middle = trunk_box(robot)
        yield robot.base_link, pin.GeometryObject("", BASE_JOINT, pin.SE3(np.eye(3), middle), coal.Box(*edges))
    for limb in leg_limbs(robot, shown):
        yield _link_name(robot.pinocchio, limb.parentJoint), limb
    for foot in robot.legs.values():
        frame, sphere = robot.pinocchio.frames[foot.foot_frame_id], coal.Sphere(foot.foot_radius)
        shape = pin.GeometryObject("", frame.parentJoint, frame.placement, sphere)
        yield _link_name(robot.pinocchio, frame.parentJoint), shape
    yield from _locked_limbs(robot, locked, {link for link, _ in of_file})


def _locked_limbs(robot: RobotModel, locked: FloatArray, shown: set[str]) -> Iterator[Named]:
    """Generate capsules on the base along links of locked joints: to the next joint, or to twice the distance of the CoM."""
    model = robot.full_pinocchio
    data, radius = model.createData(), _ARM_SHARE * LIMB_RADIUS_RATIO * robot.leg_length
    pin.forwardKinematics(model, data, locked)
    joints = [model.getJointId(name) for name in robot.locked_joints]
    for joint in joints:
        link, place = _link_name(model, joint), data.oMi[joint]
        ends = [np.array(data.oMi[below].translation) for below in joints if model.parents[below] == joint]
        for end in ends or [place.rotation @ (2 * model.inertias[joint].lever) + place.translation]:
            if link not in shown and np.linalg.norm(end - place.translation) > radius:
                yield link, capsule(BASE_JOINT, np.array(place.translation), end, radius)


def _link_name(model: pin.Model, joint: int) -> str:
    return str(model.frames[body_frame_of(model, joint)].name)
