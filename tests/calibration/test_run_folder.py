"""Run folders."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from robots import load_text, quadruped_mjcf
from rosbags.highlevel import AnyReader

import equipoise
from equipoise import (
    BayesianMethod,
    Calibration,
    ComSearchSettings,
    ExcitationSettings,
    PaperMethod,
    RobotDescription,
    RunFolder,
    calibrate,
    simulate,
)
from equipoise.bayesian.goals import Goals
from equipoise.errors import FallError, OutputError, RecordingError
from equipoise.estimator.unknowns import Priors
from equipoise.lab.static.method import Static
from equipoise.platform.logged_platform import Logged
from equipoise.recording.recording import Event, ImuStream, JointStream, Recording
from equipoise.recording.run_log import RunLog

SETTINGS = PaperMethod(com_search=ComSearchSettings(tolerance=0.01), excitation=ExcitationSettings(duration=1.0))
PROVENANCE = {
    "seed": 2,
    "sim_preset": "realistic",
    "started": "2026-01-02T03:04:05+00:00",
    "payload": [1.5, 0.05, 0.0, 0.06],
}


@pytest.fixture(scope="module")
def calibrated(a1, tmp_path_factory):
    """Run folder and its calibration."""
    with (
        RunFolder.create(tmp_path_factory.mktemp("runs") / "run", a1, SETTINGS, PROVENANCE) as folder,
        simulate(a1, "realistic", payload="1.5,0.05,0,0.06", seed=2) as simulation,
    ):
        calibration = calibrate(Logged(simulation.platform, folder.log), a1, SETTINGS, keep=folder.keep)
        folder.save_truth(simulation.truth)
    calibration = calibration.with_provenance(**PROVENANCE).with_truth(simulation.truth)
    folder.save(calibration)
    return folder, calibration


@pytest.fixture
def run(calibrated, tmp_path):
    """Copy of the run that a test may damage."""
    return Path(shutil.copytree(calibrated[0].path, tmp_path / "copy"))


@pytest.fixture
def new(tmp_path, a1):
    """Factory of run folders without recordings."""

    def make(robot=a1, settings=SETTINGS, name="run"):
        with RunFolder.create(tmp_path / name, robot, settings, {}) as folder:
            return folder

    return make


def still(kind=None, time=0.0, **about):
    joints = JointStream([time, time + 0.1], np.zeros((2, 12)))
    events = (Event(time, "trial", {"kind": kind, **about}),) if kind else ()
    return Recording(tuple("abcdefghijkl"), joints, ImuStream([time], np.zeros((1, 3)), np.ones((1, 3))), None, events)


def rewritten(run, choose):
    """Rewrite a run's log with a selection of its recordings."""
    recordings = [recording for recording in RunFolder.open(run).recordings() if choose(recording)]
    (run / "recording_0.mcap").unlink()
    with RunLog(run / "recording_0.mcap") as log:
        for recording in recordings:
            log.keep(recording)


# --- write and read


def test_a_run_has_model_settings_recordings_and_result(calibrated):
    folder, calibration = calibrated
    assert {file.name for file in folder.path.iterdir()} == {
        "run.json", "model.xml", "recording_0.mcap", "metadata.yaml", "truth.json", "calibration.json",
    }  # fmt: skip
    trials = [recording.trial for recording in folder.recordings()]
    assert len(trials) == len(calibration.trials)
    assert trials[0].diagonal == calibration.trials[0].about
    assert [trial.about for trial in trials[-3:]] == ["roll", "pitch", "yaw"]


def test_a_run_folder_is_a_bag_for_ros(calibrated):
    folder, _ = calibrated
    with AnyReader([folder.path]) as bag:
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
        states = next(connection for connection in bag.connections if connection.topic == "/joint_states")
        _, time, raw = next(bag.messages([states]))
        first = bag.deserialize(raw, states.msgtype)
    plays = folder.read().plays
    samples = sum(len(play.recording.joints.time) for play in plays)
    assert counts["/joint_states"] == counts["/imu/data"] == counts["/joint_commands"] == samples
    assert tuple(first.name) == plays[0].recording.joint_names
    assert np.array_equal(first.position, plays[0].recording.joints.position[0])
    assert time == 0


def test_repeated_estimates_are_equal(calibrated):
    folder, calibration = calibrated
    again = RunFolder.open(folder.path).estimate()
    assert again.to_json() == calibration.to_json()
    assert Calibration.load(folder.path / "calibration.json").to_dict() == json.loads(calibration.to_json())


def test_runs_can_be_estimated_with_other_settings(calibrated):
    folder, calibration = calibrated
    commanded = folder.estimate(dataclasses.replace(SETTINGS, feet="commanded"))
    assert commanded.feet == "commanded"
    assert commanded.composite.com_in_base != calibration.composite.com_in_base
    assert commanded.truth is not None


def test_runs_are_estimated_without_mujoco(calibrated):
    folder, calibration = calibrated
    script = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from equipoise import RunFolder\n"
        f"print(RunFolder.open({str(folder.path)!r}).estimate().to_json(), end='')\n"
        "assert not any(name.startswith('equipoise.simulation.mujoco') for name in sys.modules)\n"
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
    assert recordings[0].trial.kind == "lift"


def test_an_opened_run_is_read_only(new):
    folder = RunFolder.open(new().path)
    with pytest.raises(OutputError, match="is not open for writing; create a new one, or resume it"):
        folder.keep(still())


def test_recordings_are_stored_immediately(tmp_path, a1):
    with RunFolder.create(tmp_path / "run", a1, SETTINGS, {}) as folder:
        assert folder.recordings() == []
        for count in range(1, 4):
            folder.keep(still("lift", float(count)))
            assert len(folder.recordings()) == count
        folder.keep(still("lift", 9.0).broken_off())
        assert len(folder.recordings()) == 3
        assert folder.read().unfinished.joints.time[0] == 9.0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), FallError("x")])
def test_a_run_that_ends_early_is_closed(tmp_path, a1, error):
    def run():
        with RunFolder.create(tmp_path / "run", a1, SETTINGS, {}) as folder:
            folder.keep(still())
            raise error

    with pytest.raises(type(error)):
        run()
    folder = RunFolder.open(tmp_path / "run")
    assert folder.read().closed
    assert (folder.path / "metadata.yaml").exists()


@pytest.mark.parametrize(
    "method",
    [
        BayesianMethod(),
        BayesianMethod(
            60.0,
            13.4,
            0.05,
            False,
            False,
            "heavy",
            "narrow",
            "carpet",
            Goals(com_planar=1e-3),
            Priors(joint_offset=2e-3, compliance=0.0),
        ),
        PaperMethod(
            feet="commanded",
            com_search=ComSearchSettings(-0.04, 0.05, 0.003, 0.02, 0.7, 0.5),
            excitation=ExcitationSettings(0.03, 1.5, 2.0),
        ),
        Static(),
    ],
    ids=repr,
)
def test_settings_come_back(new, method):
    assert RunFolder.open(new(settings=method).path).method() == method


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"method": "magic"}, "method 'magic' is unknown; it must be one of bayesian, paper, motors"),
        ({"method": "bayesian", "duration": "long"}, "duration is 'long'; it must be a number"),
        ({"method": "bayesian", "duration": -1}, "duration is -1 s; it must be above zero, up to 3600 s"),
        ({"method": "paper", "com_search": 3}, "com_search is 3; it must be a table"),
        ({"method": "paper", "com_search": {"steps": 3}}, "unknown key 'com_search.steps'; known are lower"),
        ({"method": "paper", "com_search": {"tolerance": [1]}}, r"com_search.tolerance is \[1\]; it must be a number"),
        ({"method": "paper", "com_search": {"tolerance": -1}}, "tolerance is -1.0; it must be"),
        ({"method": "paper", "feet": "guessed"}, "feet is 'guessed'; it must be 'measured'"),
    ],
)
def test_damaged_settings_are_rejected(new, settings, words):
    path = new().path
    header = json.loads((path / "run.json").read_text(encoding="utf-8"))
    (path / "run.json").write_text(json.dumps({**header, "settings": settings}), encoding="utf-8")
    with pytest.raises(RecordingError, match=f"the settings of run .* are damaged: {words}"):
        RunFolder.open(path).estimate()


def test_the_robot_comes_back_as_it_was_read(tmp_path, new):
    description = RobotDescription(
        foot_radius=0.03, imu_position=(0.1, 0.0, 0.02), imu_rpy=(0.0, 0.1, 3.0), kp=90.0, kd=2.5,
        joint_limits={"FL_2": (-2.5, -0.3)}, locked_joints={"arm_0": 0.7},
    )  # fmt: skip
    tail = '<actuator><motor joint="FL_1" ctrlrange="-7 7"/></actuator>'
    robot = load_text(tmp_path, quadruped_mjcf(arm=True, tail=tail), description, name="Größe.xml")
    path = new(robot).path
    (tmp_path / "Größe.xml").unlink()
    again = RunFolder.open(path).robot()
    assert again.name == robot.name
    assert again.description == description
    assert again.source == robot.source
    assert again.locked_joints == robot.locked_joints
    assert again.joint_names == robot.joint_names
    assert again.legs == robot.legs
    for name in ("lower_limit", "upper_limit", "effort_limit", "velocity_limit"):
        assert np.array_equal(getattr(again, name), getattr(robot, name))
    assert np.array_equal(again.imu_in_base.homogeneous, robot.imu_in_base.homogeneous)
    assert again.pinocchio == robot.pinocchio


def test_repairs_of_a_model_are_not_reported_again(tmp_path, a1_urdf, new):
    mesh = '<collision><geometry><mesh filename="x.stl"/></geometry></collision></link>'
    robot = load_text(tmp_path, a1_urdf.replace("</link>", mesh, 1))
    assert robot.source.repairs
    path = new(robot).path
    assert RunFolder.open(path).robot().source.repairs == robot.source.repairs  # warnings are errors here


def test_a_real_robot_has_no_truth(run):
    (run / "truth.json").unlink()
    calibration = RunFolder.open(run).estimate()
    assert calibration.truth is None
    assert calibration.composite.com_in_base.x.error is None
    assert calibration.to_dict()["errors"] is None


def test_an_interrupted_trial_is_ignored(run, calibrated):
    recordings = calibrated[0].recordings()
    start = recordings[0].joints.time[0]
    (run / "recording_0.mcap").unlink()
    with RunLog(run / "recording_0.mcap") as log:
        for recording in (*recordings, recordings[0].between(start, start + 0.5).broken_off()):
            log.keep(recording)
    folder = RunFolder.open(run)
    assert folder.read().unfinished.duration < 0.5
    assert folder.estimate().to_json() == calibrated[1].to_json()


def test_a_run_without_a_complete_search_is_rejected(run):
    rewritten(run, lambda recording: recording.trial.about != "FR_RL")
    with pytest.raises(RecordingError, match="no complete search on FR_RL with a tolerance of 10 mm: of 0 lifts"):
        RunFolder.open(run).estimate()


# --- output folders


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
    with RunFolder.create(tmp_path / "run", a1, SETTINGS, {}) as folder:
        assert folder.recordings() == []


@pytest.mark.parametrize("below", ["", "deeper/run"])
def test_a_folder_that_cannot_be_made_is_named(tmp_path, a1, below):
    (tmp_path / "file").write_text("x")
    with pytest.raises(
        OutputError,
        match=r"cannot write into the output folder '.*file.*': (Not a directory|File exists); name another",
    ):
        RunFolder.create(tmp_path / "file" / below, a1, SETTINGS, {})


def test_a_deleted_run_cannot_be_written(new, calibrated):
    folder = new()
    shutil.rmtree(folder.path)
    with pytest.raises(OutputError, match=r"cannot write .*truth.json': No such file"):
        folder.save_truth(calibrated[1].truth)
    with pytest.raises(OutputError, match=r"cannot write .*calibration.json': No such file"):
        folder.save(calibrated[1])
    with pytest.raises(RecordingError, match=r"run' cannot be read: No such file"):
        folder.recordings()


@pytest.mark.parametrize("raised", [True, False])
def test_a_deleted_run_raises_on_close_unless_another_error_is_raised(tmp_path, a1, raised):
    def run():
        with RunFolder.create(tmp_path / "run", a1, SETTINGS, {}) as folder:
            shutil.rmtree(folder.path)
            if raised:
                raise FallError("x")

    with pytest.raises(FallError if raised else OutputError):
        run()


def test_the_header_is_written_last(tmp_path, a1, monkeypatch):
    seen = []
    replace = Path.replace

    def looked(self, target):
        seen.append((target.name, {file.name for file in target.parent.iterdir() if not file.name.startswith(".")}))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", looked)
    with RunFolder.create(tmp_path / "run", a1, SETTINGS, {}):
        assert seen == [("model.xml", set()), ("run.json", {"model.xml", "recording_0.mcap"})]


# --- resumed runs


def test_a_resumed_run_replays_its_recordings_and_adds_more(run, calibrated):
    expected = calibrated[0].recordings()
    rewritten(run, lambda recording: recording.joints.time[0] < expected[3].joints.time[0])
    folder, content = RunFolder.resume(run, repeats=True)
    with folder:
        assert len(content.recordings) == 3
        assert not (run / "metadata.yaml").exists()  # the recordings will change
        for recording in expected:
            folder.keep(recording)
    assert (run / "metadata.yaml").exists()
    assert all(one.equals(other) for one, other in zip(folder.recordings(), expected, strict=True))
    assert folder.estimate().to_json() == calibrated[1].to_json()


def test_an_incomplete_recording_does_not_replace_a_stored_one(run, calibrated):
    folder, content = RunFolder.resume(run, repeats=True)
    with folder:
        folder.keep(content.recordings[0])
        folder.keep(content.recordings[1].broken_off())  # Ctrl-C during the replay
    assert len(folder.recordings()) == len(content.recordings)


def test_a_run_is_complete_when_it_has_a_result(run):
    assert RunFolder.open(run).complete
    (run / "calibration.json").unlink()
    assert not RunFolder.open(run).complete


# --- damage


@pytest.mark.parametrize(("name", "kind"), [("missing", "does not exist"), ("empty", "is a folder without run.json")])
def test_a_folder_without_a_run_is_rejected(tmp_path, name, kind):
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=rf"'.*{name}' {kind}; name the run folder of a calibration"):
        RunFolder.open(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a run folder of a calibration: .*run.json' is not JSON"),
        (b'{"schema": ', "is not a run folder of a calibration: .*run.json' is not JSON"),
        (b"\xff\xfe\x00", "is not a run folder of a calibration: .*run.json' is not JSON"),
        (b"[1, 2]", "is not a run folder of a calibration: .*run.json' is not a JSON object"),
        (b"{}", "is damaged: its run.json lacks 'schema'; copy it again from an intact run folder"),
        (b'{"schema": [2]}', r"is \[2\]; this version reads 'equipoise.run/1'"),
        (
            b'{"schema": "equipoise.run/3"}',
            "is 'equipoise.run/3'; this version reads 'equipoise.run/1': it was made by an earlier version; record or "
            "estimate again$",
        ),
        (b'{"schema": "equipoise.run/1"}', "is damaged: its run.json lacks 'model'"),
    ],
)
def test_a_damaged_header_is_reported(run, content, message):
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
        ("settings", {}, "settings of run .* are damaged: method 'None' is unknown"),
    ],
)
def test_a_header_with_damaged_content_is_reported(run, key, value, message):
    header = json.loads((run / "run.json").read_text())
    header[key] = value
    (run / "run.json").write_text(json.dumps(header))
    with pytest.raises(RecordingError, match=message):
        RunFolder.open(run).estimate()


@pytest.mark.parametrize("content", [None, "", "<robot", "<robot/>", "<mujoco/>"])
def test_a_damaged_model_is_reported(run, content):
    if content is None:
        (run / "model.xml").unlink()
    else:
        (run / "model.xml").write_text(content)
    with pytest.raises(RecordingError, match=r"the run '.*copy' is damaged: its .*model.xml .*; copy it again from an"):
        RunFolder.open(run).estimate()


@pytest.mark.parametrize("missing", [1, 99])
def test_a_cut_recording_is_reported(run, missing):
    (run / "recording_0.mcap").write_bytes((run / "recording_0.mcap").read_bytes()[:-missing])
    folder = RunFolder.open(run)
    with pytest.warns(
        UserWarning,
        match=r"lack motions that the stored calibration.json is estimated from.* copy recording_0.mcap again",
    ):
        folder.recordings()
    with pytest.warns(UserWarning, match="ends in the middle: it was cut"):
        assert folder.shown().to_json() == folder.result().to_json()
    (run / "calibration.json").unlink()
    with pytest.warns(UserWarning, match="was killed, or is not over; resume it: equipoise calibrate --resume"):
        assert folder.shown().to_json() == folder.estimate().to_json()


def test_a_damaged_recording_is_reported(run):
    content = bytearray((run / "recording_0.mcap").read_bytes())
    content[len(content) // 2] ^= 8
    (run / "recording_0.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"the recording '.*recording_0.mcap' is damaged: "):
        RunFolder.open(run).estimate()


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"composite": {"mass": 1}}', '{"composite": 3}'])
def test_a_damaged_truth_is_reported(run, content):
    (run / "truth.json").write_text(content)
    with pytest.raises(RecordingError, match=r"the run '.*copy' is damaged: .*truth.json"):
        RunFolder.open(run).estimate()
