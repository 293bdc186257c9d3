"""Runs on disk: kept as they happen, found again, and estimated again anywhere."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from equipoise.recordings.storage import save_recording
from robots import load_text, quadruped_mjcf

import equipoise
from equipoise import (
    Calibration,
    CalibrationSettings,
    ComSearchSettings,
    RobotDescription,
    RunFolder,
    SwaySettings,
    calibrate,
    simulate,
)
from equipoise.errors import OutputError, RecordingError
from equipoise.estimation.parameters import Priors
from equipoise.experiments.plan import Goals
from equipoise.experiments.precise_routine import PreciseSettings
from equipoise.recordings.recording import Event, ImuStream, JointStream, Recording

SETTINGS = CalibrationSettings("paper", com_search=ComSearchSettings(tolerance=0.01), sway=SwaySettings(duration=1.0))
PROVENANCE = {
    "seed": 2,
    "noise": "realistic",
    "started": "2026-01-02T03:04:05+00:00",
    "payload": [1.5, 0.05, 0.0, 0.06],
}


@pytest.fixture(scope="module")
def calibrated(a1, tmp_path_factory):
    """A run and the calibration that it was kept of."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "run", a1, SETTINGS, PROVENANCE)
    with simulate(a1, "realistic", payload="1.5,0.05,0,0.06", seed=2) as simulation:
        calibration = calibrate(simulation.platform, a1, SETTINGS, keep=folder.keep)
        folder.save_truth(simulation.truth)
    calibration = calibration.with_provenance(**PROVENANCE).with_truth(simulation.truth)
    folder.save(calibration)
    return folder, calibration


@pytest.fixture
def run(calibrated, tmp_path):
    """A copy of the run, to do harm to."""
    return Path(shutil.copytree(calibrated[0].path, tmp_path / "copy"))


def still(kind=None, **about):
    joints = JointStream([0.0, 0.1], np.zeros((2, 12)))
    events = (Event(0.0, "trial", {"kind": kind, **about}),) if kind else ()
    return Recording(tuple("abcdefghijkl"), joints, ImuStream([0.0], np.zeros((1, 3)), np.ones((1, 3))), None, events)


# --- there and back


def test_a_run_is_its_model_its_settings_its_recordings_and_its_result(calibrated):
    folder, calibration = calibrated
    assert {file.name for file in folder.path.iterdir()} == {
        "run.json", "model.xml", "recordings", "truth.json", "calibration.json",
    }  # fmt: skip
    names = sorted(file.name for file in (folder.path / "recordings").iterdir())
    assert len(names) == len(calibration.trials)
    assert names[0] == f"000-lift-{calibration.trials[0].about}.npz"
    assert [name.split("-", 1)[1] for name in names[-3:]] == ["sway-roll.npz", "sway-pitch.npz", "sway-yaw.npz"]


def test_estimating_again_gives_the_same_numbers_bit_for_bit(calibrated):
    folder, calibration = calibrated
    again = RunFolder.open(folder.path).estimate()
    assert again.to_json() == calibration.to_json()
    assert Calibration.load(folder.path / "calibration.json").to_dict() == json.loads(calibration.to_json())


def test_estimating_again_may_take_other_settings(calibrated):
    folder, calibration = calibrated
    commanded = folder.estimate(dataclasses.replace(SETTINGS, feet="commanded"))
    assert commanded.feet == "commanded"
    assert commanded.composite.com_in_base != calibration.composite.com_in_base
    assert commanded.truth is not None


def test_estimating_again_works_where_mujoco_does_not(calibrated):
    folder, calibration = calibrated
    script = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from equipoise import RunFolder\n"
        f"print(RunFolder.open({str(folder.path)!r}).estimate().to_json(), end='')\n"
        "assert not any(name.startswith('equipoise.platforms.mujoco') for name in sys.modules)\n"
    )
    source = str(Path(equipoise.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": source},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.stdout == calibration.to_json()


def test_recordings_come_back_in_order(calibrated):
    folder, _ = calibrated
    recordings = folder.recordings()
    starts = [recording.joints.time[0] for recording in recordings]
    assert starts == sorted(starts)
    assert recordings[0].event("trial").data["kind"] == "lift"


def test_recordings_are_numbered_on_after_a_run_is_opened(tmp_path, a1):
    folder = RunFolder.create(tmp_path / "run", a1, SETTINGS, {})
    folder.keep(still("lift", diagonal="FL_RR"))
    folder.keep(still())
    RunFolder.open(folder.path).keep(still("sway", axis="roll"))
    names = sorted(file.name for file in (folder.path / "recordings").iterdir())
    assert names == ["000-lift-FL_RR.npz", "001-motion.npz", "002-sway-roll.npz"]


def test_settings_come_back(tmp_path, a1):
    settings = CalibrationSettings(
        "paper",
        feet="commanded",
        com_search=ComSearchSettings(-0.04, 0.05, 0.003, 0.02, 0.7, 0.5),
        sway=SwaySettings(0.03, 1.5, 2.0),
        precise=PreciseSettings(60.0, 13.4, 0.05, False, Goals(com_planar=1e-3), Priors(joint_zero=2e-3)),
    )
    path = RunFolder.create(tmp_path / "run", a1, settings, {}).path
    assert RunFolder.open(path).settings() == settings
    path = RunFolder.create(tmp_path / "other", a1, CalibrationSettings(), {}).path
    assert RunFolder.open(path).settings() == CalibrationSettings()


def test_the_robot_comes_back_as_it_was_read(tmp_path):
    description = RobotDescription(
        foot_radius=0.03, imu_position=(0.1, 0.0, 0.02), imu_rpy=(0.0, 0.1, 3.0), kp=90.0, kd=2.5,
        joint_limits={"FL_2": (-2.5, -0.3)}, held={"arm_0": 0.7},
    )  # fmt: skip
    tail = '<actuator><motor joint="FL_1" ctrlrange="-7 7"/></actuator>'
    robot = load_text(tmp_path, quadruped_mjcf(arm=True, tail=tail), description, name="Größe.xml")
    path = RunFolder.create(tmp_path / "run", robot, SETTINGS, {}).path
    (tmp_path / "Größe.xml").unlink()
    again = RunFolder.open(path).robot()
    assert again.name == robot.name
    assert again.description == description
    assert again.source == robot.source
    assert again.held == robot.held
    assert again.joint_names == robot.joint_names
    assert again.feet == robot.feet
    for name in ("lower_limit", "upper_limit", "effort_limit", "velocity_limit"):
        assert np.array_equal(getattr(again, name), getattr(robot, name))
    assert np.array_equal(again.imu_in_base.homogeneous, robot.imu_in_base.homogeneous)
    assert again.pinocchio == robot.pinocchio


def test_what_was_repaired_in_a_model_is_not_said_again(tmp_path, a1_urdf):
    mesh = '<collision><geometry><mesh filename="x.stl"/></geometry></collision></link>'
    robot = load_text(tmp_path, a1_urdf.replace("</link>", mesh, 1))
    assert robot.source.repairs
    path = RunFolder.create(tmp_path / "run", robot, SETTINGS, {}).path
    assert RunFolder.open(path).robot().source.repairs == robot.source.repairs  # warnings are errors here


def test_a_real_robot_has_no_truth(run):
    (run / "truth.json").unlink()
    calibration = RunFolder.open(run).estimate()
    assert calibration.truth is None
    assert calibration.errors() is None


def test_an_interrupted_trial_is_passed_over(run, calibrated):
    recordings = sorted((run / "recordings").iterdir())
    folder = RunFolder.open(run)
    first = folder.recordings()[0]
    cut = first.between(first.joints.time[0], first.joints.time[0] + 0.5)
    save_recording(cut, recordings[-1].with_name("999-lift.npz"))
    assert folder.estimate().to_json() == calibrated[1].to_json()


def test_a_run_without_a_complete_search_says_what_it_lacks(run):
    for recording in (run / "recordings").glob("*FR_RL*"):
        recording.unlink()
    with pytest.raises(RecordingError, match="no complete search on FR_RL with a tolerance of 10 mm: of 0 lifts"):
        RunFolder.open(run).estimate()


# --- where a run may not be


def test_another_run_is_not_overwritten(run, a1):
    before = (run / "run.json").read_bytes()
    with pytest.raises(OutputError) as caught:
        RunFolder.create(run, a1, SETTINGS, {})
    assert str(caught.value) == f"the output folder {str(run)!r} holds another run; name a new one with --out"
    assert (run / "run.json").read_bytes() == before


def test_other_files_are_left_alone(tmp_path, a1):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(OutputError) as caught:
        RunFolder.create(tmp_path, a1, SETTINGS, {})
    assert str(caught.value) == f"the output folder {str(tmp_path)!r} holds other files; name a new one with --out"
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.tex"]


def test_an_empty_folder_is_fine(tmp_path, a1):
    (tmp_path / "run").mkdir()
    assert RunFolder.create(tmp_path / "run", a1, SETTINGS, {}).recordings() == []


@pytest.mark.parametrize("below", ["", "deeper/run"])
def test_a_folder_that_cannot_be_made_is_named(tmp_path, a1, below):
    (tmp_path / "file").write_text("x")
    with pytest.raises(
        OutputError, match=r"cannot write into the output folder '.*file.*': (Not a directory|File exists)"
    ):
        RunFolder.create(tmp_path / "file" / below, a1, SETTINGS, {})


def test_a_run_that_is_gone_cannot_be_written_to(tmp_path, a1, calibrated):
    folder = RunFolder.create(tmp_path / "run", a1, SETTINGS, {})
    shutil.rmtree(folder.path)
    with pytest.raises(OutputError, match=r"cannot write the recording .*000-motion.npz': No such file"):
        folder.keep(still())
    with pytest.raises(OutputError, match=r"cannot write into .*: No such file"):
        folder.save_truth(calibrated[1].truth)
    with pytest.raises(OutputError, match=r"cannot write .*calibration.json': No such file"):
        folder.save(calibrated[1])


# --- damage


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_a_folder_without_a_run_is_no_run(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=rf"'.*{name}' is no run of equipoise: '.*run.json' cannot be read"):
        RunFolder.open(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no run of equipoise: .*run.json' is not JSON"),
        (b'{"schema": ', "is no run of equipoise: .*run.json' is not JSON"),
        (b"\xff\xfe\x00", "is no run of equipoise: .*run.json' is not JSON"),
        (b"[1, 2]", "is no run of equipoise: .*run.json' holds no JSON object"),
        (b"{}", "is None; this version reads 'equipoise.run/1'"),
        (b'{"schema": "equipoise.run/2"}', "is 'equipoise.run/2'; this version reads 'equipoise.run/1'"),
        (b'{"schema": "equipoise.run/1"}', "is damaged: its run.json lacks 'model'"),
    ],
)
def test_a_damaged_header_is_told(run, content, message):
    (run / "run.json").write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        RunFolder.open(run)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("model", None, "its run.json lacks 'model'"),
        ("settings", [1], "its run.json lacks 'settings'"),
        ("provenance", "x", "its run.json lacks 'provenance'"),
        ("description", {"colour": "red"}, "unknown key 'colour'"),
        ("description", {"kp": "strong"}, "is damaged"),
        ("model", {}, "KeyError"),
        ("model", {"repairs": 3}, "is damaged"),
        ("settings", {}, "settings of run .* are damaged: KeyError"),
        (
            "settings",
            {"com_search": {"tolerance": -1}, "sway": {}},
            "settings of run .* are damaged: tolerance is -1; it must be",
        ),
        (
            "settings",
            {"com_search": {"steps": 3}, "sway": {}},
            "settings of run .* unexpected keyword argument 'steps'",
        ),
        ("settings", {"com_search": 3, "sway": {}}, "settings of run .* are damaged"),
        (
            "settings",
            {"method": "best", "com_search": {}, "sway": {}, "precise": {"goals": {}, "priors": {}}},
            "settings of run .* are damaged: method 'best' is",
        ),
    ],
)
def test_a_header_with_damaged_content_is_told(run, key, value, message):
    header = json.loads((run / "run.json").read_text())
    header[key] = value
    (run / "run.json").write_text(json.dumps(header))
    with pytest.raises(RecordingError, match=message):
        RunFolder.open(run).estimate()


@pytest.mark.parametrize("content", [None, "", "<robot", "<robot/>", "<mujoco/>"])
def test_a_damaged_model_is_told(run, content):
    if content is None:
        (run / "model.xml").unlink()
    else:
        (run / "model.xml").write_text(content)
    with pytest.raises(RecordingError, match=r"the run '.*copy' is damaged"):
        RunFolder.open(run).estimate()


def test_a_damaged_recording_is_named(run):
    broken = sorted((run / "recordings").iterdir())[2]
    broken.write_bytes(broken.read_bytes()[:-100])
    with pytest.raises(RecordingError, match=rf"the recording '.*{broken.name}' cannot be read"):
        RunFolder.open(run).estimate()


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"composite": {"mass": 1}}', '{"composite": 3}'])
def test_a_damaged_truth_is_told(run, content):
    (run / "truth.json").write_text(content)
    with pytest.raises(RecordingError, match=r"the run '.*copy' is damaged: .*truth.json"):
        RunFolder.open(run).estimate()


def test_a_half_written_recording_does_not_count(run, calibrated):
    (run / "recordings" / "050-lift.partial").write_bytes(b"PK half")
    assert RunFolder.open(run).estimate().to_json() == calibrated[1].to_json()
