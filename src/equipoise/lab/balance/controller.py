"""Balance controller: a linear quadratic regulator on the state estimated by a Kalman filter.

Its output is an offset of the joint position targets. The controller is designed on a fixed model, without the true CoM.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are

from equipoise.conventions import FloatArray
from equipoise.lab.balance.balance_model import LinearModel

# Costs and noise for a robot with the A1's m g h; torques of other robots scale with theirs.
_JOINT = 30.0  # cost of a joint's distance from the reference [1/rad2]
_TILT = 3000.0  # cost of the base's rotation [1/rad2]; with a larger one the robot leans less and bends its legs more
_SPEED = 0.002  # cost of speeds relative to positions, the base's rotation weighted as a joint [s2]
_EFFORT = 100.0  # cost of an offset of a joint target [1/rad2]
_ENCODER, _LEAN, _GYRO = 0.5e-3, 3e-3, 4e-3  # standard deviation of measurement noise [rad], [rad], [rad/s]
# Standard deviations of disturbances per period, at a joint and about the line [Nm].
_JOINT_TORQUE, _LINE_TORQUE = 0.22, 0.13


class BalanceLaw:
    """Regulator and filter, with one call of `update` per control period.

    Args:
        model: model of the robot to balance.
        period: control period [s].
        delay: number of control periods from a sample to the effect of its command.
        scale: torque scale: the robot's m g h over an A1's.
    """

    def __init__(self, model: LinearModel, period: float, delay: int, scale: float) -> None:
        self._a, self._b, _ = model.discrete(period)
        self._feedback = _regulator(self._a, self._b, *_costs(model), delay)
        self._measurement = _measurements(model)
        self._gain = _filter_gain(model, self._measurement, period, scale)
        inputs = self._b.shape[1]
        self._inputs = [np.zeros(inputs)] * delay
        self._predicted = np.zeros(len(self._a))
        self.state: FloatArray = np.zeros(len(self._a))

    def begin(self, joint_error: FloatArray, lean: FloatArray) -> None:
        """Initialize the state from a robot that is nearly at rest."""
        size = len(self._a) // 2
        measured = np.concatenate([joint_error, lean])
        shape, *_ = np.linalg.lstsq(self._measurement[: len(measured), :size], measured, rcond=None)
        self._predicted = np.concatenate([shape, np.zeros(size)])

    def update(
        self, joint_error: FloatArray, lean: FloatArray, angular_velocity_in_base: FloatArray, active: bool = True
    ) -> FloatArray:
        """Compute the offset of the joint targets for the next period.

        Args:
            joint_error: (nj,) joint positions relative to the reference posture [rad].
            lean: (2,) rotation of the base about x and y [rad].
            angular_velocity_in_base: (3,) angular velocity of the base, in its own axes [rad/s].
            active: false for zero offset of the targets.

        Returns:
            (nj,) offsets of the joint targets [rad].
        """
        innovation = np.concatenate([joint_error, lean, angular_velocity_in_base]) - self._measurement @ self._predicted
        self.state = self._predicted + self._gain @ innovation
        command = np.zeros(self._b.shape[1])
        if active:
            command = -(self._feedback @ np.concatenate([self.state, *reversed(self._inputs)]))
        self._inputs.append(command)
        self._predicted = self._a @ self.state + self._b @ self._inputs.pop(0)
        return command


def _costs(model: LinearModel) -> tuple[FloatArray, FloatArray]:
    """Return the cost matrices of the state (z, zd) and of the input."""
    joints = model.of_joints.T @ model.of_joints
    base = model.of_base.T @ model.of_base
    position = _JOINT * joints + _TILT * base
    speed = _SPEED * _JOINT * (joints + base)
    return block_diag(position, speed), _EFFORT * np.eye(len(model.of_joints))


def _regulator(a: FloatArray, b: FloatArray, state_cost: FloatArray, effort: FloatArray, delay: int) -> FloatArray:
    """Return the (inputs, states + delay inputs) feedback on the state and the delayed inputs, the last one sent first."""
    states, inputs = b.shape
    late = delay * inputs
    whole = np.zeros((states + late, states + late))
    whole[:states, :states] = a
    entry = np.zeros((states + late, inputs))
    if delay == 0:
        entry[:states] = b
    else:
        whole[:states, -inputs:] = b
        whole[states + inputs :, states:-inputs] = np.eye(late - inputs)
        entry[states : states + inputs] = np.eye(inputs)
    cost = block_diag(state_cost, 1e-9 * effort[0, 0] * np.eye(late)) if late else state_cost
    value = solve_discrete_are(whole, entry, cost, effort)
    return np.asarray(np.linalg.solve(effort + entry.T @ value @ entry, entry.T @ value @ whole), dtype=float)


def _measurements(model: LinearModel) -> FloatArray:
    """Return the (nj + 5, states) measurement matrix of joint positions, lean about x and y, and angular velocity."""
    joints, base = model.of_joints, model.of_base
    return np.vstack(
        [
            np.hstack([joints, np.zeros_like(joints)]),
            np.hstack([base[:2], np.zeros_like(base[:2])]),
            np.hstack([np.zeros_like(base), base]),
        ]
    )


def _filter_gain(model: LinearModel, c: FloatArray, period: float, scale: float) -> FloatArray:
    """Compute the steady Kalman gain of the state."""
    a, b, _ = model.discrete(period)
    size = len(model.mass)
    # A joint torque tau acts like a target offset tau / kp; a torque about the line acts on the first motion.
    inverse = np.linalg.inv(model.mass)
    line = np.concatenate([0.5 * period**2 * inverse[:, 0], period * inverse[:, 0]])
    inputs = np.column_stack([b * (_JOINT_TORQUE * scale / model.kp), line * (_LINE_TORQUE * scale)])
    disturbance = inputs @ inputs.T + 1e-14 * np.eye(2 * size)
    joints = len(model.of_joints)
    noise = np.diag(np.repeat([_ENCODER, _LEAN, _GYRO], [joints, 2, 3]) ** 2)
    covariance = solve_discrete_are(a.T, c.T, disturbance, noise)
    return np.asarray(np.linalg.solve(c @ covariance @ c.T + noise, c @ covariance).T, dtype=float)
