"""Accuracy of base and leg parameters from runs with swinging feet: `make bench-legs`. Writes benchmarks/results/legs.md.

The simulated legs differ from their files: 10 % in mass in common and 5 % each, CoMs 4 mm in common to a kind of link and
2 mm each, thighs and calves 1.5 mm, with the sensors of `realistic` or all of `stress`. Lengths scale with the robot. Runs
take 120 s with a scale of 0.5 %, and with `--parameters base,legs,motors` another 10 s with the legs in the air. An
interrupted benchmark resumes from legs.jsonl.
"""

from __future__ import annotations

import dataclasses
import json
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page

from equipoise import BayesianMethod, Calibration, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.method.combined import CombinedMethod
from equipoise.method.method import Method
from equipoise.motors.method import Motors
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.tree import joint_axis
from equipoise.simulation.effects import REALISTIC, STRESS, EffectSizes

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "legs.jsonl"
FIRST = 10_000  # seeds below are for development
BASE, LEGS, MOTORS = "base", "base,legs", "base,legs,motors"  # values of `--parameters`
# Preset, parameters, and number of runs of each robot. Legs with and without motors are estimated from one run.
RUNS = (
    ("realistic", LEGS, {"unitree_a1": 20, "go2": 20, "anymal_c": 8, "solo12": 8}),
    ("realistic", MOTORS, {"unitree_a1": 20, "go2": 20, "anymal_c": 8, "solo12": 8}),
    ("realistic", BASE, {"unitree_a1": 10}),
    ("stress", LEGS, {"unitree_a1": 10}),
    ("stress", MOTORS, {"unitree_a1": 10}),
)
ASKED = {
    "realistic": ("0.30 0.20 0.80", "1.8 1.2 1.5", "3.5", "6", "0.3"),
    "stress": ("0.5 0.45 1.2", "4 2.5 3", "", "", ""),
}
KINDS = ("hip", "thigh", "calf")
Row = dict[str, Any]


def world(name: str, scale: Scale) -> EffectSizes:
    """Return the errors of the simulated robot relative to its file."""
    if name == "stress":
        return STRESS.scaled_to(scale)
    long = scale.length
    return dataclasses.replace(
        REALISTIC.scaled_to(scale), leg_mass_common=0.10, leg_mass=0.05, leg_com_common=4e-3 * long, leg_com=2e-3 * long,
        leg_length=1.5e-3 * long, cable=0.0,
    )  # fmt: skip


def run(name: str, preset: str, what: str, seed: int) -> list[Row]:
    """Return errors and standard deviations of the whole robot and of each kind of link, with and without motors."""
    robot = load_robot(name)
    stance = nominal_stance(robot)
    row: Row = {"robot": name, "world": preset, "seed": seed, "commit": commit()}
    kept: list[Recording] = []
    with simulate(robot, world(preset, stance.scale), seed=seed) as simulation:
        true = simulation.truth.composite.mass
        mass = true * (1 + 0.005 * np.random.default_rng([seed, 77]).standard_normal())
        cable = "none" if preset == "realistic" else "light"
        base = BayesianMethod(mass=mass, mass_std=0.005 * mass, cable=cable, swings=what != BASE)
        methods: dict[str, Method] = (
            {BASE: base} if what == BASE else {LEGS: base, MOTORS: CombinedMethod(base, Motors())}
        )
        try:
            calibrate(simulation.platform, robot, methods[MOTORS if MOTORS in methods else BASE], kept.append)
        except EquipoiseError as error:
            return [{**row, "what": one, "failed": f"{type(error).__name__}: {error}"} for one in methods]
        lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
        found = {
            one: method.estimate(robot, kept if one == MOTORS else lifts, stance)
            .with_truth(simulation.truth)
            .with_truth_of_parts(simulation.truth_of_parts)
            for one, method in methods.items()
        }
    return [{**row, "what": one, **errors_of(result, robot)} for one, result in found.items()]


def errors_of(result: Calibration, robot: RobotModel) -> Row:
    """Return the row of a result."""
    body = list(result.composite)
    return {
        "failed_checks": [check.name for check in result.checks if not check.passed],
        "truth": [one.truth for one in body], "error": [one.error for one in body], "sd": [one.std for one in body],
        "links": links(result, robot),
    }  # fmt: skip


def links(result: Calibration, robot: RobotModel) -> Row:
    """Return errors by kind of link: first moments of estimate and file, and lengths, with standard deviations.

    First moments are across the joint's axis and along it.
    """
    found: Row = {}
    if not result.links:
        return found
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    per_leg = len(joints) // 4
    for number, (link, joint) in enumerate(zip(result.links.values(), joints, strict=True)):
        names = ("moment", "file", "along", "file along", "length", "z")
        kind = found.setdefault(KINDS[-per_leg:][number % per_leg], {name: [] for name in names})
        axis = joint_axis(robot.pinocchio, joint)
        truth, error, model = (
            np.array([getattr(one, what) for one in link.moment]) for what in ("truth", "error", "model")
        )
        size = float(np.linalg.norm(np.cross(axis, truth)))
        for name, off in (("moment", error), ("file", model - truth)):
            kind[name].append(float(np.linalg.norm(np.cross(axis, off))) / size)
            kind["along" if name == "moment" else "file along"].append(float(abs(axis @ off)) / size)
        if link.length.error is not None:
            kind["length"].append(link.length.error)
        known = [one for one in link.quantities.values() if one.value is not None]
        kind["z"] += [one.error / one.std for one in known]
    return found


def rms(values: Any) -> Any:
    """Return the rms over the first axis."""
    return np.sqrt(np.mean(np.square(np.asarray(values, dtype=float)), axis=0))


def table(rows: list[Row]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield "# Leg parameters from the same run as the base"
    yield ""
    yield (
        "`make bench-legs`: 120 s (of an A1; scaled for other robots), with `motors` another 10 s with the legs in the air, a "
        "scale with an error of 0.5 %, seeds from 10,000. `realistic` without cable, with leg mass errors of 10 % in common "
        "and 5 % each, CoM errors of 4 mm in common to a kind of link and 2 mm each, thighs and calves 1.5 mm; `stress` with "
        "all its effects. Root mean square errors. Thigh, calf: relative error of the first moment across the joint's axis, "
        "in brackets the model file's; moments of hips and along axes are hardly identifiable. Coverage: share of 95 % "
        "intervals that contain the truth, of the whole robot's ten parameters, and of all links. std/rms: mean standard "
        "deviation over the rms error, of the CoM and of the moments of inertia."
    )
    yield ""
    yield (
        "| preset | `--parameters` | robot | runs | CoM x y z [mm] | Ixx Iyy Izz [%] | thigh (file) [%] | calf (file) [%] "
        "| lengths [mm] | coverage | coverage, links | std/rms | checks failed |"
    )
    yield "|" + "---|" * 13
    for preset, what, counts in RUNS:
        if what == LEGS:
            asked = ASKED[preset]
            yield f"| *{preset}, target* | | | | {' | '.join(asked)} | 90 % | 90 % | at most 2 | |"
        for name in counts:
            of = [row for row in rows if (row["robot"], row["world"], row["what"]) == (name, preset, what)]
            if of:
                yield line(f"{preset} | {what}", name, of)


def line(world: str, name: str, rows: list[Row]) -> str:
    """Return a row of the table."""
    done = [row for row in rows if "error" in row]
    lost = f" ({len(rows) - len(done)} failed)" if len(done) < len(rows) else ""
    error, sd, truth = (np.array([row[key] for row in done]) for key in ("error", "sd", "truth"))
    relative = error[:, 4:7] / truth[:, 4:7]
    cells = [
        world,
        name,
        f"{len(done)}{lost}",
        figures(1000 * rms(error[:, 1:4]), ".2f"),
        figures(100 * rms(relative), ".1f"),
    ]
    kinds = {kind: [row["links"][kind] for row in done if kind in row["links"]] for kind in KINDS}
    for kind in KINDS[1:]:
        values = [[100 * value for one in kinds[kind] for value in one[key]] for key in ("moment", "file")]
        cells.append("{:.1f} ({:.1f})".format(*map(rms, values)) if kinds[kind] else "")
    lengths, z = (
        np.array([value for kind in KINDS for one in kinds[kind] for value in one[key]]) for key in ("length", "z")
    )
    ratio = [sd[:, k].mean() / rms(error[:, k]) for k in range(1, 7)]
    cells += [f"{1000 * rms(lengths):.2f}" if len(lengths) else "", f"{np.mean(np.abs(error / sd) < 1.96):.0%}"]
    cells += [f"{np.mean(np.abs(z) < 1.96):.0%}" if len(z) else "", figures(np.array(ratio), ".1f")]
    cells.append(str(sum(bool(row["failed_checks"]) for row in done)))
    return f"| {' | '.join(cells)} |"


def figures(values: Any, form: str) -> str:
    """Return several numbers separated by spaces."""
    return " ".join(format(value, form) for value in values)


def case_of(row: Row) -> tuple[str, str, str, int]:
    """Return the case of a row."""
    return row["robot"], row["world"], row["what"], row["seed"]


def main() -> None:
    warnings.simplefilter("ignore")
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    done = {case_of(row) for row in rows}
    parts = [
        (seed / count, (name, preset, what, FIRST + seed))
        for preset, what, counts in RUNS
        for name, count in counts.items()
        for seed in range(count)
        if what != LEGS
    ]
    for _, case in sorted(parts):  # parts mixed evenly
        if case not in done:
            for row in run(*case):
                if case_of(row) in done:  # one of two rows of a run that was interrupted
                    continue
                rows.append(row)
                print(*case, row["what"], row.get("failed", ""), flush=True)
                with ROWS.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    write_page("legs.md", "\n".join(table(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
