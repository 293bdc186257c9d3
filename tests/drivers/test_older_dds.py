"""The versions of cyclonedds that robots run: driver, emulator and ROS 2 with them, and what pairs of versions do."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from emulator_processes import PATIENCE, logged_modes, running_emulator, unused_domain
from older_dds import SOURCES, CannotBuildError, older_python

pytest.importorskip("cyclonedds")

from equipoise.cli import INTERRUPTED
from equipoise.drivers.platforms import open_connection
from equipoise.errors import SettingsError
from equipoise.platform.platform import JointCommand

pytestmark = pytest.mark.realtime
BYTES = [  # what the library makes of messages, and of who is on a domain
    "test_dds.py",
    "test_dds_versions.py::test_who_else_is_on_a_domain_is_seen_with_the_version",
    "test_dds_versions.py::test_a_company_that_cannot_be_seen_is_not_taken_for_none",
    "test_unitree_samples.py::test_records_are_laid_out_as_in_the_robots_memory",
    "test_unitree_samples.py::test_fields_read_from_bytes_are_those_that_cyclonedds_reads",
    "test_unitree_samples.py::test_messages_carry_the_published_checksum",
    "test_ros2_samples.py::test_messages_are_on_the_wire_what_ros_makes_of_them",
]
ROBOTS = [  # each kind of message to and from a robot in another process; requests are those of the calibration below
    "test_unitree_dds_standing.py::test_samples_of_the_standing_robot",
    "test_unitree_dds_standing.py::test_gains_and_feed_forward_arrive",
    "test_unitree_dds_standing.py::test_a_commander_that_begins_in_mid_run_is_noticed_at_once_and_named",
    "test_ros2.py::test_two_writers_of_the_models_joints_are_two_robots_and_one_of_other_joints_is_not",
    "test_ros2.py::test_joints_and_imu_are_measured_in_the_models_order_and_signs",
    "test_ros2.py::test_commands_reach_the_joint_that_they_name[4]",
    "test_ros2.py::test_trajectories_command_as_arrays_do",
]
TESTS = {
    "0.10.2": BYTES + ROBOTS,
    "0.10.5": BYTES,
}  # they differ in Python alone: both are built against the same library
STATIC = ["--method", "static", "--quiet", "--yes", "--no-report"]
# What programs on version 11 do that are not ours: they call a uint8 by its name, which crashes processes of 0.10.
CRASHES_OTHERS = """
import sys
from cyclonedds.idl import types
types.byte = types.uint8
from equipoise.cli import main
main(["lab", "emulate", "unitree-dds", *sys.argv[1:]])
"""
as_robots_run = pytest.mark.parametrize("older", ["0.10.2"], indirect=True)
COMES = """
import sys
from equipoise.drivers.dds.cyclone import VERSION
from equipoise.drivers.dds.domain import DdsDomain
domain = DdsDomain(int(sys.argv[1]), "lo", (), VERSION)
sys.stdin.read()
"""


@pytest.fixture(scope="module", params=SOURCES)
def older(request, shared_folder):
    """A version and its Python, which all workers of xdist share."""
    try:
        return request.param, older_python(request.param, shared_folder / f"cyclonedds-{request.param}")
    except CannotBuildError as reason:
        pytest.skip(f"cyclonedds {request.param}, which robots run, was NOT TRIED: {reason}")


def run(python, *arguments, patience=300):
    done = subprocess.run([python, *arguments], capture_output=True, text=True, check=False, timeout=patience)
    return done.returncode, done.stdout + done.stderr


def flags(domain, *others):
    return ["unitree_a1", "--platform", "unitree-go2", "--set", "interface=lo", "--set", f"domain={domain}", *others]


def test_the_tests_of_dds_pass(older, tmp_path):
    number, python = older
    assert run(python, "-c", "from equipoise.drivers.dds.cyclone import VERSION; print(VERSION)") == (0, f"{number}\n")
    chosen = [str(Path(__file__).parent / name) for name in TESTS[number]]
    code, output = run(python, "-m", "pytest", "-q", "-o", f"cache_dir={tmp_path}", *chosen)
    assert code == 0, output[-5000:]


@as_robots_run
def test_a_calibration_of_a_go2_begins_and_is_interrupted(older, tmp_path):
    """With requests to its own controller, commands from the robot process, and the ending."""
    _, python = older
    domain = unused_domain()
    with running_emulator("unitree-dds", "--domain", domain, python=python) as emulator:
        emulator.wait_for("mode", "own stance")
        command = [python, "-m", "equipoise", "calibrate", *flags(domain, *STATIC, "--out", str(tmp_path / "run"))]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            emulator.wait_for("mode", "commanded")
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == INTERRUPTED, output
    assert any(entry.get("asked") == "release" for entry in emulator.log)
    modes = logged_modes(emulator.log)
    assert modes[modes.index("commanded") :][:3] == ["commanded", "damped", "released"]


@as_robots_run
def test_a_mixed_pair_is_refused_by_name_unless_it_is_accepted(older, tmp_path):
    _, python = older
    for ours, theirs in ((sys.executable, python), (python, sys.executable)):
        domain, own = (
            unused_domain(),
            run(ours, "-c", "import importlib.metadata as m; print(m.version('cyclonedds'))")[1],
        )
        with running_emulator("unitree-dds", "--domain", domain, python=theirs) as emulator:
            code, output = run(
                ours, "-m", "equipoise", "calibrate", *flags(domain, *STATIC, "--out", str(tmp_path / own))
            )
            assert code == 2, output
            assert f"in domain {domain} on lo" in output
            assert f"set accept_cyclonedds={own}" in output
            accepted = flags(
                domain, "--set", f"accept_cyclonedds={own.strip()}", "--set", "silence=5", "--duration", "1s"
            )
            code, output = run(ours, "-m", "equipoise", "doctor", *accepted)
            assert code in (0, 1), output
            assert "'normal' holds the motors" in output
        assert not any(entry.get("mode") == "commanded" for entry in emulator.log)


@as_robots_run
def test_who_refuses_a_version_that_would_crash_it_is_not_crashed(older):
    _, python = older
    domain = unused_domain()
    with running_emulator(None, "--domain", domain, code=CRASHES_OTHERS):
        looks = ["-m", "equipoise", "doctor", *flags(domain, "--duration", "1s")]
        code, output = run(python, *looks)
        assert code == 2, output
        assert "has Cyclone DDS 11" in output
        code, output = run(python, *looks, "--set", f"accept_cyclonedds={older[0]}")
        assert code == -11, output  # a segmentation fault: what the refusal is for


@as_robots_run
@pytest.mark.parametrize("platform", ["unitree-go2", "ros2"])
def test_a_version_that_comes_later_is_refused_before_the_first_command(older, a1, platform):
    _, python = older
    domain = unused_domain()
    link = open_connection(platform, a1, {"interface": "lo", "domain": domain})
    try:
        with subprocess.Popen([python, "-c", COMES, str(domain)], stdin=subprocess.PIPE) as process:
            until = time.monotonic() + PATIENCE
            while not link._domain._notes.processes() and time.monotonic() < until:
                time.sleep(0.01)
            with pytest.raises(SettingsError, match=r"\(process \d+ on .*\) has Cyclone DDS 0\.10"):
                link.send(JointCommand(np.zeros(12)))
            process.communicate()
    finally:
        link.close()
