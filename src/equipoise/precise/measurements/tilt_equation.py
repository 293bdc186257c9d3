"""The tilt equation: angular momentum about the support line of a robot on two feet, free of torques and forces.

In base axes, with l the support line's direction, o a point on it, P and L_o the robot's linear momentum and angular
momentum about o as seen from the base's origin (which is taken to stand still), r a body's CoM, and f the specific force that
the accelerometer feels there, gravity and the origin's own acceleration in one:

    d/dt (l . L_o) = - l . sum (r - o) x m f  -  l . (do/dt x P)  +  dl/dt . L_o

Contact forces have no moment about l. Integrated, what is constant over a trial is

    y(t) = l . L_o(t) - integral of the right side,

linear in the inertial parameters of base and links. All derivatives of o and l are inertial ones written in base axes.

The equation holds as well with the origin's velocity in the momenta and gravity in place of f. That velocity would come from
the encoders of the standing legs; what these do not see, springs, play, soft feet, is then taken for the robot's inertia.

The rotors of geared motors turn with a momentum of their own, about the joints' axes: it is added to L_o.

What has a moment about l is added to the right side: feet resist rolling, by a length times the weight that they carry,
and a cable pulls at the base. The cable's force and the floor's slope stay in the room when the robot is turned in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.precise.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.precise.measurements.heading import facing
from equipoise.precise.measurements.imu_frame import ACCELEROMETER, GYRO, gyro_error, specific_force, traced_mounting
from equipoise.precise.measurements.leg_motion import LEG_SHAPE, LegChains, LegShape
from equipoise.precise.measurements.lift_samples import LiftSamples
from equipoise.precise.measurements.momenta import BASE, Momenta
from equipoise.precise.measurements.support_line import Feet, RollingLine, SupportLine
from equipoise.precise.measurements.traced import Traced, contract, cross, dot, length, tanh, turned
from equipoise.precise.unknowns import TracedValues, Values, inputs_of
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

_ROLLING = 0.03  # [rad/s] at which feet roll, and do not creep
# Of the sag: a soft foot comes nearer to what it stands on, a soft floor goes down with it, and nobody knows which gives.
_GIVEN_BY_FEET = 0.5

Derivatives = Mapping[str, FloatArray]
"""(rows, size) derivatives by each unknown, by its name, and by "inertial"."""


@dataclass(frozen=True, eq=False)
class SensedLift:
    """The time on two feet of one trial, less the errors of its sensors.

    Attributes:
        joint_position, joint_velocity: (n, nj) joint positions of the links [rad] and velocities [rad/s].
        up_in_base: (n, 3) direction against gravity.
        angular_velocity_base_in_base: (n, 3) angular velocity of the base [rad/s].
        line_in_base: (n, 3) direction of the support line, from the right foot to the left.
    """

    joint_position: FloatArray
    joint_velocity: FloatArray
    up_in_base: FloatArray
    angular_velocity_base_in_base: FloatArray
    line_in_base: FloatArray


class TiltEquation:
    """y(t) of a set of trials, at any values of what it depends on.

    The inertial parameters are those of `momenta`.

    Attributes:
        DEPENDS_ON: names of the unknowns beside the inertial parameters.
        trials: slices of the rows, by trial.
    """

    DEPENDS_ON = (
        *DRIVE_TRAIN,
        "imu_tilt",
        *ACCELEROMETER,
        *GYRO,
        "clock_offset",
        *LEG_SHAPE,
        "foot_radius",
        "foot_radius_each",
        "sag",
        "pull",
        "floor_slope",
        "rolling",
        "rotor_spin",
    )

    def __init__(self, robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> None:
        self.legs = legs
        counts = [len(lift.joint_position) for lift in lifts]
        ends = np.cumsum(counts)
        self.trials = [slice(int(end - count), int(end)) for end, count in zip(ends, counts, strict=True)]
        # Integration is linear: one matrix per trial is faster than a call per trial and evaluation.
        self._integrals = [integral(len(lift.joint_position), lift.step) for lift in lifts]
        self._samples = _Samples.of(robot, legs, lifts)
        self._first = self._samples.at(np.array([trial.start for trial in self.trials], dtype=np.intp))
        self._middles = [(trial.start + trial.stop) // 2 for trial in self.trials]
        self._one_by_one = self._samples.one_by_one(self._middles)

    def evaluate(self, values: Values, inertial: FloatArray) -> tuple[FloatArray, FloatArray]:
        """y(t), and what it is multiplied by.

        Returns:
            (n,) y(t), with an arbitrary constant per trial [kg m2/s];
            (2 + 3 + nj, trials) levers of each trial: l . I_o l at its first sample [kg m2]; M times the height of the CoM
            above the line, which an error of the specific force is multiplied by [kg m]; and how l . L_o changes at its middle
            with what each axis of the gyroscope, and each joint's velocity, reads [kg m2].
        """
        momentum, rate = self._samples.momentum_and_rate(self._inputs(values, inertial, self._samples))
        return self._integrated(momentum.value, rate.value), self.levers(values, inertial)

    def evaluate_each(self, values: Sequence[Values], inertial: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """(n,) y(t), and (trials,) inertia l . I_o l at each first sample [kg m2]; each trial at values of its own."""
        own = {name: np.stack([of[name] for of in values], axis=1) for name in self.DEPENDS_ON}
        own["inertial"] = np.stack(inertial, axis=1)
        counts = [trial.stop - trial.start for trial in self.trials]
        repeated = {name: np.repeat(value, counts, axis=1) for name, value in own.items()}
        momentum, rate = self._samples.momentum_and_rate(inputs_of(repeated, [*own], self._samples.count))
        inertia, _ = self._first.inertia_and_moment(inputs_of(own, [*own], self._first.count))
        return self._integrated(momentum.value, rate.value), inertia.value

    def sensed(self, values: Values) -> list[SensedLift]:
        """Each trial as its sensors have it, less their errors."""
        inputs = self._inputs(values, np.zeros(BASE + 4 * self.legs.links), self._samples)
        parts = self._samples.less_errors(inputs)
        return [SensedLift(*(part.value[:, trial].T for part in parts)) for trial in self.trials]

    def levers(self, values: Values, inertial: FloatArray) -> FloatArray:
        """The second part of `evaluate`."""
        about = self._first.inertia_and_moment(self._inputs(values, inertial, self._first))
        read = self._one_by_one.momentum(self._inputs(values, inertial, self._one_by_one))
        return self._stacked(*(part.value for part in (*about, read)))

    @cached_property
    def _middle(self) -> _Samples:
        return self._samples.at(np.array(self._middles, dtype=np.intp))

    def lean(self, values: Values, names: Sequence[str] = ()) -> tuple[FloatArray, Derivatives]:
        """(trials,) sine of the angle at which each line rises to its left foot, over the floor, at the middle; derivatives.

        Zero where feet, IMU and floor are as the values say.
        """
        inputs = inputs_of(values, self.DEPENDS_ON, self._middle.count, names)
        lean = self._middle.lean(inputs)
        return lean.value, _gradients(lean, inputs, names)

    def linearise(
        self, values: Values, inertial: FloatArray, names: Sequence[str] = DEPENDS_ON
    ) -> tuple[FloatArray, FloatArray, Derivatives, Derivatives]:
        """`evaluate`, and the derivatives of both by the inertial parameters and by the unknowns named."""
        names = ("inertial", *names)
        samples, first, one_by_one = (
            self._inputs(values, inertial, part, names) for part in (self._samples, self._first, self._one_by_one)
        )
        momentum, rate = self._samples.momentum_and_rate(samples)
        about, read = self._first.inertia_and_moment(first), self._one_by_one.momentum(one_by_one)
        by_momentum, by_rate = (_gradients(part, samples, names) for part in (momentum, rate))
        by_levers = (*(_gradients(part, first, names) for part in about), _gradients(read, one_by_one, names))
        return (
            self._integrated(momentum.value, rate.value),
            self._stacked(*(part.value for part in (*about, read))),
            {name: self._integrated(by_momentum[name], by_rate[name]) for name in names},
            {name: self._stacked(*(by_lever[name] for by_lever in by_levers)) for name in names},
        )

    def rows(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """What y and the inertia about the line are linear in the inertial parameters by.

        Returns:
            (n, 10 + 4 links) and (trials, 10 + 4 links) columns.
        """
        _, _, by_y, by_levers = self.linearise(values, np.zeros(BASE + 4 * self.legs.links), names=())
        return by_y["inertial"], by_levers["inertial"][0]

    def _stacked(self, inertia: FloatArray, moment: FloatArray, read: FloatArray) -> FloatArray:
        """(2 + 3 + nj, trials, ...) of those at the first samples, and those reading by reading."""
        return np.concatenate([inertia[None], moment[None], read.reshape(-1, *inertia.shape)])

    def _inputs(self, values: Values, inertial: FloatArray, samples: _Samples, by: Sequence[str] = ()) -> TracedValues:
        return inputs_of({**values, "inertial": inertial}, ("inertial", *self.DEPENDS_ON), samples.count, by)

    def _integrated(self, momentum: FloatArray, rate: FloatArray) -> FloatArray:
        """y(t) of l . L_o and of the right side, or derivatives of y of those of both."""
        y = momentum.copy()
        for trial, integral in zip(self.trials, self._integrals, strict=True):
            y[trial] -= integral @ rate[trial]
        return y


@lru_cache(maxsize=256)  # lifts that are planned have all the same
def integral(count: int, step: float) -> FloatArray:
    """(count, count) matrix that integrates samples a step [s] apart, from the first one to each."""
    matrix = np.asarray(cumulative_simpson(np.eye(count), dx=step, axis=0, initial=0))
    matrix.setflags(write=False)
    return matrix


def _gradients(of: Traced, by: TracedValues, names: Sequence[str]) -> Derivatives:
    """(n, size) derivatives of (n,) values by each input."""
    gradients = of.gradients(np.ones(of.value.shape), [by[name] for name in names])
    return {name: gradient.T for name, gradient in zip(names, gradients, strict=True)}


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
class _Samples:
    """n samples of some lifts, components first; what is read of a lift is in `LiftSamples`.

    Attributes:
        imu_in_base: (3,) place of the IMU [m].
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
    acceleration_in_imu: FloatArray
    up_in_imu: FloatArray
    feet: Feet
    when: FloatArray
    heading: FloatArray

    @classmethod
    def of(cls, robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> _Samples:
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
            joined("acceleration_in_imu"),
            joined("up_in_imu"),
            _stance_feet(lifts),
            np.repeat([lift.when for lift in lifts], counts),
            np.repeat([lift.heading for lift in lifts], counts),
        )

    @property
    def count(self) -> int:
        return len(self.feet[0])

    def at(self, places: NDArray[np.intp]) -> _Samples:
        """Some of the samples."""
        return replace(
            self,
            joints=self.joints.at(places),
            angular_velocity_in_imu=self.angular_velocity_in_imu[:, places],
            angular_acceleration_in_imu=self.angular_acceleration_in_imu[:, places],
            acceleration_in_imu=self.acceleration_in_imu[:, places],
            up_in_imu=self.up_in_imu[:, places],
            feet=[foot[places] for foot in self.feet],
            when=self.when[places],
            heading=self.heading[places],
        )

    def one_by_one(self, places: Sequence[int]) -> _Samples:
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
        )

    def less_errors(self, values: TracedValues) -> tuple[Traced, ...]:
        """Components of `SensedLift`, first axes first, in its order."""
        imu, (position, velocity) = self._sensed(values), self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        line = SupportLine.of(posture, self.feet, self._to_centre(values, imu.up))
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
        return dot(SupportLine.of(posture, self.feet, self._radii_along(values, normal)).left, normal)

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
            - dot(line.left, cross(line.point, self._pull(values, imu.up))) * (robot.mass * (1 / self.legs.robot_mass))
        )
        return dot(line.left, angular), rate

    def inertia_and_moment(self, values: TracedValues) -> tuple[Traced, Traced]:
        """(n,) l . I_o l, and M times the height of the CoM above the line.

        The first is the momentum l . L_o of a robot that turns about its line at 1 rad/s with its joints locked.
        """
        position, _ = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        up, still = self._sensed(values).up, Traced(np.zeros(self.joints.position.shape))
        line = SupportLine.of(posture, self.feet, self._to_centre(values, up))
        turning = self.legs.traced_motion(posture, still, line.left)
        robot = Momenta.about(
            line.point, self.legs, values["inertial"], posture, turning, line.left, cross(line.point, line.left)
        )
        return dot(line.left, robot.angular), dot(up, robot.first)

    def _line_and_momenta(self, values: TracedValues, imu: _Sensed) -> tuple[SupportLine, RollingLine, Momenta, Traced]:
        """The line, how it moves, the bodies' momenta about it as seen from the base's origin, and L_o with the rotors'."""
        to_centre = self._to_centre(values, imu.up)
        position, velocity = self.joints.later(values)
        posture = self.legs.traced_posture(position, LegShape.of(self.legs, values))
        motion = self.legs.traced_motion(posture, velocity, imu.turning)
        line = SupportLine.of(posture, self.feet, to_centre)
        origin = Traced(np.zeros((3, self.count)))
        robot = Momenta.about(line.point, self.legs, values["inertial"], posture, motion, imu.turning, origin)
        angular = robot.angular + values["rotor_spin"] * motion.bending
        return line, RollingLine.of(line, motion, self.feet, to_centre), robot, angular

    def _resistance_arm(self, values: TracedValues, rolling: RollingLine) -> Traced:
        """(n,) length behind its weight at which the floor carries the robot: half of it on each rolling foot [m]."""
        left, right = (tanh(turning * (1 / _ROLLING)) for turning in (rolling.left_turning, rolling.right_turning))
        return 0.5 * values["rolling"][0] * (left + right)

    def _sensed(self, values: TracedValues) -> _Sensed:
        """What the IMU says, in base axes."""
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        read = self.angular_velocity_in_imu
        turning = turned(rotation, read - turned(gyro_error(values), read) - values["gyro_drift"] * self.when)
        return _Sensed(rotation, turned(rotation, self.up_in_imu), turning)

    def _specific_force(self, values: TracedValues, imu: _Sensed) -> Traced:
        """(3, n) specific force at the base's origin, in base axes [m/s2]."""
        force = turned(imu.rotation, specific_force(values, self.acceleration_in_imu, self.when))
        arm = np.broadcast_to(self.imu_in_base[:, None], (3, self.count))
        swept = cross(turned(imu.rotation, self.angular_acceleration_in_imu), arm)
        return force - swept - cross(imu.turning, cross(imu.turning, arm))

    def _to_centre(self, values: TracedValues, up: Traced) -> list[Traced]:
        """(3, n) from the contact points of the stance feet to their centres, in base axes [m]."""
        return self._radii_along(values, self._floor_normal(values, up))

    def _floor_normal(self, values: TracedValues, up: Traced) -> Traced:
        """(3, n) in base axes."""
        normal = up + contract("ij,j...->i...", np.eye(3)[:, :2], facing(values["floor_slope"], self.heading))
        return normal / length(normal)

    def _radii_along(self, values: TracedValues, normal: Traced) -> list[Traced]:
        """(3, n) radii of the stance feet along the floor's normal [m]."""
        radius = self.legs.foot_radius[:, None] * (1.0 + values["foot_radius"] + values["foot_radius_each"])
        radius = radius - _GIVEN_BY_FEET * 0.5 * GRAVITY * self.legs.robot_mass * values["sag"]
        return [radius[foot, np.arange(self.count)] * normal for foot in self.feet]

    def _pull(self, values: TracedValues, up: Traced) -> Traced:
        """(3, n) constant horizontal force on the base's origin, in base axes [N]."""
        forward = cross(np.array([[0.0], [1.0], [0.0]]), up)
        forward = forward / length(forward)
        pull = facing(values["pull"], self.heading)
        return pull[0] * forward + pull[1] * cross(up, forward)


def _joint_readings(robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> JointReadings:
    """Of all samples of some lifts, with the torques that they carry."""
    torque = carried_torque(robot, legs, lifts)
    ends = np.cumsum([len(lift.joint_position) for lift in lifts])[:-1]
    rates = [np.gradient(part, lift.step, axis=0) for part, lift in zip(np.split(torque, ends), lifts, strict=True)]
    position, velocity, acceleration = (
        np.concatenate([getattr(lift, f"joint_{name}") for lift in lifts])
        for name in ("position", "velocity", "acceleration")
    )
    return JointReadings.of(legs, position, velocity, torque, np.concatenate(rates), acceleration)


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
