"""Factors of 95 % regions, and limits of verdicts."""

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, norm

import equipoise
from equipoise.result.statistics import NORMAL, NORMAL_95, PLANAR_95, SPATIAL_95, ellipsoid_95, verdict_of


@pytest.mark.parametrize(("dimensions", "half"), [(1, NORMAL_95), (2, PLANAR_95), (3, SPATIAL_95)])
def test_an_interval_an_ellipse_and_an_ellipsoid_hold_95_percent(dimensions, half):
    assert chi2.cdf(half**2, dimensions) == pytest.approx(0.95, abs=5e-5)
    drawn = np.random.default_rng(dimensions).standard_normal((200_000, dimensions))
    assert (np.linalg.norm(drawn, axis=1) <= half).mean() == pytest.approx(0.95, abs=2e-3)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_an_ellipsoid_of_a_covariance_holds_95_percent(dimensions):
    generator = np.random.default_rng(dimensions)
    root = generator.standard_normal((dimensions, dimensions))
    directions, half_axes = ellipsoid_95(root @ root.T)
    drawn = generator.standard_normal((200_000, dimensions)) @ root.T
    assert (np.linalg.norm(drawn @ directions / half_axes, axis=1) <= 1).mean() == pytest.approx(0.95, abs=2e-3)
    assert np.linalg.det(directions) == pytest.approx(1.0)
    assert np.all(np.diff(half_axes) > 0)


@pytest.mark.parametrize(("percent", "half"), list(NORMAL.items()))
def test_coverage_of_intervals(percent, half):
    assert norm.cdf(half) - norm.cdf(-half) == pytest.approx(percent / 100, abs=5e-5)


@pytest.mark.parametrize(
    ("std", "verdict"),
    [(0.1, "identified"), (0.101, "weak"), (0.5, "weak"), (0.501, "not identified"), (0.0, "identified")],
)
def test_verdicts_by_reduction_of_the_standard_deviation(std, verdict):
    assert verdict_of(std, 1.0) == verdict_of(3 * std, 3.0) == verdict


def test_the_95_percent_factors_are_defined_once():
    source = Path(equipoise.__file__).parent
    for path in source.rglob("*.py"):
        if path != source / "result" / "statistics.py":
            tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            numbers = [node.value for node in tree if isinstance(node, ast.Constant) and isinstance(node.value, float)]
            found = [n for n in numbers for known in (1.96, 2.4477, 2.7955) if abs(n - known) < 5e-4]
            assert not found, path
