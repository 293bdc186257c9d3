"""Meaning of a table's column according to its name: common words for sensors, axes, joints, time and units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from equipoise.logs.tables.column_names import UNITS
from equipoise.robot.forward import leg_of

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_TIME = {"time", "t", "stamp", "timestamp", "timestamps", "sec", "secs", "seconds", "clock", "tick", "ts", "msec"}
_COUNTS = {"index", "idx", "count", "counter", "seq", "frame", "step", "steps", "row", "id", "covariance", "cov"}
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
    "velocity": {"dq", "qd", "dqs", "qdot", "v", "vel", "velocity", "velocities", "speed", "speeds"},
    "position": {"q", "qs", "p", "pos", "position", "positions", "angle", "angles", "enc", "encoder", "encoders"},
}
_FORCES, _AXES = {"force", "forces", "grf"}, {"x", "y", "z", "fx", "fy", "fz", "est"}
_COMMANDS = {"cmd", "command", "commands", "commanded", "des", "desired", "target", "targets", "ref", "reference"}
_NOT_JOINTS = {
    "force", "forces", "contact", "contacts", "grf", "wrench", "temperature", "temp", "ddq", "qdd", "feet", "base", "error",
    "limit", "limits", "ff", "feedforward", "ext", "external", "residual", "disturbance",
}  # fmt: skip
_ESTIMATES = {"estimate", "estimates", "estimated", "estimator", "ekf", "kf", "odom", "odometry", "pose", "twist"}
_BASE = {"base", "body", "trunk", "torso", "pose", "odom", "odometry", "mocap", "vicon", "optitrack"}
_OF_BASE_POSITION = _BASE | {"position", "pos", "p", "world", "in", "state"}
_OF_SOME_JOINTS = {"leg", "legs"}  # `lf_hip_joint`, `lf_upper_leg_joint`: one family
_GENERAL = {"joint", "joints", "state", "states", "motor", "motors", "data", "robot", "field", "leg", "legs", "est"}
_NAMES = {"name", "names"}
_WHOLE_IMU = {"imu", "data", "raw", "state", "sensor", "sensors", "field", "msg"}

_UNITREE = re.compile(r"\bmotor ?(states?|cmd)\b")

FORMULA = re.compile(r" \+ 1e-\d ")
"""Between the two columns of a clock, as in "stamp.sec + 1e-9 stamp.nanosec"."""
_SECONDS = ("sec", "secs", "seconds")
_REMAINDERS_ALONE = ("nanosec", "nanosecs", "nsec", "nsecs")
_REMAINDERS = {
    **dict.fromkeys((*_REMAINDERS_ALONE, "nanos", "nanoseconds"), "1e-9"),
    **dict.fromkeys(("usec", "usecs", "microseconds"), "1e-6"),
}

_BRACKETED = re.compile(r"(.*?)[\s_]*[\[({]([^\[\](){}]*)[\])}]\s*", re.DOTALL)
_ENDING = re.compile(r"(.*?[^_\s,:])(?:_| in |[,:]?\s+|[,:])((?:rad|deg|m)_s2?|[^_\s,:]+)", re.DOTALL)
_SIGNS = str.maketrans(
    {"²": "2", "⁻": "-", "¹": "1", "°": "deg", "µ": "u", "μ": "u", "_": "/", **dict.fromkeys(" ·*^.", "")}
)
_SHORTER = {"degrees?": "deg", "radians?": "rad", "sec(ond)?s?$": "s", "/sec(ond)?": "/s"}
# Units by their spellings, in lower case; those of the last line are recognized and not used.
_SPELLINGS = {
    **{unit.lower(): unit for units in UNITS.values() for unit in units},
    "millis": "ms", "micros": "us", "nanos": "ns", "dps": "deg/s", "degs-1": "deg/s", "rads": "rad/s", "rads-1": "rad/s",
    "m/s/s": "m/s2", "ms-2": "m/s2", "ms2": "m/s2", "mps2": "m/s2", "gs": "g", "n-m": "Nm",
    **{other: other for other in ("m", "mm", "cm", "m/s", "mm/s", "a", "ma", "v", "mv", "w", "degc", "%", "hz", "lsb")},
}  # fmt: skip

Families = dict[tuple[str, ...], dict[str, str]]
"""Columns that belong together by the words that they share, each a dict from their parts to their names."""


@dataclass(frozen=True)
class Named:
    """Meaning of a column's name.

    Attributes:
        kind: kind of column, as in `UNITS`; "name" for names of joints in cells, "imu" for an IMU's numbered columns.
        part: axis of a sensor, as "x", "w", "roll" or an index; a joint's own words or index; empty for time.
        family: words that the columns of one sensor, or of all joints, share.
        unit: unit that the name states, or None.
    """

    kind: str
    part: str
    family: tuple[str, ...]
    unit: str | None = None


def named(name: str) -> Named | None:
    """Return the meaning of a name, or None."""
    words = _stamp_words(name)
    if FORMULA.search(name):
        return Named("time", "", (name,), "s")
    if words and words[-1] in _REMAINDERS_ALONE:
        return None
    bare, unit, bracketed = _without_unit(name)
    found = _meaning(_words(bare))
    if unit is None:
        return found
    if found is not None and unit in UNITS.get(found.kind, ()):
        return replace(found, unit=unit)
    return None if bracketed else _meaning(words)


def two_part_stamps(names: Iterable[str]) -> dict[str, tuple[str, str, float]]:
    """Return clocks in two columns by their formulas, as "sec + 1e-9 nanosec": seconds, remainder, and its unit [s]."""
    by_words = {_stamp_words(name): name for name in names}
    found: dict[str, tuple[str, str, float]] = {}
    for words, seconds in by_words.items():
        for remainder, unit in _REMAINDERS.items() if words and words[-1] in _SECONDS else ():
            if (rest := by_words.get((*words[:-1], remainder))) is not None:
                found[f"{seconds} + {unit} {rest}"] = seconds, rest, float(unit)
    return found


def families(names: Iterable[str]) -> dict[str, Families]:
    """Return columns that belong together, by kind; raw ones and those of joints whose names state no quantity come last."""
    found: dict[str, Families] = {}
    for name in names:
        what = named(name)
        if what is not None:
            found.setdefault(what.kind, {}).setdefault(what.family, {}).setdefault(what.part, name)

    def vague(kind: str, family: tuple[str, ...]) -> bool:
        return "raw" in family or not set(family) & _QUANTITIES.get(kind, _QUANTITIES["position"])

    return {kind: dict(sorted(of.items(), key=lambda item: vague(kind, item[0]))) for kind, of in found.items()}


def source_of(family: Iterable[str]) -> set[str]:
    """Return the words of a family that do not state its quantity: those of the message that it is from."""
    return set(family) - _NAMES - _GENERAL - set().union(*_QUANTITIES.values())


def in_unitrees_order(family: Iterable[str]) -> bool:
    """Return whether columns have the names of Unitree's messages, as in motorState[0].q, and so the order of its motors."""
    return _UNITREE.search(" ".join(family)) is not None


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORDS.findall(name)]


def _stamp_words(name: str) -> tuple[str, ...]:
    bare, _, bracketed = _without_unit(name)  # the "ns" of "stamp_ns" is not removed: only a bracketed unit is certain
    return tuple(_words(bare if bracketed else name))


def _without_unit(name: str) -> tuple[str, str | None, bool]:
    """Return a name without the unit at its end, that unit or None, and whether it is in brackets."""
    stem = re.sub(r"(\[\d+\])+$", "", name)
    bracketed = _BRACKETED.fullmatch(stem)
    found = bracketed or _ENDING.fullmatch(stem)
    unit = _unit(found[2]) if found else None
    return (name if found is None or unit is None else found[1] + name[len(stem) :]), unit, bracketed is not None


def _unit(text: str) -> str | None:
    short = text.lower().translate(_SIGNS)
    for longer, shorter in _SHORTER.items():
        short = re.sub(longer, shorter, short)
    return _SPELLINGS.get(short)


def _meaning(words: Sequence[str]) -> Named | None:
    present, last = set(words), words[-1] if words else ""
    leg = leg_of(words)
    if present & _COUNTS:
        return None
    if leg is not None and present & _FORCES and not present & _AXES:
        return Named("foot_force", leg, tuple(word for word in words if leg_of([word]) is None))
    if present & _NAMES and last.isdigit():
        return Named("name", last, tuple(words[:-1]))
    if present & _BASE and last in ("x", "y", "z", "0", "1", "2") and set(words[:-1]) <= _OF_BASE_POSITION:
        return Named("base_position", last, tuple(words[:-1]))
    sensor = None if leg else _sensor(words)
    if sensor is not None:
        return sensor
    if present & _TIME and leg is None:
        return Named("time", "", tuple(words))
    if "imu" in present and last.isdigit() and set(words[:-1]) <= _WHOLE_IMU:
        return Named("imu", last, tuple(words[:-1]))
    return _joint(words, leg)


def _sensor(words: Sequence[str]) -> Named | None:
    """Return the meaning of an IMU's column: its kind by words before the axis, or by letters that are one with it."""
    present, last = set(words), words[-1] if words else ""
    axis = re.fullmatch(r"([a-z]*?)([wxyz])", last)
    kind = None
    if present & _GYROSCOPE or (present & _ANGULAR and present & _RATE):
        kind = "gyro"
    elif present & _ORIENTATION:
        kind = "orientation"
    elif present & _ACCELEROMETER and not present & _ANGULAR:
        kind = "accelerometer"
    elif last in _ANGLES and not present & _RATE and not present & {"joint", "motor", "hip"}:
        return Named("orientation", last, tuple(words[:-1]))
    elif axis is not None and axis[1] in _LETTERS:
        return Named(_LETTERS[axis[1]], axis[2], (*words[:-1], axis[1]))
    elif axis is not None and not axis[1] and words[-2:-1] and words[-2] in _LETTERS:
        kind = _LETTERS[words[-2]]
    if kind is None or "joint" in present or "motor" in present:
        return None
    if last in _ANGLES:
        return Named(kind, last, tuple(words[:-1]))
    if axis is not None:
        return Named(kind, axis[2], (*words[:-1], axis[1]))
    if present & _IN_ANGLES and last in ("0", "1", "2"):
        return Named(kind, _ANGLES[int(last)], tuple(words[:-1]))
    return Named(kind, last, tuple(words[:-1])) if last.isdigit() else None


def _joint(words: Sequence[str], leg: str | None) -> Named | None:
    present = set(words)
    quantity = next((kind for kind, of in _QUANTITIES.items() if present & of), None)
    commanded = bool(present & _COMMANDS)
    if present & _NOT_JOINTS or (quantity is None and leg is None and not commanded):
        return None
    if commanded and quantity in ("velocity", "torque"):
        return None
    if present & _ESTIMATES and (
        quantity != "torque" or present & (_ESTIMATES - {"estimate", "estimated"}) or "state" in present
    ):
        return None
    kind = "command" if commanded else quantity or "position"
    general = {*_QUANTITIES.get(quantity or "", ()), *_GENERAL, *(_COMMANDS if commanded else ())}
    if leg is not None:
        own = [word for word in words if word not in general or word in _OF_SOME_JOINTS]
        family = tuple(word for word in words if word in general and word not in _OF_SOME_JOINTS)
        return Named(kind, "_".join(own), family)
    digits = [word for word in words if word.isdigit()]
    return Named(kind, digits[-1], tuple(word for word in words if not word.isdigit())) if digits else None
