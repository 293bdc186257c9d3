"""The paper's experiment and the Bayesian method in Gazebo 11: `make bench-gazebo`.

Simulated A1s with random payloads and the errors of `realistic` are calibrated in Gazebo 11 with ODE, which shares no code
with MuJoCo. Every run appends a row to benchmarks/results/gazebo.jsonl, so that an interrupted benchmark can be resumed.
benchmarks/results/gazebo.md is written from the rows. Runs need the user root, see root.py. Everything is seeded.

    python benchmarks/gazebo/run.py            # missing runs, then the page
    python benchmarks/gazebo/run.py --tables   # page only
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from accuracy import Row, judged, load_rows, payload_of, relative, rms, rounded
from provenance import commit, write_page
from robustness import SCALE, SILENT, deviates, fired, is_silent

from equipoise import BayesianMethod, PaperMethod, Payload, Trajectory, calibrate, load_robot, nominal_stance
from equipoise.errors import EquipoiseError
from equipoise.lab.study.reproduction import PAPER_ESTIMATE, PAPER_TRUTH
from equipoise.robot.inertial import components
from equipoise.simulation.effects import IDEAL, REALISTIC
from gazebo.gazebo_platform import LACKS, GazeboPlatform, Ode
from gazebo.root import inside, prepare_root

Part = tuple[str, str, str]
"""Contacts, preset and method."""
RESULTS = Path(__file__).parents[1] / "results"
ROWS = RESULTS / "gazebo.jsonl"
FIRST = 20_000  # first seed; lower seeds are for development
CONTACTS = {
    "Unitree": ("`kp` 1e6, `kd` 1: the feet in Unitree's A1 URDF", Ode(kp=1e6)),
    "damped": ("`kp` 1e7, `kd` 1e4, `max_vel` 100", Ode(kp=1e7, kd=1e4, max_vel=100)),
    "Unitree, exact": ("Unitree, solver `world`", Ode(kp=1e6, solver="world")),
    "Unitree, differences": ("Unitree, velocities as in Unitree's joint controller", Ode(kp=1e6, difference=0.65)),
    "Unitree, 0.25 ms": ("Unitree, step 0.25 ms", Ode(kp=1e6, step=2.5e-4)),
    "Gazebo's defaults": ("`kp` 1e12, `kd` 1", Ode()),
    "damped, cone": ("damped, friction cone", Ode(friction_model="cone_model", kp=1e7, kd=1e4, max_vel=100)),
    "damped, exact": ("damped, solver `world`", Ode(solver="world", kp=1e7, kd=1e4, max_vel=100)),
}
"""Meaning and settings of the contacts."""
COUNTS: dict[Part, int] = {
    **{(label, "ideal", method): 1 for method in ("paper", "bayesian") for label in ("Unitree", "damped")},
    ("Unitree", "realistic", "paper"): 50,
    ("damped", "realistic", "paper"): 10,
    ("Unitree", "realistic", "bayesian"): 20,
    ("damped", "realistic", "bayesian"): 20,
    **{(label, "realistic", "bayesian"): 2 for label in list(CONTACTS)[2:]},
}
"""Number of runs by contacts, preset and method."""
TARGETS = (0.8, 0.6, 2.0, 5, 5, 5)  # CoM [mm], moments [%]
WITHIN, LEAST_WITHIN, LEAST_COVERAGE = 5.0, 0.95, 0.90  # [mm], fractions


def key_of(contacts: str, preset: str, method: str, seed: int) -> str:
    return f"{contacts}/{preset}/{method}/{seed}"


def cases() -> list[tuple[str, str, str, int]]:
    """Return contacts, preset, method and seed of all runs; parts are mixed evenly."""
    mixed = [(seed / count, (*part, FIRST + seed)) for part, count in COUNTS.items() for seed in range(count)]
    return [case for _, case in sorted(mixed, key=lambda pair: pair[0])]


def run(contacts: str, preset: str, name: str, seed: int) -> Row:
    """One row."""
    warnings.simplefilter("ignore")
    robot = load_robot("unitree_a1")
    generator = np.random.default_rng([seed, 77])
    payload = None if preset == "ideal" else Payload.parse(payload_of(robot, generator))
    sizes = (IDEAL if preset == "ideal" else REALISTIC).without_effects(LACKS)
    row: Row = {"key": key_of(contacts, preset, name, seed), "commit": commit(), "gazebo": gazebo_version()}
    try:
        with GazeboPlatform(robot, sizes, payload, seed, CONTACTS[contacts][1]) as platform:
            truth = platform.truth
            weighed = truth.composite.mass * (1 + SCALE * generator.standard_normal())
            method = PaperMethod() if name == "paper" else BayesianMethod(mass=weighed, mass_std=SCALE * weighed)
            result = calibrate(platform, robot, method).with_truth(truth)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    row["truth"], row["true_moments"] = (
        components(truth.composite).tolist(),
        truth.stance_effective.inertia.diagonal().tolist(),
    )
    if isinstance(method, BayesianMethod):
        moments = [quantity.value for quantity in result.stance_effective.inertia.moments]
        return row | judged(result) | {"moments": moments}
    row["moments"] = [excitation.moment for excitation in result.excitations.values()]
    return (
        row
        | {"error": result.composite.com_in_base.errors[:2].tolist()}
        | dict(method.study_columns(result, nominal_stance(robot)))
    )


def gazebo_version() -> str:
    query = inside("dpkg-query", "--show", "--showformat=${Version}", "gazebo")
    return subprocess.run(query, capture_output=True, text=True, check=True).stdout


def rates(contacts: str) -> Row:
    """Compare the velocities that Gazebo reports with the changes of the positions, while the perfect A1 squats for 2 s."""
    warnings.simplefilter("ignore")
    robot = load_robot("unitree_a1")
    stance = np.array(nominal_stance(robot).joint_position)
    with GazeboPlatform(robot, IDEAL, None, FIRST, CONTACTS[contacts][1]) as platform:
        bend = 0.15 * (1 - np.cos(2 * np.pi * np.arange(1000) / 500))
        joints = platform.play(Trajectory(stance + bend[:, None] * np.tile([0.0, 1.0, -2.0], 4))).joints
    slope = (joints.position[2:] - joints.position[:-2]) / (joints.time[2:] - joints.time[:-2])[:, None]
    assert joints.velocity is not None
    error = joints.velocity[1:-1] - slope
    share = float(np.sqrt((error[:, 2::3] ** 2).mean() / (slope[:, 2::3] ** 2).mean()))
    return {"key": f"{contacts}/rates", "commit": commit(), "rate_error": share}


ABOUT = """# Gazebo 11

`make bench-gazebo`; Gazebo {version} of Debian bullseye, ODE, step 1 ms, solver `quick` with 50 iterations, friction pyramid.
Simulated A1s, seeds from {first} on, which nothing was tuned on; random payloads of 5 to 30 % of the base's mass, a scale
with an error of 0.5 %. Errors are estimate minus truth; the truth is the sum of the links that Gazebo has loaded.

- By Gazebo: reading of a URDF that equipoise writes, friction and damping of the joints, contacts, floor, IMU with
  noise and bias.
- Drawn by equipoise as in `realistic`: leg masses, torque gains, joint offsets and noise, IMU tilt, floor slope, delays.
- Not simulated: inertia of the rotors, collisions of links other than feet.

Contacts of feet and floor:

"""


def rows_of(rows: dict[str, Row], part: Part) -> list[Row]:
    """Return the finished rows of a part."""
    found = [rows.get(key_of(*part, FIRST + seed)) for seed in range(COUNTS[part])]
    return [row for row in found if row is not None]


def good(rows: list[Row]) -> list[Row]:
    return [row for row in rows if "failed" not in row]


def table_one(rows: dict[str, Row]) -> list[str]:
    """Return Table I beside the paper's."""
    paper = "the paper: simulated", PAPER_TRUTH[:3], PAPER_TRUTH[3:], None
    lines = [paper, ("the paper: estimated", PAPER_ESTIMATE[:3], PAPER_ESTIMATE[3:], PAPER_TRUTH[:3])]
    for contacts, preset, method in COUNTS:
        for row in good(rows_of(rows, (contacts, preset, method))) if preset == "ideal" else ():
            com, truth = np.array(row["truth"][1:3]), row["true_moments"]
            if len(lines) == 2:
                lines.append(("truth", truth, com, None))
            error = row["error"][:2] if method == "paper" else row["error"][1:3]
            lines.append((f"`{method}`, {contacts}", row["moments"], com + error, truth))
    table = ["| | I_x | I_y | I_z | p_x | p_y |", "|---|---|---|---|---|---|"]
    for name, moments, com, truth in lines:
        cells = [f"{value:.4f}" for value in moments]
        if truth is not None:
            cells = [f"{cell} ({float(cell) / true - 1:+.0%})" for cell, true in zip(cells, truth, strict=True)]
        table.append(f"| {name} | {' | '.join(cells)} | {' | '.join(f'{1e3 * value:.2f}' for value in com)} |")
    return table


def figure_three(rows: list[Row]) -> list[str]:
    """Return the planar error after each halving; a search that ended early keeps its last error."""
    lines = ["| iteration | median | 5 to 95 % | within 5 mm |", "|---|---|---|---|"]
    paths = [np.hypot(*(np.array([row["iteration_x"], row["iteration_y"]]).T - row["truth"][1:3]).T) for row in rows]
    for index in range(max(map(len, paths))):
        error = 1e3 * np.array([path[min(index, len(path) - 1)] for path in paths])
        low, middle, high = np.percentile(error, [5, 50, 95])
        lines.append(f"| {index + 1} | {middle:.1f} mm | {low:.1f} to {high:.1f} mm | {np.mean(error <= WITHIN):.0%} |")
    return lines


def paper_line(contacts: str, rows: list[Row]) -> str:
    done = good(rows)
    error = 1e3 * np.array([row["error"] for row in done])
    inside = int((np.hypot(*error.T) <= WITHIN).sum())
    moments = rms(np.array([np.array(row["moments"]) / row["true_moments"] - 1 for row in done]))
    return (
        f"| {contacts} | {len(rows)} | {inside / len(rows):.0%} | {' '.join(f'{value:.2f}' for value in rms(error))} | "
        f"{np.hypot(*error.T).max():.2f} | {' '.join(f'{value:.0%}' for value in moments)} |"
    )


def bayesian_line(contacts: str, rows: list[Row]) -> str:
    done = good(rows)
    if not done:
        return f"| {contacts} | 0 of {len(rows)} |" + " - |" * 6
    errors = rms(np.array([relative(row, row["error"])[1:7] for row in done]))
    cells = [
        f"**{value:.2f}**" if value > most else f"{value:.2f}" for value, most in zip(errors, TARGETS, strict=True)
    ]
    holds, largest = np.mean([row["holds"] for row in done]), max(np.abs(deviates(row)).max() for row in done)
    share = f"{holds:.1%}" if holds >= LEAST_COVERAGE else f"**{holds:.1%}**"
    return (
        f"| {contacts} | {len(done)} of {len(rows)} | {' '.join(cells[:3])} | {' '.join(cells[3:])} | {share} | "
        f"{largest:.1f} | {fired(done).strip()} | {sum(map(is_silent, done))} |"
    )


def page(rows: dict[str, Row]) -> str:
    """Write the page from the rows."""
    version = next(row["gazebo"] for row in rows.values() if "gazebo" in row)
    lines = [ABOUT.format(version=version, first=FIRST).rstrip(), ""]
    lines += ["| contacts | settings | velocity error |", "|---|---|---|"]
    for contacts, (meaning, _) in CONTACTS.items():
        found = rows.get(f"{contacts}/rates")
        lines.append(f"| {contacts} | {meaning} | {'-' if found is None else format(found['rate_error'], '.1%')} |")
    lines += [
        "",
        "*Velocity error*: rms of reported joint velocities minus the slope of the positions, over the rms of the slope;",
        "knees of a squatting A1 without errors. Gazebo's `quick` solver moves bodies to correct penetrations, but leaves",
        "that motion out of the velocities of joints and gyroscope. Stiff contacts without damping do so at every step.",
        "Unitree's joint controller takes joint velocities from differences of positions; its gyroscope is still Gazebo's.",
        "",
        "## Table I",
        "",
        "An A1 as in its file, no sensor errors. Moments of base, hips and thighs [kg m2]; CoM of the robot [mm].",
        "",
        *table_one(rows),
    ]
    parts = {part: rows_of(rows, part) for part in COUNTS if part[1] == "realistic"}
    main_part = ("Unitree", "realistic", "paper")
    lines += [
        "",
        f"## Fig. 3: error of the CoM by iteration (Unitree's contacts, {len(good(parts[main_part]))} runs)",
        "",
    ]
    lines += figure_three(good(parts[main_part]))
    lines += [
        "",
        "## `paper`",
        "",
        "Planar error; a failed run is not within 5 mm. Moments against base, hips and thighs.",
        "",
    ]
    lines += [
        "| contacts | runs | within 5 mm | RMSE x y [mm] | largest [mm] | roll, pitch, yaw RMSE |",
        "|---|---|---|---|---|---|",
    ]
    lines += [paper_line(part[0], of) for part, of in parts.items() if part[2] == "paper" and good(of)]
    lines += ["", "## `bayesian`", ""]
    lines += [
        f"Whole robot. Targets: 0.8, 0.6, 2 mm, {TARGETS[3]} %, coverage {LEAST_COVERAGE:.0%}; those missed are bold."
    ]
    lines += [f"*Silent*: an error above {SILENT:g} standard deviations and no failed check.", ""]
    lines += [
        "| contacts | runs | CoM x y z RMSE [mm] | Ixx Iyy Izz [%] | coverage | largest z | failed checks | silent |"
    ]
    lines += ["|---|---|---|---|---|---|---|---|"]
    lines += [bayesian_line(part[0], of) for part, of in parts.items() if part[2] == "bayesian" and of]
    lines += ["", "No interval allows for velocities that leave out motion. Damp the feet, or use the solver `world`."]
    ended = [row for part in COUNTS for row in rows_of(rows, part) if "failed" in row]
    failed = [f"- {row['key']}: {row['failed'].split(';')[0]}" for row in ended]
    return "\n".join([*lines, *(["", "## Failed runs", "", *failed] if failed else []), ""])


def main() -> None:
    """Run missing cases, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tables", action="store_true", help="the page only")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    rows = load_rows(ROWS)
    if not given.tables:
        prepare_root()
        with ProcessPoolExecutor(given.jobs) as pool, ROWS.open("a", encoding="utf-8") as out:
            jobs = [pool.submit(rates, contacts) for contacts in CONTACTS if f"{contacts}/rates" not in rows]
            jobs += [pool.submit(run, *case) for case in cases() if key_of(*case) not in rows]
            for job in as_completed(jobs):
                row = rounded(job.result())
                rows[str(row["key"])] = row
                out.write(json.dumps(row) + "\n")
                out.flush()
                print(row["key"], row.get("failed", ""), flush=True)
    write_page("gazebo.md", page(rows), [row for row in rows.values() if "gazebo" in row])


if __name__ == "__main__":
    main()
