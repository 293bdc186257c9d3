"""Where the base is, sample by sample, from the encoders and the IMU alone: good for pictures.

Attitude: the gyroscope, held to gravity by the accelerometer, its bias learnt whenever nothing moves. Heading: over four
planted feet the legs say how the base turns, without drift. Place: feet that are lowest along gravity stand and roll on a
level floor; those that carry most count most, by the joint torques, for feet that carry little slip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains, cross
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.view.even_steps import SensedSteps

# On an A1; lengths and times are multiplied by those of the stance's scale.
_STANDING = 4e-3  # [m] above the lowest foot at which a foot hardly stands any more
_WINDOW = 0.1  # [s] over which nothing may move for the robot to be at rest
_STILL_JOINTS, _STILL_BASE = 2e-3, 0.03  # [rad], [rad/s]
_BIAS_TIME = 1.0  # [s] of rest after which the gyroscope's bias is known
_TO_GRAVITY_AT_REST, _TO_GRAVITY = 0.3, 10.0  # [s]
_PLANTED = 0.2  # least weight of a foot for all four to say how the base turns
_LEAST_LOAD = 0.05  # of a quarter of the robot
_SHAKEN = 1.0  # [m/s2]: an accelerometer farther off says nothing of gravity


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """The base of n samples. The world's z is up, the floor at zero; x is where the base first looked.

    Attributes:
        rotation_base_to_world: (n, 3, 3) of the base.
        position_in_world: (n, 3) the base's origin [m].
        feet_in_world: (n, 4, 3) centres of the feet [m].
        standing: (n, 4) from 0 to 1: whether each foot stands.
    """

    rotation_base_to_world: FloatArray
    position_in_world: FloatArray
    feet_in_world: FloatArray
    standing: FloatArray


class BaseTracker:
    """Follows the base through pieces of one recording, in order."""

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._robot, self._legs = robot, LegChains(robot)
        self._scale = stance.scale
        self._last: tuple[float, FloatArray, FloatArray, FloatArray] | None = (
            None  # time, joints, turning, feet in base
        )
        self._rotation, self._position = np.eye(3), np.zeros(3)
        self._bias, self._rested = np.zeros(3), 0.0
        self._memory: list[tuple[float, FloatArray]] = []  # times and joints of the last window

    def follow(self, steps: SensedSteps) -> BaseMotion:
        """The next n steps."""
        time, joint_position, turning, acceleration = (
            steps.time, steps.joint_position, steps.angular_velocity_in_base, steps.specific_force_in_base,
        )  # fmt: skip
        feet, spin = self._feet(time, joint_position, turning)
        load = self._loads(steps)
        rotation, position = np.empty((len(time), 3, 3)), np.empty((len(time), 3))
        standing = np.empty((len(time), 4))
        for index in range(len(time)):
            sample = (float(time[index]), joint_position[index], turning[index], feet[index])
            standing[index] = self._step(sample, acceleration[index], spin[index], load[index])
            rotation[index], position[index] = self._rotation, self._position
        world = position[:, None] + np.einsum("nij,nlj->nli", rotation, feet)
        return BaseMotion(rotation, position, world, standing)

    def _feet(self, time: FloatArray, position: FloatArray, turning: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 4, 3) centres of the feet in the base frame, and how their links turn against the base [rad/s]."""
        times, positions = time, position
        if self._last is not None:
            times, positions = np.append(self._last[0], time), np.vstack([self._last[1], position])
        velocity = np.diff(positions, axis=0, prepend=positions[:1]) / np.diff(times, prepend=times[0] - 1.0)[:, None]
        motion = self._legs.motion(position, velocity[-len(time) :], np.zeros_like(turning))
        return motion.foot, motion.foot_angular_velocity

    def _loads(self, steps: SensedSteps) -> FloatArray:
        """(n, 4) from a little to one: how much each foot carries, where torques tell."""
        force = feet_and_forces(self._robot, steps.joint_position, steps.joint_torque)[1]
        up = steps.specific_force_in_base / np.maximum(
            np.linalg.norm(steps.specific_force_in_base, axis=1, keepdims=True), 1e-9
        )
        carried = np.einsum("nli,ni->nl", force, up)
        total = np.maximum(carried.sum(axis=1, keepdims=True), 1e-9)
        known = np.abs(steps.joint_torque).max(axis=1, keepdims=True) > 0
        return np.where(known, np.clip(4 * carried / total, _LEAST_LOAD, 1.0) ** 2, 1.0)

    def _step(
        self,
        sample: tuple[float, FloatArray, FloatArray, FloatArray],
        acceleration: FloatArray,
        spin: FloatArray,
        load: FloatArray,
    ) -> FloatArray:
        """One sample; returns (4,) whether feet stand."""
        time, _, turning, feet = sample
        if self._last is None:
            self._rotation = _upright(acceleration)
            standing = self._standing(feet)
            self._position[:2] = -(standing @ (feet @ self._rotation.T))[:2] / standing.sum()
            self._last = sample
        else:
            step = time - self._last[0]
            still = self._still(sample)
            if still:
                self._learn_bias(turning, step)
            turned = (turning - self._bias) * step
            before, self._rotation = self._rotation, self._rotation @ Rotation.from_rotvec(turned).as_matrix()
            self._hold_to_gravity(acceleration, step, still)
            standing = self._standing(feet)
            self._move(before, sample, standing * load, spin + turned / step, step)
            self._last = sample
        height = feet @ self._rotation[2] - self._legs.foot_radius
        self._position[2] = -float(standing @ height / standing.sum())
        return standing

    def _move(
        self,
        before: FloatArray,
        sample: tuple[float, FloatArray, FloatArray, FloatArray],
        weight: FloatArray,
        spin: FloatArray,
        step: float,
    ) -> None:
        """Feet that stand stay, but for their rolling: what they do against the base, the base does against them."""
        if self._last is None:
            return
        old = self._last[3] @ before.T
        up = self._rotation[2]
        radius = self._legs.foot_radius[:, None] * up
        rolled = cross(spin, radius) @ self._rotation.T * step
        if weight.min() > _PLANTED:
            self._turn(_heading(old - old.mean(axis=0), (sample[3] @ self._rotation.T - rolled)))
        moved = sample[3] @ self._rotation.T - old - rolled
        self._position -= weight @ moved / weight.sum()

    def _turn(self, angle: float) -> None:
        cosine, sine = np.cos(angle), np.sin(angle)
        self._rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ self._rotation

    def _standing(self, feet: FloatArray) -> FloatArray:
        """(4,) from one, on the floor, to nearly zero, in the air: soft, so that nothing jumps."""
        height = feet @ self._rotation[2] - self._legs.foot_radius
        rise: FloatArray = np.asarray(height - height.min(), dtype=float) / (_STANDING * self._scale.length)
        return np.asarray(np.exp(-np.square(rise)), dtype=float) + 1e-9

    def _still(self, sample: tuple[float, FloatArray, FloatArray, FloatArray]) -> bool:
        time, position, turning, _ = sample
        self._memory.append((time, position))
        while self._memory[1:] and self._memory[1][0] <= time - _WINDOW * self._scale.time:
            self._memory.pop(0)
        quiet = float(np.abs(turning - self._bias).max()) < _STILL_BASE
        return quiet and float(np.abs(position - self._memory[0][1]).max()) < _STILL_JOINTS

    def _learn_bias(self, turning: FloatArray, step: float) -> None:
        self._rested += step
        self._bias = self._bias + (turning - self._bias) * step / max(step, min(self._rested, _BIAS_TIME))

    def _hold_to_gravity(self, acceleration: FloatArray, step: float, still: bool) -> None:
        size = float(np.linalg.norm(acceleration))
        if abs(size - GRAVITY) > _SHAKEN:
            return
        error = np.cross(self._rotation @ acceleration / size, [0, 0, 1])
        share = min(1.0, step / ((_TO_GRAVITY_AT_REST if still else _TO_GRAVITY) * self._scale.time))
        self._rotation = Rotation.from_rotvec(share * error).as_matrix() @ self._rotation


def _upright(acceleration: FloatArray) -> FloatArray:
    """(3, 3) the attitude without heading that an accelerometer at rest has."""
    up = acceleration / max(float(np.linalg.norm(acceleration)), 1e-9)
    forward = np.array([1.0, 0, 0]) - up[0] * up
    forward /= np.linalg.norm(forward)
    return np.asarray(np.stack([forward, np.cross(up, forward), up]), dtype=float)


def _heading(old: FloatArray, new: FloatArray) -> float:
    """By which angle about the vertical (4, 3) points must be turned to lie best over where they were [rad]."""
    new = new - new.mean(axis=0)
    across = new[:, 0] * old[:, 1] - new[:, 1] * old[:, 0]
    along = new[:, 0] * old[:, 0] + new[:, 1] * old[:, 1]
    return float(np.arctan2(across.sum(), along.sum()))
