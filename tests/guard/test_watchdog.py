"""Programs that die, hang or are stopped while they hold a robot up: real processes, a real wire, a simulated robot.

Of the two that see to it that the robot is damped then, the guard's own thread and the watchdog, one is enough. Times are of
the robot's peer; it counts the commands that arrived, stiff and limp.
"""

import os
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from peer_processes import StalledError, free_port, in_real_time, running_peer, unused_domain

SCRIPT = Path(__file__).parents[1].joinpath("watched_script.py")
PATIENCE = 90.0  # [s], on a machine that has other things to do
SLACK = 2.0  # [s] by which such a machine may be late
DAMPED_WITHIN = 2.5  # [s]


class Program:
    """The program, the robot, and what became of them."""

    def __init__(self, process, peer, log):
        self.process, self.peer, self.log = process, peer, log

    def hangs(self):
        """Wait until it says that it will; when that was."""
        if self.process.stdout.readline() == "hangs\n":
            return time.monotonic()
        errors = self.process.stderr.read() if self.process.stderr else ""
        assert "CommunicationError" in errors or "OverrunError" in errors, errors
        raise StalledError(errors)

    def since(self, entry, count):
        return [e for e in self.peer.log[count:] if entry.items() <= e.items()]

    def wait_for(self, mode, hung, seen):
        """How long it took from then [s]; only modes that are entered behind those seen count."""
        while time.monotonic() - hung < PATIENCE:
            if self.since({"mode": mode}, seen):
                return time.monotonic() - hung
            time.sleep(0.01)
        raise AssertionError(f"never {mode}: {self.peer.log}")


def over_udp():
    """A standing robot: its peer and its flags, and how it is reached."""
    port, local = free_port(), free_port()
    peer = "unitree_udp", "--port", port, "--start", "standing", "--noise", "ideal"
    return peer, ("unitree-a1", "address=127.0.0.1", f"port={port}", f"local_port={local}", "silence=5")


def over_dds():
    """The same; a service has to be found and asked who holds the motors before the first command."""
    domain = unused_domain()
    peer = "unitree_dds", "--domain", domain, "--noise", "ideal", "--start", "standing", "--no-sport-mode"
    return peer, ("unitree-go2", "interface=lo", f"domain={domain}", "silence=5")


@contextmanager
def program(tmp_path, how, stderr=subprocess.PIPE, wire=over_udp):
    (flags, reached), log = wire(), tmp_path / "watchdog.log"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    with running_peer(*flags) as peer:
        process = subprocess.Popen(
            [sys.executable, str(SCRIPT), how, str(log), *reached], stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=stderr, text=True, env=environment,
        )  # fmt: skip
        try:
            yield Program(process, peer, log)
        finally:
            process.kill()
            process.stdout.close()
            if process.stderr:
                process.stderr.close()
            process.wait(timeout=PATIENCE)


@pytest.mark.parametrize(
    ("how", "saved_by"),
    [
        ("loop", "the guard"),
        ("grip", "the program gave no sign of life for 2 s"),
        ("motion", "the program is gone"),
    ],
)
@in_real_time
def test_whatever_becomes_of_the_program_the_robot_is_damped(tmp_path, how, saved_by):
    with program(tmp_path, how) as run:
        seen = len(run.peer.log)
        hung = run.hangs()
        took = run.wait_for("damped", hung, seen)
        run.peer.wait_for("mode", "released")
        stiff = [entry["stiff"] for entry in run.peer.log if "stiff" in entry]
        until = time.monotonic() + PATIENCE
        while saved_by != "the guard" and not run.log.exists():
            assert time.monotonic() < until
            time.sleep(0.05)
        time.sleep(1.0)  # nobody has it stiff again
        run.process.kill()
        run.process.wait(timeout=PATIENCE)
    ended = run.peer.end()
    counts = next(entry for entry in ended if "ended" in entry)
    print(f"{how}: damped after {took:.2f} s; {counts['stiff']} stiff and {counts['limp']} limp commands in all")
    modes = [entry["mode"] for entry in ended if "mode" in entry]
    assert took < DAMPED_WITHIN + SLACK
    assert "released" not in modes[: modes.index("damped")]  # no limp legs while somebody finds out how to damp them
    assert counts["stiff"] == stiff[-1]
    assert counts["limp"] > 100
    if saved_by == "the guard":
        assert not run.log.exists()  # the watchdog had nothing to do, and says nothing
    else:
        assert f" watchdog: {saved_by}; its joints were damped (" in run.log.read_text(encoding="utf-8")


@in_real_time
def test_legs_that_are_up_are_damped_for_longer(tmp_path):
    """They come down slowly, and would fall if they were let go after the time in which a body sinks."""
    with program(tmp_path, "legs up") as run:
        hung, seen = run.hangs(), len(run.peer.log)
        run.wait_for("damped", hung, seen)
        run.wait_for("released", hung, seen)
    mode = {entry["mode"]: entry["time"] for entry in run.peer.log[seen:] if "mode" in entry}
    assert 9.0 < mode["released"] - mode["damped"] < 12.0


@in_real_time
def test_over_dds_too_though_finding_services_takes_its_time(tmp_path):
    pytest.importorskip("cyclonedds")
    with program(tmp_path, "stop", wire=over_dds) as run:
        hung, seen = run.hangs(), len(run.peer.log)
        took = run.wait_for("damped", hung, seen)
        run.wait_for("released", hung, seen)
        run.process.kill()
        run.process.wait(timeout=PATIENCE)
    counts = next(entry for entry in run.peer.end() if "ended" in entry)
    print(f"DDS: damped after {took:.2f} s; {counts['stiff']} stiff and {counts['limp']} limp commands in all")
    assert took < DAMPED_WITHIN + SLACK
    assert counts["limp"] > 100
    assert not any("ignored" in entry or "asked" in entry for entry in run.peer.log)


@pytest.mark.parametrize("stderr", ["closed pipe", "full pipe"])
@in_real_time
def test_a_watchdog_that_nobody_listens_to_damps_all_the_same(tmp_path, stderr):
    """It once spoke first, and ended by that."""
    reading, writing = os.pipe()
    try:
        if stderr == "full pipe":
            os.set_blocking(writing, False)
            with suppress(BlockingIOError):
                while True:
                    os.write(writing, bytes(4096))
            os.set_blocking(writing, True)
        with program(tmp_path, "kill", stderr=writing) as run:
            if stderr == "closed pipe":
                os.close(reading)
                reading = None
            seen = len(run.peer.log)
            hung = run.hangs()
            run.wait_for("damped", hung, seen)
            run.wait_for("released", hung, seen)
        assert next(entry for entry in run.peer.end() if "ended" in entry)["limp"] > 100
    finally:
        for end in (reading, writing):
            if end is not None:
                os.close(end)


@in_real_time
def test_nothing_is_said_of_a_program_that_ends_in_good_order(tmp_path):
    """Though it thinks for longer than a hung one may hang."""
    with program(tmp_path, "think") as run:
        run.hangs()
        _, errors = run.process.communicate(timeout=PATIENCE)
        time.sleep(1.0)
    assert (run.process.returncode, errors) == (0, "")
    assert not run.log.exists()
    modes = [entry["mode"] for entry in run.peer.end() if "mode" in entry]
    assert [mode for mode in modes if mode != "silence"] == ["own stance", "commanded", "damped", "released"]
