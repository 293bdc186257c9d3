"""Propose which column of a table is which, from the words in the columns' names. The user confirms the proposal."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.motors import MOTOR_LEGS, MOTORS
from equipoise.errors import RecordingError
from equipoise.logs.joint_names import map_by_order, map_joints
from equipoise.logs.tables.by_name import FORMULA, Families, families, in_unitrees_order, named, source_of
from equipoise.logs.tables.column_names import (
    ACCELEROMETER,
    BASE_POSITION,
    GYROSCOPE,
    JOINT_KINDS,
    SENSORS,
    TIME,
    UNITS,
    Columns,
    unit_of_steps,
)
from equipoise.logs.tables.files import TableFile
from equipoise.robot.model import RobotModel

ByKind = dict[str, Families]

_WIDTH = 76  # of remarks
_STEADY = 0.7  # of accelerometers of robots that trot 0.95, of their gyroscopes 0.1
_UPRIGHT = 0.15  # of a quaternion's x and y: a lean of 17 degrees
_FLOATING_BASE = {"position": 7, "command": 7, "velocity": 6, "torque": 6}  # columns of the base before the joints'


def propose(robot: RobotModel, file: TableFile, known: Columns, standing: bool = False) -> tuple[tuple[str, ...], str]:
    """Return the columns without a suggestion, and TOML for --columns: suggestions, comments, and lines to complete.

    Args:
        known: columns that are already mapped.
        standing: True for the log of a standing robot; see `Columns.missing`.

    Raises:
        RecordingError: names contradict each other.
    """
    known = _without_incomplete_sensors(known)
    by_kind = _by_kind(file, known.names.values())
    names, units, notes = dict(known.names), dict(known.units), dict[str, str]()
    for kind in UNITS:
        if any(name.split(".")[0] == kind for name in names) or (kind == TIME and known.rate):
            continue
        found, how = _found(robot, file, kind, by_kind)
        if found:
            names |= found
            notes[kind] = how if kind == "foot_force" else f"{how}; {_with_unit(kind, found, units)}"
    if all(map(names.get, ACCELEROMETER)):
        unread = {"base_position", *(("orientation",) if all(map(names.get, GYROSCOPE)) else ())}
        names = {ours: name for ours, name in names.items() if ours in known.names or ours.split(".")[0] not in unread}
        notes = {kind: note for kind, note in notes.items() if kind not in unread}
    else:
        for kind, (found, how) in _of_free_flyer(robot, file, by_kind).items():
            if not any(name.startswith(f"{kind}.") for name in names):
                names |= found
                notes[kind] = how
    if names.get(TIME) and TIME not in units and "the unit is" not in notes.get(TIME, ""):
        unit = unit_of_steps(file.clock(names[TIME]))
        if TIME in notes or unit != "s":
            notes[TIME] = f"by name; consecutive samples are less than half a second apart in {unit}"
        units |= {TIME: unit} if unit != "s" else {}
    proposed = Columns(names, units, known.rate)
    missing = proposed.missing(standing)
    lines = _lines_to_complete(robot, missing) + _unused_columns(file, set(names.values()))
    return missing, proposed.to_toml(notes).lstrip() + lines


def _of_free_flyer(robot: RobotModel, file: TableFile, by_kind: ByKind) -> dict[str, tuple[dict[str, str], str]]:
    """Return the base's pose and angular velocity among numbered columns of the base and all joints, and the reasons."""
    found: dict[str, tuple[dict[str, str], str]] = {}
    if columns := _of_base(robot, "position", by_kind):
        how = "the base's position before the joints, as of Pinocchio's and MuJoCo's free joints; is the unit m?"
        found["base_position"] = dict(zip(BASE_POSITION, columns[:3], strict=True)), how
        first = _w_is_first(file, columns[3:])
        how = f"the base's quaternion, {'w first, as MuJoCo' if first else 'w last, as Pinocchio'}, by its numbers"
        parts = [f"orientation.{part}" for part in ("wxyz" if first else "xyzw")]
        found["orientation"] = dict(zip(parts, columns[3:], strict=True)), how
    columns = _of_base(robot, "velocity", by_kind)
    if columns and np.allclose(robot.imu_in_base.rotation, np.eye(3)):
        how = "the base's angular velocity before the joints': is it in the base's axes, by the gyroscope, in rad/s?"
        found["gyro"] = dict(zip(GYROSCOPE, columns[3:], strict=True)), how
    return found


def _of_base(robot: RobotModel, kind: str, by_kind: ByKind) -> list[str]:
    """Return the columns of the base in the first family that has some of a floating base before those of all joints."""
    for family in by_kind.get(kind, {}).values():
        columns = _numbered(family)
        if len(columns) == _FLOATING_BASE[kind] + len(robot.joint_names):
            return columns[: _FLOATING_BASE[kind]]
    return []


def _w_is_first(file: TableFile, columns: Sequence[str]) -> bool:
    """Return whether four columns hold w x y z, not x y z w: x and y of a robot that is upright are small."""
    first, _, third, _ = (float(np.nanmedian(np.abs(file.column(name)))) for name in columns)
    return first > max(third, _UPRIGHT)


def _with_unit(kind: str, found: Mapping[str, str], units: dict[str, str]) -> str:
    """Add the unit that names of columns state to the units, if it is not ours; return a remark."""
    usual = next(iter(UNITS[kind]))
    unit = units.get(kind) or _stated_unit(kind, found)
    units |= {kind: unit} if unit and unit != usual else {}
    return f"the unit is {unit}" if unit else f"is the unit {usual}?"


def _lines_to_complete(robot: RobotModel, missing: Sequence[str]) -> str:
    """Return remarks in which the user fills in the missing columns."""
    parts = [name.partition("JOINT") for name in missing]
    names = [f"{kind}{joint}" for kind, any_joint, _ in parts for joint in (robot.joint_names if any_joint else [""])]
    rate = "# or, without a time: rate = 500, in samples a second\n" if TIME in missing else ""
    return "".join(f'# missing: {name} = "..."\n' for name in names) + rate


def _found(robot: RobotModel, file: TableFile, kind: str, by_kind: ByKind) -> tuple[dict[str, str], str]:
    """Return the columns of a kind by our names, and the reason."""
    of_kind = by_kind.get(kind, {})
    if kind in JOINT_KINDS:
        found = _named_joints(robot, kind, of_kind.values())
        return (found, "by name") if found else _numbered_joints(robot, file, kind, by_kind)
    found = _sensor(kind, of_kind)
    if found or kind not in ("gyro", "accelerometer"):
        return found, "by name"
    for family in by_kind.get("imu", {}).values():
        if len(columns := _numbered(family)) == 6:
            return _of_six(file, kind, columns)
    return {}, ""


def _of_six(file: TableFile, kind: str, columns: Sequence[str]) -> tuple[dict[str, str], str]:
    """Return the gyroscope's or the accelerometer's of an IMU's six columns, and the reason for their order."""
    first, last = (np.column_stack([file.column(name) for name in three]) for three in (columns[:3], columns[3:]))
    swapped = is_exchanged(first, last)
    place = slice(3) if swapped == (kind == "accelerometer") else slice(3, 6)
    ours = GYROSCOPE if kind == "gyro" else ACCELEROMETER
    how = f"an IMU's six columns, the {'accelerometer' if swapped else 'gyroscope'}'s first: gravity is in the accelerometer's"
    return dict(zip(ours, columns[place], strict=True)), how


def is_exchanged(gyroscope: FloatArray, acceleration: FloatArray) -> bool:
    """Return whether (n, 3) columns of a gyroscope keep their direction as gravity does, better than an accelerometer's."""
    return _steadiness(gyroscope) > max(_STEADY, _steadiness(acceleration))


def _steadiness(vectors: FloatArray) -> float:
    """Return the length of the mean vector over the mean length: one of vectors that are the same."""
    known = vectors[np.isfinite(vectors).all(axis=1)]
    length = float(np.linalg.norm(known, axis=1).sum())
    return float(np.linalg.norm(known.sum(axis=0))) / length if length else 0.0


def _stated_unit(kind: str, found: Mapping[str, str]) -> str | None:
    """Return the unit that the names of columns state, or None."""
    stated = {what.unit for name in found.values() if (what := named(name)) and what.unit}
    if len(stated) > 1:
        raise RecordingError(
            f"the names of the {kind} columns state {' and '.join(sorted(stated))}: they must have one unit; convert some, or "
            "name other columns in --columns"
        )
    return stated.pop() if stated else None


def _unused_columns(file: TableFile, used: Collection[str]) -> str:
    """Return comments that name the columns of a file that are not used."""
    parts = {part for name in used for part in (name, *FORMULA.split(name))}
    others = ", ".join([*_unused(file.names, parts), *file.passed_over])
    listed = "".join(c if c.isprintable() else "?" for c in f"not used: {others}")
    return "".join(f"\n# {line}" for line in textwrap.wrap(listed, _WIDTH)) + "\n" if others else ""


def _sensor(kind: str, of_kind: Families) -> dict[str, str]:
    """Return the first family with a column for every part of a sensor, by documented names."""
    for family, sensor in itertools.product(of_kind.values(), SENSORS[kind]):
        by_part = {name: column for name in sensor if (column := family.get(name.partition(".")[2]))}
        if len(by_part) == len(sensor):
            return by_part
        numbered = _numbered(family)[:4] if sensor in (GYROSCOPE, ACCELEROMETER, BASE_POSITION) else []
        if len(numbered) == len(sensor):
            return dict(zip(sensor, numbered, strict=True))
    return {}


def _numbered(family: Mapping[str, str]) -> list[str]:
    """Return the columns of a family whose parts are numbers, in order."""
    return [family[part] for part in sorted((part for part in family if part.isdigit()), key=int)]


def _named_joints(robot: RobotModel, kind: str, of_kind: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the first family that names every joint, by documented names."""
    for family in of_kind:
        try:
            matches = map_joints(robot, list(family)).matches
        except RecordingError:
            continue
        return {f"{kind}.{match.robot_joint}": family[match.log_joint] for match in matches}
    return {}


def _numbered_joints(robot: RobotModel, file: TableFile, kind: str, by_kind: ByKind) -> tuple[dict[str, str], str]:
    """Return the first family with a numbered column for every joint, by documented names, and the reason."""
    count = len(robot.joint_names)
    for words, family in by_kind.get(kind, {}).items():
        if in_cells := _joints_in_cells(robot, file, kind, words, by_kind):
            return in_cells, "by the names in the log's cells"
        columns = _numbered(family)
        if in_unitrees_order(words) and MOTORS == count <= len(columns):
            matches = map_by_order(robot, MOTOR_LEGS, columns).matches
            how = f"motors of Unitree, legs in the order {' '.join(MOTOR_LEGS)}"
            return {f"{kind}.{match.robot_joint}": match.log_joint for match in matches}, how
        if len(columns) >= count:
            first = _FLOATING_BASE[kind] if len(columns) == _FLOATING_BASE[kind] + count else 0
            names = [f"{kind}.{joint}" for joint in robot.joint_names]
            how = "numbered columns, in the order of the model's joints: compare joint by joint"
            return dict(zip(names, columns[first : first + count], strict=True)), how
    return {}, ""


def check_names_in_cells(robot: RobotModel, file: TableFile, columns: Columns) -> None:
    """Raise RecordingError where the names in the log's cells assign a column to another joint than the user."""
    by_kind, ours_of = _by_kind(file, ()), {theirs: ours for ours, theirs in columns.names.items() if theirs}
    for kind, words in [(of, words) for of in JOINT_KINDS for words in by_kind.get(of, ())]:
        for in_cells, column in _joints_in_cells(robot, file, kind, words, by_kind).items():
            joints = [ours.partition(".")[2] for ours in (ours_of.get(column, in_cells), in_cells)]
            if joints[0] != joints[1] and set(joints) <= set(robot.joint_names):
                raise RecordingError(
                    f"--columns assigns {column!r} of {file.title} to {joints[0]}, and the names in the log's cells to "
                    f"{joints[1]}: correct the file for --columns, or leave these columns out of it"
                )


def _joints_in_cells(
    robot: RobotModel, file: TableFile, kind: str, words: tuple[str, ...], by_kind: ByKind
) -> dict[str, str]:
    """Return a family's numbered columns by the names in the log's cells, or by the model's names if these match.

    There may be columns of a floating base before the joints; if the names have another count, none are returned. Names from
    the same message come first.

    Args:
        words: words that the numbered columns share.

    Raises:
        RecordingError: a column of names holds several.
    """
    columns = _numbered(by_kind[kind][words])
    same = sorted(by_kind.get("name", {}).items(), key=lambda item: source_of(item[0]) != source_of(words))
    for _, family in same:
        labels = [label for column in _numbered(family) if (label := file.text(column))]
        base = len(columns) - len(labels)
        if labels and len(set(labels)) == len(labels) and base in (0, _FLOATING_BASE[kind]):
            found = dict(zip(labels, columns[base:], strict=True))
            return _named_joints(robot, kind, [found]) or {f"{kind}.{label}": found[label] for label in found}
    return {}


def _by_kind(file: TableFile, taken: Collection[str]) -> ByKind:
    """Return the families of a table's columns that are not taken and have a name of their own."""
    names = dict.fromkeys((*file.names, *file.texts))
    return families(name for name in names if name not in taken and file.names.count(name) <= 1)


def _without_incomplete_sensors(known: Columns) -> Columns:
    """Return columns without the documented names of incomplete sensors: the table's other axes belong to those."""
    sensors = itertools.chain.from_iterable(SENSORS.values())
    incomplete = set(itertools.chain.from_iterable(sensor for sensor in sensors if not known.has(sensor)))
    names = {ours: theirs for ours, theirs in known.names.items() if ours != theirs or ours not in incomplete}
    return replace(known, names=names)


def _unused(names: Sequence[str], used: Collection[str]) -> Iterator[str]:
    """Yield columns that are not used; an unused array as its first and last column."""
    for _, of in itertools.groupby(names, lambda name: name.rpartition("[")[0] if name.endswith("]") else name):
        array = list(of)
        free = [name for name in array if name not in used]
        yield from [f"{free[0]} to {free[-1]}"] if free == array and len(free) > 1 else free
