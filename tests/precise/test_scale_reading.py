"""A scale's reading: in kilograms, of this robot, and near what its joints carry."""

import warnings

import pytest

from equipoise.errors import SettingsError
from equipoise.precise.measurements.scale_reading import question_mass
from equipoise.precise.method import Precise
from equipoise.recording.phases import Phase
from equipoise.robot.stance import nominal_stance


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        (16085.0, "a scale's mass of 16085 kg is more than any legged robot's; if it is in grams, give 16.085"),
        (0.01, "a scale's mass is 0.01 kg; it must be 0.05 kg or more"),
        (float("nan"), "a scale's mass is nan kg; it must be 0.05 kg or more"),
    ],
)
def test_a_mass_that_no_robot_has_is_refused(mass, message):
    with pytest.raises(SettingsError) as caught:
        Precise(mass=mass)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("mass", "like"), [(2500.0, "; if it is in grams, give 2.5"), (125.0, ""), (1.0, "")], ids=["grams", "more", "less"]
)
def test_the_mass_of_another_robot_is_refused_before_anything_moves(a1, mass, like):
    with pytest.raises(SettingsError) as caught:
        Precise(mass=mass).check(a1, nominal_stance(a1))
    assert str(caught.value) == (
        f"a scale's mass of {mass:g} kg is another robot's: the model file of 'unitree_a1' has 12.46 kg{like}"
    )


def test_a_mass_far_from_what_the_joints_carry_is_questioned_after_the_first_rest(a1, precise_run):
    first = next(recording for recording in precise_run.recordings if recording.has_phase(Phase.REST))
    with pytest.warns(
        UserWarning, match=r"the scale says 30 kg, and joint torques carry 1[34]\.\d kg; .*--mass, or none$"
    ):
        question_mass(a1, 30.0, first)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        question_mass(a1, 12.5, first)
        question_mass(a1, 18.0, first)  # a motor's torque constant may be off by so much
