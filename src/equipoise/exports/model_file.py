"""The user's own model file: the link in it that is edited, and the new inertial of this link.

The link's own inertial gains the difference between the estimated robot and the file's robot. So the edited file has the
estimated composite, whatever else is fixed to its base.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from equipoise.errors import MissingDependencyError, ModelError, ModelWarning, SettingsError
from equipoise.exports.subject import PAYLOAD, FloatArray, Subject, UsersFile, seen_from
from equipoise.exports.xml_edit import Document
from equipoise.result.calibration import Calibration
from equipoise.robot.catalog import find_in_menagerie
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import InertialParameters, composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.links import FileLink, file_links, link_names
from equipoise.robot.model import RobotModel
from equipoise.robot.source import parse_model_source
from equipoise.user_file import read_bytes

_SAME_LEGS, _OTHER_LEGS = 0.003, 0.05  # of the leg length; files of one robot place its feet to a few millimetres
_CLOSE = 1e-9  # relative tolerance of the written file's composite to the estimated one


def find_users_file(result: Calibration, model_format: str, file: Path | None) -> tuple[UsersFile, tuple[str, ...]]:
    """Return the model file to edit, and notes on it.

    Raises:
        SettingsError: no file is named, and the result has no model or one of the other format.
        ModelError: it does not exist any more, or has changed since the run.
        MissingDependencyError: it is of the other format, and MuJoCo Menagerie's file is not available.
    """
    robot = result.robot_model
    if file is None:
        if robot is None:
            raise SettingsError("a calibration.json alone has no model file: name the run folder, or give --file")
        if robot.source.format != model_format:
            return _of_other_format(result.robot, robot.source.format, model_format)
        content = _read(robot.source.path, "; name it with --file")
        if hashlib.sha256(content).hexdigest() != robot.source.sha256:
            raise ModelError(
                f"the model file {str(robot.source.path)!r} has changed since the run; to edit its present content, "
                f"name it with --file {robot.source.path}"
            )
        return UsersFile(robot.source.path, content), ()
    content = _read(file, "")
    found = hashlib.sha256(content).hexdigest()
    other = (f"{file.name} is not the model file of the run: its sha256 is {found}",)
    return UsersFile(file, content), () if found == result.model["sha256"] else other


def _of_other_format(robot: str, present: str, wanted: str) -> tuple[UsersFile, tuple[str, ...]]:
    """Return MuJoCo Menagerie's file of a robot; raises SettingsError with a remedy if there is none."""
    remedy = (
        f"the run's model is {present.upper()}: export --to {present}, or name your {wanted.upper()} file of the same robot "
        "with --file"
    )
    try:
        path = find_in_menagerie(robot) if wanted == "mjcf" else None
    except MissingDependencyError as error:
        raise MissingDependencyError(
            f"{remedy}, or install MuJoCo Menagerie's files: pip install robot_descriptions"
        ) from error
    if path is None:
        raise SettingsError(remedy)
    return _borrowed(path)


def _borrowed(path: Path) -> tuple[UsersFile, tuple[str, ...]]:
    """Return a file that is not the user's, with the folders of its meshes in full, because it is written elsewhere."""
    content = _read(path, "")
    document = Document(content, path)
    folders = [
        document.set(compiler, name, str(path.parent.resolve() / compiler.attributes[name]))
        for compiler in document.root.all("compiler")
        for name in ("assetdir", "meshdir", "texturedir")
        if name in compiler.attributes
    ]
    note = f"the file is MuJoCo Menagerie's {path.name}, whose meshes stay in {path.parent.resolve()}"
    return UsersFile(path, document.edited(folders)), (note,)


def _read(path: Path, remedy: str) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise ModelError(f"the model file {str(path)!r} cannot be read: {error.strerror}{remedy}") from error


def read_robot(subject: Subject, content: bytes) -> RobotModel:
    """Return the robot of a file with this content, without warnings about repairs."""
    assert subject.file is not None
    original = subject.result.robot_model
    description = original.description if original is not None else RobotDescription()
    source = parse_model_source(content, subject.file.path, description.base_link)
    if original is not None:  # locked joints keep their positions
        source = replace(source, home=original.source.home)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return RobotModel.from_source(source, subject.result.robot, description)


def composite_of(subject: Subject, robot: RobotModel) -> InertialParameters:
    """Return the composite of a file's robot at the result's stance."""
    stance = robot.joint_vector(dict(subject.result.joint_position), "the run's stance")
    return composite_parameters(robot, stance)


def edited_link(robot: RobotModel, joint: int = 1) -> tuple[FileLink, FloatArray]:
    """Return the link whose inertial is edited: a joint's own, or, if that has no mass, the heaviest link fixed to it.

    Args:
        joint: Pinocchio's id of the joint in the full model; 1 is the base.

    Returns:
        the link; (10,) inertial parameters of the link alone in the joint's frame, Pinocchio's order, about its origin.
    """
    links = {link.name: link for link in file_links(robot.full_pinocchio) if link.joint == joint}
    own = links.get(link_names(robot.full_pinocchio).get(joint, ""))
    link = own or max(links.values(), key=lambda link: link.inertia.mass)
    return link, np.array(link.placement.act(link.inertia).toDynamicParameters())


def new_inertial(subject: Subject, robot: RobotModel) -> tuple[str, InertialParameters, tuple[str, ...], FloatArray]:
    """Return the base's edited link, its new body in its own frame, notes, and the (10,) resulting composite.

    Raises:
        NotEstimatedError: as `Subject.nearest_body` does.
    """
    link, vector = edited_link(robot)
    before, leg_notes = composite_of(subject, robot).vector, _other_legs(subject, robot)
    what = f"link {link.name!r} of {robot.source.path.name}, minus the other links,"
    remedy = "legs and links that are fixed or locked exceed the estimate, see 'equipoise audit'"
    body, notes = subject.nearest_body(vector + subject.composite.vector - before, what, remedy)
    return link.name, seen_from(body, link.placement), (*leg_notes, *notes), before + body.vector - vector


def _other_legs(subject: Subject, robot: RobotModel) -> tuple[str, ...]:
    """Return a note on a file whose feet are not where those of the run's model are.

    Raises:
        SettingsError: the distance is so large that the file is of another robot, or has other axes or joint offsets.
    """
    original = subject.result.robot_model
    if original is None:
        return ()
    apart = float(np.linalg.norm(feet_shift(robot, original, subject.result.joint_position), axis=1).max())
    text = f"at the stance the feet of {robot.source.path.name} are {1000 * apart:.1f} mm from those of the run's model"
    if apart > _OTHER_LEGS * original.leg_length:
        raise SettingsError(f"{text}: it is another robot's, or its base frame or joint offsets differ")
    return (text,) if apart > _SAME_LEGS * original.leg_length else ()


def feet_shift(robot: RobotModel, original: RobotModel, stance: Mapping[str, float]) -> FloatArray:
    """Return the (4, 3) feet of one model minus those of another, at one stance, each in its own base frame [m]."""
    here, there = (foot_positions(one, one.joint_vector(dict(stance), "the run's stance")) for one in (robot, original))
    return here - there


def payload(subject: Subject, composite: InertialParameters) -> tuple[InertialParameters, tuple[str, ...]]:
    """Return the payload of a robot with this composite, in the base frame, and notes on it.

    Raises:
        NotEstimatedError: as `Subject.nearest_body` does.
    """
    what = f"{PAYLOAD}, the difference from the model file,"
    remedy = "leave out --add-payload-link to change the base link instead"
    return subject.nearest_body(subject.composite.vector - composite.vector, what, remedy)


def require_composite(subject: Subject, content: bytes, wanted: FloatArray) -> None:
    """Check the composite of written content.

    Args:
        wanted: (10,) parameters of the composite that it must have.

    Raises:
        ModelError: its composite differs.
    """
    got = composite_of(subject, read_robot(subject, content)).vector
    if not np.allclose(got, wanted, rtol=_CLOSE, atol=_CLOSE * wanted[0]):
        raise ModelError(
            f"{str(subject.file and subject.file.path)!r} does not follow its <inertial> elements: "
            "remove <compiler inertiafromgeom='true'/> or a second <inertial>, if there is one"
        )
