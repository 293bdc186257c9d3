"""Which settings suit `projected` and `kalman` best, on robots that no table reports: `python benchmarks/peers/tune.py`.

Writes benchmarks/results/peers_tuning.md: root mean squares over four seeds of two robots each. The settings' defaults are
taken from it. Judged by the mean square of the CoM's coordinates in mm, plus three tenths of that of the inertia in %.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from numpy.typing import NDArray
from provenance import write_page

from equipoise.robot.inertial import components
from peers import filtered, projected_least_squares, rigid_body_kalman
from peers.filtered import Filtered
from peers.projected_least_squares import ProjectedSettings
from peers.rigid_body_kalman import KalmanSettings
from peers.runs import Case, known, load, record, truth

CASES = [Case(robot, seed) for robot in ("unitree_a1", "go2") for seed in range(396, 400)]
INERTIA_WEIGHT = 0.3  # [mm/%]
Settings = ProjectedSettings | KalmanSettings


def variants() -> list[Settings]:
    """Return the defaults and the alternatives that were tried."""
    least, kalman = ProjectedSettings(), KalmanSettings()
    both: list[Settings] = [least, kalman]
    found: list[Settings] = []
    for best in both:
        found.append(best)
        found += [replace(best, cutoff=cutoff) for cutoff in (3.0, 4.0, 6.0, 9.0, 12.0) if cutoff != best.cutoff]
        found += [
            replace(best, motions=motions, acceleration=acceleration)
            for motions in ("all", "planted", "shake")
            for acceleration in ("accelerometer", "kinematic")
            if (motions, acceleration) != (best.motions, best.acceleration)
        ]
    found += [replace(least, losses=losses) for losses in ("none", "joint")]
    found += [replace(least, legs="free", leg_prior=prior) for prior in (0.003, 0.01, 0.03)]
    found += [replace(kalman, losses=False), replace(kalman, body="whole"), replace(kalman, drift=0.003)]
    found += [replace(kalman, acceleration_sd=sd) for sd in (0.1, 0.3, 1.2)]
    found += [replace(kalman, torque_sd=sd) for sd in (2.0, 30.0)]
    return found


@cache
def samples_of(case: Case, kept: Path, cutoff: float, acceleration: str, motions: str) -> Filtered:
    recordings = [*load(case, kept, "shake"), *load(case, kept, "bayesian")]
    return filtered.read_all(case.robot, recordings, case.stance, cutoff, acceleration, motions)  # pyright: ignore


def errors_of(settings: Settings, case: Case, kept: Path) -> NDArray[np.float64]:
    """(10,) in %, mm, % and % of Ixx."""
    given, at = known(case, kept), case.stance.joint_position
    samples = samples_of(case, kept, settings.cutoff, settings.acceleration, settings.motions)
    if isinstance(settings, ProjectedSettings):
        body = projected_least_squares.estimate(case.robot, samples, at, settings, given.mass)
    else:
        body = rigid_body_kalman.estimate(case.robot, samples, at, settings, (given.mass, given.mass_std))
    true = truth(case, kept)
    unit = np.concatenate([[100 / true[0]], [1000.0] * 3, 100 / true[4:7], [100 / true[4]] * 3])
    return (components(body) - true) * unit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, default=Path("runs/peers"), help="folder of the recordings")
    kept = parser.parse_args().keep
    warnings.simplefilter("ignore")
    for case in CASES:
        record(case, kept)
    lines = [
        "# Peers: how their settings were chosen",
        "",
        f"`python benchmarks/peers/tune.py`; root mean square errors over {len(CASES)} robots (A1 and Go2, seeds "
        f"{CASES[0].seed} to {CASES[-1].seed}, none of which [peers.md](peers.md) reports), given a scale's mass. Chosen by: "
        f"root mean square of x, y, z in mm plus {INERTIA_WEIGHT} of that of the inertia's six in %. The first row of each "
        "is its default; the others differ in the setting that they name.",
        "",
        "| | judged | mass % | CoM x | y | z mm | Ixx | Iyy | Izz % | Ixy | Ixz | Iyz % of Ixx |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for settings in variants():
        name = "projected" if isinstance(settings, ProjectedSettings) else "kalman"
        best = asdict(type(settings)())
        differs = ", ".join(f"{key} {value}" for key, value in asdict(settings).items() if value != best[key])
        errors = np.sqrt(np.mean(np.square([errors_of(settings, case, kept) for case in CASES]), axis=0))
        judged = np.sqrt(np.mean(errors[1:4] ** 2)) + INERTIA_WEIGHT * np.sqrt(np.mean(errors[4:] ** 2))
        cells = " | ".join(f"{value:.2f}" for value in (judged, *errors))
        lines.append(f"| {name}{': ' if differs else ''}{differs} | {cells} |")
        print(lines[-1], flush=True)
    write_page("peers_tuning.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
