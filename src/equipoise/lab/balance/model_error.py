"""What a balance law believes of its robot: the model file's inertia, a calibration's, or the truth a little wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.lab.balance.observer import SensorKnowledge
from equipoise.lab.balance.two_foot_posture import line_through, stance_legs
from equipoise.result.calibration import Calibration
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.inertial import RobotInertia, composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True, eq=False)
class Plant:
    """The model that the control law is designed for.

    Attributes:
        model: model of the robot with the base as it is assumed; its legs are the model file's.
        sensors: sensor errors that are taken off.
        source: source of the belief, in words.
    """

    model: RobotModel
    sensors: SensorKnowledge
    source: str


def model_file(robot: RobotModel) -> Plant:
    """The robot as its model file has it."""
    return Plant(robot, SensorKnowledge.none(robot), "the model file")


def calibrated(robot: RobotModel, stance: Stance, calibration: Calibration) -> Plant:
    """The robot as a calibration found it; what its method does not estimate is the model file's.

    Mass and centre of mass of the whole robot are made the calibration's by the base: the legs stay the file's.

    Raises:
        SettingsError: the calibration is of another robot model, knows no planar centre of mass, or no body can have what
            it found.
    """
    if calibration.model["sha256"] != robot.source.sha256:
        raise SettingsError(
            f"the calibration is of {calibration.robot!r} with another model file than {robot.name!r}'s (their hashes "
            "differ): give the robot that was calibrated"
        )
    nominal = composite_parameters(robot, stance.joint_position)
    found = calibration.composite
    com = found.com_in_base.values
    if not np.isfinite(com[:2]).all():
        raise SettingsError("the calibration knows no planar centre of mass; calibrate with --method bayesian or paper")
    com = np.where(np.isnan(com), nominal.com, com)
    inertia = calibration.base.inertia.values
    mass = nominal.mass if found.mass.value is None else found.mass.value
    model = with_composite(robot, stance, mass, com, inertia if np.isfinite(inertia).all() else None)
    return Plant(model, SensorKnowledge.of(calibration, robot), f"a calibration by the method {calibration.method}")


def displaced(robot: RobotModel, stance: Stance, truth: RobotInertia, diagonal: str, error: float) -> Plant:
    """The simulated truth with the centre of mass displaced.

    Args:
        error: displacement along the horizontal normal of the diagonal's support line; positive: believed too far
            forward [m].
    """
    com = truth.composite.com + error * forward_of(stance, diagonal)
    model = with_composite(robot, stance, truth.composite.mass, com, truth.base.inertia)
    source = f"the simulated truth, centre of mass {1000 * error:+g} mm off"
    return Plant(model, SensorKnowledge.none(robot), source)


def forward_of(stance: Stance, diagonal: str) -> FloatArray:
    """(3,) the horizontal normal of a support line at the nominal stance, which points forward, in base axes."""
    right, left = (stance.feet_in_base[LEG_NAMES.index(leg)] for leg in stance_legs(diagonal))
    return line_through(right, left)[1]


def error_along(stance: Stance, diagonal: str, believed: RobotModel, truth: RobotInertia) -> float:
    """How far the believed centre of mass is in front of the true one, along the normal of a support line [m]."""
    com = composite_parameters(believed, stance.joint_position).com
    return float(forward_of(stance, diagonal) @ (com - truth.composite.com))


def with_composite(
    robot: RobotModel, stance: Stance, mass: float, com: FloatArray, base_inertia: FloatArray | None = None
) -> RobotModel:
    """The robot with such a base that the whole of it has a mass and a centre of mass at its stance.

    Args:
        mass: mass of the whole robot [kg].
        com: (3,) centre of mass of the whole robot, in the base frame [m].
        base_inertia: (3, 3) inertia of the base about its own centre of mass, in base axes [kg m2]; default: the
            model's.

    Raises:
        SettingsError: no base can do that.
    """
    nominal = composite_parameters(robot, stance.joint_position)
    base = robot.pinocchio.inertias[1]
    legs = nominal.mass - base.mass
    legs_moment = nominal.mass * nominal.com - base.mass * np.array(base.lever)
    if not mass > legs:
        raise SettingsError(
            f"the whole robot would weigh {mass:.2f} kg, and the legs of {robot.name!r} weigh {legs:.2f} kg by its model "
            "file: check the calibration's mass"
        )
    inertia = np.array(base.inertia) if base_inertia is None else base_inertia
    if not np.linalg.eigvalsh(inertia).min() > 0:
        raise SettingsError("the base would have a principal moment of inertia that is not positive: calibrate longer")
    lever = (mass * com - legs_moment) / (mass - legs)
    return robot.with_base(pin.Inertia(mass - legs, lever, inertia))
