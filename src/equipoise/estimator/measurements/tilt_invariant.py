"""Tilt equation: angular momentum about the support line of a robot on two feet, without torques and contact forces.

All vectors are in base axes. l is the support line's direction and o a point on it. P and L_o are the robot's linear momentum
and angular momentum about o, relative to the base's origin. r is a body's CoM. f is the specific force at the base's origin,
from the accelerometer: gravity and the origin's acceleration together.

    d/dt (l . L_o) = - l . sum (r - o) x m f  -  l . (do/dt x P)  +  dl/dt . L_o

Contact forces have no moment about l. Integration gives a constant of a trial,

    y(t) = l . L_o(t) - integral of the right side,

linear in the inertial parameters of base and links. All derivatives of o and l are inertial ones written in base axes.

The equation is also valid with the origin's velocity in the momenta and gravity in place of f. That velocity would come from
the encoders of the standing legs. Compliance, backlash and soft feet, which encoders do not measure, would then bias the
inertia.

The angular momentum of geared motors' rotors about the joints' axes is added to L_o.

Other moments about l are added to the right side: the rolling resistance of the feet, a length times their load, and the
forces of a cable that pulls at the base or hangs from it. The cable's force and the floor's slope stay fixed in the world when
the robot is rotated; a hanging load rotates with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.integrate import cumulative_simpson

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN
from equipoise.estimator.measurements.imu_frame import ACCELEROMETER, GYRO
from equipoise.estimator.measurements.leg_motion import LEG_SHAPE, LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.momenta import BASE
from equipoise.estimator.measurements.tilt_samples import TiltSamples
from equipoise.estimator.measurements.traced import Traced
from equipoise.estimator.unknowns import TracedValues, Values, inputs_of
from equipoise.robot.model import RobotModel

Derivatives = Mapping[str, FloatArray]
"""(rows, size) derivatives with respect to each parameter; keys are the parameters' names and "inertial"."""

Linearised = tuple[FloatArray, FloatArray, Derivatives, Derivatives]
"""y(t), the levers, and the derivatives of both."""


@dataclass(frozen=True, eq=False)
class SensedLift:
    """Corrected sensor readings of one trial on two feet.

    Attributes:
        joint_position, joint_velocity: (n, nj) joint positions of the links [rad] and velocities [rad/s].
        up_in_base: (n, 3) upward direction.
        angular_velocity_base_in_base: (n, 3) angular velocity of the base [rad/s].
        line_in_base: (n, 3) direction of the support line, from the right foot to the left.
    """

    joint_position: FloatArray
    joint_velocity: FloatArray
    up_in_base: FloatArray
    angular_velocity_base_in_base: FloatArray
    line_in_base: FloatArray


class TiltInvariant:
    """Function y(t) of a set of trials. The inertial parameters are those of `momenta`.

    Attributes:
        DEPENDS_ON: names of the parameters, without the inertial ones.
        trials: slices of the rows, by trial.
    """

    DEPENDS_ON = (
        *DRIVE_TRAIN,
        "imu_tilt",
        "imu_position",
        *ACCELEROMETER,
        *GYRO,
        "gyro_lag",
        "clock_offset",
        *LEG_SHAPE,
        "foot_radius",
        "foot_radius_each",
        "foot_width",
        "foot_compliance",
        "external_force",
        "hanging_load",
        "tether_stiffness",
        "floor_slope",
        "rolling_resistance",
        "rotor_spin",
    )

    def __init__(self, robot: RobotModel, legs: LegChains, lifts: Sequence[LiftSamples]) -> None:
        self.legs = legs
        self.trials = _slices([lift.rows for lift in lifts])
        self._readings = _slices([len(lift.joint_position) for lift in lifts])
        self._means = [lift.means for lift in lifts]
        # Integration is linear: one matrix per trial is faster than a call per trial and evaluation.
        self._integrals = [lift.means(integral(len(lift.joint_position), lift.reading_step)) for lift in lifts]
        self._samples = TiltSamples.of(robot, legs, lifts)
        self._first = self._samples.at(np.array([trial.start for trial in self._readings], dtype=np.intp))
        self._middles = [(trial.start + trial.stop) // 2 for trial in self._readings]
        self._one_by_one = self._samples.one_by_one(self._middles)
        self._last: tuple[tuple[bytes, ...], Linearised] | None = None  # rounds and checks ask for it again

    def evaluate(self, values: Values, inertial: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute y(t) and its sensitivities to errors of the sensors (levers).

        Returns:
            (n,) y(t), with an arbitrary constant per trial [kg m2/s];
            (2 + 3 + nj, trials) levers of each trial: l . I_o l at its first sample [kg m2]; the robot's mass times the
            height of the CoM above the line, the factor on an error of the specific force [kg m]; and the derivative of
            l . L_o at its middle with respect to each axis of the gyroscope and each joint's velocity [kg m2].
        """
        if (known := self._known(values, inertial)) is not None:
            return known[:2]
        momentum, rate = self._samples.momentum_and_rate(self._inputs(values, inertial, self._samples))
        return self._integrated(momentum.value, rate.value), self.levers(values, inertial)

    def evaluate_each(self, values: Sequence[Values], inertial: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return (n,) y(t) and (trials,) inertia l . I_o l at each first sample [kg m2], with separate values per trial."""
        own = {name: np.stack([of[name] for of in values], axis=1) for name in self.DEPENDS_ON}
        own["inertial"] = np.stack(inertial, axis=1)
        counts = [trial.stop - trial.start for trial in self._readings]
        repeated = {name: np.repeat(value, counts, axis=1) for name, value in own.items()}
        momentum, rate = self._samples.momentum_and_rate(inputs_of(repeated, [*own], self._samples.count))
        inertia, _ = self._first.inertia_and_moment(inputs_of(own, [*own], self._first.count))
        return self._integrated(momentum.value, rate.value), inertia.value

    def sensed(self, values: Values) -> list[SensedLift]:
        """Return the corrected sensor readings of each trial."""
        inputs = self._inputs(values, np.zeros(BASE + 4 * self.legs.links), self._samples)
        parts = self._samples.corrected(inputs)
        return [SensedLift(*(part.value[:, trial].T for part in parts)) for trial in self._readings]

    def levers(self, values: Values, inertial: FloatArray) -> FloatArray:
        """Return the levers of `evaluate`."""
        if (known := self._known(values, inertial)) is not None:
            return known[1]
        about = self._first.inertia_and_moment(self._inputs(values, inertial, self._first))
        read = self._one_by_one.momentum(self._inputs(values, inertial, self._one_by_one))
        return self._stacked(*(part.value for part in (*about, read)))

    @cached_property
    def _middle(self) -> TiltSamples:
        return self._samples.at(np.array(self._middles, dtype=np.intp))

    def lean(self, values: Values, names: Sequence[str] = ()) -> tuple[FloatArray, Derivatives]:
        """Return the (trials,) sine of each line's inclination to the floor, positive if its left foot is higher, and its
        derivatives.

        The line is that at the middle of the trial. With exact values for feet, IMU and floor, the inclination is zero.
        """
        inputs = inputs_of(values, self.DEPENDS_ON, self._middle.count, names)
        lean = self._middle.lean(inputs)
        return lean.value, _gradients(lean, inputs, names)

    def linearise(self, values: Values, inertial: FloatArray, names: Sequence[str] = DEPENDS_ON) -> Linearised:
        """Return the results of `evaluate` and their derivatives by the inertial and the named parameters."""
        known, names = self._known(values, inertial), ("inertial", *names)
        if known is None or tuple(known[2]) != names:
            known = self._linearised(values, inertial, names)
            self._last = _bytes_of(values, inertial), known
        return known

    def _known(self, values: Values, inertial: FloatArray) -> Linearised | None:
        """Return the last derivatives if they are those at the same values, by any parameters."""
        return self._last[1] if self._last is not None and self._last[0] == _bytes_of(values, inertial) else None

    def _linearised(self, values: Values, inertial: FloatArray, names: Sequence[str]) -> Linearised:
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
        """Return the derivatives of y and of the inertia about the line by the inertial parameters, in which both are linear.

        Returns:
            (n, 10 + 4 links) and (trials, 10 + 4 links) columns.
        """
        _, _, by_y, by_levers = self.linearise(values, np.zeros(BASE + 4 * self.legs.links), names=())
        return by_y["inertial"], by_levers["inertial"][0]

    def _stacked(self, inertia: FloatArray, moment: FloatArray, read: FloatArray) -> FloatArray:
        """Stack levers of the first samples and of each reading to (2 + 3 + nj, trials, ...)."""
        return np.concatenate([inertia[None], moment[None], read.reshape(-1, *inertia.shape)])

    def _inputs(
        self, values: Values, inertial: FloatArray, samples: TiltSamples, by: Sequence[str] = ()
    ) -> TracedValues:
        return inputs_of({**values, "inertial": inertial}, ("inertial", *self.DEPENDS_ON), samples.count, by)

    def _integrated(self, momentum: FloatArray, rate: FloatArray) -> FloatArray:
        """Return y(t) from l . L_o and the right side, or its derivatives from theirs."""
        parts = zip(self._means, self._integrals, self._readings, strict=True)
        return np.concatenate([means(momentum[of]) - integral @ rate[of] for means, integral, of in parts])


def _slices(counts: Sequence[int]) -> list[slice]:
    """Return the places of consecutive parts with these numbers of rows."""
    ends = np.cumsum(counts)
    return [slice(int(end - count), int(end)) for end, count in zip(ends, counts, strict=True)]


@lru_cache(maxsize=256)  # all planned lifts have the same one
def integral(count: int, step: float) -> FloatArray:
    """Return the (count, count) matrix that integrates samples a step [s] apart, from the first one to each."""
    matrix = np.asarray(cumulative_simpson(np.eye(count), dx=step, axis=0, initial=0))
    matrix.setflags(write=False)
    return matrix


def _bytes_of(values: Values, inertial: FloatArray) -> tuple[bytes, ...]:
    return (inertial.tobytes(), *(values[name].tobytes() for name in TiltInvariant.DEPENDS_ON))


def _gradients(of: Traced, by: TracedValues, names: Sequence[str]) -> Derivatives:
    """Return (n, size) derivatives of (n,) values by each input."""
    gradients = of.gradients(np.ones(of.value.shape), [by[name] for name in names])
    return {name: gradient.T for name, gradient in zip(names, gradients, strict=True)}
