"""Answers of a payload measurement from intervals."""

import dataclasses

import numpy as np
import pytest

from equipoise.calibration.payload_change import PayloadChange
from equipoise.calibration.payload_measurement import _answer, _message
from equipoise.result.body import Body
from equipoise.robot.inertial import InertialParameters
from equipoise.terminal.several_runs import print_payload_change, print_payload_truth

TRUTH = InertialParameters(0.6, np.zeros(3), 1e-3 * np.eye(3))
SIZES = np.repeat([0.125, 2e-3, 5e-3], [1, 3, 6])  # of an A1


def found(mass, half_width, shift=0.0, shift_half_width=5e-4):
    """Return a difference with given half widths of 95 % intervals, with its mass at one point."""
    values = np.array([mass, shift, *8 * [0.0]])
    halves = np.array([half_width, *3 * [shift_half_width], *6 * [1e-3]])
    covariance = np.diag((halves / 1.96) ** 2)
    change = Body.of(values, covariance, np.abs(values)).with_sure_zeros(SIZES)
    nothing = np.array([abs(mass), *9 * [np.nan]])
    payload = Body.of(nothing, np.where(np.isnan(nothing), np.nan, covariance), np.abs(nothing)).with_sure_zeros(SIZES)
    return PayloadChange("unitree_a1", payload, change, removed=mass < 0)


@pytest.mark.parametrize(
    ("delta", "answer"),
    [
        (found(0.02, 0.05), "nothing"),
        (found(0.06, 0.05), "nothing"),  # there, and too little
        (found(0.43, 0.56), "unsure"),
        (found(0.02, 0.56), "unsure"),
        (found(0.02, 0.05, shift=1e-3, shift_half_width=5e-3), "unsure"),
        (found(0.43, 0.56, shift=3e-3), "moved"),
        (found(0.43, 0.1), "added"),
        (found(-0.43, 0.1), "removed"),
    ],
)
def test_an_uncertain_change_is_not_called_too_small(a1, delta, answer):
    assert _answer(a1, delta) == answer


@pytest.mark.parametrize(
    ("delta", "words"),
    [
        (found(0.43, 0.56), "cannot tell whether anything changed: +0.430 +- 0.560 kg, CoM x +0.0 +- 0.5 mm"),
        (found(0.02, 0.05), "too small to matter: +0.020 +- 0.050 kg"),
        (found(0.43, 0.56, shift=3e-3), "the centre of mass moved: CoM x +3.0 +- 0.5 mm"),
    ],
)
def test_the_message_has_the_answer(a1, delta, words):
    message = _message(a1, "since runs/last", delta, _answer(a1, delta), 26.0)
    assert message.startswith(f"unitree_a1: {words}")
    assert "since runs/last; 26 s of robot time" in message
    assert ("--mass KG" in message) == ("cannot tell" in message)


@pytest.mark.parametrize(
    ("delta", "words"),
    [
        (found(0.43, 0.56), "whether anything was added or removed"),
        (found(0.02, 0.05), "No significant payload was added"),
    ],
)
def test_two_runs_distinguish_no_change_from_an_uncertain_one(delta, words, capsys):
    print_payload_change(delta)
    assert words in " ".join(capsys.readouterr().out.split())


def test_the_ground_truth_of_a_simulated_payload_is_printed(capsys):
    change = found(0.43, 0.1)
    print_payload_truth(change)
    assert capsys.readouterr().out == ""
    print_payload_truth(dataclasses.replace(change, payload=change.payload.with_truth(TRUTH)))
    printed = capsys.readouterr().out
    assert ["mass", "[kg]", "0.430", "0.100", "0.600", "-0.170", "(!)"] in map(str.split, printed.splitlines())
    assert printed.endswith("(!): the truth is outside the interval.\n")
