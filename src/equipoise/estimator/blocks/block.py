"""What a block of rows is: residuals of one equation in units of their own noise.

Every block says by name which unknowns its rows depend on, and gives its residual and the derivative by these; which rows
belong to which motion; and how well each motion fits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.tilt_equation import Derivatives
from equipoise.estimator.parameters import INERTIAL, Unknowns

_OUTLIER = 3.0  # times the median misfit
LEFT_OUT = 1e6
"""Noise of motions that are left out, over what their sensors explain."""


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


class MotionBlock(ResidualBlock):
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
        self.scale = np.where(misfit > _OUTLIER * max(median, 1.0), LEFT_OUT, raised)

    def misfits(self, x: FloatArray) -> tuple[Misfit, ...]:
        return tuple(
            Misfit(index, float(misfit), bool(scale < LEFT_OUT))
            for (index, _), misfit, scale in zip(self.motions, self.normalised_residual(x), self.scale, strict=True)
        )


def whitening_of(covariance: FloatArray) -> FloatArray:
    """(..., n, n) matrices that turn residuals with these covariances into white ones."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=float)
