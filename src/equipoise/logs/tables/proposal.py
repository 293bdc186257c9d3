"""Propose which column of a table is which, from the words in the columns' names. The user confirms the proposal."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Collection, Iterator, Sequence

from equipoise.errors import RecordingError
from equipoise.logs.joint_names import map_joints
from equipoise.logs.tables.by_name import Families, families
from equipoise.logs.tables.column_names import (
    ACCELEROMETER,
    ANGLES,
    FOOT_FORCES,
    GYROSCOPE,
    JOINT_KINDS,
    QUATERNION,
    TIME,
    UNITS,
    Columns,
    unit_of_steps,
)
from equipoise.logs.tables.files import TableFile
from equipoise.robot.model import RobotModel

_WIDTH = 76  # of remarks
_FLOATING_BASE = {"position": 7, "velocity": 6}  # columns of the base before those of the joints


def propose(robot: RobotModel, file: TableFile, known: Columns) -> tuple[tuple[str, ...], str]:
    """Return the columns that no name suggests, and TOML for --columns: the others, remarks, and lines to complete.

    Args:
        known: columns that are known already.
    """
    known = _without_incomplete_sensors(known)
    taken = known.names.values()
    by_kind = families(name for name in file.names if name not in taken and file.names.count(name) == 1)
    names, units, notes = dict(known.names), dict(known.units), dict[str, str]()
    for kind, of_kind in by_kind.items():
        if any(name.split(".")[0] == kind for name in names):
            continue
        found, how = _joints(robot, kind, of_kind) if kind in JOINT_KINDS else (_sensor(kind, of_kind), "by name")
        if found:
            names |= found
            unit = units.get(kind, next(iter(UNITS[kind])))
            notes[kind] = how if kind == "foot_force" else f"{how}; is the unit {unit}?"
    if all(map(names.get, GYROSCOPE)):  # then an orientation is not read
        names = {ours: name for ours, name in names.items() if not ours.startswith("orientation.")}
        notes.pop("orientation", None)
    if names.get(TIME) and TIME not in units:
        unit = unit_of_steps(file.clock(names[TIME]))
        if TIME in notes or unit != "s":
            notes[TIME] = f"by name; consecutive samples are less than half a second apart in {unit}"
        units |= {TIME: unit} if unit != "s" else {}
    proposed = Columns(names, units)
    missing = [name for name in proposed.missing() if name != "position.JOINT"]
    if missing != list(proposed.missing()):
        missing += [f"position.{joint}" for joint in robot.joint_names]
    lines = "".join(f'# missing: {name} = "..."\n' for name in missing)
    return proposed.missing(), proposed.to_toml(notes).lstrip() + lines + _unused_columns(file, set(names.values()))


def _unused_columns(file: TableFile, used: Collection[str]) -> str:
    """Return remarks that name what a file holds besides."""
    others = ", ".join([*_unused(file.names, used), *file.passed_over])
    listed = "".join(c if c.isprintable() else "?" for c in f"not used: {others}")
    return "".join(f"\n# {line}" for line in textwrap.wrap(listed, _WIDTH)) + "\n" if others else ""


def _sensor(kind: str, of_kind: Families) -> dict[str, str]:
    """Return the first family with a column for every part of a sensor, by our names."""
    for family, sensor in itertools.product(of_kind, _SENSORS.get(kind, ())):
        parts = [name.partition(".")[2] for name in sensor]
        numbered = [str(index) for index in range(len(parts))]
        for keys in (parts, numbered) if sensor in (GYROSCOPE, ACCELEROMETER) else (parts,):
            if set(keys) <= set(family):
                return {ours: family[key] for ours, key in zip(sensor, keys, strict=True)}
    return {}


def _joints(robot: RobotModel, kind: str, of_kind: Families) -> tuple[dict[str, str], str]:
    """Return the first family with a column for every joint, by our names, and the reason."""
    for family in of_kind:
        try:
            matches = map_joints(robot, list(family)).matches
        except RecordingError:
            continue
        return {f"{kind}.{match.robot_joint}": family[match.log_joint] for match in matches}, "by name"
    count = len(robot.joint_names)
    for family in of_kind:
        numbers = sorted((part for part in family if part.isdigit()), key=int)
        base = _FLOATING_BASE.get(kind, 0)
        first = base if len(numbers) == base + count else 0
        if len(numbers) >= count:
            columns = [family[part] for part in numbers[first : first + count]]
            named = {f"{kind}.{joint}": column for joint, column in zip(robot.joint_names, columns, strict=True)}
            return named, "numbered columns, in the order of the model's joints: compare joint by joint"
    return {}, ""


def _without_incomplete_sensors(known: Columns) -> Columns:
    """Return columns without those that have our name for some axes of a sensor: the other axes belong to them."""
    incomplete = [sensor for sensors in _SENSORS.values() for sensor in sensors if not known.has(sensor)]
    names = {
        name: theirs
        for name, theirs in known.names.items()
        if name != theirs or not any(name in sensor for sensor in incomplete)
    }
    return Columns(names, known.units)


def _unused(names: Sequence[str], used: Collection[str]) -> Iterator[str]:
    """Yield columns that are not used; an unused array as its first to its last."""
    for _, of in itertools.groupby(names, lambda name: name.rpartition("[")[0] if name.endswith("]") else name):
        array = list(of)
        free = [name for name in array if name not in used]
        yield from [f"{free[0]} to {free[-1]}"] if free == array and len(free) > 1 else free


_SENSORS = {
    "time": ((TIME,),),
    "gyro": (GYROSCOPE,),
    "accelerometer": (ACCELEROMETER,),
    "orientation": (QUATERNION, ANGLES),
    "foot_force": (FOOT_FORCES,),
}
