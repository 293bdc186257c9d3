"""What a robot looks like at a posture, as primitive shapes: those of its model file, and stand-ins where it has none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.robot.model import RobotModel
from equipoise.robot.tree import read_shapes

FloatArray = NDArray[np.float64]

_THICKNESS = 0.06  # radius of a stand-in for a leg's link, over its length
_BASE_HEIGHT = 0.3  # of a stand-in for the base, over its length


@dataclass(frozen=True, eq=False)
class Shape:
    """A box, sphere, cylinder or capsule.

    Attributes:
        kind: which.
        part: "base" or "leg".
        size: half lengths of a box; radius, radius and half length along z of the others, without a capsule's caps [m].
        position: (3,) of its middle in the base frame [m].
        rotation: (3, 3) from its axes to the base's.
        from_model: whether the model file has it; else it stands in for what the file leaves out.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule"]
    part: Literal["base", "leg"]
    size: tuple[float, float, float]
    position: FloatArray
    rotation: FloatArray
    from_model: bool = True


def robot_shapes(robot: RobotModel, joint_position: FloatArray) -> list[Shape]:
    """All links at a posture; links without a primitive shape get a capsule along the leg, or a box between the hips.

    Args:
        joint_position: (nj,) of the leg joints [rad].
    """
    shapes, covered = _from_model(robot, joint_position)
    places = _joint_places(robot, joint_position)
    for leg in robot.legs.values():
        ends = [*(places[joint].translation for joint in leg.joint_ids), _foot(robot, places, leg.foot_frame_id)]
        for joint, start, end in zip(leg.joint_ids, ends[:-1], ends[1:], strict=True):
            if str(robot.pinocchio.names[joint]) not in covered:
                shapes += _capsule(start, end, leg.foot_radius)
        if not any(shape.kind == "sphere" and np.allclose(shape.position, ends[-1], atol=1e-3) for shape in shapes):
            shapes.append(
                Shape(
                    "sphere",
                    "leg",
                    (leg.foot_radius, leg.foot_radius, leg.foot_radius),
                    ends[-1],
                    np.eye(3),
                    from_model=False,
                )
            )
    if not any(shape.part == "base" for shape in shapes):
        shapes.append(_base_box(np.array([places[leg.joint_ids[0]].translation for leg in robot.legs.values()])))
    return shapes


def _from_model(robot: RobotModel, joint_position: FloatArray) -> tuple[list[Shape], set[str]]:
    """The file's own shapes, and the joints whose links have one that is more than a foot."""
    model, geometry = read_shapes(robot.source)
    configuration = pin.neutral(model)
    positions = {**robot.held, **dict(zip(robot.joint_names, joint_position, strict=True))}
    for name, position in positions.items():
        configuration[model.joints[model.getJointId(name)].idx_q] = position
    configuration[:7] = [0, 0, 0, 0, 0, 0, 1]
    data = model.createData()
    pin.forwardKinematics(model, data, configuration)
    shapes: list[Shape] = []
    covered: set[str] = set()
    for shape in geometry.geometryObjects:
        joint = str(model.names[shape.parentJoint])
        place = data.oMi[shape.parentJoint] * shape.placement
        part: Literal["base", "leg"] = "leg" if joint in robot.joint_names else "base"
        for kind, size in _primitive(shape.geometry):
            shapes.append(Shape(kind, part, size, np.array(place.translation), np.array(place.rotation)))
            covered |= set() if kind == "sphere" else {joint}
    return shapes, covered


def _primitive(geometry: Any) -> Iterator[tuple[Any, tuple[float, float, float]]]:
    """Kind and size; nothing for a shape of another kind."""
    kind = type(geometry).__name__.lower()
    if kind == "box":
        x, y, z = (float(half) for half in geometry.halfSide)
        yield kind, (x, y, z)
    elif kind in ("sphere", "cylinder", "capsule"):
        radius = float(geometry.radius)
        yield kind, (radius, radius, radius if kind == "sphere" else float(geometry.halfLength))


def _joint_places(robot: RobotModel, joint_position: FloatArray) -> dict[int, pin.SE3]:
    pin.forwardKinematics(robot.pinocchio, robot.pinocchio_data, robot.configuration(joint_position))
    return {joint: pin.SE3(robot.pinocchio_data.oMi[joint]) for joint in range(1, robot.pinocchio.njoints)}


def _foot(robot: RobotModel, places: dict[int, pin.SE3], frame_id: int) -> FloatArray:
    frame = robot.pinocchio.frames[frame_id]
    return np.array((places[frame.parentJoint] * frame.placement).translation)


def _capsule(start: FloatArray, end: FloatArray, foot_radius: float) -> Iterator[Shape]:
    """From one joint to the next; nothing if they coincide."""
    along = np.array(end) - np.array(start)
    length = float(np.linalg.norm(along))
    if length > foot_radius / 2:
        radius = max(0.6 * foot_radius, _THICKNESS * length)
        size = (radius, radius, length / 2)
        yield Shape("capsule", "leg", size, (np.array(start) + end) / 2, _turned_to(along / length), from_model=False)


def _turned_to(direction: FloatArray) -> FloatArray:
    """A rotation whose z axis is a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


def _base_box(hips: FloatArray) -> Shape:
    low, high = hips.min(axis=0), hips.max(axis=0)
    half = (high - low) / 2
    length, breadth = float(half[0]), float(half[1])
    return Shape("box", "base", (length, breadth, _BASE_HEIGHT * length), (low + high) / 2, np.eye(3), from_model=False)
