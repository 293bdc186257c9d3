"""Payloads on the simulated robot: their inertia and the forces on the engine's floor."""

import numpy as np
import pytest

from equipoise import InertialParameters, Payload, nominal_stance, simulate
from equipoise.errors import SettingsError
from equipoise.robot.inertial import nominal_inertia

BOX = InertialParameters(1.5, np.array([0.1, -0.02, 0.08]), np.diag([0.003, 0.005, 0.006]))
PLATE = InertialParameters(0.8, np.array([-0.05, 0.0, 0.06]), np.diag([0.002, 0.003, 0.005]))
POINT = InertialParameters(2.0, np.array([0.0, 0.03, 0.1]), np.zeros((3, 3)))
TURNED = InertialParameters(
    1.0, np.array([0.05, 0.02, -0.04]), np.array([[0.004, 1e-3, -5e-4], [1e-3, 0.005, 2e-4], [-5e-4, 2e-4, 0.006]])
)


def test_a_point_mass_is_four_numbers():
    payload = Payload.parse("1.5,0.1,-0.02,0.08").parameters
    assert payload.mass == 1.5
    assert payload.com.tolist() == [0.1, -0.02, 0.08]
    assert not payload.inertia.any()


def test_a_body_is_seven_numbers():
    payload = Payload.parse(" 1.5, .1,0,8e-2, 0.003,0.005,0.006 ").parameters
    assert payload.com.tolist() == [0.1, 0.0, 0.08]
    assert np.array_equal(payload.inertia, np.diag([0.003, 0.005, 0.006]))


@pytest.mark.parametrize(
    "text", ["", "1.5", "1,2,3", "1,2,3,4,5", "1,2,3,4,5,6", "1,2,3,4,5,6,7,8", "1,2,3,x", "1;2;3;4"]
)
def test_other_numbers_are_not_a_payload(text):
    with pytest.raises(SettingsError) as caught:
        Payload.parse(text)
    assert str(caught.value) == (
        f"payload {text!r} is not MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ (kg, m, kg m2), for example 1.5,0.1,0,0.08"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0,0,0", "a payload's mass must be positive, got 0 kg"),
        ("-1,0,0,0", "a payload's mass must be positive, got -1 kg"),
        ("nan,0,0,0", "mass must be finite, got nan"),
        ("inf,0,0,0", "mass must be finite, got inf"),
        ("1,0,nan,0", r"com must be \(3,\) finite numbers"),
        ("1,0,0,0,inf,1,1", r"inertia must be \(3, 3\) finite numbers"),
        (
            "1,0,0,0,1,1,3",
            "the payload's inertia is not physical: a principal moment, 3 kg m2, exceeds the sum of the others",
        ),
        ("1,0,0,0,-1,1,1", "the payload's inertia is not physical: a principal moment of inertia is -1 kg m2"),
        ("1,0,0,0,0,0,1", "the payload's inertia is not physical: a principal moment of inertia is 0 kg m2"),
    ],
)
def test_an_unphysical_payload_is_rejected(text, message):
    with pytest.raises(SettingsError, match=message):
        Payload.parse(text)


@pytest.mark.parametrize("parameters", [BOX, PLATE, POINT, TURNED])
def test_the_truth_is_the_robot_and_its_payload_joined(a1, parameters):
    # An engine that counts the payload's offset twice has it at 2 p.
    stance = nominal_stance(a1).joint_position
    truth, nominal = simulate(a1, "ideal", payload=Payload(parameters)).truth, nominal_inertia(a1, stance)
    for body in ("base", "composite", "stance_effective"):
        expected, found = getattr(nominal, body) + parameters, getattr(truth, body)
        assert found.mass == pytest.approx(expected.mass)
        assert np.allclose(found.com, expected.com, rtol=0, atol=1e-9)
        assert np.allclose(found.inertia, expected.inertia, rtol=0, atol=1e-6)


def test_text_is_a_payload_too(a1):
    written, made = (simulate(a1, "ideal", payload=payload).truth for payload in ("2,0,0.03,0.1", Payload(POINT)))
    assert np.array_equal(written.composite.inertia, made.composite.inertia)


@pytest.mark.parametrize("parameters", [BOX, POINT])
def test_the_floor_carries_the_payload_where_it_is(a1, parameters):
    # Moments of the floor's forces about the base: the engine's dynamics, not the figures that the truth is read from.
    feet_moments = []
    for payload in (None, Payload(parameters)):
        with simulate(a1, "ideal", payload=payload) as simulation:
            data = simulation.platform._data
            feet_moments.append(data.qfrc_constraint[:6].copy())
    force, moment = np.split(feet_moments[1] - feet_moments[0], 2)
    weight = parameters.mass * 9.81
    assert force[2] == pytest.approx(weight, rel=0.02)
    assert moment[:2] == pytest.approx(
        [parameters.com[1] * weight, -parameters.com[0] * weight], abs=0.03 * weight * 0.1
    )


def test_a_payload_adds_to_the_leg_errors(a1):
    bare, loaded = (simulate(a1, "realistic", payload=payload, seed=4).truth for payload in (None, Payload(BOX)))
    assert loaded.composite.mass == pytest.approx(bare.composite.mass + BOX.mass)
    assert np.allclose(loaded.composite.com, (bare.composite + BOX).com, atol=1e-9)
