"""Estimates from public logs of real robots, as tables of logs.md.

The logs are not distributed here: REAL_LOGS names a folder with checkouts, and the logs are read as with `--columns`. Nothing
was tuned on them.

    git clone https://github.com/mrsp/serow
    git clone https://github.com/hanlinniu/unitree_sdk2_python
    REAL_LOGS=. python benchmarks/logs.py --only=-of-
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rows import NotTriedError, Row, Table  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import robot_called
from tables import markdown

from equipoise import BayesianMethod, RobotModel
from equipoise.drivers.unitree.motors import MOTOR_LEGS, MOTORS
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.problem import MapProblem
from equipoise.estimator.solve import solve
from equipoise.lab.static.method import Static
from equipoise.logs.joint_names import map_by_order
from equipoise.logs.offline import LogEstimate, estimate_log, estimate_standing_log
from equipoise.logs.raw_log import Log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import Columns
from equipoise.result.held_out import FOUND, MODEL
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import components

MASSES = ((12.0, 0.5), (12.0, 3.0), (13.1, 0.5), (14.5, 0.5), (16.0, 0.5))  # [kg] with standard deviations
STARTS = 5
GO1 = "serow/evaluation/unit_tests/data/go1.csv"
MESSAGES = {
    state: f"unitree_sdk2_python/example/low_level/motor_state_data_example_{state}.py" for state in ("standup", "sit")
}
COLUMNS = {
    "time": "Time(s)",
    **{f"gyro.{axis}": f"BaseW{axis}" for axis in "xyz"},
    **{f"accelerometer.{axis}": f"BaseA{axis}" for axis in "xyz"},
}
ELSEWHERE = (
    (
        "mrsp/serow, `evaluation/mujoco_test`, Go2, five logs",
        "simulated; the files were not available",
    ),
    ("mrsp/serow, `evaluation/unit_tests/data/go2.csv`, Go2", "the file was not available"),
    (
        "iit-DLSLab/sim2real-robot-identification, Go2",
        "its base is fixed to a stand, without an IMU; `make bench-baselines` reads it if it is there",
    ),
    ("ouguangjun/legkilo-dataset, Go1", "stored outside its repository, not available"),
    ("UMich-CURLY/deep-contact-estimator, Mini Cheetah", "stored outside its repository, not available"),
    ("IIT's DLS datasets, HyQ", "needs an account, not available"),
    (
        "well-robotics/PRIME and Renkunzhao/PRIME, Go2 with a plate of 4.6 kg",
        "`p_sense`, `v_sense`, `tau_sense`: the layout is read; no repository was available",
    ),
    ("Renkunzhao/PRIME, `lowstate` bags, Go2 with 4 kg on one side", "the repository was not available"),
    (
        "ShahramKhorshidi/system_identification, Spot",
        "torques and contacts available; positions and velocities are too large for the copy that was available",
    ),
    ("DLinC3/LegBiCal, B1", "`b1.npz` was not available; `train.npz` and `test.npz` are synthetic"),
    ("Gepetto/quadruped-reactive-walking, Solo12", "no log in the repository"),
    ("dfki-ric-underactuated-lab/dfki-quad, Go2", "planned trajectories, no log in the repository"),
    ("LeCAR-Lab/SPI-Active, Go2", "no log in the repository"),
    ("ShuoYangRobotics/Cerberus, A1 and Go1", "no log in the repository"),
    ("alessandroassirelli98/solo12-examples, Solo12", "no log in the repository"),
    ("iit-DLSLab/muse", "no log in the repository"),
)


def file_of(path: str) -> Path:
    """Return a file in a checkout; raises NotTriedError."""
    file = Path(os.environ.get("REAL_LOGS", ""), path)
    if "REAL_LOGS" not in os.environ or not file.exists():
        raise NotTriedError(f"{path} is not in the folder that REAL_LOGS names")
    return file


def read(robot: RobotModel) -> Log:
    """Return the walk with the columns that `equipoise estimate` proposes."""
    positions = {f"position.{name}": f"JointPos{name.removesuffix('_joint')}" for name in robot.joint_names}
    forces = {f"foot_force.{leg}": f"{leg}_Force" for leg in robot.legs}
    return read_log(file_of(GO1), robot, columns=Columns({**COLUMNS, **positions, **forces}))


def walk(mass: float, std: float) -> Row:
    """Return the estimates from the whole walk and from its halves, with a mass and its standard deviation [kg]."""
    robot = robot_called("go1")
    log = read(robot)
    begin, end = float(log.recording.joints.time[0]), float(log.recording.joints.time[-1])
    middle, method = (begin + end) / 2, BayesianMethod(mass=mass, mass_std=std)
    parts = {"all": (begin, end), "first half": (begin, middle), "second half": (middle, end)}
    found = {
        name: estimate_log(robot, replace(log, recording=log.recording.between(*part)), method)
        for name, part in parts.items()
    }
    halves = [found[name].result.composite for name in ("first half", "second half")]
    return {
        **{name: part_row(one) for name, one in found.items()},
        "apart": (1e3 * (halves[0].values - halves[1].values)[1:4]).tolist(),
        "half_width": (1e3 * NORMAL_95 * np.hypot(halves[0].stds, halves[1].stds)[1:4]).tolist(),
        "other_starts": from_other_starts(found["all"]),
    }


def part_row(found: LogEstimate) -> Row:
    """Return the CoMs with half widths of 95 % intervals [mm] and the held-out errors [mm] of one estimate."""
    result, predicted = found.result, found.result.held_out
    return {
        "steps": sum(segment.steps for segment in found.report.segments),
        "coms": [
            ", ".join(f"{1e3 * one.value:.1f} ± {500 * (one.upper - one.lower):.1f}" for one in [*body][1:4])
            for body in (result.composite, result.base)
        ],
        "alarms": [check.name for check in result.checks if not check.passed],
        "held_out": [] if predicted is None else [1e3 * predicted.error(body) for body in (FOUND, MODEL)],
    }


def from_other_starts(found: LogEstimate) -> tuple[float, float]:
    """Return the largest change of the CoM [mm], and of all parameters [standard deviations], from other starts."""
    evidence = found.result.evidence
    assert isinstance(evidence, PosteriorEvidence)
    posterior = evidence.posterior
    robot, stance, priors = posterior.unknowns.robot, posterior.unknowns.stance, posterior.unknowns.priors
    moved, stds = [0.0], [0.0]
    for seed in range(STARTS):
        problem = MapProblem(robot, stance, posterior.motions, priors, posterior.problem.mass, lifts_needed=False)
        start = problem.unknowns.start()
        start[:10] += np.random.default_rng(seed).uniform(-0.2, 0.2, 10) * ([1.0] * 4 + [0.1] * 6)
        body = problem.unknowns.robot_body(solve(problem, start, 2)[0])
        apart = components(body) - components(posterior.robot_body)
        moved.append(1e3 * float(np.linalg.norm(apart[1:4])))
        stds.append(float(np.abs(apart / np.sqrt(np.diag(posterior.robot_covariance))).max()))
    return max(moved), max(stds)


def message(state: str, robot: RobotModel) -> Log:
    """Return a printed message of a Go2's motors as a log of one sample."""
    text = file_of(MESSAGES[state]).read_text(encoding="utf-8")
    numbers = re.findall(r"\bq=(\S+), dq=\S+, ddq=\S+, tau_est=(\S+),", text)[:MOTORS]
    motors = [{"q": float(position), "tau_est": float(torque)} for position, torque in numbers]
    of = {f"motor_state[{index}]": motor for index, motor in enumerate(motors)}
    joints = {match.robot_joint: match.log_joint for match in map_by_order(robot, MOTOR_LEGS, [*of]).matches}
    columns = {
        f"{kind}.{joint}": f"{name}.{field}"
        for joint, name in joints.items()
        for kind, field in (("position", "q"), ("torque", "tau_est"))
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "message.jsonl")
        file.write_text(json.dumps({"motor_state": motors}) + "\n", encoding="utf-8")
        return read_log(file, robot, columns=Columns(columns), standing=True)


def show_walk(rows: list[Row]) -> Iterator[str]:
    yield "## A real Go1 that walks for 20 s"
    yield ""
    yield (
        f"`{GO1}`: 25 s at 400 Hz, encoders, IMU, foot forces, no torques and no joint velocities. **The mass of this robot "
        "is not known**: the maker states 12 kg, and the commit that added the log names a recording of Cerberus 2.0 "
        f"(`go1_trot`), whose robot carried additional sensors. So the log is estimated with {len(rows)} assumptions of it "
        "(± one standard deviation). CoMs in the base frame, ± half of the 95 % interval; trunk: with everything fixed to it. "
        "Held out: rms error at the CoM of steps predicted by an estimate without their walk, and with the model file's body."
    )
    yield ""
    head = (
        "mass [kg]",
        "part",
        "steps",
        "CoM x, y, z [mm]",
        "trunk CoM x, y, z [mm]",
        "failed checks",
        "held out [mm]",
    )
    yield from markdown(head, _parts(rows))
    yield ""
    yield (
        f"The halves of the log, and {STARTS} other starts of the solver, with root moments of the base up to 20 % and CoMs "
        "up to 10 mm off the file's:"
    )
    yield ""
    head = (
        "mass [kg]",
        "halves apart, x, y, z [mm]",
        "its half width",
        "other starts: CoM [mm]",
        "largest change [std]",
    )
    yield from markdown(head, _changes(rows))


def _parts(rows: list[Row]) -> Iterator[list[str]]:
    for row in rows:
        for part in ("all", "first half", "second half"):
            one = row[part]
            errors = ", ".join(f"{value:.2f}" for value in one["held_out"])
            yield [_mass(row), part, one["steps"], *one["coms"], ", ".join(one["alarms"]) or "none", errors]


def _changes(rows: list[Row]) -> Iterator[list[str]]:
    for row in rows:
        vectors = [", ".join(f"{value:.1f}" for value in row[name]) for name in ("apart", "half_width")]
        yield [_mass(row), *vectors, *(f"{value:.2f}" for value in row["other_starts"])]


def _mass(row: Row) -> str:
    return "{:g} ± {:g}".format(*row["case"])


def standing(state: str) -> Row:
    """Return mass and planar CoM with half widths of 95 % intervals, from one message."""
    robot = robot_called("go2")
    mass, x, y, *_ = estimate_standing_log(robot, message(state, robot), Static()).result.composite
    return {
        "mass": [mass.value, mass.half_width],
        "com": [[1e3 * one.value, 1e3 * one.half_width] for one in (x, y)],
        "file": robot.mass,
    }


def show_standing(rows: list[Row]) -> Iterator[str]:
    yield "## Two messages of a real Go2"
    yield ""
    yield (
        f"`{MESSAGES['standup']}` and `_sit.py`: encoders and torques of one message each, without IMU, by `--method static`. "
        f"The model file of the Go2 has {rows[0]['file']:.3f} kg; the true mass is not known. A sitting robot is refused."
    )
    yield ""
    lines = (
        [
            *row["case"],
            "{:.2f} ± {:.2f}".format(*row["mass"]),
            ", ".join("{:.1f} ± {:.1f}".format(*com) for com in row["com"]),
        ]
        for row in rows
    )
    yield from markdown(("message", "mass [kg]", "CoM x, y [mm]"), lines)
    yield ""
    yield "## Public logs that were looked for"
    yield ""
    yield from markdown(("log", "state"), ELSEWHERE)


TABLES = (
    Table("walk-of-go1", walk, MASSES, show_walk),
    Table("message-of-go2", standing, [(state,) for state in MESSAGES], show_standing),
)
