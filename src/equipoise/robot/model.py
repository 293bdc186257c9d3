"""RobotModel: what is known about a quadruped from its model file, found from the kinematic tree alone."""

from __future__ import annotations

import copy
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.source import ModelSource, read_model_source
from equipoise.robot.tree import (
    Spheres,
    body_frame_of,
    hold_other_joints,
    joint_axis,
    leg_chains,
    name_legs,
    read_pinocchio,
)
from equipoise.robot.urdf import UNLIMITED_JOINT_RANGE

DIAGONALS: dict[str, tuple[str, str]] = {"FL_RR": ("FL", "RR"), "FR_RL": ("FR", "RL")}
"""The two diagonals; each support line runs from the right foot to the left one."""

A1_TORQUE_SCALE = 38.0  # m g h of an A1 [Nm]; gains, friction and armature scale from there

# A model without foot spheres gets feet of this fraction of the leg length: Solo's 16 mm feet on 0.32 m legs.
_DEFAULT_FOOT_RADIUS_RATIO = 0.05


@dataclass(frozen=True)
class Leg:
    """One leg, from the hip down.

    Attributes:
        name: FL, FR, RL or RR.
        joint_names: from the hip down; the last is the knee, the one before it the hip pitch.
        joint_ids: of the same joints in the Pinocchio model.
        joints: indices of the same joints in the robot's joint vectors.
        foot_frame_id: Pinocchio's id of the frame at the foot's centre.
        foot_radius: [m].
    """

    name: str
    joint_names: tuple[str, ...]
    joint_ids: tuple[int, ...]
    joints: tuple[int, ...]
    foot_frame_id: int
    foot_radius: float


@dataclass(frozen=True)
class Foot:
    """Where a foot's sphere sits: on which link (body), where on it [m], and its radius [m]."""

    body: str
    position_in_body: tuple[float, float, float]
    radius: float


class RobotModel:
    """A quadruped: a floating base and four legs of two or three joints.

    Joint vectors everywhere have the leg joints in Pinocchio's order, `joint_names`. Joints that are no leg's are held
    still and belong to the base.

    Attributes:
        name: how the robot is called in reports.
        source: the cleaned model file.
        description: what the user overrode.
        pinocchio: Pinocchio model, free-flyer first, then the leg joints.
        full_pinocchio: the same before other joints were locked; the user's own model.
        held: where joints that are no leg's are held, by name [rad].
        legs: by name, in the order FL FR RL RR.
        joint_names: (nj) names in joint order.
        lower_limit, upper_limit: (nj,) position limits [rad].
        velocity_limit: (nj,) [rad/s]; infinite where the model gives none.
        effort_limit: (nj,) [Nm]; infinite where the model gives none.
        base_link: name of the base link.
        imu_in_base: pose of the IMU in the base frame.
    """

    def __init__(
        self, source: ModelSource, name: str | None = None, description: RobotDescription | None = None
    ) -> None:
        self.source = source
        self.description = description or RobotDescription()
        self.name = name or source.path.stem
        for repair in source.repairs:
            warnings.warn(f"{self.name}: {repair}", ModelWarning, stacklevel=3)
        self.full_pinocchio, spheres = read_pinocchio(source)
        chains = leg_chains(self.full_pinocchio, source.path)
        self.pinocchio, self.held = hold_other_joints(self.full_pinocchio.copy(), chains, self.description)
        self.joint_names = tuple(str(name) for name in self.pinocchio.names[2:])
        if any(joint.nq != 1 or joint.nv != 1 for joint in self.pinocchio.joints[2:]):
            raise ModelError(f"robot model {str(source.path)!r} has a leg joint with more than one axis")
        self.legs = self._find_legs(spheres, chains)
        self.base_link = self._base_link()
        self.imu_in_base = self._find_imu()
        self._set_limits()
        self.mass = float(pin.computeTotalMass(self.pinocchio))
        if not self.mass > 0:
            raise ModelError(f"robot model {str(source.path)!r} has no mass")
        self.pinocchio_data: pin.Data = self.pinocchio.createData()
        """Scratch memory of the algorithms that run on this model; every call overwrites it."""

    @classmethod
    def from_file(
        cls, path: str | Path, name: str | None = None, description: RobotDescription | None = None
    ) -> RobotModel:
        """From a URDF or an MJCF file.

        Raises:
            ModelError: the file is missing, is neither format, or does not describe a quadruped.
        """
        source = read_model_source(path, description.base_link if description else None)
        return cls(source, name, description)

    def with_base(self, base: pin.Inertia) -> RobotModel:
        """The same robot with another base, as a plan or a feed-forward torque takes it to be.

        Args:
            base: of the base link with everything fixed to it, in its own frame.
        """
        other = copy.copy(self)
        other.pinocchio = self.pinocchio.copy()
        other.pinocchio.inertias[1] = base
        other.pinocchio_data = other.pinocchio.createData()
        other.mass = float(pin.computeTotalMass(other.pinocchio))
        return other

    @cached_property
    def leg_length(self) -> float:
        """Thigh plus shank of the mean leg, measured across the hip pitch axis [m]."""
        return float(np.mean([self._leg_length(leg) for leg in self.legs.values()]))

    @cached_property
    def leg_joints(self) -> NDArray[np.intp]:
        """(4, n) indices of the joints of the legs FL FR RL RR in the joint vectors, from the hip down."""
        return np.array([leg.joints for leg in self.legs.values()])

    @cached_property
    def foot_frames(self) -> tuple[int, ...]:
        """Pinocchio's ids of the frames at the feet FL FR RL RR."""
        return tuple(leg.foot_frame_id for leg in self.legs.values())

    def configuration(self, joint_position: FloatArray) -> FloatArray:
        """(7 + nj,) Pinocchio configuration with the base frame at the world's origin."""
        return np.concatenate([_BASE_AT_ORIGIN, joint_position])

    def torque_scale(self, hip_height: float) -> float:
        """M g h [Nm], which gains, friction and armature scale with."""
        return self.mass * GRAVITY * hip_height

    def gains(self, hip_height: float) -> tuple[float, float]:
        """Joint PD gains kp [Nm/rad] and kd [Nm s/rad]: the description's, or scaled with m g h from an A1's."""
        scale = self.torque_scale(hip_height) / A1_TORQUE_SCALE
        kp, kd = self.description.kp, self.description.kd
        return (100.0 * scale if kp is None else kp), (3.0 * scale if kd is None else kd)

    @cached_property
    def feet(self) -> dict[str, Foot]:
        """Where the foot spheres sit on the links, for an engine that reads the same model."""
        feet: dict[str, Foot] = {}
        for leg in self.legs.values():
            frame = self.pinocchio.frames[leg.foot_frame_id]
            body = self.pinocchio.frames[frame.parentFrame]
            x, y, z = (body.placement.inverse() * frame.placement).translation
            feet[leg.name] = Foot(str(body.name), (float(x), float(y), float(z)), leg.foot_radius)
        return feet

    def _find_legs(self, spheres: Spheres, chains: list[list[str]]) -> dict[str, Leg]:
        names = list(self.pinocchio.names)
        by_leg = name_legs(self.pinocchio, [[names.index(joint) for joint in chain] for chain in chains])
        legs: dict[str, Leg] = {}
        guessed: list[str] = []
        for leg_name in LEG_NAMES:
            ids = by_leg[leg_name]
            placement, radius = self._find_foot(spheres.get(names[ids[-1]], []), leg_name, ids[-1])
            if radius is None:
                guessed.append(leg_name)
            body = body_frame_of(self.pinocchio, ids[-1])
            frame = pin.Frame(f"equipoise_{leg_name}_foot", ids[-1], body, placement, pin.FrameType.OP_FRAME)
            frame_id = int(self.pinocchio.addFrame(frame))
            joint_names = tuple(names[joint] for joint in ids)
            legs[leg_name] = Leg(
                leg_name, joint_names, tuple(ids), tuple(joint - 2 for joint in ids), frame_id, radius or 0.0
            )
        if guessed:
            radius = _DEFAULT_FOOT_RADIUS_RATIO * float(np.mean([self._leg_length(leg) for leg in legs.values()]))
            warnings.warn(
                f"{self.name}: no sphere at the feet; a radius of {radius * 1000:.0f} mm is assumed "
                "(set foot_radius in the robot description)",
                ModelWarning,
                stacklevel=4,
            )
            legs = {
                name: Leg(
                    name, leg.joint_names, leg.joint_ids, leg.joints, leg.foot_frame_id, leg.foot_radius or radius
                )
                for name, leg in legs.items()
            }
        return legs

    def _find_foot(self, spheres: list[tuple[pin.SE3, float]], leg: str, knee: int) -> tuple[pin.SE3, float | None]:
        """Placement of the foot's centre in the knee joint's frame and the radius of the sphere there, if any.

        The foot is the collision sphere farthest from the knee, or else the farthest frame.
        """
        wanted = self.description.foot_frames.get(leg)
        if wanted is not None:
            called_so = [
                frame for frame in self.pinocchio.frames if frame.name == wanted
            ]  # a joint's may be a link's too
            if not called_so:
                raise SettingsError(f"foot frame {wanted!r} of leg {leg} is not in robot model {self.name!r}")
            below_knee = [frame for frame in called_so if frame.parentJoint == knee]
            if not below_knee:
                raise SettingsError(f"foot frame {wanted!r} is not below the knee of leg {leg}")
            placement = pin.SE3(np.eye(3), np.array(below_knee[0].placement.translation))
            near = [
                radius
                for sphere, radius in spheres
                if np.linalg.norm(sphere.translation - placement.translation) < 0.5 * radius
            ]
            return placement, self.description.foot_radius or (near[0] if near else None)
        frames = [np.array(f.placement.translation) for f in self.pinocchio.frames if f.parentJoint == knee]
        farthest = max(frames, key=lambda position: float(np.linalg.norm(position)))
        if spheres:
            placement, radius = max(spheres, key=lambda sphere: float(np.linalg.norm(sphere[0].translation)))
            if np.linalg.norm(placement.translation) > 0.5 * np.linalg.norm(farthest):  # else it is part of the knee
                return placement, self.description.foot_radius or radius
        if np.linalg.norm(farthest) < 1e-3:
            raise ModelError(
                f"robot model {str(self.source.path)!r}: nothing marks the foot of leg {leg} "
                f"(below joint {self.pinocchio.names[knee]!r}); name its frame under [foot_frames] in a description"
            )
        return pin.SE3(np.eye(3), farthest), self.description.foot_radius

    def _leg_length(self, leg: Leg) -> float:
        """Thigh plus shank, across the knee's axis: an offset along the axis makes no leg longer."""
        data = self.pinocchio.createData()
        pin.framesForwardKinematics(self.pinocchio, data, pin.neutral(self.pinocchio))
        hip, knee = (data.oMi[joint] for joint in leg.joint_ids[-2:])
        foot = data.oMf[leg.foot_frame_id]
        axis = np.array(knee.rotation) @ joint_axis(self.pinocchio, leg.joint_ids[-1])
        across = np.eye(3) - np.outer(axis, axis)
        thigh = across @ (knee.translation - hip.translation)
        shank = across @ (foot.translation - knee.translation)
        return float(np.linalg.norm(thigh) + np.linalg.norm(shank))

    def _base_link(self) -> str:
        bodies = [f for f in self.pinocchio.frames if f.parentJoint == 1 and f.type == pin.FrameType.BODY]
        return str(bodies[0].name) if bodies else "base"

    def _find_imu(self) -> pin.SE3:
        """The described pose, or that of a frame on the base with "imu" in its name, or the base frame itself."""
        named = [f for f in self.pinocchio.frames if f.parentJoint == 1 and "imu" in str(f.name).lower()]
        bodies = [f for f in named if f.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)]
        pose = pin.SE3(bodies[0].placement) if bodies else pin.SE3.Identity()
        if self.description.imu_position is not None:
            pose.translation = np.array(self.description.imu_position)
        if self.description.imu_rpy is not None:
            pose.rotation = pin.rpy.rpyToMatrix(np.array(self.description.imu_rpy))
        return pose

    def _set_limits(self) -> None:
        model = self.pinocchio
        self.lower_limit = np.array(model.lowerPositionLimit[7:])
        self.upper_limit = np.array(model.upperPositionLimit[7:])
        unlimited = ~(self.upper_limit > self.lower_limit)
        self.lower_limit[unlimited | (self.lower_limit < -UNLIMITED_JOINT_RANGE)] = -UNLIMITED_JOINT_RANGE
        self.upper_limit[unlimited | (self.upper_limit > UNLIMITED_JOINT_RANGE)] = UNLIMITED_JOINT_RANGE
        for joint, (lower, upper) in self.description.joint_limits.items():
            index = self._joint_index(joint, "joint_limits")
            self.lower_limit[index], self.upper_limit[index] = lower, upper
        self.effort_limit = np.array(
            [self.source.effort_limits.get(name, model.effortLimit[6 + i]) for i, name in enumerate(self.joint_names)]
        )
        self.velocity_limit = np.array(model.velocityLimit[6:])
        for limit in (self.effort_limit, self.velocity_limit):
            limit[~(limit > 0)] = np.inf
        for name in ("lower_limit", "upper_limit", "velocity_limit", "effort_limit"):
            getattr(self, name).setflags(write=False)

    def _joint_index(self, joint: str, key: str) -> int:
        try:
            return self.joint_names.index(joint)
        except ValueError:
            raise SettingsError(
                f"{key} names {joint!r}, which is no leg joint of {self.name!r}; those are {', '.join(self.joint_names)}"
            ) from None

    def joint_vector(self, by_name: dict[str, float], key: str) -> FloatArray:
        """(nj,) from values by joint name; every leg joint must be named once."""
        vector = np.full(len(self.joint_names), np.nan)
        for joint, value in by_name.items():
            vector[self._joint_index(joint, key)] = value
        missing = [name for name, value in zip(self.joint_names, vector, strict=True) if np.isnan(value)]
        if missing:
            raise SettingsError(f"{key} lacks {', '.join(missing)}; it needs every leg joint")
        return vector


_BASE_AT_ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # position, then quaternion xyzw
