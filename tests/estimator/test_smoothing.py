"""Splines through samples with known signals or noise."""

import tracemalloc

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import BSpline

from equipoise.estimator.measurements.smoothing import fit_spline

TIME = np.linspace(0.3, 0.7, 201)
BETWEEN = np.linspace(0.3, 0.7, 77)
QUINTICS = [Polynomial([0.2, -1, 3, 5, -20, 40]), Polynomial([-0.5, 2, 0, -4, 6, -30])]


def at(polynomials, time, derivative=0):
    return np.column_stack([p.deriv(derivative)(time) if derivative else p(time) for p in polynomials])


@pytest.mark.parametrize("with_rates", [False, True])
def test_quintics_are_reproduced_with_their_derivatives(with_rates):
    rates = at(QUINTICS, TIME, 1) if with_rates else None
    spline = fit_spline(TIME, at(QUINTICS, TIME), 0.05, rates, 0.01 if with_rates else 0.0).spline
    for derivative, tolerance in enumerate((1e-8, 1e-6, 1e-4)):
        found = spline.derivative(derivative)(BETWEEN) if derivative else spline(BETWEEN)
        np.testing.assert_allclose(found, at(QUINTICS, BETWEEN, derivative), atol=tolerance)


def test_narrower_knots_follow_faster_signals():
    wave = np.sin(2 * np.pi * 12 * TIME)[:, None]
    misses = [np.abs(fit_spline(TIME, wave, knot).spline(TIME) - wave).max() for knot in (0.4, 0.01)]
    assert misses[0] > 0.3
    assert misses[1] < 1e-4


def test_rates_are_weighted():
    still, rates = np.zeros((len(TIME), 1)), np.ones((len(TIME), 1))
    light, heavy = (fit_spline(TIME, still, 0.05, rates, w).spline.derivative()(BETWEEN) for w in (1e-4, 1e2))
    assert np.abs(light).max() < 1e-2
    assert np.abs(heavy - 1).max() < 1e-2


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_the_mean_is_a_low_pass_filter(derivative):
    """A line and waves: 2 Hz stay, 14 Hz are halved, 60 Hz vanish, without a delay."""
    inner = BETWEEN[(BETWEEN > 0.35) & (BETWEEN < 0.65)]
    for frequency, kept in ((2.0, 0.98), (14.0, 0.5), (60.0, 0.0)):
        turn = 2j * np.pi * frequency
        wave = np.exp(turn * TIME)
        samples = np.column_stack([wave.real, wave.imag, TIME])
        mean = fit_spline(TIME, samples, 0.004, reach=0.04).at(inner, derivative)
        expected = kept * turn**derivative * np.exp(turn * inner)
        np.testing.assert_allclose(mean[:, 0] + 1j * mean[:, 1], expected, atol=0.04 * abs(turn) ** derivative)
        np.testing.assert_allclose(
            mean[:, 2], (inner, np.ones_like(inner), np.zeros_like(inner))[derivative], atol=1e-3
        )


@pytest.mark.parametrize("derivative", [0, 1])
@pytest.mark.parametrize(("with_rates", "reach"), [(False, 0.0), (True, 0.0), (True, 0.02)])
def test_noise_matches_many_draws(derivative, with_rates, reach):
    generator = np.random.default_rng(3)
    draws, sd, rate_sd, few = 6000, 0.3, 4.0, TIME[:60]
    values = sd * generator.standard_normal((len(few), draws))
    rates = rate_sd * generator.standard_normal((len(few), draws)) if with_rates else None
    fit = fit_spline(few, values, 0.03, rates, sd / rate_sd if with_rates else 0.0, reach)
    time = few[0] + reach + (few[-1] - few[0] - 2 * reach) * np.linspace(0.05, 0.95, 9)
    drawn = fit.at(time, derivative)
    expected = sd**2 * fit.noise(time, derivative)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(drawn) / scale, expected / scale, atol=0.07)


def test_rates_reduce_the_noise_of_velocities():
    blank = np.zeros((len(TIME), 1))
    without, with_rates = fit_spline(TIME, blank, 0.02), fit_spline(TIME, blank, 0.02, blank, 0.01)
    assert (np.diag(with_rates.noise(BETWEEN, 1)) < 0.5 * np.diag(without.noise(BETWEEN, 1))).all()


def test_a_gap_wider_than_the_knots_stays_finite():
    kept = (TIME < 0.45) | (TIME > 0.52)
    fit = fit_spline(TIME[kept], at(QUINTICS, TIME[kept]), 0.02)
    assert np.isfinite(fit.spline(BETWEEN)).all()
    assert np.isfinite(fit.noise(BETWEEN)).all()
    outside = (BETWEEN < 0.44) | (BETWEEN > 0.53)
    np.testing.assert_allclose(fit.spline(BETWEEN[outside]), at(QUINTICS, BETWEEN[outside]), atol=1e-4)


@pytest.mark.parametrize("weight", [0.0, 0.01])
def test_the_banded_fit_matches_a_dense_one(weight):
    generator, few = np.random.default_rng(4), TIME[:80]
    values, rates = generator.standard_normal((2, len(few), 3))
    fit = fit_spline(few, values, 0.02, rates if weight else None, weight)
    unit = BSpline(fit.spline.t, np.eye(len(fit.spline.c)), 5)
    design = np.vstack([unit(few), weight * unit.derivative()(few)])
    dense = np.linalg.lstsq(design, np.vstack([values, weight * rates]), rcond=None)[0]
    np.testing.assert_allclose(fit.spline.c, dense, atol=1e-6)
    curvature = unit.derivative(2)(few)
    expected = curvature @ np.linalg.inv(design.T @ design) @ curvature.T
    np.testing.assert_allclose(fit.noise(few, 2), expected, atol=1e-6 * np.abs(expected).max())


def test_memory_is_proportional_to_the_samples():
    time = np.arange(0, 300, 1 / 500)
    waves = np.column_stack([np.sin(2 * time), np.cos(3 * time)])
    tracemalloc.start()
    fit = fit_spline(time, waves, 0.03)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_allclose(fit.spline(time), waves, atol=1e-6)
    assert peak < 100e6  # a dense design: 12 GB
