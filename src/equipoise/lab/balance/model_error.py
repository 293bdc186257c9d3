"""Design models of the balance controller: the model file, a calibration, or the truth with a displaced CoM."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.lab.balance.observer import SensorCorrections
from equipoise.lab.balance.two_foot_posture import line_through, stance_legs
from equipoise.result.calibration import Calibration
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.inertial import RobotInertia, composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True, eq=False)
class DesignModel:
    """Model that the controller is designed on.

    Attributes:
        model: model of the robot, with the legs of the model file.
        sensors: sensor errors that are subtracted.
        source: description of the model's source.
    """

    model: RobotModel
    sensors: SensorCorrections
    source: str


def model_file(robot: RobotModel) -> DesignModel:
    """Return the robot's model file."""
    return DesignModel(robot, SensorCorrections.none(robot), "the model file")


def calibrated(robot: RobotModel, stance: Stance, calibration: Calibration) -> DesignModel:
    """Return the model with the result of a calibration, and the model file's values of all that it does not estimate.

    The base is changed so that the whole robot has the calibrated mass and CoM. The legs stay the file's.

    Raises:
        SettingsError: the calibration is of another robot model, has no planar CoM, or is not physically possible.
    """
    if calibration.model["sha256"] != robot.source.sha256:
        raise SettingsError(
            f"the calibration is of {calibration.robot!r} with another model file than {robot.name!r}'s (their hashes "
            "differ); select the robot that was calibrated"
        )
    nominal = composite_parameters(robot, stance.joint_position)
    composite = calibration.composite
    com = composite.com_in_base.values
    if not np.isfinite(com[:2]).all():
        raise SettingsError("the calibration has no planar centre of mass; calibrate with --method bayesian or paper")
    com = np.where(np.isnan(com), nominal.com, com)
    inertia = calibration.base.inertia.values
    mass = nominal.mass if composite.mass.value is None else composite.mass.value
    model = with_composite(robot, stance, mass, com, inertia if np.isfinite(inertia).all() else None)
    source = f"a calibration by the method {calibration.method}"
    return DesignModel(model, SensorCorrections.of(calibration, robot), source)


def displaced(robot: RobotModel, stance: Stance, truth: RobotInertia, diagonal: str, error: float) -> DesignModel:
    """Return the simulated truth with the CoM displaced.

    Args:
        error: displacement along the horizontal normal of the diagonal's support line; positive: forward [m].
    """
    com = truth.composite.com + error * forward_of(stance, diagonal)
    model = with_composite(robot, stance, truth.composite.mass, com, truth.base.inertia)
    source = f"the simulated truth, centre of mass {1000 * error:+g} mm off"
    return DesignModel(model, SensorCorrections.none(robot), source)


def forward_of(stance: Stance, diagonal: str) -> FloatArray:
    """Return the (3,) horizontal normal of a support line at the nominal stance, which points forward, in base axes."""
    right, left = (stance.feet_in_base[LEG_NAMES.index(leg)] for leg in stance_legs(diagonal))
    return line_through(right, left)[1]


def error_along(stance: Stance, diagonal: str, design_model: RobotModel, truth: RobotInertia) -> float:
    """Return the distance of a model's CoM in front of the true one, along the normal of a support line [m]."""
    com = composite_parameters(design_model, stance.joint_position).com
    return float(forward_of(stance, diagonal) @ (com - truth.composite.com))


def with_composite(
    robot: RobotModel, stance: Stance, mass: float, com: FloatArray, base_inertia: FloatArray | None = None
) -> RobotModel:
    """Return the robot with a base that gives the whole robot a mass and a CoM at its stance.

    Args:
        mass: mass of the whole robot [kg].
        com: (3,) centre of mass of the whole robot, in the base frame [m].
        base_inertia: (3, 3) inertia of the base about its own CoM, in base axes [kg m2]; default: the model's.

    Raises:
        SettingsError: no physically possible base does that.
    """
    nominal = composite_parameters(robot, stance.joint_position)
    base = robot.pinocchio.inertias[1]
    legs = nominal.mass - base.mass
    legs_moment = nominal.mass * nominal.com - base.mass * np.array(base.lever)
    if not mass > legs:
        raise SettingsError(
            f"the mass of the whole robot is {mass:.2f} kg, but the legs of {robot.name!r} have {legs:.2f} kg in its model "
            "file; check the calibration's mass"
        )
    inertia = np.array(base.inertia) if base_inertia is None else base_inertia
    if not np.linalg.eigvalsh(inertia).min() > 0:
        raise SettingsError("a principal moment of inertia of the base is not positive; calibrate longer (--duration)")
    lever = (mass * com - legs_moment) / (mass - legs)
    return robot.with_base(pin.Inertia(mass - legs, lever, inertia))
