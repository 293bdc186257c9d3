"""Legs of a quadruped: joints, length and feet."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.tree import Round, Rounds, body_frame_of, joint_axis, name_legs

# A model without foot spheres gets feet of this fraction of the leg length: Solo's 16 mm feet on 0.32 m legs.
_DEFAULT_FOOT_RADIUS_RATIO = 0.05
# Frames nearer to the knee's axis belong to the knee [m; of the thigh's length]: motors and rotors are up to 0.05 off.
_SHORTEST_SHANK, _SHANK_RATIO = 5e-3, 0.2
_ADD_FOOT = (
    'add a fixed link at the foot\'s centre in a copy of the file (a <link> and a <joint type="fixed"> whose origin is there, '
    "or a site in MJCF)"
)


@dataclass(frozen=True)
class Leg:
    """Leg, from the hip down.

    Attributes:
        name: name of the leg, FL, FR, RL or RR.
        joint_names: names of its joints from the hip down; the last is the knee, the one before it the hip pitch.
        joint_ids: ids of the same joints in the Pinocchio model.
        joints: indices of the same joints in the robot's joint vectors.
        foot_frame_id: Pinocchio's id of the frame at the foot's centre.
        foot_body: name of the foot's link.
        foot_in_body: place of the foot's centre on that link [m].
        foot_radius: radius of the foot [m].
        foot_half_width: half-width of a cylindrical foot along the knee's axis [m]; zero for a ball.
    """

    name: str
    joint_names: tuple[str, ...]
    joint_ids: tuple[int, ...]
    joints: tuple[int, ...]
    foot_frame_id: int
    foot_body: str
    foot_in_body: tuple[float, ...]
    foot_radius: float
    foot_half_width: float


def add_legs(
    model: pin.Model, chains: list[list[str]], rounds: Rounds, description: RobotDescription, robot: str, path: Path
) -> dict[str, Leg]:
    """Return the legs FL FR RL RR of a model, and add a frame at the centre of each foot to the model.

    Args:
        model: Pinocchio model with leg joints only.
        chains: names of each leg's joints from the hip down.
        rounds: spheres among the collision shapes, and cylinders along the joints' axes.
        description: robot configuration, for foot frames and radius.
        robot: name of the robot, for messages.
        path: path of its model file, for messages.
    """
    by_leg = name_legs(model, chains)
    legs: dict[str, Leg] = {}
    guessing = False
    for leg in LEG_NAMES:
        names = by_leg[leg]
        ids = tuple(int(model.getJointId(name)) for name in names)
        knee, below = ids[-1], rounds.get(names[-1], [])
        if leg in description.foot_frames:
            centre, shape = _described_foot(model, knee, leg, description.foot_frames[leg], below, robot)
        else:
            centre, shape = _found_foot(model, knee, leg, below, path)
        radius = description.foot_radius or (shape.radius if shape else 0.0)
        guessing |= radius == 0.0
        placement, body_id = pin.SE3(np.eye(3), centre), body_frame_of(model, knee)
        body = model.frames[body_id]
        frame = pin.Frame(f"equipoise_{leg}_foot", knee, body_id, placement, pin.FrameType.OP_FRAME)
        legs[leg] = Leg(
            name=leg,
            joint_names=tuple(names),
            joint_ids=ids,
            joints=tuple(joint - 2 for joint in ids),
            foot_frame_id=int(model.addFrame(frame)),
            foot_body=str(body.name),
            foot_in_body=tuple((body.placement.inverse() * placement).translation.tolist()),
            foot_radius=radius,
            foot_half_width=shape.half_width if shape else 0.0,
        )
    length = float(np.mean([leg_length(model, leg) for leg in legs.values()]))
    if description.foot_radius is not None and description.foot_radius > length / 2:
        raise SettingsError(
            f"foot_radius is {description.foot_radius:g} m, and the legs of {robot!r} are {length:.2f} m long; metres, not "
            "millimetres?"
        )
    if not guessing:
        return legs
    guess = _DEFAULT_FOOT_RADIUS_RATIO * length
    warnings.warn(
        f"{robot}: no sphere or cylinder at the feet; a radius of {guess * 1000:.0f} mm is assumed "
        "(set foot_radius in the robot configuration)",
        ModelWarning,
        stacklevel=4,
    )
    return {name: replace(leg, foot_radius=leg.foot_radius or guess) for name, leg in legs.items()}


def leg_length(model: pin.Model, leg: Leg) -> float:
    """Return the length of thigh plus shank [m], across the knee's axis: an offset along the axis does not count."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    hip, knee = (data.oMi[joint] for joint in leg.joint_ids[-2:])
    foot = data.oMf[leg.foot_frame_id]
    axis = np.array(knee.rotation) @ joint_axis(model, leg.joint_ids[-1])
    across = np.eye(3) - np.outer(axis, axis)
    thigh = across @ (knee.translation - hip.translation)
    shank = across @ (foot.translation - knee.translation)
    return float(np.linalg.norm(thigh) + np.linalg.norm(shank))


def _described_foot(
    model: pin.Model, knee: int, leg: str, wanted: str, rounds: list[Round], robot: str
) -> tuple[FloatArray, Round | None]:
    """Return the (3,) place of the frame of that name in the knee joint's frame [m], and the round shape there, if any."""
    named = [frame for frame in model.frames if frame.name == wanted]  # a joint and a link may share a name
    if not named:
        raise SettingsError(f"foot frame {wanted!r} of leg {leg} is not in robot model {robot!r}")
    below_knee = [frame for frame in named if frame.parentJoint == knee]
    if not below_knee:
        raise SettingsError(f"foot frame {wanted!r} is not below the knee of leg {leg}")
    centre = np.array(below_knee[0].placement.translation)
    if _on_knee(model, knee, centre):
        raise SettingsError(
            f"foot frame {wanted!r} of leg {leg} sits on the knee's axis (joint {str(model.names[knee])!r}), as the frame of "
            f"the link itself does; {_ADD_FOOT}"
        )
    near = (shape for shape in rounds if np.linalg.norm(shape.centre - centre) < 0.5 * shape.radius)
    return centre, next(near, None)


def _found_foot(
    model: pin.Model, knee: int, leg: str, rounds: list[Round], path: Path
) -> tuple[FloatArray, Round | None]:
    """Return the (3,) place of the foot's centre in the knee joint's frame [m], and the round shape there, if any.

    The foot is the round collision shape farthest from the knee, or else the farthest frame.
    """
    frames = [np.array(frame.placement.translation) for frame in model.frames if frame.parentJoint == knee]
    farthest = max(frames, key=lambda position: float(np.linalg.norm(position)))
    if rounds:
        shape = max(rounds, key=lambda shape: float(np.linalg.norm(shape.centre)))
        part_of_knee = np.linalg.norm(shape.centre) <= 0.5 * np.linalg.norm(farthest)
        if not part_of_knee and not _on_knee(model, knee, shape.centre):
            return shape.centre, shape
    if _on_knee(model, knee, farthest):
        raise ModelError(
            f"robot model {str(path)!r}: nothing marks the foot of leg {leg}: below joint {str(model.names[knee])!r} there is "
            f"neither a frame nor a sphere away from its axis; {_ADD_FOOT}"
        )
    return farthest, None


def _on_knee(model: pin.Model, knee: int, foot: FloatArray) -> bool:
    """Return whether a (3,) point in the knee joint's frame [m] is so near to its axis that there is no shank."""
    thigh = float(np.linalg.norm(model.jointPlacements[knee].translation))
    return float(np.linalg.norm(np.cross(joint_axis(model, knee), foot))) < max(_SHORTEST_SHANK, _SHANK_RATIO * thigh)
