"""Mass, centre of mass and inertia of a quadruped, measured with its own sensors.

    robot = load_robot("unitree_a1")
    with simulate(robot, preset="realistic", payload="1.5,0.1,0,0.08") as simulation:
        calibration = calibrate(simulation.platform, robot).with_truth(simulation.truth)

Names are imported on first use: only `simulate` needs MuJoCo.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from equipoise._version import __version__

if TYPE_CHECKING:
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.calibration.payload_change import PayloadChange, find_payload_change
    from equipoise.calibration.routine import calibrate, estimate
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.drivers.hardware import RobotConnection
    from equipoise.drivers.platforms import Driver
    from equipoise.errors import CommunicationError, EquipoiseError, RecordingError, SettingsError
    from equipoise.estimator.prior_runs.two_runs import ScaleReadings
    from equipoise.experiments.excitation_settings import ExcitationSettings
    from equipoise.exports.formats import Format, export
    from equipoise.exports.subject import Subject, Written
    from equipoise.guard.guard import Guard
    from equipoise.logs.raw_log import RawImu, RawJoints, RawLog
    from equipoise.logs.reader import LogReader
    from equipoise.logs.topics import Topics
    from equipoise.method.method import Method
    from equipoise.paper.method import PaperMethod
    from equipoise.paper.settings import ComSearchSettings
    from equipoise.platform.platform import Health, JointCommand, Platform, RobotState, Trajectory
    from equipoise.platform.stepped import SteppedPlatform
    from equipoise.platform.stepping import play_by_stepping
    from equipoise.platform.tilt_limit import TiltLimit
    from equipoise.recording.recording import Recording
    from equipoise.result.body import Body
    from equipoise.result.calibration import Calibration
    from equipoise.result.quantity import Quantity
    from equipoise.robot.audit import Audit, audit
    from equipoise.robot.catalog import load_robot
    from equipoise.robot.description import RobotDescription
    from equipoise.robot.inertial import InertialParameters
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance, nominal_stance
    from equipoise.simulation.effects import EffectSizes
    from equipoise.simulation.payload import Payload
    from equipoise.simulation.simulation import Simulation, simulate

__all__ = [  # noqa: RUF022 - the version last
    "Audit", "Body", "Calibration", "ComSearchSettings", "CommunicationError", "PayloadChange", "Driver", "EquipoiseError",
    "Format", "Guard", "Health", "InertialParameters", "JointCommand", "LogReader", "Method", "PaperMethod", "Payload",
    "Platform", "BayesianMethod", "Quantity", "RawImu", "RawJoints", "RawLog", "Recording", "RecordingError",
    "RobotConnection",
    "RobotDescription", "RobotModel", "RobotState", "RunFolder", "ScaleReadings", "EffectSizes", "SettingsError",
    "Simulation", "Stance", "SteppedPlatform", "Subject", "ExcitationSettings", "TiltLimit", "Topics", "Trajectory", "Written",
    "audit", "calibrate", "estimate", "export", "find_payload_change", "load_robot", "nominal_stance", "play_by_stepping",
    "simulate", "__version__",
]  # fmt: skip

_MODULES = {
    "calibration.payload_change": "PayloadChange find_payload_change",
    "calibration.routine": "calibrate estimate",
    "calibration.run_folder": "RunFolder",
    "drivers.platforms": "Driver",
    "drivers.hardware": "RobotConnection",
    "errors": "CommunicationError EquipoiseError RecordingError SettingsError",
    "estimator.prior_runs.two_runs": "ScaleReadings",
    "experiments.excitation_settings": "ExcitationSettings",
    "exports.formats": "Format export",
    "exports.subject": "Subject Written",
    "guard.guard": "Guard",
    "logs.raw_log": "RawImu RawJoints RawLog",
    "logs.reader": "LogReader",
    "logs.topics": "Topics",
    "method.method": "Method",
    "paper.method": "PaperMethod",
    "paper.settings": "ComSearchSettings",
    "platform.platform": "Health JointCommand Platform RobotState Trajectory",
    "platform.stepped": "SteppedPlatform",
    "platform.stepping": "play_by_stepping",
    "platform.tilt_limit": "TiltLimit",
    "bayesian.method": "BayesianMethod",
    "recording.recording": "Recording",
    "result.body": "Body",
    "result.calibration": "Calibration",
    "result.quantity": "Quantity",
    "robot.audit": "Audit audit",
    "robot.catalog": "load_robot",
    "robot.description": "RobotDescription",
    "robot.inertial": "InertialParameters",
    "robot.model": "RobotModel",
    "robot.stance": "Stance nominal_stance",
    "simulation.effects": "EffectSizes",
    "simulation.payload": "Payload",
    "simulation.simulation": "Simulation simulate",
}
"""Public names by module."""
_HOME = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'equipoise' has no attribute {name!r}")
    return getattr(importlib.import_module(f"equipoise.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
