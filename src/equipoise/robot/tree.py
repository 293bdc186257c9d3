"""Kinematic tree of a model in Pinocchio, and the four legs in it."""

from __future__ import annotations

import itertools
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError, SettingsError
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.description import RobotDescription
from equipoise.robot.forward import legs_by_place
from equipoise.robot.source import ModelSource

_BACKLASH = 0.1  # [rad] between the limits of a joint that models backlash
_SAME_PLACE = 1e-3  # [m] between two parallel axes that are one
_PARALLEL = 1e-3  # [rad]
_ALONG = 0.98  # cosine of the angle to an axis


class Round(NamedTuple):
    """Sphere among the collision shapes of a link, or cylinder along its joint's axis.

    Attributes:
        centre: (3,) centre in the joint's frame [m].
        radius: radius [m].
        half_width: half the length of a cylinder; zero for a sphere [m].
    """

    centre: FloatArray
    radius: float
    half_width: float


Rounds = dict[str, list[Round]]
"""Round shapes by the name of the joint that moves them."""


def joint_axis(model: pin.Model, joint: int) -> FloatArray:
    """Return the (3,) axis of a one-axis joint, in the joint's own frame."""
    motion = _motion_of(model, joint)
    return motion[3:] if motion[3:].any() else motion[:3]


def _motion_of(model: pin.Model, joint: int) -> FloatArray:
    """Return the (6,) motion axis of a one-axis joint in its own frame: linear, then angular."""
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, pin.neutral(model))
    return np.array(data.S, dtype=float).reshape(6)


def read_pinocchio(source: ModelSource) -> tuple[pin.Model, Rounds]:
    """Return the cleaned file in Pinocchio, floating, and the round shapes that may be feet."""
    model, geometry = read_shapes(source)
    rounds: Rounds = {}
    for shape in geometry.geometryObjects:
        joint, kind, placement = shape.parentJoint, type(shape.geometry).__name__, shape.placement
        cylinder = kind == "Cylinder" and joint > 1
        along = float(np.array(placement.rotation)[:, 2] @ joint_axis(model, joint)) if cylinder else 0.0
        if kind == "Sphere" or abs(along) > _ALONG:
            half_width = float(shape.geometry.halfLength) if cylinder else 0.0
            found = Round(np.array(placement.translation), float(shape.geometry.radius), half_width)
            rounds.setdefault(str(model.names[joint]), []).append(found)
    return model, rounds


def read_shapes(source: ModelSource) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the cleaned file in Pinocchio, floating, and its collision shapes."""
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


def leg_chains(model: pin.Model, source: ModelSource) -> list[list[str]]:
    """Return the four legs as joint names from the hip down: four equally long chains that end in a leaf.

    A chain runs from a leaf joint up to the last joint above which the tree branches.
    """
    chains: list[list[int]] = []
    for leaf in (joint for joint in range(2, model.njoints) if not model.children[joint]):
        chain = [leaf]
        while (parent := model.parents[chain[0]]) > 1 and len(model.children[parent]) == 1:
            chain.insert(0, parent)
        chains.append(chain)
    by_length: dict[int, list[list[int]]] = {}
    for chain in chains:
        by_length.setdefault(len(chain), []).append(chain)
    legs = [group for length, group in by_length.items() if len(group) == 4 and length in (2, 3)]
    wheels = [str(model.names[chain[-1]]) for chain in by_length.get(4, []) if _turns_freely(model, chain[-1])]
    if not legs and len(wheels) == 4:
        raise ModelError(
            f"robot model {str(source.path)!r} stands on wheels (joints {', '.join(wheels)}), but equipoise needs feet that "
            "do not move. If your wheels are braked throughout, by their motors or by pins, make those joints fixed in a copy "
            "of the file, and give the wheels' radius as foot_radius in a robot configuration"
        )
    if len(legs) != 1:
        raise ModelError(
            f"robot model {str(source.path)!r} is not a supported quadruped: it needs exactly four legs of two or "
            f"three joints each; limbs found: {_limbs(model, by_length) or 'none'}{_not_leg_joints(model, chains, source)}"
        )
    for chain in legs[0]:
        _refuse_leg_joints(model, chain, source)
    names = [[str(model.names[joint]) for joint in chain] for chain in legs[0]]
    _refuse_coupled(source, {joint for chain in names for joint in chain})
    return names


def _limbs(model: pin.Model, by_length: dict[int, list[list[int]]]) -> str:
    """Count limbs by their number of joints, with the joints of one of each."""
    return ", ".join(
        f"{len(group)} of {length} joints ({', '.join(str(model.names[joint]) for joint in group[0])})"
        for length, group in sorted(by_length.items())
    )


def _not_leg_joints(model: pin.Model, chains: list[list[int]], source: ModelSource) -> str:
    """Advise on joints that keep limbs from being legs."""
    advice = ""
    odd = {str(model.names[joint]): kind for chain in chains for joint in chain if (kind := _odd_kind(model, joint))}
    if odd:
        kinds = " and ".join(dict.fromkeys(odd.values()))
        advice += f"; {', '.join(odd)} are {kinds}: make them fixed in a copy of the file if they do not move"
    if source.locked:
        advice += f"; {', '.join(source.locked)} are locked by equal limits: give the range of those that move"
    return advice


def _odd_kind(model: pin.Model, joint: int) -> str | None:
    """Return the kind of a joint that does not turn about one axis, or that hardly moves; None for others."""
    kind, at = _kind_unless_revolute(model, joint), model.joints[joint]
    if kind is not None or at.nq != 1:
        return kind
    span = float(model.upperPositionLimit[at.idx_q] - model.lowerPositionLimit[at.idx_q])
    return "hardly moving" if span < _BACKLASH else None


def _refuse_leg_joints(model: pin.Model, chain: list[int], source: ModelSource) -> None:
    """Refuse joints of a leg that do not turn about one axis, or about the same one as the joint before."""
    where = f"robot model {str(source.path)!r}"
    for joint in chain:
        body, *together = _in_one_body(source, str(model.names[joint]))
        if together:
            raise ModelError(
                f"{where}: body {body!r} of a leg has several joints, {' and '.join(together)}; legs need one joint per body: "
                f"remove {' and '.join(together[1:])} in a copy of the file"
            )
        if (kind := _kind_unless_revolute(model, joint)) is not None:
            raise ModelError(
                f"{where}: leg joint {str(model.names[joint])!r} is {kind}, and legs need joints that turn about one axis "
                "(revolute, continuous or hinge); if it does not move, make it fixed in a copy of the file"
            )
    for above, below in itertools.pairwise(chain):
        placement, axis = model.jointPlacements[below], joint_axis(model, above)
        distance = np.linalg.norm(np.cross(axis, placement.translation))
        if (
            distance < _SAME_PLACE
            and np.linalg.norm(np.cross(axis, placement.rotation @ joint_axis(model, below))) < _PARALLEL
        ):
            raise ModelError(
                f"{where}: leg joints {str(model.names[above])!r} and {str(model.names[below])!r} turn about the same axis; "
                "make the one that is not driven fixed in a copy of the file"
            )


def _in_one_body(source: ModelSource, joint: str) -> list[str]:
    """List a joint's body and, if Pinocchio joined several joints of the file, those, the widest range first."""
    for body in ET.fromstring(source.xml).iter("body"):
        joints = body.findall("joint")
        if len(joints) > 1 and joint == f"Composite_{joints[0].get('name')}":
            return [
                str(body.get("name")),
                *(str(each.get("name")) for each in sorted(joints, key=_range_of, reverse=True)),
            ]
    return [joint]


def _range_of(joint: ET.Element) -> float:
    words = joint.get("range", "-inf inf").split()
    return float(words[-1]) - float(words[0])


def _refuse_coupled(source: ModelSource, leg_joints: set[str]) -> None:
    coupled = [f"{' with '.join(joints)} ({element})" for element, joints in source.couplings if leg_joints & {*joints}]
    if coupled:
        raise ModelError(
            f"robot model {str(source.path)!r}: leg joints are coupled, but equipoise moves each independently: "
            f"{', '.join(coupled)}; if they are not coupled on the robot, remove the couplings in a copy of the file"
        )


def _kind_unless_revolute(model: pin.Model, joint: int) -> str | None:
    """Return the kind of a joint that does not turn about one axis, in words; None for one that does."""
    at = model.joints[joint]
    if at.nq != 1 or at.nv != 1:
        name = str(cast("Any", at).shortname()).removeprefix("JointModel")
        return {"FreeFlyer": "floating"}.get(name, f"of more than one axis ({name.lower()})")
    return None if _motion_of(model, joint)[3:].any() else "prismatic"


def _turns_freely(model: pin.Model, joint: int) -> bool:
    """Return whether a joint has no stops, as a wheel."""
    at = model.joints[joint]
    if at.nq != 1:  # Pinocchio's own joint without stops has a sine and a cosine
        return at.nv == 1
    lower, upper = float(model.lowerPositionLimit[at.idx_q]), float(model.upperPositionLimit[at.idx_q])
    return not lower < upper or upper - lower >= 2 * UNLIMITED_JOINT_RANGE


def hold_other_joints(
    model: pin.Model, chains: list[list[str]], description: RobotDescription, home: Mapping[str, float]
) -> tuple[pin.Model, dict[str, float]]:
    """Return the model with every joint that does not belong to a leg locked, and the position of each.

    The position is the description's, else that of the keyframe "home", else zero or the limit nearest to it.

    Raises:
        SettingsError: the description names another joint, or a position beyond its limits.
    """
    leg_joints = {joint for chain in chains for joint in chain}
    others = [str(name) for name in model.names[2:] if str(name) not in leg_joints]
    for joint in description.locked_joints:
        if joint not in others:
            hint = f"others are {', '.join(others)}" if others else "this robot has no others, so leave it out"
            raise SettingsError(f"locked_joints names {joint!r}, which is a leg joint or does not exist; {hint}")
    if not others:
        return model, {}
    configuration, locked = pin.neutral(model), dict.fromkeys(others, 0.0)
    for name in others:
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            locked[name] = configuration[joint.idx_q] = _locked_at(model, name, joint.idx_q, description, home)
        elif name in description.locked_joints:
            raise SettingsError(f"locked_joints names {name!r}, which has more than one axis")
    to_lock = [model.getJointId(name) for name in others]
    reduced, _ = pin.buildReducedModel(model, [pin.GeometryModel()], to_lock, configuration)
    return reduced, locked


def _locked_at(
    model: pin.Model, joint: str, index: int, description: RobotDescription, home: Mapping[str, float]
) -> float:
    """Return the position at which a joint is locked [rad]; `index` is its place in the model's positions."""
    lower, upper = float(model.lowerPositionLimit[index]), float(model.upperPositionLimit[index])
    position = description.locked_joints.get(joint)
    if not lower < upper:
        return home.get(joint, 0.0) if position is None else position
    if position is None:
        return min(max(home.get(joint, 0.0), lower), upper)
    if not lower <= position <= upper:
        raise SettingsError(
            f"locked_joints puts joint {joint!r} at {position:.3f} rad, outside its limits {lower:.3f} to {upper:.3f}; "
            "give its angle during the calibration, in radians"
        )
    return position


def hips_of(model: pin.Model, chains: list[list[str]]) -> FloatArray:
    """Return the (4, 3) hip pitch joints of the legs in the base frame, all joints at zero [m]."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    return np.array([np.array(data.oMi[model.getJointId(chain[-2])].translation) for chain in chains])


def name_legs(model: pin.Model, chains: list[list[str]]) -> dict[str, list[str]]:
    """Return the chains by leg name, from the places of the hips: x forward, y left in the base frame."""
    hips = hips_of(model, chains)
    named = dict(zip(legs_by_place(hips), chains, strict=True))
    if len(named) != 4:
        positions = "; ".join(f"({x:.3f}, {y:.3f}, {z:.3f})" for x, y, z in hips)
        raise ModelError(
            f"the four hips are not front left, front right, rear left and rear right of each other in the base frame "
            f"(x forward, y left): {positions}"
        )
    return named


def body_frame_of(model: pin.Model, joint: int) -> int:
    """Return the id of the frame of the link that the joint moves."""
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY:
            return index
    raise ModelError(f"joint {model.names[joint]!r} moves no link")
