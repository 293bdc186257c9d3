"""Emulators in their own processes, for tests."""

import itertools
import json
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

PATIENCE = 60.0  # [s] for a process that starts on a busy machine


class EmulatorProcess:
    """A running emulator, of a protocol or a program, and its log so far."""

    def __init__(self, protocol, *flags, python=sys.executable, code=None):
        self.log, self.flags = [], flags
        program = ["-m", "equipoise", "lab", "emulate", protocol] if code is None else ["-c", code]
        self._process = subprocess.Popen(
            [python, *program, *map(str, flags)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait_for(self, key, value=None, patience=PATIENCE, after=None):
        """Return the first log entry with a key (and a value), or the first one that follows another entry."""
        until = time.monotonic() + patience
        while time.monotonic() < until:
            for entry in self.log[0 if after is None else self.log.index(after) + 1 :]:
                if key in entry and value in (None, entry[key]):
                    return entry
            if self._process.poll() is not None and not self._reader.is_alive():
                break
            time.sleep(0.01)
        raise AssertionError(f"the emulator never logged {key} {value}: {self.log} {self._process.poll()}")

    def fault(self, **fault):
        """Give the emulator a fault, as `equipoise.lab.emulators.faults` describes it."""
        self._process.stdin.write(json.dumps(fault) + "\n")
        self._process.stdin.flush()

    def kill(self):
        """Kill the process, as a power cut."""
        self._process.kill()
        self._process.wait(timeout=10)

    def end(self):
        """End the process, as Ctrl-C; return the whole log."""
        if self._process.poll() is None:
            self._process.terminate()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.kill()
        self._reader.join(timeout=10)
        self._process.stdout.close()
        with suppress(BrokenPipeError):  # a fault that it did not read
            self._process.stdin.close()
        return self.log

    def _read(self):
        for line in self._process.stdout:
            if line.endswith("\n"):  # a killed process leaves a piece of one
                self.log.append({**json.loads(line), "at": time.monotonic()})


def logged_modes(log):
    """Return the modes in an emulator's log, in order, without silences, which busy machines cause."""
    modes = [entry["mode"] for entry in log if "mode" in entry and entry["mode"] != "silence"]
    return [mode for mode, _ in itertools.groupby(modes)]


@contextmanager
def running_emulator(protocol, *flags, **others):
    """Run an emulator that is ready."""
    emulator = EmulatorProcess(protocol, *flags, **others)
    try:
        emulator.wait_for("ready")
        yield emulator
    finally:
        emulator.end()


_ports = []  # sockets: each keeps its port for this process


def free_port():
    """Return a UDP port that no other process of these tests uses: it reserves the TCP port of its number.

    The port is below those that the system gives to sockets without one, which may take a port before the emulator does.
    """
    for port in range(20_000, 32_000):
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", port))
            _ports.append(socket.create_server(("127.0.0.1", port)))
            return port
    raise AssertionError("no port is free")


_domains = []  # sockets: each keeps its domain for this process


def unused_domain():
    """Return a DDS domain that no other process of these tests uses: it reserves a TCP port, which DDS does not use."""
    for domain in range(1, 231):
        with suppress(OSError):
            _domains.append(socket.create_server(("127.0.0.1", 7400 + 250 * domain)))
            return domain
    raise AssertionError("no DDS domain is free")
