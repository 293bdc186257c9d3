"""Tables of the page `safety`: resumption of killed runs, and loss of samples.

`equipoise calibrate` is killed (SIGKILL) at random times and resumed; the result must equal that of an uninterrupted run. A
simulated robot that is logged in real time, a quarter of a second at once as on hardware, is also killed.
"""

from __future__ import annotations

import json
import mmap
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from rows import Row, Table  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import cases_of
from tables import column, interval_of_share, markdown

from equipoise.recording.run_log_reader import read_log

KILLS = 6  # of each method
LOSSES = 12
PERIOD = 0.002  # [s]
MOST_LOST = 0.3  # [s] of samples
METHODS = {
    "bayesian": ["--duration", "30s", "--no-excitation"],
    "paper": ["--method", "paper", "--tolerance", "0.02"],
}
COMMON = ["--quiet", "--sim-preset", "realistic", "--payload", "1,0.03,0.02,0.06", "--seed", "3"]
# A child records its progress in a memory-mapped file, which survives the kill.
CALIBRATE = """
import mmap, struct, sys
from equipoise.cli import main
from equipoise.simulation.mujoco import MujocoPlatform
file = open(sys.argv[1], "r+b")
shared = mmap.mmap(file.fileno(), 8)
def noting(method):
    def noted(self, *arguments, **named):
        result = method(self, *arguments, **named)
        shared[:] = struct.pack("<q", self._periods)
        return result
    return noted
MujocoPlatform.__init__, MujocoPlatform._roll = noting(MujocoPlatform.__init__), noting(MujocoPlatform._roll)
sys.exit(main(sys.argv[2:]))
"""
ROBOT = """
import mmap, struct, sys, time
from pathlib import Path
import numpy as np
from equipoise import JointCommand, load_robot, simulate
from equipoise.platform.stepping import recording_of
from equipoise.recording.run_log import RunLog
file = open(sys.argv[1], "r+b")
shared = mmap.mmap(file.fileno(), 8)
platform = simulate(load_robot("unitree_a1"), "realistic").platform
here = platform.read().joint_position
log, states, took = RunLog(Path(sys.argv[2])), [platform.read()], []
log.begin(10**6)
begin = time.perf_counter()
for period in range(1, 10**6):
    states.append(platform.step(JointCommand(here)))
    shared[:] = struct.pack("<q", period)
    if period % 125 == 0:
        piece = recording_of(platform.joint_names, states[:125], np.tile(here, (125, 1)), ())
        start = time.perf_counter()
        log.add(piece)
        print(1000 * (time.perf_counter() - start), flush=True)
        states = states[125:]
    time.sleep(max(0.0, begin + 0.002 * period - time.perf_counter()))
"""


class Observer:
    """Reader of the number of control periods that a child has finished."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.write_bytes(bytes(8))
        with path.open("r+b") as file:
            self._shared = mmap.mmap(file.fileno(), 8)

    @property
    def periods(self) -> int:
        return int(struct.unpack("<q", self._shared[:])[0])


def begun(method: str, folder: Path, observer: Observer) -> subprocess.Popen[bytes]:
    """Start a calibration, and wait until its run folder exists."""
    arguments = ["calibrate", *METHODS[method], *COMMON, "--out", str(folder)]
    command = [sys.executable, "-c", CALIBRATE, str(observer.path), *arguments]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (folder / "run.json").exists():
        if process.poll() is not None:
            raise RuntimeError(f"the calibration ended with {process.returncode} at its start")
        time.sleep(0.001)
    return process


@cache
def uninterrupted(method: str) -> tuple[object, int]:
    """Return the result of a run, and its number of control periods."""
    with tempfile.TemporaryDirectory() as name:
        observer = Observer(Path(name, "periods"))
        if code := begun(method, Path(name, "run"), observer).wait():
            raise RuntimeError(f"the calibration ended with {code}")
        return result_in(Path(name, "run")), observer.periods


def result_in(folder: Path) -> object:
    """Return a run's result without times."""
    table = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    return {**table, "timings": None, "provenance": {**table["provenance"], "time": None}}


def killed(method: str, seed: int) -> Row:
    """Kill a run at a random delay after a random control period, which may be between motions, and resume it."""
    generator = random.Random(seed)
    wanted, periods = uninterrupted(method)
    with tempfile.TemporaryDirectory() as name:
        observer, folder, code = Observer(Path(name, "periods")), Path(name, "run"), 0
        while code == 0:  # it ended before the kill
            shutil.rmtree(folder, ignore_errors=True)
            observer = Observer(observer.path)
            period, later = generator.uniform(0, periods), generator.uniform(0, 0.3)
            process = begun(method, folder, observer)
            while observer.periods < period and process.poll() is None:
                time.sleep(0.001)
            time.sleep(later)
            process.kill()
            code = process.wait()
        log = read_log(folder)
        lost = observer.periods - sum(len(play.recording.joints.time) for play in log.plays)
        command = [sys.executable, "-m", "equipoise", "calibrate", "--quiet", "--resume", str(folder)]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
        same = done.returncode == 0 and result_in(folder) == wanted
    return {
        "moment": PERIOD * observer.periods,
        "complete": len(log.recordings),
        "lost": PERIOD * lost,
        "identical": same,
    }


def show_killed(rows: list[Row]) -> Iterator[str]:
    same = sum(row["identical"] for row in rows)
    share = f"{same} of {len(rows)} ({interval_of_share(same / len(rows), len(rows))})"
    yield "## Killed and resumed runs"
    yield ""
    yield (
        "`equipoise calibrate`, killed by SIGKILL at random times and resumed with `--resume`. The result of the "
        f"uninterrupted run, in every number of `calibration.json` except times: "
        f"{share if same == len(rows) else f'**{share}**'}. A simulation returns a motion at its end, some tens of "
        "milliseconds after its start; a lost motion is simulated again."
    )
    yield ""
    yield from markdown(
        ("method", "kills", "same result", "simulated time at the kill [s]", "largest loss [s]"), _lines(rows)
    )


def _lines(rows: list[Row]) -> Iterator[list[str]]:
    for method in METHODS:
        if of := [row for row in rows if row["case"][0] == method]:
            moments = column(of, "moment")
            same = sum(row["identical"] for row in of)
            span = f"{moments.min():.1f} to {moments.max():.1f}"
            yield [method, str(len(of)), str(same), span, f"{column(of, 'lost').max():.2f}"]


def lost(seed: int) -> Row:
    """Kill a robot that is logged in real time; return the loss of samples [s] and the times of its writes [ms]."""
    with tempfile.TemporaryDirectory() as name:
        observer, path = Observer(Path(name, "periods")), Path(name, "log.mcap")
        command = [sys.executable, "-c", ROBOT, str(observer.path), str(path)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        while not observer.periods and process.poll() is None:
            time.sleep(0.001)
        time.sleep(random.Random(seed).uniform(0.5, 4.0))
        process.kill()
        printed, _ = process.communicate()
        written = sum(len(play.recording.joints.time) for play in read_log(path).plays)
    return {"lost": PERIOD * (observer.periods - written), "writes": [float(line) for line in printed.splitlines()]}


def show_lost(rows: list[Row]) -> Iterator[str]:
    lost, writes = column(rows, "lost"), np.concatenate([row["writes"] for row in rows])
    most = f"{lost.max():.3f} s" if lost.max() <= MOST_LOST else f"**{lost.max():.3f} s**"
    yield (
        f"A robot that is logged in real time, a quarter of a second of samples at once, killed at {len(rows)} random times: "
        f"at most {most} of samples lost (target: {MOST_LOST:g} s), median {np.median(lost):.3f} s. Writing a quarter of a "
        f"second (125 samples of joints, IMU and commands) takes {np.median(writes):.1f} ms (median), "
        f"{np.percentile(writes, 95):.1f} ms (95th percentile)."
    )


TABLES = (
    Table(
        "killed",
        killed,
        cases_of({(name,): KILLS for name in METHODS}),
        show_killed,
        alone=True,
    ),
    Table("lost", lost, cases_of({(): LOSSES}), show_lost, alone=True),
)
