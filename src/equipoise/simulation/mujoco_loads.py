"""Loads of the simulated robot in MuJoCo: a payload, a swinging or sloshing load, external forces."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import SettingsError
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.payload import Payload

WATER = "equipoise_water"
SWINGING_LOAD = "equipoise_swinging_load"
SLING, HOSE, PULL = "equipoise_sling", "equipoise_hose", "equipoise_pull"

_SLING, _SLACK = 1.0, 5e-3  # [m] on an A1: length of a safety sling at the stance, and its slack
_STRING = 0.1  # [m], of a load that swings, on an A1
_WAVE = 0.05  # [m] length of a pendulum with the period of water in a tank 0.15 m long and half as deep, on an A1
_SWING_DAMPING = 0.02  # share of critical damping: air and the string, or water on its walls
_FAR = 1e4  # [m] length of a cord whose force and direction are constant


def add_loads(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, stance: Stance, errors: DrawnErrors, payload: Payload | None
) -> None:
    """Add the payload and the loads of the effects to the base.

    Raises:
        SettingsError: slosh is enabled without a payload.
    """
    sizes = errors.sizes
    if payload is not None:
        _add_part(base, "equipoise_payload", payload, 1 - sizes.slosh)
    if sizes.slosh:
        _add_water(base, stance, payload, sizes.slosh)
    if sizes.swinging_load:
        _add_swinging_load(base, stance, sizes.swinging_load)
    _add_cords(spec, base, stance, errors)


def linear(value: float, like: Any) -> Any:
    """Return damping or stiffness as the engine takes it: a scalar up to MuJoCo 3, coefficients of a polynomial from 4 on."""
    return value if np.ndim(like) == 0 else value * np.eye(np.size(like))[0]


def _add_part(base: mujoco.MjsBody, name: str, payload: Payload, share: float) -> mujoco.MjsBody:
    """Add a share of the payload as a body at the base frame's origin whose inertial is offset.

    MuJoCo 4 counts an offset of the body twice when its inertial has none of its own.
    """
    parameters = payload.parameters
    tensor = share * parameters.inertia
    # A point mass has no inertia, but MuJoCo requires a positive one.
    floor = 1e-9 * np.eye(3) if not tensor.any() else np.zeros((3, 3))
    body = base.add_body(name=name, pos=[0, 0, 0])
    body.explicitinertial = True
    body.mass = share * parameters.mass
    body.ipos = parameters.com
    body.fullinertia = (tensor + floor)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return body


def _add_water(base: mujoco.MjsBody, stance: Stance, payload: Payload | None, share: float) -> None:
    """Add a share of the payload on springs along the base's x and y axes: the first mode of water in a tank."""
    if payload is None:
        raise SettingsError(f"slosh is {share:g}, but the robot has no payload; give one, for example 1.5,0.1,0,0.08")
    water = _add_part(base, WATER, payload, share)
    mass, frequency = share * payload.parameters.mass, np.sqrt(GRAVITY / (_WAVE * stance.scale.length))
    for axis in np.eye(3)[:2]:
        joint = water.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        joint.stiffness = linear(mass * frequency**2, joint.stiffness)
        joint.damping = linear(2 * _SWING_DAMPING * mass * frequency, joint.damping)


def _add_swinging_load(base: mujoco.MjsBody, stance: Stance, mass: float) -> None:
    """Add a ball on a string under the base, half-way to the rear feet."""
    length, radius = _STRING * stance.scale.length, 0.2 * _STRING * stance.scale.length
    load = base.add_body(name=SWINGING_LOAD, pos=0.5 * _above_rear_feet(stance))
    load.explicitinertial = True
    load.mass, load.ipos, load.inertia = mass, [0, 0, -length], np.full(3, 0.4 * mass * radius**2)
    about_hook = mass * (length**2 + 0.4 * radius**2)
    joint = load.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    joint.damping = linear(2 * _SWING_DAMPING * about_hook * np.sqrt(GRAVITY / length), joint.damping)


def _above_rear_feet(stance: Stance) -> FloatArray:
    """Return the (3,) point of the base, in its frame, at the height of its origin [m]."""
    return np.array([-np.abs(stance.feet_in_base[:, 0]).mean(), 0, 0])


def _add_cords(spec: mujoco.MjSpec, base: mujoco.MjsBody, stance: Stance, errors: DrawnErrors) -> None:
    """Add springs from the base to the world: a sling above its origin, a hose and a vertical pull above the rear feet."""
    sizes, sling, origin, back = errors.sizes, _SLING * stance.scale.length, np.zeros(3), _above_rear_feet(stance)
    far = -np.sign(sizes.vertical_pull) * _FAR * errors.gravity_direction
    cords = (  # name, stiffness [N/m], point of the base, the cord from there to its hook in the room, free length [m]
        (SLING, sizes.sling, origin, [0, 0, sling], sling + _SLACK * stance.scale.length),
        (HOSE, sizes.hose, back, origin, 0.0),
        (PULL, abs(sizes.vertical_pull) / _FAR, back, far, 0.0),
    )
    for name, stiffness, eye, cord, free_length in cords:
        if stiffness:
            base.add_site(name=f"{name}_eye", pos=eye)
            spec.worldbody.add_site(name=f"{name}_hook", pos=eye + cord + [0, 0, stance.base_height])
            tendon = spec.add_tendon(name=name, springlength=[0, free_length])
            tendon.stiffness = linear(stiffness, tendon.stiffness)
            tendon.wrap_site(f"{name}_hook")
            tendon.wrap_site(f"{name}_eye")
