"""A --mass that disagrees with the joint torques: a script fails, a terminal asks."""

import io
import json
import sys

import pytest
from commands import at_a_terminal

from equipoise.cli import main

WRONG = ["calibrate", "--mass", "9.5", "--duration", "40s", "--seed", "4", "--quiet", "--no-report"]


def test_a_script_is_refused_with_both_numbers_and_may_try_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    out = tmp_path / "run"
    assert main([*WRONG, "--out", str(out), "--json"]) == 2
    captured = capsys.readouterr()
    assert "the given mass is 9.5 kg, and the joint torques carry 12.29 kg (-23%, limit 15%)" in captured.err
    assert "--confirm-mass" in captured.err
    assert "--resume" not in captured.err  # nothing was measured
    assert not out.exists()
    assert main([*WRONG, "--confirm-mass", "--out", str(out)]) == 0
    table = json.loads((out / "calibration.json").read_text())
    assert table["mass_comparison"]["given"] == 9.5
    assert table["mass_comparison"]["from_torques"] == pytest.approx(12.45, rel=0.03)
    shown = " ".join(capsys.readouterr().out.split())
    assert "Doubtful: the given mass is 9.5 kg, and the joint torques carry 12." in shown
    assert "assumed: the given mass of 9.5 kg is right (standard deviation 0.048 kg)" in shown


@pytest.mark.parametrize(("answer", "code"), [("yes", 0), ("no", 2), ("9.5", 2)])
def test_an_operator_is_asked_while_the_robot_stands(tmp_path, answer, code, monkeypatch):
    command = [*WRONG, "--out", str(tmp_path / "run")]
    asked, error, ended = at_a_terminal(command, "ends the run:", answer, monkeypatch)
    assert "Mass in doubt: the given mass is 9.5 kg, and the joint torques carry 12." in asked
    assert ended == code
    assert ("--confirm-mass" in error) == (code == 2)
    assert (tmp_path / "run").exists() == (code == 0)


def test_a_payload_measurement_is_refused_and_confirmed_alike(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    earlier, out = str(tmp_path / "earlier"), str(tmp_path / "run")
    quick = ["--seed", "4", "--cable", "none", "--quiet"]
    first = [
        "calibrate",
        *quick,
        "--duration",
        "40s",
        "--mass",
        "12.45",
        "--no-report",
        "--out",
        earlier,
    ]
    assert main(first) == 0
    again = [
        "payload",
        "unitree_a1",
        "--prior-run",
        earlier,
        "--noise-seed",
        "104",
        "--payload",
        "0.3,0.05,0,0.08",
        *quick,
        "--mass",
        "11.5",
        "--out",
        out,
    ]
    capsys.readouterr()
    assert main(again) == 2
    error = capsys.readouterr().err
    assert f"with the torque constants of {earlier} (-" in error
    assert "%, limit 5%)" in error
    assert main([*again, "--confirm-mass"]) == 0
    printed = capsys.readouterr().out
    assert "Doubtful: the given mass is 11.5 kg, and the joint torques carry 12." in printed
    assert "Payload and ground truth" in printed
    assert main(["payload", "unitree_a1", "--prior-run", earlier, *quick, "--confirm-mass"]) == 2  # confirms no mass
