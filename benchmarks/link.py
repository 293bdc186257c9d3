"""The link to a Go2: is its 500 Hz loop punctual, and do calibrations over it match the direct simulation: `make bench-link`.

The simulated robot runs in a process of its own on the second core, as does what writes a calibration's log; the loop on the
first. Both must be idle otherwise. Ten minutes. Results are kept in benchmarks/results/link.json, of each motion and each
calibration the most punctual round; --anew begins anew, --tables only writes benchmarks/results/link.md.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
import tyro
from provenance import commit, write_page

import equipoise
from equipoise import JointCommand, Precise, RunFolder, Trajectory, calibrate, load_robot, nominal_stance, simulate
from equipoise.drivers import hardware
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.dds import open_link
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.guard.guard import Guard
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.robot.inertial import components

RESULTS = Path(__file__).parent / "results"
ROBOT, DOMAIN, PAYLOAD = "unitree_a1", 71, "1.5,0.05,-0.02,0.06"
EDGES = [0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, np.inf]  # [ms]
LIMIT, SHARE = 1.0, 0.999  # [ms], of the commands
TICK = 0.1  # [ms] of a processor
BUDGET = 60.0  # [s] of robot time
MOTIONS = ("standing", "swaying", "swaying, guarded")
COLUMNS = ("waiting only", *MOTIONS)
PERIOD = 2e-3  # [s]
NAMES = ("mass", "CoM x", "CoM y", "CoM z", "Ixx", "Iyy", "Izz")
UNITS = (1.0, 1e3, 1e3, 1e3, 1.0, 1.0, 1.0)  # kg, mm, kg m2
MODEL = load_robot(ROBOT)
STANCE = nominal_stance(MODEL).joint_position


@dataclass(frozen=True)
class Options:
    """What is measured.

    Attributes:
        seconds: of each motion.
        seeds: of the calibrations; none: no calibrations.
        anew: forget what was measured before.
        tables: measure nothing.
        realtime: let the system schedule both processes before all others, where other programs run (as root).
    """

    seconds: float = 60.0
    seeds: tuple[int, ...] = (3, 4, 5)
    anew: bool = False
    tables: bool = False
    realtime: bool = False


OPTIONS = Options()


def hurry(priority: int) -> None:
    """The calling thread goes before all that is not in real time; what it starts inherits that."""
    if OPTIONS.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO if priority else os.SCHED_OTHER, os.sched_param(priority))


class Hurried(PlatformWrapper):
    """In real time while it is moved. Who plans for a second in real time is stopped by the system, and the robot sinks."""

    def play(self, trajectory: Trajectory, stop: Any = None) -> Any:
        hurry(1)
        try:
            return super().play(trajectory, stop)
        finally:
            hurry(0)


@contextmanager
def waiting_noted() -> Generator[list[float]]:
    """Processor time of each tick [s] of the loop, its waiting left out, as long as this lasts."""
    wait, send, ticks, since = hardware._wait_until, HardwarePlatform._send, [], [0.0, 0.0]

    def waited(moment: float) -> None:
        before = time.thread_time()
        wait(moment)
        since[1] += time.thread_time() - before

    def sent(self: HardwarePlatform, command: JointCommand) -> None:
        send(self, command)
        now = time.thread_time()
        ticks.append(now - since[0] - since[1])
        since[:] = now, 0.0

    hardware._wait_until, HardwarePlatform._send = waited, sent  # pyright: ignore
    try:
        yield ticks
    finally:
        hardware._wait_until, HardwarePlatform._send = wait, send


@contextmanager
def robot(*flags: str) -> Generator[HardwarePlatform, None, None]:
    """Connected to a simulated robot on the other core."""
    command = [sys.executable, "-m", "equipoise.peers.unitree_dds", "--robot", ROBOT, "--domain", str(DOMAIN)]
    hurry(2)
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen([*command, "--start", "standing", "--no-sport-mode", *flags], stdout=log)
        os.sched_setaffinity(process.pid, {1})
        try:
            with HardwarePlatform(
                open_link(MODEL, UnitreeDdsSettings(interface="lo", domain=DOMAIN)), 30.0
            ) as connection:
                connection.read()
                yield connection
        finally:
            hurry(0)
            process.terminate()
            process.wait(timeout=10)


def lateness(motion: str, seconds: float) -> dict[str, Any]:
    """How late commands left [ms], and how often their deadlines began anew."""
    with (
        robot("--noise", "ideal") as connection,
        guard(connection, motion.endswith("guarded")) as moved,
        waiting_noted() as ticks,
    ):
        moved.play(Trajectory(np.repeat(STANCE[None], 500, axis=0)))
        timing = connection.timing
        first, lost = len(timing.lateness), timing.lost
        ticks.clear()
        if motion == "standing":
            for _ in range(round(seconds / PERIOD)):
                moved.step(JointCommand(STANCE))
        else:
            trajectory = sway()
            for _ in range(round(seconds / (len(trajectory.position) * PERIOD))):
                moved.play(trajectory)
        cpu = {"tick": np.percentile(ticks, [10, 50]).tolist()}
        return {**histogram(timing.lateness[first:] * 1e3, timing.lost - lost), **cpu}


def waiting_only(seconds: float) -> dict[str, Any]:
    """The same for a loop that does nothing else: what this machine allows."""
    hurry(2)
    late = np.zeros(round(seconds / PERIOD))
    deadline = time.monotonic()
    for step in range(len(late)):
        deadline += PERIOD
        if (left := deadline - time.monotonic() - 0.15e-3) > 0:
            time.sleep(left)
        while time.monotonic() < deadline:
            pass
        late[step] = time.monotonic() - deadline
    hurry(0)
    return histogram(late * 1e3, 0)


def histogram(late: np.ndarray, lost: int) -> dict[str, Any]:
    return {
        "commit": commit(),
        "load": os.getloadavg()[0],
        "realtime": OPTIONS.realtime,
        "counts": [int(np.sum((late > low) & (late <= high))) for low, high in itertools.pairwise([-1.0, *EDGES[1:]])],
        "percentiles": np.percentile(late, [50, 99, 99.9, 100]).tolist(),
        "on_time": float((late <= LIMIT).mean()),
        "lost": lost,
    }


def guard(connection: HardwarePlatform, wanted: bool) -> Any:
    return Guard(connection, MODEL) if wanted else nullcontext(connection)


def sway() -> Trajectory:
    """Five seconds of all legs long and short in turn, gently."""
    at = np.arange(2500) * 2e-3
    position = np.repeat(STANCE[None], len(at), axis=0)
    for place, leg in enumerate(MODEL.legs.values()):
        wave = 0.05 * np.sin(2 * np.pi * at) * (-1) ** place
        position[:, leg.joints[-2]] += wave
        position[:, leg.joints[-1]] -= 2 * wave
    return Trajectory(position)


def calibrations(seed: int) -> dict[str, Any]:
    """The same robot directly and over the link, guarded and logged: what is found, how sure, and the truth."""
    settings = Precise(budget=BUDGET)
    with simulate(MODEL, "realistic", PAYLOAD, seed) as simulation:
        found = {"truth": components(simulation.truth.composite)[:7].tolist()}
        found["direct"] = summary(calibrate(simulation.platform, MODEL, settings))
    found["floor"] = waiting_only(10.0)["on_time"]
    flags = ("--noise", "realistic", "--payload", PAYLOAD, "--seed", str(seed))
    with tempfile.TemporaryDirectory() as place, RunFolder.create(f"{place}/run", MODEL, settings, {}) as folder:
        os.sched_setaffinity(0, {1})
        folder.log.write_beside()  # before threads are bound to the first core
        os.sched_setaffinity(0, {0})
        with robot(*flags) as connection:
            began, clock = time.monotonic(), connection.read().time
            hurry(0)
            with Guard(connection, MODEL, log=folder.log) as guarded:
                found["linked"] = summary(calibrate(Hurried(guarded), MODEL, settings, folder.keep))
                found["pace"] = (connection.read().time - clock) / (time.monotonic() - began)
                timing = connection.timing
                found |= {"held": timing.held, "held_late": timing.held_late, "load": os.getloadavg()[0]}
                found |= {"realtime": OPTIONS.realtime, "late": histogram(timing.lateness * 1e3, timing.lost)}
                found["on_time"] = found["late"]["on_time"]
                hurry(1)
    return found


def summary(result: equipoise.Calibration) -> dict[str, Any]:
    return {
        "found": result.composite.values[:7].tolist(),
        "sd": result.composite.deviations[:7].tolist(),
        "robot_time": sum(trial.duration for trial in result.trials),
    }


def loop_table(results: dict[str, Any]) -> list[str]:
    names = [name for name in COLUMNS if name in results]
    columns = [results[name] for name in names]
    rows = [
        "| ms late | " + " | ".join(names) + " |",
        "|---|" + "---|" * len(columns),
    ]
    for place, (low, high) in enumerate(itertools.pairwise(EDGES)):
        name = f"{low:g} to {high:g}" if np.isfinite(high) else f"over {low:g}"
        rows.append(f"| {name} | " + " | ".join(str(column["counts"][place]) for column in columns) + " |")
    for place, name in enumerate(("median", "99 %", "99.9 %", "latest")):
        rows.append(f"| {name} | " + " | ".join(f"{column['percentiles'][place]:.3f} ms" for column in columns) + " |")
    for name, key, form in (
        (f"within {LIMIT:g} ms", "on_time", "**{:.3%}**"),
        ("deadlines missed", "lost", "{}"),
        ("load of the machine", "load", "{:.1f}"),
        ("scheduled in real time", "realtime", "{}"),
        ("commit", "commit", "{}"),
    ):
        rows.append(f"| {name} | " + " | ".join(form.format(column.get(key, "-")) for column in columns) + " |")
    met = all(results[name]["on_time"] >= SHARE for name in names if name in MOTIONS)
    rows += ["", f"Target: {SHARE:.1%} within {LIMIT:g} ms: **{'met' if met else 'missed'}**."]
    ticks = {name: results[name]["tick"] for name in names if "tick" in results[name]}
    if ticks:
        said = "; ".join(f"{name} {1e3 * tick:.2f} ({1e3 * least:.2f})" for name, (least, tick) in ticks.items())
        cheap = ticks[MOTIONS[-1]][1] <= 1e-3 * TICK
        rows += ["", f"Processor time of a tick without its waiting, link included, median (and the tenth of them that are "
                 f"cheapest) [ms]: {said}. Target: {TICK:g} ms guarded: **{'met' if cheap else 'missed'}**."]  # fmt: skip
    return rows


def punctuality_table(results: dict[str, Any]) -> list[str]:
    """Of whole calibrations."""
    rows = [
        "| seed | commands of motions | within 1 ms | within 2 ms | 99.9 % | latest | held between motions "
        "| of those within 1 ms | waiting only, just before | load | commit |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for seed, row in sorted(results.items()):
        late = row["late"]
        count = sum(late["counts"])
        two = sum(late["counts"][: EDGES.index(2.0)]) / count
        rows.append(
            f"| {seed} | {count} | **{row['on_time']:.2%}** | {two:.2%} | {late['percentiles'][2]:.2f} ms | "
            f"{late['percentiles'][3]:.1f} ms | {row['held']} | {1 - row['held_late'] / max(row['held'], 1):.1%} | "
            f"{row['floor']:.2%} | {row['load']:.1f} | {late['commit']} |"
        )
    met = all(row["on_time"] >= SHARE for row in results.values())
    return [*rows, "", f"Target: {SHARE:.1%} within {LIMIT:g} ms: **{'met' if met else 'missed'}**."]


def calibration_table(results: dict[str, Any]) -> list[str]:
    rows = [
        "| seed | | " + " | ".join(NAMES) + " | robot s | pace | on time |",
        "|---|---|" + "---|" * (len(NAMES) + 3),
    ]
    ratios: list[float] = []
    for seed, row in sorted(results.items()):
        truth = np.array(row["truth"])
        for way in ("direct", "linked"):
            error = (np.array(row[way]["found"]) - truth) * UNITS
            rest = f"{row['pace']:.3f} | {row['on_time']:.2%}" if way == "linked" else "- | -"
            deviation = np.array(row[way]["sd"]) * UNITS
            cells = " | ".join(f"{value:+.3g} ± {sd:.2g}" for value, sd in zip(error, deviation, strict=True))
            rows.append(f"| {seed} | {way} | {cells} | {row[way]['robot_time']:.0f} | {rest} |")
        difference = np.array(row["linked"]["found"]) - np.array(row["direct"]["found"])
        ratio = difference / np.hypot(row["linked"]["sd"], row["direct"]["sd"])
        ratios += ratio.tolist()
        rows.append(f"| {seed} | **apart, in sd** | " + " | ".join(f"**{value:+.2f}**" for value in ratio) + " | | | |")
    within = float(np.mean(np.abs(ratios) <= 2))
    return [
        *rows,
        "",
        f"Root mean square of all {len(ratios)} differences: {np.sqrt(np.mean(np.square(ratios))):.2f} combined standard "
        f"deviations; {within:.0%} within two.",
    ]


def report(results: dict[str, Any]) -> str:
    lines = [
        "# The link to a Go2",
        "",
        f"`make bench-link`; equipoise {equipoise.__version__}, Python {platform.python_version()}. A simulated robot speaks "
        "a Go2's messages over DDS on loopback at 500 Hz, in a process on the other core. Of each motion, the most "
        "punctual of several rounds.",
        "",
        "## How late commands leave after their deadlines",
        "",
        *(loop_table(results) if MOTIONS[0] in results else []),
    ]
    if results.get("calibrations"):
        lines += [
            "",
            "## Calibrations over it",
            "",
            f"An A1 with a payload of 1.5 kg, preset `realistic`, `precise` with a budget of {BUDGET:.0f} s, guarded; "
            "estimate less truth with the standard deviation that the result states: kg, mm, kg m2. Direct: the same robot "
            "without a link. Pace: the robot's time over ours.",
            "",
            *calibration_table(results["calibrations"]),
            "",
            "## How late their commands leave",
            "",
            "The log is written meanwhile, by a process on the other core. Commands of motions; those that repeat the last "
            "one while the next motion is planned are counted apart. Waiting only: a loop that does nothing else, for ten "
            "seconds just before: what the machine allows.",
            "",
            *punctuality_table(results["calibrations"]),
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    global OPTIONS  # noqa: PLW0603
    OPTIONS = options = tyro.cli(Options)
    warnings.simplefilter("ignore")
    kept = RESULTS / "link.json"
    results: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() and not options.anew else {}
    if not options.tables:
        os.sched_setaffinity(0, {0})
        if options.realtime:
            os.setpriority(os.PRIO_PROCESS, 0, -20)  # who plans has the lock that who holds the robot waits for
        for name in COLUMNS:
            measured = lateness(name, options.seconds) if name in MOTIONS else waiting_only(options.seconds)
            print(name, measured, flush=True)
            if measured["on_time"] >= results.get(name, measured)["on_time"]:
                results[name] = measured
            kept.write_text(json.dumps(results, indent=1) + "\n")
        for seed in options.seeds:
            measured = calibrations(seed)
            print(seed, measured, flush=True)
            known = results.setdefault("calibrations", {})
            if measured["on_time"] >= known.get(str(seed), measured)["on_time"]:
                known[str(seed)] = measured
            kept.write_text(json.dumps(results, indent=1) + "\n")
    text = report(results)
    late = [row["late"] for row in results.get("calibrations", {}).values()]
    write_page("link.md", text, [*(results[name] for name in COLUMNS), *late])
    print(text)


if __name__ == "__main__":
    main()
