"""Derivatives of equations, compared with finite differences."""

import numpy as np
import pytest

from equipoise.estimator.measurements.imu_frame import mounting, traced_mounting
from equipoise.estimator.measurements.traced import Traced, contract, cos, cross, dot, length, sin, stacked, turned

COUNT, STEP = 4, 1e-6
CONSTANT = np.random.default_rng(7).standard_normal((3, COUNT))


def matrix_of(v):
    return stacked([v, cross(v, CONSTANT), 2.0 * v], axis=1)


EQUATIONS = {
    "sums and differences": lambda v: dot(3.0 - (v + CONSTANT) - v[0] + 1.0, CONSTANT - v),
    "products and quotients": lambda v: (v[0] * CONSTANT[0] * v[1]) / (2.0 + v[2] * v[2]),
    "sine and cosine": lambda v: sin(v[0]) * cos(v[1]),
    "length": lambda v: length(v + CONSTANT),
    "cross products of both": lambda v: dot(cross(cross(v, CONSTANT), v), v),
    "matrices": lambda v: dot(turned(matrix_of(v), v), CONSTANT),
    "products of matrices": lambda v: contract("ij...,jk...->ik...", matrix_of(v), matrix_of(v))[0, 2],
    "constants of a matrix": lambda v: dot(turned(np.arange(9.0).reshape(3, 3, 1), v), v),
    "sums over an axis": lambda v: contract("ikn,kn->in", stacked([v, v * v], axis=1), stacked([v[1], v[2]], axis=0))[
        0
    ],
    "broadcasting": lambda v: dot(v[:, None] * stacked([v, CONSTANT + v], axis=1), CONSTANT[:, None])[1],
    "picked samples": lambda v: stacked([v, v * v], axis=1)[1, np.array([0, 1, 1, 0]), np.arange(COUNT)],
    "what one value gives twice": lambda v: v[0] * v[0] + v[0],
}


@pytest.mark.parametrize("equation", EQUATIONS.values(), ids=EQUATIONS)
def test_gradients_match_differences(equation):
    value = np.random.default_rng(1).standard_normal((3, COUNT))
    entry = Traced.input(value)
    result = equation(entry)
    (found,) = result.gradients(np.ones(COUNT), [entry])
    for component, unit in enumerate(STEP * np.eye(3)):
        ahead, behind = (equation(Traced(value + sign * unit[:, None])).value for sign in (1, -1))
        np.testing.assert_allclose(found[component], (ahead - behind) / (2 * STEP), rtol=1e-6, atol=1e-8)


def test_seeds_scale_gradients_and_other_inputs_have_none():
    entry, other = Traced.input(CONSTANT), Traced.input(CONSTANT)
    of_entry, of_other = (2.0 * entry[0]).gradients(np.arange(COUNT), [entry, other])
    np.testing.assert_array_equal(of_entry, [2.0 * np.arange(COUNT), np.zeros(COUNT), np.zeros(COUNT)])
    assert of_other.shape == CONSTANT.shape
    assert not of_other.any()


def test_two_results_have_separate_gradients():
    entry = Traced.input(CONSTANT)
    shared = sin(entry)
    for row, result in enumerate((shared[0], shared[1])):
        (found,) = result.gradients(np.ones(COUNT), [entry])
        np.testing.assert_allclose(found[row], np.cos(CONSTANT[row]))
        assert np.count_nonzero(found.any(axis=1)) == 1


@pytest.mark.parametrize("size", [0.0, 0.02, 1.0])
def test_the_mounting_and_its_derivatives_are_correct(size):
    nominal = mounting(np.eye(3), np.array([0.3, -1.0, 0.5]))
    vector = size * np.array([0.6, -0.3, 0.7])
    entry = Traced.input(np.repeat(vector[:, None], COUNT, axis=1))
    rotation = traced_mounting(nominal, entry)
    np.testing.assert_allclose(rotation.value[..., 2], mounting(nominal, vector), atol=1e-15)
    for row, column in np.ndindex(3, 3):
        (found,) = rotation[row, column].gradients(np.ones(COUNT), [entry])
        for component, unit in enumerate(STEP * np.eye(3)):
            ahead, behind = (mounting(nominal, vector + sign * unit)[row, column] for sign in (1, -1))
            assert found[component, 1] == pytest.approx((ahead - behind) / (2 * STEP), abs=1e-8)
