"""`equipoise lab balance` for users and scripts, and its figure."""

import json

import pytest
from robots import quadruped_urdf

from equipoise.cli import main
from equipoise.errors import SettingsError
from equipoise.lab.cli.balance import metres
from equipoise.recording.run_log_reader import read_log
from equipoise.simulation.mujoco import MujocoPlatform

SHORT = ["--duration", "1s", "--quiet", "--sim-preset", "ideal"]


def fails(capsys, code, *arguments):
    assert main(["lab", "balance", *arguments]) == code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    return lines[0]


def test_json_is_one_object_and_the_same_is_saved(tmp_path, capsys):
    out = tmp_path / "run"
    arguments = [*SHORT, "--com-error", "2mm", "--json", "--out", str(out)]
    assert main(["lab", "balance", *arguments, "--diagonal", "FR_RL"]) == 0
    captured = capsys.readouterr()
    table = json.loads(captured.out)
    assert captured.err == ""
    assert table == json.loads((out / "balance.json").read_text(encoding="utf-8"))
    assert table["schema"] == "equipoise.balance/1"
    assert table["balanced"] is True
    assert list(table["diagonals"]) == ["FR_RL"]
    trial = table["diagonals"]["FR_RL"]
    assert trial["model_error"] == pytest.approx(2e-3, abs=1e-9)
    assert trial["time_balanced"] == 1.0
    assert table["settings"]["duration"] == 1.0
    assert table["provenance"]["com_error"] == 2e-3
    assert sorted(file.name for file in out.iterdir()) == ["balance-FR_RL.mcap", "balance.html", "balance.json"]


def test_a_fall_is_a_verdict_and_with_check_an_exit_code(tmp_path, capsys):
    arguments = ["--payload", "2,0.08,0.03,0.1", "--diagonal", "FR_RL", "--no-report", *SHORT]
    assert main(["lab", "balance", *arguments, "--out", str(tmp_path / "a")]) == 0
    captured = capsys.readouterr()
    assert "FR_RL: fell after 0." in captured.out
    assert "designed on the model file; sensor errors are not corrected" in " ".join(captured.out.split())
    assert not (tmp_path / "a" / "balance.html").exists()
    assert main(["lab", "balance", *arguments, "--check", "--json", "--out", str(tmp_path / "b")]) == 4
    captured = capsys.readouterr()
    assert json.loads(captured.out)["balanced"] is False
    assert "the robot did not balance for 1 s on FR_RL" in captured.err


def test_a_calibration_is_read_from_its_file_or_its_folder(tmp_path, capsys, bayesian_run):
    bayesian_run.result.save(tmp_path / "calibration.json")
    payload = ["--payload", "1.5,0.05,-0.02,0.06", "--seed", "4"]
    arguments = [
        "--com",
        str(tmp_path),
        *payload,
        "--diagonal",
        "FL_RR",
        "--sim-preset",
        "realistic",
        "--duration",
        "2s",
    ]
    assert main(["lab", "balance", *arguments, "--out", str(tmp_path / "run"), "--quiet"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "FL_RR: balanced for 2.0 s" in out
    assert "designed on a calibration by the method bayesian; sensor errors are corrected as calibrated." in out


def test_ctrl_c_keeps_the_recordings(tmp_path, capsys, monkeypatch):
    original = MujocoPlatform.step

    def interrupted(self, command):
        state = original(self, command)
        if state.time > 3.5 and not stopped:
            stopped.append(state.time)
            raise KeyboardInterrupt
        return state

    stopped = []
    monkeypatch.setattr(MujocoPlatform, "step", interrupted)
    assert main(["lab", "balance", *SHORT, "--out", str(tmp_path / "run")]) == 130
    assert f"the recording until the interruption is in {tmp_path / 'run'}" in capsys.readouterr().err
    recording = read_log(tmp_path / "run" / "balance-FL_RR-broken-off.mcap").unfinished
    assert recording.has_phase("lower")
    assert recording.joints.time[-1] > stopped[0]


def test_errors_of_flags_name_the_valid_values(tmp_path, capsys):
    assert "pass one of them" in fails(capsys, 2, "--com", "x.json", "--com-error", "5mm")
    assert "'5 apples' is not a length" in fails(capsys, 2, "--com-error", "5 apples")
    assert "--duration 'soon' is not a time" in fails(capsys, 2, "--duration", "soon")
    assert "the duration is 0 s" in fails(capsys, 2, "--duration", "0s")
    (tmp_path / "two.urdf").write_text(quadruped_urdf(joints_per_leg=2))
    message = "'two' cannot balance on two feet: with fewer than three joints"
    assert message in fails(capsys, 2, str(tmp_path / "two.urdf"))
    assert "MASS,X,Y,Z" in fails(capsys, 2, "--payload", "heavy")
    assert "does not exist; name the run folder" in fails(capsys, 5, "--com", str(tmp_path / "missing.json"))
    (tmp_path / "other.json").write_text("{}")
    assert "is a JSON file of another kind" in fails(capsys, 5, "--com", str(tmp_path / "other.json"))
    assert "is not empty; name a new one with --out" in fails(capsys, 6, "--out", str(tmp_path))


@pytest.mark.parametrize(("text", "value"), [("5mm", 5e-3), ("-5mm", -5e-3), ("0.5 cm", 5e-3), ("0.005", 5e-3)])
def test_lengths_have_units(text, value):
    assert metres(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "mm", "5", "1e9mm", "nan", "5 km"])
def test_invalid_lengths_raise_an_error(text):
    with pytest.raises(SettingsError, match="is not a length of at most 100 mm"):
        metres(text)
