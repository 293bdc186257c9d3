"""Model of a quadruped from its model file, based on the kinematic tree alone."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.cleaning.urdf import LIGHTEST_BASE, NEGLIGIBLE_MASS_FRACTION
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.forward import forward_axis, turned
from equipoise.robot.imu import ImuPose, find_imu
from equipoise.robot.legs import Leg, add_legs, leg_length
from equipoise.robot.limits import joint_index, limits_not_mirrored, position_limits, refuse_degrees
from equipoise.robot.links import refuse_other_units
from equipoise.robot.scale import Scale
from equipoise.robot.source import ModelSource, read_model_source
from equipoise.robot.tree import hips_of, hold_other_joints, leg_chains, read_pinocchio

DIAGONALS: dict[str, tuple[str, str]] = {"FL_RR": ("FL", "RR"), "FR_RL": ("FR", "RL")}
"""The two diagonals; each support line runs from the right foot to the left one."""

PAIRS = DIAGONALS | {"FL_RL": ("FL", "RL"), "FR_RR": ("FR", "RR"), "FL_FR": ("FL", "FR"), "RL_RR": ("RL", "RR")}
"""Pairs of standing feet during walking; in lift trials they are diagonals."""


_KP, _KD = 100.0, 3.0  # joint gains [Nm/rad], [Nm s/rad] on an A1


@dataclass(frozen=True, eq=False, repr=False)
class RobotModel:
    """Quadruped: a floating base and four legs of two or three joints. Made by `from_file` or `from_source`.

    Joint vectors everywhere have the leg joints in Pinocchio's order, `joint_names`. Other joints are locked and belong to
    the base.

    A model never changes, so threads may share it: arrays are read-only, and computations use their own data, of `Kinematics`
    or `create_data`. Pinocchio cannot protect its models: copy one before you change it.

    Attributes:
        name: name of the robot in reports.
        source: cleaned model file.
        description: user's overrides of the file.
        pinocchio: Pinocchio model, free-flyer first, then the leg joints.
        full_pinocchio: the user's own Pinocchio model, before other joints were locked.
        locked_joints: positions of joints that do not belong to legs, by name [rad].
        legs: legs by name, in the order FL FR RL RR.
        lower_limit, upper_limit: (nj,) position limits [rad].
        velocity_limit: (nj,) velocity limits [rad/s]; infinite if the model gives no plausible one.
        effort_limit: (nj,) torque limits [Nm]; infinite if the model gives no plausible one.
    """

    name: str
    source: ModelSource
    description: RobotDescription
    pinocchio: pin.Model
    full_pinocchio: pin.Model
    locked_joints: Mapping[str, float]
    legs: Mapping[str, Leg]
    lower_limit: FloatArray
    upper_limit: FloatArray
    velocity_limit: FloatArray
    effort_limit: FloatArray

    def __post_init__(self) -> None:
        for name in ("locked_joints", "legs"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        for limit in (self.lower_limit, self.upper_limit, self.velocity_limit, self.effort_limit):
            limit.setflags(write=False)
        if not self.mass > 0:
            raise ModelError(f"robot model {str(self.source.path)!r} has no mass")

    def __reduce__(self) -> tuple[type[RobotModel], tuple[Any, ...]]:
        """Support pickle and copy, which cannot handle read-only mappings."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return type(self), tuple(
            {**values, "locked_joints": dict(self.locked_joints), "legs": dict(self.legs)}.values()
        )

    @classmethod
    def from_file(
        cls, path: str | Path, name: str | None = None, description: RobotDescription | None = None
    ) -> RobotModel:
        """Return the model of a URDF or an MJCF file.

        Raises:
            ModelError: the file is missing, is neither format, or does not describe a quadruped.
        """
        source = read_model_source(path, description.base_link if description else None)
        return cls.from_source(source, name, description)

    @classmethod
    def from_source(
        cls, source: ModelSource, name: str | None = None, description: RobotDescription | None = None
    ) -> RobotModel:
        """Return the model of a cleaned file; its name is the file's unless one is given.

        Raises:
            ModelError: it does not describe a quadruped.
        """
        description = description or RobotDescription()
        # A file's name may not be valid UTF-8, which figures, pages and JSON require.
        name = name or source.path.stem.encode(errors="backslashreplace").decode()
        full, rounds = read_pinocchio(source)
        chains = leg_chains(full, source)
        if source.forward == "+x":
            axis = description.forward or forward_axis(chains, hips_of(full, chains), source.path)
            if axis != "+x":
                source = turned(source, _base_link(full), axis, description.forward is not None)
                full, rounds = read_pinocchio(source)
        for repair in source.repairs:
            warnings.warn(f"{name}: {repair}", ModelWarning, stacklevel=3)
        model, locked = hold_other_joints(full.copy(), chains, description, source.home)
        legs = add_legs(model, chains, rounds, description, name, source.path)
        refuse_degrees(model, source.path)
        lower, upper = position_limits(model, _joint_names(model), description, name)
        velocity, effort = _velocity_and_effort_limits(model, source)
        robot = cls(name, source, description, model, full, locked, legs, lower, upper, velocity, effort)
        hips = hips_of(model, chains)
        refuse_other_units(robot.full_pinocchio, robot.leg_length, hips, source)
        _refuse_far_imu(robot, hips)
        for text in limits_not_mirrored(model, legs, robot.leg_length):
            warnings.warn(f"{name}: {text}", ModelWarning, stacklevel=3)
        if robot.defect_of_base is not None:
            message = f"the base {robot.base_link!r} has {robot.defect_of_base}"
            if model.inertias[1].mass <= NEGLIGIBLE_MASS_FRACTION * robot.mass:
                raise ModelError(f"robot model {str(source.path)!r}: {message}")
            warnings.warn(f"{name}: {message}", ModelWarning, stacklevel=3)
        return robot

    def with_base(self, base: pin.Inertia) -> RobotModel:
        """Return the robot with another base, for a plan or a feed-forward torque.

        Args:
            base: inertial parameters of the base link with everything fixed to it, in the base frame.
        """
        model = self.pinocchio.copy()
        model.inertias[1] = base
        return dataclasses.replace(self, pinocchio=model)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """(nj) names of the leg joints, in joint order."""
        return _joint_names(self.pinocchio)

    @cached_property
    def base_link(self) -> str:
        """Name of the base link."""
        return _base_link(self.pinocchio)

    @cached_property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(pin.computeTotalMass(self.pinocchio))

    @property
    def defect_of_base(self) -> str | None:
        """Defect of the base's mass in the file, as a phrase after "the base has"; None if there is none."""
        mass = float(self.pinocchio.inertias[1].mass)
        if mass >= LIGHTEST_BASE * self.mass:
            return None
        return (
            f"hardly any mass, {mass:.3g} kg of the robot's {self.mass:.4g} kg, although it holds motors and battery: give "
            "its link an <inertial> with mass, centre of mass and inertia"
        )

    @property
    def imu_in_base(self) -> pin.SE3:
        """Pose of the IMU in the base frame, as a copy; `imu` has its source."""
        return pin.SE3(self.imu.placement)

    @cached_property
    def imu(self) -> ImuPose:
        """Pose of the IMU, and its source."""
        return find_imu(self.pinocchio, self.description, self.source.imu_sensors, self.base_link)

    @cached_property
    def leg_length(self) -> float:
        """Length of thigh plus shank across the knee's axis, mean over the legs [m]."""
        return float(np.mean([leg_length(self.pinocchio, leg) for leg in self.legs.values()]))

    @cached_property
    def leg_joints(self) -> NDArray[np.intp]:
        """(4, n) indices of the joints of the legs FL FR RL RR in the joint vectors, from the hip down."""
        joints = np.array([self.legs[name].joints for name in LEG_NAMES])
        joints.setflags(write=False)
        return joints

    @cached_property
    def foot_frames(self) -> tuple[int, ...]:
        """Pinocchio's ids of the frames at the feet FL FR RL RR."""
        return tuple(self.legs[name].foot_frame_id for name in LEG_NAMES)

    def create_data(self) -> pin.Data:
        """Create data for Pinocchio's algorithms on this model.

        It takes half as long as the model's own `createData`, which copies the data once more.
        """
        return cast("Any", pin.Data)(self.pinocchio)

    def configuration(self, joint_position: FloatArray) -> FloatArray:
        """Return the (7 + nj,) Pinocchio configuration with the base frame at the world's origin."""
        return np.concatenate([_BASE_AT_ORIGIN, joint_position])

    def gains(self, hip_height: float) -> tuple[float, float]:
        """Return joint PD gains kp [Nm/rad] and kd [Nm s/rad]: the description's, or an A1's scaled to the robot."""
        scale = Scale.of(self.mass, hip_height)
        kp, kd = self.description.kp, self.description.kd
        return (_KP * scale.torque if kp is None else kp), (_KD * scale.torque if kd is None else kd)

    def joint_vector(self, by_name: dict[str, float], key: str) -> FloatArray:
        """Return a (nj,) vector from values by joint name; every leg joint must be named once."""
        vector = np.full(len(self.joint_names), np.nan)
        for joint, value in by_name.items():
            vector[joint_index(self.joint_names, joint, key, self.name)] = value
        missing = [name for name, value in zip(self.joint_names, vector, strict=True) if np.isnan(value)]
        if missing:
            raise SettingsError(f"{key} lacks {', '.join(missing)}; it needs every leg joint")
        return vector


def _base_link(model: pin.Model) -> str:
    bodies = [f for f in model.frames if f.parentJoint == 1 and f.type == pin.FrameType.BODY]
    return str(bodies[0].name) if bodies else "base"


def _joint_names(model: pin.Model) -> tuple[str, ...]:
    return tuple(str(name) for name in model.names[2:])


def _refuse_far_imu(robot: RobotModel, hips: FloatArray) -> None:
    """Refuse a described IMU that is farther from the robot than the robot is large.

    Args:
        hips: (4, 3) hips in the base frame [m].
    """
    position, middle = robot.imu.placement.translation, hips.mean(axis=0)
    if robot.description.imu_position is None:
        return
    size = 2 * float(np.linalg.norm(hips - middle, axis=1).max()) + robot.leg_length
    away = float(np.linalg.norm(position - middle))
    if away > size:
        raise SettingsError(
            f"imu_position is {', '.join(f'{value:g}' for value in position)} m in the base frame, {away:.3g} m from the "
            f"middle of the hips, and {robot.name!r} is {size:.2g} m large; metres, not millimetres?"
        )


def _velocity_and_effort_limits(model: pin.Model, source: ModelSource) -> tuple[FloatArray, FloatArray]:
    """Return (nj,) limits of the velocities [rad/s] and torques [Nm]; infinite if the model gives no plausible one."""
    velocity = np.array(model.velocityLimit[6:])
    effort = np.array(
        [source.effort_limits.get(name, model.effortLimit[6 + i]) for i, name in enumerate(_joint_names(model))]
    )
    weight = pin.computeTotalMass(model) * np.linalg.norm(model.gravity.linear)
    for limit, most in ((velocity, _FASTEST), (effort, _LONGEST_LEVER * weight)):
        limit[~((limit > 0) & (limit < most))] = np.inf
    return velocity, effort


# Files often have placeholders, as 1000. A limit above these values is not that of a motor.
_FASTEST = 200.0  # [rad/s]; the fastest of the catalogue's motors has 52
_LONGEST_LEVER = 3.0  # [m], for the weight; the longest of the catalogue's robots is 0.27
_BASE_AT_ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # position, then quaternion xyzw
_BASE_AT_ORIGIN.setflags(write=False)
