"""A Go2's emulator in a process of its own over DDS, connections to it, and programs that command it too."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
from emulator_processes import unused_domain

from equipoise import nominal_stance
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.dds import open_connection
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.platform.platform import JointCommand, Trajectory

PATIENCE = 60.0  # [s] for an emulator to start on a busy machine


class Peer:
    """A process with a simulated robot, and what it wrote."""

    def __init__(self, process, path, domain, flags):
        self.process, self.path, self.domain, self.flags = process, path, domain, flags

    def fault(self, **fault):
        """Give it a fault, as `equipoise.lab.emulators.faults` describes it."""
        self.process.stdin.write(json.dumps(fault) + "\n")
        self.process.stdin.flush()

    def logged(self, key=None):
        """All entries, or the values under a key."""
        entries = [json.loads(line) for line in self.path.read_text().splitlines() if line.endswith("}")]
        return entries if key is None else [entry[key] for entry in entries if key in entry]

    def wait_for(self, patience=PATIENCE, **what):
        """Wait for an entry."""
        until = time.monotonic() + patience
        while not any(what.items() <= entry.items() for entry in self.logged()):
            assert self.process.poll() is None, self.path.read_text()
            assert time.monotonic() < until, f"{what} was not logged: {self.path.read_text()}"
            time.sleep(0.02)


@contextmanager
def running(tmp_path_factory, *flags, domain=None):
    path, domain = tmp_path_factory.mktemp("emulator") / "log.jsonl", domain or unused_domain()
    command = [
        sys.executable,
        "-m",
        "equipoise",
        "lab",
        "emulate",
        "unitree-dds",
        "--domain",
        str(domain),
        "--sim-preset",
        "ideal",
    ]
    with path.open("w") as log:
        process = subprocess.Popen(
            [*command, "--duration", "120", *flags], stdin=subprocess.PIPE, stdout=log, stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    emulator = Peer(process, path, domain, flags)
    try:
        emulator.wait_for(ready=True)
        yield emulator
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(timeout=10)
        process.stdin.close()


def settings(emulator, **others):
    return UnitreeDdsSettings(interface="lo", domain=emulator.domain, **others)


@contextmanager
def connected(emulator, robot, **others):
    with HardwarePlatform(open_connection(robot, settings(emulator, **others))) as platform:
        yield platform


def hold(platform, position, seconds=0.3, **others):
    """Stand for a while by the robot's clock; the last state."""
    state = platform.read()
    end, patience = state.time + seconds, time.monotonic() + PATIENCE
    while state.time < end:
        assert time.monotonic() < patience
        state = platform.step(JointCommand(position, **others))
    return state


def excitation(robot):
    """Legs long and short in turn, so that the body rolls and pitches."""
    at = np.arange(750) * 2e-3
    wave = np.sin(2 * np.pi * at / 1.5) * np.sin(np.pi * at / 1.5) ** 2
    position = np.repeat(nominal_stance(robot).joint_position[None], len(at), axis=0)
    for leg, sign in (("FL", 1.0), ("RR", -0.3), ("FR", 0.3)):
        _, thigh, calf = robot.legs[leg].joints
        position[:, thigh] += 0.2 * sign * wave
        position[:, calf] -= 0.4 * sign * wave
    return Trajectory(position)


COMMANDS = """
import sys, time
from equipoise.drivers.dds.domain import DdsDomain, raw
from equipoise.drivers.unitree.dds import COMMAND_TOPIC
from equipoise.drivers.unitree.dds_types import LowCmd
from equipoise.drivers.unitree.low_level import COMMAND
sample, domain = raw(LowCmd), DdsDomain(int(sys.argv[1]), "lo")
commands, record = domain.outbox(COMMAND_TOPIC, sample), COMMAND.blank()
print("ready", flush=True)
sys.stdin.readline()
while True:
    commands.send(sample(COMMAND.encoded(record)))
    print("sent", flush=True)
    time.sleep(2e-3)
"""


@contextmanager
def other_commander(emulator):
    """A program that sends commands as soon as it is asked; a function that asks, and its process."""
    other = [sys.executable, "-c", COMMANDS, str(emulator.domain)]
    with subprocess.Popen(other, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def command():
            process.stdin.write("go\n")
            process.stdin.flush()
            assert process.stdout.readline() == "sent\n"

        try:
            assert process.stdout.readline() == "ready\n"
            yield command, process
        finally:
            process.kill()
