"""Timing of the 500 Hz loop with a Go2's messages, and agreement of its calibrations with direct simulation.

    make bench-link

An emulator sends the messages over DDS on loopback. The loop is measured with and without real-time priority, on an idle
computer and with eight busy processes; then whole calibrations run over it. It takes 25 minutes on an otherwise idle computer.
Rows are stored in benchmarks/results/link.json; --again repeats all measurements, --tables only writes the page.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
import tyro
from provenance import commit, write_page

import equipoise
from equipoise import BayesianMethod, RunFolder, Trajectory, calibrate, load_robot, nominal_stance, simulate
from equipoise.calibration.routine import perform
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.robot.inertial import components

RESULTS = Path(__file__).parent / "results"
ROBOT, DOMAIN, PAYLOAD = "unitree_a1", 71, "1.5,0.05,-0.02,0.06"
LOAD = 8  # busy processes
BUDGET = 60.0  # [s] of robot time
NAMES = ("mass", "CoM x", "CoM y", "CoM z", "Ixx", "Iyy", "Izz")
UNITS = (1.0, 1e3, 1e3, 1e3, 1.0, 1.0, 1.0)  # kg, mm, kg m2
MODEL = load_robot(ROBOT)
SLEEPER = """
import json, sys, time
from equipoise.platform.realtime import claim_real_time
claimed, period, late = claim_real_time(), 2e-3, []
due = time.monotonic()
for _ in range(round(float(sys.argv[1]) / period)):
    due += period
    time.sleep(max(0.0, due - time.monotonic()))
    late.append(time.monotonic() - due)
    due += max(0.0, late[-1] // period * period)
within = sum(each <= 1e-3 for each in late) / len(late)
print(json.dumps({"realtime": claimed, "periods": len(late), "within": within, "latest": max(late)}))
"""


@dataclass(frozen=True)
class Options:
    """Settings of the benchmark.

    Attributes:
        seconds: duration of each loop measurement; at least ten minutes for the one at load with priority.
        seeds: seeds of the calibrations.
        again: repeat all measurements.
        tables: only write the page.
    """

    seconds: float = 60.0
    seeds: tuple[int, ...] = (3, 4, 5)
    again: bool = False
    tables: bool = False


@contextlib.contextmanager
def emulator(*flags: str) -> Generator[None]:
    """Run an emulator of a lying robot."""
    command = [
        sys.executable,
        "-m",
        "equipoise.lab.emulators.unitree_dds",
        "--robot",
        ROBOT,
        "--domain",
        str(DOMAIN),
        *flags,
    ]
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log)
        try:
            time.sleep(5.0)
            yield
        finally:
            process.terminate()
            process.wait(timeout=10)


@contextlib.contextmanager
def busy(count: int) -> Generator[None]:
    """Run processes that keep the processors busy."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def remote(realtime: bool, log: Any = None) -> RemoteRobot:
    return RemoteRobot("unitree-go2", MODEL, {"interface": "lo", "domain": DOMAIN}, log, realtime=realtime)


def loop_row(realtime: bool, load: int, seconds: float) -> dict[str, Any]:
    """Measure the lateness of commands during excitation and holding, and CPU time of both processes."""
    with emulator("--sim-preset", "ideal", "--start", "standing", "--no-sport-mode"), busy(load):
        robot = remote(realtime)
        began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
        with robot:
            standing, feet = stand_up(robot, MODEL, nominal_stance(MODEL))
            trajectory = excitation()
            for _ in range(round(seconds / (len(trajectory.position) * robot.control_period))):
                robot.play(trajectory)
            move_to(standing, feet)
        wall = time.monotonic() - began
    now, report = resource.getrusage(resource.RUSAGE_SELF), robot.report()
    share = (now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime) / wall
    return {**dataclasses.asdict(report), "load": load, "calibration_share": share, "commit": commit()}


def bare_row(seconds: float) -> dict[str, Any]:
    """Measure the lateness of a process with real-time priority that only sleeps, beside busy processes, and stolen time."""
    with busy(LOAD):
        stolen = stolen_time()
        late = subprocess.run([sys.executable, "-c", SLEEPER, str(seconds)], check=True, capture_output=True, text=True)
        return {**json.loads(late.stdout), "load": LOAD, "stolen": stolen_time() - stolen, "commit": commit()}


def stolen_time() -> float:
    """Return the time that this virtual machine wanted to run and did not, in all its processors since its start [s]."""
    with open("/proc/stat", encoding="utf-8") as file:
        return int(file.readline().split()[8]) / os.sysconf("SC_CLK_TCK")


def excitation() -> Trajectory:
    """Return a slow motion of five seconds that extends and retracts all legs."""
    at = np.arange(2500) * 2e-3
    position = np.repeat(nominal_stance(MODEL).joint_position[None], len(at), axis=0)
    for place, leg in enumerate(MODEL.legs.values()):
        wave = 0.05 * np.sin(2 * np.pi * at) * (-1) ** place
        position[:, leg.joints[-2]] += wave
        position[:, leg.joints[-1]] -= 2 * wave
    return Trajectory(position)


def calibration_row(seed: int, realtime: bool) -> dict[str, Any]:
    """Calibrate the same robot directly and over the robot process; return estimates, intervals and truth."""
    method = BayesianMethod(duration=BUDGET)
    with simulate(MODEL, "realistic", PAYLOAD, seed, "lying") as simulation:
        truth = components(simulation.truth.composite)[:7].tolist()
        direct = summary(calibrate(simulation.platform, MODEL, method))
    with (
        emulator("--sim-preset", "realistic", "--payload", PAYLOAD, "--seed", str(seed)),
        tempfile.TemporaryDirectory() as place,
        RunFolder.create(f"{place}/run", MODEL, method, {}) as folder,
    ):
        robot = remote(realtime, folder.log)
        with robot:
            experiment = perform(robot, MODEL, method, folder.keep)
        linked = summary(experiment.estimate(method))
    return {
        "seed": seed, "truth": truth, "direct": direct, "linked": linked, "commit": commit(),
        **dataclasses.asdict(robot.report()),
    }  # fmt: skip


def summary(result: equipoise.Calibration) -> dict[str, Any]:
    return {"found": result.composite.values[:7].tolist(), "std": result.composite.stds[:7].tolist()}


def loop_table(rows: dict[str, Any]) -> list[str]:
    lines = [
        "| real-time priority | busy processes | commands | within 1 ms | 99.9 % [ms] | latest [ms] | missed deadlines "
        "| CPU per period [ms] | calibration process, share of a core |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows.values():
        share = 1 - row["overruns"] / row["commands"]
        lines.append(
            f"| {row['realtime']} | {row['load']} | {row['commands']} | **{share:.3%}** | {1e3 * row['late_999']:.2f} "
            f"| {1e3 * row['latest']:.2f} | {row['stalls']} | {1e3 * row['work']:.3f} | {row['calibration_share']:.0%} |"
        )
    return lines


def calibration_table(rows: dict[str, Any]) -> list[str]:
    lines = [
        "| seed | real-time priority | | " + " | ".join(NAMES) + " | within 1 ms |",
        "|---|---|---|" + "---|" * (len(NAMES) + 1),
    ]
    ratios: list[float] = []
    for row in rows.values():
        truth = np.array(row["truth"])
        for way in ("direct", "linked"):
            error, std = (np.array(row[way]["found"]) - truth) * UNITS, np.array(row[way]["std"]) * UNITS
            cells = " | ".join(f"{value:+.3g} ± {sd:.2g}" for value, sd in zip(error, std, strict=True))
            on_time = f"{1 - row['overruns'] / row['commands']:.2%}" if way == "linked" else "-"
            lines.append(
                f"| {row['seed']} | {row['realtime'] if way == 'linked' else '-'} | {way} | {cells} | {on_time} |"
            )
        apart = np.array(row["linked"]["found"]) - np.array(row["direct"]["found"])
        ratios += (apart / np.hypot(row["linked"]["std"], row["direct"]["std"])).tolist()
    rms, within = np.sqrt(np.mean(np.square(ratios))), np.mean(np.abs(ratios) <= 2)
    return [*lines, "", f"Root mean square of all {len(ratios)} differences between the two ways: {rms:.2f} combined standard "
            f"deviations; {within:.0%} within two."]  # fmt: skip


def page(rows: dict[str, Any]) -> str:
    loops = {key: row for key, row in rows.items() if key.startswith("loop")}
    calibrations = {key: row for key, row in rows.items() if key.startswith("calibration")}
    lines = [
        "# The robot process over a Go2's messages",
        "",
        f"`make bench-link`; equipoise {equipoise.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores. "
        "An emulator sends a Go2's messages over DDS on loopback at 500 Hz.",
        "",
        "## Timing of the loop",
        "",
        "Delay of every command after its deadline, during excitation and holding. Target with real-time priority at a load "
        "of 8 in ten minutes: 99.9 % within 1 ms, none later than 5 ms; CPU per period under 0.15 ms.",
        "",
        *loop_table(loops),
    ]
    if "bare" in rows:
        bare = rows["bare"]
        lines += [
            "",
            f"A process that only sleeps for 2 ms at a time, with {bare['realtime']}, on the same computer with "
            f"{bare['load']} busy processes: {bare['within']:.3%} of {bare['periods']} periods within 1 ms, latest "
            f"{1e3 * bare['latest']:.1f} ms. Meanwhile the hypervisor withheld {bare['stolen']:.2f} s of processor time.",
        ]
    if calibrations:
        lines += [
            "",
            "## Calibrations over the loop",
            "",
            f"An A1 with a payload of 1.5 kg, preset `realistic`, method `bayesian` with a duration of {BUDGET:.0f} "
            f"s, logged: "
            "estimate minus truth ± the standard deviation that the result states [kg, mm, kg m2]. Direct: the same simulated "
            "robot in one process.",
            "",
            *calibration_table(calibrations),
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = tyro.cli(Options)
    warnings.simplefilter("ignore")
    kept = RESULTS / "link.json"
    rows: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() and not options.again else {}
    wanted: dict[str, tuple[Callable[..., dict[str, Any]], tuple[Any, ...]]] = {
        f"loop {realtime} {load}": (loop_row, (realtime, load, options.seconds * (10 if realtime and load else 1)))
        for realtime in (True, False)
        for load in (0, LOAD)
    }
    wanted["bare"] = bare_row, (10 * options.seconds,)
    for place, seed in enumerate(options.seeds):
        wanted[f"calibration {seed}"] = calibration_row, (seed, place != len(options.seeds) - 1)
    for key, (measure, arguments) in wanted.items():
        if key not in rows and not options.tables:
            rows[key] = measure(*arguments)
            print(key, rows[key], flush=True)
            kept.write_text(json.dumps(rows, indent=1) + "\n")
    text = page({key: rows[key] for key in wanted if key in rows})
    write_page("link.md", text, [*rows.values()])
    print(text)


if __name__ == "__main__":
    main()
