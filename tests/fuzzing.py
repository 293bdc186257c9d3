"""Randomly damaged files, given to every reader.

A reader reads them or raises an error of ours. Anything else is a failure: another exception, a crash, a hang. Readers run in
child processes, because some are written in C++.

    python tests/fuzzing.py --cases 10000 --seed 1 --out failures
"""

import argparse
import contextlib
import io
import multiprocessing
import random
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from robots import quadruped_mjcf, quadruped_urdf

from equipoise import (
    Calibration,
    RobotDescription,
    RobotModel,
    RunFolder,
    calibrate,
    load_robot,
    simulate,
)
from equipoise.drivers.platforms import given_settings
from equipoise.drivers.unitree.packet_formats import FORMS
from equipoise.drivers.unitree.packets import (
    CommandPacket,
    SensorReadings,
    read_state,
)
from equipoise.errors import EquipoiseError
from equipoise.lab.emulators.udp_packets import StatePacket, read_command
from equipoise.lab.static.method import Static
from equipoise.logs.joint_names import read_joint_map
from equipoise.logs.reader import read_log as read_foreign
from equipoise.platform.platform import JointCommand
from equipoise.recording.run_log_reader import read_log

PATIENCE = 30.0  # [s] for one file; starting a child is not counted
NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e308",
    b"-1",
    b"0",
    b"1e-320",
    b"99999999999999999999",
    b"0x1F",
    b"",
    b"--3",
    b"1.2.3",
)


# --- what is damaged


def corpus(folder):
    """Small valid files by target; written once, read by the damage."""

    robot = load_robot("unitree_a1")
    settings = Static()
    run = folder / "run"
    with simulate(robot, "realistic") as simulation, RunFolder.create(run, robot, settings, {}) as kept:
        result = calibrate(simulation.platform, robot, settings, kept.keep)
        recording = kept.recordings()[0]
    kept.save(result)
    log = (run / "recording_0.mcap").read_bytes()
    return {
        "urdf": [quadruped_urdf().encode(), robot.source.xml.encode()],
        "mjcf": [quadruped_mjcf().encode()],
        "description": [b'base_link = "trunk"\nfoot_radius = 0.02\n[joint_limits]\nFL_hip_joint = [-0.6, 0.6]\n'],
        "settings": [b'interface = "lo"\ndomain = 1\npeers = ["a", "b"]\n'],
        "run log": [log],
        "run header": [(run / "run.json").read_bytes()],
        "calibration": [(run / "calibration.json").read_bytes()],
        "bag": [log],
        "csv": [table_of(recording)],
        "joint map": [b'FL_hip_joint = "front_left_hip"\nFR_hip_joint = 3\n'],
        **{target: packets_of(form) for target, form in UDP.items()},
    }


def table_of(recording):
    """The first samples of a recording as CSV."""
    names = recording.joint_names
    axes = [f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    rows = [",".join(["time", *(f"position.{name}" for name in names), *axes])]
    joints, imu = recording.joints, recording.imu
    for time_, *values in zip(
        joints.time, joints.position, imu.angular_velocity_in_imu, imu.acceleration_in_imu, strict=True
    ):
        rows.append(",".join(f"{value:.6g}" for value in [time_, *(v for part in values for v in part)]))
    return "\n".join(rows[:120]).encode()


def packets_of(layout):
    """A state and a command."""

    values = np.linspace(0.1, 1.2, 12)
    state = SensorReadings(values, values, values, 30 + values, values[:3], values[:3], 1234, 0.8, 24.0)
    command = JointCommand(values, values, values, 10 * values, values)
    return [bytes(StatePacket(layout).write(state)), bytes(CommandPacket(layout).write(command))]


UDP = {f"udp {protocol} {name}": form for protocol, forms in FORMS.items() for name, form in forms.items()}
SUFFIX = {
    "urdf": ".urdf", "mjcf": ".xml", "description": ".toml", "settings": ".toml", "run log": ".mcap", "run header": ".json",
    "calibration": ".json", "csv": ".csv", "bag": ".mcap", "joint map": ".toml", **dict.fromkeys(UDP, ".bin"),
}  # fmt: skip


def damaged(random_, samples):
    """Return a damaged valid file, or noise."""
    data = bytearray(random_.choice(samples))
    if random_.random() < 0.05:
        return random_.randbytes(random_.randrange(2000))
    for _ in range(random_.choice((1, 1, 2, 4, 16))):
        random_.choice((_flip, _cut, _repeat, _drop, _insert, _number, _number, _token, _token))(random_, data)
    return bytes(data)


def _flip(random_, data):
    if data:
        data[random_.randrange(len(data))] = random_.randrange(256)


def _cut(random_, data):
    del data[random_.randrange(len(data) + 1) :]


def _span(random_, data):
    begin = random_.randrange(len(data) + 1)
    return begin, min(len(data), begin + random_.choice((1, 4, 30, 300)))


def _repeat(random_, data):
    begin, end = _span(random_, data)
    data[end:end] = data[begin:end] * random_.choice((1, 2, 50))


def _drop(random_, data):
    begin, end = _span(random_, data)
    del data[begin:end]


def _insert(random_, data):
    begin, _ = _span(random_, data)
    data[begin:begin] = random_.choice((random_.randbytes(8), b"\0" * 8, b"<", b'"', b"]", b"\xff\xfe", b"{" * 200))


def _number(random_, data):
    found = list(re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", bytes(data[:200_000])))
    if found:
        match = random_.choice(found)
        data[match.start() : match.end()] = random_.choice(NUMBERS)


def _token(random_, data):
    """Return the data with one word replaced by another."""
    found = list(re.finditer(rb"[A-Za-z_]{3,}", bytes(data[:200_000])))
    if len(found) > 1:
        one, other = random_.choice(found), random_.choice(found)
        data[one.start() : one.end()] = other.group()


# --- who reads it


def readers():
    """Readers of a file, by target."""

    robot = load_robot("unitree_a1")

    def read_header(path):
        (path.parent / "model.xml").write_text(robot.source.xml, encoding="utf-8")
        path.replace(path.parent / "run.json")
        folder = RunFolder.open(path.parent)
        folder.method()
        folder.robot()

    def packets(layout):
        def read(path):
            data = path.read_bytes()
            read_state(layout, data)
            read_state(layout, data, check=False)
            read_command(layout, data)

        return read

    return {
        "urdf": RobotModel.from_file,
        "mjcf": RobotModel.from_file,
        "description": RobotDescription.from_toml,
        "settings": lambda path: given_settings((), path),
        "run log": read_log,
        "run header": read_header,
        "calibration": Calibration.load,
        "csv": lambda path: read_foreign(path, robot),
        "bag": lambda path: read_foreign(path, robot),
        "joint map": read_joint_map,
        **{target: packets(form) for target, form in UDP.items()},
    }


def child(connection, folder):
    """Read requested files, and write the outcomes."""
    warnings.simplefilter("ignore")
    by_target = readers()
    place = Path(folder)
    connection.send("ready")
    while (job := connection.recv()) is not None:
        target, data = job
        path = place / f"file{SUFFIX[target]}"
        path.write_bytes(data)
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                by_target[target](path)
            outcome = "read"
        except EquipoiseError as error:
            outcome = type(error).__name__ if str(error).strip() else "an error without words"
        except BaseException:
            outcome = "foreign: " + traceback.format_exc()
        connection.send(outcome)


# --- who looks on


@dataclass
class Failure:
    """File that made a reader crash."""

    target: str
    case: int
    what: str
    data: bytes


class Child:
    """Process that reads; restarted when it dies."""

    def __init__(self, folder):
        self._context = multiprocessing.get_context("spawn")
        self._folder = folder
        self._start()

    def read(self, target, data):
        self._connection.send((target, data))
        begin = time.monotonic()
        while not self._connection.poll(0.05):
            if not self._process.is_alive():
                code = self._process.exitcode
                self._start()
                return f"crash: exit code {code}"
            if time.monotonic() - begin > PATIENCE:
                self.close()
                self._start()
                return "hang"
        try:
            return self._connection.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            self._start()
            return f"crash: exit code {code}"

    def close(self):
        self._process.kill()
        self._process.join()

    def _start(self):
        self._connection, other = self._context.Pipe()
        self._process = self._context.Process(target=child, args=(other, str(self._folder)), daemon=True)
        self._process.start()
        other.close()
        self._connection.recv()


def fuzz(cases, seed, tell=lambda done, failures: None):
    """Damage a number of files and read them; return outcomes by target, and failures."""
    outcomes, failures = Counter(), []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        samples = corpus(folder)
        (folder / "child").mkdir()
        reader = Child(folder / "child")
        for case in range(cases):
            random_ = random.Random(f"{seed} {case}")
            target = list(samples)[case % len(samples)]
            data = damaged(random_, samples[target])
            outcome = reader.read(target, data)
            kind = outcome.split(":")[0]
            outcomes[target, kind] += 1
            if kind in ("foreign", "crash", "hang", "an error without words"):
                failures.append(Failure(target, case, outcome, data))
            tell(case + 1, failures)
        reader.close()
    return outcomes, failures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder for files that a reader did not survive")
    given = parser.parse_args()
    begin = time.monotonic()
    progress = lambda done, failures: print(f"\r{done} files, {len(failures)} failures", end="", file=sys.stderr)  # noqa: E731
    outcomes, failures = fuzz(given.cases, given.seed, progress)
    print(f"\r{given.cases} files, seed {given.seed}, {time.monotonic() - begin:.0f} s; {len(failures)} failures")
    for target in dict.fromkeys(target for target, _ in outcomes):
        ways = sorted((kind, count) for (of, kind), count in outcomes.items() if of == target)
        print(f"  {target}: {', '.join(f'{count} {kind}' for kind, count in ways)}")
    for failure in failures[:20]:
        print(f"\n{failure.target}, case {failure.case}: {failure.what}")
    if given.out is not None and failures:
        given.out.mkdir(parents=True, exist_ok=True)
        for failure in failures:
            name = f"{failure.target.replace(' ', '-')}-{given.seed}-{failure.case}{SUFFIX[failure.target]}"
            (given.out / name).write_bytes(failure.data)
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
