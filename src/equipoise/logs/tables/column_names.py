"""Map from the documented column names to a table's columns and units, from a TOML file or by equal names.

The documented name is on the left: `gyro.x = "wx"`, `position.FL_hip_joint = "q[0]"`; `units.gyro = "deg/s"` states a unit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError, SettingsError, did_you_mean
from equipoise.robot.model import LEG_NAMES
from equipoise.user_file import read_text, toml_table

TIME = "time"
JOINT_KINDS = ("position", "velocity", "torque", "command")
GYROSCOPE = tuple(f"gyro.{axis}" for axis in "xyz")
ACCELEROMETER = tuple(f"accelerometer.{axis}" for axis in "xyz")
QUATERNION = tuple(f"orientation.{part}" for part in "wxyz")
ANGLES = tuple(f"orientation.{part}" for part in ("roll", "pitch", "yaw"))
BASE_POSITION = tuple(f"base_position.{axis}" for axis in "xyz")
FOOT_FORCES = tuple(f"foot_force.{leg}" for leg in LEG_NAMES)
SENSORS = {
    TIME: ((TIME,),),
    "gyro": (GYROSCOPE,),
    "accelerometer": (ACCELEROMETER,),
    "orientation": (QUATERNION, ANGLES),
    "base_position": (BASE_POSITION,),
    "foot_force": (FOOT_FORCES,),
}
"""Documented names by kind, but for joints: those of a sensor stand together; one of several suffices."""
_SENSED = (*GYROSCOPE, *ACCELEROMETER, *QUATERNION, *ANGLES, *BASE_POSITION, *FOOT_FORCES)

_ANGLE = {"rad": 1.0, "deg": np.pi / 180}
_TURNING = {"rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30}
STANDARD_GRAVITY = 9.80665
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": _ANGLE,
    "velocity": _TURNING,
    "torque": {"Nm": 1.0, "mNm": 1e-3},
    "command": _ANGLE,
    "gyro": _TURNING,
    "accelerometer": {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY},
    "orientation": _ANGLE,
    "base_position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "foot_force": {"counts": 1.0, "N": 1.0},  # only how they change counts
}
"""Factors to the documented unit by kind of column; the first unit of a kind is the documented one."""
_STEPS = {"ns": 1e5, "us": 100.0, "ms": 0.5}  # smallest median steps of times in these units


@dataclass(frozen=True)
class ColumnProposal:
    """Proposed map for a table whose columns do not have the documented names.

    Attributes:
        what: description of the table's defect.
        text: TOML for --columns, guessed from the names of the columns.
        names: names of the table's columns.
    """

    what: str
    text: str
    names: tuple[str, ...]

    def error(self) -> RecordingError:
        """Return the error of a table that cannot be read without this map."""
        remedy = "Check this proposal, save it as columns.toml, and add --columns columns.toml"
        rest = "columns with documented names need no line"
        return RecordingError(f"{self.what}. {remedy}; {rest}:\n\n{self.text}", self, details={"columns": self.text})


@dataclass(frozen=True)
class Columns:
    """A table's columns by their documented names.

    Attributes:
        names: names in the table by documented name, as {"gyro.x": "wx"}; an empty one leaves out a column of that name.
        units: units by kind, where they are not the documented ones, as {"gyro": "deg/s"}.
        rate: samples per second, where the table has no time.
    """

    names: Mapping[str, str] = field(default_factory=dict[str, str])
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    rate: float | None = None

    def __post_init__(self) -> None:
        """Raise SettingsError for a rate that is not a positive number."""
        if self.rate is not None and not 0 < self.rate < np.inf:
            raise SettingsError(f"the rate must be above zero, in samples per second, not {self.rate:g}")

    def of_table(self, names: Iterable[str]) -> Columns:
        """Return the columns with those of a table that already have documented names."""
        assigned = set(self.names.values())
        return Columns({name: name for name in names if is_ours(name) and name not in assigned}).with_changes(self)

    @classmethod
    def from_toml(cls, path: Path) -> Columns:
        """Read columns from a user's file.

        Raises:
            SettingsError: the file is missing or holds something else.
        """
        try:
            text = read_text(path)
        except (OSError, UnicodeDecodeError) as error:
            raise SettingsError(f"the columns {str(path)!r} cannot be read: {error}") from error
        return cls.from_text(text, f"the columns {str(path)!r}")

    @classmethod
    def from_text(cls, text: str, what: str) -> Columns:
        """Read columns from TOML.

        Args:
            what: word for the text in messages.

        Raises:
            SettingsError: it holds something else.
        """
        try:
            table = toml_table(text)
        except ValueError as error:
            raise SettingsError(f"{what} cannot be read: {error}") from error
        units, rate = table.pop("units", {}), table.pop("rate", None)
        names = dict(leaves("", table))
        for name, theirs in names.items():
            if not is_ours(name):
                raise SettingsError(
                    f"{what}: {name!r} is not a documented column; {did_you_mean(name, (TIME, *_SENSED))}those are {TIME}, "
                    f"{', '.join(_SENSED)}, {', '.join(f'{kind}.JOINT' for kind in JOINT_KINDS)}"
                )
            if not isinstance(theirs, str):
                raise SettingsError(f'{what}: {theirs!r} is not a column\'s name; write it as {_key(name)} = "..."')
        for kind, unit in cast("dict[str, Any]", units).items() if isinstance(units, dict) else [("units", units)]:
            allowed = UNITS.get(kind)
            if allowed is None:
                raise SettingsError(f"{what}: units are of {', '.join(UNITS)}, not of {kind!r}")
            if not isinstance(unit, str) or unit not in allowed:
                raise SettingsError(f"{what}: {unit!r} is not a unit of {kind}; those are {', '.join(allowed)}")
        if not isinstance(rate, (int, float, type(None))):
            raise SettingsError(f"{what}: {rate!r} is not a rate; write it as rate = 500, in samples per second")
        return cls(cast("dict[str, str]", names), cast("dict[str, str]", units), rate)

    def with_changes(self, changes: Columns) -> Columns:
        """Return the columns with other names and units; a name whose column is reassigned has none."""
        names = {**self.names, **dict.fromkeys(self.losers(changes), ""), **changes.names}
        return Columns(names, {**self.units, **changes.units}, changes.rate or self.rate)

    def losers(self, changes: Columns) -> list[str]:
        """Return the documented names whose columns the changes assign to others."""
        given = {theirs for theirs in changes.names.values() if theirs}
        return [ours for ours, theirs in self.names.items() if theirs in given and ours not in changes.names]

    def check(self, names: Sequence[str], what: str) -> None:
        """Raise SettingsError for names that a table lacks, and for one that has two documented names."""
        assigned = {ours: theirs for ours, theirs in self.names.items() if theirs}
        for ours, theirs in assigned.items():
            if theirs not in names:
                raise SettingsError(
                    f"--columns maps {ours} to {theirs!r}, which {what} does not have; {did_you_mean(theirs, names)}it has "
                    f"{', '.join(names)}"
                )
        by_theirs: dict[str, str] = {}
        for ours, theirs in assigned.items():
            if theirs in by_theirs:
                raise SettingsError(f"--columns assigns {theirs!r} to {by_theirs[theirs]} and to {ours}: keep one")
            by_theirs[theirs] = ours

    def factor(self, kind: str) -> float:
        """Return the factor from a kind's numbers to the documented unit."""
        return UNITS[kind][self.units[kind]] if kind in self.units else 1.0

    def has(self, names: Iterable[str]) -> bool:
        """Return whether the table has columns for all of some documented names."""
        return all(map(self.names.get, names))

    def has_pose(self) -> bool:
        """Return whether the base's position is in place of an accelerometer."""
        return self.has(BASE_POSITION) and not self.has(ACCELEROMETER)

    def joints(self, kind: str) -> list[str]:
        """Return the names of the joints that have a column of a kind."""
        return [
            ours.removeprefix(f"{kind}.") for ours, name in self.names.items() if name and ours.startswith(f"{kind}.")
        ]

    def missing(self, standing: bool = False) -> tuple[str, ...]:
        """Return the columns that an estimate needs and the table lacks.

        Args:
            standing: True for the log of a standing robot, which needs joint positions and torques.
        """
        if standing:
            return tuple(f"{kind}.JOINT" for kind in ("position", "torque") if not self.joints(kind))
        if self.has_pose():
            needed: tuple[str, ...] = () if self.has(ANGLES) else QUATERNION
        else:
            needed = (*ACCELEROMETER, *(() if any(map(self.has, (GYROSCOPE, QUATERNION, ANGLES))) else GYROSCOPE))
        absent = [name for name in (*([] if self.rate else [TIME]), *needed) if not self.names.get(name)]
        return (*absent, *([] if self.joints("position") else ["position.JOINT"]))

    def to_toml(self, notes: Mapping[str, str] | None = None) -> str:
        """Return TOML as `from_toml` reads it, to which lines may be added; columns with documented names are left out.

        Args:
            notes: remarks by kind, written above its columns.
        """
        notes = notes or {}
        lines = [f"rate = {self.rate}"] if self.rate else list[str]()
        for kind in UNITS:
            lines += [f"# {kind}: {notes[kind]}"] if kind in notes else []
            of_kind = {ours: theirs for ours, theirs in self.names.items() if ours.split(".")[0] == kind}
            lines += [f"{_key(ours)} = {_quoted(theirs)}" for ours, theirs in of_kind.items() if ours != theirs]
        lines += [f"units.{kind} = {_quoted(unit)}" for kind, unit in self.units.items()]
        return "\n".join(lines) + "\n"


def is_ours(name: str) -> bool:
    """Return whether a name is one that docs/logs.md lists."""
    kind, _, of = name.partition(".")
    return name == TIME or name in _SENSED or (kind in JOINT_KINDS and bool(of))


def unit_of_steps(time: FloatArray) -> str:
    """Return the unit in which consecutive times are less than half a second apart."""
    steps = np.abs(np.diff(time[np.isfinite(time)]))
    step = float(np.median(steps)) if len(steps) else 0.0
    return next((unit for unit, least in _STEPS.items() if step > least), "s")


def leaves(name: str, value: object) -> Iterator[tuple[str, Any]]:
    """Yield the values nested in tables and lists, by the names of their paths."""
    if isinstance(value, Mapping):
        for key, part in cast("Mapping[str, Any]", value).items():
            yield from leaves(f"{name}.{key}".removeprefix("."), part)
    elif isinstance(value, list):
        for index, part in enumerate(cast("list[Any]", value)):
            yield from leaves(f"{name}[{index}]", part)
    else:
        yield name, value


def _key(ours: str) -> str:
    kind, dot, of = ours.partition(".")
    return f"{kind}{dot}{of if re.fullmatch('[A-Za-z0-9_-]*', of) else _quoted(of)}"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
