"""Faults at the wire: an emulator in real time behind UDP or DDS, the robot process, and what becomes of the robot."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from emulator_processes import free_port, running_emulator, unused_domain
from guarded import lift

from equipoise import Trajectory, nominal_stance
from equipoise.errors import (
    CommunicationError,
    FallError,
    MotionError,
    OutputError,
    StoppedError,
)
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard.endings import NOT_CONFIRMED
from equipoise.guard.limits import Limits
from equipoise.guard.remote_robot import RemoteRobot

SCRIPT = Path(__file__).parents[1] / "remote_script.py"
PATIENCE = 90.0  # [s], on a machine that has other things to do
LIMITS = Limits(stall=0.5)  # of the calibration process, which shares two cores with other tests
LOWERED = ("lowered", "damped", "released")


@contextlib.contextmanager
def emulated_a1(*flags, dds=False, start="standing"):
    """An A1's emulator; the platform's name and settings for it."""
    if dds:
        domain = unused_domain()
        flags = ("--domain", domain, "--no-sport-mode", *flags)
        name, settings = "unitree-go2", {"interface": "lo", "domain": domain}
    else:
        port, local = free_port(), free_port()
        flags = ("--protocol", "a1", "--port", port, *flags)
        name, settings = "unitree-a1", {"address": "127.0.0.1", "port": port, "local_port": local}
    protocol = "unitree-dds" if dds else "unitree-udp"
    with running_emulator(protocol, "--robot", "unitree_a1", "--start", start, "--trace", *flags) as emulator:
        yield emulator, name, settings


@contextlib.contextmanager
def standing(robot, *flags, dds=False, log=None, folder=None):
    """A robot that has stood up, and its emulator."""
    with emulated_a1(*flags, dds=dds) as (emulator, name, settings):
        remote = RemoteRobot(name, robot, settings, log, folder and folder / "ending.txt", LIMITS)
        with remote:
            raised, feet = stand_up(remote, robot, nominal_stance(robot))
            yield remote, emulator, raised, feet


def moments(emulator, **what):
    """Robot times of log lines with such values [s]."""
    return [entry["time"] for entry in emulator.log if what.items() <= entry.items()]


def modes(emulator):
    """Modes of the motor boards in order."""
    found = [entry["mode"] for entry in emulator.log if "mode" in entry]
    return [mode for mode, _ in itertools.groupby(found)]


def ended_by(kind, remote, robot, emulator, fault, seconds=10.0):
    """Give a fault while two feet are up; the error, and the robot time from the fault to damping [s]."""
    emulator.fault(**fault, when="lift")
    with pytest.raises(kind) as caught:
        lift(remote, robot, watch=seconds)
    [name] = set(fault) - {"for"}
    began = emulator.wait_for("fault", name)
    # It may be damped within the control period of the fault, and it was damped before it stood up.
    damped = emulator.wait_for("mode", "damped", patience=20.0, after=began)
    return caught.value, damped["time"] - began["time"]


def fastest_descent(emulator, since):
    """Fastest vertical speed downward after a robot time, up to where the robot is damped [m/s]."""
    until = next((time for time in moments(emulator, mode="damped") if time > since), np.inf)
    return -min((e["speed"] for e in emulator.log if "speed" in e and since + 0.2 < e["time"] <= until), default=0.0)


def hold(remote, seconds):
    """Hold the robot where it stands."""
    here = np.repeat(remote.read().joint_position[None], round(seconds / remote.control_period), axis=0)
    remote.play(Trajectory(here, torque=np.tile(remote.read().joint_torque, (len(here), 1))))


# --- the operator


@pytest.mark.realtime
def test_the_remote_control_damps_the_robot(a1):
    with standing(a1) as (remote, emulator, *_):
        error, delay = ended_by(StoppedError, remote, a1, emulator, {"press": "L2+B"})
        assert remote.report().ending == ("damped", "released")
        assert "damp the robot" in str(error)
        assert delay < 0.05
        damped, released = moments(emulator, mode="damped")[-1], moments(emulator, mode="released")[-1]
        assert released - damped > 1.5  # for as long as it moves
        assert abs(next(e["speed"] for e in emulator.log if e.get("mode") == "released")) < 0.1
    assert error.exit_code == 13


@pytest.mark.realtime
def test_the_space_bar_damps_the_robot(a1):
    with standing(a1) as (remote, emulator, *_):
        pressed = time.monotonic()
        remote.stop("damp")
        with pytest.raises(StoppedError, match="the operator asked to damp the robot") as caught:
            lift(remote, a1, watch=1.0)
        assert caught.value.exit_code == 13
        assert next(e["at"] for e in emulator.log if e.get("mode") == "damped" and e["at"] > pressed) - pressed < 0.05
        assert remote.report().ending == ("damped", "released")


# --- a robot that should not go on


@pytest.mark.realtime
def test_an_empty_battery_lowers_the_robot(a1):
    with standing(a1, dds=True) as (remote, emulator, *_):
        error, _ = ended_by(StoppedError, remote, a1, emulator, {"charge": 0.05})
        assert "the battery charge is 5%" in str(error)
        assert remote.report().ending == ("feet down", *LOWERED)
        assert fastest_descent(emulator, moments(emulator, fault="charge")[0]) < 0.25
    assert error.exit_code == 12


class Full:
    """A disk that is full while the robot stands up."""

    def __init__(self):
        self.pieces = 0

    def begin(self, *about):
        pass

    def add(self, piece):
        self.pieces += self.pieces > 0 or piece.has_phase("stand")
        if self.pieces > 7:
            raise OutputError("the recording cannot be written: No space left on device")


@pytest.mark.realtime
def test_a_full_disk_lowers_the_robot(a1):
    with (
        emulated_a1(start="lying") as (_, name, settings),
        RemoteRobot(name, a1, settings, Full(), None, LIMITS) as remote,
    ):
        with pytest.raises(OutputError, match="No space left"):
            stand_up(remote, a1, nominal_stance(a1))
        assert remote.report().ending == LOWERED


# --- a robot that is not sound


@pytest.mark.realtime
def test_a_cable_that_comes_out_in_a_lift_is_not_reported_as_damped(a1):
    with standing(a1) as (remote, emulator, *_):
        emulator.fault(cut=True, when="lift")
        with pytest.raises(CommunicationError, match="no sample has arrived"):
            lift(remote, a1, watch=10.0)
        assert remote.report().ending == (f"damping commands were sent; {NOT_CONFIRMED}", "released")
        assert modes(emulator)[-1] == "silence"  # the motor boards damp


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("fault", "kind", "longest"),
    [({"freeze": "imu"}, (MotionError, FallError), 0.4), ({"lose": "encoders"}, MotionError, 0.05)],
)
def test_a_sensor_that_fails_in_a_lift_damps_the_robot_at_once(a1, fault, kind, longest):
    with standing(a1) as (remote, emulator, *_):
        _, delay = ended_by(kind, remote, a1, emulator, fault)
        assert delay < longest
        assert remote.report().ending[-1] == "released"


@pytest.mark.realtime
def test_a_push_in_a_lift_damps_the_robot_beyond_the_recovery_angle(a1):
    with standing(a1) as (remote, emulator, *_):
        ended_by((FallError, MotionError), remote, a1, emulator, {"push": [0, 100, 0], "for": 0.3})
        tilted = next(e["time"] for e in emulator.log if e.get("tilt", 0.0) > np.degrees(Limits().lean_in_lift))
        assert moments(emulator, mode="damped")[0] < tilted + 0.1 + 0.1  # the trace has a line every 0.1 s


@pytest.mark.realtime
def test_a_blocked_joint_meets_a_bounded_force(a1):
    with standing(a1) as (remote, emulator, raised, _):
        joint = a1.joint_names.index("FL_calf_joint")
        before = remote.read().joint_torque
        emulator.fault(block="FL_calf_joint")
        emulator.wait_for("fault", "block")
        with pytest.raises(MotionError, match="FL_calf_joint"):
            move_to(raised, nominal_stance(a1).feet_in_base + [0.0, 0.0, 0.06])
        began = moments(emulator, fault="block")[0]
        strained = max(
            e["torque"]
            for e in emulator.log
            if "torque" in e and e["time"] > began and e["joint"].endswith("calf_joint")
        )
        assert strained < np.abs(before[joint]) + 0.3 * a1.effort_limit[joint] + 3.0
        assert remote.report().ending == ("damped", "released")


# --- samples


@pytest.mark.realtime
def test_bad_samples_are_left_out_and_counted(a1):
    with standing(a1, dds=True) as (remote, emulator, raised, feet):
        for fault in ({"damage": 0.02}, {"replay": 0.02}):
            emulator.fault(**fault)
        for there in (nominal_stance(a1).feet_in_base, feet):
            move_to(raised, there)
    report = remote.report()
    assert min(report.samples.rejected, report.samples.out_of_order) >= 5
    assert report.ending == LOWERED


# --- other programs


@pytest.mark.realtime
def test_another_program_that_commands_ends_the_run_and_is_not_fought(a1):
    with standing(a1, dds=True) as (remote, emulator, *_):
        domain = next(flag for flag in emulator.flags if isinstance(flag, int))
        other = subprocess.Popen(
            [sys.executable, "-c", OTHER, str(domain)], stdout=subprocess.PIPE, text=True, env=environment()
        )
        with pytest.raises(MotionError, match=str(other.pid)) as caught:
            hold(remote, 20.0)
        assert caught.value.other_commander
        other.communicate(timeout=PATIENCE)
        assert remote.report().ending == ("left to the other program", "released")


OTHER = """
import sys, time
from equipoise.drivers.dds.domain import DdsDomain, raw
from equipoise.drivers.unitree.dds import COMMAND_TOPIC
from equipoise.drivers.unitree.dds_types import LowCmd
from equipoise.drivers.unitree.low_level import COMMAND
domain = DdsDomain(int(sys.argv[1]), "lo")
kind = raw(LowCmd)
outbox = domain.outbox(COMMAND_TOPIC, kind)
time.sleep(1.0)
for _ in range(500):
    outbox.send(kind(COMMAND.encoded(COMMAND.blank())))
    time.sleep(2e-3)
"""


# --- the two processes


def environment():
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}


@contextlib.contextmanager
def program(how, folder, *flags):
    """A program that lifts two feet of an emulated robot: its process, the robot process' number, and the emulator."""
    with emulated_a1(*flags) as (emulator, name, settings):
        given = [f"{key}={value}" for key, value in settings.items()]
        process = subprocess.Popen(
            [sys.executable, str(SCRIPT), how, str(folder), name, *given],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=environment(),
        )  # fmt: skip
        try:
            line = process.stdout.readline()
            assert line, process.communicate()
            yield process, json.loads(line)["robot"], emulator
        finally:
            process.send_signal(signal.SIGCONT)
            if process.poll() is None:
                process.kill()
            process.communicate(timeout=PATIENCE)


def damped_after(emulator, moment):
    """Time from a moment of this computer's clock to damping [s]."""
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        for entry in emulator.log:
            if entry.get("mode") in ("damped", "silence") and entry["at"] > moment:
                return entry["at"] - moment
        time.sleep(0.01)
    raise AssertionError(emulator.log[-5:])


def ending_in(folder):
    """Return the text of the ending, once the robot was released."""
    until = time.monotonic() + 10.0
    while not (folder / "ending.txt").exists() and time.monotonic() < until:
        time.sleep(0.05)
    return (folder / "ending.txt").read_text()


@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_robot_process_that_is_lost_is_replaced_within_50_ms(tmp_path, number):
    with program("hold", tmp_path) as (process, robot, emulator):
        time.sleep(0.5)
        moment = time.monotonic()
        os.kill(robot, number)
        delay = damped_after(emulator, moment)
        _, errors = process.communicate(timeout=PATIENCE)
        assert delay < 0.05, emulator.log[-5:]
        assert "silence" not in modes(emulator)[:-1]  # the second connection went on in time
    assert CommunicationError.__name__ in errors
    assert "the robot process " in (tmp_path / "ending.txt").read_text()
    assert "damped (" in (tmp_path / "ending.txt").read_text()


@pytest.mark.realtime
@pytest.mark.parametrize("how", ["kill", "grip"])
def test_a_calibration_process_that_is_lost_leaves_a_robot_that_lies(tmp_path, how):
    with program(how, tmp_path) as (process, _, emulator):
        if how == "kill":
            process.communicate(timeout=PATIENCE)
        emulator.wait_for("mode", "released", patience=30.0)
        assert modes(emulator)[-3:] == ["commanded", "damped", "released"] or modes(emulator)[-2:] == [
            "released",
            "silence",
        ]
    ending = ending_in(tmp_path)
    assert "feet down, lowered, damped, released" in ending
    assert ("died or closed the pipe" if how == "kill" else "sent no heartbeat") in ending


@pytest.mark.realtime
def test_a_robot_that_was_without_both_processes_is_not_pulled_up_again(tmp_path):
    """On a suspended computer; the motor boards have damped the robot meanwhile."""
    with program("hold", tmp_path) as (process, robot, emulator):
        for pid in (process.pid, robot):
            os.kill(pid, signal.SIGSTOP)
        time.sleep(5.0)
        asleep = len(emulator.log)
        for pid in (robot, process.pid):
            os.kill(pid, signal.SIGCONT)
        process.communicate(timeout=PATIENCE)
        assert "commanded" not in [entry.get("mode") for entry in emulator.log[asleep:]]


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("numbers", "longest", "ending"),
    [
        ([signal.SIGINT], 4.2, "feet down, lowered, damped, released"),
        ([signal.SIGINT, signal.SIGINT], 1.2, "feet down, damped, released"),
        ([signal.SIGTERM], 1.0, "feet down, damped, released"),
    ],
    ids=lambda value: " ".join(n.name for n in value) if isinstance(value, list) else "",
)
def test_signals_put_the_robot_down(tmp_path, numbers, longest, ending):
    with program("hold", tmp_path) as (process, _, emulator):
        time.sleep(0.3)
        moment = time.monotonic()
        for number in numbers:
            process.send_signal(number)
            time.sleep(0.05)
        delay = damped_after(emulator, moment)
        process.communicate(timeout=PATIENCE)
        assert delay < longest, emulator.log[-5:]
        assert ending in (tmp_path / "ending.txt").read_text()
    assert process.returncode != 0
