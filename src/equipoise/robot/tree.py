"""Legs in a kinematic tree: reading a model into Pinocchio, and finding in it what makes a quadruped."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError, SettingsError
from equipoise.robot.description import RobotDescription
from equipoise.robot.source import ModelSource

# Spheres among the collision shapes by the joint that moves them: placement in its frame, and radius [m].
Spheres = dict[str, list[tuple[pin.SE3, float]]]


def joint_axis(model: pin.Model, joint: int) -> FloatArray:
    """(3,) axis of a one-axis joint, in the joint's own frame."""
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, pin.neutral(model))
    motion = np.asarray(data.S).reshape(6)
    rotation = motion[3:]
    return np.array(rotation if np.linalg.norm(rotation) > 0 else motion[:3])


def read_pinocchio(source: ModelSource) -> tuple[pin.Model, Spheres]:
    """The cleaned file in Pinocchio, floating, and the spheres among its collision shapes."""
    model, geometry = read_shapes(source)
    spheres: Spheres = {}
    for shape in geometry.geometryObjects:
        if type(shape.geometry).__name__ == "Sphere":
            placement = pin.SE3(np.eye(3), np.array(shape.placement.translation))
            spheres.setdefault(str(model.names[shape.parentJoint]), []).append(
                (placement, float(shape.geometry.radius))
            )
    return model, spheres


def read_shapes(source: ModelSource) -> tuple[pin.Model, pin.GeometryModel]:
    """The cleaned file in Pinocchio, floating, and its collision shapes."""
    try:
        if source.format == "urdf":
            model = pin.buildModelFromXML(source.xml, pin.JointModelFreeFlyer())
            return model, pin.buildGeomFromUrdfString(model, source.xml, pin.GeometryType.COLLISION)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "model.xml"
            file.write_text(source.xml, encoding="utf-8")
            model = pin.buildModelFromMJCF(str(file))
            return model, pin.buildGeomFromMJCF(model, str(file), pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError, IndexError) as error:
        raise ModelError(f"robot model {str(source.path)!r} cannot be read by Pinocchio: {error}") from error


def leg_chains(model: pin.Model, path: Path) -> list[list[str]]:
    """The four legs as joint names from the hip down, found as four like chains that end in a leaf.

    A chain runs from a leaf joint up to the last joint above which the tree branches.
    """
    children: dict[int, list[int]] = {joint: [] for joint in range(model.njoints)}
    for joint in range(2, model.njoints):
        children[model.parents[joint]].append(joint)
    chains: list[list[int]] = []
    for leaf in (joint for joint in range(2, model.njoints) if not children[joint]):
        chain = [leaf]
        while (parent := model.parents[chain[0]]) > 1 and len(children[parent]) == 1:
            chain.insert(0, parent)
        chains.append(chain)
    by_length: dict[int, list[list[int]]] = {}
    for chain in chains:
        by_length.setdefault(len(chain), []).append(chain)
    legs = [group for length, group in by_length.items() if len(group) == 4 and length in (2, 3)]
    if len(legs) != 1:
        found = ", ".join(f"{len(group)} of {length} joints" for length, group in sorted(by_length.items())) or "none"
        raise ModelError(
            f"robot model {str(path)!r} is no quadruped that equipoise knows: it needs exactly four legs of two or three "
            f"joints each; limbs found: {found}"
        )
    return [[str(model.names[joint]) for joint in chain] for chain in legs[0]]


def hold_other_joints(
    model: pin.Model, chains: list[list[str]], description: RobotDescription
) -> tuple[pin.Model, dict[str, float]]:
    """The model with every joint that is no leg's locked, and where each was locked."""
    leg_joints = {joint for chain in chains for joint in chain}
    others = [str(name) for name in model.names[2:] if str(name) not in leg_joints]
    for joint in description.held:
        if joint not in others:
            raise SettingsError(f"held names {joint!r}, which is a leg joint or none; others are {', '.join(others)}")
    if not others:
        return model, {}
    configuration = pin.neutral(model)
    for joint, position in description.held.items():
        joint_id = model.getJointId(joint)
        if model.joints[joint_id].nq != 1:
            raise SettingsError(f"held joint {joint!r} has more than one axis")
        configuration[model.joints[joint_id].idx_q] = position
    to_lock = [model.getJointId(name) for name in others]
    reduced, _ = pin.buildReducedModel(model, [pin.GeometryModel()], to_lock, configuration)
    return reduced, {name: description.held.get(name, 0.0) for name in others}


def name_legs(model: pin.Model, chains: list[list[int]]) -> dict[str, list[int]]:
    """Chains by leg name, told by where the hips are: x forward, y left in the base frame."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    hips = np.array([np.array(data.oMi[chain[-2]].translation) for chain in chains])
    side = hips - hips.mean(axis=0)
    named = {
        ("F" if x > 0 else "R") + ("L" if y > 0 else "R"): chain for (x, y, _), chain in zip(side, chains, strict=True)
    }
    if len(named) != 4:
        positions = "; ".join(f"({x:.3f}, {y:.3f}, {z:.3f})" for x, y, z in hips)
        raise ModelError(
            f"the four hips are not front left, front right, rear left and rear right of each other in the base frame "
            f"(x forward, y left): {positions}"
        )
    return named


def body_frame_of(model: pin.Model, joint: int) -> int:
    """Id of the frame of the link that the joint moves."""
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY:
            return index
    raise ModelError(f"joint {model.names[joint]!r} moves no link")
