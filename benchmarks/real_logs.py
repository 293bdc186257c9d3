"""Estimates from public logs of real robots: `python benchmarks/real_logs.py --help`. Writes benchmarks/results/real_logs.md.

The logs are not distributed here: a checkout is passed by path, and read as with `--columns`. Nothing was tuned on them.

    git clone https://github.com/mrsp/serow
    git clone https://github.com/hanlinniu/unitree_sdk2_python
    python benchmarks/real_logs.py serow unitree_sdk2_python
"""

from __future__ import annotations

import argparse
import json
import os
import re
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import write_page

from equipoise import BayesianMethod, RobotModel, load_robot
from equipoise.drivers.unitree.motors import MOTOR_LEGS, MOTORS
from equipoise.errors import EquipoiseError
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

RESULTS = Path(__file__).parent / "results"
MASSES = ((12.0, 0.5), (12.0, 3.0), (13.1, 0.5), (14.5, 0.5), (16.0, 0.5))  # [kg] with standard deviations
STARTS = 5
GO1 = "evaluation/unit_tests/data/go1.csv"
MESSAGES = {state: f"example/low_level/motor_state_data_example_{state}.py" for state in ("standup", "sit")}
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
    ("iit-DLSLab/sim2real-robot-identification, Go2", "hangs on a stand, without an IMU; [motors](motors.md) reads it"),
    ("ouguangjun/legkilo-dataset, Go1", "stored outside its repository, not available"),
    ("UMich-CURLY/deep-contact-estimator, Mini Cheetah", "stored outside its repository, not available"),
    ("IIT's DLS datasets, HyQ", "needs an account, not available"),
    (
        "well-robotics/PRIME and Renkunzhao/PRIME, Go2 with a plate of 4.6 kg",
        "`p_sense`, `v_sense`, `tau_sense`: the layout is read ([base pose](base_pose.md)); no repository was available",
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


def read(checkout: Path, robot: RobotModel) -> Log:
    """Return the log with the columns that `equipoise estimate` proposes."""
    positions = {f"position.{name}": f"JointPos{name.removesuffix('_joint')}" for name in robot.joint_names}
    forces = {f"foot_force.{leg}": f"{leg}_Force" for leg in robot.legs}
    return read_log(checkout / GO1, robot, columns=Columns({**COLUMNS, **positions, **forces}))


def message(checkout: Path, state: str, robot: RobotModel) -> Log:
    """Return a printed message of a Go2's motors as a log of one sample."""
    text = (checkout / MESSAGES[state]).read_text(encoding="utf-8")
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


def of_messages(checkout: Path) -> Iterator[str]:
    """Write the section on single messages."""
    robot = load_robot("go2")
    yield "## hanlinniu/unitree_sdk2_python: two messages of a Go2"
    yield ""
    yield (
        f"`{MESSAGES['standup']}` and `_sit.py`: encoders and torques of one message each, without IMU, by `--method static`. "
        f"The model file of the Go2 has {robot.mass:.3f} kg; the true mass is not known."
    )
    yield ""
    yield "| message | mass [kg] | CoM x, y [mm] |"
    yield "|---|---|---|"
    for state in MESSAGES:
        try:
            mass, x, y, *_ = estimate_standing_log(robot, message(checkout, state, robot), Static()).result.composite
        except EquipoiseError as error:
            yield f"| {state} | {type(error).__name__}: {error} | |"
            continue
        coms = ", ".join(f"{1e3 * one.value:.1f} ± {1e3 * one.half_width:.1f}" for one in (x, y))
        yield f"| {state} | {mass.value:.2f} ± {mass.half_width:.2f} | {coms} |"


def lines(robot: RobotModel, log: Log, messages: Path) -> Iterator[str]:
    """Write the page."""
    yield "# Logs of real robots"
    yield ""
    yield (
        "`python benchmarks/real_logs.py SEROW SDK`. Public logs of quadrupeds that could be read, and those that could not. "
        "The true parameters of these robots are not known, and nothing was tuned on the logs. CoM of the whole robot at the "
        "nominal stance and of the trunk with everything fixed to it, in the base frame, with 95 % intervals."
    )
    yield ""
    yield "## mrsp/serow: a Go1 that walks for 20 s"
    yield ""
    yield (
        f"`{GO1}`: 25 s at 400 Hz, encoders, IMU, foot forces, no torques and no joint velocities. The model file is the "
        f"catalogue's `{robot.name}`. **The mass of this robot is not known**: the maker states 12 kg, and the commit that "
        "added the log names a recording of Cerberus 2.0 (`go1_trot`), whose robot carried additional sensors. So the log is "
        f"estimated with {len(MASSES)} masses. Held-out error: rms error at the CoM of steps predicted by an estimate without "
        "their walk; the second number is the error with the model file's body."
    )
    yield ""
    yield (
        "| mass given [kg] | part | steps | CoM x, y, z [mm] | trunk CoM x, y, z [mm] | failed checks "
        "| held-out error, with the file's body [mm] |"
    )
    yield "|---|---|---|---|---|---|---|"
    begin, end = float(log.recording.joints.time[0]), float(log.recording.joints.time[-1])
    middle = (begin + end) / 2
    parts = (("all", begin, end), ("first half", begin, middle), ("second half", middle, end))
    compared: list[str] = []
    for mass, std in MASSES:
        method, found = BayesianMethod(mass=mass, mass_std=std), list[LogEstimate]()
        for name, start, until in parts:
            try:
                found.append(estimate_log(robot, part(log, start, until), method))
            except EquipoiseError as error:
                yield f"| {mass:g} ± {std:g} | {name} | {type(error).__name__}: {error} | | | | |"
                continue
            yield f"| {mass:g} ± {std:g} | {name} | {row(found[-1])} |"
        if len(found) == len(parts):
            compared.append(
                f"| {mass:g} ± {std:g} | {differences(found[1], found[2])} | {from_other_starts(found[0])} |"
            )
    yield ""
    yield (
        "Difference of the estimates from the two halves, and largest change of the estimate from the whole log with "
        f"{STARTS} other starts of the solver, with root moments of the base up to 20 % and CoMs up to 10 mm off "
        "the file's."
    )
    yield ""
    yield (
        "| mass given [kg] | difference of halves, x, y, z [mm] | half-width of the difference [mm] "
        "| other starts: CoM change [mm] | in standard deviations |"
    )
    yield "|---|---|---|---|---|"
    yield from compared
    yield ""
    yield (
        "A walk does not determine the height of the IMU: each of these results states that it uses the file's, and the "
        "change of Ixx per 10 mm."
    )
    yield ""
    yield from of_messages(messages)
    yield ""
    yield "## Others"
    yield ""
    yield "| log | |"
    yield "|---|---|"
    for name, why in ELSEWHERE:
        yield f"| {name} | {why} |"


def part(log: Log, start: float, end: float) -> Log:
    return replace(log, recording=log.recording.between(start, end))


def row(found: LogEstimate) -> str:
    result, predicted = found.result, found.result.held_out
    steps = sum(segment.steps for segment in found.report.segments)
    coms = [
        ", ".join(f"{1e3 * one.value:.1f} ± {500 * (one.upper - one.lower):.1f}" for one in [*body][1:4])
        for body in (result.composite, result.base)
    ]
    failed = ", ".join(check.name for check in result.checks if not check.passed) or "none"
    errors = "" if predicted is None else f"{1e3 * predicted.error(FOUND):.2f}, {1e3 * predicted.error(MODEL):.2f}"
    return " | ".join([str(steps), *coms, failed, errors])


def differences(first: LogEstimate, second: LogEstimate) -> str:
    """Compare two halves. Sensors and legs are the same in both, so the true half-width is at most this."""
    one, other = first.result.composite, second.result.composite
    apart = 1e3 * (one.values - other.values)[1:4]
    both = 1e3 * NORMAL_95 * np.hypot(one.stds, other.stds)[1:4]
    return " | ".join(", ".join(f"{value:.1f}" for value in vector) for vector in (apart, both))


def from_other_starts(found: LogEstimate) -> str:
    """Estimate from other starts; return the largest change of the CoM, and of all parameters in standard deviations."""
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
    return f"{max(moved):.2f} | {max(stds):.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("serow", type=Path, help="checkout of mrsp/serow")
    parser.add_argument("messages", type=Path, help="checkout of hanlinniu/unitree_sdk2_python")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    robot = load_robot("go1")
    page = "\n".join(lines(robot, read(arguments.serow, robot), arguments.messages)) + "\n"
    write_page("real_logs.md", page)


if __name__ == "__main__":
    main()
