"""Feet, belly and floor of the simulated robot in MuJoCo: point contacts, or patches, rubber and footholds of its effects."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import BELLY_RATIO, Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import Contacts, EffectSizes
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.mujoco_drive import spring_constraint

FLOOR = "equipoise_floor"
# Tangential stiffness over normal stiffness of contacts: MuJoCo's soft contacts creep at 1, and a foot that creeps by
# a millimetre over a trial is a support line off by a millimetre.
IMPRATIO = 100.0
# [s] Contact time constant: MuJoCo softens contacts if the time step exceeds half of it.
CONTACT_TIME = 2e-3
# Share of a contact's or a joint's slip that is corrected at once. At MuJoCo's default, 0.9 to 0.95, standing feet creep four
# times as far while the body shakes, and sink in by 40 instead of 3 um.
IMPEDANCE = 0.99, 0.99
# Damping of rubber over its stiffness [s]: a robot that bounces at 16 Hz on its feet loses a fifth of its swing each time.
_RUBBER_TIME = 2e-3
_FILE_KEYS = ("condim", "friction", "solref", "solimp", "solmix", "priority", "margin", "gap")


def foot_name(leg: str) -> str:
    """Return the name of the geom at a foot's centre."""
    return f"equipoise_{leg}_foot"


def foot_geoms(model: mujoco.MjModel, leg: str) -> list[int]:
    """Return the ids of all geoms of a foot."""
    return [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith(foot_name(leg))]


def add_contacts(
    spec: mujoco.MjSpec,
    robot: RobotModel,
    stance: Stance,
    base: mujoco.MjsBody,
    errors: DrawnErrors,
    legs: LegErrors,
    contacts: Contacts,
) -> None:
    """Add feet (balls, or of the shape that effects give them), belly (a box, for lying) and the floor; nothing else touches.

    Args:
        contacts: contact parameters of feet and floor: "default", or "file" for those of the feet in the model file, on a
            floor with MuJoCo's defaults.

    Raises:
        SettingsError: the file has no contact parameters, or feet would have two shapes.
    """
    from_file = _parameters_from_file(spec, robot) if contacts == "file" else {}
    dimensions, friction = _friction(errors)
    hard = {"solref": [CONTACT_TIME, 1.0], "solimp": [*IMPEDANCE, 0.001, 0.5, 2.0], "friction": friction}
    floor = hard if contacts == "default" else {}
    spec.worldbody.add_geom(
        name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=1, conaffinity=2, **floor
    )  # fmt: skip
    touching = {"contype": 2, "conaffinity": 1, "condim": 3, "mass": 0.0, **hard}
    heights, axes = errors.drawn["foothold_height"], _base_axes(robot, stance)
    for index, (name, leg) in enumerate(robot.legs.items()):
        how: dict[str, Any] = {**touching, "condim": dimensions, **from_file.get(name, {})}
        if heights.any():
            # Each foot has a separate floor and touches no other.
            how |= {"contype": 4 << index, "conaffinity": 4 << index}
            spec.worldbody.add_geom(
                name=f"{FLOOR}_{name}", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, heights[index]],
                contype=4 << index, conaffinity=4 << index, **floor,
            )  # fmt: skip
        how["pos"] = leg.foot_in_body
        radius, width = leg.foot_radius + legs.foot_radius[index], errors.sizes.foot_width or leg.foot_half_width
        _add_foot(spec.body(leg.foot_body), name, radius, width, errors.sizes, axes[index], how)
    hips_above_base = stance.hip_height - stance.base_height
    reach = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    thickness = 0.02 * robot.leg_length
    base.add_geom(
        name="equipoise_belly",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.6 * reach[0], 0.4 * reach[1], thickness],
        pos=[0, 0, hips_above_base - BELLY_RATIO * robot.leg_length + thickness],
        **touching,
    )


def _add_foot(
    body: mujoco.MjsBody, leg: str, radius: float, width: float, sizes: EffectSizes, base_axes: FloatArray,
    how: dict[str, Any],
) -> None:  # fmt: skip
    """Add a foot of a radius at the stance: a ball, a cylinder or an ellipsoid, with a disc where it is flat.

    Args:
        width: half-width of a cylinder across the leg; zero of a ball [m].
        base_axes: (3, 3) axes of the base at the stance, as columns in the body's axes.
        how: position and contact parameters of its geoms.
    """
    if width and sizes.foot_oval:
        raise SettingsError("cylindrical feet (foot_width or the model file) cannot be oval; disable foot_oval")
    shape, size = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0]
    if width:
        shape, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, width, 0]
    if oval := sizes.foot_oval:
        # Radii of curvature at the end of a semi-axis are the squares of the other two over it.
        shape, size = mujoco.mjtGeom.mjGEOM_ELLIPSOID, radius * np.sqrt([1, 1 + oval, 1 - oval / 2])
    up_forward_left = base_axes[:, [2, 0, 1]]
    body.add_geom(name=foot_name(leg), type=shape, size=size, quat=quat_wxyz(up_forward_left), **how)
    if flat := sizes.foot_flat:
        shape, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [flat, radius, 0]
        body.add_geom(name=f"{foot_name(leg)}_flat", type=shape, size=size, quat=quat_wxyz(base_axes), **how)


def _base_axes(robot: RobotModel, stance: Stance) -> list[FloatArray]:
    """Return for each foot the (3, 3) axes of the base at the stance, as columns in the axes of the foot's body."""
    model, data = robot.pinocchio, robot.create_data()
    pin.framesForwardKinematics(model, data, robot.configuration(stance.joint_position))
    frames = [model.getFrameId(leg.foot_body, pin.FrameType.BODY) for leg in robot.legs.values()]
    return [np.array(data.oMf[frame].rotation).T for frame in frames]


def quat_wxyz(rotation: FloatArray) -> FloatArray:
    """Return a (3, 3) rotation as a quaternion, w first."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)


def floors_of_feet(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors) -> list[int]:
    """Return the ids of the geoms that the feet FL FR RL RR stand on."""
    uneven = errors.drawn["foothold_height"].any()
    return [model.geom(f"{FLOOR}_{leg}" if uneven else FLOOR).id for leg in robot.legs]


def foothold_heights(errors: DrawnErrors, heading: float) -> FloatArray:
    """(4,) heights of what the feet of a robot stand on that was turned in the room [m].

    After half a turn each foot stands where the one across stood.

    Args:
        heading: angle by which the robot was turned [rad].
    """
    before, turned = errors.drawn["foothold_height"], (1 - np.cos(heading)) / 2
    return (1 - turned) * before + turned * before[::-1]


def soften_feet(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors) -> None:
    """Give the feet their drawn stiffness, on a hard floor.

    MuJoCo makes friction as stiff as the normal force, times a ratio. The ratio is raised, so that soft feet creep no faster
    than hard ones.
    """
    stiffness = errors.sizes.foot_stiffness
    if not stiffness:
        return
    for geom in (geom for leg in robot.legs for geom in foot_geoms(model, leg)):
        weight = float(model.body_invweight0[model.geom_bodyid[geom], 0])
        solref, solimp, softness = spring_constraint(stiffness, _RUBBER_TIME * stiffness, model.opt.timestep, weight)
        model.geom_solref[geom], model.geom_solimp[geom], model.geom_priority[geom] = solref, solimp, 1
        hard = weight * (1 - IMPEDANCE[0]) / IMPEDANCE[0] / IMPRATIO
        model.opt.impratio = max(model.opt.impratio, softness / hard)


def _friction(errors: DrawnErrors) -> tuple[int, list[float]]:
    """Return the contact dimensions, and the sliding, torsional [m] and rolling [m] friction.

    The dimensions are 3 for sliding, 4 with torsional, 6 with rolling friction; friction without one has no effect.
    """
    torsional, rolling = errors.sizes.torsional_friction, errors.sizes.rolling_friction
    if not (torsional or rolling):
        return 3, [errors.floor_friction, 0.005, 0.0001]
    return 6 if rolling else 4, [errors.floor_friction, torsional, rolling]


def _parameters_from_file(spec: mujoco.MjSpec, robot: RobotModel) -> dict[str, dict[str, Any]]:
    """Return by leg the contact parameters of the file's sphere at the foot; it may belong to a body fixed to the link.

    Args:
        spec: the file's bodies and shapes, before anything is added.
    """
    found: dict[str, dict[str, Any]] = {}
    if robot.source.format == "mjcf":
        model: Any = spec.compile()
        data: Any = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for leg in robot.legs.values():
            link = model.body(leg.foot_body).id
            where = data.xpos[link] + data.xmat[link].reshape(3, 3) @ leg.foot_in_body
            spheres = (model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & (
                model.body_weldid[model.geom_bodyid] == model.body_weldid[link]
            )
            there = spheres & np.isclose(data.geom_xpos, where, atol=1e-6).all(axis=1)
            for index in np.flatnonzero(there)[:1]:
                found[leg.name] = {key: getattr(model, f"geom_{key}")[index] for key in _FILE_KEYS}
    if missing := sorted(robot.legs.keys() - found):
        raise SettingsError(
            f"the model file of {robot.name!r} has no contact parameters for its feet: it needs an MJCF sphere at each foot, "
            f"and {', '.join(missing)} have none; omit --contact-model file"
        )
    return found
