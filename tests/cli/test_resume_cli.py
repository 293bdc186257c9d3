"""`equipoise calibrate --resume` after a killed process."""

import contextlib
import json
import shutil
import subprocess
import sys
import time

import pytest

from equipoise import RunFolder
from equipoise.cli import main

pytestmark = pytest.mark.usefixtures("fine_engine")

QUICK = ["--method", "paper", "--tolerance", "0.03", "--excitation-duration", "0.8"]
ROBOT = ["--sim-preset", "realistic", "--payload", "1,0.03,0.02,0.06", "--seed", "3", "--start", "lying"]
COMMAND = [sys.executable, "-m", "equipoise", "calibrate", "--quiet"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of a complete run."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    assert main(["calibrate", *QUICK, *ROBOT, "--quiet", "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def cut(whole, tmp_path):
    """Copy of the run, killed half-way."""
    return cut_at(0.5, whole, tmp_path / "run")


def cut_at(part, whole, copy):
    """Return a copy of a run that was killed after part of its log."""
    shutil.copytree(whole, copy)
    for name in ("calibration.json", "metadata.yaml"):
        (copy / name).unlink()
    content = (copy / "recording_0.mcap").read_bytes()
    (copy / "recording_0.mcap").write_bytes(content[: int(part * len(content))])
    return copy


def killed_at(arguments, folder, size, name="recording_0.mcap"):
    """Run a process, and kill it when its file of the log has grown to a size."""
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    log = folder / name
    with process:
        while process.poll() is None:
            with contextlib.suppress(FileNotFoundError):
                if (folder / "run.json").exists() and log.stat().st_size >= size:
                    process.kill()
                    break
            time.sleep(0.002)
        assert process.wait() == -9, process.stderr.read()


def result(folder):
    table = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    del table["provenance"]["time"]
    return table


def test_a_resumed_run_has_the_same_result(whole, tmp_path, capsys):
    folder, moments = tmp_path / "run", (0.0, 0.5)
    size = (whole / "recording_0.mcap").stat().st_size
    killed_at([*QUICK, *ROBOT, "--out", str(folder)], folder, moments[0] * size)
    for moment in moments[1:]:
        before = RunFolder.open(folder).read().recordings
        killed_at(["--resume", str(folder)], folder, moment * size, "recording_1.mcap")
        now = RunFolder.open(folder).read().recordings
        assert len(now) >= len(before)
        assert all(one.equals(other) for one, other in zip(before, now, strict=False))
    assert main(["calibrate", "--resume", str(folder), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert result(folder) == result(whole)
    assert printed == json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    ours, theirs = RunFolder.open(folder), RunFolder.open(whole)
    assert all(one.equals(other) for one, other in zip(ours.recordings(), theirs.recordings(), strict=True))
    assert ours.estimate().to_json() == printed_as_text(printed)
    more = {f"recording_{number}.mcap" for number in (1, 2)}
    assert {file.name for file in folder.iterdir()} == {file.name for file in whole.iterdir()} | more


def test_resume_removes_files_that_were_being_written(whole, tmp_path):
    copy = cut_at(0.5, whole, tmp_path / "copy")
    (copy / ".truth.json.0a1b2c3d.partial").write_text("{", encoding="utf-8")
    assert main(["calibrate", "--resume", str(copy), "--quiet"]) == 0
    assert not list(copy.glob(".*"))


def printed_as_text(table):
    return json.dumps(table, indent=2) + "\n"


@pytest.mark.parametrize(("part", "how", "time"), [(0.5, "belly", "3s"), (0.6, "three-feet", "5s")])
def test_a_run_killed_during_motor_swings_has_the_same_result(tmp_path, part, how, time):
    """The robot lies with raised legs, or stands on three feet; the recordings of the base stay."""
    whole, arguments = tmp_path / "whole", ["--parameters", "base,motors", "--method", "static", "--motor-time", time]
    arguments += ["--motor-stance", how, "--no-report"]
    assert main(["calibrate", *arguments, *ROBOT, "--quiet", "--out", str(whole)]) == 0
    copy = cut_at(part, whole, tmp_path / f"cut at {part}")
    assert main(["calibrate", "--resume", str(copy), "--quiet", "--no-report"]) == 0
    assert result(copy) == result(whole)


def test_a_run_with_other_noise_is_resumed(tmp_path):
    """Runs with another --noise-seed have the same robot and sensors."""
    method = ["--method", "static", "--no-report", "--quiet"]
    assert main(["calibrate", *method, *ROBOT, "--out", str(tmp_path / "01")]) == 0
    assert main(["calibrate", *method, *ROBOT, "--noise-seed", "99", "--out", str(tmp_path / "02")]) == 0
    first, second = (result(tmp_path / name) for name in ("01", "02"))
    assert first["composite"] != second["composite"]
    assert first["truth"] == second["truth"]
    copy = cut_at(0.7, tmp_path / "02", tmp_path / "copy")
    assert main(["calibrate", "--resume", str(copy), "--quiet"]) == 0
    assert result(copy) == second


def test_a_run_that_is_complete_is_estimated_again(whole, capsys):
    before = (whole / "recording_0.mcap").read_bytes()
    assert main(["calibrate", "--resume", str(whole), "--json"]) == 0
    captured = capsys.readouterr()
    assert captured.err == f"the run in {whole} is complete; this is its result\n"
    assert json.loads(captured.out) == json.loads((whole / "calibration.json").read_text(encoding="utf-8"))
    assert (whole / "recording_0.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["go2"], "a robot"), (["unitree_a1"], "a robot"), (["--seed", "4"], "--seed"), (["--no-excitation"],
        "--no-excitation"),
        (["--sim-preset", "ideal"], "--sim-preset"), (["--t-thres", "1"], "--t-thres"), (["--out", "x"], "--out"),
        (["--foot-radius", "0.03"], "--foot-radius"), (["--method", "static"], "--method"),
    ],
)  # fmt: skip
def test_resume_refuses_other_settings(whole, arguments, named, capsys):
    assert main(["calibrate", "--resume", str(whole), *arguments]) == 2
    assert f"error: --resume uses the settings of the run; {named} cannot be given with it" in capsys.readouterr().err


def test_only_a_run_can_be_resumed(tmp_path, capsys):
    assert main(["calibrate", "--resume", str(tmp_path)]) == 5
    assert "name the run folder of a calibration" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"platform": "unitree-z9", "platform_settings": {}}, "platform 'unitree-z9' is not known"),
        ({"seed": None}, "has no 'seed' in its provenance; only runs of"),
        ({"sim_preset": "loud"}, "preset 'loud' does not exist"),
        ({"payload": "heavy"}, "is not MASS,X,Y,Z"),
        ({"seed": 4}, "standing up"),
    ],
)
def test_a_run_that_cannot_be_repeated_raises_and_is_unchanged(cut, facts, message, capsys):
    header = json.loads((cut / "run.json").read_text(encoding="utf-8"))
    header["provenance"] |= facts
    if facts.get("seed", 0) is None:
        del header["provenance"]["seed"]
    (cut / "run.json").write_text(json.dumps(header), encoding="utf-8")
    before = RunFolder.open(cut).read().recordings
    assert main(["calibrate", "--resume", str(cut), "--quiet"]) in (2, 5)
    assert message in capsys.readouterr().err
    now = RunFolder.open(cut).read().recordings
    assert len(now) == len(before) > 0
    assert all(one.equals(other) for one, other in zip(now, before, strict=True))


def test_a_run_of_another_process_is_refused(cut, capsys):
    with RunFolder.resume(cut, repeats=True)[0]:
        assert main(["calibrate", "--resume", str(cut), "--quiet"]) == 6
    assert "is being written by another process" in capsys.readouterr().err
