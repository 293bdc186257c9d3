"""The table of formats, and the function that writes one. A new consumer needs a writer and a row, here or by entry point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from equipoise._version import __version__
from equipoise.errors import EquipoiseError, SettingsError, did_you_mean
from equipoise.exports import controllers, learning, mjcf, relative, sdf, sensors_and_motors, tables, urdf, usd, xacro
from equipoise.exports.acceptance import accept_bodies, accept_columns, require_within_robot
from equipoise.exports.format import Format
from equipoise.exports.model_file import find_users_file
from equipoise.exports.parameters import BASE, LEGS, MOTORS, SENSORS, columns_of
from equipoise.exports.randomisation import DRAWS
from equipoise.exports.subject import Subject, UsersFile
from equipoise.plugins import Table
from equipoise.result.calibration import Calibration
from equipoise.robot.model import RobotModel
from equipoise.user_file import read_bytes, write_file

_BASE, _WHOLE, _BOTH = ("base",), ("composite",), ("composite", "base")
_FOUND = (SENSORS, MOTORS)
_ALL_PARTS = (BASE, *_FOUND, LEGS)
_PAGE = "sensors-and-motors"
_FOUND_FILE = "sensors_and_motors"
FORMATS: dict[str, Format] = {
    row.name: row
    for row in (
        Format("urdf", _BASE, "model", True, "your URDF", "robot.urdf", urdf.write, "urdf",
               parts=(BASE, MOTORS, LEGS)),
        Format("mjcf", _BASE, "model", True, "your MJCF", "robot.xml", mjcf.write, "mjcf",
               parts=(BASE, MOTORS, LEGS)),
        Format("sdf", _BASE, "given", True, "Gazebo's model.sdf", "base.sdf", sdf.write, "sdf"),
        Format("usd", _BASE, "given", False, "Isaac Sim, Isaac Lab: your USD", "robot.usd", usd.write, "usd",
               parts=(BASE, MOTORS)),
        Format("xacro", _BASE, "given", False, "legged_control's const.xacro", "const.xacro", xacro.write, "legged_control"),
        Format("quadruped-pympc", _WHOLE, "", False, "Quadruped-PyMPC's config.py", "config.py",
               controllers.quadruped_pympc, "quadruped-pympc", lacks=("composite CoM",)),
        Format("unitree-guide", _WHOLE, "", False, "unitree_guide's unitreeRobot.cpp", "unitreeRobot.cpp",
               controllers.unitree_guide, "unitree-guide"),
        Format("mit-cheetah", _BOTH, "", False, "MIT's Cheetah-Software", "cheetah.cpp",
               controllers.mit_cheetah, "mit-cheetah", lacks=("composite CoM",)),
        Format("quad-sdk", _WHOLE, "", False, "Quad-SDK's ROBOT.yaml, main.m", "quad-sdk.yaml", controllers.quad_sdk,
               "quad-sdk", lacks=("composite CoM",)),
        Format("mjlab", _BASE, "", False, "mjlab's dr.pseudo_inertia", "mjlab_randomisation.py", learning.mjlab, "mjlab",
               samples=True, parts=(BASE, *_FOUND)),
        Format("isaaclab", _BASE, "", False, "Isaac Lab's event terms", "isaaclab_randomisation.py",
               learning.isaaclab, "isaaclab", samples=True, parts=(BASE, *_FOUND), lacks=("base inertia",)),
        Format("yaml", _BOTH, "", False, "tools of your own", "inertia.yaml", tables.write_yaml, "tables", parts=_ALL_PARTS),
        Format("json", _BOTH, "", False, "tools of your own", "inertia.json", tables.write_json, "tables", parts=_ALL_PARTS),
        Format("toml", (), "", False, "tools of your own", f"{_FOUND_FILE}.toml", sensors_and_motors.write_toml,
               _PAGE, parts=(*_FOUND, LEGS)),
        Format("joint-offsets", (), "", False, "encoder software", "joint_offsets.yaml",
               sensors_and_motors.write_joint_offsets, _PAGE, parts=(SENSORS,)),
        Format("c-header", (), "", False, "firmware, C and C++", f"{_FOUND_FILE}.h",
               sensors_and_motors.write_c_header, _PAGE, parts=_FOUND),
        Format("ros2", (), "", False, "parameters of a ROS 2 node", "ros2_parameters.yaml",
               sensors_and_motors.write_ros2, _PAGE, parts=_FOUND),
        Format("unitree-yaml", (), "", False, "lists in Unitree's motor order", "unitree.yaml",
               sensors_and_motors.write_unitree, _PAGE, parts=_FOUND),
        Format("holosoma", (), "", False, "holosoma's joint_offsets_deg", "holosoma_offsets.py",
               sensors_and_motors.write_holosoma, _PAGE, parts=(SENSORS,)),
    )
}  # fmt: skip
"""Built-in formats by name."""
RELATIVE: dict[str, Format] = {
    row.name: row
    for row in (
        Format("json", _BASE, "", False, "tools of your own", "relative.json", relative.write_json),
        Format("ros2", _BASE, "", False, "parameters of a ROS 2 node", "relative_ros2.yaml", relative.write_ros2),
    )
}
"""Formats of the base's difference from another model."""
_ALL: Table[Format] = Table("format", "equipoise.formats", Format, FORMATS)


@dataclass(frozen=True)
class Export:
    """Content of an exported file.

    Attributes:
        format: row of the format in the table, with the bodies and parts that were written.
        content: bytes of the file.
        file_name: default name of the file; it contains the parts if they are not the default ones.
        header: first lines of the file: body, quantities, frame, run and stance.
        notes: objections to the numbers, worst first.
        parts: parts of the result that were written, of "base", "sensors", "motors" and "legs".
        contents: sentence that states which of mass, CoM and inertia was written, and what the consumer cannot hold.
    """

    format: Format
    content: bytes
    file_name: str
    header: tuple[str, ...]
    notes: tuple[str, ...]
    parts: tuple[str, ...] = (BASE,)
    contents: str = ""

    @property
    def text(self) -> str:
        """Content as text; only edits of a user's file may not be UTF-8."""
        return self.content.decode()

    def save(self, path: str | Path) -> Path:
        """Write the file, whole or not at all, into an existing folder; raises OutputError."""
        write_file(Path(path), self.content)
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, without the content."""
        return {
            "equipoise": __version__,
            "format": self.format.name,
            "bodies": list(self.format.bodies),
            "parts": list(self.parts),
            "contents": self.contents,
            "about": list(self.header),
            "notes": list(self.notes),
        }


def export(
    result: Calibration,
    format: str,  # noqa: A002 - the usual name
    *,
    file: str | Path | None = None,
    payload_link: bool = False,
    force: bool = False,
    samples: int = 0,
    seed: int = 0,
    run: str = "",
    parameters: str | None = None,
    relative_to: RobotModel | None = None,
) -> Export:
    """Return a result in the form that a consumer reads.

    Args:
        result: result of a calibration; urdf and mjcf need its model, as in `RunFolder.result`.
        format: name of a format, as `find_format` takes it.
        file: user's file to edit; default for urdf and mjcf: the run's model file.
        payload_link: whether to write the payload as a separate link (urdf, mjcf, sdf).
        force: whether to write parameters that are not identified, with a note in the file.
        samples: number of drawn bodies to list (mjlab, isaaclab).
        seed: seed of all random draws.
        run: name of the run, for the file's header.
        parameters: parts to write: "base", "sensors", "motors", "legs", several separated by commas, or "all" that the
            format holds and the run estimated. Default: the base, or all if the format or the run lacks the base.
        relative_to: other model of the robot, of `relative.load_reference`; its base's difference is written (json, ros2).

    Raises:
        SettingsError: the format does not exist, or does not take an argument.
        NotEstimatedError: the method does not estimate what the format needs; or a value is not identified or not physical,
            a CoM lies outside the robot or a check failed, and `force` is false.
        ModelError: the model file has moved, has changed or cannot be edited.
    """
    row = find_format(format) if relative_to is None else _relative_format(format)
    _refuse_flags(row, file is not None, payload_link, samples, seed)
    parts = _parts(row, result, parameters)
    if (payload_link or samples) and BASE not in parts:
        raise SettingsError(
            f"--add-payload-link and --samples need the base, which --parameters {','.join(parts)} leaves out; add base"
        )
    if payload_link and LEGS in parts:
        raise SettingsError("--add-payload-link does not change the model's links: remove legs from --parameters")
    bodies = () if BASE not in parts else ("composite",) if payload_link else row.bodies
    notes = accept_bodies(result, bodies, force)
    columns, of_columns = accept_columns(result, [part for part in parts if part != BASE], force)
    notes = tuple(dict.fromkeys(notes + of_columns))
    users, about_file = _users_file(result, row, None if file is None else Path(file))
    subject = Subject(result, run, users, payload_link, samples, seed, notes + about_file, force, parts, columns)
    # A model file's base depends on its other links.
    own_base = "base" in bodies and row.file != "model" and relative_to is None
    outside = require_within_robot(subject, ("composite", "base") if own_base else bodies and ("composite",))
    base_notes = subject.base_and_notes[1] if own_base else ()
    subject = replace(subject, notes=outside + base_notes + subject.notes, reference=relative_to)
    contents = row.contents(bodies, subject) if relative_to is None else relative.contents(subject)
    subject = replace(subject, contents=contents)
    written = row.write(subject)
    name = Path(users.path.name if users else row.output)
    if parts != _parts(row, result, None):  # otherwise one part would overwrite another
        stem = () if name.stem == _FOUND_FILE else (name.stem,)  # that stem names parts already
        name = name.with_stem("_".join((*stem, *parts)))
    if payload_link:
        name = name.with_stem(f"{name.stem}_payload")
    header, notes = subject.header(written.about, *written.notes), written.notes + subject.notes
    row = replace(row, bodies=bodies, parts=parts)
    return Export(row, written.content, name.name, header, notes, parts, contents)


def export_all(
    result: Calibration,
    *,
    force: bool = False,
    seed: int = 0,
    run: str = "",
    parameters: str | None = None,
    relative_to: RobotModel | None = None,
) -> dict[str, Export | EquipoiseError]:
    """Return a result in every format that holds the parameters, by the format's name, or the error of that format.

    The arguments are those of `export`.
    """
    found: dict[str, Export | EquipoiseError] = {}
    for name, row in (all_formats() if relative_to is None else RELATIVE).items():
        if isinstance(row, EquipoiseError):
            found[name] = row
        elif parameters in (None, "all") or _words(parameters) <= set(row.parts):
            try:
                found[name] = export(
                    result, name, force=force, seed=seed, run=run, parameters=parameters, relative_to=relative_to
                )
            except EquipoiseError as error:
                found[name] = error
    return found


def find_format(name: str) -> Format:
    """Return a format, built in or added by an entry point.

    Raises:
        SettingsError: no format has the name, or two have.
        MissingDependencyError: the package that adds it cannot be used.
    """
    if name not in _ALL:
        raise SettingsError(f"{name!r} is not a format; {did_you_mean(name, _ALL)}it must be one of {', '.join(_ALL)}")
    return _ALL[name]


def _relative_format(name: str) -> Format:
    if name not in RELATIVE:
        raise SettingsError(f"--relative-to writes {' and '.join(RELATIVE)}, not {name!r}; leave out --to for both")
    return RELATIVE[name]


def all_formats() -> dict[str, Format | EquipoiseError]:
    """Return all formats by name, or the error of a format that cannot be used."""
    return _ALL.rows()


def _parts(row: Format, result: Calibration, parameters: str | None) -> tuple[str, ...]:
    """Return the requested parts in the format's order; raises SettingsError for one that it cannot hold."""
    available = tuple(part for part in row.parts if _has(result, part))
    if parameters is None and BASE in row.parts and (BASE in available or not available):
        return (BASE,)
    if parameters in (None, "all"):
        return available or row.parts  # the error then gives the reason
    words = _words(parameters)
    if lacking := words - set(row.parts):
        able = ", ".join(name for name, other in FORMATS.items() if words <= set(other.parts))
        raise SettingsError(
            f"--parameters {parameters}: {row.name} does not hold {' and '.join(sorted(lacking))}, only "
            f"{', '.join(row.parts)}; {able} hold it"
        )
    return tuple(part for part in row.parts if part in words)


def _words(parameters: str) -> set[str]:
    """Return parts by their names; raises SettingsError."""
    words = {word.strip() for word in parameters.split(",")}
    if wrong := sorted(words - set(_ALL_PARTS)):
        raise SettingsError(
            f"--parameters is {parameters!r}; {did_you_mean(wrong[0], _ALL_PARTS)}it must be {', '.join(_ALL_PARTS)}, "
            "several separated by commas, or all"
        )
    return words


def _has(result: Calibration, part: str) -> bool:
    """Return whether a run estimated a part."""
    if part != BASE:
        return bool(columns_of(result, part))
    return all(quantity.value is not None for quantity in result.composite)


def _refuse_flags(row: Format, file: bool, payload_link: bool, samples: int, seed: int) -> None:
    if file and not row.file:
        raise SettingsError(f"--file: format {row.name} edits no file; omit --file, and use its output for {row.where}")
    if payload_link and not row.payload:
        able = ", ".join(name for name, other in FORMATS.items() if other.payload)
        raise SettingsError(f"--add-payload-link: format {row.name} has no links; use {able}")
    if samples < 0 or (samples and not row.samples):
        able = " and ".join(name for name, other in FORMATS.items() if other.samples)
        raise SettingsError(f"--samples is {samples}; it must be zero or more, and only {able} list drawn bodies")
    if samples > DRAWS:
        raise SettingsError(f"--samples is {samples}; it must be at most {DRAWS}, the number of drawn bodies")
    if seed < 0:
        raise SettingsError(f"--seed is {seed}; it must be zero or more")


def _users_file(result: Calibration, row: Format, file: Path | None) -> tuple[UsersFile | None, tuple[str, ...]]:
    if row.file == "model":
        return find_users_file(result, row.name, file)
    if file is None:
        return None, ()
    try:
        return UsersFile(file, read_bytes(file)), ()
    except OSError as error:
        raise SettingsError(f"--file {str(file)!r} cannot be read: {error.strerror}") from error
