"""The tilt equation: angular momentum about the support line of a robot on two feet, free of torques and forces.

In base axes, with l the support line's direction, o a point on it, P and L_o the robot's linear momentum and angular
momentum about o, r a body's CoM, and up against gravity:

    d/dt (l . L_o) = l . sum (r - o) x m g  -  l . (do/dt x P)  +  dl/dt . L_o

Contact forces have no moment about l. Integrated, what is constant over a trial is

    y(t) = l . L_o(t) - integral of the right side,

linear in the base's ten parameters and in a scale of each leg link's. The feet roll on the floor as spheres, which gives
the base's velocity without an accelerometer. All derivatives of o and l are inertial ones written in base axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.precise.measurements.leg_motion import LegChains, LegMotion, cross, cross_matrix
from equipoise.precise.measurements.lift_samples import LiftSamples
from equipoise.precise.unknowns import Values

_BASE = 10


def mounting(rotation_imu_to_base: FloatArray, imu_tilt: FloatArray) -> FloatArray:
    """(3, 3) the IMU's rotation to the base as it is.

    Args:
        rotation_imu_to_base: (3, 3) rotation from the IMU frame to the base frame, as it should be.
        imu_tilt: (3,) rotation vector of the IMU in the frame where it should be [rad].
    """
    return rotation_imu_to_base @ Rotation.from_rotvec(imu_tilt).as_matrix()


class TiltEquation:
    """The rows of y(t) for a set of trials, at any values of the unknowns that it depends on.

    Attributes:
        DEPENDS_ON: names of the unknowns beside the inertial parameters, in which the rows are linear.
        trials: slices of the rows, by trial.
    """

    DEPENDS_ON = ("joint_zero", "imu_tilt", "accelerometer_bias", "clock_offset", "foot_radius", "floor_slope")

    def __init__(self, legs: LegChains, rotation_imu_to_base: FloatArray, lifts: Sequence[LiftSamples]) -> None:
        self.legs = legs
        self._rotation = rotation_imu_to_base
        counts = [len(lift.joint_position) for lift in lifts]
        ends = np.cumsum(counts)
        self.trials = [slice(int(end - count), int(end)) for end, count in zip(ends, counts, strict=True)]
        # Integration is linear: one matrix per trial is faster than a call per trial and evaluation.
        self._integrals = [
            np.asarray(cumulative_simpson(np.eye(count), dx=lift.step, axis=0, initial=0))
            for count, lift in zip(counts, lifts, strict=True)
        ]

        def joined(name: str) -> FloatArray:
            return np.concatenate([getattr(lift, name) for lift in lifts])

        self._joint_position, self._joint_velocity = joined("joint_position"), joined("joint_velocity")
        self._angular_velocity_in_imu = joined("angular_velocity_in_imu")
        self._angular_acceleration_in_imu = joined("angular_acceleration_in_imu")
        self._to_rest = joined("rotation_to_rest")
        self._rest_acceleration_in_imu = np.repeat([lift.rest_acceleration_in_imu for lift in lifts], counts, axis=0)
        self._left, self._right = np.repeat([lift.stance_feet for lift in lifts], counts, axis=0).T
        self._first = np.array([trial.start for trial in self.trials], dtype=np.intp)

    def rows(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """y(t) and the moment of inertia about the line.

        Returns:
            (n, 10 + links) columns of y(t), with an arbitrary constant per trial, for the base's parameters (Pinocchio's
            order, about the base's origin) and a factor on each leg link's;
            (trials, 10 + links) columns of l . I_o l at each trial's first sample.
        """
        rotation = mounting(self._rotation, values["imu_tilt"])
        # The IMU's samples are younger: what it will read that much earlier belongs to the encoders' samples.
        late = values["clock_offset"]
        angular_velocity_in_base = (
            self._angular_velocity_in_imu - late * self._angular_acceleration_in_imu
        ) @ rotation.T
        gravity = self._rest_acceleration_in_imu - values["accelerometer_bias"]
        up_imu = np.einsum("nji,nj->ni", self._to_rest, gravity / np.linalg.norm(gravity, axis=1, keepdims=True))
        up = (up_imu + late * cross(self._angular_velocity_in_imu, up_imu)) @ rotation.T
        normal = up.copy()
        normal[:, :2] += values["floor_slope"]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        motion = self.legs.motion(
            self._joint_position - values["joint_zero"], self._joint_velocity, angular_velocity_in_base
        )
        line = _Line.of_rolling_feet(
            motion, normal, self.legs.foot_radius * (1 + values["foot_radius"]), self._left, self._right
        )
        momentum, rate = self._momentum_and_rate(motion, line, angular_velocity_in_base, up)
        for trial, integral in zip(self.trials, self._integrals, strict=True):
            momentum[trial] -= integral @ rate[trial]
        return momentum, self._inertia_about_line(motion, line, values["joint_zero"])

    def velocity_sensitivity(self, values: Values, parameters: FloatArray) -> FloatArray:
        """(trials,) root sum of squares over joints of how l . L_o changes with a joint's velocity [kg m2].

        At each trial's middle; with it, noise of the joint velocities becomes noise of y.

        Args:
            parameters: (10 + links,) inertial parameters, in the order of the columns of `rows`.
        """
        middle = np.array([(trial.start + trial.stop) // 2 for trial in self.trials])
        position = self._joint_position[middle] - values["joint_zero"]
        up = np.einsum("nji,nj->ni", self._to_rest[middle], self._rest_acceleration_in_imu[middle]) @ self._rotation.T
        normal = up / np.linalg.norm(up, axis=1, keepdims=True)
        total = np.zeros(len(middle))
        still = np.zeros((len(middle), 3))
        for joint in range(position.shape[1]):
            velocity = np.zeros_like(position)
            velocity[:, joint] = 1.0
            motion = self.legs.motion(position, velocity, still)
            line = _Line.of_rolling_feet(motion, normal, self.legs.foot_radius, self._left[middle], self._right[middle])
            momentum, _ = self._momentum_and_rate(motion, line, still, normal)
            total += (momentum @ parameters) ** 2
        return np.sqrt(total)

    def _momentum_and_rate(
        self, motion: LegMotion, line: _Line, angular_velocity_in_base: FloatArray, up: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(n, 10 + links) columns of l . L_o and of its rate of change, the right side of the tilt equation."""
        across_rolling, falling = cross(line.left, line.velocity), GRAVITY * cross(line.left, up)
        base_momentum, base_linear = _base_momentum(angular_velocity_in_base, line.base_velocity, line.point)
        base = np.einsum("ni,nij->nj", line.left, base_momentum)
        base_rate = np.einsum("ni,nij->nj", line.left_rate, base_momentum)
        base_rate -= np.einsum("ni,nij->nj", across_rolling, base_linear)
        base_rate[:, 0] -= np.einsum("ni,ni->n", falling, line.point)
        base_rate[:, 1:4] += falling
        linear = self.legs.mass[..., None] * (motion.com_velocity + line.base_velocity[:, None, None])
        arm = motion.com - line.point[:, None, None]
        angular = motion.spin + cross(arm, linear)
        leg = np.einsum("ni,nlki->nlk", line.left, angular)
        leg_rate = np.einsum("ni,nlki->nlk", line.left_rate, angular)
        leg_rate -= np.einsum("ni,nlki->nlk", across_rolling, linear)
        leg_rate += np.einsum("ni,nlki->nlk", falling, arm) * self.legs.mass
        count = len(angular_velocity_in_base)
        return np.hstack([base, leg.reshape(count, -1)]), np.hstack([base_rate, leg_rate.reshape(count, -1)])

    def _inertia_about_line(self, motion: LegMotion, line: _Line, joint_zero: FloatArray) -> FloatArray:
        """The momentum l . L_o of a robot that turns about its line at 1 rad/s with its joints locked."""
        first = self._first
        left, point = line.left[first], line.point[first]
        still = self.legs.motion(
            (self._joint_position - joint_zero)[first], np.zeros((len(first), self._joint_position.shape[1])), left
        )
        velocity = -cross(left, point)
        momentum, _ = _base_momentum(left, velocity, point)
        base = np.einsum("ni,nij->nj", left, momentum)
        linear = self.legs.mass[..., None] * (still.com_velocity + velocity[:, None, None])
        angular = still.spin + cross(still.com - point[:, None, None], linear)
        return np.hstack([base, np.einsum("ni,nlki->nlk", left, angular).reshape(len(first), -1)])


@dataclass(frozen=True, eq=False)
class _Line:
    """The moving support line of n samples, in base axes.

    Attributes:
        left: (n, 3) direction of the support line, from the right foot to the left, in base axes.
        point: (n, 3) contact point of the right foot, in the base frame [m].
        velocity: (n, 3) velocity of the point, as the contact travels over the floor, in base axes [m/s].
        left_rate: (n, 3) inertial rate of change of the direction, in base axes [1/s].
        base_velocity: (n, 3) velocity of the base's origin, in base axes [m/s].
    """

    left: FloatArray
    point: FloatArray
    velocity: FloatArray
    left_rate: FloatArray
    base_velocity: FloatArray

    @classmethod
    def of_rolling_feet(
        cls, motion: LegMotion, normal: FloatArray, radius: FloatArray, left_foot: NDArray[np.intp],
        right_foot: NDArray[np.intp],
    ) -> _Line:  # fmt: skip
        """A sphere that rolls without slipping: its centre moves with its angular velocity x (radius normal)."""
        sample = np.arange(len(normal))
        contacts: list[FloatArray] = []
        rolling: list[FloatArray] = []
        base: list[FloatArray] = []
        for foot in (left_foot, right_foot):
            r = radius[foot][:, None]
            contacts.append(motion.foot[sample, foot] - r * normal)
            rolling.append(cross(motion.foot_angular_velocity[sample, foot], r * normal))
            base.append(rolling[-1] - motion.foot_velocity[sample, foot])
        between = contacts[0] - contacts[1]
        length = np.linalg.norm(between, axis=1, keepdims=True)
        left = between / length
        left_rate = (rolling[0] - rolling[1]) / length
        left_rate -= left * np.einsum("ni,ni->n", left, left_rate)[:, None]
        return cls(left, contacts[1], rolling[1], left_rate, (base[0] + base[1]) / 2)


def _base_momentum(
    angular_velocity_in_base: FloatArray, velocity: FloatArray, point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 3, 10) columns of the base's angular momentum about a point and of its linear momentum."""
    count = len(angular_velocity_in_base)
    linear = np.zeros((count, 3, _BASE))
    linear[:, :, 0] = velocity
    linear[:, :, 1:4] = cross_matrix(angular_velocity_in_base)
    angular = np.zeros((count, 3, _BASE))
    angular[:, :, 0] = -cross(point, velocity)
    angular[:, :, 1:4] = -cross_matrix(velocity) - cross_matrix(point) @ linear[:, :, 1:4]
    x, y, z = angular_velocity_in_base.T
    angular[:, 0, 4], angular[:, 0, 5], angular[:, 0, 7] = x, y, z
    angular[:, 1, 5], angular[:, 1, 6], angular[:, 1, 8] = x, y, z
    angular[:, 2, 7], angular[:, 2, 8], angular[:, 2, 9] = x, y, z
    return angular, linear
