"""Position limits of leg joints: those of the file or narrower described ones, and checks of implausible ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError, SettingsError
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.description import RobotDescription
from equipoise.robot.legs import Leg
from equipoise.robot.tree import joint_axis

_ROUNDED = 1e-3  # [rad] that a described limit may lie beyond the file's, which has more digits
# Limits beyond two turns either mean no limit, as +-10, +-100 or +-10 pi, or are degrees.
_FEWEST_DEGREES, _MOST_DEGREES = 4 * np.pi, 720.0
_FEWEST_RADIANS = 2 * np.pi**2 / 180  # [rad]; if all limits are below it, radians were read as degrees
_MIRRORED = 0.1  # [rad] that limits of the two sides may differ; the thighs of Spot differ by 0.06
_SAME_PLACE_RATIO = 0.01  # of the leg length; places that are mirrored at zero differ by less
_SAME_AXIS = 0.01  # [rad]


def file_limits(model: pin.Model) -> tuple[FloatArray, FloatArray]:
    """Return (nj,) lower and upper position limits of the file, two turns if it has none or wider ones [rad]."""
    lower, upper = np.array(model.lowerPositionLimit[7:]), np.array(model.upperPositionLimit[7:])
    return np.maximum(lower, -UNLIMITED_JOINT_RANGE), np.minimum(upper, UNLIMITED_JOINT_RANGE)


def position_limits(
    model: pin.Model, joint_names: tuple[str, ...], description: RobotDescription, robot: str
) -> tuple[FloatArray, FloatArray]:
    """Return (nj,) lower and upper position limits [rad]: the file's, or narrower described ones."""
    lower, upper = file_limits(model)
    for joint, (least, most) in description.joint_limits.items():
        index = joint_index(joint_names, joint, "joint_limits", robot)
        if max(lower[index] - least, most - upper[index]) > _ROUNDED:
            units = "; rad, not degrees?" if max(-least, most) > UNLIMITED_JOINT_RANGE else ""
            raise SettingsError(
                f"joint_limits of {joint!r} are {least:g} to {most:g} rad, beyond the model's {lower[index]:.3f} to "
                f"{upper[index]:.3f} rad; they may be narrower, not wider{units}"
            )
        lower[index], upper[index] = max(least, lower[index]), min(most, upper[index])
    return lower, upper


def joint_index(joint_names: tuple[str, ...], joint: str, key: str, robot: str) -> int:
    """Return the index of a joint that a description names under a key."""
    try:
        return joint_names.index(joint)
    except ValueError:
        raise SettingsError(
            f"{key} names {joint!r}, which is not a leg joint of {robot!r}; those are {', '.join(joint_names)}"
        ) from None


def refuse_degrees(model: pin.Model, path: Path) -> None:
    """Refuse a file whose leg joints have limits in degrees, or in radians that are read as degrees."""
    lower, upper = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
    wrong = [
        f"{name} {low:g} to {high:g} rad"
        for name, low, high in zip(model.names[2:], lower, upper, strict=True)
        if _looks_like_degrees(float(low), float(high))
    ]
    if wrong:
        raise ModelError(
            f"robot model {str(path)!r}: position limits look like degrees: {', '.join(wrong)}; give them in radians"
        )
    largest = float(np.maximum(np.abs(lower), np.abs(upper)).max())
    if largest < _FEWEST_RADIANS:
        raise ModelError(
            f"robot model {str(path)!r}: no leg joint may turn by more than {largest:.3g} rad: its position limits look like "
            'radians that are read as degrees; in MJCF give <compiler angle="radian"/>'
        )


def _looks_like_degrees(lower: float, upper: float) -> bool:
    """Return whether limits [rad] exceed a leg joint's range and do not mean no limit."""
    largest = max(-lower, upper)
    if not 1.001 * _FEWEST_DEGREES < largest <= _MOST_DEGREES:
        return max(lower, -upper) > UNLIMITED_JOINT_RANGE
    turns, decades = largest / np.pi, np.log10(largest)
    stands_for_none = abs(turns - round(turns)) < 0.01 or abs(decades - round(decades)) < 1e-6
    return abs(lower + upper) > 1e-3 * largest or not stands_for_none


def limits_not_mirrored(model: pin.Model, legs: Mapping[str, Leg], leg_length: float) -> Iterator[str]:
    """Compare the file's limits of left and right legs, joint by joint, and yield a sentence for each pair that differs.

    Mirroring in the plane y = 0 turns an axis (x, y, z) to (-x, y, -z). If a left joint has that axis, its limits are the
    right one's; if it has the opposite one, they are those with exchanged signs. Joints that are not mirrored at zero
    are not compared.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    lower, upper = file_limits(model)
    middle = np.mean([data.oMi[leg.joint_ids[0]].translation[1] for leg in legs.values()])
    for left, right in ((legs["FL"], legs["FR"]), (legs["RL"], legs["RR"])):
        points = [_points(data, leg) - np.array([0.0, middle, 0.0]) for leg in (left, right)]
        apart = np.linalg.norm(points[0] - points[1] * np.array([1.0, -1.0, 1.0]), axis=1)
        for place, (one, other) in enumerate(zip(left.joint_ids, right.joint_ids, strict=True)):
            if apart[: place + 2].max() > _SAME_PLACE_RATIO * leg_length:
                break
            axes = [data.oMi[joint].rotation @ joint_axis(model, joint) for joint in (one, other)]
            sense = float(axes[0] @ (axes[1] * np.array([-1.0, 1.0, -1.0])))
            if 1 - abs(sense) > _SAME_AXIS**2:
                continue
            of_left, of_right = ((float(lower[joint - 2]), float(upper[joint - 2])) for joint in (one, other))
            mirrored = of_right if sense > 0 else (-of_right[1], -of_right[0])
            if np.abs(np.subtract(of_left, mirrored)).max() <= _MIRRORED:
                continue
            same = np.abs(np.subtract(of_left, of_right)).max() <= _MIRRORED
            yield (
                f"limits of {model.names[one]} and {model.names[other]} are not mirrored: {_span(of_left)} rad"
                + (" both, though equal angles do not mirror these legs" if same else f" and {_span(of_right)} rad")
                + f"; mirrored, {model.names[one]} has {_span(mirrored)} rad"
            )


def _points(data: pin.Data, leg: Leg) -> FloatArray:
    """Return (n + 1, 3) joints and foot of a leg in the base frame [m]."""
    return np.array(
        [*(data.oMi[joint].translation for joint in leg.joint_ids), data.oMf[leg.foot_frame_id].translation]
    )


def _span(limits: tuple[float, float]) -> str:
    return f"{limits[0]:.3g} to {limits[1]:.3g}"
