"""Which column of a strange table is probably which: by name where names tell, by content where they do not.

Names propose, and what is in the columns confirms and gives the unit. What is found is a proposal, for people to look through.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.logs.joint_names import map_joints
from equipoise.logs.tables.by_content import (
    carries,
    joint_order,
    quaternion_order,
    unit_of_angles,
    unit_of_attitude,
    unit_of_derivative,
    unit_of_gravity,
    unit_of_time,
    unit_of_turning,
)
from equipoise.logs.tables.by_name import families, named
from equipoise.logs.tables.columns import (
    ACCELEROMETER,
    ANGLES,
    FOOT_FORCES,
    GYROSCOPE,
    QUATERNION,
    TIME,
    UNITS,
    Columns,
)
from equipoise.logs.tables.files import TableFile
from equipoise.robot.model import LEG_NAMES, RobotModel

_STEADY = 0.1  # by which a norm may spread, relative, for its columns to be an accelerometer without being called so
_WIDTH = 76  # of remarks
_MOST = 60_000  # samples that are looked at: minutes


@dataclass(frozen=True)
class Proposal:
    """What a table's columns probably are.

    Attributes:
        columns: the columns.
        notes: reasons by kind of column.
        others: names of the columns that are not used, and what else is in the file.
    """

    columns: Columns
    notes: Mapping[str, str]
    others: tuple[str, ...]

    def to_toml(self) -> str:
        """TOML for --columns, the reasons as remarks."""
        said = "".join(c if c.isprintable() else "?" for c in f"not used: {', '.join(self.others)}")
        others = "".join(f"\n# {line}" for line in textwrap.wrap(said, _WIDTH))
        return self.columns.to_toml(self.notes) + (f"{others}\n" if self.others else "")


def propose(robot: RobotModel, file: TableFile, known: Columns) -> Proposal:
    """What the columns of a file probably are.

    Args:
        known: columns that are known already.
    """
    guess = _Guess(robot, file, known)
    guess.time()
    guess.orientation()  # three of a quaternion's four may have the norm of gravity in g
    guess.accelerometer()
    guess.unit_of_orientation()
    guess.positions()
    guess.others_of_joints()
    guess.gyroscope()
    guess.foot_forces()
    guess.leave_out_what_is_not_read()
    return guess.proposal()


class _Guess:
    """Kind after kind is found among the columns that are left."""

    def __init__(self, robot: RobotModel, file: TableFile, known: Columns) -> None:
        self.robot, self.file = robot, file
        known = _whole_sensors(known)
        self.names, self.units, self.notes = dict(known.names), dict(known.units), dict[str, str]()
        self._numbers = dict(_numbers(file))
        free = [name for name in self._numbers if name not in known.names.values()]
        self._families = families(free)
        self._free = {name: self._numbers[name] for name in free}
        self._joint_order: tuple[str, ...] = ()

    def proposal(self) -> Proposal:
        used = set(self.names.values())
        others = (*_unused(self.file.names, used), *self.file.passed_over)
        return Proposal(Columns(self.names, self.units), self.notes, others)

    # --- one column

    def time(self) -> None:
        """By name if it increases evenly; else the first column that does."""
        if TIME in self.names:
            ours = self.names[TIME]
            unit = unit_of_time(self.file.clock(ours)[:_MOST]) if ours in self._numbers else None
            if unit not in (None, "s") and "time" not in self.units:
                self._take("time", {TIME: ours}, unit, "increases evenly")
            return
        said = [name for family in self._families.get("time", []) for name in family.values()]
        for name in [*said, *(name for name in self._free if name not in said)]:
            time = self.file.clock(name)[:_MOST]
            if name not in said and (np.diff(time) == 1).all():
                continue  # counts rows
            unit = unit_of_time(time)
            if unit is not None:
                self._take("time", {TIME: name}, unit, "increases evenly")
                return

    # --- the IMU

    def accelerometer(self) -> None:
        """Three whose norm is that of gravity: those that are called so, else those in which it spreads least."""
        if any(name in self.names for name in ACCELEROMETER):
            return
        named = [(three, unit_of_gravity(self._table(three))) for three in self._threes("accelerometer")]
        others = [(three, unit_of_gravity(self._table(three))) for three in self._windows(3)]
        others = [(three, found) for three, found in others if found is not None and found[1] < _STEADY]
        others.sort(key=lambda one: one[1][1])
        for three, found in [*named, *others]:
            if found is not None:
                ours = dict(zip(ACCELEROMETER, three, strict=True))
                self._take("accelerometer", ours, found[0], "its norm is that of gravity")
                return

    def orientation(self) -> None:
        """Four whose norm is one, or roll, pitch and yaw by name."""
        if any(name in self.names for name in (*QUATERNION, *ANGLES)):
            return
        for family in self._families.get("orientation", []):
            if set("wxyz") <= set(family):
                ours = {f"orientation.{part}": family[part] for part in "wxyz"}
                if quaternion_order(self._table(list(ours.values()))) is not None:
                    self._take("orientation", ours, None, "by name; its norm is one")
                    return
            if {"roll", "pitch", "yaw"} <= set(family):
                ours = {f"orientation.{part}": family[part] for part in ("roll", "pitch", "yaw")}
                self._take("orientation", ours, None, "by name alone: is it in rad?")
                return
        for four in self._windows(4):
            order = quaternion_order(self._table(four))
            if order is not None:
                ours = {f"orientation.{part}": name for part, name in zip(order, four, strict=True)}
                ours = {name: ours[name] for name in QUATERNION}
                self._take("orientation", ours, None, f"its norm is one; that w is the {_place(order)}, is a guess")
                return

    def unit_of_orientation(self) -> None:
        """The unit of roll, pitch and yaw by which up is the accelerometer's, if they were found."""
        angles, acceleration = self._known_table(ANGLES), self._known_table(ACCELEROMETER)
        if angles is None or acceleration is None or "orientation" not in self.notes:
            return
        unit = unit_of_attitude(angles, acceleration)
        if unit is not None:
            ours = {name: self.names[name] for name in ANGLES}
            self._take("orientation", ours, unit, "by name; its up is the accelerometer's")

    def gyroscope(self) -> None:
        """Three by which the accelerometer's idea of up turns, called so or not."""
        if any(name in self.names for name in GYROSCOPE):
            return
        time, acceleration, named = self._known_time(), self._known_table(ACCELEROMETER), self._threes("gyro")
        if time is not None and acceleration is not None:
            threes = named or [*self._windows(3)]
            found = [(unit_of_turning(time, acceleration, self._table(three)), three) for three in threes]
            fitting = [(of[1], of[0], three) for of, three in found if of is not None]
            if fitting:
                _, unit, three = max(fitting)
                self._take("gyro", dict(zip(GYROSCOPE, three, strict=True)), unit, "up turns as it says")
                return
        if named:
            self._take("gyro", dict(zip(GYROSCOPE, named[0], strict=True)), None, "by name alone: is it in rad/s?")

    def foot_forces(self) -> None:
        """By name, where there is one of each leg."""
        for family in self._families.get("foot_force", []):
            if set(LEG_NAMES) <= set(family) and not any(name in self.names for name in FOOT_FORCES):
                ours = dict(zip(FOOT_FORCES, (family[leg] for leg in LEG_NAMES), strict=True))
                self._take("foot_force", ours, None, "by name alone")

    def leave_out_what_is_not_read(self) -> None:
        """An orientation beside a gyroscope."""
        if all(map(self.names.get, GYROSCOPE)):
            self.names = {ours: name for ours, name in self.names.items() if not ours.startswith("orientation.")}
            self.units.pop("orientation", None)
            self.notes.pop("orientation", None)

    def _threes(self, kind: str) -> list[list[str]]:
        """Columns of an axis each whose names are a sensor's."""
        threes = [[family[part] for part in _parts(family, "xyz")] for family in self._families.get(kind, [])]
        return [three for three in threes if len(three) == 3]

    # --- joints

    def positions(self) -> None:
        """By the joints' names, or in an order that limits and floor speak for."""
        if any(name.startswith("position.") for name in self.names):
            return
        for family in self._families.get("position", []):
            joints = self._by_joint_names(family)
            if joints is not None:
                unit = unit_of_angles(self.robot, self._table(list(joints.values())))
                if unit is not None:
                    self._take("position", _ours("position", joints), unit, "by name, and within the joints' limits")
                    return
        time, acceleration = self._known_time(), self._known_table(ACCELEROMETER)
        by_content = self._windows(len(self.robot.joint_names))
        for windows, called in ((self._numbered("position"), True), (by_content, False)):
            orders = [
                (joint_order(self.robot, time, self._table(columns), acceleration), columns) for columns in windows
            ]
            fitting = [(order, columns) for order, columns in orders if order is not None and (called or order.level)]
            if fitting:
                order, columns = min(fitting, key=lambda one: one[0].off)
                self._joint_order = order.joints
                sure = "as limits and floor say" if order.sure else "a guess: compare the legs, joint by joint"
                joints = dict(zip(order.joints, columns, strict=True))
                why = f"within the joints' limits; {order.words}, {sure}"
                self._take("position", _ours("position", joints), order.unit, why)
                return

    def others_of_joints(self) -> None:
        """Velocities, torques and commands, by name or by what they must be of the positions."""
        names = [f"position.{joint}" for joint in self.robot.joint_names]
        position, time = self._known_table(names), self._known_time()
        if position is None or time is None:
            return
        position = position * UNITS["position"][self.units.get("position", "rad")]

        def of_velocity(table: FloatArray) -> str | None:
            return unit_of_derivative(time, position, table)

        def of_torque(table: FloatArray) -> str | None:
            return "Nm" if carries(self.robot, position, table) else None

        def of_command(table: FloatArray) -> str | None:
            return unit_of_angles(self.robot, table)

        self._of_joints("velocity", of_velocity, "the derivatives of the positions")
        self._of_joints("torque", of_torque, "they carry the robot")
        self._of_joints("command", of_command, "within the joints' limits", only_by_name=True)

    def _of_joints(
        self, kind: str, unit_of: Callable[[FloatArray], str | None], why: str, only_by_name: bool = False
    ) -> None:
        if any(name.startswith(f"{kind}.") for name in self.names):
            return
        order = self._joint_order or self.robot.joint_names
        by_joints = filter(None, map(self._by_joint_names, self._families.get(kind, [])))
        named = [*by_joints, *(dict(zip(order, columns, strict=True)) for columns in self._numbered(kind))]
        others = (
            self._by_their_legs(columns) or dict(zip(order, columns, strict=True))
            for columns in self._windows(len(order))
        )
        for joints in itertools.chain(named, [] if only_by_name else others):
            unit = unit_of(self._table([joints[joint] for joint in self.robot.joint_names]))
            if unit is not None:
                self._take(kind, _ours(kind, joints), unit, why)
                return
        if named:
            self._take(kind, _ours(kind, named[0]), None, f"by name alone: is it in {next(iter(UNITS[kind]))}?")

    def _by_their_legs(self, columns: Sequence[str]) -> dict[str, str] | None:
        """Columns of nobody knows what by the robot's joints, if their names say which is which."""
        said = [what for what in map(named, columns) if what is not None and what.joint]
        if len(said) < len(columns):
            return None
        return self._by_joint_names({what.part: name for what, name in zip(said, columns, strict=True)})

    def _by_joint_names(self, family: Mapping[str, str]) -> dict[str, str] | None:
        """Columns by the robot's joints, if a family's names say which is which."""
        parts = list(family)
        try:
            matches = map_joints(self.robot, parts).matches
        except RecordingError:
            return None
        return {match.robot_joint: family[parts[match.column]] for match in matches}

    def _numbered(self, kind: str) -> Iterator[list[str]]:
        """As many columns as there are joints whose names are a quantity's and numbers."""
        count = len(self.robot.joint_names)
        for family in self._families.get(kind, []):
            numbers = sorted((part for part in family if part.isdigit()), key=int)
            if len(numbers) >= count:
                yield [family[part] for part in numbers[:count]]

    # --- what is left

    def _windows(self, size: int) -> Iterator[list[str]]:
        """Free columns that stand side by side in the file."""
        places = {name: place for place, name in enumerate(self.file.names)}
        free = list(self._free)
        for first in range(len(free) - size + 1):
            names = free[first : first + size]
            if places[names[-1]] - places[names[0]] == size - 1:
                yield names

    def _take(self, kind: str, names: Mapping[str, str], unit: str | None, why: str) -> None:
        self.names |= names
        self.notes[kind] = why
        if unit is not None:
            self.units.pop(kind, None)
            if unit != next(iter(UNITS[kind])):
                self.units[kind] = unit
        for name in names.values():
            self._free.pop(name, None)
        taken = set(names.values())
        self._families = {
            of: [family for family in those if not taken & set(family.values())] for of, those in self._families.items()
        }

    def _table(self, names: Sequence[str]) -> FloatArray:
        return np.column_stack([self._numbers[name] for name in names])

    def _known_table(self, ours: Sequence[str]) -> FloatArray | None:
        found = [self.names.get(name) for name in ours]
        present = [name for name in found if name is not None and name in self._numbers]
        return self._table(present) if len(present) == len(ours) else None

    def _known_time(self) -> FloatArray | None:
        name = self.names.get(TIME)
        if name is None or name not in self._numbers:
            return None
        return self.file.clock(name)[:_MOST] * UNITS["time"][self.units.get("time", "s")]


def _whole_sensors(known: Columns) -> Columns:
    """Without our names for some of a sensor's axes: the others belong to them."""
    halves = [sensor for sensor in (GYROSCOPE, ACCELEROMETER, QUATERNION, ANGLES) if not known.has(sensor)]
    names = {
        name: theirs
        for name, theirs in known.names.items()
        if name != theirs or not any(name in half for half in halves)
    }
    return Columns(names, known.units)


def _numbers(file: TableFile) -> Iterator[tuple[str, FloatArray]]:
    """Columns of numbers by name."""
    for name in file.names:
        if file.names.count(name) > 1:
            continue
        try:
            values = file.column(name)[:_MOST]
        except RecordingError:
            continue
        if np.isfinite(values).any():
            yield name, values


def _unused(names: Sequence[str], used: Collection[str]) -> Iterator[str]:
    """Columns that are not used; an array of which none is, as its first to its last."""
    for _, of in itertools.groupby(names, lambda name: name.rpartition("[")[0] if name.endswith("]") else name):
        array = list(of)
        free = [name for name in array if name not in used]
        yield from [f"{free[0]} to {free[-1]}"] if free == array and len(free) > 1 else free


def _parts(family: Mapping[str, str], parts: str) -> list[str]:
    """A family's keys for some axes: by letter, or by number."""
    if set(parts) <= set(family):
        return list(parts)
    return [str(k) for k in range(len(parts)) if str(k) in family]


def _ours(kind: str, joints: Mapping[str, str]) -> dict[str, str]:
    return {f"{kind}.{joint}": name for joint, name in joints.items()}


def _place(order: str) -> str:
    return "first" if order.startswith("w") else "last"
