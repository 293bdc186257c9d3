"""Programs that are ended in the middle, from outside or by themselves: real processes, real signals, a simulated robot."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1].joinpath("guarded_script.py")
PATIENCE = 120.0  # [s], on a machine that has other things to do
PUT_DOWN = ["on four feet", "on two feet", "on four feet", "damped", "released"]


def seen(path):
    """What the robot was made to do so far."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


@pytest.fixture
def start(tmp_path):
    """Starts programs, and ends those that a failed test leaves."""
    processes = []

    def start(how):
        path = tmp_path / how
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        process = subprocess.Popen(
            [sys.executable, str(SCRIPT), how, str(path)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True, start_new_session=True, env=environment,
        )  # fmt: skip
        processes.append(process)
        return process, path

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate(timeout=PATIENCE)


def wait_for(path, what):
    until = time.monotonic() + PATIENCE
    while what not in seen(path):
        assert time.monotonic() < until, seen(path)
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("how", "numbers", "last_line"),
    [
        ("with", [signal.SIGINT], "equipoise.platform.platform.MotionInterrupted: interrupted"),
        ("with", [signal.SIGTERM], "equipoise.platform.platform.MotionInterrupted: interrupted"),
        ("with", [signal.SIGHUP, signal.SIGINT, signal.SIGINT], "equipoise.platform.platform.MotionInterrupted: interrupted"),
        ("without", [signal.SIGINT], "equipoise.platform.platform.MotionInterrupted: interrupted"),
        ("thinking", [signal.SIGINT], "KeyboardInterrupt"),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(n.name for n in value),
)  # fmt: skip
def test_a_signal_puts_the_robot_down_before_the_program_ends(start, how, numbers, last_line):
    process, path = start(how)
    wait_for(path, "on two feet")
    if how == "thinking":
        time.sleep(1.0)  # two feet are up, and nobody moves the robot
    for number in numbers:
        process.send_signal(number)
        time.sleep(0.05)
    _, errors = process.communicate(timeout=PATIENCE)
    assert seen(path) == PUT_DOWN
    assert errors.splitlines()[-1] == last_line
    assert ("ended by SIGTERM" in errors) == (numbers == [signal.SIGTERM])
    # Python ends by the signal itself where KeyboardInterrupt is nothing but that.
    assert process.returncode == (-signal.SIGINT if how == "thinking" else 1)


@pytest.mark.parametrize(
    ("how", "code", "said"), [("exit", 3, ""), ("error", 1, "ValueError: an error of the program")]
)
def test_a_program_that_just_ends_puts_the_robot_down_too(start, how, code, said):
    process, path = start(how)
    _, errors = process.communicate(timeout=PATIENCE)
    assert seen(path) == PUT_DOWN
    assert errors.strip().endswith(said)
    assert process.returncode == code
