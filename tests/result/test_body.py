"""One body: its quantities, their arrays, and its JSON form."""

import dataclasses
import json

import numpy as np
import pytest

from equipoise import InertialParameters, Quantity
from equipoise.errors import NotEstimatedError
from equipoise.result.body import Body
from equipoise.robot.inertial import COMPONENTS, components

BASE = InertialParameters(
    6.2, np.array([0.02, -0.003, 0.03]), np.array([[0.03, 1e-3, 2e-3], [1e-3, 0.07, -1e-3], [2e-3, -1e-3, 0.08]])
)
TRUE = InertialParameters(6.0, np.array([0.01, 0.0, 0.05]), np.diag([0.02, 0.06, 0.07]))
COVARIANCE = np.diag(np.arange(1.0, 11.0) ** 2 * 1e-6) + 1e-8


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("mass", "com", "inertia"))


@pytest.fixture
def body():
    return Body.complete(BASE, COVARIANCE, np.full(10, 0.012), TRUE).with_truth(TRUE)


def test_quantity_attributes(body):
    std = np.sqrt(COVARIANCE[2, 2])
    y = body.com_in_base.y
    assert y == Quantity("com_y", "m", -0.003, std, "weak", 0.0, 0.0)
    assert y.half_width == 1.96 * std
    assert y.interval == (y.lower, y.upper) == (-0.003 - y.half_width, -0.003 + y.half_width)
    assert (y.error, y.change) == (-0.003, -0.003)
    assert not y.missed
    assert dataclasses.replace(y, truth=-0.003 - 1.01 * y.half_width).missed
    assert body.mass.missed


def test_quantities_are_attributes_of_a_body(body):
    assert [quantity.name for quantity in body] == list(COMPONENTS)
    for name in COMPONENTS[4:]:
        quantity = getattr(body.inertia, name)
        row, column = ("xyz".index(axis) for axis in name[1:])
        assert (quantity.name, quantity.value, quantity.unit) == (name, BASE.inertia[row, column], "kg m2")
    assert [moment.name for moment in body.inertia.moments] == ["Ixx", "Iyy", "Izz"]
    assert (body.mass.value, body.mass.unit) == (BASE.mass, "kg")


def test_arrays_are_those_of_the_quantities(body):
    assert np.array_equal(body.values, components(BASE))
    assert np.array_equal(body.com_in_base.values, BASE.com)
    assert np.array_equal(body.inertia.values, BASE.inertia)
    assert np.array_equal(body.stds, np.sqrt(np.diag(COVARIANCE)))
    assert np.array_equal(body.com_in_base.errors, BASE.com - TRUE.com)
    assert np.array_equal(body.inertia.errors, BASE.inertia - TRUE.inertia)
    assert np.array_equal(body.covariance, COVARIANCE)
    with pytest.raises(ValueError, match="read-only"):
        body.covariance[0, 0] = 0.0


def test_a_body_returns_its_parameters(body):
    assert same(body.parameters(), BASE)
    assert same(body.model, TRUE)
    assert same(body.truth, TRUE)
    assert body.with_truth(None).truth is None
    assert body.with_truth(None).mass.error is None
    assert same(body.with_model(BASE).model, BASE)


def test_json_round_trip_of_a_complete_body(body):
    table = json.loads(json.dumps(body.to_dict(), allow_nan=False))
    again = Body.from_dict(table).with_model(TRUE).with_truth(TRUE)
    assert list(again) == list(body)
    assert np.array_equal(again.covariance, body.covariance)
    assert table["uncertainty"]["intervals"]["Ixy"] == {
        "std": body.inertia.Ixy.std, "lower": body.inertia.Ixy.lower, "upper": body.inertia.Ixy.upper,
        "verdict": body.inertia.Ixy.verdict,
    }  # fmt: skip


def test_json_round_trip_of_an_incomplete_body():
    variance = np.full((10, 10), np.nan)
    variance[0, 0] = 0.04
    body = Body.of([2.0, *9 * [np.nan]], variance, np.ones(10))
    assert body.covariance is None
    table = json.loads(json.dumps(body.to_dict(), allow_nan=False))
    assert table["inertia"] is None
    assert table["com_in_base"] == [None, None, None]
    assert list(table["uncertainty"]["intervals"]) == ["mass"]
    assert list(Body.from_dict(table)) == list(body)
    assert np.isnan(body.values[1:]).all()


@pytest.mark.parametrize(
    ("body", "missing"),
    [
        (Body.partial(), "mass, inertia, com_in_base.x, com_in_base.y, com_in_base.z"),
        (Body.of([1.0, 0, 0, np.nan, 1, 1, 1, 0, 0, 0]), "com_in_base.z"),
        (Body.of([np.nan, 0, 0, 0, 1, 1, 1, 0, 0, 0]), "mass"),
        (Body.of([1.0, 0, 0, 0, 1, 1, 1, 0, 0, np.nan]), "inertia"),
    ],
)
def test_the_error_names_missing_parameters(body, missing):
    with pytest.raises(NotEstimatedError) as caught:
        body.parameters()
    assert (
        str(caught.value)
        == f"this calibration does not estimate {missing}; use --method bayesian, with base in --parameters"
    )


def test_errors_exist_where_estimate_and_truth_exist():
    partial = Body.of([6.0, 0.01, *8 * [np.nan]]).with_truth(BASE)
    assert partial.numbers("error") == {
        "mass": pytest.approx(-0.2), "com_in_base": [pytest.approx(-0.01), None, None], "inertia": None,
    }  # fmt: skip
    assert not Body.complete(BASE).with_truth(BASE).errors.any()


def test_parameters_without_estimate_have_a_model_value():
    height = Body.partial(TRUE, com_in_base=(0.01, 0.0, None)).com_in_base.z
    assert height == Quantity("com_z", "m", model=0.05)
    assert height.interval is height.half_width is height.error is height.change is None


def test_doubted_keeps_numbers_and_changes_verdicts():
    sure = np.diag(np.repeat([1e-12, 1.0, 1e-7], [1, 1, 8]))
    body = Body.complete(BASE, sure, np.full(10, 1.5e-3), TRUE).with_truth(TRUE)
    assert {quantity.verdict for quantity in body} == {"identified", "weak", "not identified"}
    doubted = body.doubted()
    assert [one.verdict for one in doubted] == [
        "not identified" if one.verdict == "not identified" else "doubtful" for one in body
    ]
    for one, other in zip(doubted, body, strict=True):
        assert dataclasses.replace(one, verdict=other.verdict) == other
    assert np.array_equal(doubted.covariance, body.covariance)
    again = Body.from_dict(json.loads(json.dumps(doubted.to_dict()))).with_model(TRUE).with_truth(TRUE)
    assert list(again) == list(doubted)


def test_doubted_raises_standard_deviations_to_the_lower_bounds():
    body = Body.complete(BASE, np.diag(np.repeat([1e-12, 1.0, 1e-7], [1, 1, 8])) + 1e-13, np.ones(10))
    least = np.where(np.arange(10) == 2, 0.02, 1e-9)
    doubted = body.doubted(least)
    assert np.allclose(doubted.stds, np.maximum(body.stds, least))
    scale = np.outer(doubted.stds, doubted.stds)
    before = np.outer(body.stds, body.stds)
    assert np.allclose(doubted.covariance / scale, body.covariance / before)


def test_doubted_adds_no_verdicts():
    assert {quantity.verdict for quantity in Body.of([6.0, *9 * [np.nan]]).doubted()} == {None}
