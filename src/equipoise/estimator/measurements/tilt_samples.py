"""Terms of the tilt equation at each sample: the support line, and the momenta and moments about it."""

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
_READINGS = ("angular_velocity_in_imu", "angular_acceleration_in_imu", "acceleration_in_imu", "up_in_imu")
_ROLLING = 0.03  # [rad/s] at which feet roll instead of creeping
# Share of the feet in the foot compliance: a soft foot lowers its centre relative to the contact point, a soft floor does not,
# and the measurements do not separate them.
_COMPLIANCE_OF_FEET = 0.5


@dataclass(frozen=True, eq=False)
class TiltSamples:
    """Readings of n samples of several lifts, components first, as in `LiftSamples`, and the terms of the equation.

    Attributes:
        imu_in_base: (3,) position of the IMU, according to the model [m].
        feet: (n,) indices of the left stance foot, and of the right one.
        when: (n,) time since the middle of the run, divided by the run's duration.
        heading: (n,) rotation of the robot to its left since the start of the run [rad].
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
            angular_jerk_in_imu=np.ascontiguousarray(
                _rates([lift.angular_acceleration_in_imu for lift in lifts], lifts).T
            ),
            feet=_stance_feet(lifts),
            when=np.repeat([lift.when for lift in lifts], counts),
            heading=np.repeat([lift.heading for lift in lifts], counts),
            **{name: joined(name) for name in _READINGS},
        )

    @property
    def count(self) -> int:
        return len(self.feet[0])

    def at(self, places: NDArray[np.intp]) -> TiltSamples:
        """Select samples by index."""
        of_samples = (*_READINGS, "angular_jerk_in_imu", "when", "heading")
        selected = {name: getattr(self, name)[..., places] for name in of_samples}
        return replace(self, joints=self.joints.at(places), feet=[foot[places] for foot in self.feet], **selected)

    def one_by_one(self, places: Sequence[int]) -> TiltSamples:
        """Return copies of selected samples at rest, each with a single reading of 1 rad/s.

        The order is: all samples with the gyroscope's first axis, its other axes, then each joint's velocity.
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

    def corrected(self, values: TracedValues) -> tuple[Traced, ...]:
        """Return the fields of `SensedLift` in its order, components first."""
        (_, up, turning), (position, velocity) = self._sensed(values), self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        line = ContactLine.of(posture, self.feet, self._contacts(values, posture, self._floor_normal(values, up)))
        return position, velocity, up, turning, line.left

    def lean(self, values: TracedValues) -> Traced:
        """Return the (n,) sine of the line's inclination to the floor, up to its left foot.

        The upward direction is the accelerometer's mean, corrected for its errors.
        """
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        gravity = turned(rotation, specific_force(values, GRAVITY * self.up_in_imu, self.when))
        normal = self._floor_normal(values, gravity / length(gravity))
        position, _ = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        return dot(ContactLine.of(posture, self.feet, self._contacts(values, posture, normal)).left, normal)

    def momentum(self, values: TracedValues) -> Traced:
        """Return (n,) l . L_o [kg m2/s]."""
        _, up, turning = self._sensed(values)
        line, _, _, angular = self._line_and_momenta(values, up, turning)
        return dot(line.left, angular)

    def momentum_and_rate(self, values: TracedValues) -> tuple[Traced, Traced]:
        """Return (n,) l . L_o [kg m2/s] and its rate of change, the right side of the tilt equation [Nm]."""
        rotation, up, turning = self._sensed(values)
        line, rolling, robot, angular = self._line_and_momenta(values, up, turning)
        rate = (
            dot(cross(line.left, self._specific_force(values, rotation, turning)), robot.first)
            - dot(line.left, cross(rolling.velocity - rolling.base_velocity, robot.linear))
            + dot(rolling.left_rate, angular)
            - GRAVITY * robot.mass * self._resistance_arm(values, rolling)
            + dot(line.left, self._moment(values, line, up)) * (robot.mass * (1 / self.legs.robot_mass))
        )
        return dot(line.left, angular), rate

    def inertia_and_moment(self, values: TracedValues) -> tuple[Traced, Traced]:
        """Return (n,) l . I_o l, and M times the height of the CoM above the line.

        The first is the momentum l . L_o of a robot that rotates about its line at 1 rad/s with locked joints.
        """
        position, _ = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        (_, up, _), still = self._sensed(values), Traced(np.zeros(self.joints.position.shape))
        line = ContactLine.of(posture, self.feet, self._contacts(values, posture, self._floor_normal(values, up)))
        turning = self.legs.traced_motion(posture, still, line.left)
        robot = Momenta.about(
            line.point, self.legs, values["inertial"], posture, turning, line.left, cross(line.point, line.left)
        )
        return dot(line.left, robot.angular), dot(up, robot.first)

    def _line_and_momenta(
        self, values: TracedValues, up: Traced, turning: Traced
    ) -> tuple[ContactLine, RollingLine, Momenta, Traced]:
        """Return the line, its motion, the bodies' momenta about it relative to the base's origin, and L_o with rotors."""
        position, velocity = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        motion = self.legs.traced_motion(posture, velocity, turning)
        contacts = self._contacts(values, posture, self._floor_normal(values, up))
        line = ContactLine.of(posture, self.feet, contacts)
        origin = Traced(np.zeros((3, self.count)))
        robot = Momenta.about(line.point, self.legs, values["inertial"], posture, motion, turning, origin)
        angular = robot.angular + values["rotor_spin"] * motion.bending
        return line, RollingLine.of(line, motion, self.feet, contacts), robot, angular

    def _resistance_arm(self, values: TracedValues, rolling: RollingLine) -> Traced:
        """Return the (n,) lever arm of the robot's weight in the rolling resistance, half of it on each foot [m]."""
        left, right = (tanh(turning * (1 / _ROLLING)) for turning in (rolling.left_turning, rolling.right_turning))
        return 0.5 * values["rolling_resistance"][0] * (left + right)

    def _sensed(self, values: TracedValues) -> tuple[Traced, Traced, Traced]:
        """Return the corrected IMU readings.

        Returns:
            (3, 3, n) rotation of the IMU to the base; (3, n) upward direction, accurate enough for contact points; (3, n)
            angular velocity [rad/s]; both in base axes.
        """
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        rate = self._turning(values, self.angular_velocity_in_imu, self.angular_acceleration_in_imu)
        rate = rate - values["gyro_drift"] * self.when
        return rotation, turned(rotation, self.up_in_imu), turned(rotation, rate)

    @staticmethod
    def _turning(values: TracedValues, read: FloatArray, read_rate: FloatArray) -> Traced:
        """Return the (3, n) angular velocity, or its rate, at the time of the accelerometer's sample, to first order."""
        return angular_velocity(values, read) + values["gyro_lag"] * angular_velocity(values, read_rate)

    def _specific_force(self, values: TracedValues, rotation: Traced, turning: Traced) -> Traced:
        """Return the (3, n) specific force at the base's origin, in base axes [m/s2]."""
        force = turned(rotation, specific_force(values, self.acceleration_in_imu, self.when))
        rate = self._turning(values, self.angular_acceleration_in_imu, self.angular_jerk_in_imu)
        turning_rate = turned(rotation, rate)
        arm = values["imu_position"] + self.imu_in_base[:, None]
        return force - cross(turning_rate, arm) - cross(turning, cross(turning, arm))

    def _floor_normal(self, values: TracedValues, up: Traced) -> Traced:
        """Return the (3, n) normal of the floor, in base axes."""
        normal = up + contract("ij,j...->i...", np.eye(3)[:, :2], facing(values["floor_slope"], self.heading))
        return normal / length(normal)

    def _contacts(self, values: TracedValues, posture: TracedPosture, normal: Traced) -> list[FootContact]:
        """Return the contacts of the stance feet with a floor of (3, n) normals, in base axes."""
        radius = self.legs.foot_radius[:, None] * (1.0 + values["foot_radius"] + values["foot_radius_each"])
        radius = radius - _COMPLIANCE_OF_FEET * 0.5 * GRAVITY * self.legs.robot_mass * values["foot_compliance"]
        directions, sample = foot_directions(self.legs, posture), np.arange(self.count)
        return [
            FootContact(radius[foot, sample], normal, values["foot_width"], directions[:, :, foot, sample])
            for foot in self.feet
        ]

    def _moment(self, values: TracedValues, line: ContactLine, up: Traced) -> Traced:
        """Return the (3, n) moment of external force, tether and hanging load about the line's point [Nm]."""
        hanging = contract("ij,j...->i...", np.eye(3)[:, :2], values["hanging_load"])
        end, at_rest = self.legs.end_of_trunk, self.legs.end_of_trunk - self.legs.middle_of_feet
        middle = line.point + 0.5 * line.length * line.left
        at_rest = at_rest + cross(cross(_UP, up), at_rest)
        tether = cross(end - line.point, values["tether_stiffness"] * (at_rest + middle - end))
        return hanging + tether - cross(line.point, self._external_force(values, up))

    def _external_force(self, values: TracedValues, up: Traced) -> Traced:
        """Return the (3, n) constant horizontal force on the base's origin, in base axes [N]."""
        forward = cross(np.array([[0.0], [1.0], [0.0]]), up)
        forward = forward / length(forward)
        force = facing(values["external_force"], self.heading)
        return force[0] * forward + force[1] * cross(up, forward)


def _joint_readings(robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> JointReadings:
    """Return the joint readings of all lifts, with torques from statics."""
    torque = carried_torque(robot, legs, lifts)
    position, velocity, acceleration = (
        np.concatenate([getattr(lift, f"joint_{name}") for lift in lifts])
        for name in ("position", "velocity", "acceleration")
    )
    of_lifts = np.split(torque, np.cumsum([len(lift.joint_position) for lift in lifts])[:-1])
    return JointReadings.of(legs, position, velocity, torque, _rates(of_lifts, lifts), acceleration)


def _rates(readings: Sequence[FloatArray], lifts: Sequence[LiftSamples]) -> FloatArray:
    """Return (n, k) rates of change of the readings of several lifts."""
    return np.concatenate(
        [np.gradient(part, lift.reading_step, axis=0) for part, lift in zip(readings, lifts, strict=True)]
    )


def carried_torque(robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> FloatArray:
    """Return the (n, nj) joint torques of standing legs that carry the robot's weight [Nm]; zero in lifted legs.

    The contact force is the model's mass times the specific force, and its distribution follows from the model's CoM. This is
    accurate enough for joint deflections. Internal forces between the two feet hardly change in a lift and are neglected.
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
    """Return (n,) indices of the left stance foot of each sample of several lifts, and of the right one."""
    return tuple(
        np.repeat([lift.stance_feet for lift in lifts], [len(lift.joint_position) for lift in lifts], axis=0).T
    )
