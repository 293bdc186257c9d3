"""Rehearsals, compared with calibrations."""

import numpy as np
import pytest

from equipoise import BayesianMethod, PaperMethod, calibrate, simulate
from equipoise.calibration.rehearsal import rehearse
from equipoise.errors import SettingsError
from equipoise.lab.static.method import Static

SETTINGS = {
    "bayesian": BayesianMethod(duration=40),
    "paper": PaperMethod(),
    "static": Static(),
}


@pytest.mark.parametrize("method", SETTINGS)
def test_joints_stay_within_the_predicted_range(a1, method, request):
    rehearsal = rehearse(a1, SETTINGS[method])
    kept = []
    if method == "paper":
        kept = request.getfixturevalue("paper_run").recordings
    else:
        with simulate(a1, "ideal") as simulation:
            calibrate(simulation.platform, a1, SETTINGS[method], kept.append)
    sent = np.concatenate([recording.commands.position for recording in kept])
    lower, upper = rehearsal.joint_range
    assert (sent >= lower - 0.12).all()
    assert (sent <= upper + 0.12).all()
    assert rehearsal.duration == pytest.approx(sum(recording.duration for recording in kept) + 12, rel=0.35)


def test_torques_are_those_of_a_robot_of_its_weight(a1):
    rehearsal = rehearse(a1, SETTINGS["paper"])
    assert (rehearsal.largest_torque < a1.effort_limit).all()
    assert rehearsal.largest_torque.max() > 5
    assert rehearsal.postures[0].what == "lying"


def test_impossible_settings_are_rejected(a1):
    with pytest.raises(SettingsError, match="allows no lift after the search"):
        rehearse(a1, BayesianMethod(duration=20))
