"""Domain randomisation for reinforcement learning: Python files with plain numbers, to import from a task."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from equipoise.errors import NotEstimatedError
from equipoise.exports.found import BASE
from equipoise.exports.learning_joints import isaaclab_joints, mjlab_joints
from equipoise.exports.randomisation import Spread, spread
from equipoise.exports.subject import Subject, number
from equipoise.exports.written import Written
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components


def mjlab(subject: Subject) -> Written:
    """mjlab: ranges of dr.pseudo_inertia and dr.encoder_bias, and what actuators take."""
    return _together(subject, _mjlab_base, mjlab_joints)


def isaaclab(subject: Subject) -> Written:
    """Isaac Lab: ranges of randomize_rigid_body_mass and randomize_rigid_body_com, and what actuators take."""
    return _together(subject, _isaaclab_base, isaaclab_joints)


def _together(subject: Subject, *writers: Callable[[Subject], Written]) -> Written:
    """The base, then sensors and motors, each if it is asked for."""
    of_base, of_joints = writers
    parts = [of_base(subject)] if BASE in subject.parts else []
    parts += [of_joints(subject)] if subject.columns else []
    return Written(b"".join(part.content for part in parts), "; ".join(part.about for part in parts))


def _mjlab_base(subject: Subject) -> Written:
    drawn, about = _spread(subject), _about(subject)
    ranges = {f"{name}_range": pair for name, pair in drawn.entry_ranges().items()}
    return Written.text(
        [
            *_head(subject, about),
            "# Each range is what one entry is open by, to 95 %, while the others stay, for mjlab draws each by itself.",
            "#   EventTermCfg(mode='startup', func=dr.pseudo_inertia,",
            f"#     params={{'asset_cfg': SceneEntityCfg('robot', body_names=({subject.file_link!r},)), **PSEUDO_INERTIA}})",
            *_dictionary("PSEUDO_INERTIA", ranges),
            *_tail(subject, drawn),
        ],
        about,
    )


def _isaaclab_base(subject: Subject) -> Written:
    drawn, about = _spread(subject), _about(subject)
    ranges, body = drawn.body_ranges(), subject.base_in_file
    low, high = (bound / body.mass for bound in ranges["mass"])
    shifts = {
        axis: tuple(bound - found for bound in ranges[f"com_{axis}"])
        for axis, found in zip("xyz", body.com, strict=True)
    }
    on_base = f"asset_cfg=SceneEntityCfg('robot', body_names={subject.file_link!r})"
    return Written.text(
        [
            *_head(subject, about),
            f"#   EventTerm(func=mdp.randomize_rigid_body_mass, mode='startup', params=dict({on_base}, **MASS))",
            f"#   EventTerm(func=mdp.randomize_rigid_body_com, mode='startup', params=dict({on_base}, **COM))",
            f'MASS = {{"mass_distribution_params": ({number(low)}, {number(high)}), "operation": "scale"}}',
            *_dictionary("COM_RANGE", shifts),
            'COM = {"com_range": COM_RANGE}',
            *_tail(subject, drawn),
        ],
        about,
    )


def _spread(subject: Subject) -> Spread:
    covariance = subject.result.composite.covariance
    if covariance is None:
        raise NotEstimatedError("this calibration has no covariance; calibrate with --method precise")
    # A turn of the axes is linear in all ten numbers.
    turn = np.column_stack([components(subject.in_file(InertialParameters.from_components(one))) for one in np.eye(10)])
    composite = subject.in_file(subject.composite)
    return spread(subject.base_in_file, composite, turn @ covariance @ turn.T, subject.seed)


def _about(subject: Subject) -> str:
    return (
        f"what the run left open of base link {subject.file_link!r} with all that is fixed to it or held, about the file "
        "that --to mjcf or --to urdf writes, whose legs stay"
    )


def _head(subject: Subject, about: str) -> list[str]:
    return [
        *(f"# {line}" for line in subject.header(about)),
        "# Drawn through the pseudo-inertia: all bodies in these ranges, and all SAMPLES, can exist.",
    ]


def _tail(subject: Subject, drawn: Spread) -> list[str]:
    lines = _dictionary("QUANTILES", drawn.body_ranges())
    lines.insert(0, "# 2.5 and 97.5 % of the drawn bodies: kg, m, kg m2")
    lines += [f"BASE_LINK = {subject.file_link!r}", f"SEED = {subject.seed}"]
    if subject.samples:
        lines += [f"# Drawn bodies, correlated as the estimate is: {', '.join(COMPONENTS)}", "SAMPLES = ["]
        lines += [f"    ({', '.join(map(number, row))})," for row in drawn.bodies[: subject.samples]]
        lines.append("]")
    return lines


def _dictionary(name: str, ranges: dict[str, tuple[float, ...]] | dict[str, tuple[float, float]]) -> list[str]:
    rows = [f'    "{key}": ({", ".join(map(number, pair))}),' for key, pair in ranges.items()]
    return [f"{name} = {{", *rows, "}"]
