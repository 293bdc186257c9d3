"""Our estimators and the alternatives that users have, on the same robots and recordings: `make bench-peers`.

Every (robot, seed, peer) appends a row to benchmarks/results/peers.jsonl, so that an interrupted benchmark resumes where it
was; benchmarks/results/peers.md is made from the rows. All is seeded. Every estimate runs in a process of its own, whose
CPU time and memory are measured.

    python benchmarks/peers/run.py             # what is missing, then the tables
    python benchmarks/peers/run.py --tables    # the tables only
    python benchmarks/peers/run.py --robots go2 --peers "kalman;bayesian"

Packages beyond equipoise's: `cvxpy` where the matrix inequalities of `projected` bind, and what `mujoco[sysid]` brings. Peers
that lack theirs get a row that says so, and are run when they have it.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform as machine
import resource
import sys
import time
import warnings
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from provenance import commit, write_page

import equipoise
from equipoise import estimate
from equipoise.errors import EquipoiseError
from equipoise.method.table import method_named
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import components, composite_parameters
from peers import filtered, mujoco_sysid, projected_least_squares, rigid_body_kalman
from peers.mujoco_sysid import SysidSettings
from peers.projected_least_squares import ProjectedSettings
from peers.rigid_body_kalman import KalmanSettings
from peers.runs import FEED_FORWARD, Case, Known, known, load, record, truth

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).parents[1] / "results"
ROWS, TABLES, NOTES = RESULTS / "peers.jsonl", RESULTS / "peers.md", Path(__file__).parent / "notes.md"
ROBOTS = ("unitree_a1", "go2", "anymal_c")
SEEDS = range(10_000, 10_008)  # none of them was used to tune a peer
SLOW_SEEDS = range(10_000, 10_005)  # of mujoco.sysid
SLOW = "mujoco.sysid"
DIGITS = 6


@dataclass(frozen=True)
class Peer:
    """One row of the table.

    Attributes:
        runs: which recordings it is given.
        module: what must be installed for it, or None.
    """

    name: str
    runs: tuple[str, ...]
    module: str | None = None


PEERS = {
    peer.name: peer
    for peer in (
        Peer("bayesian", ("bayesian",)),
        Peer("bayesian, no scale", ("bayesian",)),
        Peer("model file", ()),
        Peer("static", ("static",)),
        Peer("paper", ("paper",)),
        Peer("projected", ("shake", "bayesian"), "cvxpy"),
        Peer("projected, no scale", ("shake", "bayesian"), "cvxpy"),
        Peer("kalman", ("shake", "bayesian")),
        Peer("kalman, no scale", ("shake", "bayesian")),
        Peer(SLOW, ("shake", "bayesian"), "mujoco[sysid]"),
    )
}


def estimate_by(peer: str, case: Case, kept: Path) -> tuple[list[float | None], float]:
    """(10) components of the whole robot, None where the peer finds none, and CPU seconds from recordings to them."""
    recordings = [recording for run in PEERS[peer].runs for recording in load(case, kept, run)]
    given, (method, *rest) = known(case, kept), peer.split(", ")
    case.stance  # noqa: B018 - not to be timed
    scale = None if rest else given
    feed = [_feed_forward(case, kept, run) for run in PEERS[peer].runs for _ in load(case, kept, run)]
    start = time.process_time()
    if method in ("bayesian", "paper", "static"):
        found = _ours(method, case, recordings, scale)
    elif method == "model file":
        found = components(composite_parameters(case.robot, case.stance.joint_position)).tolist()
    else:
        found = _theirs(method, case, recordings, feed, scale)
    return found, time.process_time() - start


def _feed_forward(case: Case, kept: Path, run: str) -> tuple[FloatArray, FloatArray]:
    with np.load(case.folder(kept) / run / FEED_FORWARD) as stored:
        return stored["time"], stored["torque"]


def _ours(method: str, case: Case, recordings: list[Recording], scale: Known | None) -> list[float | None]:
    asked = method_named(method)()
    if scale is not None:
        asked = asked.weighed(scale.mass, scale.mass_std)
    result = estimate(case.robot, recordings, asked)
    if method == "bayesian":
        return result.composite.values.tolist()
    axes = ("roll", "pitch", "yaw")
    moments = [result.excitations[axis].moment if axis in result.excitations else None for axis in axes]
    return [*(quantity.value for quantity in [*result.composite][:4]), *moments, None, None, None]


def _theirs(
    method: str,
    case: Case,
    recordings: list[Recording],
    feed: list[tuple[FloatArray, FloatArray]],
    scale: Known | None,
) -> list[float | None]:
    weighed = None if scale is None else (scale.mass, scale.mass_std)
    at = case.stance.joint_position
    if method == SLOW:
        found = mujoco_sysid.estimate(case.robot, recordings, feed, case.stance, SysidSettings(), weighed)
        return components(found).tolist()
    settings = ProjectedSettings() if method == "projected" else KalmanSettings()
    samples = filtered.read_all(
        case.robot, recordings, case.stance, settings.cutoff, settings.acceleration, settings.motions
    )
    if isinstance(settings, ProjectedSettings):
        mass = None if weighed is None else weighed[0]
        return components(projected_least_squares.estimate(case.robot, samples, at, settings, mass)).tolist()
    return components(rigid_body_kalman.estimate(case.robot, samples, at, settings, weighed)).tolist()


def row_of(peer: str, case: Case, kept: Path) -> dict[str, object]:
    """One row; runs in a process of its own."""
    warnings.simplefilter("ignore")
    row: dict[str, object] = {"key": key_of(peer, case), "robot": case.robot_name, "seed": case.seed, "peer": peer}
    row["commit"] = commit()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        found, seconds = estimate_by(peer, case, kept)
    except ModuleNotFoundError:
        return {**row, "not_installed": PEERS[peer].module}
    except (EquipoiseError, np.linalg.LinAlgError) as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    true = truth(case, kept)
    errors = [None if value is None else round(float(value - t), DIGITS) for value, t in zip(found, true, strict=True)]
    recordings = [recording for run in PEERS[peer].runs for recording in load(case, kept, run)]
    return {
        **row,
        "truth": [round(float(value), DIGITS) for value in true],
        "error": errors,
        "cpu_s": round(seconds, 3),
        "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "memory_before_mb": round(before / 1024),
        "robot_time": round(sum(recording.duration for recording in recordings), 1),
    }


def key_of(peer: str, case: Case) -> str:
    return f"{case.robot_name}/{case.seed}/{peer}"


def load_rows() -> dict[str, dict]:
    """Rows by key; the last of a key counts, and one that only says what was not installed does not."""
    if not ROWS.exists():
        return {}
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines() if line.strip()]
    return {row["key"]: row for row in rows}


def run_missing(robots: Iterable[str], peers: Iterable[str], kept: Path) -> None:
    rows = load_rows()
    done = {key for key, row in rows.items() if "not_installed" not in row}
    wanted = list(peers)
    context = multiprocessing.get_context("spawn")
    for robot in robots:
        for seed in SEEDS:
            case = Case(robot, seed)
            missing = [
                peer for peer in wanted if key_of(peer, case) not in done and (peer != SLOW or seed in SLOW_SEEDS)
            ]
            if not missing:
                continue
            record(case, kept)
            with ProcessPoolExecutor(1, mp_context=context, max_tasks_per_child=1) as pool:
                for peer in missing:
                    row = pool.submit(row_of, peer, replace(case), kept).result()
                    if row != rows.get(row["key"]):  # still not installed
                        with ROWS.open("a", encoding="utf-8") as out:
                            out.write(json.dumps(row) + "\n")
                    print(row["key"], row.get("failed") or row.get("not_installed") or row["cpu_s"], flush=True)


def relative(row: dict) -> FloatArray:
    """Errors in %, mm, % of each moment, % of Ixx; nan where there is none."""
    true = np.array(row["truth"])
    unit = np.concatenate([[100 / true[0]], [1000.0] * 3, 100 / true[4:7], [100 / true[4]] * 3])
    return np.array([np.nan if value is None else value for value in row["error"]]) * unit


def table(robot: str, rows: Iterable[dict]) -> list[str]:
    lines = [
        "| peer | n | mass % | CoM x | y | z mm | Ixx | Iyy | Izz % | Ixy | Ixz | Iyz % of Ixx | CPU s | memory MB "
        "| robot time |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    here = [row for row in rows if row["robot"] == robot]
    full = [[row for row in here if row["peer"] == peer] for peer in PEERS if peer != SLOW]
    slow = [row for row in here if row["peer"] == SLOW]
    lines += table_rows([part for part in full if part])
    if slow:  # has fewer seeds, and is compared on those alone
        seeds = {row["seed"] for row in slow}
        same = [row for row in here if row["peer"] == "bayesian" and row["seed"] in seeds]
        lines += table_rows([slow, [{**row, "peer": "bayesian, on those seeds"} for row in same]])
    return lines


def table_rows(groups: list[list[dict]]) -> list[str]:
    """A line for each peer; the least of each column is bold."""
    good = [[row for row in group if "error" in row] for group in groups]
    errors = [np.sqrt(np.mean(np.square([relative(row) for row in part]), axis=0)) if part else None for part in good]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a column without values
        best = np.nanmin([error for error in errors if error is not None] or [np.full(10, np.nan)], axis=0)
    lines: list[str] = []
    for group, part, error in zip(groups, good, errors, strict=True):
        name = group[0]["peer"] if group else "?"
        if error is None:
            absent = [row["not_installed"] for row in group if "not_installed" in row]
            lines.append(f"| {name} | {f'not installed: {absent[0]}' if absent else 'failed'} |" + " |" * 13)
            continue
        cells = [
            "-" if np.isnan(value) else f"**{value:.2f}**" if value <= least else f"{value:.2f}"
            for value, least in zip(error, best, strict=True)
        ]
        memory = np.median([row["memory_mb"] - row["memory_before_mb"] for row in part])
        cpu = np.median([row["cpu_s"] for row in part])
        seconds = np.mean([row["robot_time"] for row in part])
        lines.append(
            f"| {name} | {len(part)} of {len(group)} | " + " | ".join(cells)
            + f" | {cpu:.2g} | +{memory:.0f} | {seconds:.0f} s |"
        )  # fmt: skip
    return lines


def write_tables() -> str:
    rows = list(load_rows().values())
    before = np.median([row["memory_before_mb"] for row in rows if "memory_before_mb" in row])
    lines = [
        "# Baselines on the same data",
        "",
        f"`make bench-peers`; equipoise {equipoise.__version__}, Pinocchio {pin.__version__}, MuJoCo {mujoco.__version__}, "
        f"Python {machine.python_version()}. Root mean square of estimate less truth over seeds {SEEDS[0]} to {SEEDS[-1]}, "
        "for the whole robot at the nominal stance; random payloads of 5 to 30 % of the base's mass; preset `realistic`; a "
        "scale good to 0.5 %, given to all but `static`, `paper` and those marked no scale. "
        "Bold: the lowest of a column; `mujoco.sysid`, a minute a run, has five seeds and is "
        "compared with `bayesian` on those. Robot time: of the recordings given. "
        "The paper's I is compared with the whole robot's. CPU: median process seconds from recordings to estimate, one core. "
        f"Memory: peak over what a process holds before it reads the recordings ({before:.0f} MB, nearly all imports).",
    ]
    for robot in ROBOTS:
        if any(row["robot"] == robot for row in rows):
            lines += ["", f"## {robot}", "", *table(robot, rows)]
    failed = [row for row in rows if "failed" in row]
    if failed:
        lines += ["", "## Estimates that failed", "", *(f"- {row['key']}: {row['failed']}" for row in failed)]
    text = "\n".join(lines) + "\n\n" + NOTES.read_text(encoding="utf-8")
    write_page("peers.md", text, rows)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="make the tables from the rows there are")
    parser.add_argument("--robots", default=",".join(ROBOTS), help="some of them, with commas")
    parser.add_argument("--peers", default=";".join(PEERS), help="some of them, with semicolons")
    parser.add_argument(
        "--keep", type=Path, default=Path("runs/peers"), help="folder of the recordings (45 MB a robot)"
    )
    arguments = parser.parse_args()
    if not arguments.tables:
        run_missing(arguments.robots.split(","), arguments.peers.split(";"), arguments.keep)
    print(write_tables())


if __name__ == "__main__":
    main()
