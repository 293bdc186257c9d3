"""The posterior's residuals in units of their own noise: one block per kind of evidence.

Every block says by name which unknowns its rows depend on, and gives its residual and the derivative by these; which rows
belong to which motion; and how well each motion fits.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.precise.measurements.evidence import RunEvidence
from equipoise.precise.measurements.leg_motion import LegChains
from equipoise.precise.measurements.leg_swing import LegSwing
from equipoise.precise.measurements.lift_samples import LiftSamples
from equipoise.precise.measurements.planted_moves import PlantedMove, PlantedRows
from equipoise.precise.measurements.tilt_equation import Derivatives, TiltEquation, integral
from equipoise.precise.measurements.torque_balance import TorqueSamples, sawtooth, torque_rows
from equipoise.precise.parameters import INERTIAL, Unknowns

_OUTLIER = 3.0  # times the median misfit
_FREE_CONSTANT = 0.25  # [rad2/s2] variance of a trial's unknown constant: as good as infinite
# Lifts that say what one says of what noise does not explain: a model's errors are the same in several of them.
_SHARED = 2.5
_MANY = 1e6  # weight's inverse of what is left out
# What sensor noise does not explain of an ideal robot's residual: contacts that give [rad/s], and a bias of the accelerometer
# that is not the same in all lifts [m/s2].
_TILT_FLOOR, _BIAS_FLOOR = 3e-4, 2e-3
# Feet at rest on an A1: how far they seem to move [m], and to rise [m]; and how the gyroscope's attitude drifts over a move
# and the accelerometer's wanders from rest to rest [rad]. Twice what an ideal robot shows: each rest ends one move and begins
# the next, and springs and feet that sag are the same in all.
_FOOT_NOISE, _HEIGHT_NOISE, _TURN_NOISE, _UP_NOISE = 2.4e-4, 1.6e-4, 6e-4, 8e-4
# By which a line between two feet of a robot that walks may seem to lean, from step to step: the mean of what the
# accelerometer feels is not gravity alone, and floors are uneven. Three steps in a row say what one says.
_LEAN_NOISE = 0.02  # [rad]
_QUIETEST = 0.3  # of these, what robots with ordinary sensors show
_SAYING = 15  # rows of a move's twenty that say something: means are taken off
_FEWEST_FREEDOMS = 20.0  # from which on the noise that residuals show is known to a fifth
_RESTLESS = (
    1.5  # times what residuals show is what feet may do: they show less by chance, and what they do lasts over moves
)
# Torque of an A1's joint that the friction model leaves unexplained, over its Coulomb friction; at rest and in motion.
_FRICTION_UNKNOWN = 1.0
_FRICTION_AT_FIRST = 0.5  # [Nm] on an A1
_TORQUE_FLOOR = 0.01  # of an A1's torque scale over 38: [Nm]
_SAMPLES_AT_ONCE = 1024
_TORQUE_CORRELATION = 30.0  # samples of a motion that say what one says: friction's errors last


@dataclass(frozen=True, eq=False)
class Misfit:
    """How one motion fits the estimate.

    Attributes:
        motion: index of the recording.
        normalised_residual: root mean square of the residual over what its noise explains.
        used: False for an outlier that was left out.
    """

    motion: int
    normalised_residual: float
    used: bool


class ResidualBlock(ABC):
    """Rows of one equation.

    Attributes:
        depends_on: names of the unknowns that the rows depend on.
        columns: indices of these in the vector of unknowns: the Jacobian's columns.
        open: names of these that are not held, beside the inertial ones.
        motions: index of each recording, and its rows.
    """

    depends_on: tuple[str, ...]

    def __init__(self, unknowns: Unknowns, motions: list[tuple[int, slice]]) -> None:
        self.motions = motions
        self._lay_out(unknowns)

    def _lay_out(self, unknowns: Unknowns) -> None:
        self.unknowns, self.columns = unknowns, unknowns.columns(*self.depends_on)
        self.open = [name for name in self.depends_on if name not in INERTIAL and unknowns.estimates(name)]

    def laid_out(self, unknowns: Unknowns, x: FloatArray) -> ResidualBlock:
        """The same rows at noise levels as they are, by another vector of unknowns of the same robot.

        Args:
            x: such a vector, at which noise is prepared.
        """
        block = copy(self)
        block._lay_out(unknowns)
        block.prepare(x)
        return block

    def _by_unknowns(self, x: FloatArray, by: Derivatives) -> FloatArray:
        """(..., len(columns)) derivatives by the unknowns, of those by their values and by "inertial"."""
        unknowns = self.unknowns
        parts = [by[name] * unknowns.scale[unknowns[name]] for name in self.open]
        if "inertial" in by:
            parts.insert(0, by["inertial"] @ unknowns.inertial_jacobian(x)[:, unknowns.columns(*INERTIAL)])
        return np.concatenate(parts, axis=-1)

    def prepare(self, x: FloatArray) -> None:  # noqa: B027
        """Noise levels of a round; nothing to do where they do not depend on x."""

    @abstractmethod
    def residual(self, x: FloatArray) -> FloatArray:
        """(rows,) residual, in units of its noise."""

    @abstractmethod
    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The residual, and its (rows, len(columns)) derivative."""

    def by_motion(self, x: FloatArray) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Of each motion: its index, its (size, size) information and its (size,) gradient."""
        residual, jacobian = self.linearise(x)
        places = np.ix_(self.columns, self.columns)
        for motion, rows in self.motions:
            alive()
            information, gradient = np.zeros((self.unknowns.size, self.unknowns.size)), np.zeros(self.unknowns.size)
            information[places] = jacobian[rows].T @ jacobian[rows]
            gradient[self.columns] = jacobian[rows].T @ residual[rows]
            yield motion, information, gradient

    def expect_misfit(self, misfit: float) -> None:  # noqa: B027
        """Take the noise to be so many times what sensors explain; nothing to do where noise is known."""

    def renew_noise(self, x: FloatArray) -> None:  # noqa: B027
        """Raise the noise of what does not fit; nothing to do where noise is known."""

    def misfits(self, x: FloatArray) -> tuple[Misfit, ...]:
        """How each motion fits; empty where that is not told motion by motion."""
        return ()


class _MotionBlock(ResidualBlock):
    """Rows of motions that each have a noise level of their own.

    Attributes:
        shared: number of motions that say what one says of what sensors' noise does not explain.
        scale: (motions,) noise of each over what its sensors explain.
    """

    shared = 1.0

    def __init__(self, unknowns: Unknowns, motions: list[tuple[int, slice]]) -> None:
        super().__init__(unknowns, motions)
        self.scale = np.ones(len(motions))

    @abstractmethod
    def normalised_residual(self, x: FloatArray) -> FloatArray:
        """(motions,) misfit of each, over what its sensors' noise explains."""

    def expect_misfit(self, misfit: float) -> None:
        self.scale = np.full(len(self.motions), misfit)

    def renew_noise(self, x: FloatArray) -> None:
        misfit = self.normalised_residual(x)
        median = float(np.median(misfit))
        misfit_or_more = np.maximum(misfit, max(0.7 * median, 1.0))
        raised = np.sqrt(1 + self.shared * (misfit_or_more**2 - 1))
        self.scale = np.where(misfit > _OUTLIER * max(median, 1.0), _MANY, raised)

    def misfits(self, x: FloatArray) -> tuple[Misfit, ...]:
        return tuple(
            Misfit(index, float(misfit), bool(scale < _MANY))
            for (index, _), misfit, scale in zip(self.motions, self.normalised_residual(x), self.scale, strict=True)
        )


class TiltBlock(_MotionBlock):
    """Rows of the tilt equation of all lifts and steps, whitened."""

    depends_on = (*INERTIAL, *TiltEquation.DEPENDS_ON)
    shared = _SHARED

    def __init__(self, unknowns: Unknowns, legs: LegChains, lifts: Sequence[tuple[int, LiftSamples]]) -> None:
        self.lifts = [lift for _, lift in lifts]
        self.equation = TiltEquation(unknowns.robot, legs, self.lifts)
        motions = [(index, rows) for (index, _), rows in zip(lifts, self.equation.trials, strict=True)]
        super().__init__(unknowns, motions)
        self._sensors = [TiltNoise.of(lift) for lift in self.lifts]
        self._noise = self._sensors
        self._unexplained = np.zeros(motions[-1][1].stop)

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> TiltBlock | None:
        """All lifts of a run and all steps; None if there is none."""
        lifts = [(motion.index, lift) for motion in evidence.motions for lift in motion.on_two_feet]
        return cls(unknowns, legs, lifts) if lifts else None

    def prepare(self, x: FloatArray) -> None:
        """Noise of each trial: that of its readings, and what they do not explain."""
        levers = self.equation.levers(self.unknowns.values(x), self.unknowns.inertial(x))
        self._noise = [
            sensors.raised(scale, gains)
            for scale, sensors, gains in zip(self.scale, self._sensors, (levers[1:] / levers[0]).T, strict=True)
        ]

    def fit(self, x: FloatArray) -> None:
        """Take the lifts to obey the equation at x: predicted ones are near enough for derivatives, and for no more."""
        y, levers = self.equation.evaluate(self.unknowns.values(x), self.unknowns.inertial(x))
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
        """(n,) residual of each trial [rad/s], and its (1 + 3 + nj,) gains."""
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
        """Of each lift's residual: (n, len(columns)) derivative [rad/s], and (n, n) covariance of the noise [rad2/s2]."""
        _, jacobian = self.linearise(x)
        levers = self.equation.levers(self.unknowns.values(x), self.unknowns.inertial(x))
        for (_, rows), noise, gains in zip(self.motions, self._noise, (levers[1:] / levers[0]).T, strict=True):
            derivative = np.linalg.solve(noise.whitening(gains), jacobian[rows])
            yield np.asarray(derivative, dtype=float), noise.covariance(gains)

    def normalised_residual(self, x: FloatArray) -> FloatArray:
        return np.array(
            [
                np.sqrt(np.sum((sensors.whitening(gains) @ residual) ** 2) / sensors.explains(gains))
                for sensors, (residual, gains) in zip(self._sensors, self._residuals(x), strict=True)
            ]
        )


@dataclass(frozen=True, eq=False)
class TiltNoise:
    """Noise of a lift's residual, from that of its sensors.

    A reading that is off shifts the residual by as much as it is multiplied by, which hangs on the unknowns. So does the
    noise: with fixed weights a reading's noise would draw what it is multiplied by towards zero, legs that move towards no
    mass. That the covariance changes with the unknowns undoes this (total least squares; Fuller, Measurement Error Models,
    chapter 1), without the determinant that a likelihood has: what was read is not drawn from a population.

    Attributes:
        specific_force: (n, n) covariance of the specific force's integral, along any axis [m2/s2].
        angular_velocity: (n, n) covariance of any axis of the gyroscope [rad2/s2].
        joint_velocity: (n, n) covariance of any joint's velocity [rad2/s2].
        beside: (n, n) covariance of what is not a reading's [rad2/s2].
    """

    specific_force: FloatArray
    angular_velocity: FloatArray
    joint_velocity: FloatArray
    beside: FloatArray

    @classmethod
    def of(cls, lift: LiftSamples) -> TiltNoise:
        """Of a lift as its sensors are at rest."""
        alive()
        count = len(lift.joint_position)
        integrate = integral(count, lift.step)
        ramp = _BIAS_FLOOR * lift.step * np.arange(count)
        force = integrate @ lift.acceleration_noise @ integrate.T + np.outer(ramp, ramp)
        return cls(force, lift.angular_velocity_noise, lift.velocity_noise, _TILT_FLOOR**2 * np.eye(count))

    def raised(self, factor: float, gains: FloatArray) -> TiltNoise:
        """The noise of residuals that are so many times larger than readings explain.

        Args:
            gains: as of `covariance`.
        """
        return replace(self, beside=self.beside + (factor**2 - 1) * self.covariance(gains))

    def covariance(self, gains: FloatArray) -> FloatArray:
        """(n, n) covariance [rad2/s2].

        Args:
            gains: (1 + 3 + nj,) what the specific force [1/m], each axis of the gyroscope and each joint's velocity are
                multiplied by.
        """
        force, turning, moving = gains[0] ** 2, gains[1:4] @ gains[1:4], gains[4:] @ gains[4:]
        return (
            force * self.specific_force + turning * self.angular_velocity + moving * self.joint_velocity + self.beside
        )

    def explains(self, gains: FloatArray) -> float:
        """Whitened squares of a residual that readings alone make: smoothed, they have fewer freedoms than samples."""
        white = self.whitening(gains)
        read = self.covariance(gains) - self.beside
        return float(np.einsum("ij,jk,ik->", white, read, white))

    def whitening(self, gains: FloatArray) -> FloatArray:
        """(n, n) matrix that turns residuals into white ones, but for a constant."""
        return _whitening(self.covariance(gains) + _FREE_CONSTANT)

    def growth(self, gains: FloatArray, by_gains: FloatArray, weighted: FloatArray) -> FloatArray:
        """(n, size) half the covariance's derivative by the unknowns, times a residual.

        Args:
            gains: as of `covariance`.
            by_gains: (1 + 3 + nj, size) derivatives of these.
            weighted: (n,) residual times the covariance's inverse.
        """
        parts = (
            (self.specific_force, slice(0, 1)), (self.angular_velocity, slice(1, 4)), (self.joint_velocity, slice(4, None)),
        )  # fmt: skip
        return np.asarray(
            sum(np.outer(part @ weighted, gains[own] @ by_gains[own]) for part, own in parts), dtype=float
        )


def _centred(rows: FloatArray) -> FloatArray:
    """(n, ...) rows less their mean."""
    return np.asarray(rows - rows.mean(axis=0), dtype=float)


def _whitening(covariance: FloatArray) -> FloatArray:
    """(..., n, n) matrices that turn residuals with these covariances into white ones."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=float)


class LevelBlock(_MotionBlock):
    """The floor that a robot walks on is level, but for its slope: the line between two standing feet rises to neither."""

    depends_on = TiltEquation.DEPENDS_ON

    def __init__(self, unknowns: Unknowns, legs: LegChains, steps: Sequence[tuple[int, LiftSamples]]) -> None:
        super().__init__(unknowns, [(index, slice(k, k + 1)) for k, (index, _) in enumerate(steps)])
        self.equation = TiltEquation(unknowns.robot, legs, [step for _, step in steps])

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> LevelBlock | None:
        """All steps of a run; None if there is none."""
        steps = [(motion.index, step) for motion in evidence.motions for step in motion.steps]
        return cls(unknowns, legs, steps) if steps else None

    def residual(self, x: FloatArray) -> FloatArray:
        lean, _ = self.equation.lean(self.unknowns.values(x))
        return lean / (_LEAN_NOISE * self.scale)

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        lean, by = self.equation.lean(self.unknowns.values(x), self.open)
        noise = _LEAN_NOISE * self.scale
        return lean / noise, self._by_unknowns(x, by) / noise[:, None]

    def normalised_residual(self, x: FloatArray) -> FloatArray:
        return self.scale * np.abs(self.residual(x))


class PlantedBlock(_MotionBlock):
    """Rows of planted moves: feet that stay, footholds that keep their heights. Whitened."""

    depends_on = PlantedRows.DEPENDS_ON
    _quiet = 1.0  # factor on the noise that is allowed for, which quiet feet have shown

    def __init__(
        self, unknowns: Unknowns, legs: LegChains, rotation: FloatArray, moves: Sequence[tuple[int, PlantedMove]]
    ) -> None:
        motions = [(index, slice(20 * k, 20 * k + 20)) for k, (index, _) in enumerate(moves)]
        super().__init__(unknowns, motions)
        self.rows = PlantedRows(legs, rotation, unknowns.stance, [move for _, move in moves])
        feet, size = self.rows.footholds, unknowns.stance.scale.length
        turns = np.asarray([np.cross(axis, feet).T.ravel() for axis in np.eye(3)], dtype=float)
        moved = (size * _FOOT_NOISE) ** 2 * np.eye(12) + _TURN_NOISE**2 * turns.T @ turns
        leaning = feet[:, :2] @ feet[:, :2].T
        heights = (size * _HEIGHT_NOISE) ** 2 * np.eye(4) + _UP_NOISE**2 * leaning
        whitening = np.zeros((20, 20))
        whitening[:12, :12] = _whitening(moved)
        whitening[12:16, 12:16] = whitening[16:, 16:] = _whitening(heights)
        self._whitening = whitening

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> PlantedBlock | None:
        """All planted moves of a run; None if there is none."""
        moves = [(motion.index, motion.move) for motion in evidence.motions if motion.move is not None]
        return cls(unknowns, legs, np.array(unknowns.robot.imu_in_base.rotation), moves) if moves else None

    def residual(self, x: FloatArray) -> FloatArray:
        return self._whitened(self.rows.residuals(self.unknowns.values(x)).reshape(-1, 20, 1)).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows, by = self.rows.linearise(self.unknowns.values(x), self.open)
        columns = self._by_unknowns(x, by).reshape(-1, 20, len(self.columns))
        jacobian = self._whitened(columns).reshape(-1, len(self.columns))
        return self._whitened(rows.reshape(-1, 20, 1)).ravel(), jacobian

    def at_shown_noise(self, x: FloatArray) -> PlantedBlock:
        """The same rows at the noise that they show at x, where that is less than what is allowed for."""
        shown = copy(self)
        allowed = self.scale / self._quiet
        shown._quiet = max(_QUIETEST, min(1.0, float(np.median(self.normalised_residual(x)))))
        shown.scale = allowed * shown._quiet
        return shown

    def at_found_noise(self, x: FloatArray, covariance: FloatArray) -> PlantedBlock:
        """The same rows at the noise that residuals at x show, the unknowns' freedoms taken off, where that is less.

        Args:
            covariance: (size, size) covariance of the estimate x.
        """
        residual, jacobian = self.linearise(x)
        taken = float(np.einsum("ij,jk,ik->", jacobian, covariance[np.ix_(self.columns, self.columns)], jacobian))
        freedoms = _SAYING * float(np.sum(self.scale < _MANY)) - taken
        if freedoms < _FEWEST_FREEDOMS:
            return self
        shown = _RESTLESS * np.sqrt(residual @ residual / freedoms)
        found = copy(self)
        found._quiet = max(_QUIETEST, min(1.0, float(shown)))
        found.scale = self.scale * found._quiet
        return found

    def _whitened(self, rows: FloatArray) -> FloatArray:
        """(moves, 20, k) of such."""
        return np.asarray(self._whitening @ rows / self.scale[:, None, None], dtype=float)

    def normalised_residual(self, x: FloatArray) -> FloatArray:
        residual = self.residual(x).reshape(-1, 20)
        return self.scale * np.sqrt((residual**2).sum(axis=1) / _SAYING)


class TorqueBlock(ResidualBlock):
    """Rows of the torque balance, at the last round's values of all that it is not linear in. Whitened.

    Attributes:
        normalised_residual: root mean square of all rows' residuals over what their noise explains.
    """

    actuators = ("torque_gain_common", "torque_gain", "coulomb", "viscous", "armature")
    gains = ("torque_gain_common", "torque_gain")
    depends_on = (*INERTIAL, *actuators)

    def __init__(self, unknowns: Unknowns, torques: Sequence[tuple[int, TorqueSamples]]) -> None:
        super().__init__(unknowns, [])
        self.samples = TorqueSamples.joined([sample for _, sample in torques])
        counts = [len(sample.joint_position) for _, sample in torques]
        self._correlation = np.repeat([1.0 if count == 1 else _TORQUE_CORRELATION for count in counts], counts)
        self._owner = np.repeat([index for index, _ in torques], counts)
        self.normalised_residual = 1.0
        self._matrix, self._target = np.zeros((0, 0)), np.zeros(0)
        self._row_correlation, self._rows = np.zeros(0), 0

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> TorqueBlock | None:
        """All torques of a run; None if there are none."""
        torques = [(motion.index, sample) for motion in evidence.motions for sample in motion.torques]
        return cls(unknowns, torques) if torques else None

    def prepare(self, x: FloatArray) -> None:
        """The rows as a linear system in the inertial parameters and what the actuators do, whitened.

        Many rows of one motion become as few as there are columns, by orthogonal turns, which change no square and no
        product of what is made of them: neither time nor memory of a round grows with how long a motion lasted.
        """
        systems: list[FloatArray] = []
        owners: list[FloatArray] = []
        self._rows = 0
        for first in range(0, len(self._owner), _SAMPLES_AT_ONCE):
            part = slice(first, first + _SAMPLES_AT_ONCE)
            whitened = self._whitened(x, part)
            self._rows += whitened.shape[0] * whitened.shape[1]
            of_part = np.column_stack([self._owner[part], self._correlation[part]])
            for alike in _alike(of_part):
                systems.append(_few_rows(whitened[alike].reshape(-1, whitened.shape[2])))
                owners.append(np.tile(of_part[alike.start], (len(systems[-1]), 1)))
        whole, owner = np.concatenate(systems), np.concatenate(owners)
        self._matrix, self._target = whole[:, :-1], whole[:, -1]
        self._row_correlation = owner[:, 1]
        self.motions = [(int(owner[rows.start, 0]), rows) for rows in _alike(owner[:, :1])]

    def _whitened(self, x: FloatArray, part: slice) -> FloatArray:
        """(n, r, columns + 1) rows of some of the samples and, in the last column, their targets."""
        unknowns, samples = self.unknowns, self.samples.part(part)
        rows = torque_rows(unknowns.robot, samples, unknowns.values(x))
        scale = unknowns.torque_scale
        # Before anything is known of friction it is taken to be large: else what it does is taken for the motors' gains.
        found = float(np.abs(unknowns.value(x, "coulomb")[0]))
        coulomb = max(found, 0.02 * scale) if found else _FRICTION_AT_FIRST * scale
        direction = np.abs(rows.friction_direction)
        unknown = coulomb**2 * ((1 - direction) ** 2 + _FRICTION_UNKNOWN**2) + (_TORQUE_FLOOR * scale) ** 2
        noise: FloatArray = np.einsum("nrj,nj,nsj->nrs", rows.torque, unknown, rows.torque)
        stiffness, _ = unknowns.robot.gains(unknowns.stance.hip_height)
        noise += sawtooth(rows, samples.period, stiffness)[:, None, None] ** 2 * np.eye(noise.shape[1])
        # The accelerometer's noise acts through the mass: a hundredth of a metre per second squared on all of it.
        weight = (0.01 * unknowns.robot.mass) ** 2 * np.array([1, 1, 1, 0.01, 0.01, 0.01])
        noise += np.einsum("nrk,k,nsk->nrs", rows.acceleration_rows, weight, rows.acceleration_rows)
        level = self.normalised_residual * np.sqrt(self._correlation[part])
        whitening = _whitening(noise) / level[:, None, None]
        terms = {
            "torque_gain_common": -_summed(rows.torque, rows.reported),
            "torque_gain": -rows.torque * rows.reported[:, None],
            "coulomb": _summed(rows.torque, rows.friction_direction),
            "viscous": _summed(rows.torque, rows.joint_velocity),
            "armature": _summed(rows.torque, rows.joint_acceleration),
        }
        target = np.einsum("nrj,nj->nr", rows.torque, rows.reported) - rows.links @ unknowns.model_links
        links = rows.links @ unknowns.of_links
        acting = [terms[name] for name in self.actuators if unknowns.estimates(name)]
        return whitening @ np.concatenate([rows.base, links, *acting, target[..., None]], axis=2)

    def _linear(self, x: FloatArray) -> FloatArray:
        return np.concatenate([self.unknowns.inertial(x)[:10], (x * self.unknowns.scale)[self.columns[10:]]])

    def residual(self, x: FloatArray) -> FloatArray:
        # Over the mean gain: the balance is homogeneous, and lighter robots with weaker motors would fit any noise better.
        return (self._matrix @ self._linear(x) - self._target) / self._mean_gain(x)

    def _mean_gain(self, x: FloatArray) -> float:
        return 1 + float(sum(self.unknowns.value(x, name).mean() for name in self.gains))

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        unknowns, gain, residual = self.unknowns, self._mean_gain(x), self.residual(x)
        jacobian = self._matrix * unknowns.scale[self.columns]
        jacobian[:, :10] = self._matrix[:, :10] @ unknowns.inertial_jacobian(x)[:10, :10]
        for name in self.gains:
            own = np.isin(self.columns, unknowns.columns(name))
            jacobian[:, own] -= np.outer(residual, unknowns.scale[self.columns[own]] / max(1, own.sum()))
        return residual, jacobian / gain

    def renew_noise(self, x: FloatArray) -> None:
        residual = self.residual(x) * self.normalised_residual * np.sqrt(self._row_correlation)
        self.normalised_residual = max(1.0, float(np.sqrt(np.sum(residual**2) / self._rows)))


class LegSwingBlock(ResidualBlock):
    """Rows of legs that swung in the air while the base lay. Whitened as they come."""

    depends_on = (*INERTIAL, "torque_gain_common", "torque_gain")

    def __init__(self, unknowns: Unknowns, swings: Sequence[tuple[int, LegSwing]]) -> None:
        rows = [0, *np.cumsum([len(swing.target) for _, swing in swings]).tolist()]
        super().__init__(
            unknowns,
            [(index, slice(*edges)) for (index, _), edges in zip(swings, itertools.pairwise(rows), strict=True)],
        )
        self._rows = np.concatenate([swing.rows for _, swing in swings])
        self._target = np.concatenate([swing.target for _, swing in swings])

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> LegSwingBlock | None:
        """All such of a run; None if there is none."""
        swings = [(motion.index, motion.leg_swing) for motion in evidence.motions if motion.leg_swing is not None]
        return cls(unknowns, swings) if swings else None

    def residual(self, x: FloatArray) -> FloatArray:
        values = self.unknowns.values(x)
        gains = values["torque_gain_common"] + values["torque_gain"]
        return self._rows @ np.concatenate([self.unknowns.inertial(x)[10:], gains]) - self._target

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        of_links, of_gains = np.split(self._rows, [len(self.unknowns.model_links)], axis=1)
        by = {
            "inertial": np.hstack([np.zeros((len(of_links), 10)), of_links]),
            "torque_gain_common": of_gains.sum(axis=1, keepdims=True),
            "torque_gain": of_gains,
        }
        return self.residual(x), self._by_unknowns(x, by)


def _alike(rows: FloatArray) -> list[slice]:
    """Runs of (n, k) rows that are the same."""
    edges = np.flatnonzero(np.diff(rows, axis=0).any(axis=1)) + 1
    return [slice(begin, end) for begin, end in itertools.pairwise([0, *edges.tolist(), len(rows)])]


def _few_rows(system: FloatArray) -> FloatArray:
    """(m, c) rows with the squares and products of (n, c) rows, m no more than c."""
    return np.asarray(np.linalg.qr(system, mode="r"), dtype=float) if len(system) > system.shape[1] else system


def _summed(torque: FloatArray, signal: FloatArray) -> FloatArray:
    """(n, r, 1) columns of what all joints have in common, of (n, r, nj) rows and an (n, nj) signal of each joint."""
    return np.einsum("nrj,nj->nr", torque, signal)[..., None]


BLOCKS: tuple[Callable[[Unknowns, LegChains, RunEvidence], ResidualBlock | None], ...] = (
    TiltBlock.of,
    LevelBlock.of,
    PlantedBlock.of,
    TorqueBlock.of,
    LegSwingBlock.of,
)
"""Makers of the blocks of all evidence; a maker gives None where there is none of its kind."""
