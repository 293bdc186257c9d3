"""What public logs of real robots tell: `python benchmarks/real_logs.py --help`. Writes benchmarks/results/real_logs.md.

Logs are not ours to pass on: a checkout is given by its path, stays where it is, and is read as anybody would read it, its
columns named as by `--columns`. Nothing is tuned on them.

    git clone https://github.com/mrsp/serow
    python benchmarks/real_logs.py serow
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import write_page

from equipoise import Precise, RobotModel, load_robot
from equipoise.errors import EquipoiseError
from equipoise.logs.log import Log
from equipoise.logs.offline import LogEstimate, estimate_log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.columns import Columns
from equipoise.result.statistics import NORMAL_95

RESULTS = Path(__file__).parent / "results"
MASS, MASS_SD = 12.0, 0.5  # [kg] of a Go1 by its maker
GO1 = "evaluation/unit_tests/data/go1.csv"
COLUMNS = {
    "time": "Time(s)",
    **{f"gyro.{axis}": f"BaseW{axis}" for axis in "xyz"},
    **{f"accelerometer.{axis}": f"BaseA{axis}" for axis in "xyz"},
}
ELSEWHERE = (
    (
        "mrsp/serow, `evaluation/mujoco_test`, Go2, five logs",
        "simulated; the files were not at hand",
    ),
    ("mrsp/serow, `evaluation/unit_tests/data/go2.csv`, Go2", "the file was not at hand"),
    ("iit-DLSLab/sim2real-robot-identification, Go2", "hangs on a stand, without an IMU; [motors](motors.md) reads it"),
    ("ouguangjun/legkilo-dataset, Go1", "kept outside its repository, not at hand"),
    ("UMich-CURLY/deep-contact-estimator, Mini Cheetah", "kept outside its repository, not at hand"),
    ("IIT's DLS datasets, HyQ", "behind an account, not at hand"),
)


def read(checkout: Path, robot: RobotModel) -> Log:
    """The log, its columns named as `equipoise estimate` proposes them."""
    positions = {f"position.{name}": f"JointPos{name.removesuffix('_joint')}" for name in robot.joint_names}
    forces = {f"foot_force.{leg}": f"{leg}_Force" for leg in robot.legs}
    return read_log(checkout / GO1, robot, columns=Columns({**COLUMNS, **positions, **forces}))


def lines(robot: RobotModel, log: Log) -> Iterator[str]:
    """The page."""
    yield "# Logs of real robots"
    yield ""
    yield (
        "`python benchmarks/real_logs.py SEROW`. Every public log of a quadruped that we found and could read, with what came "
        "out, misses and refusals included. Of none of these robots the truth is known; nothing was tuned on them. CoM of the "
        "whole robot at the nominal stance and of the trunk with what is fixed to it, in the base frame, 95 % intervals."
    )
    yield ""
    yield "## mrsp/serow: a Go1 that walks for 20 s"
    yield ""
    yield (
        f"`{GO1}`: 25 s at 400 Hz, encoders, IMU, foot forces, no torques and no joint velocities. The model file is the "
        f"catalogue's `{robot.name}`; the mass is the maker's, {MASS:g} kg, taken to be good to {MASS_SD:g} kg."
    )
    yield ""
    yield (
        "| part of the log | used | CoM x, y, z [mm] | trunk's CoM x, y, z [mm] | checks that failed | "
        "unseen steps: rms error [mm], with the file's body |"
    )
    yield "|---|---|---|---|---|---|"
    begin, end = float(log.recording.joints.time[0]), float(log.recording.joints.time[-1])
    middle = (begin + end) / 2
    found: list[LogEstimate] = []
    for what, start, until in (("all of it", begin, end), ("first half", begin, middle), ("second half", middle, end)):
        try:
            found.append(estimate_log(robot, part(log, start, until), Precise(mass=MASS, mass_sd=MASS_SD)))
        except EquipoiseError as error:
            yield f"| {what} | {type(error).__name__}: {error} | | | | |"
            continue
        yield row(what, found[-1])
    if len(found) == 3:
        yield ""
        yield agreement(found[1], found[2])
    yield ""
    yield "## Others"
    yield ""
    yield "| log | |"
    yield "|---|---|"
    for name, why in ELSEWHERE:
        yield f"| {name} | {why} |"


def part(log: Log, start: float, end: float) -> Log:
    return replace(log, recording=log.recording.between(start, end))


def row(what: str, found: LogEstimate) -> str:
    result = found.result
    steps = sum(segment.steps for segment in found.report.segments)
    said = [
        ", ".join(f"{1e3 * one.value:.1f} ± {500 * (one.upper - one.lower):.1f}" for one in [*body][1:4])
        for body in (result.composite, result.base)
    ]
    failed = ", ".join(check.name for check in result.checks if not check.passed) or "none"
    predicted = result.held_out
    unseen = (
        ""
        if predicted is None
        else f"{1e3 * predicted.error('this run'):.2f}, {1e3 * predicted.error('model file'):.2f}"
    )
    return f"| {what} | {steps} steps | {' | '.join(said)} | {failed} | {unseen} |"


def agreement(first: LogEstimate, second: LogEstimate) -> str:
    """Of two halves: sensors and legs are the same in both, so that the difference is no more than this."""
    one, other = first.result.composite, second.result.composite
    apart = (one.values - other.values)[1:4]
    both = NORMAL_95 * np.hypot(one.deviations, other.deviations)[1:4]
    return (
        f"The halves differ by {', '.join(f'{1e3 * value:.1f}' for value in apart)} mm; both intervals together are "
        f"{', '.join(f'{1e3 * value:.1f}' for value in both)} mm, most of which are joint zeros and the IMU's mounting, the "
        "same in both."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("serow", type=Path, help="checkout of mrsp/serow")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    robot = load_robot("go1")
    page = "\n".join(lines(robot, read(arguments.serow, robot))) + "\n"
    write_page("real_logs.md", page)


if __name__ == "__main__":
    main()
