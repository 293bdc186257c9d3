"""Other methods on the same recordings: `make bench-baselines`. Writes benchmarks/results/baselines.md.

Whole robot: every simulated robot has one recording of each kind, which all methods share. Motors: ten seconds of swinging
legs, in MuJoCo and DART. Log: a public log of a real Go2, if the variable EQUIPOISE_GO2_LOG has its path
(`baselines_of_others/go2_log.py`). The methods are in `baselines_of_others`; `mujoco.sysid` has fewer seeds, because it takes
a minute.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rows import NotTriedError, Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from baselines_of_others import filtered, go2_log, motors, mujoco_sysid, projected_least_squares, rigid_body_kalman
from baselines_of_others.mujoco_sysid import SysidSettings
from baselines_of_others.projected_least_squares import ProjectedSettings
from baselines_of_others.recordings import Recorded, record
from baselines_of_others.rigid_body_kalman import KalmanSettings
from simulated import FIRST_SEED, cases_of, judged, robot_called
from tables import column, figures, markdown, relative, rms

from equipoise import Calibration, Recording, calibrate, estimate, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.method.table import method_named
from equipoise.motors.method import Motors
from equipoise.robot.inertial import components, composite_parameters

SLOW = "mujoco.sysid"
AXES = ("roll", "pitch", "yaw")
ROBOTS = ("unitree_a1", "go2", "anymal_c")
SEEDS = {"": 8, SLOW: 5}
# Runs whose recordings each method has.
METHODS = {
    "bayesian": ("bayesian",), "bayesian, no scale": ("bayesian",), "model file": (), "static": ("static",),
    "paper": ("paper",), "projected": ("shake", "bayesian"), "projected, no scale": ("shake", "bayesian"),
    "kalman": ("shake", "bayesian"), "kalman, no scale": ("shake", "bayesian"), SLOW: ("shake", "bayesian"),
}  # fmt: skip
# Robot, preset, engine, and number of seeds.
MOTOR_RUNS: dict[tuple[str, Any, Any], int] = {
    ("unitree_a1", "realistic", "mujoco"): 4, ("go2", "realistic", "mujoco"): 4, ("unitree_a1", "realistic", "dart"): 4,
    ("unitree_a1", "stress", "mujoco"): 4,
}  # fmt: skip
QUANTITIES = {
    "coulomb_friction": "Coulomb [%]", "relative_gain": "relative gain [%]", "armature": "armature [%]",
    "viscous_friction": "viscous [%]", "delay": "delay [ms]",
}  # fmt: skip
LOG = "EQUIPOISE_GO2_LOG"
NOTES = Path(__file__).parent / "baselines_of_others/notes.md"


def robots(name: str, slow: str, seed: int) -> Row:
    """Return the row of a simulated robot: errors and CPU time of each method [s].

    Args:
        slow: name of the only method besides `bayesian`; empty: all but the slow one.
    """
    methods = ["bayesian", slow] if slow else [method for method in METHODS if method != SLOW]
    recorded = record(name, seed, dict.fromkeys(run for method in methods for run in METHODS[method]))
    true, row = components(recorded.truth.composite), {}
    for method in methods:
        recordings = [replace(recording) for run in METHODS[method] for recording in recorded.runs[run]]  # not cached
        start = time.process_time()
        try:
            found = values_of(method, recorded, recordings)
        except (EquipoiseError, np.linalg.LinAlgError) as error:
            row[method] = {"failed": f"{type(error).__name__}: {error}"}
            continue
        except ModuleNotFoundError as error:
            raise NotTriedError(str(error)) from error
        cpu = time.process_time() - start
        if isinstance(found, Calibration):
            if method == "bayesian":
                row |= judged(found.with_truth(recorded.truth))
            moments = [found.excitations[axis].moment if axis in found.excitations else None for axis in AXES]
            values = [one.value for one in found.composite]
            found = values if method.startswith("bayesian") else [*values[:4], *moments, None, None, None]
        errors = [None if value is None else value - t for value, t in zip(found, true.tolist(), strict=True)]
        robot_time = sum(recording.duration for recording in recordings)
        row[method] = {"truth": true.tolist(), "error": errors, "cpu": cpu, "robot_time": robot_time}
    return row


def values_of(method: str, recorded: Recorded, recordings: list[Recording]) -> Calibration | list[float]:
    """Return the ten components of the whole robot, or a result."""
    name, *without = method.split(", ")
    scale = None if without else (recorded.mass, recorded.mass_std)
    robot, stance = recorded.robot, recorded.stance
    at = stance.joint_position
    if name in ("bayesian", "paper", "static"):
        ours = method_named(name)()
        return estimate(robot, recordings, ours if scale is None else ours.weighed(*scale))
    if name == "model file":
        found = composite_parameters(robot, at)
    elif name == SLOW:
        feed = [recorded.feed_forward[run] for run in METHODS[name] for _ in recorded.runs[run]]
        found = mujoco_sysid.estimate(robot, recordings, feed, stance, SysidSettings(), scale)
    else:
        settings = ProjectedSettings() if name == "projected" else KalmanSettings()
        samples = filtered.read_all(robot, recordings, stance, settings.cutoff, settings.acceleration, settings.motions)
        if isinstance(settings, ProjectedSettings):
            found = projected_least_squares.estimate(robot, samples, at, settings, None if scale is None else scale[0])
        else:
            found = rigid_body_kalman.estimate(robot, samples, at, settings, scale)
    return components(found).tolist()


def show_robots(rows: list[Row]) -> Iterator[str]:
    yield "## Whole robot"
    yield ""
    yield (
        "`realistic`, random payloads of 5 to 30 % of the base's mass. A scale of 0.5 % is given to all but `static`, `paper` "
        "and those without scale. The paper's I is compared with the whole robot's. Robot time: of the recordings given. CPU: "
        "median process time from recordings to estimate, one core."
    )
    yield ""
    head = (
        "robot", "method", "runs", "mass [%]", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "Ixy, Ixz, Iyz [% of Ixx]",
        "CPU [s]", "robot time [s]",
    )  # fmt: skip
    yield from markdown(head, _robot_lines(rows))


def _robot_lines(rows: list[Row]) -> Iterator[list[str]]:
    for name in ROBOTS:
        for slow in SEEDS:
            here = [row for row in rows if row["case"][:2] == [name, slow]]
            for method in METHODS:
                of = [row[method] for row in here if method in row]
                if done := [one for one in of if "error" in one]:
                    errors = rms(relative(done))
                    count = str(len(of)) if len(done) == len(of) else f"{len(done)} of {len(of)}"
                    yield [
                        name, f"{method}, same seeds" if slow and method != slow else method, count, figures(errors[:1]),
                        figures(errors[1:4]), figures(errors[4:7]), figures(errors[7:]),
                        f"{np.median(column(done, 'cpu')):.2g}", f"{column(done, 'robot_time').mean():.0f}",
                    ]  # fmt: skip


def motor_fits(name: str, preset: Any, engine: Any, seed: int) -> Row:
    """Return the row of ten seconds of swinging: errors and CPU time of each method [s]."""
    if mujoco_sysid.toolbox() is None:
        raise NotTriedError("mujoco.sysid is not installed: pip install 'mujoco[sysid]'")
    robot, kept = robot_called(name), list[Recording]()
    with simulate(robot, preset, seed=seed, engine=engine) as simulation:
        calibrate(simulation.platform, robot, Motors(motor_time=10.0), keep=kept.append)
        truth = [simulation.truth_of_parts["motors"][joint] for joint in robot.joint_names]
    scale, row = nominal_stance(robot).scale, {}
    for method, fit in motors.FITS.items():
        recording, start = replace(kept[-1]), time.process_time()  # a copy, of which nothing is cached
        found = fit(robot, recording, scale)
        row[method] = {"cpu": time.process_time() - start, **motors.errors_of(found, truth)}
    sd = motors.in_units(motors.ours(robot, kept[-1], scale, "std"), truth)
    return row | {
        "error": [error for quantity in sd for error in row["equipoise"][quantity]],
        "sd": [value for of in sd.values() for value in of],
    }


def show_motors(rows: list[Row]) -> Iterator[str]:
    yield "## Motors"
    yield ""
    yield (
        "Ten seconds of swinging, rms errors over all joints. The fits of trajectories and `mujoco.sysid` simulate robots "
        "with the engine, step, joint control and friction that made them, except in DART."
    )
    yield ""
    head = ("robot", "method", "runs", *QUANTITIES.values(), "CPU [s]")
    yield from markdown(head, _motor_lines(rows))


def _motor_lines(rows: list[Row]) -> Iterator[list[str]]:
    for name, preset, engine in MOTOR_RUNS:
        of = [row for row in rows if row["case"][:3] == [name, preset, engine]]
        shown = name + (", `stress`" if preset == "stress" else "") + (", in DART" if engine == "dart" else "")
        for method in motors.FITS if of else ():
            found = [row[method] for row in of]
            errors = [rms(np.ravel(column(found, one))) if one in found[0] else np.nan for one in QUANTITIES]
            cells = [figures(*one) for one in zip(errors, (".1f", ".1f", ".1f", ".1f", ".2f"), strict=True)]
            yield [shown, method, str(len(of)), *cells, f"{np.median(column(found, 'cpu')):.2g}"]


def log(name: str) -> Row:
    """Return the row of the log of a real robot."""
    path = Path(os.environ.get(LOG, ""))
    if path.name != name:
        raise NotTriedError(f"{LOG} is not the path of {name}: see baselines_of_others/go2_log.py")
    return {"found": go2_log.predict(path)}


def show_log(rows: list[Row]) -> Iterator[str]:
    yield "## Motors of a real Go2"
    yield ""
    yield (
        "The log of [IIT's identification](https://github.com/iit-DLSLab/sim2real-robot-identification) "
        "(`datasets/go2/traj_0.pt`): a Go2 in the air, its base fixed; all joints follow 13 triangles, each faster than the "
        "last, for 23.5 s; commands and encoders at 200 Hz, no torques, no IMU. Motors are fitted on every other triangle; "
        "joint positions of the rest are predicted from commands alone. Gains (20 Nm/rad, 1.5 Nm s/rad) are those of the "
        "repository's configuration; the base is assumed upright; the links are our file's. The motors' true values are "
        "unknown: fits that predict about equally well differ, because delay, viscous friction and armature have similar "
        "effects in such slow motions. Motors: median of the joints."
    )
    yield ""
    head = (
        "", "fitted half, rms [mrad]", "other half, predicted [mrad]", "Coulomb [Nm]", "viscous [Nm s/rad]",
        "armature [kg m2]", "delay [ms]",
    )  # fmt: skip
    lines = [
        (
            name, f"{one['fitted']:.1f}", f"{one['predicted']:.1f}", f"{one['coulomb_friction']:.2f}",
            f"{one['viscous_friction']:.2f}", f"{one['armature']:.3f}", f"{1e3 * one['delay']:.1f}",
        )
        for name, one in rows[0]["found"].items()
    ]  # fmt: skip
    yield from markdown(head, lines)


PAGE = Page(
    "baselines",
    f"""# Other methods on the same recordings

`make bench-baselines`; seeds from {FIRST_SEED:,}, simulated robots unless a table says otherwise. Root mean square errors,
estimate minus truth; "-": not estimated. The implementations are ours, and no method has seen a truth.""",
    (
        Table(
            "robots",
            robots,
            cases_of({(name, slow): n for name in ROBOTS for slow, n in SEEDS.items()}),
            show_robots,
        ),
        Table(
            "motors",
            motor_fits,
            cases_of(MOTOR_RUNS),
            show_motors,
        ),
        Table("log", log, [("traj_0.pt",)], show_log),
    ),
    NOTES.read_text(encoding="utf-8"),
)

if __name__ == "__main__":
    main(PAGE)
