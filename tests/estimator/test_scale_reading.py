"""Plausibility checks of a mass from a scale."""

import pytest

from equipoise.bayesian.method import BayesianMethod
from equipoise.errors import SettingsError
from equipoise.robot.stance import nominal_stance


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        (16085.0, "a mass of 16085 kg exceeds that of any legged robot; if it is in grams, pass 16.085"),
        (0.01, "a mass of 0.01 kg is too small; pass at least 0.05 kg"),
        (0.0, "a mass of 0 kg is too small; pass at least 0.05 kg"),
        (-12.0, "a mass of -12 kg is too small; pass at least 0.05 kg"),
        (float("nan"), "a mass of nan kg is too small; pass at least 0.05 kg"),
        (float("inf"), "a mass of inf kg exceeds that of any legged robot"),
    ],
)
def test_implausible_masses_raise(mass, message):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=mass)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("mass", "grams"),
    [(2500.0, "; if it is in grams, pass 2.5"), (125.0, ""), (1.0, "")],
    ids=["grams", "more", "less"],
)
def test_a_mass_of_another_robot_raises_before_any_motion(a1, mass, grams):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=mass).check(a1, nominal_stance(a1))
    assert str(caught.value) == (
        f"a mass of {mass:g} kg does not match the model file of 'unitree_a1', which has 12.46 kg{grams}"
    )


@pytest.mark.parametrize("std", [12.0, 13.5])
def test_a_standard_deviation_as_large_as_the_mass_raises(std):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=12.0, mass_std=std)
    assert str(caught.value) == (
        f"the mass is 12 kg and its standard deviation {std:g} kg, which is not smaller; "
        "pass the scale's standard deviation, or omit both"
    )
    assert BayesianMethod(mass=12.0, mass_std=3.0).scale == (12.0, 3.0)


@pytest.mark.parametrize("std", [0.0, -0.1, float("nan"), float("inf")])
def test_invalid_standard_deviations_raise(std):
    message = f"the standard deviation of the scale's mass is {std:g} kg; it must be from 0.0001 to 500 kg"
    with pytest.raises(SettingsError, match=message):
        BayesianMethod(mass=600.0, mass_std=std)


def test_a_standard_deviation_without_a_mass_raises():
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass_std=0.1)
    assert str(caught.value) == "mass_std is given without a mass; give both or neither"


def test_there_is_nothing_to_confirm_without_a_mass():
    with pytest.raises(SettingsError, match="confirm_mass is given without a mass"):
        BayesianMethod(confirm_mass=True)
