"""Accuracy of `bayesian` calibrations over UDP with good and bad networks, compared with direct simulation.

Calibrations run in real time, about a minute and a half each. Writes benchmarks/results/udp.md. The emulator has its own
process; the last columns show delays by a busy machine. An interrupted benchmark resumes from benchmarks/results/udp.jsonl;
delete the file to start again.

    python benchmarks/udp.py               # on an idle machine
    sudo chrt -r 5 python benchmarks/udp.py   # on a busy machine
"""

from __future__ import annotations

import json
import os
import platform as machine
import socket
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # the emulator uses the other core
    os.environ[_name] = "1"

import mujoco
import numpy as np
from provenance import commit, write_page

import equipoise
from equipoise import BayesianMethod, Calibration, calibrate, load_robot, simulate
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.robot.inertial import COMPONENTS

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "udp.jsonl"
SETTINGS = BayesianMethod(duration=60.0)
PAYLOAD = "1,0.05,0.02,0.08"
BAD = ("--loss", "0.02", "--duplicate", "0.02", "--reorder", "0.02")
RUNS = (("a1", ()), ("a1", BAD), ("go1", BAD))
SEEDS = (3, 4)
ROBOT = load_robot("unitree_a1")


@dataclass
class Row:
    """Calibration: connection, errors, and timing."""

    what: str
    seed: int
    result: Calibration
    timing: dict[str, Any] = field(default_factory=dict)

    def cells(self) -> list[str]:
        found = self.result.composite
        diagonal = [moment.error / moment.truth for moment in found.inertia.moments]
        return [
            self.what,
            str(self.seed),
            f"{1000 * found.mass.error:+.0f}",
            " ".join(f"{1000 * value:+.2f}" for value in found.com_in_base.errors),
            " ".join(f"{100 * value:+.1f}" for value in diagonal),
            f"{self.worst():.1f}",
            *(str(self.timing.get(name, "")) for name in ("rejected", "fresh", "late", "waited")),
        ]

    def worst(self) -> float:
        """Largest error over its printed standard deviation."""
        return float(np.max(np.abs(self.result.composite.errors) / self.result.composite.stds))


def direct(seed: int) -> Row:
    """Without a network."""
    with simulate(ROBOT, "realistic", PAYLOAD, seed) as simulation:
        return Row("no network", seed, calibrate(simulation.platform, ROBOT, SETTINGS).with_truth(simulation.truth))


def named(protocol: str, faults: tuple[str, ...]) -> str:
    return f"{protocol}, 2 % lost, doubled, overtaken" if faults else f"{protocol}, good network"


def over_udp(protocol: str, faults: tuple[str, ...], seed: int) -> Row:
    """Over loopback, guarded."""
    with simulate(ROBOT, "realistic", PAYLOAD, seed) as simulation:
        truth = simulation.truth
    port = free_port()
    with peer("--protocol", protocol, "--port", str(port), "--payload", PAYLOAD, "--seed", str(seed), *faults) as log:
        given = {"address": "127.0.0.1", "port": port, "local_port": free_port()}
        with RemoteRobot(f"unitree-{protocol}", ROBOT, given) as remote:
            result = calibrate(remote, ROBOT, SETTINGS).with_truth(truth)
        report = remote.report()
    timing = {
        "rejected": report.samples.rejected,
        "fresh": report.samples.fresh,
        "late": f"{100 * (report.overruns or 0) / report.commands:.2f} ({1000 * (report.latest or 0):.0f} ms)",
        "waited": f"{1000 * sum(entry.get('behind', 0.0) for entry in log):.0f}",
    }
    return Row(named(protocol, faults), seed, result, timing)


@contextmanager
def peer(*flags: str) -> Generator[list[dict[str, Any]]]:
    """Run the emulator in its own process; yield its log."""
    command = [sys.executable, "-m", "equipoise.lab.emulators.unitree_udp", "--sim-preset", "realistic", *flags]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    log = [json.loads(process.stdout.readline())]
    lines = process.stdout
    reader = threading.Thread(target=lambda: log.extend(json.loads(line) for line in lines), daemon=True)
    reader.start()
    try:
        yield log
    finally:
        process.terminate()
        process.wait(timeout=10)
        reader.join(timeout=10)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def table(rows: list[list[str]]) -> str:
    columns = (
        "over", "seed", "mass [g]", "CoM [mm]", "Ixx Iyy Izz [%]", f"largest error / std of {len(COMPONENTS)}", "rejected",
        "samples used", "commands over 1 ms late [%] (worst)", "delay of the emulator [ms]",
    )  # fmt: skip
    lines = [
        "# Calibrations over UDP",
        "",
        f"`python benchmarks/udp.py`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}, {machine.system()} on "
        f"{os.cpu_count()} cores. The A1 with 1 kg on it, preset `realistic`, method `bayesian` with 60 s of robot time. "
        "Errors of the whole robot's parameters, estimate minus truth; std: as printed. An emulator in its own process sends "
        "the A1's compressed or the Go1's plain packets over loopback UDP; no real robot was used. "
        f"{'Real-time' if os.sched_getscheduler(0) == os.SCHED_RR else 'Ordinary'} priority; load average at the end "
        f"{os.getloadavg()[0]:.0f}.",
        "",
        "| " + " | ".join(columns) + " |",
        "|" + "---|" * len(columns),
        *("| " + " | ".join(row) + " |" for row in rows),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    kept = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {tuple(row["cells"][:2]): row for row in kept}
    planned = [("no network", direct, ())] + [(named(*run), over_udp, run) for run in RUNS]
    rows: list[dict[str, Any]] = []
    for seed in SEEDS:
        for what, calibrated, run in planned:
            row = done.get((what, str(seed))) or {"cells": calibrated(*run, seed).cells(), "commit": commit()}
            rows.append(row)
            if row not in kept:
                with ROWS.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
                print(row, flush=True)
    text = table([row["cells"] for row in rows])
    write_page("udp.md", text, rows)
    print(text)


if __name__ == "__main__":
    main()
