"""Baselines of the motors' identification: functions from a recording to the parameters of all joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines_of_others import mujoco_sysid_motors, torque_regression, trajectory_fit
from baselines_of_others.held_base import JointParameters, Swing, read_swing
from equipoise import RobotModel, nominal_stance
from equipoise.motors.method import Motors
from equipoise.recording.recording import Recording
from equipoise.robot.scale import Scale

Found = dict[str, NDArray[np.float64]]
"""(nj,) values of each joint by names of `Motor`, in the unit in which motors report torques on average."""
Fit = Callable[[RobotModel, Recording, Scale], Found]

UNITS = {"coulomb_friction": None, "relative_gain": 0.01, "armature": None, "viscous_friction": None, "delay": 1e-3}
"""Unit of each quantity's errors; None: a hundredth of the truth."""


def ours(robot: RobotModel, recording: Recording, _: Scale, what: str = "value") -> Found:
    """Return the estimates of `--parameters motors`, or their standard deviations: "std"."""
    found = Motors().estimate(robot, [recording], nominal_stance(robot)).motors.values()
    return {name: np.array([getattr(motor.quantities[name], what) for motor in found], dtype=float) for name in UNITS}


def ours_without_torques(robot: RobotModel, recording: Recording, scale: Scale) -> Found:
    """Return the same estimates for a robot that does not report torques."""
    return ours(robot, replace(recording, joints=replace(recording.joints, torque=None)), scale)


def by(fit: Callable[[RobotModel, Swing, Scale], JointParameters], *more: str) -> Fit:
    """Return a baseline's function for friction, armature and `more`."""
    return lambda robot, recording, scale: values_of(fit(robot, read_swing(robot, recording), scale), more)


def values_of(parameters: JointParameters, more: Sequence[str]) -> Found:
    """Return a baseline's values in the unit in which motors report torques on average."""
    p, mean = parameters, parameters.gain.mean()
    values = {"coulomb_friction": p.coulomb_friction, "viscous_friction": p.viscous_friction, "armature": p.armature}
    others = {"relative_gain": p.gain / mean - 1, "delay": np.full_like(p.gain, p.delay)}
    return {name: of / mean for name, of in values.items()} | {name: others[name] for name in more}


def errors_of(found: Found, truth: Sequence[dict[str, Any]]) -> dict[str, list[float]]:
    """Return the errors of all joints in `UNITS`."""
    return in_units({name: of - [one[name] for one in truth] for name, of in found.items()}, truth)


def in_units(values: Found, truth: Sequence[dict[str, Any]]) -> dict[str, list[float]]:
    """Return values of all joints, such as errors, in `UNITS`."""
    units = {name: UNITS[name] or 0.01 * np.array([one[name] for one in truth]) for name in values}
    return {name: (of / units[name]).tolist() for name, of in values.items()}


FITS: dict[str, Fit] = {
    "equipoise": ours,
    "equipoise, without torques": ours_without_torques,
    "trajectory fit (as PACE)": by(trajectory_fit.fit, "delay"),
    "torque regression": by(torque_regression.fit),
    "mujoco.sysid": by(mujoco_sysid_motors.fit, "relative_gain", "delay"),
}
