"""The tilt equation: angular momentum about the support line of a robot on two feet, free of torques and forces.

In base axes, with l the support line's direction, o a point on it, P and L_o the robot's linear momentum and angular
momentum about o, r a body's CoM, and up against gravity:

    d/dt (l . L_o) = l . sum (r - o) x m g  -  l . (do/dt x P)  +  dl/dt . L_o

Contact forces have no moment about l. Integrated, what is constant over a trial is

    y(t) = l . L_o(t) - integral of the right side,

linear in the inertial parameters of base and links. The feet roll on the floor as spheres, which gives
the base's velocity without an accelerometer. All derivatives of o and l are inertial ones written in base axes.

What has a moment about l is added to the right side: feet resist rolling, by a length times the weight that they carry,
and a cable pulls at the base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson, cumulative_trapezoid
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.precise.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.precise.measurements.imu_frame import GYRO, gyro_error, traced_mounting, turned_by, turns_of
from equipoise.precise.measurements.leg_motion import LEG_SHAPE, LegChains, LegShape, TracedPosture
from equipoise.precise.measurements.lift_samples import LiftSamples
from equipoise.precise.measurements.momenta import BASE, Momenta
from equipoise.precise.measurements.support_line import Feet, RollingLine, SupportLine
from equipoise.precise.measurements.traced import Traced, contract, cross, dot, length, tanh, turned
from equipoise.precise.unknowns import TracedValues, Values, inputs_of

_ROLLING = 0.03  # [rad/s] at which feet roll, and do not creep

Derivatives = Mapping[str, FloatArray]
"""(rows, size) derivatives by each unknown, by its name, and by "inertial"."""


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
        "accelerometer_bias",
        *GYRO,
        "clock_offset",
        *LEG_SHAPE,
        "foot_radius",
        "foot_radius_each",
        "pull",
        "floor_slope",
        "rolling",
    )

    def __init__(self, legs: LegChains, rotation_imu_to_base: FloatArray, lifts: Sequence[LiftSamples]) -> None:
        self.legs = legs
        counts = [len(lift.joint_position) for lift in lifts]
        ends = np.cumsum(counts)
        self.trials = [slice(int(end - count), int(end)) for end, count in zip(ends, counts, strict=True)]
        # Integration is linear: one matrix per trial is faster than a call per trial and evaluation.
        self._integrals = [
            np.asarray(cumulative_simpson(np.eye(count), dx=lift.step, axis=0, initial=0))
            for count, lift in zip(counts, lifts, strict=True)
        ]
        self._samples = _Samples.of(legs, rotation_imu_to_base, lifts)
        self._first = self._samples.at(np.array([trial.start for trial in self.trials], dtype=np.intp))
        middle = self._samples.at(np.array([(trial.start + trial.stop) // 2 for trial in self.trials]))
        velocity = Traced.input(middle.joints.velocity.value)
        self._middle = replace(middle, joints=replace(middle.joints, velocity=velocity))

    def evaluate(self, values: Values, inertial: FloatArray) -> tuple[FloatArray, FloatArray]:
        """y(t) and the moment of inertia about the line.

        Returns:
            (n,) y(t), with an arbitrary constant per trial [kg m2/s];
            (trials,) l . I_o l at each trial's first sample [kg m2].
        """
        momentum, rate = self._samples.momentum_and_rate(self._inputs(values, inertial, self._samples))
        return self._integrated(momentum.value, rate.value), self.inertia_about_line(values, inertial)

    def inertia_about_line(self, values: Values, inertial: FloatArray) -> FloatArray:
        """The second part of `evaluate`."""
        return self._first.inertia_about_line(self._inputs(values, inertial, self._first)).value

    def linearise(
        self, values: Values, inertial: FloatArray, names: Sequence[str] = DEPENDS_ON
    ) -> tuple[FloatArray, FloatArray, Derivatives, Derivatives]:
        """`evaluate`, and the derivatives of both by the inertial parameters and by the unknowns named."""
        names = ("inertial", *names)
        samples, first = (self._inputs(values, inertial, part, names) for part in (self._samples, self._first))
        momentum, rate = self._samples.momentum_and_rate(samples)
        inertia = self._first.inertia_about_line(first)
        return (
            self._integrated(momentum.value, rate.value),
            inertia.value,
            {
                name: self._integrated(by_momentum.T, by_rate.T)
                for name, by_momentum, by_rate in zip(
                    names, _gradients(momentum, samples, names), _gradients(rate, samples, names), strict=True
                )
            },
            {name: by_inertia.T for name, by_inertia in zip(names, _gradients(inertia, first, names), strict=True)},
        )

    def rows(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """What both are linear in the inertial parameters by: (n, 10 + 4 links) columns, (trials, 10 + 4 links) ones."""
        _, _, by_y, by_inertia = self.linearise(values, np.zeros(BASE + 4 * self.legs.links), names=())
        return by_y["inertial"], by_inertia["inertial"]

    def velocity_sensitivity(self, values: Values, inertial: FloatArray) -> FloatArray:
        """(trials,) root sum of squares over joints of how l . L_o changes with a joint's velocity [kg m2].

        At each trial's middle; with it, noise of the joint velocities becomes noise of y.
        """
        momentum, _ = self._middle.momentum_and_rate(self._inputs(values, inertial, self._middle))
        (by_velocity,) = momentum.gradients(np.ones(self._middle.count), [self._middle.joints.velocity])
        return np.sqrt((by_velocity**2).sum(axis=0))

    def _inputs(self, values: Values, inertial: FloatArray, samples: _Samples, by: Sequence[str] = ()) -> TracedValues:
        return inputs_of({**values, "inertial": inertial}, ("inertial", *self.DEPENDS_ON), samples.count, by)

    def _integrated(self, momentum: FloatArray, rate: FloatArray) -> FloatArray:
        """y(t) of l . L_o and of the right side, or derivatives of y of those of both."""
        y = momentum.copy()
        for trial, integral in zip(self.trials, self._integrals, strict=True):
            y[trial] -= integral @ rate[trial]
        return y


def _gradients(of: Traced, by: TracedValues, names: Sequence[str]) -> list[FloatArray]:
    return of.gradients(np.ones(of.value.shape), [by[name] for name in names])


@dataclass(frozen=True, eq=False)
class _Samples:
    """n samples of some lifts, components first; what is read of a lift is in `LiftSamples`.

    Attributes:
        turns: (3, 3, 3, n) integrals since the rest of R_ij w_k, of attitudes R and readings w of the gyroscope.
        feet: (n,) indices of the left stance foot, and of the right one.
    """

    legs: LegChains
    rotation_imu_to_base: FloatArray
    joints: JointReadings
    angular_velocity_in_imu: FloatArray
    angular_acceleration_in_imu: FloatArray
    rotation_from_rest: FloatArray
    turns: FloatArray
    rest_acceleration_in_imu: FloatArray
    feet: Feet

    @classmethod
    def of(cls, legs: LegChains, rotation_imu_to_base: FloatArray, lifts: Sequence[LiftSamples]) -> _Samples:
        counts = [len(lift.joint_position) for lift in lifts]

        def joined(name: str) -> FloatArray:
            return np.ascontiguousarray(np.concatenate([getattr(lift, name) for lift in lifts]).T)

        return cls(
            legs,
            rotation_imu_to_base,
            JointReadings.of(
                legs,
                *(np.concatenate(parts) for parts in zip(*map(_joint_parts, lifts), strict=True)),
            ),
            joined("angular_velocity_in_imu"),
            joined("angular_acceleration_in_imu"),
            joined("rotation_to_rest"),
            np.concatenate([_turns(lift) for lift in lifts], axis=-1),
            np.repeat([lift.rest_acceleration_in_imu for lift in lifts], counts, axis=0).T,
            tuple(np.repeat([lift.stance_feet for lift in lifts], counts, axis=0).T),
        )

    @property
    def count(self) -> int:
        return len(self.feet[0])

    def at(self, places: NDArray[np.intp]) -> _Samples:
        """Some of the samples."""
        return _Samples(
            self.legs,
            self.rotation_imu_to_base,
            self.joints.at(places),
            self.angular_velocity_in_imu[:, places],
            self.angular_acceleration_in_imu[:, places],
            self.rotation_from_rest[..., places],
            self.turns[..., places],
            self.rest_acceleration_in_imu[:, places],
            [foot[places] for foot in self.feet],
        )

    def momentum_and_rate(self, values: TracedValues) -> tuple[Traced, Traced]:
        """(n,) l . L_o [kg m2/s], and its rate of change: the right side of the tilt equation [Nm]."""
        angular_velocity, up = self._turning_and_up(values)
        posture, to_centre = self._posture(values), self._to_centre(values, up)
        motion = self.legs.traced_motion(posture, self.joints.link_velocity(values), angular_velocity)
        line = SupportLine.of(posture, self.feet, to_centre)
        rolling = RollingLine.of(line, motion, self.feet, to_centre)
        robot = Momenta.about(
            line.point, self.legs, values["inertial"], posture, motion, angular_velocity, rolling.base_velocity
        )
        rate = (
            GRAVITY * dot(cross(line.left, up), robot.first)
            - dot(line.left, cross(rolling.velocity, robot.linear))
            + dot(rolling.left_rate, robot.angular)
            - GRAVITY * robot.mass * self._resistance_arm(values, rolling)
            - dot(line.left, cross(line.point, self._pull(values, up))) * (robot.mass * (1 / self.legs.robot_mass))
        )
        return dot(line.left, robot.angular), rate

    def inertia_about_line(self, values: TracedValues) -> Traced:
        """(n,) l . I_o l: the momentum l . L_o of a robot that turns about its line at 1 rad/s with its joints locked."""
        _, up = self._turning_and_up(values)
        posture, still = self._posture(values), Traced(np.zeros(self.joints.position.shape))
        line = SupportLine.of(posture, self.feet, self._to_centre(values, up))
        turning = self.legs.traced_motion(posture, still, line.left)
        robot = Momenta.about(
            line.point, self.legs, values["inertial"], posture, turning, line.left, cross(line.point, line.left)
        )
        return dot(line.left, robot.angular)

    def _resistance_arm(self, values: TracedValues, rolling: RollingLine) -> Traced:
        """(n,) length behind its weight at which the floor carries the robot: half of it on each rolling foot [m]."""
        left, right = (tanh(turning * (1 / _ROLLING)) for turning in (rolling.left_turning, rolling.right_turning))
        return 0.5 * values["rolling"][0] * (left + right)

    def _pull(self, values: TracedValues, up: Traced) -> Traced:
        """(3, n) constant horizontal force on the base's origin, forward and to its left, in base axes [N]."""
        forward = cross(np.array([[0.0], [1.0], [0.0]]), up)
        forward = forward / length(forward)
        return values["pull"][0] * forward + values["pull"][1] * cross(up, forward)

    def _posture(self, values: TracedValues) -> TracedPosture:
        return self.legs.traced_posture(self.joints.link_position(values), LegShape.of(self.legs, values))

    def _turning_and_up(self, values: TracedValues) -> tuple[Traced, Traced]:
        """(3, n) angular velocity and direction against gravity, in base axes."""
        # The IMU's samples are younger: what it will read that much earlier belongs to the encoders' samples.
        late = values["clock_offset"]
        error = gyro_error(values)
        angular_velocity_in_imu = self.angular_velocity_in_imu - late * self.angular_acceleration_in_imu
        angular_velocity_in_imu = angular_velocity_in_imu - turned(error, angular_velocity_in_imu)
        gravity = self.rest_acceleration_in_imu - values["accelerometer_bias"]
        up_at_rest = gravity / length(gravity)
        up_in_imu = turned(self.rotation_from_rest, up_at_rest + cross(turned_by(error, self.turns), up_at_rest))
        up_in_imu = up_in_imu + late * cross(self.angular_velocity_in_imu, up_in_imu)
        rotation = traced_mounting(self.rotation_imu_to_base, values["imu_tilt"])
        return turned(rotation, angular_velocity_in_imu), turned(rotation, up_in_imu)

    def _to_centre(self, values: TracedValues, up: Traced) -> list[Traced]:
        """(3, n) from the contact points of the stance feet to their centres, in base axes [m]."""
        normal = up + contract("ij,j...->i...", np.eye(3)[:, :2], values["floor_slope"])
        normal = normal / length(normal)
        radius = self.legs.foot_radius[:, None] * (1.0 + values["foot_radius"] + values["foot_radius_each"])
        return [radius[foot, np.arange(self.count)] * normal for foot in self.feet]


def _turns(lift: LiftSamples) -> FloatArray:
    """(3, 3, 3, n) `turns` of a lift; up to its first sample of the turn, a small one, as if it was about one axis."""
    rate = np.einsum("nij,nk->ijkn", lift.rotation_to_rest, lift.angular_velocity_in_imu)
    before = turns_of(Rotation.from_matrix(lift.rotation_to_rest[0]))
    return before[..., None] + cumulative_trapezoid(rate, dx=lift.step, axis=-1, initial=0)


def _joint_parts(lift: LiftSamples) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Positions, velocities, torques and their rates of change."""
    none = np.zeros_like(lift.joint_position)
    torque = none if lift.joint_torque is None else lift.joint_torque
    rate = none if lift.joint_torque_rate is None else lift.joint_torque_rate
    return lift.joint_position, lift.joint_velocity, torque, rate
