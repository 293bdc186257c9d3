"""Calibrations in other physics engines: `make bench-engines`. Writes benchmarks/results/engines.md.

Four robots are calibrated in MuJoCo, DART and PyBullet with the same drawn payloads and errors, an A1 also in Drake, and in
Gazebo 11 with ODE by both methods. PyBullet, Drake and Gazebo share no code with MuJoCo and are not part of the package;
nothing was tuned in them. Runs in Gazebo need the user root and its root folder, see gazebo/root.py.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from importlib.metadata import version
from itertools import product

from rows import NotTriedError, Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from gazebo.gazebo_platform import LACKS, GazeboPlatform, Ode
from gazebo.root import ROOT, SERVER
from simulated import FIRST_SEED, SCALE_ERROR, cases_of, judged, payload_of, robot_called, weighed
from tables import (
    SILENT,
    column,
    coverage_with_interval,
    failed_checks,
    figures,
    interval_of_share,
    is_silent,
    markdown,
    relative,
    rms,
)
from worlds.world import ENGINES, lacking, world

from equipoise import BayesianMethod, PaperMethod, Payload, Trajectory, calibrate, nominal_stance
from equipoise.lab.study.reproduction import PAPER_ESTIMATE, PAPER_TRUTH
from equipoise.robot.inertial import components
from equipoise.simulation.effects import IDEAL, REALISTIC

PRESETS = ("ideal", "realistic")
ROBOTS = {"unitree_a1": 5, "go2": 3, "solo12": 3, "anymal_c": 3}
IN_ENGINES = {
    (preset, name, engine): n
    for (name, n), preset, engine in product(ROBOTS.items(), PRESETS, ENGINES)
    if engine != "drake" or name == "unitree_a1"
}
"""Number of runs by preset, robot and engine."""
PACKAGES = {"mujoco": "mujoco", "dart": "dartpy", "pybullet": "pybullet", "drake": "drake"}
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
"""Meaning and settings of Gazebo's contacts."""
IN_GAZEBO = {
    ("damped", "realistic", "bayesian"): 20,
    ("Unitree", "realistic", "bayesian"): 20,
    ("Unitree, exact", "realistic", "bayesian"): 2,
    ("Unitree, differences", "realistic", "bayesian"): 2,
    ("Unitree", "realistic", "paper"): 50,
    **{(contacts, "ideal", method): 1 for method in ("paper", "bayesian") for contacts in ("Unitree", "damped")},
}
"""Number of runs by contacts, preset and method."""
TARGETS = (0.8, 0.6, 2.0), (5.0, 5.0, 5.0)  # CoM [mm], moments [%]
COVERAGE = 0.9
WITHIN = 5e-3  # [m], of the paper's planar CoM


def in_engine(preset: str, name: str, engine: str, seed: int) -> Row:
    """Return the row of a calibration without a scale in an engine of `ENGINES`."""
    robot = robot_called(name)
    payload = Payload.parse(payload_of(robot, np.random.default_rng([seed, 77])))
    begin = time.process_time()
    with world(engine, preset, robot, payload, seed) as (platform, inertia):
        result = calibrate(platform, robot)
    return judged(result, inertia) | {
        "cpu": time.process_time() - begin,
        "version": f"{ENGINES[engine]} {version(PACKAGES[engine])}",
        "lacks": list(lacking(engine, preset)),
    }


def show_engines(rows: list[Row]) -> Iterator[str]:
    versions = dict.fromkeys(row["version"] for row in rows)
    lacks = {ENGINES[row["case"][2]]: ", ".join(f"`{name}`" for name in row["lacks"]) for row in rows if row["lacks"]}
    yield "## MuJoCo, DART, PyBullet and Drake"
    yield ""
    yield (
        f"{', '.join(versions)}. `bayesian` without a scale. Contact, joint friction and integration are each engine's own; "
        "each engine computes the truth of its bodies. `realistic` lacks what an engine does not support "
        f"({'; '.join(f'{engine}: {names}' for engine, names in lacks.items())}). Drake has hydroelastic contact and the "
        "solver SAP. Difference: of the errors in an engine and in MuJoCo, over their combined standard deviation, same "
        "seeds. CPU time: median of a calibration on one core, with planning and estimation."
    )
    yield ""
    head = (
        "preset",
        "engine",
        "runs",
        "coverage",
        "error / std, rms",
        "largest",
        "difference / std, rms",
        "largest",
        "failed checks",
    )
    yield from markdown(head, _engine_lines(rows))
    yield ""
    head = ("preset", "robot", "engine", "runs", "mass [%]", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "CPU time [s]")
    yield from markdown(head, _robot_lines(rows))


def _engine_lines(rows: list[Row]) -> Iterator[list[str]]:
    for preset, (engine, called) in product(PRESETS, ENGINES.items()):
        if of := [row for row in rows if row["case"][0] == preset and row["case"][2] == engine]:
            ratios, apart = column(of, "error") / column(of, "sd"), difference(of, rows)
            cells = ["-", "-"]
            if engine != "mujoco" and len(apart):
                cells = [figures(rms(apart.ravel())), figures(np.abs(apart).max())]
            yield [
                preset, called, str(len(of)), coverage_with_interval(of),
                figures(rms(ratios.ravel())), figures(np.abs(ratios).max()), *cells, failed_checks(of),
            ]  # fmt: skip


def difference(of: list[Row], rows: list[Row]) -> np.ndarray:
    """Return (n, 10) differences from MuJoCo's errors of the same seeds, over the combined standard deviations.

    Errors are compared instead of estimates, because each engine assembles the drawn legs itself.
    """
    in_mujoco = {(row["case"][0], row["case"][1], row["case"][3]): row for row in rows if row["case"][2] == "mujoco"}
    pairs = [(row, in_mujoco.get((row["case"][0], row["case"][1], row["case"][3]))) for row in of]
    return np.array([
        np.subtract(row["error"], other["error"]) / np.hypot(row["sd"], other["sd"]) for row, other in pairs if other
    ])  # fmt: skip


def _robot_lines(rows: list[Row]) -> Iterator[list[str]]:
    for preset, name, (engine, called) in product(PRESETS, ROBOTS, ENGINES.items()):
        if of := [row for row in rows if row["case"][:3] == [preset, name, engine]]:
            error = rms(relative(of))
            cells = [figures(error[:1], ".1f"), figures(error[1:4]), figures(error[4:7], ".1f")]
            yield [preset, name, called, str(len(of)), *cells, figures(np.median(column(of, "cpu")), ".0f")]


def needs_gazebo() -> None:
    """Raise an error if this machine cannot run Gazebo."""
    if os.geteuid() != 0 or not (ROOT / SERVER[1:]).exists():
        raise NotTriedError("Gazebo 11 is not installed, or the user is not root: see benchmarks/gazebo/root.py")


def velocities(contacts: str) -> Row:
    """Compare the joint velocities that Gazebo reports with the slope of the positions, while a perfect A1 squats for 2 s."""
    needs_gazebo()
    robot = robot_called("unitree_a1")
    stance = np.array(nominal_stance(robot).joint_position)
    with GazeboPlatform(robot, IDEAL, None, FIRST_SEED, CONTACTS[contacts][1]) as platform:
        bend = 0.15 * (1 - np.cos(2 * np.pi * np.arange(1000) / 500))
        joints = platform.play(Trajectory(stance + bend[:, None] * np.tile([0.0, 1.0, -2.0], 4))).joints
    slope = (joints.position[2:] - joints.position[:-2]) / (joints.time[2:] - joints.time[:-2])[:, None]
    knees = (joints.velocity[1:-1] - slope)[:, 2::3], slope[:, 2::3]
    return {"velocity_error": float(rms(knees[0].ravel()) / rms(knees[1].ravel()))}


def show_velocities(rows: list[Row]) -> Iterator[str]:
    yield "## Gazebo 11"
    yield ""
    yield (
        "Gazebo 11 of Debian bullseye, ODE, step 1 ms, solver `quick` with 50 iterations, friction pyramid. Gazebo reads a "
        "URDF that equipoise writes, and simulates friction and damping of joints, contacts, and the IMU with noise and "
        "bias. equipoise draws leg masses, torque gains, joint offsets and noise, IMU tilt, floor slope and delays. Rotors "
        "have no inertia. The truth is the sum of the links that Gazebo has loaded."
    )
    yield ""
    lines = [[row["case"][0], CONTACTS[row["case"][0]][0], f"{row['velocity_error']:.1%}"] for row in rows]
    yield from markdown(("contacts", "settings", "velocity error"), lines)
    yield ""
    yield (
        "Velocity error: rms of reported joint velocities minus the slope of the positions, over the rms of the slope; knees "
        "of a squatting A1 without errors. The solver `quick` moves bodies to correct penetrations, but leaves that motion "
        "out of the velocities of joints and gyroscope. Stiff contacts without damping do so at every step. The check `joint "
        "velocities` fails then: damp the feet, or use the solver `world`. Unitree's joint controller takes joint velocities "
        "from differences of positions, which pass the check; its gyroscope is still Gazebo's."
    )


def in_gazebo(contacts: str, preset: str, name: str, seed: int) -> Row:
    """Return the row of a calibration of an A1 in Gazebo; with a payload and a scale, except in `ideal`."""
    needs_gazebo()
    robot, generator = robot_called("unitree_a1"), np.random.default_rng([seed, 77])
    payload = None if preset == "ideal" else Payload.parse(payload_of(robot, generator))
    sizes = (IDEAL if preset == "ideal" else REALISTIC).without_effects(LACKS)
    with GazeboPlatform(robot, sizes, payload, seed, CONTACTS[contacts][1]) as platform:
        mass = weighed(platform.truth.composite.mass, generator)
        method = PaperMethod() if name == "paper" else BayesianMethod(mass=mass, mass_std=SCALE_ERROR * mass)
        result = calibrate(platform, robot, method).with_truth(platform.truth)
    truth = components(platform.truth.composite).tolist()
    row: Row = {"truth": truth, "true_moments": platform.truth.stance_effective.inertia.diagonal().tolist()}
    if isinstance(method, BayesianMethod):
        moments = [quantity.value for quantity in result.stance_effective.inertia.moments]
        return row | judged(result) | {"moments": moments}
    moments = [excitation.moment for excitation in result.excitations.values()]
    error = result.composite.com_in_base.errors[:2].tolist()
    return row | {"planar_error": error, "moments": moments} | dict(method.study_columns(result, nominal_stance(robot)))


def show_gazebo(rows: list[Row]) -> Iterator[str]:
    def part(preset: str, method: str) -> list[Row]:
        return [row for row in rows if row["case"][1:3] == [preset, method]]

    yield "### The paper's Table I"
    yield ""
    yield "An A1 as in its file without sensor errors. Moments of base, hips and thighs [kg m2]; CoM of the robot [mm]."
    yield ""
    yield from markdown(
        ("", "I_x", "I_y", "I_z", "p_x", "p_y"), _table_one(part("ideal", "paper") + part("ideal", "bayesian"))
    )
    yield ""
    yield "### `paper` with random payloads"
    yield ""
    yield "Planar CoM after each halving, as in the paper's Fig. 3; a search that ended early keeps its last error."
    yield ""
    head = ("contacts", "runs", "halvings", "median [mm]", "5 to 95 % [mm]", "largest [mm]", "within 5 mm")
    yield from markdown(head, _halvings(part("realistic", "paper")))
    yield ""
    yield "### `bayesian` with random payloads"
    yield ""
    yield (
        f"Seeds from {FIRST_SEED:,}, a scale with an error of {SCALE_ERROR:.1%}. Silent: an error of one of ten parameters "
        f"above {SILENT:g} standard deviations, and no failed check."
    )
    yield ""
    head = (
        "contacts",
        "runs",
        "CoM x, y, z [mm]",
        "Ixx, Iyy, Izz [%]",
        "coverage",
        "largest error / std",
        "failed checks",
        "silent",
    )
    yield from markdown(head, _bayesian_lines(part("realistic", "bayesian")))


def _table_one(rows: list[Row]) -> Iterator[list[str]]:
    lines = [("the paper: simulated", PAPER_TRUTH[:3], PAPER_TRUTH[3:], None)]
    lines += [("the paper: estimated", PAPER_ESTIMATE[:3], PAPER_ESTIMATE[3:], PAPER_TRUTH[:3])]
    lines += [("truth", rows[0]["true_moments"], rows[0]["truth"][1:3], None)] if rows else []
    for row in rows:
        error = row["planar_error"] if "planar_error" in row else row["error"][1:3]
        com = np.array(row["truth"][1:3]) + error
        lines.append((f"`{row['case'][2]}`, {row['case'][0]}", row["moments"], tuple(com), row["true_moments"]))
    for name, moments, com, truth in lines:
        shares = (
            [""] * 3
            if truth is None
            else [f" ({one / true - 1:+.0%})" for one, true in zip(moments, truth, strict=True)]
        )
        yield [
            name,
            *(f"{value:.4f}{share}" for value, share in zip(moments, shares, strict=True)),
            *(f"{1e3 * value:.2f}" for value in com),
        ]


def _halvings(rows: list[Row]) -> Iterator[list[str]]:
    for contacts in CONTACTS:
        of = [row for row in rows if row["case"][0] == contacts]
        paths = [np.hypot(*(np.array([row["iteration_x"], row["iteration_y"]]).T - row["truth"][1:3]).T) for row in of]
        for index in range(max(map(len, paths), default=0)):
            error = np.array([path[min(index, len(path) - 1)] for path in paths])
            low, middle, high = 1e3 * np.percentile(error, [5, 50, 95])
            within = interval_of_share(float(np.mean(error <= WITHIN)), len(of))
            most = f"{1e3 * error.max():.1f}"
            yield [contacts, str(len(of)), str(index + 1), f"{middle:.1f}", f"{low:.1f} to {high:.1f}", most, within]


def _bayesian_lines(rows: list[Row]) -> Iterator[list[str]]:
    most = [" ".join(f"*{limit:g}*" for limit in of) for of in TARGETS]
    yield ["*target*", "", *most, f"*{COVERAGE:.0%}*", "", "", "*0*"]
    for contacts in CONTACTS:
        if of := [row for row in rows if row["case"][0] == contacts]:
            error, ratios = rms(relative(of)), np.abs(column(of, "error") / column(of, "sd"))
            silent = sum(map(is_silent, of))
            yield [
                contacts, str(len(of)), figures(error[1:4], most=TARGETS[0]), figures(error[4:7], ".1f", TARGETS[1]),
                coverage_with_interval(of, COVERAGE), figures(ratios.max(), ".1f"), failed_checks(of),
                f"**{silent}**" if silent else "0",
            ]  # fmt: skip


PAGE = Page(
    "engines",
    f"""# Other physics engines

`make bench-engines`; seeds from {FIRST_SEED:,}, random payloads of 5 to 30 % of the base's mass. A seed draws the same
payload, sensors, motors and floor for all engines. `ideal`: perfect sensors, a robot as in its file. Root mean square errors
of the whole robot at the nominal stance, estimate minus truth. Coverage: share of 95 % intervals that contain the truth, with
its own 95 % interval. Bold: target missed.""",
    (
        Table("engines", in_engine, cases_of(IN_ENGINES), show_engines),
        Table("velocities", velocities, [(contacts,) for contacts in CONTACTS], show_velocities),
        Table("gazebo", in_gazebo, cases_of(IN_GAZEBO), show_gazebo),
    ),
)

if __name__ == "__main__":
    main(PAGE)
