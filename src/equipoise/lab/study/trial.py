"""One trial: the drawn robot, calibrated by each method, as rows of a table."""

from __future__ import annotations

import os
import shutil
import threading
import time
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.calibration.routine import calibrate, check
from equipoise.calibration.run_folder import RunFolder
from equipoise.conventions import AXES
from equipoise.errors import EquipoiseError
from equipoise.lab.study.rows import SUCCEEDED, Row, Table, table_of
from equipoise.lab.study.study import Draw, Study, draw, nominal_robot
from equipoise.method.method import Method
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.robot.kinematics import foot_jacobians
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.simulation import Simulation, simulate

# Trials of a process share its robot models, whose scratch memory every call overwrites: one at a time, whoever asks.
_ONE_AT_A_TIME = threading.Lock()


def check_study(study: Study) -> None:
    """Refuse what is wrong with every trial, before any is run: the robot, or settings that do not fit it.

    Raises:
        EquipoiseError: what each trial would have failed with.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot, _ = nominal_robot(study)
        for method in study.methods:
            check(robot, method)
        simulate(robot, timestep=study.timestep, contact_model=study.contact_model).platform.close()


def run_trial(study: Study, trial: int, logs: str | None = None) -> Table:
    """One row for each of the study's methods. A calibration that fails is a row too, never an exception.

    Args:
        study: study that says what is drawn and done.
        trial: number of the trial.
        logs: folder, in one that exists, for the recordings of calibrations that fail; None keeps none. (All can be run
            again by number.)
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            drawn = draw(study, trial)
            facts = {"trial": trial, **_facts(drawn)}
        except Exception as error:  # a random robot that cannot stand, say
            nothing = [_failed({"trial": trial, "method": method.name}, error, None) for method in study.methods]
            return table_of(nothing)
        return table_of([_calibrated(study, drawn, facts, method, logs) for method in study.methods])


def _calibrated(study: Study, drawn: Draw, facts: Row, method: Method, logs: str | None) -> Row:
    row: Row = {**facts, "method": method.name}
    recordings: list[Recording] = []
    started, busy = time.perf_counter(), time.process_time()
    simulation: Simulation | None = None
    try:
        timestep = method.timestep if study.timestep is None else study.timestep
        row["timestep"] = timestep
        with simulate(
            drawn.robot, drawn.sizes, drawn.payload, drawn.seed, timestep=timestep, contact_model=study.contact_model
        ) as simulation:
            row |= _truth(simulation)
            if drawn.scale_reading is not None and study.scale_error is not None:
                weight = simulation.truth.composite.mass * (1 + drawn.scale_reading)
                method = method.weighed(weight, study.scale_error * weight)
            result = calibrate(simulation.platform, drawn.robot, method, recordings.append)
        row |= {"status": SUCCEEDED, "message": ""} | _estimates(result, drawn, method)
    except Exception as error:  # a study of thousands of robots counts what goes wrong, our own mistakes included
        row = _failed(row, error, _kept(logs, drawn, method, recordings, row, simulation))
    if simulation is not None:
        row["simulated_time"] = simulation.platform.read().time
    return row | {
        "robot_time": sum(recording.duration for recording in recordings),
        "wall_time": time.perf_counter() - started,
        "cpu_time": time.process_time() - busy,
        "worker": os.getpid(),
    }


def _failed(row: Row, error: Exception, log: str | None) -> Row:
    message = str(error)
    if not isinstance(error, EquipoiseError):
        message = "".join(traceback.format_exception(error)).strip()
    return row | {"status": type(error).__name__, "message": message, "log": log}


def _kept(
    logs: str | None, drawn: Draw, method: Method, recordings: list[Recording], row: Mapping[str, Any],
    simulation: Simulation | None,
) -> str | None:  # fmt: skip
    """Keep what a calibration measured before it failed; None where it cannot be kept."""
    if logs is None or not Path(logs).parent.is_dir():  # a worker elsewhere does not see the study's folder
        return None
    path = Path(logs) / f"trial-{row['trial']:06d}-{row['method']}"
    try:
        if path.exists():  # of the same trial, killed before its row was written
            shutil.rmtree(path)
        with RunFolder.create(path, drawn.robot, method, {"trial": row["trial"]}) as folder:
            if simulation is not None:
                folder.save_truth(simulation.truth)
            for recording in recordings:
                folder.keep(recording)
        return str(folder.path)
    except (EquipoiseError, OSError):  # the trial's number is enough
        return None


def _facts(drawn: Draw) -> Row:
    """What was drawn, in numbers that errors can be held against."""
    robot, stance = drawn.robot, drawn.stance
    errors = DrawnErrors.draw(drawn.sizes, len(robot.joint_names), drawn.seed)
    zeros = errors.joint_offset[robot.leg_joints]
    feet = np.asarray(np.einsum("fij,fj->fi", foot_jacobians(robot, stance.joint_position), zeros), dtype=float)
    payload = None if drawn.payload is None else drawn.payload.parameters
    return {
        "robot_mass": robot.mass,
        "leg_length": robot.leg_length,
        "hip_height": stance.hip_height,
        "payload_mass": 0.0 if payload is None else payload.mass,
        **{f"payload_{axis}": None if payload is None else float(payload.com[i]) for i, axis in enumerate("xyz")},
        **{f"size_{row.name}": row.amount(getattr(drawn.sizes, row.name)) for row in drawn.sizes.rows() if row.varied},
        "joint_zero_rms": float(np.sqrt(np.mean(errors.joint_offset**2))),
        "foot_error_rms": float(np.linalg.norm(feet[:, :2]) / np.sqrt(feet[:, :2].size)),
        "imu_tilt_size": float(np.linalg.norm(errors.imu_tilt[:2])),
    }


def _truth(simulation: Simulation) -> Row:
    truth = simulation.truth
    row: Row = dict(zip([f"true_{name}" for name in COMPONENTS], components(truth.composite).tolist(), strict=True))
    for index, axis in enumerate(AXES):
        row[f"true_stance_effective_{axis}"] = float(truth.stance_effective.inertia[index, index])
    return row


def _estimates(result: Calibration, drawn: Draw, method: Method) -> Row:
    """What a calibration found; where it does not estimate a parameter there is no value."""
    moments = {axis: excitation.moment for axis, excitation in result.excitations.items()}
    row: Row = {f"moment_{axis}": moments.get(axis) for axis in AXES}
    row |= {f"estimated_{quantity.name}": quantity.value for quantity in result.composite}
    row |= {f"std_{quantity.name}": quantity.std for quantity in result.composite}
    row |= method.study_columns(result, drawn.stance)
    row["estimation_time"] = sum(result.timings.values()) or None
    row["lifts"] = sum(trial.kind == "lift" for trial in result.trials)
    row["trustworthy"] = result.trustworthy
    return row
