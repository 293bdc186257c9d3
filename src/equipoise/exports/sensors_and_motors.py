"""Files of sensor and motor parameters alone: for the user's own tools, firmware, ROS 2 and robot programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

from equipoise.errors import NotEstimatedError, SettingsError
from equipoise.exports.parameters import Column
from equipoise.exports.subject import Subject, Written, number
from equipoise.exports.tables import columns_table, provenance, yaml_lines

SCHEMA = "equipoise.sensors-and-motors/1"
_AXES = {"imu_tilt": ("roll", "pitch", "yaw"), "clock_offset": ("imu",)}
_MOTOR_LEGS = ("FR", "FL", "RR", "RL")  # of Unitree's robots; each hip, thigh, calf


def write_toml(subject: Subject) -> Written:
    """Write all parameters, with standard deviations and verdicts, as TOML."""
    about = subject.columns_words
    table = {**provenance(subject, SCHEMA, about), **columns_table(subject.columns)}
    return subject.text(about, _toml(table, ()))


def write_ros2(subject: Subject) -> Written:
    """Write parameters of any ROS 2 node: equipoise.joint_offset.FL_hip_joint and so on."""
    about = subject.columns_words
    values = {column.name: {key: column.number(key) for key in column.values} for column in subject.columns}
    lines = yaml_lines({"/**": {"ros__parameters": {"equipoise": values}}})
    return subject.text(about, [*_meanings(subject), *lines])


def write_c_header(subject: Subject) -> Written:
    """Write arrays in the model's joint order, and by axis; 0 for values that are not identified."""
    about, joints = subject.columns_words, list(subject.result.joint_position)
    names = ", ".join(map(_quoted, joints))
    lines = [
        "#ifndef EQUIPOISE_SENSORS_AND_MOTORS_H",
        "#define EQUIPOISE_SENSORS_AND_MOTORS_H",
        f"#define EQUIPOISE_JOINTS {len(joints)}",
        f"static const char *const equipoise_joint_names[EQUIPOISE_JOINTS] = {{{names}}};",
    ]
    for column in subject.columns:
        keys = _keys(column, joints)
        size = "EQUIPOISE_JOINTS" if keys is joints else str(len(keys))
        values = ", ".join(number(column.number(key)) for key in keys)
        order = "" if keys is joints else f"; {', '.join(keys)}"
        lines += [
            f"// [{column.unit}] {column.meaning}{order}",
            f"static const double equipoise_{column.name}[{size}] = {{{values}}};",
        ]
    return subject.text(about, [*lines, "#endif"], mark="// ")


def write_joint_offsets(subject: Subject) -> Written:
    """Write joint offsets alone, by joint, as YAML."""
    about = "joint offsets [rad], encoder reading minus joint position: joint = reading - offset"
    return subject.text(about, yaml_lines(_offsets(subject)))


def write_unitree(subject: Subject) -> Written:
    """Write lists in the order of a Unitree robot's motors, as YAML; 0 for values that are not identified."""
    about = (
        f"{subject.columns_words}; lists in the order of the motors, {' '.join(_MOTOR_LEGS)}, each from the hip down"
    )
    joints = _in_motor_order(subject)
    values = {column.name: [column.number(key) for key in _keys(column, joints)] for column in subject.columns}
    lines = yaml_lines({"joint_names": joints, **values})
    return subject.text(about, [*_meanings(subject), *lines])


def write_holosoma(subject: Subject) -> Written:
    """Write Holosoma's joint_offsets_deg, which are added to commanded positions."""
    about = "joint offsets in degrees: encoder reading minus joint position, to be added to a command"
    degrees = {joint: math.degrees(offset) for joint, offset in _offsets(subject).items()}
    lines = [
        "JOINT_OFFSETS_DEG = {",
        *(f"    {name!a}: {number(value)}," for name, value in degrees.items()),
        "}",
        "",
        "",
        "def joint_offsets_deg(dof_names):",
        '    """RobotConfig(..., joint_offsets_deg=joint_offsets_deg(dof_names)): 0 for joints that are not listed."""',
        "    return tuple(JOINT_OFFSETS_DEG.get(name, 0.0) for name in dof_names)",
    ]
    return subject.text(about, lines)


def _offsets(subject: Subject) -> dict[str, float]:
    if not (offsets := subject.column("joint_offset")):
        raise NotEstimatedError(
            "no joint offset is identified by this run; calibrate longer (--duration), or write them anyway with --force"
        )
    return offsets


def _keys(column: Column, joints: list[str]) -> list[str]:
    """Return all joints, or all axes, of a column, with a value or without."""
    if set(column.values) <= set(joints):
        return joints
    return list(_AXES.get(column.name, "xyz"))


def _in_motor_order(subject: Subject) -> list[str]:
    robot = subject.result.robot_model
    if robot is None:
        raise SettingsError("a calibration.json alone has no legs of the robot: name the run folder")
    return [robot.joint_names[joint] for leg in _MOTOR_LEGS for joint in robot.legs[leg].joints]


def _meanings(subject: Subject) -> list[str]:
    return [f"# {column.name} [{column.unit}]: {column.meaning}" for column in subject.columns]


def _toml(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Return a table's own values, then the tables in it."""
    inner = {key: cast("Mapping[str, Any]", value) for key, value in table.items() if isinstance(value, Mapping)}
    own = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in table.items() if key not in inner]
    head = ["", f"[{'.'.join(map(_toml_key, path))}]"] if path and own else []
    lines = [*head, *own]
    for key, value in inner.items():
        lines += _toml(value, (*path, key))
    return lines


def _toml_key(key: str) -> str:
    return key if key.isidentifier() and key.isascii() else _quoted(key, "U{:08x}")


def _toml_value(value: Any) -> str:
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml_value, cast('list[Any]', value)))}]"
    return _quoted(str(value), "U{:08x}")


def _quoted(text: str, escape: str = "") -> str:
    """Return text in double quotes, with all but printable ASCII escaped: as octal bytes of UTF-8 (C), or by `escape`.

    Args:
        escape: form of a character's number, for languages other than C.
    """
    return f'"{"".join(_escaped(letter, escape) for letter in text)}"'


def _escaped(letter: str, escape: str) -> str:
    if " " <= letter <= "~" and letter not in '"\\?':  # ??/ is a backslash to old C
        return letter
    if escape:
        return "\\" + escape.format(ord(letter))
    return "".join(f"\\{byte:03o}" for byte in letter.encode())
