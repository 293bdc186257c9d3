"""Python files for reinforcement learning, with ranges of the base and joint parameters, to import from a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from equipoise.exports import randomisation
from equipoise.exports.parameters import BASE
from equipoise.exports.subject import FloatArray, Subject, Written, number
from equipoise.robot.inertial import COMPONENTS

_DRAWN = "# Drawn through the pseudo-inertia: all bodies in these ranges, and all SAMPLES, are physical."
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
# Isaac Sim 5 takes friction as torques, as here; 4.5 takes it as a coefficient: do not use these numbers there.


def actuator(timestep):
    \"\"\"DelayedPDActuatorCfg(joint_names_expr=list(JOINTS), stiffness=..., damping=..., **actuator(timestep)).\"\"\"
    fields = {"armature": ARMATURE, "friction": FRICTION, "dynamic_friction": FRICTION, "viscous_friction": VISCOUS}
    row = {key: {joint: max(0.0, value) for joint, value in values.items()} for key, values in fields.items() if values}
    if DELAY:
        row["min_delay"] = max(0, round(min(low for low, _ in DELAY.values()) / timestep))
        row["max_delay"] = max(0, round(max(high for _, high in DELAY.values()) / timestep))
    return row
"""


def mjlab(subject: Subject) -> Written:
    """Write ranges of mjlab's dr.pseudo_inertia and dr.encoder_bias, and actuator parameters."""
    return _together(subject, _mjlab_base, "ENCODER_BIAS", _MJLAB)


def isaaclab(subject: Subject) -> Written:
    """Write ranges of Isaac Lab's randomize_rigid_body_mass and randomize_rigid_body_com, and actuator parameters."""
    return _together(subject, _isaaclab_base, "JOINT_OFFSET", _ISAACLAB)


def _together(subject: Subject, of_base: Callable[[Subject], Written], offsets: str, code: str) -> Written:
    """Return the requested parts: the base, then sensors and motors."""
    parts = [of_base(subject)] if BASE in subject.parts else []
    parts += [_joints(subject, offsets, code)] if subject.columns else []
    return Written(b"".join(part.content for part in parts), "; ".join(part.about for part in parts))


def _mjlab_base(subject: Subject) -> Written:
    drawn = _drawn(subject)
    entries = randomisation.entries_between(drawn, randomisation.pseudo_inertias(subject.base_in_file.vector[None])[0])
    ranges = {f"{name}_range": pair for name, pair in randomisation.entry_ranges(entries).items()}
    lines = [
        _DRAWN,
        "# Each range is the 95 % interval of one entry given the others, because mjlab draws each independently.",
        "#   EventTermCfg(mode='startup', func=dr.pseudo_inertia,",
        f"#     params={{'asset_cfg': SceneEntityCfg('robot', body_names=({subject.file_link!r},)), **PSEUDO_INERTIA}})",
        *_dictionary("PSEUDO_INERTIA", ranges),
        *_tail(subject, randomisation.components_of(drawn)),
    ]
    return subject.text(_about(subject), lines)


def _isaaclab_base(subject: Subject) -> Written:
    bodies = randomisation.components_of(_drawn(subject))
    ranges, body = randomisation.body_ranges(bodies), subject.base_in_file
    low, high = (bound / body.mass for bound in ranges["mass"])
    shifts = {
        axis: tuple(bound - found for bound in ranges[f"com_{axis}"])
        for axis, found in zip("xyz", body.com, strict=True)
    }
    on_base = f"asset_cfg=SceneEntityCfg('robot', body_names={subject.file_link!r})"
    lines = [
        _DRAWN,
        f"#   EventTerm(func=mdp.randomize_rigid_body_mass, mode='startup', params=dict({on_base}, **MASS))",
        f"#   EventTerm(func=mdp.randomize_rigid_body_com, mode='startup', params=dict({on_base}, **COM))",
        f'MASS = {{"mass_distribution_params": ({number(low)}, {number(high)}), "operation": "scale"}}',
        *_dictionary("COM_RANGE", shifts),
        'COM = {"com_range": COM_RANGE}',
        *_tail(subject, bodies),
    ]
    return subject.text(_about(subject), lines)


def _drawn(subject: Subject) -> FloatArray:
    """Return (n, 4, 4) pseudo-inertias of bodies drawn from the posterior, in the axes of the model file."""
    covariance = subject.covariance_seen_from(subject.file_placement)
    composite = subject.in_file(subject.composite)
    return randomisation.drawn_bases(subject.base_in_file, composite, covariance, subject.seed)


def _about(subject: Subject) -> str:
    return (
        f"posterior uncertainty of base link {subject.file_link!r} with all links fixed to it or locked, around the file "
        "that --to mjcf or --to urdf writes; its legs do not change"
    )


def _tail(subject: Subject, bodies: FloatArray) -> list[str]:
    """Return the last lines, from (n, 10) drawn bodies in the order of COMPONENTS."""
    lines = _dictionary("QUANTILES", randomisation.body_ranges(bodies))
    lines.insert(0, "# 2.5 and 97.5 % of the drawn bodies: kg, m, kg m2")
    lines += [f"BASE_LINK = {subject.file_link!r}", f"SEED = {subject.seed}"]
    if subject.samples:
        lines += [f"# Drawn bodies, correlated as the estimate is: {', '.join(COMPONENTS)}", "SAMPLES = ["]
        lines += [f"    ({', '.join(map(number, row))})," for row in bodies[: subject.samples]]
        lines.append("]")
    return lines


def _dictionary(name: str, values: Mapping[str, float | Sequence[float]], comment: str = "") -> list[str]:
    """Return a dictionary of numbers or of tuples of numbers, with a comment on its first line."""
    rows = [f"    {key!a}: {_python(value)}," for key, value in values.items()]
    return [f"{name} = {{{comment}", *rows, "}"]


def _python(value: float | Sequence[float]) -> str:
    return f"({', '.join(map(number, value))})" if isinstance(value, Sequence) else number(value)


def _joints(subject: Subject, offsets: str, code: str) -> Written:
    about = subject.columns_words
    lines = [
        f"JOINTS = ({''.join(f'{joint!a}, ' for joint in subject.joints).rstrip()})",
        "# 95 % interval of encoder reading minus joint position [rad]",
        *_dictionary(offsets, _intervals(subject, "joint_offset")),
        "# 95 % interval of the delay from command to torque [s]",
        *_dictionary("DELAY", _intervals(subject, "delay")),
        *_dictionary("ARMATURE", subject.column("armature"), "  # kg m2"),
        *_dictionary("FRICTION", subject.column("coulomb_friction"), "  # Nm"),
        *_dictionary("VISCOUS", subject.column("viscous_friction"), "  # Nm s/rad"),
        "# true over reported torque, over their mean, minus one",
        *_dictionary("RELATIVE_GAIN", subject.column("relative_gain")),
        *code.rstrip("\n").split("\n"),
    ]
    return subject.text(about, lines)


def _intervals(subject: Subject, name: str) -> dict[str, tuple[float, float]]:
    """Return the 95 % intervals of a column, by joint."""
    columns = [column for column in subject.columns if column.name == name]
    found = {key: quantity.interval for column in columns for key, quantity in column.values.items()}
    return {key: ends for key, ends in found.items() if ends}
