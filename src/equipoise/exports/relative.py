"""Difference of the measured base from that of another model file, such as the one that a policy was trained on.

Files of one robot count rotors and small links in the base, in the legs, or not at all. So the measured base is the one that
gives the measured robot with the legs of the other file. About the origin of the base frame, with p of the base and P of the
whole robot at the run's stance,

    p_run = p_model + P_run - P_model,

so both bases hold all that the other file does not count in its legs, and the covariance of p_run is that of P_run.

The log-Cholesky parameters of a body with pseudo-inertia J are the entries of the upper triangular U with J = U U'. Those of
the stretch have J_run = U J_model U' (Rucker and Wensing 2022; `randomisation` writes U out).
"""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ModelWarning, NotEstimatedError, SettingsError
from equipoise.exports import randomisation
from equipoise.exports.model_file import composite_of, feet_shift
from equipoise.exports.subject import Subject, Written, seen_from
from equipoise.exports.tables import provenance, yaml_lines
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.forward import link_in_file
from equipoise.robot.inertial import COMPONENTS, InertialParameters, base_parameters, components
from equipoise.robot.links import file_links
from equipoise.robot.model import RobotModel

SCHEMA = "equipoise.relative/1"
_SAME_FRAME = 0.01  # of the leg length: feet of files of one robot agree within 0.5 %, those of A1 and Go1 within 4 %
_SAME_LEGS = 0.002  # of the robot's mass: a heavier difference of the legs is a note
_DIGITS = 15  # of a zero that is computed
_ABOUT_ORIGIN = (
    "mass", "moment_x", "moment_y", "moment_z",
    "Ixx_origin", "Ixy_origin", "Iyy_origin", "Ixz_origin", "Iyz_origin", "Izz_origin",
)  # fmt: skip
_UNITS: dict[str, str] = {
    **dict(zip(_ABOUT_ORIGIN, ["kg", *3 * ["kg m"], *6 * ["kg m2"]], strict=True)),
    **dict(zip(COMPONENTS[1:], [*3 * ["m"], *6 * ["kg m2"]], strict=True)),
}

Rows = dict[str, dict[str, Any]]


def load_reference(name: str, result: Calibration) -> RobotModel:
    """Return another model of a run's robot.

    Its links are found as the run's robot configuration states, and joints outside the legs are locked as in the run.

    Args:
        name: name of a robot, or path of a URDF or MJCF file.
        result: result of the run.

    Raises:
        ModelError: no such robot or file, or it is not a quadruped.
        SettingsError: its leg joints, base frame or joint offsets are not those of the run's model; or the run has no model.
    """
    original = _original(result)
    description = replace(
        RobotDescription(),
        **{key: getattr(original.description, key) for key in ("base_link", "forward", "foot_frames")},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        reference = load_robot(name, description)
        locked = {joint: q for joint, q in original.locked_joints.items() if joint in reference.locked_joints}
        if locked != dict(reference.locked_joints):
            reference = load_robot(name, replace(description, locked_joints=locked))
    here, there = set(original.joint_names), set(reference.joint_names)
    if here != there:
        raise SettingsError(
            f"--relative-to {name}: its leg joints are not those of the run's model: only the run has "
            f"{_names(here - there)}, only {name} has {_names(there - here)}; name a file of the same robot and joints"
        )
    shift = feet_shift(reference, original, result.joint_position)
    if np.linalg.norm(shift, axis=1).max() > _SAME_FRAME * original.leg_length:
        mean = ", ".join(f"{round(1000 * value, 1) + 0.0:.1f}" for value in shift.mean(axis=0))
        raise SettingsError(
            f"--relative-to {name}: at the run's stance its feet are up to "
            f"{1000 * np.linalg.norm(shift, axis=1).max():.1f} mm from those of the run's model (mean {mean} mm): its base "
            "frame or joint offsets differ, or it is another robot's; calibrate with that file, or move its base frame"
        )
    return reference


def write_json(subject: Subject) -> Written:
    """Write both bases, their difference with intervals, and the links that each file counts in base and legs, as JSON."""
    reference, about = _reference(subject), _about(subject)
    rows, covariance, notes = _compared(subject)
    table = {
        **provenance(replace(subject, notes=notes + subject.notes), SCHEMA, about),
        "relative_to": {
            "name": reference.name,
            "file": str(reference.source.path),
            "format": reference.source.format,
            "sha256": reference.source.sha256,
            "base_link": _frame(reference),
        },
        "stance": subject.result.stance_dict(),
        **rows,
        "covariance": {"order": list(_ABOUT_ORIGIN), "values": covariance.tolist()},
        "links": {"run": _counted(_original(subject.result)), "model": _counted(reference)},
        "legs_run_minus_model": dict(zip(_ABOUT_ORIGIN, _legs_difference(subject).tolist(), strict=True)),
    }
    return Written((json.dumps(table, indent=2) + "\n").encode(), about, notes)


def write_ros2(subject: Subject) -> Written:
    """Write both bases, their difference and its standard deviations as parameters of any ROS 2 node."""
    reference, about = _reference(subject), _about(subject)
    rows, _, notes = _compared(subject)
    columns = {
        column: {kind: {name: row[column] for name, row in of_kind.items()} for kind, of_kind in rows.items()}
        for column in ("model", "run", "difference", "std")
    }
    values = {"relative_to": _name(reference), "base_link": _frame(reference), **columns}
    lines = yaml_lines({"/**": {"ros__parameters": {"equipoise": values}}})
    return subject.text(about, lines, notes)


def contents(subject: Subject) -> str:
    """Return the sentence that states the difference of mass and CoM, with 95 % intervals, and its frame."""
    reference = _reference(subject)
    bodies, in_composite, _ = _measured(subject)
    rows, _ = _base_rows(bodies, in_composite)
    mass, *com = (
        f"{scale * rows[name]['difference']:+.{digits}f} +- {scale * NORMAL_95 * rows[name]['std']:.{digits}f}"
        for name, scale, digits in (("mass", 1, 3), ("com_x", 1000, 1), ("com_y", 1000, 1), ("com_z", 1000, 1))
    )
    return (
        f"written of the base: the robot's minus that of {_name(reference)}: mass {mass} kg, CoM x {com[0]}, y {com[1]}, "
        f"z {com[2]} mm in the frame of {_frame(reference)!r}; first moment, inertia and log-Cholesky parameters"
    )


def _measured(subject: Subject) -> tuple[tuple[InertialParameters, ...], FloatArray, tuple[str, ...]]:
    """Return bodies in the axes of the other file's base link, and the covariance of the last one.

    Returns:
        the other file's base, the run's base for its legs, and the run's composite; (10, 10) covariance of the composite in
        the order of COMPONENTS, SI units; notes.
    """
    reference = _reference(subject)
    placement = link_in_file(reference.base_link, reference.source.forward)[1]
    in_composite = subject.covariance_seen_from(placement)
    model = base_parameters(reference)
    added = subject.composite.vector - composite_of(subject, reference).vector
    run, notes = subject.nearest_body(
        model.vector + added, f"the base for the legs of {_name(reference)}", "check the legs with 'equipoise audit'"
    )
    model, run, composite = (seen_from(body, placement) for body in (model, run, subject.composite))
    return (model, run, composite), in_composite, (*notes, *_legs_note(subject))


def _base_rows(bodies: tuple[InertialParameters, ...], in_composite: FloatArray) -> tuple[Rows, FloatArray]:
    """Return rows of mass, CoM and inertia, and the (10, 10) covariance of the difference about the origin, SI units.

    Args:
        bodies, in_composite: as from `_measured`.
    """
    model, run, composite = bodies
    slope, back = randomisation.vector_slope(composite), np.linalg.inv(randomisation.vector_slope(run))
    covariance = slope @ in_composite @ slope.T
    stds = np.sqrt(np.concatenate([np.diag(covariance), np.diag(back @ covariance @ back.T)[1:]]))
    values = np.array([np.concatenate([body.vector, components(body)[1:]]) for body in (model, run)])
    return _table(_UNITS, values, stds, values[1] + NORMAL_95 * np.outer([-1, 1], stds)), covariance


def _compared(subject: Subject) -> tuple[dict[str, Rows], FloatArray, tuple[str, ...]]:
    """Return rows of the other file's base, the run's and their difference, in the axes of that file's base link.

    Intervals of the entries of U are those of physical bodies that are drawn from the posterior; all others are linear.

    Returns:
        rows by kind and name; (10, 10) covariance of the difference about the origin, SI units; notes.
    """
    bodies, in_composite, notes = _measured(subject)
    of_base, covariance = _base_rows(bodies, in_composite)
    model, run, composite = bodies
    rows = {"base": of_base}
    pair = randomisation.pseudo_inertias(np.array([model.vector, run.vector]))
    if not np.linalg.eigvalsh(pair[0])[0] > 0:
        raise NotEstimatedError(
            f"the base of {_name(_reference(subject))} has no log-Cholesky parameters: it is as flat as a plate; correct its "
            "inertia"
        )
    drawn = randomisation.drawn_bases(run, composite, in_composite, subject.seed)
    for kind, origin in (("log_cholesky", np.eye(4)), ("stretch", pair[0])):
        entries = randomisation.entries_between(drawn, origin)
        ends = np.quantile(entries, randomisation.QUANTILES, axis=0)
        values = randomisation.entries_between(pair, origin)
        rows[kind] = _table(dict.fromkeys(randomisation.ENTRIES, "1"), values, entries.std(axis=0), ends)
    return rows, covariance, notes


def _table(units: dict[str, str], values: FloatArray, stds: FloatArray, ends: FloatArray) -> Rows:
    """Return a row for each of n numbers.

    Args:
        units: unit of each number by name.
        values: (2, n) numbers of the other file and of the run.
        stds: (n,) standard deviations of the run's numbers.
        ends: (2, n) bounds of the intervals of the run's numbers.
    """
    columns = np.vstack([values.round(_DIGITS), stds, ends - values[0]]).T.tolist()
    rows: Rows = {}
    for (name, unit), (model, run, std, lower, upper) in zip(units.items(), columns, strict=True):
        numbers = {"model": model, "run": run, "difference": run - model, "std": std, "lower": lower, "upper": upper}
        rows[name] = {"unit": unit, **numbers, "significant": not lower <= 0 <= upper}
    return rows


def _legs_note(subject: Subject) -> tuple[str, ...]:
    reference, mass = _reference(subject), float(_legs_difference(subject)[0])
    if abs(mass) <= _SAME_LEGS * reference.mass:
        return ()
    return (
        f"the legs of {_name(reference)} are {abs(mass):.3f} kg {'lighter' if mass > 0 else 'heavier'} than those of the "
        "run's model: the base's difference contains that of the legs, which the JSON form lists (legs_run_minus_model)",
    )


def _legs_difference(subject: Subject) -> FloatArray:
    """Return (10,) parameters of the run's legs minus those of the other file, at the stance, about the base's origin."""
    run, model = (
        composite_of(subject, robot).vector - base_parameters(robot).vector
        for robot in (_original(subject.result), _reference(subject))
    )
    return run - model


def _counted(robot: RobotModel) -> dict[str, dict[str, float]]:
    """Return the masses [kg] of the links that a file counts in the base and in the legs, by name."""
    full = robot.full_pinocchio
    hips = [full.getJointId(leg.joint_names[0]) for leg in robot.legs.values()]
    of_legs = {int(joint) for hip in hips for joint in full.subtrees[hip]}
    links: dict[str, dict[str, float]] = {"base": {}, "legs": {}}
    for link in file_links(full):
        links["legs" if link.joint in of_legs else "base"][link.name] = float(link.inertia.mass)
    return links


def _original(result: Calibration) -> RobotModel:
    if result.robot_model is None:
        raise SettingsError("a calibration.json alone has no model file: name the run folder for --relative-to")
    return result.robot_model


def _reference(subject: Subject) -> RobotModel:
    assert subject.reference is not None
    return subject.reference


def _about(subject: Subject) -> str:
    reference = _reference(subject)
    theirs, ours = (", ".join(_counted(robot)["base"]) for robot in (reference, _original(subject.result)))
    return (
        f"base link {_frame(reference)!r} of {_name(reference)} with all links fixed to it or locked: {theirs} (in the run's "
        f"model: {ours}); 'run' gives the estimated composite with the legs of that file; moment and I.._origin are about "
        "that link's origin, I.. about the CoM"
    )


def _name(reference: RobotModel) -> str:
    file = reference.source.path
    return file.name if file.stem == reference.name else reference.name


def _frame(reference: RobotModel) -> str:
    return link_in_file(reference.base_link, reference.source.forward)[0]


def _names(joints: set[str]) -> str:
    return ", ".join(sorted(joints)) or "none"
