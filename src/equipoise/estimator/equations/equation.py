"""Base classes of the equations, which read samples from recordings and return residuals in units of their noise.

An equation lists the parameters that it depends on. It returns its residual, the derivative by these parameters, and the
rows and normalized residual of each motion. It also names its contribution to the uncertainty and a remedy.
A new equation is a module in this package and an entry in table.py.
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
from equipoise.estimator.unknowns import MORE_TIME
from equipoise.recording.recording import Recording
from equipoise.recording.trials import RecordedTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_OUTLIER = 3.0  # times the median normalized residual
LEFT_OUT = 1e6
"""Noise of excluded motions, divided by their sensor noise."""

Sample = TypeVar("Sample")


@dataclass(frozen=True, eq=False)
class RunContext:
    """Properties of a run that equations need to read a recording.

    Attributes:
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].
        when: time since the middle of the run, divided by the run's duration.
        heading: rotation of the robot to its left since the start of the run [rad].
    """

    robot: RobotModel
    stance: Stance
    legs: LegChains
    gyro_bias: FloatArray
    when: float
    heading: float


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Samples of all equations from one recording.

    Attributes:
        index: index of the recording in the run.
        trial: trial of the recording, or None.
        samples: samples of the equations, each of its equation's type.
        left_out: reason why an equation could not read the recording, or None.
        duration: duration of the recording; of a walk or crawl, from the first to the last step [s].
    """

    index: int
    trial: RecordedTrial | None = None
    samples: tuple[object, ...] = ()
    left_out: str | None = None
    duration: float = 0.0

    def of(self, kind: type[Sample]) -> tuple[Sample, ...]:
        """Return the samples of a type."""
        return tuple(sample for sample in self.samples if isinstance(sample, kind))

    @property
    def lift(self) -> LiftSamples | None:
        """Samples of the lift; None if there is none, as in a walk."""
        return next((lift for lift in self.of(LiftSamples) if not isinstance(lift, StepSamples)), None)


@dataclass(frozen=True, eq=False)
class MotionResidual:
    """Normalized residual of one motion.

    Attributes:
        motion: index of the recording.
        normalized_residual: root mean square of the residual, divided by its expected noise.
        used: False for an excluded outlier.
    """

    motion: int
    normalized_residual: float
    used: bool


class Equation(ABC, Generic[Sample]):
    """Rows of one equation.

    Attributes:
        depends_on: names of the parameters that the rows depend on.
        name: name of its motions in documents.
        kind: type of the samples of a motion.
        source: name of its noise among the sources of uncertainty.
        remedy: measure that reduces this noise.
        samples: samples of all motions, in order.
        columns: indices of these parameters in the parameter vector: the Jacobian's columns.
        open: names of these parameters that are estimated, without the inertial ones.
        motions: index of each recording, and its rows.
    """

    depends_on: ClassVar[tuple[str, ...]]
    name: ClassVar[str]
    kind: type[Sample]
    source: ClassVar[str]
    remedy: ClassVar[str] = MORE_TIME

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[Sample]:
        """Return the samples of a recording; empty if the equation does not use this kind of recording.

        Raises:
            RecordingError: it is of this kind and cannot be read.
        """
        return ()

    @classmethod
    def of(cls, unknowns: Unknowns, motions: Sequence[MotionSamples]) -> Equation[Sample] | None:
        """Return the rows of all samples of a run; None if there are none."""
        samples = [(motion.index, sample) for motion in motions for sample in motion.of(cls.kind)]
        return cls(unknowns, samples) if samples else None

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, Sample]]) -> None:
        self.samples = [sample for _, sample in samples]
        edges = itertools.pairwise(itertools.accumulate(map(self._rows_in, self.samples), initial=0))
        self.motions = [(motion, slice(*rows)) for (motion, _), rows in zip(samples, edges, strict=True)]
        self._lay_out(unknowns)

    @abstractmethod
    def _rows_in(self, sample: Sample) -> int:
        """Return the number of rows of a sample."""

    def _lay_out(self, unknowns: Unknowns) -> None:
        self.unknowns, self.columns = unknowns, unknowns.columns(*self.depends_on)
        self.open = [name for name in self.depends_on if name not in INERTIAL and unknowns.estimates(name)]

    def laid_out(self, unknowns: Unknowns, x: FloatArray) -> Equation[Sample]:
        """Return these rows, with unchanged noise levels, for another parameter vector of the same robot.

        Args:
            x: value of the new vector, at which the noise is prepared.
        """
        same = copy(self)
        same._lay_out(unknowns)
        same.prepare(x)
        return same

    def _by_unknowns(self, x: FloatArray, by: Derivatives) -> FloatArray:
        """Return (..., len(columns)) derivatives by the parameter vector, from those by values and by "inertial"."""
        unknowns = self.unknowns
        parts = [by[name] * unknowns.scale[unknowns[name]] for name in self.open]
        if "inertial" in by:
            parts.insert(0, by["inertial"] @ unknowns.inertial_jacobian(x)[:, unknowns.columns(*INERTIAL)])
        return np.concatenate(parts, axis=-1)

    def prepare(self, x: FloatArray) -> None:
        """Compute the noise levels of an iteration; by default they do not depend on x."""

    @abstractmethod
    def residual(self, x: FloatArray) -> FloatArray:
        """Return the (rows,) residual, in units of its noise."""

    @abstractmethod
    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residual and its (rows, len(columns)) derivative."""

    def by_motion(self, x: FloatArray) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield the index, (size, size) information and (size,) gradient of each motion."""
        residual, jacobian = self.linearise(x)
        places = np.ix_(self.columns, self.columns)
        for motion, rows in self.motions:
            information, gradient = np.zeros((self.unknowns.size, self.unknowns.size)), np.zeros(self.unknowns.size)
            information[places] = jacobian[rows].T @ jacobian[rows]
            gradient[self.columns] = jacobian[rows].T @ residual[rows]
            yield motion, information, gradient

    def at_residual_noise(self, x: FloatArray, covariance: FloatArray | None = None) -> Equation[Sample]:
        """Return these rows with their noise reduced to that of the residuals at x; by default the noise is fixed.

        Args:
            covariance: (size, size) covariance of the estimate x, whose degrees of freedom are subtracted from the
                residuals' mean square; None: the median of the normalized residuals is used.
        """
        return self

    def expect_residual(self, normalized_residual: float) -> None:
        """Set the noise to a multiple of the sensor noise; by default the noise is fixed."""

    def renew_noise(self, x: FloatArray) -> None:
        """Increase the noise of motions with large residuals; by default the noise is fixed."""

    def normalized_residuals(self, x: FloatArray) -> tuple[MotionResidual, ...]:
        """Return the normalized residual of each motion; by default none."""
        return ()


class MotionEquation(Equation[Sample]):
    """Rows of motions with one noise level each.

    Attributes:
        shared: number of motions that have their errors beyond sensor noise in common.
        scale: (motions,) noise of each motion, divided by its sensor noise.
    """

    shared = 1.0

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, Sample]]) -> None:
        super().__init__(unknowns, samples)
        self.scale = np.ones(len(samples))

    @abstractmethod
    def normalized_residual(self, x: FloatArray) -> FloatArray:
        """Return (motions,) root mean squares of the residuals, divided by the sensor noise."""

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
    """Return (..., n, n) matrices that whiten residuals with these covariances."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=float)
