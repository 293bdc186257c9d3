"""A scale's reading: in kilograms, of this robot, with a standard deviation below it."""

import pytest

from equipoise.bayesian.method import BayesianMethod
from equipoise.errors import SettingsError
from equipoise.robot.stance import nominal_stance


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        (16085.0, "a scale's mass of 16085 kg is more than any legged robot's; if it is in grams, give 16.085"),
        (0.01, "a scale's mass is 0.01 kg; it must be 0.05 kg or more"),
        (0.0, "a scale's mass is 0 kg; it must be 0.05 kg or more"),
        (-12.0, "a scale's mass is -12 kg; it must be 0.05 kg or more"),
        (float("nan"), "a scale's mass is nan kg; it must be 0.05 kg or more"),
        (float("inf"), "a scale's mass of inf kg is more than any legged robot's"),
    ],
)
def test_a_mass_that_no_robot_has_is_refused(mass, message):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=mass)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("mass", "like"), [(2500.0, "; if it is in grams, give 2.5"), (125.0, ""), (1.0, "")], ids=["grams", "more", "less"]
)
def test_the_mass_of_another_robot_is_refused_before_anything_moves(a1, mass, like):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=mass).check(a1, nominal_stance(a1))
    assert str(caught.value) == (
        f"a scale's mass of {mass:g} kg is another robot's: the model file of 'unitree_a1' has 12.46 kg{like}"
    )


@pytest.mark.parametrize("std", [12.0, 13.5])
def test_a_standard_deviation_as_large_as_the_mass_is_refused(std):
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass=12.0, mass_std=std)
    assert str(caught.value) == (
        f"the scale's mass is 12 kg and its standard deviation {std:g} kg: a standard deviation as large as the mass "
        "determines nothing; give that of the scale, or leave both out"
    )
    assert BayesianMethod(mass=12.0, mass_std=3.0).scale == (12.0, 3.0)


@pytest.mark.parametrize("std", [0.0, -0.1, float("nan"), float("inf")])
def test_a_standard_deviation_that_is_none_is_refused(std):
    said = f"the standard deviation of the scale's mass is {std:g} kg; it must be from 0.0001 to 500 kg"
    with pytest.raises(SettingsError, match=said):
        BayesianMethod(mass=600.0, mass_std=std)


def test_a_standard_deviation_without_a_mass_is_refused_under_no_flag_s_name():
    """The flag is --mass-std in 'calibrate' and --mass-std in 'weigh'."""
    with pytest.raises(SettingsError) as caught:
        BayesianMethod(mass_std=0.1)
    assert str(caught.value) == "a standard deviation is given for the scale's mass, and no mass; give both, or neither"


def test_there_is_nothing_to_confirm_without_a_mass():
    with pytest.raises(SettingsError, match="confirm_mass confirms a given mass, and there is none"):
        BayesianMethod(confirm_mass=True)
