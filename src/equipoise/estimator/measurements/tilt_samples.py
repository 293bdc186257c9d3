"""The terms of the tilt equation at each sample: the support line, the momenta about it, and what has a moment about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.measurements.drive_train import JointReadings
from equipoise.estimator.measurements.foot_contact import FootContact, foot_directions
from equipoise.estimator.measurements.heading import facing
from equipoise.estimator.measurements.imu_frame import angular_velocity, specific_force, traced_mounting
from equipoise.estimator.measurements.leg_motion import LegChains, LegShape, TracedPosture
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.momenta import Momenta
from equipoise.estimator.measurements.support_line import ContactLine, Feet, RollingLine
from equipoise.estimator.measurements.traced import Traced, contract, cross, dot, length, tanh, turned
from equipoise.estimator.unknowns import TracedValues
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

_UP = np.array([[0.0], [0.0], [1.0]])
_ROLLING = 0.03  # [rad/s] at which feet roll, and do not creep
# Of the sag: a soft foot comes nearer to what it stands on, a soft floor goes down with it, and nobody knows which gives.
_GIVEN_BY_FEET = 0.5


@dataclass(frozen=True, eq=False)
class _Sensed:
    """What an IMU says of n samples.

    Attributes:
        rotation: (3, 3, n) rotation of the IMU to the base.
        up: (3, n) direction against gravity, in base axes: good enough for where feet touch the floor.
        turning: (3, n) angular velocity, in base axes [rad/s].
    """

    rotation: Traced
    up: Traced
    turning: Traced


@dataclass(frozen=True, eq=False)
class TiltSamples:
    """n samples of some lifts, components first, and the terms of the equation at each; readings are as in `LiftSamples`.

    Attributes:
        imu_in_base: (3,) place of the IMU, by the model [m].
        feet: (n,) indices of the left stance foot, and of the right one.
        when: (n,) time since the middle of the run over the run's duration.
        heading: (n,) angle by which the robot was turned since the run began [rad].
    """

    legs: LegChains
    rotation_imu_to_base: FloatArray
    imu_in_base: FloatArray
    joints: JointReadings
    angular_velocity_in_imu: FloatArray
    angular_acceleration_in_imu: FloatArray
    angular_jerk_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    up_in_imu: FloatArray
    feet: Feet
    when: FloatArray
    heading: FloatArray

    @classmethod
    def of(cls, robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> TiltSamples:
        counts = [len(lift.joint_position) for lift in lifts]

        def joined(name: str) -> FloatArray:
            return np.ascontiguousarray(np.concatenate([getattr(lift, name) for lift in lifts]).T)

        return cls(
            legs,
            np.array(robot.imu_in_base.rotation),
            np.array(robot.imu_in_base.translation),
            _joint_readings(robot, legs, lifts),
            joined("angular_velocity_in_imu"),
            joined("angular_acceleration_in_imu"),
            np.ascontiguousarray(_rates([lift.angular_acceleration_in_imu for lift in lifts], lifts).T),
            joined("acceleration_in_imu"),
            joined("up_in_imu"),
            _stance_feet(lifts),
            np.repeat([lift.when for lift in lifts], counts),
            np.repeat([lift.heading for lift in lifts], counts),
        )

    @property
    def count(self) -> int:
        return len(self.feet[0])

    def at(self, places: NDArray[np.intp]) -> TiltSamples:
        """Some of the samples."""
        return replace(
            self,
            joints=self.joints.at(places),
            angular_velocity_in_imu=self.angular_velocity_in_imu[:, places],
            angular_acceleration_in_imu=self.angular_acceleration_in_imu[:, places],
            angular_jerk_in_imu=self.angular_jerk_in_imu[:, places],
            acceleration_in_imu=self.acceleration_in_imu[:, places],
            up_in_imu=self.up_in_imu[:, places],
            feet=[foot[places] for foot in self.feet],
            when=self.when[places],
            heading=self.heading[places],
        )

    def one_by_one(self, places: Sequence[int]) -> TiltSamples:
        """Some of the samples at rest, but for one reading that is 1 rad/s.

        All of them with that of the gyroscope's first axis, then the others, then those with each joint's velocity in turn.
        """
        joints = len(self.joints.position)
        again = self.at(np.tile(np.array(places, dtype=np.intp), 3 + joints))
        readings = np.repeat(np.eye(3 + joints), len(places), axis=1)
        still = np.zeros((joints, again.count))
        return replace(
            again,
            joints=replace(again.joints, velocity=readings[3:], torque_rate=still, acceleration=still),
            angular_velocity_in_imu=readings[:3],
            angular_acceleration_in_imu=np.zeros((3, again.count)),
        )

    def less_errors(self, values: TracedValues) -> tuple[Traced, ...]:
        """Components of `SensedLift`, first axes first, in its order."""
        imu, (position, velocity) = self._sensed(values), self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        line = ContactLine.of(posture, self.feet, self._contacts(values, posture, self._floor_normal(values, imu.up)))
        return position, velocity, imu.up, imu.turning, line.left

    def lean(self, values: TracedValues) -> Traced:
        """(n,) sine of the angle at which the line rises to its left foot, over the floor.

        Up is here what the accelerometer feels in the mean, with its errors.
        """
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        felt = turned(rotation, specific_force(values, GRAVITY * self.up_in_imu, self.when))
        normal = self._floor_normal(values, felt / length(felt))
        position, _ = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        return dot(ContactLine.of(posture, self.feet, self._contacts(values, posture, normal)).left, normal)

    def momentum(self, values: TracedValues) -> Traced:
        """(n,) l . L_o [kg m2/s]."""
        line, _, _, angular = self._line_and_momenta(values, self._sensed(values))
        return dot(line.left, angular)

    def momentum_and_rate(self, values: TracedValues) -> tuple[Traced, Traced]:
        """(n,) l . L_o [kg m2/s], and its rate of change: the right side of the tilt equation [Nm]."""
        imu = self._sensed(values)
        line, rolling, robot, angular = self._line_and_momenta(values, imu)
        rate = (
            dot(cross(line.left, self._specific_force(values, imu)), robot.first)
            - dot(line.left, cross(rolling.velocity - rolling.base_velocity, robot.linear))
            + dot(rolling.left_rate, angular)
            - GRAVITY * robot.mass * self._resistance_arm(values, rolling)
            + dot(line.left, self._moment(values, line, imu.up)) * (robot.mass * (1 / self.legs.robot_mass))
        )
        return dot(line.left, angular), rate

    def inertia_and_moment(self, values: TracedValues) -> tuple[Traced, Traced]:
        """(n,) l . I_o l, and M times the height of the CoM above the line.

        The first is the momentum l . L_o of a robot that turns about its line at 1 rad/s with its joints locked.
        """
        position, _ = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        up, still = self._sensed(values).up, Traced(np.zeros(self.joints.position.shape))
        line = ContactLine.of(posture, self.feet, self._contacts(values, posture, self._floor_normal(values, up)))
        turning = self.legs.traced_motion(posture, still, line.left)
        robot = Momenta.about(
            line.point, self.legs, values["inertial"], posture, turning, line.left, cross(line.point, line.left)
        )
        return dot(line.left, robot.angular), dot(up, robot.first)

    def _line_and_momenta(self, values: TracedValues, imu: _Sensed) -> tuple[ContactLine, RollingLine, Momenta, Traced]:
        """The line, how it moves, the bodies' momenta about it as seen from the base's origin, and L_o with the rotors'."""
        position, velocity = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        motion = self.legs.traced_motion(posture, velocity, imu.turning)
        contacts = self._contacts(values, posture, self._floor_normal(values, imu.up))
        line = ContactLine.of(posture, self.feet, contacts)
        origin = Traced(np.zeros((3, self.count)))
        robot = Momenta.about(line.point, self.legs, values["inertial"], posture, motion, imu.turning, origin)
        angular = robot.angular + values["rotor_spin"] * motion.bending
        return line, RollingLine.of(line, motion, self.feet, contacts), robot, angular

    def _resistance_arm(self, values: TracedValues, rolling: RollingLine) -> Traced:
        """(n,) length behind its weight at which the floor carries the robot: half of it on each rolling foot [m]."""
        left, right = (tanh(turning * (1 / _ROLLING)) for turning in (rolling.left_turning, rolling.right_turning))
        return 0.5 * values["rolling_resistance"][0] * (left + right)

    def _sensed(self, values: TracedValues) -> _Sensed:
        """What the IMU says, in base axes."""
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        rate = self._turning(values, self.angular_velocity_in_imu, self.angular_acceleration_in_imu)
        rate = rate - values["gyro_drift"] * self.when
        return _Sensed(rotation, turned(rotation, self.up_in_imu), turned(rotation, rate))

    @staticmethod
    def _turning(values: TracedValues, read: FloatArray, read_rate: FloatArray) -> Traced:
        """(3, n) angular velocity, or its rate of change, when the accelerometer's sample was taken, to first order."""
        return angular_velocity(values, read) + values["gyro_lag"] * angular_velocity(values, read_rate)

    def _specific_force(self, values: TracedValues, imu: _Sensed) -> Traced:
        """(3, n) specific force at the base's origin, in base axes [m/s2]."""
        force = turned(imu.rotation, specific_force(values, self.acceleration_in_imu, self.when))
        rate = self._turning(values, self.angular_acceleration_in_imu, self.angular_jerk_in_imu)
        turning_rate = turned(imu.rotation, rate)
        arm = values["imu_position"] + self.imu_in_base[:, None]
        return force - cross(turning_rate, arm) - cross(imu.turning, cross(imu.turning, arm))

    def _floor_normal(self, values: TracedValues, up: Traced) -> Traced:
        """(3, n) in base axes."""
        normal = up + contract("ij,j...->i...", np.eye(3)[:, :2], facing(values["floor_slope"], self.heading))
        return normal / length(normal)

    def _contacts(self, values: TracedValues, posture: TracedPosture, normal: Traced) -> list[FootContact]:
        """Contacts of the stance feet with a floor of (3, n) normals, in base axes."""
        radius = self.legs.foot_radius[:, None] * (1.0 + values["foot_radius"] + values["foot_radius_each"])
        radius = radius - _GIVEN_BY_FEET * 0.5 * GRAVITY * self.legs.robot_mass * values["foot_compliance"]
        directions, sample = foot_directions(self.legs, posture), np.arange(self.count)
        return [
            FootContact(radius[foot, sample], normal, values["foot_width"], directions[:, :, foot, sample])
            for foot in self.feet
        ]

    def _moment(self, values: TracedValues, line: ContactLine, up: Traced) -> Traced:
        """(3, n) moment about the line's point of what pulls at the base's origin and hangs from the base [Nm]."""
        hanging = contract("ij,j...->i...", np.eye(3)[:, :2], values["hanging_load"])
        end, at_rest = self.legs.end_of_trunk, self.legs.end_of_trunk - self.legs.middle_of_feet
        middle = line.point + 0.5 * line.length * line.left
        at_rest = at_rest + cross(cross(_UP, up), at_rest)
        held = cross(end - line.point, values["tether_stiffness"] * (at_rest + middle - end))
        return hanging + held - cross(line.point, self._pull(values, up))

    def _pull(self, values: TracedValues, up: Traced) -> Traced:
        """(3, n) constant horizontal force on the base's origin, in base axes [N]."""
        forward = cross(np.array([[0.0], [1.0], [0.0]]), up)
        forward = forward / length(forward)
        pull = facing(values["external_force"], self.heading)
        return pull[0] * forward + pull[1] * cross(up, forward)


def _joint_readings(robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> JointReadings:
    """Of all samples of some lifts, with the torques that they carry."""
    torque = carried_torque(robot, legs, lifts)
    position, velocity, acceleration = (
        np.concatenate([getattr(lift, f"joint_{name}") for lift in lifts])
        for name in ("position", "velocity", "acceleration")
    )
    of_lifts = np.split(torque, np.cumsum([len(lift.joint_position) for lift in lifts])[:-1])
    return JointReadings.of(legs, position, velocity, torque, _rates(of_lifts, lifts), acceleration)


def _rates(readings: Sequence[FloatArray], lifts: Sequence[LiftSamples]) -> FloatArray:
    """(n, k) rates of change of the readings of some lifts."""
    return np.concatenate([np.gradient(part, lift.step, axis=0) for part, lift in zip(readings, lifts, strict=True)])


def carried_torque(robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> FloatArray:
    """(n, nj) joint torques by which the standing legs carry the robot's weight [Nm]; zero in the lifted ones.

    The floor pushes with the robot's mass times the specific force, near enough for how far joints give: by the model's mass
    and CoM, and without what the two feet push against each other, which hardly changes in a lift.
    """
    counts, kinematics = [len(lift.joint_position) for lift in lifts], Kinematics(robot)
    position = np.concatenate([lift.joint_position for lift in lifts])
    acceleration = np.concatenate([lift.acceleration_in_imu for lift in lifts])
    com = np.repeat([kinematics.com(lift.joint_position[0]) for lift in lifts], counts, axis=0)
    force = robot.mass * acceleration @ np.array(robot.imu_in_base.rotation).T
    each, (on_left, on_right) = np.arange(len(position)), _stance_feet(lifts)
    feet = legs.feet(position)
    left, right = feet[each, on_left], feet[each, on_right]
    along = left - right
    part = np.einsum("ni,ni->n", com - right, along) / np.einsum("ni,ni->n", along, along)
    pushes = np.zeros((len(position), 4, 3))
    pushes[each, on_left], pushes[each, on_right] = part[:, None] * force, (1 - part)[:, None] * force
    torque = np.zeros(position.shape)
    for moved in legs.joints.T:
        velocity = np.zeros(position.shape)
        velocity[:, moved] = 1.0
        moving = legs.motion(position, velocity, np.zeros((len(position), 3)))
        torque[:, moved] = -np.einsum("nli,nli->nl", pushes, moving.foot_velocity)
    return torque


def _stance_feet(lifts: Sequence[LiftSamples]) -> Feet:
    """(n,) indices of the left stance foot of each sample of some lifts, and of the right one."""
    return tuple(
        np.repeat([lift.stance_feet for lift in lifts], [len(lift.joint_position) for lift in lifts], axis=0).T
    )
