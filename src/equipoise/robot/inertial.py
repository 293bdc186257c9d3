"""Mass, centre of mass and inertia of the base, of the whole robot at a stance, and of the paper's centroidal body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

COMPONENTS = ("mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Order in which the ten inertial parameters of a body are reported; inertia about the CoM, in base axes."""
_ROWS, _COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]


@dataclass(frozen=True, eq=False)
class InertialParameters:
    """Inertial parameters of a rigid body.

    Attributes:
        mass: mass [kg].
        com: (3,) centre of mass in the base frame [m].
        inertia: (3, 3) about the centre of mass, in base axes [kg m2].
    """

    mass: float
    com: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        for name, shape in (("com", (3,)), ("inertia", (3, 3))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise SettingsError(f"{name} must be {shape} finite numbers, got {array.tolist()}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not np.isfinite(self.mass):
            raise SettingsError(f"mass must be finite, got {self.mass}")

    @classmethod
    def from_pinocchio(cls, inertia: pin.Inertia) -> InertialParameters:
        """Return the parameters of a pinocchio.Inertia expressed in the base frame."""
        return cls(float(inertia.mass), np.array(inertia.lever), np.array(inertia.inertia))

    def to_pinocchio(self) -> pin.Inertia:
        """Return a pinocchio.Inertia, which also keeps the inertia about the centre of mass."""
        return pin.Inertia(self.mass, self.com, self.inertia)

    @classmethod
    def from_components(cls, values: FloatArray) -> InertialParameters:
        """Return the parameters from (10,) mass [kg], CoM [m] and inertia about it [kg m2], in the order of COMPONENTS."""
        xx, yy, zz, xy, xz, yz = values[4:]
        return cls(float(values[0]), values[1:4], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    @classmethod
    def from_vector(cls, vector: FloatArray) -> InertialParameters:
        """Return the parameters from a vector that is additive over bodies; need not be physical, but its mass is not zero.

        Args:
            vector: (10,) parameters m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin, in Pinocchio's order.
        """
        return cls.from_pinocchio(pin.Inertia.FromDynamicParameters(vector))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {"mass": self.mass, "com_in_base": self.com.tolist(), "inertia": self.inertia.tolist()}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> InertialParameters:
        """Return the body of a JSON form."""
        return cls(table["mass"], table["com_in_base"], table["inertia"])

    @property
    def vector(self) -> FloatArray:
        """(10,) parameters about the origin, in Pinocchio's order, as `from_vector` takes them."""
        mass, com = self.mass, self.com
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
        return np.array([mass, *(mass * com), xx, xy, yy, xz, yz, zz])

    def __add__(self, other: InertialParameters) -> InertialParameters:
        """Return both bodies rigidly joined (parallel axis theorem)."""
        return InertialParameters.from_pinocchio(self.to_pinocchio() + other.to_pinocchio())

    @property
    def principal_moments(self) -> FloatArray:
        """(3,) principal moments, ascending [kg m2]."""
        return np.asarray(np.linalg.eigvalsh(self.inertia), dtype=float)

    def physical_defect(self) -> str | None:
        """Return the reason why no rigid body can have these parameters, or None if one can.

        A body has a positive mass, positive principal moments, and none of them exceeds the sum of the others.
        """
        if self.mass <= 0:
            return f"its mass is {self.mass:g} kg"
        smallest, middle, largest = self.principal_moments
        if smallest <= 0:
            return f"a principal moment of inertia is {smallest:.3g} kg m2"
        if largest > (smallest + middle) * (1 + 1e-3):
            return f"a principal moment, {largest:.3g} kg m2, exceeds the sum of the others, {smallest + middle:.3g}"
        return None


def moment_parameters(point: FloatArray) -> FloatArray:
    """Return the (10, 3) derivative of `InertialParameters.vector` by a first moment along each axis at a point."""
    added = np.zeros((10, 3))
    added[1:4] = np.eye(3)
    for axis, unit in enumerate(np.eye(3)):
        across = np.outer(point, unit)
        tensor = 2 * point[axis] * np.eye(3) - across - across.T
        added[4:, axis] = tensor[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return added


def components(body: InertialParameters) -> FloatArray:
    """Return (10,) parameters in the order of COMPONENTS."""
    return np.concatenate([[body.mass], body.com, body.inertia[_ROWS, _COLUMNS]])


@dataclass(frozen=True, eq=False)
class RobotInertia:
    """Three bodies of a result, at one stance, in the base frame.

    Attributes:
        composite: the whole robot frozen at the stance, for single-rigid-body controllers.
        base: the base link with everything rigidly fixed to it.
        stance_effective: the paper's body, base, hips and thighs, about its own CoM.
    """

    composite: InertialParameters
    base: InertialParameters
    stance_effective: InertialParameters


def nominal_inertia(robot: RobotModel, joint_position: FloatArray) -> RobotInertia:
    """Return the three bodies of the model file at a posture.

    Args:
        joint_position: (nj,) joint positions in the model's joint order [rad].
    """
    return RobotInertia(
        composite_parameters(robot, joint_position),
        base_parameters(robot),
        stance_effective_parameters(robot, joint_position),
    )


def composite_parameters(robot: RobotModel, joint_position: FloatArray) -> InertialParameters:
    """Return the whole robot frozen at a posture, in the base frame.

    Args:
        joint_position: (nj,) joint positions in the model's joint order [rad].
    """
    data, configuration = robot.create_data(), robot.configuration(joint_position)
    pin.ccrba(robot.pinocchio, data, configuration, np.zeros(robot.pinocchio.nv))
    com = np.array(pin.centerOfMass(robot.pinocchio, data, configuration))
    return InertialParameters(float(robot.mass), com, np.array(data.Ig.inertia))


def stance_effective_parameters(robot: RobotModel, joint_position: FloatArray) -> InertialParameters:
    """Return the paper's centroidal body: base, hips and thighs, without links below the knees, about its own CoM."""
    below_knees = {leg.joint_ids[-1] for leg in robot.legs.values()}
    poses = Kinematics(robot).joint_poses(joint_position)
    total = pin.Inertia.Zero()
    for joint in range(1, robot.pinocchio.njoints):
        if joint not in below_knees:
            total = total + poses[joint].act(robot.pinocchio.inertias[joint])
    return InertialParameters.from_pinocchio(total)


def base_parameters(robot: RobotModel) -> InertialParameters:
    """Return the base link with everything rigidly fixed to it."""
    return InertialParameters.from_pinocchio(robot.pinocchio.inertias[1])
