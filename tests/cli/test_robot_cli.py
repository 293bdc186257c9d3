"""Verbs for robots, against an emulator in its own process over UDP."""

import dataclasses
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import groupby

import numpy as np
import pytest
from emulator_processes import free_port, running_emulator

from equipoise import BayesianMethod, RunFolder, nominal_stance
from equipoise.calibration.rehearsal import rehearse
from equipoise.cli import main
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.packet_formats import FORMS
from equipoise.lab.static.method import Static
from equipoise.recording.run_log_reader import read_log
from equipoise.robot.stance import lies
from equipoise.terminal.robot_reports import print_checkup, print_rehearsal

EQUIPOISE = [sys.executable, "-m", "equipoise"]
STATIC = ["--method", "static", "--quiet", "--yes", "--no-report"]


@contextmanager
def robot(*flags, protocol="go1"):
    """Yield an emulated Go1 or A1, and the flags for it."""
    port = free_port()
    with running_emulator("unitree-udp", "--protocol", protocol, "--port", port, *flags) as peer:
        found = [f"robot=127.0.0.1,port={port}", f"local_port={free_port()}", "silence=5"]
        pairs = [pair for part in found for pair in part.split(",")]
        yield peer, ["--platform", f"unitree-{protocol}", *(flag for pair in pairs for flag in ("--set", _named(pair)))]


def sunk():
    """Wait until the limp robot has sunk to the floor, where a calibration begins."""
    time.sleep(3.0)


def _named(pair):
    key, value = pair.split("=")
    return f"{ {'robot': 'address'}.get(key, key) }={value}"


@pytest.mark.realtime
@pytest.mark.parametrize(("protocol", "form"), [(robot, list(forms)[-1]) for robot, forms in FORMS.items()])
def test_the_doctor_moves_nothing_with_each_packet_form(protocol, form, capsys):
    with robot("--form", form, protocol=protocol) as (peer, flags):
        code = main(["doctor", *flags, "--duration", "1s", "--json"])
        table = json.loads(capsys.readouterr().out)
    assert code in (0, 1)  # a busy machine's samples come late, which the doctor reports
    assert {finding["name"] for finding in table["findings"]} >= {"joint samples", "gravity against the stance"}
    assert len(table["joints"]) == 12
    assert not any(entry.get("mode") == "commanded" for entry in peer.log)


def test_the_doctor_shows_the_gains_and_those_of_the_manufacturer(a1, capsys):
    print_checkup(a1, "unitree-go2", [], [])
    shown = " ".join(capsys.readouterr().out.split())
    assert "unitree_a1 on unitree-go2: joint map" in shown
    assert re.search(
        r"Joint gains: \d+ Nm/rad and \d+\.\d Nm s/rad; .* The manufacturer's example uses 60 and 5;", shown
    )
    print_checkup(a1, "mujoco", [], [])
    assert "Gains" not in capsys.readouterr().out


@pytest.mark.realtime
def test_recording_moves_nothing_and_leaves_a_log(tmp_path, capsys):
    path = tmp_path / "still.mcap"
    with robot() as (peer, flags):
        assert main(["record", *flags, "--duration", "1s", "--out", str(path), "--quiet"]) == 0
    assert str(path) in capsys.readouterr().out
    assert len(read_log(path).plays[0].recording.joints.time) > 100
    assert not any(entry.get("mode") == "commanded" for entry in peer.log)
    assert main(["record", "--duration", "1s", "--out", str(path)]) == 6
    assert "exists; name a new file with --out" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["doctor", "record"])
def test_a_silent_robot_raises_and_leaves_no_file(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(HardwarePlatform.__init__, "__defaults__", (0.2,))
    flags = ["--set", "address=127.0.0.1", "--set", f"port={free_port()}", "--set", f"local_port={free_port()}"]
    assert main([verb, "--platform", "unitree-go1", *flags]) == 10
    assert capsys.readouterr().err.endswith("is this the right network interface?\n")
    assert not [*tmp_path.rglob("*.mcap")]


@pytest.mark.realtime
def test_a_calibration_ends_with_the_robot_lying_damped_and_released(tmp_path, capsys):
    out = tmp_path / "run"
    with robot("--start", "lying") as (peer, flags):
        sunk()
        code = main(["calibrate", *flags, *STATIC, "--out", str(out)])
        time.sleep(0.5)
    printed = capsys.readouterr()
    assert code == 0, printed.err
    modes = [entry["mode"] for entry in peer.log if "mode" in entry]
    assert "lying" not in printed.out
    assert modes[modes.index("commanded") :][:3] == ["commanded", "damped", "released"]
    provenance = RunFolder.open(out).provenance
    assert provenance["platform"] == "unitree-go1"
    assert len(RunFolder.open(out).recordings()) == 1


@pytest.mark.realtime
def test_nothing_moves_unless_the_robot_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO("no\n"))
    with robot("--start", "lying") as (peer, flags):
        code = main(["calibrate", *flags, "--method", "static", "--out", str(tmp_path / "run")])
    printed = capsys.readouterr().err
    assert code == 2
    assert "Type unitree_a1 to begin" in printed
    assert "not confirmed, nothing was moved" in printed
    assert not any(entry.get("mode") == "commanded" for entry in peer.log)
    assert not (tmp_path / "run").exists()


@pytest.mark.realtime
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_a_program_that_is_killed_leaves_a_damped_robot(tmp_path):
    """The packets have the less likely form. The robot process lowers the robot under control."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    with robot("--start", "lying", "--form", "scrambled") as (peer, flags):
        sunk()
        command = [*EQUIPOISE, "calibrate", *flags, *STATIC, "--out", str(tmp_path / "run")]
        with subprocess.Popen(command, env=environment) as process:
            peer.wait_for("mode", "commanded")
            time.sleep(1.0)
            assert process.poll() is None
            process.kill()
        peer.wait_for("mode", "released")
        modes = [entry["mode"] for entry in peer.log if "mode" in entry]
    after = [mode for mode, _ in groupby(mode for mode in modes[modes.index("commanded") :] if mode != "silence")]
    assert after[:3] == ["commanded", "damped", "released"], peer.log


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--platform", "unitree-go2", "--sim-preset", "ideal"], "--sim-preset is for simulators; unitree-go2 is not"),
        (["--set", "interface=lo"], "--set is for real robots; mujoco is not"),
    ],
)
def test_flags_of_another_platform_are_refused(arguments, message, capsys):
    assert main(["calibrate", "--quiet", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_dry_run_moves_nothing_and_prints_the_plan(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "--platform", "unitree-go2", "--method", "paper", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    for words in (
        "unitree_a1 on unitree-go2: method paper",
        "excitation about yaw",
        "FL_hip_joint",
        "Nothing was moved.",
    ):
        assert words in printed
    assert "Joint gains: 60 Nm/rad and 5.0 Nm s/rad" in printed, "those that the run will command"
    assert main(["calibrate", "--method", "paper", "--dry-run", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "equipoise.rehearsal/1"
    assert table["joints"]["FL_hip_joint"]["torque"] < table["joints"]["FL_hip_joint"]["torque_limit"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("flags", "first", "time", "around"),
    [
        ("--duration 60s", ["nominal stance"], 60, ""),
        ("--duration 60s --start lying", ["lying", "nominal stance"], 72, ", with checks, standing up and lying down"),
        ("--parameters motors", ["nominal stance", "lying", "legs up, middle"], 22, ""),
    ],
)
def test_a_dry_run_begins_with_the_posture_of_the_start(flags, first, time, around, capsys):
    assert main(["calibrate", *flags.split(), "--dry-run", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert [posture["what"] for posture in table["postures"]][: len(first)] == first
    assert table["duration"] == pytest.approx(time, abs=1)
    assert main(["calibrate", *flags.split(), "--dry-run"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert f", about {time} s{around}. The robot {'is checked, stands up' if around else 'stands'}, " in printed
    assert ("from lying until it lies again" in printed) == bool(around)


def test_a_dry_run_counts_lifts_and_names_each_posture_once(a1, capsys):
    rehearsal = rehearse(a1, BayesianMethod(duration=60), standing=True)
    plan = BayesianMethod(duration=60).forecast(a1, nominal_stance(a1))
    lifts = [posture for posture in rehearsal.postures if "two feet up" in posture.what]
    assert [lift.what.partition(":")[0] for lift in lifts[:4]] == ["search, nominal"] * 4
    assert sum(lift.times for lift in lifts) == plan.lifts + 4
    assert f"lifts two diagonal feet {plan.lifts + 4} times" in rehearsal.course.doing
    assert rehearsal.duration == plan.robot_time
    assert plan.trials()[-1][0] == "excitation about all axes"
    print_rehearsal(rehearsal, "mujoco")
    printed = " ".join(capsys.readouterr().out.split())
    assert printed.count("excitation about yaw") == 1
    assert "The run plans again from what it measures, so its postures may differ from these." in printed
    assert f"for its mass of {a1.mass:.1f} kg at rest: a payload and motion add torque." in printed


def test_a_crouch_of_a_run_is_not_listed_as_lying(two_jointed):
    rehearsal = rehearse(two_jointed, BayesianMethod(duration=120), standing=True)
    low = [lies(two_jointed, nominal_stance(two_jointed), posture.joint_position) for posture in rehearsal.postures]
    assert any(low)
    assert "lying" not in [posture.what for posture in rehearsal.postures]


def test_a_run_that_is_rotated_halfway_lies_down(a1):
    rehearsal = rehearse(a1, BayesianMethod(duration=60, rotate_halfway=True), standing=True)
    assert [posture.what for posture in rehearsal.postures][:2] == ["nominal stance", "lying"]


@pytest.mark.parametrize(
    ("joints", "largest", "row"),
    [
        (12, r"Nm at \w+, which has no plausible limit in the model file\.", r"\d\.\d Nm, no limit, at"),
        (11, r"Nm at RR_calf_joint, \d+% of its limit\.", r"\d+% at RR_calf_joint"),
    ],
    ids=["no joint has a limit", "one has"],
)
def test_a_dry_run_marks_joints_without_a_torque_limit(a1, joints, largest, row, capsys):
    rehearsal = rehearse(a1, Static())
    limit = np.array([*joints * [np.inf], *a1.effort_limit[joints:]])
    print_rehearsal(dataclasses.replace(rehearsal, robot=dataclasses.replace(a1, effort_limit=limit)), "mujoco")
    printed = capsys.readouterr().out
    assert "inf" not in printed
    assert len(re.findall(r"\d, no limit *$", printed, re.MULTILINE)) == joints
    assert re.search(largest, " ".join(printed.split()))
    assert re.search(row, printed)


def test_recording_prints_its_path_without_a_terminal(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["record", "--duration", "1s", "--out", "here.mcap"]) == 0
    assert capsys.readouterr().err.startswith("recording into here.mcap for 1 s\n")
    assert main(["record", "--duration", "1s", "--out", "there.mcap", "--quiet"]) == 0
    assert "recording into" not in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["record", "doctor"])
def test_a_duration_of_zero_raises(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([verb, "--duration", "0s"]) == 2
    assert "--duration is 0s; give a positive time such as 10s" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["record", "report"])
def test_a_mistyped_path_creates_no_folder(verb, tmp_path, capsys):
    run, out = tmp_path / "run", tmp_path / "lgos" / "new" / "file"
    arguments = ["--duration", "1s"]
    if verb == "report":
        assert main(["calibrate", "--method", "static", "--quiet", "--no-report", "--out", str(run)]) == 0
        arguments = [str(run)]
    assert main([verb, *arguments, "--out", str(out)]) == 6
    assert f"{str(out)!r}: No such file or directory; check " in capsys.readouterr().err
    assert not (tmp_path / "lgos").exists()


def test_a_recording_goes_into_logs_by_default(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["record", "--duration", "1s", "--quiet"]) == 0
    (log,) = (tmp_path / "logs").iterdir()
    assert str(log.relative_to(tmp_path)) in capsys.readouterr().out
    assert main(["record", "--duration", "1s", "--quiet", "--out", "on the floor.mcap"]) == 0
    assert "equipoise estimate 'on the floor.mcap' --robot unitree_a1\n" in capsys.readouterr().err


def test_platforms_are_listed_with_their_settings(capsys):
    assert main(["platforms", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in table["platforms"]] == [
        "unitree-go2",
        "unitree-b2",
        "ros2",
        "unitree-a1",
        "unitree-go1",
    ]
    assert main(["platforms"]) == 0
    assert "docs/hardware/unitree-go2-b2.md" in capsys.readouterr().out


def test_a_simulated_robot_is_recorded_for_ten_seconds(tmp_path, capsys):
    out = tmp_path / "log.mcap"
    assert main(["record", "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joint_samples"] == pytest.approx(5000, abs=5)
