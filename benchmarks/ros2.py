"""Accuracy of calibrations over ROS 2 with an emulator in its own process: `python benchmarks/ros2.py`.

It compares position controllers without gains and torques, and controllers with them, with direct simulation of the same
robot, payload, noise and truth (row `direct`). Everything runs in real time, about an hour for two seeds, and needs two free
cores; each row has the pace of the emulator's time. On a busy machine: `chrt -r 4 python ...`.
An interrupted benchmark resumes from benchmarks/results/ros2.jsonl; `--tables` only writes benchmarks/results/ros2.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import warnings
from dataclasses import dataclass, field
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per process
    os.environ.setdefault(_name, "1")

import mujoco
import numpy as np
from provenance import commit, write_page

import equipoise
from equipoise import BayesianMethod, Method, calibrate, load_robot, simulate
from equipoise.errors import EquipoiseError
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.method.table import method_named
from equipoise.robot.inertial import components

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "ros2.jsonl"
ROBOT, DOMAIN, PAYLOAD = "unitree_a1", 41, "1.0,0.05,0.02,0.08"
BUDGET = 60.0  # [s] of `bayesian`
SCALE = 0.005  # relative standard deviation of the scale
SOFT = 100.0  # [Nm/rad], stiffness of the simulated A1
GAINS, BY_JOINT = "quadruped_ros2_control", "/{joint}_controller/commands"
OLDER = "5cacbbc"  # commit of rows without one


@dataclass(frozen=True)
class Case:
    """Emulator flags and connection settings; without settings, direct simulation."""

    name: str
    peer: tuple[str, ...] = ()
    settings: dict[str, object] | None = field(default_factory=dict)


CASES = [
    Case("direct", settings=None),
    Case("soft legs, stiffness given", ("--stiffness", f"{SOFT}"), {"stiffness": SOFT}),
    Case("soft legs, torques left aside", ("--stiffness", f"{SOFT}")),
    Case("300 Nm/rad, torques left aside", ("--stiffness", "300")),
    Case("stiff (1000 Nm/rad)", ("--stiffness", "1000")),
    Case("stiff, trajectories at 100 Hz", ("--stiffness", "1000"), {"command_type": "joint_trajectory"}),
    Case(
        "the same, interpolated",
        ("--stiffness", "1000", "--interpolate-from-desired-state"),
        {"command_type": "joint_trajectory", "time_from_start": 0.01},
    ),
    Case("stiff, no efforts reported", ("--stiffness", "1000", "--unreported", "effort")),
    Case("gains, a controller an interface", ("--stack", GAINS), {"stack": GAINS}),
    Case(
        "gains, a controller a joint",
        ("--stack", GAINS, "--impedance-topic", BY_JOINT),
        {"stack": GAINS, "command_topic": BY_JOINT},
    ),
    Case("champ", ("--stack", "champ"), {"stack": "champ"}),
    Case("champ, its IMU at 250 Hz", ("--stack", "champ", "--imu-rate", "250"), {"stack": "champ"}),
    Case("unitree-go2-ros2", ("--stack", "unitree-go2-ros2"), {"stack": "unitree-go2-ros2"}),
]


def _settings(method: str) -> Method:
    return BayesianMethod(duration=BUDGET) if method == "bayesian" else method_named(method)()


def run(case: Case, method: str, seed: int) -> dict[str, object]:
    """One row."""
    robot = load_robot(ROBOT)
    with simulate(robot, "realistic", PAYLOAD, seed) as simulation:
        truth = components(simulation.truth.composite)
        settings = _settings(method).weighed(truth[0], SCALE * truth[0])
        known = {"case": case.name, "method": method, "seed": seed, "commit": commit()}
        row: dict[str, object] = {**known, "truth": truth.tolist()}
        if case.settings is None:
            return {**row, **measured(simulation.platform, robot, settings, truth)}
    with Peer(case, seed):
        with RemoteRobot("ros2", robot, {"domain": DOMAIN, **case.settings}) as remote:
            began, clock = time.monotonic(), remote.read().time
            row.update(measured(remote, robot, settings, truth))
            row["pace"] = (remote.read().time - clock) / (time.monotonic() - began)
        row["late"] = (remote.report().overruns or 0) / max(1, remote.report().commands)
    return row


def measured(platform, robot, settings, truth) -> dict[str, object]:
    """Return errors and robot time of a calibration, or its failure."""
    try:
        result = calibrate(platform, robot, settings)
    except EquipoiseError as error:
        return {"failed": f"{type(error).__name__}: {error}"}
    common = {"robot_time": sum(trial.duration for trial in result.trials), "warnings": list(result.warnings)}
    if isinstance(settings, BayesianMethod):
        error = result.composite.values - truth
        return {**common, "error": error.tolist(), "sd": result.composite.stds.tolist()}
    moments = [
        result.excitations[axis].moment if axis in result.excitations else None for axis in ("roll", "pitch", "yaw")
    ]
    found = [None, *(one.value for one in result.composite.com_in_base), *moments]
    return {**common, "error": [None if v is None else float(v - truth[i]) for i, v in enumerate(found)]}


class Peer:
    """Process of the emulator."""

    def __init__(self, case: Case, seed: int) -> None:
        flags = ["--domain", str(DOMAIN), "--seed", str(seed), "--payload", PAYLOAD, *case.peer]
        self._command = [sys.executable, "-m", "equipoise.lab.emulators.ros2", "--robot", ROBOT, *flags]

    def __enter__(self) -> Peer:
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        while '"ready"' not in self._process.stdout.readline():
            if self._process.poll() is not None:
                raise SystemExit("the emulator ended at its start")
        self._log = subprocess.Popen(["cat"], stdin=self._process.stdout, stdout=subprocess.DEVNULL)
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.terminate()
        self._process.wait(10)
        self._log.wait(10)
        self._process.stdout.close()


def rounded(row: dict[str, object]) -> dict[str, object]:
    """Round numbers to six digits, because rows are stored in the repository."""
    return json.loads(json.dumps(row), parse_float=lambda text: float(f"{float(text):.6g}"))


def cell(values: list[float | None], unit: list[float]) -> str:
    return " / ".join("-" if v is None else f"{v * u:+.2f}" for v, u in zip(values, unit, strict=True))


def write_table() -> str:
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()]
    lines = [
        "# Calibrations over ROS 2",
        "",
        f"`python benchmarks/ros2.py`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}. Estimate minus truth "
        f"on a simulated A1 with a payload of 1 kg, preset `realistic`, a scale with an error of 0.5 %, `bayesian` for "
        f"{BUDGET:.0f} s. An emulator exchanges JointState, Imu and commands over DDS on loopback in real time. "
        "`error / std`: the largest error of CoM and moments over its printed standard deviation. The paper's I is "
        "compared with the whole robot's. Pace: the emulator's time over real time. Late: commands more than a millisecond "
        "late (at 100 trajectories per second, each waits for ten samples).",
        "",
        f"Rows of commit {OLDER} were made before a correction of simulated contacts and joint friction: feet slid by up to "
        "2 mm/s, and friction led by 20 degrees at 6 Hz.",
        "",
        "| position control | method | seed | CoM x / y / z mm | Ixx / Iyy / Izz % | error / std | pace | late | commit |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    order = {case.name: index for index, case in enumerate(CASES)}
    for row in sorted(rows, key=lambda r: (r["method"] != "bayesian", order[r["case"]], r["seed"])):
        head = f"| {row['case']} | {row['method']} | {row['seed']} | "
        pace = f"{row['pace']:.3f} | {row['late']:.1%}" if "pace" in row else "- | -"
        pace += f" | {row.get('commit', OLDER)} |"
        if "failed" in row:
            lines.append(head + f"{row['failed']} | | | {pace}")
            continue
        error, truth = row["error"], row["truth"]
        moments = cell(error[4:7], [100 / value for value in truth[4:7]])
        ratio = f"{np.abs(np.array(error[1:7]) / row['sd'][1:7]).max():.1f}" if "sd" in row else "-"
        mark = " (*)" if row["warnings"] else ""
        lines.append(head + f"{cell(error[1:4], [1e3] * 3)} | {moments} | {ratio}{mark} | {pace}")
    if any(row.get("warnings") for row in rows):
        lines += ["", "(*) Warnings of the result:", ""]
        lines += [
            f"- {row['case']}, {row['method']}, {row['seed']}: {w}" for row in rows for w in row.get("warnings", [])
        ]
    text = "\n".join(lines) + "\n"
    write_page("ros2.md", text, [{"commit": row.get("commit", OLDER)} for row in rows])
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="only write the page")
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4])
    parser.add_argument("--cases", nargs="+", default=[case.name for case in CASES], help="names in the table")
    parser.add_argument("--methods", nargs="+", default=["bayesian", "paper"])
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    if not arguments.tables:
        kept = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.exists() else []
        done = {(row["case"], row["method"], row["seed"]) for row in map(json.loads, kept)}
        for seed in arguments.seeds:
            for method in arguments.methods:
                for case in (each for each in CASES if each.name in arguments.cases):
                    if (case.name, method, seed) not in done:
                        row = run(case, method, seed)
                        with ROWS.open("a", encoding="utf-8") as out:
                            out.write(json.dumps(rounded(row)) + "\n")
                        print({key: value for key, value in row.items() if key not in ("truth", "sd")}, flush=True)
    print(write_table())


if __name__ == "__main__":
    main()
