"""Arrays with reverse-mode automatic differentiation.

The backward pass costs about two evaluations, for any number of inputs (Griewank and Walther, Evaluating Derivatives, 2nd
ed., chapter 3). Equations here apply to each sample separately. If an input's value is repeated for each sample, the gradient
of the sum over samples is therefore the derivative of every sample by its own value.

Components come first and samples last, (3, ..., n), so that numpy works on long contiguous rows.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray

_numbers = itertools.count()
_NONE = np.empty(0)

Pullback = Callable[[FloatArray], FloatArray]
"""Function from the gradient by a result to that by one of its operands."""


class Traced:
    """Array in an equation. Arrays that do not depend on an input keep no record of their operands.

    Attributes:
        value: array itself.
    """

    __array_ufunc__ = None  # numpy leaves operators to this class

    def __init__(self, value: FloatArray, *origins: tuple[Traced | FloatArray, Pullback]) -> None:
        self.value = value
        self._number = next(_numbers)  # above the numbers of all operands
        self._origins = [(of, pullback) for of, pullback in origins if isinstance(of, Traced) and of._varies]
        self._varies = bool(self._origins)

    @classmethod
    def input(cls, value: FloatArray) -> Traced:
        """Create an independent variable."""
        variable = cls(value)
        variable._varies = True
        return variable

    def gradients(self, seed: FloatArray, inputs: Sequence[Traced]) -> list[FloatArray]:
        """Return the gradients of the sum of seed * value by the inputs, each of its input's shape."""
        totals: dict[int, tuple[Traced, FloatArray]] = {self._number: (self, seed)}
        waiting = [-self._number]
        while waiting:
            result, by_result = totals[-heapq.heappop(waiting)]  # all its uses have been processed
            for origin, pullback in result._origins:
                share = pullback(by_result)
                if origin._number in totals:
                    share = share + totals[origin._number][1]
                else:
                    heapq.heappush(waiting, -origin._number)
                totals[origin._number] = (origin, share)
            if result._origins:
                del totals[result._number]
        return [
            totals[entry._number][1] if entry._number in totals else np.zeros(entry.value.shape) for entry in inputs
        ]

    def __add__(self, other: Traced | FloatArray | float) -> Traced:
        a, b = self.value, _value(other)
        return Traced(a + b, (self, lambda g: _like(g, a)), (_origin(other), lambda g: _like(g, b)))

    __radd__ = __add__

    def __sub__(self, other: Traced | FloatArray | float) -> Traced:
        a, b = self.value, _value(other)
        return Traced(a - b, (self, lambda g: _like(g, a)), (_origin(other), lambda g: -_like(g, b)))

    def __rsub__(self, other: FloatArray | float) -> Traced:
        return -1.0 * self + other

    def __mul__(self, other: Traced | FloatArray | float) -> Traced:
        a, b = self.value, _value(other)
        return Traced(a * b, (self, lambda g: _like(g * b, a)), (_origin(other), lambda g: _like(g * a, b)))

    __rmul__ = __mul__

    def __truediv__(self, other: Traced) -> Traced:
        a, b = self.value, other.value
        result = a / b
        return Traced(result, (self, lambda g: _like(g / b, a)), (other, lambda g: _like(-g * result / b, b)))

    def __getitem__(self, index: Any) -> Traced:
        """Return a part; no element may occur twice."""

        def pullback(by_part: FloatArray) -> FloatArray:
            whole = np.zeros(self.value.shape)
            whole[index] = by_part
            return whole

        return Traced(self.value[index], (self, pullback))


def contract(subscripts: str, a: Traced | FloatArray, b: Traced | FloatArray) -> Traced:
    """Return `numpy.einsum` of two arrays, as "ij...,j...->i..."; the ellipsis has equally many axes in both."""
    of_a, of_b, of_result = subscripts.replace("->", ",").split(",")
    x, y = _value(a), _value(b)

    def to_a(g: FloatArray) -> FloatArray:
        return _like(_einsum(f"{of_result},{of_b}->{of_a}", g, y), x)

    def to_b(g: FloatArray) -> FloatArray:
        return _like(_einsum(f"{of_result},{of_a}->{of_b}", g, x), y)

    return Traced(_einsum(subscripts, x, y), (a, to_a), (b, to_b))


def dot(a: Traced | FloatArray, b: Traced | FloatArray) -> Traced:
    """Return the scalar product along the first axis."""
    return contract("i...,i...->...", a, b)


def turned(matrix: Traced | FloatArray, vector: Traced | FloatArray) -> Traced:
    """Return products of matrices and vectors, along the first axes."""
    return contract("ij...,j...->i...", matrix, vector)


def cross(a: Traced | FloatArray, b: Traced | FloatArray) -> Traced:
    """Return the cross product along the first axis."""
    x, y = _value(a), _value(b)
    return Traced(_cross(x, y), (a, lambda g: _like(_cross(y, g), x)), (b, lambda g: _like(_cross(g, x), y)))


def sin(angle: Traced) -> Traced:
    """Return the sine."""
    return Traced(np.sin(angle.value), (angle, lambda g: g * np.cos(angle.value)))


def cos(angle: Traced) -> Traced:
    """Return the cosine."""
    return Traced(np.cos(angle.value), (angle, lambda g: -g * np.sin(angle.value)))


def tanh(of: Traced) -> Traced:
    """Return the hyperbolic tangent."""
    result = np.tanh(of.value)
    return Traced(result, (of, lambda g: g * (1 - result**2)))


def length(vector: Traced) -> Traced:
    """Return the length along the first axis."""
    result = np.sqrt(np.einsum("i...,i...->...", vector.value, vector.value))
    return Traced(result, (vector, lambda g: g / result * vector.value))


def stacked(parts: Sequence[Traced], axis: int) -> Traced:
    """Stack arrays of one shape along a new axis."""

    def pullback_of(number: int) -> Pullback:
        return lambda g: np.take(g, number, axis)

    whole = np.stack([part.value for part in parts], axis)
    return Traced(whole, *((part, pullback_of(number)) for number, part in enumerate(parts)))


def _value(of: Traced | FloatArray | float) -> FloatArray:
    return of.value if isinstance(of, Traced) else np.asarray(of, dtype=float)


def _origin(of: Traced | FloatArray | float) -> Traced | FloatArray:
    return of if isinstance(of, Traced) else _NONE


def _like(gradient: FloatArray, value: FloatArray) -> FloatArray:
    """Sum a gradient over the axes along which a value was broadcast."""
    if gradient.shape == value.shape:
        return gradient
    gradient = gradient.sum(axis=tuple(range(gradient.ndim - value.ndim)))
    spread = tuple(axis for axis, size in enumerate(value.shape) if size == 1 != gradient.shape[axis])
    return gradient.sum(axis=spread, keepdims=True)


def _einsum(subscripts: str, a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum(subscripts, a, b), dtype=float)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    result = np.empty((3, *np.broadcast_shapes(a.shape[1:], b.shape[1:])))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=result[i])
        result[i] -= a[k] * b[j]
    return result
