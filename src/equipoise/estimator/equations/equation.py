"""Base of the equations: each reads its own samples from recordings and returns residuals in units of their noise.

Every equation lists by name the unknowns that it depends on. It returns its residual and the derivative by these, the rows
and the misfit of each motion; it names its share of the uncertainty and what lowers that. A new equation is a module in this
package and a line of the table in table.py.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples, StepSamples
from equipoise.estimator.measurements.tilt_invariant import Derivatives
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.estimator.unknown import MORE_TIME
from equipoise.recording.recording import Recording
from equipoise.recording.trials import RecordedTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_OUTLIER = 3.0  # times the median misfit
LEFT_OUT = 1e6
"""Noise of motions that are left out, over what their sensors explain."""

Sample = TypeVar("Sample")


@dataclass(frozen=True, eq=False)
class RunContext:
    """Facts of a run that equations need in order to read a recording.

    Attributes:
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].
        when: time since the middle of the run over the run's duration.
        heading: angle by which the robot was turned in the room since the run began, to its left [rad].
    """

    robot: RobotModel
    stance: Stance
    legs: LegChains
    gyro_bias: FloatArray
    when: float
    heading: float


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """One recording as the equations read it.

    Attributes:
        index: index of the recording in the run.
        trial: trial that it is of; None if that is not known.
        samples: samples that the equations read from it, each of its equation's kind.
        left_out: reason why an equation could not read it, or None.
        duration: duration of the recording, of a walk or crawl from its first to its last step [s].
    """

    index: int
    trial: RecordedTrial | None = None
    samples: tuple[object, ...] = ()
    left_out: str | None = None
    duration: float = 0.0

    def of(self, kind: type[Sample]) -> tuple[Sample, ...]:
        """Samples of a kind."""
        return tuple(one for one in self.samples if isinstance(one, kind))

    @property
    def lift(self) -> LiftSamples | None:
        """Samples of the lift; None if there is none, as in a walk."""
        return next((one for one in self.of(LiftSamples) if not isinstance(one, StepSamples)), None)


@dataclass(frozen=True, eq=False)
class MotionResidual:
    """How one motion fits the estimate.

    Attributes:
        motion: index of the recording.
        normalized_residual: root mean square of the residual over what its noise explains.
        used: False for an outlier that was left out.
    """

    motion: int
    normalized_residual: float
    used: bool


class Equation(ABC, Generic[Sample]):
    """Rows of one equation.

    Attributes:
        depends_on: names of the unknowns that the rows depend on.
        name: name of its motions in documents.
        kind: type of the samples of a motion.
        source: name of its noise among the sources of uncertainty.
        remedy: what lowers that.
        samples: samples of all motions, in order.
        columns: indices of the unknowns in the vector of unknowns: the Jacobian's columns.
        open: names of these that are not held, beside the inertial ones.
        motions: index of each recording, and its rows.
    """

    depends_on: ClassVar[tuple[str, ...]]
    name: ClassVar[str]
    kind: type[Sample]
    source: ClassVar[str]
    remedy: ClassVar[str] = MORE_TIME

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[Sample]:
        """Samples of a recording; empty if it is of another kind.

        Raises:
            RecordingError: it is of this kind, and cannot be read.
        """
        return ()

    @classmethod
    def of(cls, unknowns: Unknowns, motions: Sequence[MotionSamples]) -> Equation[Sample] | None:
        """Rows of all samples of a run; None if there are none."""
        samples = [(motion.index, one) for motion in motions for one in motion.of(cls.kind)]
        return cls(unknowns, samples) if samples else None

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, Sample]]) -> None:
        self.samples = [sample for _, sample in samples]
        edges = itertools.pairwise(itertools.accumulate(map(self._rows_in, self.samples), initial=0))
        self.motions = [(motion, slice(*rows)) for (motion, _), rows in zip(samples, edges, strict=True)]
        self._lay_out(unknowns)

    @abstractmethod
    def _rows_in(self, sample: Sample) -> int:
        """Number of the rows of a sample."""

    def _lay_out(self, unknowns: Unknowns) -> None:
        self.unknowns, self.columns = unknowns, unknowns.columns(*self.depends_on)
        self.open = [name for name in self.depends_on if name not in INERTIAL and unknowns.estimates(name)]

    def laid_out(self, unknowns: Unknowns, x: FloatArray) -> Equation[Sample]:
        """The same rows at noise levels as they are, by another vector of unknowns of the same robot.

        Args:
            x: such a vector, at which noise is prepared.
        """
        same = copy(self)
        same._lay_out(unknowns)
        same.prepare(x)
        return same

    def _by_unknowns(self, x: FloatArray, by: Derivatives) -> FloatArray:
        """(..., len(columns)) derivatives by the unknowns, of those by their values and by "inertial"."""
        unknowns = self.unknowns
        parts = [by[name] * unknowns.scale[unknowns[name]] for name in self.open]
        if "inertial" in by:
            parts.insert(0, by["inertial"] @ unknowns.inertial_jacobian(x)[:, unknowns.columns(*INERTIAL)])
        return np.concatenate(parts, axis=-1)

    def prepare(self, x: FloatArray) -> None:
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
            information, gradient = np.zeros((self.unknowns.size, self.unknowns.size)), np.zeros(self.unknowns.size)
            information[places] = jacobian[rows].T @ jacobian[rows]
            gradient[self.columns] = jacobian[rows].T @ residual[rows]
            yield motion, information, gradient

    def at_residual_noise(self, x: FloatArray, covariance: FloatArray | None = None) -> Equation[Sample]:
        """The same rows at the noise that their residuals at x show, where that is less; these where noise is known.

        Args:
            covariance: (size, size) covariance of the estimate x, whose degrees of freedom are subtracted from the
                residuals' mean square; None: the median of the misfits is used.
        """
        return self

    def expect_residual(self, normalized_residual: float) -> None:
        """Take the noise to be so many times what sensors explain; nothing to do where noise is known."""

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise of what does not fit; nothing to do where noise is known."""

    def normalized_residuals(self, x: FloatArray) -> tuple[MotionResidual, ...]:
        """How each motion fits; empty where that is not told motion by motion."""
        return ()


class MotionEquation(Equation[Sample]):
    """Rows of motions that each have a noise level of their own.

    Attributes:
        shared: number of motions that say what one says of what sensors' noise does not explain.
        scale: (motions,) noise of each over what its sensors explain.
    """

    shared = 1.0

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, Sample]]) -> None:
        super().__init__(unknowns, samples)
        self.scale = np.ones(len(samples))

    @abstractmethod
    def normalized_residual(self, x: FloatArray) -> FloatArray:
        """(motions,) misfit of each, over what its sensors' noise explains."""

    def expect_residual(self, normalized_residual: float) -> None:
        self.scale = np.full(len(self.motions), normalized_residual)

    def renew_noise(self, x: FloatArray) -> None:
        normalized_residual = self.normalized_residual(x)
        median = float(np.median(normalized_residual))
        residual_or_more = np.maximum(normalized_residual, max(0.7 * median, 1.0))
        raised = np.sqrt(1 + self.shared * (residual_or_more**2 - 1))
        self.scale = np.where(normalized_residual > _OUTLIER * max(median, 1.0), LEFT_OUT, raised)

    def normalized_residuals(self, x: FloatArray) -> tuple[MotionResidual, ...]:
        return tuple(
            MotionResidual(index, float(normalized_residual), bool(scale < LEFT_OUT))
            for (index, _), normalized_residual, scale in zip(
                self.motions, self.normalized_residual(x), self.scale, strict=True
            )
        )


def whitening_of(covariance: FloatArray) -> FloatArray:
    """(..., n, n) matrices that turn residuals with these covariances into white ones."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=float)
