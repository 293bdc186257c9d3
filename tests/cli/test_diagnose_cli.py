"""`equipoise diagnose` for users and scripts."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from commands import fails

from equipoise import Recording, RunFolder
from equipoise.cli import main
from equipoise.recording.run_log import save_recording


@pytest.fixture(scope="module")
def run(bayesian_run, a1, tmp_path_factory):
    """Return the folder of a finished run with a payload."""
    path = tmp_path_factory.mktemp("runs") / "a1"
    with RunFolder.create(path, a1, bayesian_run.settings, {}) as folder:
        for recording in bayesian_run.recordings:
            folder.keep(recording)
        folder.save(bayesian_run.result)
    return path


@pytest.fixture(scope="module")
def log(bayesian_run, a1, tmp_path_factory):
    """Return a log in which the encoder of RL_calf_joint reads 30 mrad too much."""
    whole = Recording.concatenate(bayesian_run.recordings)
    position = whole.joints.position + 0.03 * (np.array(a1.joint_names) == "RL_calf_joint")
    path = tmp_path_factory.mktemp("logs") / "moves.mcap"
    save_recording(replace(whole, joints=replace(whole.joints, position=position), events=()), path)
    return path


def test_a_run_is_diagnosed_with_the_commands_that_correct_it(run, capsys):
    assert main(["diagnose", str(run)]) == 1
    printed = capsys.readouterr().out
    assert "unitree_a1: causes of a lean at the stance" in printed
    (line,) = (line for line in printed.splitlines() if line.startswith("payload: "))
    assert line.startswith("payload: mass +")
    assert "set the inertial of link 'trunk' in the model file" in line
    assert line.endswith(f"(equipoise export {run} --to urdf)")
    assert "ruled out: " in printed
    assert "failed checks" not in printed


def test_scripts_get_all_causes_and_commands_that_work(run, capsys):
    assert main(["diagnose", str(run), "--json"]) == 1
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "equipoise.diagnosis/1"
    assert set(table) == {"schema", "robot", "causes", "inseparable", "failed_checks"}
    assert [cause["verdict"] for cause in table["causes"]].count("significant") == 1
    first = {name: value for name, value in table["causes"][0].items() if name != "change"}
    assert set(first) == {"name", "kind", "values", "shift", "bound", "lean", "deviate", "verdict"}
    assert (first["name"], first["lean"]) == ("payload", None)
    kinds = {cause["kind"]: cause["change"] for cause in table["causes"]}
    for kind in ("joint_offset", "imu_level", "payload"):
        command = kinds[kind].partition("(equipoise ")[2].rstrip(")").replace("RUN", str(run))
        assert main([*shlex.split(command), "--quiet"]) == 0
    joint, offsets = kinds["joint_offset"].split()[1], (run / "export" / "joint_offsets.yaml").read_text()
    assert f"{joint}: " in offsets
    assert "imu_tilt" in (run / "export" / "sensors_and_motors.toml").read_text()


def test_a_faulty_joint_is_named_from_a_log(log, capsys):
    assert main(["diagnose", str(log), "--robot", "unitree_a1"]) == 1
    printed = capsys.readouterr().out
    assert "(equipoise export FILE --to joint-offsets --force)" in printed
    assert "To write FILE, use 'equipoise estimate' with --out FILE" in printed
    assert "RL_calf_joint offset: offset +" in printed


@pytest.mark.parametrize(
    ("code", "words", "problem"),
    [
        (5, ["nosuch"], "nosuch"),
        (5, ["LOG"], "--robot"),
        (3, ["LOG", "--robot", "unitre_a1"], "did you mean 'unitree_a1'"),
        (2, ["RUN", "--from", "3s"], "logs of other programs"),
    ],
)
def test_wrong_arguments_are_refused(run, log, capsys, code, words, problem):
    given = [{"RUN": str(run), "LOG": str(log)}.get(word, word) for word in words]
    assert problem in fails(capsys, code, "diagnose", *given)


def test_a_run_of_another_method_is_refused(tmp_path, capsys):
    run = str(tmp_path / "static")
    assert main(["calibrate", "--method", "static", "--quiet", "--no-report", "--out", run]) == 0
    assert "'static' has no posterior" in fails(capsys, 8, "diagnose", run)
