"""Map from the robot's joints to a log's: names differ between model files, drivers and firmware.

Tried in this order, leg by leg: the user's joint map; equal names; names that differ only in case, separators, a namespace
before them or "joint" after them; leg and place in it, by common words. A leg is matched as a whole: "hip" may be the
abduction or the joint after it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import RecordingError, SettingsError
from equipoise.robot.forward import leg_of, words_of
from equipoise.robot.legs import Leg
from equipoise.robot.model import RobotModel
from equipoise.user_file import read_text, toml_table

# Place in a leg of three joints, from the hip down: abduction, hip pitch, knee.
_PLACE_WORDS = {
    **dict.fromkeys(("abad", "abduct", "abduction", "abductor", "haa", "hx", "aa", "roll", "shoulder", "coxa"), 0),
    **dict.fromkeys(("thigh", "upper", "hfe", "hy", "fe", "pitch", "femur", "flexion"), 1),
    **dict.fromkeys(("calf", "knee", "kfe", "kn", "lower", "shank", "shin", "tibia"), 2),
}
_WEAK_WORDS = {"leg": 1, "foot": 2}  # a thigh and a shank in some models; in others part of any joint's name
# "hip" alone is the abduction or the hip pitch: the leg's other names decide.
_HIP, _HIP_AXES = "hip", {"x": 0, "y": 1, "z": None}
_LATER, _EITHER = 2, 1  # costs of a word that is not the name's first, and of one that may mean something else


@dataclass(frozen=True)
class JointMatch:
    """One joint of the robot and the log's column for it.

    Attributes:
        robot_joint, log_joint: names of the joint in the model and in the log.
        column: index of the log's joint.
        how: reason of the match: "given", "same name", "spelling" or "leg and place".
    """

    robot_joint: str
    log_joint: str
    column: int
    how: str


@dataclass(frozen=True)
class JointMap:
    """Matches of all joints of the robot, in its order, and the log's other joints.

    Attributes:
        matches: matches, one for each joint of the robot.
        ignored: names of the log's other joints.
    """

    matches: tuple[JointMatch, ...]
    ignored: tuple[str, ...] = ()

    @property
    def columns(self) -> NDArray[np.intp]:
        """(nj,) columns of the log in the robot's joint order."""
        return np.array([match.column for match in self.matches], dtype=np.intp)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        joints = {m.robot_joint: {"log": m.log_joint, "how": m.how} for m in self.matches}
        return {"joints": joints, "ignored": list(self.ignored)}


def map_joints(robot: RobotModel, log_joints: Sequence[str], given: Mapping[str, str | int] | None = None) -> JointMap:
    """Map each joint of the robot to a joint of the log.

    Args:
        log_joints: names in the order of the log's columns.
        given: the user's joint map: log's name or column by the robot's name.

    Raises:
        SettingsError: the user's map names a joint that does not exist.
        RecordingError: a joint of the robot has no counterpart, or several; the message lists the matches.
    """
    found = _given(robot, log_joints, given or {})
    problems: list[str] = []
    for how, match in (("same name", _same_name), ("spelling", _spelling), ("leg and place", _leg_and_place)):
        used = {m.column for m in found.values()}
        free = [column for column in range(len(log_joints)) if column not in used]
        problems = []
        for leg in robot.legs.values():
            joints = [joint for joint in leg.joint_names if joint not in found]
            columns = match(leg, joints, log_joints, free)
            if joints and all(len(those) == 1 for those in columns):
                for joint, (column,) in zip(joints, columns, strict=True):
                    found[joint] = JointMatch(joint, log_joints[column], column, how)
            elif joints and all(columns):
                problems += [_several(joint, those, log_joints) for joint, those in zip(joints, columns, strict=True)]
        if problems:
            break
    missing = [joint for joint in robot.joint_names if joint not in found]
    if missing:
        raise _unmapped(robot, log_joints, found, missing, problems)
    used = {match.column for match in found.values()}
    ignored = tuple(name for column, name in enumerate(log_joints) if column not in used)
    return JointMap(tuple(found[joint] for joint in robot.joint_names), ignored)


def map_by_order(robot: RobotModel, legs: Sequence[str], motors: Sequence[str]) -> JointMap:
    """Map the joints of a robot whose messages have no names but three motors a leg, from the hip down, leg after leg.

    Args:
        legs: names of the legs in the order of the messages.
        motors: names to call the columns by.

    Raises:
        RecordingError: a leg of the robot does not have three joints.
    """
    matches: dict[str, JointMatch] = {}
    for leg in legs:
        joints = robot.legs[leg].joint_names
        if len(joints) != 3:
            raise RecordingError(
                f"the log has three motors a leg, and {robot.name!r} has {len(joints)} joints in leg {leg}: is it this "
                "robot's log?"
            )
        for place, joint in enumerate(joints):
            column = 3 * legs.index(leg) + place
            matches[joint] = JointMatch(joint, motors[column], column, "motor order")
    return JointMap(tuple(matches[joint] for joint in robot.joint_names))


def read_joint_map(path: Path) -> dict[str, str | int]:
    """Read a user's joint map from a TOML file: the log's name, or its column from 0, by the robot's name.

    Raises:
        SettingsError: the file is missing or holds something else.
    """
    try:
        table = toml_table(read_text(path))
    except (OSError, ValueError) as error:
        raise SettingsError(f"the joint map {str(path)!r} cannot be read: {error}") from error
    section = table.get("joints")
    table = cast("dict[str, Any]", section) if isinstance(section, dict) else table
    wrong = [key for key, value in table.items() if isinstance(value, bool) or not isinstance(value, (str, int))]
    if wrong or not table:
        raise SettingsError(
            f'the joint map {str(path)!r} must have lines as FL_hip_joint = "front_left_hip", or a column\'s number'
            + (f"; {wrong[0]!r} is something else" if wrong else "")
        )
    return cast("dict[str, str | int]", table)


def _given(robot: RobotModel, log_joints: Sequence[str], given: Mapping[str, str | int]) -> dict[str, JointMatch]:
    found: dict[str, JointMatch] = {}
    for joint, name in given.items():
        if joint not in robot.joint_names:
            raise SettingsError(
                f"the joint map names {joint!r}, which is not a leg joint of {robot.name!r}; those are "
                f"{', '.join(robot.joint_names)}"
            )
        column = log_joints.index(name) if name in log_joints else name
        if not isinstance(column, int) or not 0 <= column < len(log_joints):
            raise SettingsError(f"the joint map gives {name!r} for {joint}; the log's joints are {_listed(log_joints)}")
        found[joint] = JointMatch(joint, log_joints[column], column, "given")
    columns = [match.column for match in found.values()]
    if len(set(columns)) < len(columns):
        twice = next(match.log_joint for match in found.values() if columns.count(match.column) > 1)
        raise SettingsError(f"the joint map assigns {twice!r} to two joints")
    return found


def _several(joint: str, columns: Sequence[int], log_joints: Sequence[str]) -> str:
    return f"{joint} may be {' or '.join(repr(log_joints[column]) for column in columns)}"


def _same_name(leg: Leg, joints: Sequence[str], log_joints: Sequence[str], free: Sequence[int]) -> list[list[int]]:
    """Return the columns for each of a leg's joints."""
    del leg
    return [[column for column in free if log_joints[column] == joint] for joint in joints]


def _spelling(leg: Leg, joints: Sequence[str], log_joints: Sequence[str], free: Sequence[int]) -> list[list[int]]:
    del leg
    keys = {column: _key(log_joints[column]) for column in free}
    found: list[list[int]] = []
    for joint in joints:
        key = _key(joint)
        same = [column for column in free if keys[column] == key]
        found.append(same or [column for column in free if keys[column].endswith(f"_{key}")])
    return found


def _leg_and_place(leg: Leg, joints: Sequence[str], log_joints: Sequence[str], free: Sequence[int]) -> list[list[int]]:
    of_leg = [column for column in free if leg_of(words_of(log_joints[column])) == leg.name]
    places = [3 - len(leg.joint_names) + leg.joint_names.index(joint) for joint in joints]
    return _assign(places, of_leg, log_joints)


def _assign(places: Sequence[int], columns: Sequence[int], log_joints: Sequence[str]) -> list[list[int]]:
    """Return the columns of a leg by place, with the least total cost; several where the optimum is not unique."""
    costs = [_place_costs(words_of(log_joints[column])) for column in columns]
    if not any(costs):
        costs = _numbered(columns, log_joints)
    best, ways = float("inf"), list[tuple[int, ...]]()
    for way in itertools.permutations(range(len(columns)), len(places)):
        if all(place in costs[index] for place, index in zip(places, way, strict=True)):
            cost = sum(costs[index][place] for place, index in zip(places, way, strict=True))
            if cost <= best:
                ways = [*(ways if cost == best else []), way]
                best = cost
    return [sorted({columns[way[k]] for way in ways}) for k in range(len(places))]


def _place_costs(words: Sequence[str]) -> dict[int, int]:
    """Return the costs of the places in a leg that a name may mean; the first word that names one counts most."""
    costs: dict[int, int] = {}
    later = 0
    for word, following in itertools.zip_longest(words, words[1:]):
        if word == _HIP and following in _HIP_AXES:
            place = _HIP_AXES[following]
            named = {} if place is None else {place: 0}
        elif word == _HIP and _PLACE_WORDS.get(following or "") in (0, 1):
            named = {_PLACE_WORDS[following or ""]: 0}
        elif word == _HIP:
            named = {0: 0, 1: _EITHER}
        elif word in _WEAK_WORDS:
            named = {_WEAK_WORDS[word]: _EITHER}
        else:
            named = {_PLACE_WORDS[word]: 0} if word in _PLACE_WORDS else {}
        for place, cost in named.items():
            costs.setdefault(place, cost + later)
        later = _LATER if named else later
    return costs


def _numbered(columns: Sequence[int], log_joints: Sequence[str]) -> list[dict[int, int]]:
    """Return places by numbers from the hip down, as in FL_0 FL_1 FL_2, counted from 0 or 1."""
    numbers = [[int(word) for word in words_of(log_joints[column]) if word.isdigit()] for column in columns]
    last = [number[-1] if number else -1 for number in numbers]
    first = min(last, default=-1)
    if first not in (0, 1) or sorted(last) != list(range(first, first + 3)):
        return [{} for _ in columns]
    return [{number - first: 0} for number in last]


def _key(name: str) -> str:
    return "_".join(words_of(name))


def _unmapped(
    robot: RobotModel, log_joints: Sequence[str], found: Mapping[str, JointMatch], missing: Sequence[str],
    problems: Sequence[str],
) -> RecordingError:  # fmt: skip
    names = {_key(name) for name in log_joints}
    lacking = [joint for joint in missing if _key(joint) not in names] or missing  # legs are matched as a whole
    used, known = {match.column for match in found.values()}, {_key(joint) for joint in robot.joint_names}
    free = [name for column, name in enumerate(log_joints) if column not in used and _key(name) not in known]
    reason = "; ".join(problems) or f"no name in the log resembles {', '.join(lacking)}"
    matched = ", ".join(f"{match.robot_joint} = {match.log_joint}" for match in found.values()) or "none"
    if not free and not problems:
        return RecordingError(
            f"the log has no columns of the joints {', '.join(lacking)}, and none that could be theirs: record all "
            f"{len(robot.joint_names)} joints of {robot.name}. The log's joints: {_listed(log_joints)}"
        )
    return RecordingError(
        f"the log's joints cannot be identified: {reason}. Found so far: {matched}. The log's other joints: "
        f"{_listed(free)}. Map them in a TOML file (--joint-map), with lines as {lacking[0]} = "
        f"{(free or ['...'])[0]!r}"
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names) or "none"
