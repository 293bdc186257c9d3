"""Joints, encoders and motors for reinforcement learning: dictionaries by joint, and functions that make settings of them."""

from __future__ import annotations

from collections.abc import Sequence

from equipoise.exports.found import Column
from equipoise.exports.subject import Subject, number
from equipoise.exports.written import Written

_MJLAB = """
# One event a joint: 'encoder_bias_FL_hip_joint': EventTermCfg(mode='startup', func=dr.encoder_bias, params={'bias_range':
#   ENCODER_BIAS['FL_hip_joint'], 'asset_cfg': SceneEntityCfg('robot', joint_names=('FL_hip_joint',))})


def actuators(timestep):
    \"\"\"One for each joint: BuiltinPositionActuatorCfg(stiffness=..., damping=..., **row); timestep of the physics [s].\"\"\"
    rows = []
    for joint in JOINTS:
        row = {"target_names_expr": (joint,)}
        for key, values in (("armature", ARMATURE), ("frictionloss", FRICTION), ("viscous_damping", VISCOUS)):
            if joint in values:
                row[key] = max(0.0, values[joint])
        if joint in DELAY:
            row["delay_min_lag"], row["delay_max_lag"] = (max(0, round(end / timestep)) for end in DELAY[joint])
        rows.append(row)
    return rows
"""
_ISAACLAB = """
# Isaac Sim 5 takes friction as torques, as here; 4.5 took it as a coefficient, which none of these is.


def actuator(timestep):
    \"\"\"DelayedPDActuatorCfg(joint_names_expr=list(JOINTS), stiffness=..., damping=..., **actuator(timestep)).\"\"\"
    fields = {"armature": ARMATURE, "friction": FRICTION, "dynamic_friction": FRICTION, "viscous_friction": VISCOUS}
    row = {key: {joint: max(0.0, value) for joint, value in values.items()} for key, values in fields.items() if values}
    if DELAY:
        row["min_delay"] = max(0, round(min(low for low, _ in DELAY.values()) / timestep))
        row["max_delay"] = max(0, round(max(high for _, high in DELAY.values()) / timestep))
    return row
"""


def mjlab_joints(subject: Subject) -> Written:
    """mjlab: encoder_bias, and armature, frictionloss, viscous damping and delay of actuators."""
    return _written(subject, "ENCODER_BIAS", _MJLAB)


def isaaclab_joints(subject: Subject) -> Written:
    """Isaac Lab: armature, friction and delay of a DelayedPDActuator; joint zeros for an observation of one's own."""
    return _written(subject, "JOINT_ZERO", _ISAACLAB)


def _written(subject: Subject, zeros: str, code: str) -> Written:
    about = subject.columns_words
    lines = [
        *(f"# {line}" for line in subject.header(about)),
        f"JOINTS = ({''.join(f'{joint!a}, ' for joint in subject.joints).rstrip()})",
        "# 95 % of encoder reading less joint position [rad]",
        *_ranges(zeros, _columns(subject, "joint_zero")),
        "# 95 % of the age of the command that a torque obeys [s]",
        *_ranges("DELAY", _columns(subject, "delay")),
        *_values("ARMATURE", subject.column("armature"), "kg m2"),
        *_values("FRICTION", subject.column("coulomb_friction"), "Nm"),
        *_values("VISCOUS", subject.column("viscous_friction"), "Nm s/rad"),
        *_values(
            "RELATIVE_GAIN", subject.column("relative_gain"), "true over reported torque, over their mean, less one"
        ),
        *code.rstrip("\n").split("\n"),
    ]
    return Written.text(lines, about)


def _columns(subject: Subject, name: str) -> list[Column]:
    return [column for column in subject.columns if column.name == name]


def _ranges(name: str, columns: Sequence[Column]) -> list[str]:
    intervals = {key: quantity.interval for column in columns for key, quantity in column.values.items()}
    rows = [f"    {key!a}: ({number(ends[0])}, {number(ends[1])})," for key, ends in intervals.items() if ends]
    return [f"{name} = {{", *rows, "}"]


def _values(name: str, values: dict[str, float], unit: str) -> list[str]:
    return [f"{name} = {{  # {unit}", *(f"    {key!a}: {number(value)}," for key, value in values.items()), "}"]
