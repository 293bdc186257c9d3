"""Recipes of CONTRIBUTING: other packages add a platform, a driver, a format, a reader."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exporting import found

from equipoise import BayesianMethod, Guard, JointCommand, RunFolder, nominal_stance
from equipoise.cli import main
from equipoise.drivers import platforms
from equipoise.drivers.platforms import open_platform
from equipoise.errors import CommunicationError, MissingDependencyError, MotionError, SettingsError
from equipoise.exports import formats
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.logs import reader

OUTSIDE = Path(__file__).parent / "outside"
STATIC = ["--method", "static", "--yes", "--quiet", "--no-report"]


@pytest.fixture
def installed(monkeypatch):
    """Add packages of tests/outside to the path of Python and of the programs that it starts."""
    tables = (platforms.PLATFORMS, formats._ALL, reader.READERS)

    def forget():
        for table in tables:
            vars(table).pop("_added", None)

    def install(*names):
        paths = [str(OUTSIDE / name) for name in names]
        for path in paths:
            monkeypatch.syspath_prepend(path)
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*paths, os.environ.get("PYTHONPATH", "")]))
        forget()

    yield install
    forget()
    for name in [name for name in sys.modules if name.startswith("outside_")]:
        del sys.modules[name]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Write a module into the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)

    def write(name, text):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")

    yield write
    for name in set(sys.modules) - before:
        if "." not in name and (tmp_path / f"{name}.py").exists():
            del sys.modules[name]


def calibrated(out, *flags):
    code = main(["calibrate", *flags, *STATIC, "--out", str(out)])
    return code, RunFolder.open(out) if code == 0 else None


@pytest.mark.realtime
@pytest.mark.parametrize("platform", ["outside-robot", "outside_platform:Robot"])
def test_a_users_class_is_a_platform_in_every_verb(installed, here, tmp_path, capsys, platform):
    if ":" in platform:
        here("outside_platform", (OUTSIDE / "platform" / "outside_platform.py").read_text(encoding="utf-8"))
    else:
        installed("platform")
    flags = ["--platform", platform]
    assert main(["calibrate", *flags, "--method", "static", "--dry-run"]) == 0
    assert f"unitree_a1 on {platform}: method static" in capsys.readouterr().out
    assert main(["doctor", *flags, "--duration", "1s", "--json"]) == 0
    assert {row["name"] for row in json.loads(capsys.readouterr().out)["findings"]} >= {"joint samples", "IMU samples"}
    assert main(["record", *flags, "--duration", "1s", "--out", "log.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joint_samples"] == pytest.approx(500, abs=5)
    code, folder = calibrated(tmp_path / "run", *flags, "--set", "preset=realistic", "--set", "seed=3")
    assert code == 0
    assert folder.provenance["platform"] == platform
    assert folder.provenance["platform_settings"] == {"preset": "realistic", "seed": "3"}
    guard = folder.result().provenance["guard"]
    assert guard["commands"] > 100
    assert guard["ending"][-1] == "released"
    assert folder.result().composite.mass.value == pytest.approx(12.458, rel=0.1)


def test_platforms_lists_what_packages_add_with_their_settings(installed, capsys):
    installed("platform", "driver")
    assert main(["platforms", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["platforms"]}
    assert rows["outside-robot"]["what"] == "Robot that is moved step by step."
    assert rows["outside-robot"]["settings"] == [["preset", "text", "ideal"], ["seed", "a whole number", 0]]
    assert rows["outside-bus"]["start"] == "lie it down, switch it on"
    assert rows["outside-bus"]["settings"] == [["node", "a whole number", 1], ["diary", "text", ""]]
    assert main(["platforms"]) == 0
    assert "outside-bus: robots on another vendor's bus" in capsys.readouterr().out


@pytest.mark.realtime
def test_a_users_platform_plays_by_stepping_and_is_guarded(installed, a1):
    installed("platform")
    stand = JointCommand(nominal_stance(a1).joint_position)
    with RemoteRobot("outside-robot", a1, {}) as remote:
        assert "has no second connection" in remote.warning
        assert remote.step(stand).joint_position.shape == (12,)
    assert remote.report().ending[-1] == "released"
    from outside_platform import Robot  # noqa: PLC0415 - installed by the fixture

    with Robot(a1) as robot, Guard(robot, a1) as guard:
        guard.step(stand)


MINE = """
from equipoise import SteppedPlatform

class Mine(SteppedPlatform):
    control_period = 2e-3
    def __init__(self, robot, port):
        super().__init__(robot)
        {made}
    def read(self):
        {read}
    def step(self, command): ...
    def close(self): ...

class NoStep(SteppedPlatform):
    def read(self): ...
    def close(self): ...

class NoPeriod:
    def __init__(self, robot): ...
    read = step = close = __init__

NOTHING = 3
"""


def mine(made="pass", read="pass"):
    return MINE.format(made=made or "pass", read=read)


@pytest.mark.parametrize(
    ("platform", "kind", "message"),
    [
        ("his:Mine", SettingsError, "platform 'his:Mine': module 'his' does not exist, neither in "),
        (
            "mine:Mein",
            SettingsError,
            "the module 'mine' has no 'Mein'; did you mean 'Mine'? its classes are Mine, NoStep",
        ),
        (
            "mine:NoStep",
            MissingDependencyError,
            "the class 'NoStep' lacks step; a platform has read, step, close and control_period",
        ),
        (
            "mine:NOTHING",
            MissingDependencyError,
            "platform 'mine:NOTHING' is of type int; it must be a class, or a Driver",
        ),
        ("mine:NoPeriod", MissingDependencyError, "its control_period is None; it must be a time [s] above zero"),
        (
            "broken:Mine",
            MissingDependencyError,
            "the module 'broken' fails when it is imported (ZeroDivisionError: division by zero)",
        ),
    ],
)
def test_other_objects_are_refused_as_platforms(here, a1, platform, kind, message):
    here("mine", mine())
    here("broken", "1 / 0")
    with pytest.raises(kind) as caught:
        open_platform(platform, a1, {})
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("made", "given", "kind", "message"),
    [
        ("", {}, SettingsError, "platform 'mine:Mine' needs the setting 'port': --set port=VALUE"),
        ("", {"prot": "x"}, SettingsError, "platform 'mine:Mine' has no setting 'prot'; it has port"),
        ("raise OSError('no such port')", {"port": "x"}, CommunicationError, "cannot be opened: no such port"),
        (
            "raise KeyError('x')",
            {"port": "x"},
            MissingDependencyError,
            "cannot be created (KeyError: 'x'): the call is Mine(robot,",
        ),
        (
            "self.joint_names = ('a',)",
            {"port": "x"},
            MissingDependencyError,
            "its joint_names are a; they must be the model's",
        ),
    ],
)
def test_a_platform_that_cannot_be_made_gives_the_reason(here, a1, made, given, kind, message):
    here("mine", mine(made=made))
    with pytest.raises(kind) as caught:
        open_platform("mine:Mine", a1, given)
    assert message in str(caught.value)


@pytest.mark.realtime
def test_a_robot_process_that_dies_at_once_is_not_one_that_is_late(here, a1):
    here("mine", mine(made="__import__('os')._exit(3)"))
    with pytest.raises(CommunicationError, match=r"died before it was ready \(exit code 3\); the robot was not moved"):
        RemoteRobot("mine:Mine", a1, {"port": "x"})


STATE = "from equipoise import RobotState; import numpy as np; return RobotState(0.0, {}, None, None, np.zeros(3), {})"


@pytest.mark.parametrize(
    ("read", "kind", "message"),
    [
        ("return None", MotionError, "read returns a NoneType; it must be a RobotState"),
        (
            STATE.format("np.zeros(3)", "np.zeros(3)"),
            MotionError,
            "read returns (3,) as joint_position; it must be an array of",
        ),
        (
            STATE.format("np.zeros(12)", "[0, 0, 9]"),
            MotionError,
            "read returns list as acceleration_in_imu; it must be an array of",
        ),
        ("raise OSError('unplugged')", CommunicationError, "cannot be reached: read fails (unplugged)"),
        ("return 1 / 0", MotionError, "read fails (ZeroDivisionError: division by zero)"),
    ],
)
def test_defects_of_a_users_platform_are_typed_errors(here, a1, read, kind, message):
    here("mine", mine(read=read))
    with open_platform("mine:Mine", a1, {"port": "x"}) as platform, pytest.raises(kind) as caught:
        platform.read()
    assert message in str(caught.value)


@pytest.mark.realtime
def test_a_users_driver_is_a_platform_in_every_verb(installed, tmp_path, capsys):
    installed("driver")
    flags = ["--platform", "outside-bus"]
    assert main(["calibrate", *flags, "--method", "static", "--dry-run"]) == 0
    assert main(["doctor", *flags, "--set", "node=2"]) == 10
    assert "nobody answers at node 2" in capsys.readouterr().err
    assert main(["doctor", *flags, "--duration", "1s", "--json"]) in (0, 1)  # a busy machine's samples come late
    capsys.readouterr()
    assert main(["record", *flags, "--duration", "1s", "--out", str(tmp_path / "log.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joint_samples"] > 0
    diary = tmp_path / "diary"
    code, folder = calibrated(tmp_path / "run", *flags, "--set", f"diary={diary}")
    assert code == 0, capsys.readouterr().err
    # A look before, the robot process, the calibration process.
    assert diary.read_text(encoding="utf-8").split() == ["program", "program", "second"]
    assert folder.result().composite.mass.value == pytest.approx(12.458, rel=0.1)


def test_a_users_format_is_listed_and_written(installed, a1, tmp_path, capsys):
    installed("format")
    with RunFolder.create(tmp_path / "run", a1, BayesianMethod(), {"time": "2026-01-01"}) as folder:
        folder.save(found(a1).with_provenance(**folder.provenance))
    assert main(["export", "--list", "--json"]) == 0
    assert "kilograms" in {row["name"] for row in json.loads(capsys.readouterr().out)["formats"]}
    assert main(["export", "--list"]) == 0
    assert "a scale's display" in capsys.readouterr().out
    assert main(["export", str(tmp_path / "run"), "--to", "kilograms", "--quiet"]) == 0
    first, *about = (tmp_path / "run" / "export" / "mass.txt").read_text(encoding="utf-8").splitlines()
    assert float(first) == pytest.approx(folder.result().composite.mass.value, abs=5e-4)
    assert "whole robot frozen at its stance" in " ".join(about)


def test_a_log_with_a_users_suffix_is_estimated(installed, bayesian_run, a1, tmp_path, capsys):
    recording = bayesian_run.recordings[0]
    path = tmp_path / "stand.arrays"
    np.savez(
        tmp_path / "stand.npz", time=recording.joints.time, names=recording.joint_names, position=recording.joints.position,
        torque=recording.joints.torque, gyro=recording.imu.angular_velocity_in_imu,
        accelerometer=recording.imu.acceleration_in_imu,
    )  # fmt: skip
    (tmp_path / "stand.npz").rename(path)
    estimate = ["estimate", str(path), "--robot", "unitree_a1", "--json", "--no-report"]
    assert main(estimate) == 5
    assert "or a file .mcap, .db3, .bag, .csv, .tsv" in capsys.readouterr().err
    installed("reader")
    assert main(estimate) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["provenance"]["format"] == "arrays"
    assert table["composite"]["mass"] == pytest.approx(bayesian_run.truth.composite.mass, rel=0.05)
    broken = tmp_path / "broken.arrays"
    broken.write_bytes(b"no archive")
    assert main(["estimate", str(broken), "--robot", "unitree_a1"]) == 5
    assert f"the log {str(broken)!r} cannot be read: " in capsys.readouterr().err


def test_a_package_that_fails_is_named_and_others_work(installed, tmp_path, monkeypatch, capsys):
    shutil.copytree(OUTSIDE / "platform", tmp_path / "platform")
    (tmp_path / "platform" / "outside_platform.py").write_text("import no_such_thing", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path / "platform"))
    installed("driver")
    assert main(["platforms", "--json"]) == 0
    rows = {row["name"]: row["settings"] for row in json.loads(capsys.readouterr().out)["platforms"]}
    assert rows["outside-robot"].startswith(
        "cannot be used here: platform 'outside-robot' of the package outside_platform 1.0 cannot be used: "
    )
    assert rows["outside-bus"] == [["node", "a whole number", 1], ["diary", "text", ""]]
    assert main(["doctor", "--platform", "outside-robot"]) == 7
    assert "No module named 'no_such_thing'" in capsys.readouterr().err
    assert main(["doctor", "--duration", "1s"]) == 0


def test_a_module_in_the_current_folder_is_found_by_the_installed_program(here, tmp_path):
    here("mine", (OUTSIDE / "platform" / "outside_platform.py").read_text(encoding="utf-8"))
    code = "import sys; sys.path.pop(0); from equipoise.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["calibrate", "--platform", "mine:Robot", "--method", "static", "--dry-run"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "unitree_a1 on mine:Robot" in done.stdout
