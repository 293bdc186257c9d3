"""Alternatives to our motor identification, on the same recordings: the second half of `benchmarks/motors.py`.

Rows are kept in motors_peers.jsonl, so that it resumes. Baselines that lack a package get a row that says so, and are run
when they have it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from provenance import commit

from equipoise import RobotModel, calibrate, load_robot, nominal_stance, simulate
from equipoise.motors.method import Motors
from equipoise.recording.recording import Recording
from equipoise.robot.scale import Scale
from peers import mujoco_sysid_motors, torque_regression, trajectory_fit
from peers.held_base import JointParameters, Swing, read_swing

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).parents[1] / "results"
ROWS, LOG = RESULTS / "motors_peers.jsonl", RESULTS / "motors_go2_log.json"
NOTES = Path(__file__).parent / "motors_notes.md"
FIRST, DURATION = 10_000, 10  # first seed; [s]
# Robot, preset of `--sim-preset`, engine, and how many seeds.
WORLDS = (
    ("unitree_a1", "realistic", "mujoco", 4), ("go2", "realistic", "mujoco", 4),
    ("unitree_a1", "realistic", "dart", 2), ("unitree_a1", "stress", "mujoco", 2),
)  # fmt: skip
KEY = ("robot", "noise", "engine", "seed", "peer")
Found = dict[
    str, FloatArray
]  # (nj,) of each joint by names of `Motor`, torques in the unit in which motors report them
Fit = Callable[[RobotModel, Recording, Scale], Found]


def ours(robot: RobotModel, recording: Recording, _: Scale) -> Found:
    """What `--parameters motors` says."""
    motors = Motors().estimate(robot, [recording], nominal_stance(robot)).motors.values()
    names = [name for motor in motors for name in motor.quantities]
    return {name: np.array([motor.quantities[name].value for motor in motors]) for name in names}


def ours_without_torques(robot: RobotModel, recording: Recording, scale: Scale) -> Found:
    """The same of a robot that reports none."""
    return ours(robot, replace(recording, joints=replace(recording.joints, torque=None)), scale)


def by(fit: Callable[[RobotModel, Swing, Scale], JointParameters], *more: str) -> Fit:
    """What a peer finds: friction, armature, and `more`."""
    return lambda robot, recording, scale: values_of(fit(robot, read_swing(robot, recording), scale), more)


def values_of(parameters: JointParameters, more: Sequence[str]) -> Found:
    """In the unit in which motors report torques on average."""
    p, mean = parameters, parameters.gain.mean()
    values = {"coulomb_friction": p.coulomb_friction, "viscous_friction": p.viscous_friction, "armature": p.armature}
    found = {name: of / mean for name, of in values.items()}
    besides = {"relative_gain": p.gain / mean - 1, "delay": np.full_like(p.gain, p.delay)}
    return found | {name: besides[name] for name in more}


OURS = "equipoise"
PEERS: dict[str, Fit] = {
    OURS: ours,
    "equipoise, without torques": ours_without_torques,
    "trajectory fit (as PACE)": by(trajectory_fit.fit, "delay"),
    "mujoco.sysid": by(mujoco_sysid_motors.fit, "relative_gain", "delay"),
    "torque regression": by(torque_regression.fit),
}


def run_missing() -> list[dict[str, Any]]:
    """All rows, those that were missing made."""
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    done = {tuple(row[name] for name in KEY) for row in rows if "not_installed" not in row}
    for *world, seeds in WORLDS:
        for seed in range(FIRST, FIRST + seeds):
            cases = [(*world, seed, peer) for peer in PEERS]
            if missing := [case for case in cases if case not in done]:
                recorded = record(*world, seed)
                for case in missing:
                    rows = keep(rows, dict(zip(KEY, case, strict=True)) | row_of(case[-1], *recorded))
    return rows


def keep(rows: list[dict[str, Any]], made: dict[str, Any]) -> list[dict[str, Any]]:
    """All rows, on disk too; the new one takes the place of one that says that its peer was not installed."""
    rows = [row for row in rows if any(row[name] != made[name] for name in KEY)] + [made]
    ROWS.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return rows


def record(name: str, noise: Any, engine: Any, seed: int) -> tuple[RobotModel, Recording, list[dict[str, float]]]:
    """The recording from which our row of this robot and seed was made, and each joint's true values."""
    robot, kept = load_robot(name), list[Recording]()
    with simulate(robot, noise, seed=seed, engine=engine) as simulation:
        calibrate(simulation.platform, robot, Motors(motor_time=float(DURATION)), keep=kept.append)
        print(name, noise, engine, seed, flush=True)
        return robot, kept[-1], [simulation.truth_of_parts["motors"][joint] for joint in robot.joint_names]


def row_of(peer: str, robot: RobotModel, recording: Recording, truth: list[dict[str, float]]) -> dict[str, Any]:
    """Errors of all joints in the units of our table, and the CPU time that finding them took [s]."""
    row, scale = {"commit": commit()}, nominal_stance(robot).scale
    start = time.process_time()
    try:
        found = PEERS[peer](robot, recording, scale)
    except ModuleNotFoundError as error:
        return {**row, "not_installed": str(error)}
    seconds = round(time.process_time() - start, 2)
    print(" ", peer, seconds, flush=True)
    return {**row, "cpu_s": seconds, **errors_of(found, truth)}


def errors_of(found: Found, truth: list[dict[str, float]]) -> dict[str, list[float]]:
    """Of all joints: in % of the truth; gains in %, delays in ms."""
    units = {"relative_gain": 0.01, "delay": 1e-3}

    def errors(name: str, values: FloatArray) -> FloatArray:
        true = np.array([of[name] for of in truth])
        return (values - true) / units.get(name, 0.01 * true)

    return {name: errors(name, values).tolist() for name, values in found.items()}


def section(rows: list[dict[str, Any]], columns: dict[str, str]) -> Iterator[str]:
    """Lines of the page: a table, notes, and the real log.

    Args:
        columns: label of each quantity by its name.
    """
    yield "## Others, on the same recordings"
    yield ""
    yield f"| robot | method | runs | {' | '.join(columns.values())} | CPU [s] |"
    yield "|" + "---|" * (len(columns) + 4)
    for *world, _ in WORLDS:
        for peer in PEERS:
            yield line(world, peer, [row for row in rows if [row[name] for name in KEY[:3]] == world], columns)
    yield ""
    yield NOTES.read_text().rstrip()
    for log in real_log():
        yield from log_table(log)


def line(world: list[str], peer: str, rows: list[dict[str, Any]], columns: dict[str, str]) -> str:
    """Root mean squares over all joints and runs of one world; where a peer lacks a package, what is missing."""
    robot, noise, engine = world
    name = robot + (f", `{noise}`" if noise != "realistic" else "") + (", in DART" if engine == "dart" else "")
    made = [row for row in rows if row["peer"] == peer and "not_installed" not in row]
    if not made:
        return f"| {name} | {peer} | 0 |" + " |" * (len(columns) + 1)
    cells = [rms(made, quantity) if quantity in made[0] else "-" for quantity in columns]
    cpu = f"{np.median([row['cpu_s'] for row in made]):.2g}"
    return f"| {name} | {peer} | {len(made)} | {' | '.join(cells)} | {cpu} |"


def rms(rows: list[dict[str, Any]], name: str) -> str:
    """Over all joints and runs."""
    return f"{np.sqrt(np.mean(np.square([row[name] for row in rows]))):.{2 if name == 'delay' else 1}f}"


def real_log() -> list[dict[str, Any]]:
    """Return what was found in the log of a real robot, if it is there."""
    return [json.loads(LOG.read_text())] if LOG.exists() else []


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
        motors = f"{found['coulomb_friction']:.2f} | {found['viscous_friction']:.2f} | {found['armature']:.3f}"
        rest = f"{motors} | {1e3 * found['delay']:.1f}"
        yield f"| {name} | {found['fitted']:.1f} | {found['predicted']:.1f} | {rest} |"
    yield ""
    yield "Motors: the median of the joints."
