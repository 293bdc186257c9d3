"""Trial of a study: calibration of a drawn robot with each method, as table rows."""

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

# Trials of a process share robot models, whose scratch memory every call overwrites.
_ONE_AT_A_TIME = threading.Lock()


def check_study(study: Study) -> None:
    """Check robot and settings before the first trial.

    Raises:
        EquipoiseError: every trial would fail with this error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot, _ = nominal_robot(study)
        for method in study.methods:
            check(robot, method)
        simulate(robot, timestep=study.timestep, contact_model=study.contact_model).platform.close()


def run_trial(study: Study, trial: int, logs: str | None = None) -> Table:
    """Run a trial; return a row per method. A failed calibration gives a row, never an exception.

    Args:
        study: study of the trial.
        trial: number of the trial.
        logs: folder, with an existing parent, for the recordings of failed calibrations; None: they are not saved.
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            drawn = draw(study, trial)
            facts = {"trial": trial, **_facts(drawn)}
        except Exception as error:  # for example a random robot that cannot stand
            failures = [_failed({"trial": trial, "method": method.name}, error, None) for method in study.methods]
            return table_of(failures)
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
            result = calibrate(simulation.platform, drawn.robot, method, recordings.append)
        row |= {"status": SUCCEEDED, "message": ""} | _estimates(result, drawn, method)
    except Exception as error:  # every failure is counted, including bugs of equipoise
        row = _failed(row, error, _save_recordings(logs, drawn, method, recordings, row, simulation))
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


def _save_recordings(
    logs: str | None, drawn: Draw, method: Method, recordings: list[Recording], row: Mapping[str, Any],
    simulation: Simulation | None,
) -> str | None:  # fmt: skip
    """Save the recordings of a failed calibration; return their folder, or None if they cannot be saved."""
    if logs is None or not Path(logs).parent.is_dir():  # workers on other machines do not have the study's folder
        return None
    path = Path(logs) / f"trial-{row['trial']:06d}-{row['method']}"
    try:
        if path.exists():  # from the same trial, killed before its row was written
            shutil.rmtree(path)
        with RunFolder.create(path, drawn.robot, method, {"trial": row["trial"]}) as folder:
            if simulation is not None:
                folder.save_truth(simulation.truth)
            for recording in recordings:
                folder.keep(recording)
        return str(folder.path)
    except (EquipoiseError, OSError):  # the trial can be repeated by its number
        return None


def _facts(drawn: Draw) -> Row:
    """Return the sizes of payload and drawn errors."""
    robot, stance = drawn.robot, drawn.stance
    errors = DrawnErrors.draw(drawn.sizes, len(robot.joint_names), drawn.seed)
    offsets = errors.drawn["joint_offset"][robot.leg_joints]
    feet = np.asarray(np.einsum("fij,fj->fi", foot_jacobians(robot, stance.joint_position), offsets), dtype=float)
    payload = None if drawn.payload is None else drawn.payload.parameters
    return {
        "robot_mass": robot.mass,
        "leg_length": robot.leg_length,
        "hip_height": stance.hip_height,
        "payload_mass": 0.0 if payload is None else payload.mass,
        **{f"payload_{axis}": None if payload is None else float(payload.com[i]) for i, axis in enumerate("xyz")},
        **{f"size_{row.name}": row.amount(getattr(drawn.sizes, row.name)) for row in drawn.sizes.rows() if row.varied},
        "joint_zero_rms": float(np.sqrt(np.mean(errors.drawn["joint_offset"] ** 2))),
        "foot_error_rms": float(np.linalg.norm(feet[:, :2]) / np.sqrt(feet[:, :2].size)),
        "imu_tilt_size": float(np.linalg.norm(errors.drawn["imu_tilt"][:2])),
    }


def _truth(simulation: Simulation) -> Row:
    truth = simulation.truth
    row: Row = dict(zip([f"true_{name}" for name in COMPONENTS], components(truth.composite).tolist(), strict=True))
    for index, axis in enumerate(AXES):
        row[f"true_stance_effective_{axis}"] = float(truth.stance_effective.inertia[index, index])
    return row


def _estimates(result: Calibration, drawn: Draw, method: Method) -> Row:
    """Return the estimates of a calibration, None if a parameter is not estimated."""
    moments = {axis: excitation.moment for axis, excitation in result.excitations.items()}
    row: Row = {f"moment_{axis}": moments.get(axis) for axis in AXES}
    row |= {f"estimated_{quantity.name}": quantity.value for quantity in result.composite}
    row |= {f"std_{quantity.name}": quantity.std for quantity in result.composite}
    row |= method.study_columns(result, drawn.stance)
    row["estimation_time"] = sum(result.timings.values()) or None
    row["lifts"] = sum(trial.kind == "lift" for trial in result.trials)
    row["trustworthy"] = result.trustworthy
    return row
