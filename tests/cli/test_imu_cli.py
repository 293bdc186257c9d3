"""IMU pose on the command line: always printed; if unknown, a terminal asks and a script fails."""

import io
import json
import sys

import pytest
from commands import at_a_terminal, fails
from robots import quadruped_urdf

from equipoise import RunFolder
from equipoise.cli import main

BNO = """<link name="bno085"/><joint name="bno085_joint" type="fixed"><origin xyz="0.05 0 0.02"/><parent link="trunk"/>
<child link="bno085"/></joint>"""
ORIGIN = "IMU: at the origin of base link 'trunk' (assumed: no frame of the model looks like an IMU)"
STATIC = ["--method", "static", "--sim-preset", "ideal", "--no-report"]


@pytest.fixture(autouse=True)
def script(monkeypatch):
    """Close the standard input, so that there is no operator."""
    monkeypatch.setattr(sys, "stdin", io.StringIO())


@pytest.fixture
def plain(tmp_path):
    path = tmp_path / "plain.urdf"
    path.write_text(quadruped_urdf())
    return str(path)


@pytest.fixture
def with_bno(tmp_path):
    path = tmp_path / "bno.urdf"
    path.write_text(quadruped_urdf(extra=BNO))
    return str(path)


def streams(capsys):
    captured = capsys.readouterr()
    return " ".join(captured.out.split()), " ".join(captured.err.split())


@pytest.mark.parametrize("verb", [["audit"], ["plan", "--duration", "60s"], ["calibrate", "--dry-run"], ["doctor"]])
def test_verbs_that_move_nothing_state_it(plain, capsys, verb):
    assert main([verb[0], plain, *verb[1:]]) == 0
    assert ORIGIN in streams(capsys)[0]


@pytest.mark.parametrize("verb", [["audit"], ["plan", "--duration", "60s"], ["calibrate", "--dry-run"]])
def test_a_proposed_frame_is_stated_by_verbs_that_use_no_imu(with_bno, capsys, verb):
    assert main([verb[0], with_bno, *verb[1:], "--json"]) == 0
    table = json.loads(capsys.readouterr().out)["imu"]
    assert (table["frame"], table["assumed"], table["proposed"]) == (None, True, ["bno085"])
    assert table["message"].startswith("at the origin of base link 'trunk' (assumed: ")


def test_a_simulated_run_without_an_imu_frame_states_where_the_imu_is(plain, capsys, tmp_path):
    assert main(["calibrate", plain, *STATIC, "--out", str(tmp_path / "run")]) == 0
    out, err = streams(capsys)
    assert ORIGIN in out
    assert ORIGIN in err
    assert RunFolder.open(tmp_path / "run").result().model["imu"] == ORIGIN.removeprefix("IMU: ")


REFUSED = (
    "error: the pose of the IMU is not known: no frame of the model is named imu, and 'bno085' may be the IMU's. "
    "Give --imu-frame bno085 (frames of the base: trunk, bno085), or, if the IMU is at the origin of the base, "
    "--imu-position 0 0 0"
)


@pytest.mark.parametrize("verb", [["calibrate", "--out"], ["doctor", "--duration"]])
def test_a_script_has_to_name_a_proposed_frame(with_bno, capsys, tmp_path, verb):
    value = str(tmp_path / "run") if verb[0] == "calibrate" else "1s"
    assert fails(capsys, 2, verb[0], with_bno, verb[1], value) == REFUSED
    assert not (tmp_path / "run").exists()


def test_a_named_frame_is_used_and_stated(with_bno, capsys, tmp_path):
    out = tmp_path / "run"
    assert main(["calibrate", with_bno, *STATIC, "--imu-frame", "bno085", "--out", str(out)]) == 0
    stated = "IMU: frame 'bno085' (described by imu_frame), at 50.0 0.0 20.0 mm in the base frame"
    assert stated in streams(capsys)[0]
    assert RunFolder.open(out).robot().imu.frame == "bno085"
    assert main(["calibrate", with_bno, *STATIC, "--imu-frame", "trunk", "--out", str(tmp_path / "other")]) == 0


@pytest.mark.parametrize("arguments", [["doctor", "--platform", "ros2"], ["calibrate", "--platform", "ros2", "--yes"]])
def test_on_a_robot_no_pose_is_assumed(plain, capsys, arguments):
    error = fails(capsys, 2, arguments[0], plain, *arguments[1:])
    assert error == (
        "error: the pose of the IMU is not known: no frame of the model looks like an IMU. Give --imu-frame NAME (frames of "
        "the base: trunk), or, if the IMU is at the origin of the base, --imu-position 0 0 0"
    )


def test_a_dry_run_names_the_flags_that_the_run_needs(plain, capsys):
    assert main(["calibrate", plain, "--platform", "ros2", "--method", "static", "--dry-run"]) == 0
    out, err = streams(capsys)
    assert "Nothing was moved." in out
    assert err.endswith(
        "before the run: the pose of the IMU is not known: no frame of the model looks like an IMU. Give --imu-frame NAME "
        "(frames of the base: trunk), or, if the IMU is at the origin of the base, --imu-position 0 0 0"
    )


def test_a_log_has_no_assumed_pose_either(plain, capsys, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time\n0\n")
    assert "the pose of the IMU is not known" in fails(capsys, 2, "estimate", str(log), "--robot", plain)


@pytest.mark.parametrize(
    ("answer", "frame", "position"),
    [("", "bno085", [0.05, 0, 0.02]), ("bno085", "bno085", [0.05, 0, 0.02]), ("origin", None, [0, 0, 0])],
)
def test_an_operator_is_asked(with_bno, tmp_path, answer, frame, position, monkeypatch):
    run, asked, error = answered(with_bno, tmp_path / "run", answer, monkeypatch)
    assert "'bno085' may be the IMU's" in asked
    assert run == 0, error
    imu = RunFolder.open(tmp_path / "run").robot().imu
    assert imu.frame == frame
    assert not imu.is_assumed
    assert imu.placement.translation == pytest.approx(position)


def test_an_answer_that_is_not_a_frame_of_the_base_raises(with_bno, tmp_path, monkeypatch):
    run, _, error = answered(with_bno, tmp_path / "run", "bno08", monkeypatch)
    assert run == 2
    assert "imu_frame is 'bno08', which is not a frame of the base; did you mean 'bno085'?" in error


def answered(robot, out, answer, monkeypatch):
    """Return exit code, question and the rest of stderr of a calibration with an operator."""
    command = ["calibrate", robot, *STATIC, "--quiet", "--out", str(out)]
    asked, error, code = at_a_terminal(command, "origin of the base", answer, monkeypatch)
    return code, " ".join(asked.split()), error
