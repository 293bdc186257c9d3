"""Alternatives to our motor identification, on the same recordings: the second half of `benchmarks/motors.py`.

Rows are kept in motors_peers.jsonl: it goes on where it was. Peers that lack a package get a row that says so, and are run
when they have it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from commit import commit
from numpy.typing import NDArray

from equipoise import RobotModel, calibrate, load_robot, nominal_stance, simulate
from equipoise.motors.method import Motors
from equipoise.recording.recording import Recording
from equipoise.robot.scale import Scale
from peers import mujoco_sysid_motors, torque_regression, trajectory_fit
from peers.held_base import JointParameters, Swing, read_swing

RESULTS = Path(__file__).parents[1] / "results"
ROWS, LOG = RESULTS / "motors_peers.jsonl", RESULTS / "motors_go2_log.json"
NOTES = Path(__file__).parent / "motors_notes.md"
ROBOTS, FIRST, SEEDS, DURATION = ("unitree_a1", "go2"), 10_000, 4, 10
Truth = dict[str, dict[str, float]]
Fit = Callable[[RobotModel, Swing, Scale], JointParameters]
# What it is called, what it fits by, what it finds besides friction and armature, and what must be installed.
PEERS: dict[str, tuple[Fit, tuple[str, ...], str | None]] = {
    "trajectory fit (as PACE)": (trajectory_fit.fit, ("delay",), None),
    "mujoco.sysid": (mujoco_sysid_motors.fit, ("relative_gain", "delay"), "mujoco[sysid]"),
    "torque regression": (torque_regression.fit, (), None),
}
# Column of a row by what a peer calls it; errors are over the truth, but those of gains.
_OVER_TRUTH = {"coulomb_friction": "coulomb", "viscous_friction": "viscous", "armature": "armature"}


def run_missing() -> list[dict[str, Any]]:
    """All rows, those that were missing made."""
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["seed"], row["peer"]) for row in rows if "not_installed" not in row}
    for seed in range(FIRST, FIRST + SEEDS):
        for name in ROBOTS:
            if missing := [peer for peer in PEERS if (name, seed, peer) not in done]:
                recorded = record(name, seed)
                for peer in missing:
                    rows = keep(rows, row_of(name, seed, peer, *recorded))
    return rows


def keep(rows: list[dict[str, Any]], made: dict[str, Any]) -> list[dict[str, Any]]:
    """All rows, on disk too; the new one takes the place of one that says that its peer was not installed."""
    same = ("robot", "seed", "peer")
    rows = [row for row in rows if any(row[name] != made[name] for name in same)] + [made]
    ROWS.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return rows


def record(name: str, seed: int) -> tuple[RobotModel, Recording, Truth]:
    """The recording from which our row of this robot and seed was made."""
    robot, kept = load_robot(name), list[Recording]()
    with simulate(robot, "realistic", seed=seed) as simulation:
        calibrate(simulation.platform, robot, Motors(motor_time=float(DURATION)), keep=kept.append)
        return robot, kept[-1], simulation.motor_truth


def row_of(name: str, seed: int, peer: str, robot: RobotModel, recording: Recording, truth: Truth) -> dict[str, Any]:
    """Errors of all joints in the units of our table, and the CPU time that finding them took [s]."""
    fit, more, package = PEERS[peer]
    row = {"robot": name, "seed": seed, "duration": DURATION, "peer": peer, "commit": commit()}
    swing, scale = read_swing(robot, recording), nominal_stance(robot).scale
    start = time.process_time()
    try:
        found = fit(robot, swing, scale)
    except ModuleNotFoundError:
        return {**row, "not_installed": package}
    row["cpu_s"] = round(time.process_time() - start, 2)
    print(name, seed, peer, row["cpu_s"], flush=True)
    return row | errors_of(found, [truth[joint] for joint in robot.joint_names], more)


def errors_of(found: JointParameters, truth: list[dict[str, float]], more: tuple[str, ...]) -> dict[str, list[float]]:
    """Of all joints: in % of the truth; gains in %, delays in ms. Torques are in the unit in which motors report them."""
    mean = found.gain.mean()

    def true(name: str) -> NDArray[np.float64]:
        return np.array([of[name] for of in truth])

    errors = {name: 100 * (getattr(found, mine) / mean / true(name) - 1) for name, mine in _OVER_TRUTH.items()}
    if "relative_gain" in more:
        errors["relative_gain"] = 100 * (found.gain / mean - 1 - true("relative_gain"))
    if "delay" in more:
        errors["delay"] = 1e3 * (found.delay - true("delay"))
    return {name: values.tolist() for name, values in errors.items()}


def section(ours: list[dict[str, Any]], rows: list[dict[str, Any]], columns: dict[str, str]) -> Iterator[str]:
    """Lines of the page: a table, notes, and the real log.

    Args:
        ours: rows of `benchmarks/motors.py`.
        columns: label of each quantity by its name.
    """
    yield "## Others, on the same recordings"
    yield ""
    yield f"| robot | | runs | {' | '.join(columns.values())} | CPU [s] |"
    yield "|" + "---|" * (len(columns) + 4)
    same = [row for row in ours if row["duration"] == DURATION and row["seed"] < FIRST + SEEDS]
    for robot in ROBOTS:
        yield line(robot, "equipoise", [row for row in same if row["robot"] == robot], columns)
        for peer in PEERS:
            yield line(robot, peer, [row for row in rows if (row["robot"], row["peer"]) == (robot, peer)], columns)
    yield ""
    yield NOTES.read_text().rstrip()
    if LOG.exists():
        yield from log_table(json.loads(LOG.read_text()))


def line(robot: str, peer: str, rows: list[dict[str, Any]], columns: dict[str, str]) -> str:
    """Root mean squares over all joints and runs."""
    made = [row for row in rows if "not_installed" not in row]
    if not made:
        return f"| {robot} | {peer} | {'not installed' if rows else 0} |" + " |" * (len(columns) + 1)
    cells = [rms(made, name) if name in made[0] else "-" for name in columns]
    cpu = f"{np.median([row['cpu_s'] for row in made]):.2g}" if "cpu_s" in made[0] else "-"
    return f"| {robot} | {peer} | {len(made)} | {' | '.join(cells)} | {cpu} |"


def rms(rows: list[dict[str, Any]], name: str) -> str:
    """Over all joints and runs."""
    return f"{np.sqrt(np.mean(np.square([row[name] for row in rows]))):.{2 if name == 'delay' else 1}f}"


def log_table(log: dict[str, Any]) -> Iterator[str]:
    """Lines of the page on the real robot's log, after what the notes say of it."""
    yield ""
    columns = (
        "", "fitted half, rms [mrad]", "other half, predicted [mrad]", "Coulomb [Nm]", "viscous [Nm s/rad]",
        "armature [kg m2]", "delay [ms]",
    )  # fmt: skip
    yield f"| {' | '.join(columns)} |"
    yield "|" + "---|" * len(columns)
    for name, found in log["found"].items():
        motors = f"{found['coulomb']:.2f} | {found['viscous']:.2f} | {found['armature']:.3f}"
        rest = f"{motors} | {1e3 * found['delay']:.1f}"
        yield f"| {name} | {found['fitted']:.1f} | {found['predicted']:.1f} | {rest} |"
    yield ""
    yield f"Motors: the median of the joints. Made at commit {log['commit']}."
