"""Tilt equation of lifts and steps, with errors in variables.

The residual is y(t) of every trial (tilt_invariant.py), minus its mean, divided by the moment of inertia about the support
line: an angular velocity. Parameters multiply the sensor readings in it, so its covariance depends on these parameters
(total least squares, see `TiltNoise`). With fixed weights, noise in the regressors would bias the inertia towards zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import MotionEquation, RunContext, whitening_of
from equipoise.estimator.measurements.lift_samples import LiftSamples, read_lift
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant, integral
from equipoise.estimator.measurements.walking import read_walk
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.recording.recording import Recording
from equipoise.recording.trials import LiftTrial, WalkTrial

_FREE_CONSTANT = 0.25  # [rad2/s2] variance of a trial's unknown constant: practically infinite
_SHARED = 2.5  # effective number of lifts with the same model error: correlated errors average less than noise
# Residual of an ideal robot beyond sensor noise: compliant contacts [rad/s], and an accelerometer bias that varies from lift
# to lift [m/s2].
_TILT_FLOOR, _BIAS_FLOOR = 3e-4, 2e-3
# Normalized residual up to which the unexplained part is modelled as an angular velocity: lifts of ordinary robots stay below
# it, which leaves their inertia unbiased. Beyond it the unexplained part is modelled as a moment, as of feet that hardly
# roll: a moment turns a larger inertia less. With a constant noise the inertia would diverge to two or three times the truth.
_MOST_OF_VELOCITY = 4.0


class TiltEquation(MotionEquation[LiftSamples]):
    """Whitened rows of the tilt equation of all lifts and steps."""

    depends_on = (*INERTIAL, *TiltInvariant.DEPENDS_ON)
    name = "lifts"
    kind = LiftSamples
    source = "noise of the lifts"
    shared = _SHARED

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[LiftSamples]:
        """Return the samples on two feet of a lift, or of each step of a walk."""
        trial = recording.trial
        if isinstance(trial, LiftTrial):
            return (_read_lift(run, recording, trial),)
        if isinstance(trial, WalkTrial) and recording.complete:
            return [replace(step, when=run.when) for step in read_walk(recording, trial, run.stance, run.gyro_bias)]
        return ()

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, LiftSamples]]) -> None:
        super().__init__(unknowns, samples)
        self.equation = TiltInvariant(unknowns.robot, unknowns.legs, self.samples)
        self._sensors = [TiltNoise.of(lift) for lift in self.samples]
        self._noise = self._sensors
        self._unexplained = np.zeros(self.motions[-1][1].stop)

    def _rows_in(self, sample: LiftSamples) -> int:
        return sample.rows

    def prepare(self, x: FloatArray) -> None:
        """Compute the noise of each trial, of its sensors and beyond."""
        levers = self.equation.levers(self.unknowns.values(x), self.unknowns.inertial(x))
        self._noise = [
            sensors.raised(scale, gains)
            for scale, sensors, gains in zip(self.scale, self._sensors, (levers[1:] / levers[0]).T, strict=True)
        ]

    def zero_at(self, x: FloatArray) -> None:
        """Subtract the residual at x from all residuals: predicted lifts are accurate enough for derivatives only.

        Derivatives are needed next, so they are computed at once and kept.
        """
        y, levers, *_ = self.equation.linearise(self.unknowns.values(x), self.unknowns.inertial(x), self.open)
        self._unexplained = np.concatenate(
            [_centred(y[trial]) / inertia for trial, inertia in zip(self.equation.trials, levers[0], strict=True)]
        )

    def residual(self, x: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                noise.whitening(gains) @ residual
                for noise, (residual, gains) in zip(self._noise, self._residuals(x), strict=True)
            ]
        )

    def _residuals(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return the (n,) residual [rad/s] and (1 + 3 + nj,) gains of each trial."""
        y, levers = self.equation.evaluate(self.unknowns.values(x), self.unknowns.inertial(x))
        inertia, gains = levers[0], levers[1:] / levers[0]
        return [
            (_centred(y[trial]) / inertia[index] - self._unexplained[trial], gains[:, index])
            for index, trial in enumerate(self.equation.trials)
        ]

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, inertial = self.unknowns.values(x), self.unknowns.inertial(x)
        y, levers, by_y, by_levers = self.equation.linearise(values, inertial, self.open)
        columns, lever_columns = self._by_unknowns(x, by_y), self._by_unknowns(x, by_levers)
        inertia, gains, by_inertia = levers[0], levers[1:] / levers[0], lever_columns[0]
        by_gains = (lever_columns[1:] - gains[..., None] * by_inertia) / inertia[:, None]
        residuals: list[FloatArray] = []
        jacobians: list[FloatArray] = []
        for index, (noise, trial) in enumerate(zip(self._noise, self.equation.trials, strict=True)):
            whitening = noise.whitening(gains[:, index])
            moved = _centred(y[trial]) / inertia[index]
            residuals.append(whitening @ (moved - self._unexplained[trial]))
            derivative = (_centred(columns[trial]) - np.outer(moved, by_inertia[index])) / inertia[index]
            grown = noise.growth(gains[:, index], by_gains[:, index], whitening.T @ residuals[-1])
            jacobians.append(whitening @ (derivative - grown))
        return np.concatenate(residuals), np.concatenate(jacobians)

    def unwhitened(self, x: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield each lift's (n, len(columns)) derivative [rad/s] and (n, n) noise covariance [rad2/s2]."""
        _, jacobian = self.linearise(x)
        levers = self.equation.levers(self.unknowns.values(x), self.unknowns.inertial(x))
        for (_, rows), noise, gains in zip(self.motions, self._noise, (levers[1:] / levers[0]).T, strict=True):
            derivative = np.linalg.solve(noise.whitening(gains), jacobian[rows])
            yield np.asarray(derivative, dtype=float), noise.covariance(gains)

    def normalized_residual(self, x: FloatArray) -> FloatArray:
        return np.array(
            [
                np.sqrt(np.sum((sensors.whitening(gains) @ residual) ** 2) / sensors.explains(gains))
                for sensors, (residual, gains) in zip(self._sensors, self._residuals(x), strict=True)
            ]
        )


def _read_lift(run: RunContext, recording: Recording, trial: LiftTrial) -> LiftSamples:
    if not recording.complete:
        reason = "not lifted: out of reach, or the robot could have tipped over"
        raise RecordingError(reason if recording.refused else "interrupted")
    lift = read_lift(run.robot, run.legs, recording, trial.diagonal, run.stance, run.gyro_bias)
    return replace(lift, when=run.when, heading=run.heading)


@dataclass(frozen=True, eq=False)
class TiltNoise:
    """Noise of a lift's residual, from the noise of its sensors.

    A reading's error is multiplied by a gain that depends on the parameters, and so is its noise. With fixed weights this
    noise would bias the gains towards zero, such as the masses of moving legs. A covariance that follows the parameters
    removes the bias (total least squares; Fuller, Measurement Error Models, chapter 1). The log-determinant of a likelihood
    is omitted, because the true readings are not drawn from a population.

    Attributes:
        specific_force: (n, n) covariance of the specific force's integral, along any axis [m2/s2].
        angular_velocity: (n, n) covariance of any axis of the gyroscope [rad2/s2].
        joint_velocity: (n, n) covariance of any joint's velocity [rad2/s2].
        unexplained: (n, n) covariance beyond sensor noise [rad2/s2].
    """

    specific_force: FloatArray
    angular_velocity: FloatArray
    joint_velocity: FloatArray
    unexplained: FloatArray

    @classmethod
    def of(cls, lift: LiftSamples) -> TiltNoise:
        """Return the noise of a lift from that of its sensors at rest."""
        count = lift.rows
        integrate = integral(count, lift.step)
        ramp = _BIAS_FLOOR * lift.step * np.arange(count)
        force = integrate @ lift.acceleration_noise @ integrate.T + np.outer(ramp, ramp)
        return cls(force, lift.angular_velocity_noise, lift.velocity_noise, _TILT_FLOOR**2 * np.eye(count))

    def raised(self, factor: float, gains: FloatArray) -> TiltNoise:
        """Return the noise of residuals that are `factor` times their sensor noise.

        Args:
            gains: see `covariance`.
        """
        covariance, of_velocity = self.covariance(gains), min(factor, _MOST_OF_VELOCITY)
        moments = (factor**2 - of_velocity**2) * covariance / gains[0] ** 2
        return replace(
            self,
            specific_force=self.specific_force + moments,
            unexplained=self.unexplained + (of_velocity**2 - 1) * covariance,
        )

    def covariance(self, gains: FloatArray) -> FloatArray:
        """Return the (n, n) covariance of the residual [rad2/s2].

        Args:
            gains: (1 + 3 + nj,) factors on the specific force [1/m], each axis of the gyroscope and each joint's velocity.
        """
        force, turning, moving = gains[0] ** 2, gains[1:4] @ gains[1:4], gains[4:] @ gains[4:]
        read = force * self.specific_force + turning * self.angular_velocity + moving * self.joint_velocity
        return read + self.unexplained

    def explains(self, gains: FloatArray) -> float:
        """Return the expected sum of whitened squares from sensor noise: smoothing leaves fewer freedoms than samples."""
        white = self.whitening(gains)
        read = self.covariance(gains) - self.unexplained
        return float(np.einsum("ij,jk,ik->", white, read, white))

    def whitening(self, gains: FloatArray) -> FloatArray:
        """Return an (n, n) matrix that whitens residuals up to a constant."""
        return whitening_of(self.covariance(gains) + _FREE_CONSTANT)

    def growth(self, gains: FloatArray, by_gains: FloatArray, weighted: FloatArray) -> FloatArray:
        """Return (n, size) half the covariance's derivative with respect to the parameters, times a residual.

        Args:
            gains: see `covariance`.
            by_gains: (1 + 3 + nj, size) derivatives of `gains` with respect to the parameters.
            weighted: (n,) residual times the covariance's inverse.
        """
        parts = (
            (self.specific_force, slice(0, 1)), (self.angular_velocity, slice(1, 4)), (self.joint_velocity, slice(4, None)),
        )  # fmt: skip
        return np.asarray(
            sum(np.outer(part @ weighted, gains[own] @ by_gains[own]) for part, own in parts), dtype=float
        )


def _centred(rows: FloatArray) -> FloatArray:
    """Subtract the mean of (n, ...) rows."""
    return np.asarray(rows - rows.mean(axis=0), dtype=float)
