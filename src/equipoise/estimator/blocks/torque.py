"""Joint torques: the balance of the planted robot."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import ResidualBlock, whitening_of
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.torque_balance import TorqueSamples, sawtooth, torque_rows
from equipoise.estimator.parameters import INERTIAL, Unknowns

# Torque of an A1's joint that the friction model leaves unexplained, over its Coulomb friction; at rest and in motion.
_FRICTION_UNKNOWN = 1.0
_FRICTION_AT_FIRST = 0.5  # [Nm] on an A1
_TORQUE_FLOOR = 0.01  # of an A1's torque scale over 38: [Nm]
_SAMPLES_AT_ONCE = 1024
_TORQUE_CORRELATION = 10.0  # samples of a motion that say what one says: friction's errors last for a second


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
        whitening = whitening_of(noise) / level[:, None, None]
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
