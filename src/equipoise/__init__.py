"""equipoise: what a quadruped weighs, where its centre of mass is, how hard it is to turn, by its own sensors.

    robot = load_robot("unitree_a1")
    with simulate(robot, noise="realistic", payload="1.5,0.1,0,0.08") as simulation:
        calibration = calibrate(simulation.platform, robot).with_truth(simulation.truth)

Names are imported when they are first used: `simulate` needs MuJoCo, nothing else here does.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from equipoise._version import __version__

if TYPE_CHECKING:
    from equipoise.calibration import CalibrationSettings, calibrate, estimate
    from equipoise.delta import Delta, find_delta
    from equipoise.errors import EquipoiseError
    from equipoise.estimation.two_runs import ScaleReadings
    from equipoise.experiments.precise_routine import PreciseSettings
    from equipoise.experiments.sway import SwaySettings
    from equipoise.experiments.trial_runner import ComSearchSettings
    from equipoise.outputs.export.formats import export
    from equipoise.platforms.payload import Payload
    from equipoise.platforms.platform import JointCommand, Platform, RobotState, Trajectory
    from equipoise.platforms.sensors import SensorErrors
    from equipoise.platforms.simulation import Simulation, simulate
    from equipoise.recordings.recording import Recording
    from equipoise.result import Calibration
    from equipoise.robot.audit import Audit, audit
    from equipoise.robot.catalog import load_robot
    from equipoise.robot.description import RobotDescription
    from equipoise.robot.inertial import InertialParameters
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance, nominal_stance
    from equipoise.run_folder import RunFolder

_HOME = {
    "Audit": "robot.audit",
    "Calibration": "result",
    "CalibrationSettings": "calibration",
    "ComSearchSettings": "experiments.trial_runner",
    "Delta": "delta",
    "EquipoiseError": "errors",
    "InertialParameters": "robot.inertial",
    "JointCommand": "platforms.platform",
    "Payload": "platforms.payload",
    "Platform": "platforms.platform",
    "PreciseSettings": "experiments.precise_routine",
    "Recording": "recordings.recording",
    "RobotDescription": "robot.description",
    "RobotModel": "robot.model",
    "RobotState": "platforms.platform",
    "RunFolder": "run_folder",
    "ScaleReadings": "estimation.two_runs",
    "SensorErrors": "platforms.sensors",
    "Simulation": "platforms.simulation",
    "Stance": "robot.stance",
    "SwaySettings": "experiments.sway",
    "Trajectory": "platforms.platform",
    "audit": "robot.audit",
    "calibrate": "calibration",
    "estimate": "calibration",
    "export": "outputs.export.formats",
    "find_delta": "delta",
    "load_robot": "robot.catalog",
    "nominal_stance": "robot.stance",
    "simulate": "platforms.simulation",
}
"""Public names and the modules that they live in."""

__all__ = [  # noqa: RUF022 - in the order of _HOME, with the version last
    "Audit",
    "Calibration",
    "CalibrationSettings",
    "ComSearchSettings",
    "Delta",
    "EquipoiseError",
    "InertialParameters",
    "JointCommand",
    "Payload",
    "Platform",
    "PreciseSettings",
    "Recording",
    "RobotDescription",
    "RobotModel",
    "RobotState",
    "RunFolder",
    "ScaleReadings",
    "SensorErrors",
    "Simulation",
    "Stance",
    "SwaySettings",
    "Trajectory",
    "audit",
    "calibrate",
    "estimate",
    "export",
    "find_delta",
    "load_robot",
    "nominal_stance",
    "simulate",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'equipoise' has no attribute {name!r}")
    return getattr(importlib.import_module(f"equipoise.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
