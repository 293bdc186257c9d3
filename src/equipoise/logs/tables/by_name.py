"""Meaning of a table's column according to its name: the words that people use for sensors, axes, joints and time."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from equipoise.robot.forward import leg_of

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_TIME = {"time", "t", "stamp", "timestamp", "timestamps", "sec", "secs", "seconds", "clock", "tick"}
_COUNTS = {"index", "idx", "count", "counter", "seq", "frame", "step", "steps", "row", "id"}
_GYROSCOPE = {"gyro", "gyros", "gyroscope", "gyr", "omega", "angvel"}
_ACCELEROMETER = {"acc", "accel", "accelerometer", "acceleration", "accelerations"}
_ORIENTATION = {"quat", "quaternion", "orientation", "ori", "attitude", "rpy", "euler"}
_ANGULAR, _RATE = {"angular", "ang", "rotational"}, {"velocity", "vel", "rate", "rates", "speed"}
_ANGLES, _IN_ANGLES = ("roll", "pitch", "yaw"), {"rpy", "euler"}
# Letters that go before an axis in one word, as in "wx".
_LETTERS = {"w": "gyro", "g": "gyro", "gyro": "gyro", "omega": "gyro", "a": "accelerometer", "acc": "accelerometer",
            "accel": "accelerometer", "q": "orientation", "quat": "orientation"}  # fmt: skip
_QUANTITIES = {
    "torque": {"tau", "torque", "torques", "effort", "efforts", "eff", "tauest", "trq"},
    "velocity": {"dq", "qd", "dqs", "qdot", "vel", "velocity", "velocities", "speed", "speeds"},
    "position": {"q", "qs", "pos", "position", "positions", "angle", "angles", "enc", "encoder", "encoders"},
}
_FORCES, _AXES = {"force", "forces", "grf"}, {"x", "y", "z", "fx", "fy", "fz", "est"}
_COMMANDS = {"cmd", "command", "commands", "commanded", "des", "desired", "target", "targets", "ref", "reference"}
_NOT_JOINTS = {"force", "forces", "contact", "contacts", "grf", "temperature", "temp", "ddq", "qdd", "feet", "base"}
_OF_SOME_JOINTS = {"leg", "legs"}  # `lf_hip_joint`, `lf_upper_leg_joint`: one family
_GENERAL = {"joint", "joints", "state", "states", "motor", "motors", "data", "robot", "field", "leg", "legs", "est"}

Families = list[dict[str, str]]
"""Columns that belong together, each a dict from their parts to their names."""


@dataclass(frozen=True)
class Named:
    """Meaning of a column's name.

    Attributes:
        kind: kind of column, as in `UNITS`.
        part: axis of a sensor, as "x", "w", "roll" or an index; a joint's own words or index; empty for time.
        family: words that the columns of one sensor, or of all joints, share.
        joint: whether the part names a joint by a leg.
    """

    kind: str
    part: str
    family: tuple[str, ...]
    joint: bool = False


def named(name: str) -> Named | None:
    """Return the meaning of a name, or None."""
    words = [word.lower() for word in _WORDS.findall(name)]
    said = set(words)
    if said & _COUNTS:
        return None
    leg = leg_of(words)
    if leg is not None and said & _FORCES and not said & _AXES:
        return Named("foot_force", leg, tuple(word for word in words if leg_of([word]) is None))
    sensor = None if leg else _sensor(words)
    if sensor is not None:
        return sensor
    if said & _TIME and leg is None:
        return Named("time", "", tuple(words))
    return _joint(words, leg)


def _sensor(words: list[str]) -> Named | None:
    """Return the meaning of an IMU's column: its kind by words before the axis, or by letters that are one with it."""
    said, last = set(words), words[-1] if words else ""
    axis = re.fullmatch(r"([a-z]*?)([wxyz])", last)
    kind = None
    if said & _GYROSCOPE or (said & _ANGULAR and said & _RATE):
        kind = "gyro"
    elif said & _ORIENTATION:
        kind = "orientation"
    elif said & _ACCELEROMETER and not said & _ANGULAR:
        kind = "accelerometer"
    elif last in _ANGLES and not said & _RATE and not said & {"joint", "motor", "hip"}:
        return Named("orientation", last, tuple(words[:-1]))
    elif axis is not None and axis[1] in _LETTERS:
        return Named(_LETTERS[axis[1]], axis[2], (*words[:-1], axis[1]))
    elif axis is not None and not axis[1] and words[-2:-1] and words[-2] in _LETTERS:
        kind = _LETTERS[words[-2]]
    if kind is None or "joint" in said or "motor" in said:
        return None
    if last in _ANGLES:
        return Named(kind, last, tuple(words[:-1]))
    if axis is not None:
        return Named(kind, axis[2], (*words[:-1], axis[1]))
    if said & _IN_ANGLES and last in ("0", "1", "2"):
        return Named(kind, _ANGLES[int(last)], tuple(words[:-1]))
    return Named(kind, last, tuple(words[:-1])) if last.isdigit() else None


def _joint(words: list[str], leg: str | None) -> Named | None:
    said = set(words)
    quantity = next((kind for kind, of in _QUANTITIES.items() if said & of), None)
    commanded = bool(said & _COMMANDS)
    if said & _NOT_JOINTS or (quantity is None and leg is None and not commanded):
        return None
    if commanded and quantity in ("velocity", "torque"):
        return None
    kind = "command" if commanded else quantity or "position"
    general = {*_QUANTITIES.get(quantity or "", ()), *_GENERAL, *(_COMMANDS if commanded else ())}
    if leg is not None:
        own = [word for word in words if word not in general or word in _OF_SOME_JOINTS]
        family = tuple(word for word in words if word in general and word not in _OF_SOME_JOINTS)
        return Named(kind, "_".join(own), family, joint=True)
    digits = [word for word in words if word.isdigit()]
    return Named(kind, digits[-1], tuple(word for word in words if not word.isdigit())) if digits else None


def families(names: Iterable[str]) -> dict[str, Families]:
    """Return columns that belong together, by kind; those of joints whose names state no quantity come last."""
    found: dict[str, dict[tuple[bool, tuple[str, ...], bool], dict[str, str]]] = {}
    for name in names:
        what = named(name)
        if what is not None:
            vague = what.joint and not set(what.family) & {*_QUANTITIES.get(what.kind, ()), *_COMMANDS}
            family = found.setdefault(what.kind, {}).setdefault((vague, what.family, what.joint), {})
            family.setdefault(what.part, name)
    return {kind: [of[key] for key in sorted(of, key=lambda key: key[0])] for kind, of in found.items()}
