"""Linear model of a robot that balances on two rolling feet.

With J the Jacobian of the two contact points, all motions without slip are v = N zd, N a basis of the null space of J:
its first column turns the rigid robot about the support line, the others change its shape. About a posture at rest,

    M zdd + K z = H^T dtau + G d,     dtau = kp (u - H z) - kd H zd,

with H = N's joint rows, u an offset of the joint targets, and d the distance of the true CoM in front of the model's.
The first row of H^T is zero: only gravity and inertia turn the robot about the line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import expm, null_space

from equipoise.conventions import FloatArray
from equipoise.lab.balance.two_foot_posture import Posture, contact_jacobian, generalized_gravity, stance_legs
from equipoise.robot.model import RobotModel

# Four-point differences: with this step their error and that of rounding are both below 1e-9 of the largest term.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Linear dynamics near a posture on two feet. The first of the coordinates z is the rotation about +left [rad].

    Attributes:
        mass: (nz, nz) mass matrix M.
        stiffness: (nz, nz) stiffness matrix K, of gravity alone.
        of_joints: (nj, nz) matrix H from z to joint positions.
        of_base: (3, nz) matrix from z to the rotation of the base, in its own axes.
        of_offset: (nz,) generalised force G per metre of the true CoM in front of the model's [N].
        kp, kd: joint gains [Nm/rad], [Nm s/rad].
    """

    mass: FloatArray
    stiffness: FloatArray
    of_joints: FloatArray
    of_base: FloatArray
    of_offset: FloatArray
    kp: float
    kd: float

    @property
    def unstable_pole(self) -> float:
        """Rate at which the robot with locked joints tips over [1/s]."""
        return float(np.sqrt(-self.stiffness[0, 0] / self.mass[0, 0]))

    def continuous(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, B, E of the state x = (z, zd): xd = A x + B u + E d."""
        size = len(self.mass)
        joints = self.of_joints.T @ self.of_joints
        inverse = np.linalg.inv(self.mass)
        a = np.zeros((2 * size, 2 * size))
        a[:size, size:] = np.eye(size)
        a[size:, :size] = -inverse @ (self.stiffness + self.kp * joints)
        a[size:, size:] = -inverse @ (self.kd * joints)
        b = np.vstack([np.zeros_like(self.of_joints.T), self.kp * inverse @ self.of_joints.T])
        e = np.concatenate([np.zeros(size), inverse @ self.of_offset])
        return a, b, e

    def discrete(self, period: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, B, E from one control period to the next, with zero-order hold of the inputs."""
        a, b, e = self.continuous()
        states, inputs = b.shape
        whole = np.zeros((states + inputs + 1, states + inputs + 1))
        whole[:states] = np.hstack([a, b, e[:, None]]) * period
        moved = np.asarray(expm(whole))[:states]
        return moved[:, :states], moved[:, states:-1], moved[:, -1]


def linear_model(
    robot: RobotModel, posture: Posture, diagonal: str, gains: tuple[float, float], armature: float
) -> LinearModel:
    """Linearise about a posture.

    Args:
        robot: design model of the robot.
        gains: stiffness kp [Nm/rad] and damping kd [Nm s/rad] of the joints' position control.
        armature: rotor inertia seen at each joint [kg m2].
    """
    configuration = robot.configuration(posture.joint_position)
    jacobian = contact_jacobian(robot, configuration, stance_legs(diagonal))
    basis = _motions(posture, jacobian)
    inertia = np.array(pin.crba(robot.pinocchio, robot.create_data(), configuration))
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    inertia[range(6, len(inertia)), range(6, len(inertia))] += armature
    stiffness = basis.T @ _gravity_stiffness(robot, posture, diagonal, basis)
    return LinearModel(
        mass=basis.T @ inertia @ basis,
        stiffness=stiffness,
        of_joints=basis[6:],
        of_base=basis[3:6],
        of_offset=-basis.T @ _gravity_of_offset(robot, configuration, posture.forward),
        kp=gains[0],
        kd=gains[1],
    )


def residual(robot: RobotModel, posture: Posture, diagonal: str, configuration: FloatArray) -> FloatArray:
    """Compute the (nv,) generalised force that is missing for rest, with the posture's torques and foot forces."""
    gravity = generalized_gravity(robot, configuration)
    force = contact_jacobian(robot, configuration, stance_legs(diagonal)).T @ posture.foot_force
    return gravity - force - np.concatenate([np.zeros(6), posture.torque])


def _motions(posture: Posture, jacobian: FloatArray) -> FloatArray:
    """Compute the (nv, nz) basis of the motions without slip: rotation about the line, orthonormal changes of shape."""
    rotation = np.zeros(jacobian.shape[1])
    rotation[:3] = np.cross(posture.left, -posture.middle)  # of the base frame, which is at the origin
    rotation[3:6] = posture.left
    shapes = null_space(np.vstack([jacobian, rotation]), rcond=1e-9)
    return np.column_stack([rotation, shapes])


def _gravity_stiffness(robot: RobotModel, posture: Posture, diagonal: str, basis: FloatArray) -> FloatArray:
    """Compute the (nv, nz) derivative of the residual by z."""
    start = robot.configuration(posture.joint_position)

    def at(direction: FloatArray) -> FloatArray:
        moved = np.array(pin.integrate(robot.pinocchio, start, direction))
        return residual(robot, posture, diagonal, moved)

    columns = [
        (8 * (at(_STEP * column) - at(-_STEP * column)) - (at(2 * _STEP * column) - at(-2 * _STEP * column)))
        / (12 * _STEP)
        for column in basis.T
    ]
    return np.column_stack(columns)


def _gravity_of_offset(robot: RobotModel, configuration: FloatArray, forward: FloatArray) -> FloatArray:
    """Compute the (nv,) change of the generalised gravity per metre that the robot's CoM moves forward."""
    base = robot.pinocchio.inertias[1]
    moved = robot.with_base(
        pin.Inertia(base.mass, base.lever + robot.mass / base.mass * forward, np.array(base.inertia))
    )
    return generalized_gravity(moved, configuration) - generalized_gravity(robot, configuration)
