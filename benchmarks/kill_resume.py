"""Resumption of killed runs, and loss of samples: `make bench-kill`.

`equipoise calibrate` is killed (SIGKILL) at twenty random times and resumed; the result must equal that of an uninterrupted
run. A simulated robot that is logged in real time, a quarter of a second at once as on hardware, is also killed twenty times
to measure the loss of samples. Writes benchmarks/results/kill_resume.md.
"""

from __future__ import annotations

import json
import mmap
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import mujoco
import numpy as np
from provenance import write_page

import equipoise
from equipoise.recording.run_log_reader import read_log

RESULTS = Path(__file__).parent / "results"
KILLS, SEED = 20, 5
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


@dataclass
class Observer:
    """Return the number of control periods that a child has finished."""

    path: Path

    def __post_init__(self) -> None:
        self.path.write_bytes(bytes(8))
        with open(self.path, "r+b") as file:
            self._shared = mmap.mmap(file.fileno(), 8)

    @property
    def periods(self) -> int:
        return int(struct.unpack("<q", self._shared[:])[0])


@dataclass
class Kill:
    """Result of a killed run."""

    method: str
    moment: float  # [s] of simulated time
    complete: int  # recordings by then
    lost: float  # [s] of samples
    identical: bool


def calibrate(folder: Path, observer: Observer, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", CALIBRATE, str(observer.path), "calibrate", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (folder / "run.json").exists():
        if process.poll() is not None:
            raise RuntimeError(f"the calibration ended with {process.returncode} at its start")
        time.sleep(0.001)
    return process


def uninterrupted(method: str, folder: Path, observer: Observer) -> int:
    """Return the number of control periods of a run."""
    process = calibrate(folder, observer, *METHODS[method], *COMMON, "--out", str(folder))
    if process.wait():
        raise RuntimeError(f"the calibration ended with {process.returncode}")
    return observer.periods


def killed(method: str, folder: Path, observer: Observer, draw: random.Random, whole: int) -> Kill:
    """Kill a run at a random delay after a random control period, which may be between motions."""
    code = 0
    while code == 0:  # it ended before the kill
        shutil.rmtree(folder, ignore_errors=True)
        period, later = draw.uniform(0, whole), draw.uniform(0, 0.3)
        process = calibrate(folder, observer, *METHODS[method], *COMMON, "--out", str(folder))
        while observer.periods < period and process.poll() is None:
            time.sleep(0.001)
        time.sleep(later)
        process.kill()
        code = process.wait()
    log = read_log(folder)
    lost = observer.periods - sum(len(play.recording.joints.time) for play in log.plays)
    kill = Kill(method, PERIOD * observer.periods, len(log.recordings), PERIOD * lost, False)
    command = [sys.executable, "-m", "equipoise", "calibrate", "--quiet", "--resume", str(folder)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    kill.identical = done.returncode == 0 and result(folder) == result(folder.with_name(method))
    return kill


def result(folder: Path) -> object:
    """Return a run's result without times."""
    table = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    return {**table, "timings": None, "provenance": {**table["provenance"], "time": None}}


def calibrations(folder: Path, draw: random.Random) -> list[Kill]:
    kills: list[Kill] = []
    for method in METHODS:
        observer = Observer(folder / f"{method}.periods")
        whole = uninterrupted(method, folder / method, observer)
        for index in range(KILLS // len(METHODS)):
            kills.append(killed(method, folder / f"{method}-{index}", observer, draw, whole))
            print(kills[-1], flush=True)
    return kills


def robots(folder: Path, draw: random.Random) -> tuple[list[float], list[float]]:
    """Return seconds of lost samples, and milliseconds of each write."""
    lost: list[float] = []
    took: list[float] = []
    for index in range(KILLS):
        observer, path = Observer(folder / f"{index}.periods"), folder / f"{index}.mcap"
        command = [sys.executable, "-c", ROBOT, str(observer.path), str(path)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        while not observer.periods and process.poll() is None:
            time.sleep(0.001)
        time.sleep(draw.uniform(0.5, 4.0))
        process.kill()
        printed, _ = process.communicate()
        took += [float(line) for line in printed.splitlines()]
        log = read_log(path)
        lost.append(PERIOD * (observer.periods - sum(len(play.recording.joints.time) for play in log.plays)))
    return lost, took


def main() -> None:
    draw = random.Random(SEED)
    with tempfile.TemporaryDirectory() as name:
        kills = calibrations(Path(name), draw)
        lost, took = robots(Path(name), draw)
    same = sum(kill.identical for kill in kills)
    lines = [
        "# Killed runs",
        "",
        f"`make bench-kill`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}.",
        "",
        f"`equipoise calibrate`, killed by SIGKILL at {len(kills)} random times and resumed with `--resume`: "
        f"**{same} of {len(kills)} give the result of the uninterrupted run**, in every number of `calibration.json` except "
        "times. A simulation returns a motion at its end, some tens of milliseconds after its start; a lost motion is "
        "simulated again.",
        "",
        "| method | killed at [s of simulated time] | complete recordings by then | simulated time lost [s] | same result |",
        "|---|---|---|---|---|",
        *(
            f"| {kill.method} | {kill.moment:.2f} | {kill.complete} | {kill.lost:.2f} | {'yes' if kill.identical else 'NO'} |"
            for kill in sorted(kills, key=lambda kill: (kill.method, kill.moment))
        ),
        "",
        f"A robot that is logged in real time, a quarter of a second of samples at once, killed at {len(lost)} random "
        f"times: **at most {max(lost):.3f} s of samples lost**, median {np.median(lost):.3f} s. Target: at most "
        f"{MOST_LOST:g} s: **{'met' if max(lost) <= MOST_LOST else 'missed'}**.",
        "",
        f"Writing a quarter of a second (125 samples of joints, IMU and commands) takes {np.median(took):.2f} ms (median), "
        f"{np.percentile(took, 95):.2f} ms (95th percentile).",
    ]
    text = "\n".join(lines) + "\n"
    write_page("kill_resume.md", text)
    print(text)


if __name__ == "__main__":
    main()
