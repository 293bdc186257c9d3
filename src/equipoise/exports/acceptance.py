"""Objections to a result, and the parts of it that are only written if forced."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin

from equipoise.clearance.shapes import Spheres, robot_shapes
from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.exports.parameters import LEGS, MOTORS, SENSORS, Column, columns_of
from equipoise.exports.subject import Subject
from equipoise.result.calibration import Calibration
from equipoise.robot.model import RobotModel

_WEAK = "weakly identified"
_LEFT_OUT = "not identified, so not written (0 where a format lists every joint)"
_REMEDY = {
    SENSORS: "calibrate with --method bayesian",
    MOTORS: "calibrate with --parameters base,motors",
    LEGS: "calibrate with --parameters base,legs",
}
_AROUND = 0.1  # of the leg length: how far beyond links and feet a CoM may lie, to the sides and below
_ABOVE = 1.0  # of the leg length: payloads are carried on the back, in stacks
_GYRATIONS = 3.0  # radii of gyration of the model's robot: the bound without a model file


class ParameterNote(str):
    """Note that lists parameters.

    Attributes:
        kind: property that they share, in words.
        names: names of the parameters.
    """

    kind: str
    names: tuple[str, ...]

    def __new__(cls, kind: str, names: Iterable[str]) -> ParameterNote:
        names = tuple(names)
        note = super().__new__(cls, f"{kind}: {', '.join(names)}")
        note.kind, note.names = kind, names
        return note

    def __reduce__(self) -> tuple[type[ParameterNote], tuple[str, tuple[str, ...]]]:
        return ParameterNote, (self.kind, self.names)


def accept_bodies(result: Calibration, bodies: Sequence[str], force: bool) -> tuple[str, ...]:
    """Return the objections to a result's bodies, one sentence each, worst first.

    Raises:
        NotEstimatedError: the method does not estimate a body; or a parameter is not identified or a check failed, and `force`
            is false.
    """
    for body in bodies:
        try:
            getattr(result, body).parameters()
        except NotEstimatedError as error:
            raise NotEstimatedError(f"{body}: {error}") from None
    missing = _with_verdict(result, bodies, "not identified")
    if missing and not force:
        raise NotEstimatedError(
            f"not identified by this run: {', '.join(missing)}; calibrate longer (--duration) or with a scale (--mass), or "
            "write them anyway with --force"
        )
    notes = [f"FORCED: not identified, close to the model file's values: {', '.join(missing)}"] if missing else []
    if _with_verdict(result, bodies, "doubtful"):
        _refuse_doubtful(result, force)
    notes += _failed(result)
    weak = _with_verdict(result, bodies, "weak")
    notes += [f"assumed: {assumption}" for assumption in result.assumptions]
    return (*notes, *([ParameterNote(_WEAK, weak)] if weak else []))


def accept_columns(
    result: Calibration, parts: Sequence[str], force: bool
) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """Return the columns of sensors, motors and legs to write, and the objections, one sentence each, worst first.

    Values that are not identified are left out unless `force` is true.

    Args:
        parts: requested parts, of "sensors", "motors" and "legs".

    Raises:
        NotEstimatedError: the run did not estimate a part; or no value of a part is identified, or a check failed, and
            `force` is false.
    """
    found = [column for part in parts for column in _columns(result, part, force)]
    if not found:
        return (), ()
    _refuse_doubtful(result, force)
    missing, weak = _names(found, "not identified"), _names(found, "weak")
    notes = [ParameterNote("FORCED: not identified" if force else _LEFT_OUT, missing)] if missing else []
    notes += _failed(result)
    notes += [ParameterNote(_WEAK, weak)] if weak else []
    written = found if force else [column.identified() for column in found]
    return tuple(column for column in written if column.values), tuple(notes)


def require_within_robot(subject: Subject, bodies: Sequence[str]) -> tuple[str, ...]:
    """Refuse a body whose CoM lies outside the robot.

    Returns:
        a note on the body if it is written by force.

    Raises:
        NotEstimatedError: a CoM lies outside the robot, and `force` is false.
    """
    if not bodies:
        return ()
    low, high, bounds_source = _bounds(subject)
    coms = ((name, getattr(subject, name).com) for name in bodies)
    name, com = next(((name, com) for name, com in coms if ((com < low) | (com > high)).any()), ("", low))
    if not name:
        return ()
    sides = ", ".join(f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in zip("xyz", low, high, strict=True))
    place = ", ".join(f"{value:.4g}" for value in com)
    message = f"the {name}'s CoM ({place}) m lies outside {subject.result.robot!r}: {sides} m {bounds_source}"
    if subject.forced:
        return (f"FORCED: {message}",)
    raise NotEstimatedError(
        f"{message}. Was the result edited, or is it in millimetres? Estimate it again from the run's recordings "
        "(equipoise estimate RUN), or write it anyway with --force"
    )


def _columns(result: Calibration, part: str, force: bool) -> tuple[Column, ...]:
    columns = columns_of(result, part)
    if not columns:
        raise NotEstimatedError(f"this run did not estimate {part}; {_REMEDY[part]}")
    if not force and not any(column.identified().values for column in columns):
        raise NotEstimatedError(
            f"not identified by this run: {', '.join(_names(columns, 'not identified'))}; calibrate longer (--duration), or "
            "write them anyway with --force"
        )
    return columns


def _failed(result: Calibration) -> list[str]:
    return [f"check failed: {check.name}: {check.message}" for check in result.checks if not check.passed]


def _refuse_doubtful(result: Calibration, force: bool) -> None:
    if (failed := _failed(result)) and not force:
        raise NotEstimatedError(
            f"the result is doubtful: {'; '.join(failed)}; fix this and calibrate again, or write it anyway with --force"
        )


def _with_verdict(result: Calibration, bodies: Iterable[str], verdict: str) -> list[str]:
    named = ((f"{body} {quantity.name}", quantity) for body in bodies for quantity in getattr(result, body))
    return [name for name, quantity in named if quantity.verdict == verdict]


def _names(columns: Iterable[Column], verdict: str) -> list[str]:
    """Return the names of the values with a verdict, column by column."""
    names: list[str] = []
    for column in columns:
        if some := [key for key, quantity in column.values.items() if quantity.verdict == verdict]:
            names.append(f"{column.name} ({'all' if len(some) == len(column.values) else ' '.join(some)})")
    return names


def _bounds(subject: Subject) -> tuple[FloatArray, FloatArray, str]:
    """Return lower and upper bounds (3,) of a CoM in the base frame [m], and words for their source."""
    result = subject.result
    if (robot := result.robot_model) is not None:
        stance = robot.joint_vector(dict(result.joint_position), "the run's stance")
        low, high = _box(robot, stance)
        around, up = _AROUND * robot.leg_length, np.array([0.0, 0.0, _ABOVE - _AROUND]) * robot.leg_length
        return low - around, high + around + up, "at its stance, with room for a payload"
    model = result.nominal.composite
    reach = _GYRATIONS * float(np.sqrt(np.trace(model.inertia) / (2 * model.mass)))
    return model.com - reach, model.com + reach, f"within {_GYRATIONS:g} radii of gyration of its model"


def _box(robot: RobotModel, joint_position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds (3,) of links and feet in the base frame [m]."""
    data = robot.create_data()
    pin.forwardKinematics(robot.pinocchio, data, robot.configuration(joint_position))
    spheres = Spheres.around(robot_shapes(robot).geometryObjects)
    centres, radii = spheres.placed([*data.oMi]), spheres.radius[:, None]
    return (centres - radii).min(axis=0), (centres + radii).max(axis=0)
