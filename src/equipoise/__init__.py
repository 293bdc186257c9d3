"""equipoise: what a quadruped weighs, where its centre of mass is, how hard it is to turn, by its own sensors.

    robot = load_robot("unitree_a1")
    calibration = calibrate(platform, robot)

The simulated robot is in `equipoise.platforms.simulation`, which needs MuJoCo; nothing else here does.
"""

from equipoise._version import __version__
from equipoise.calibration import CalibrationSettings, calibrate, estimate
from equipoise.errors import EquipoiseError
from equipoise.experiments.com_search import ComSearchSettings
from equipoise.experiments.sway import SwaySettings
from equipoise.platforms.platform import JointCommand, Platform, RobotState, Trajectory
from equipoise.recordings.recording import Recording
from equipoise.result import Calibration
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance

__all__ = [
    "Calibration",
    "CalibrationSettings",
    "ComSearchSettings",
    "EquipoiseError",
    "InertialParameters",
    "JointCommand",
    "Platform",
    "Recording",
    "RobotDescription",
    "RobotModel",
    "RobotState",
    "Stance",
    "SwaySettings",
    "Trajectory",
    "__version__",
    "calibrate",
    "estimate",
    "load_robot",
    "nominal_stance",
]
