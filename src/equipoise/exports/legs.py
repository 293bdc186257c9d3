"""Leg links in the user's own model file: masses and first moments as found, before the base is made to fit them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from equipoise.errors import ModelError, SettingsError
from equipoise.exports.found import BASE, LEGS, MOTORS
from equipoise.exports.model_file import edited_link, read_robot
from equipoise.exports.subject import Subject, seen_from
from equipoise.exports.xml_edit import Document, Edit
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.links import link_names
from equipoise.robot.model import RobotModel

COMMENT = ("equipoise: mass and first moment as found, with the base",)
_LEGS = (
    "the leg links' <inertial> as found, each whole, what is not identified about as it was; their own inertias scaled with "
    "their masses, lengths as they were"
)


def what_else(subject: Subject, joints: str) -> str:
    """What is written beside the base's inertial, in words.

    Args:
        joints: words for what is written of joints.
    """
    parts = {LEGS: _LEGS, MOTORS: joints}
    return "; ".join(words for part, words in parts.items() if part in subject.parts) or "nothing else was changed"


def with_legs(
    subject: Subject, robot: RobotModel, edit: Callable[[Document, str, InertialParameters], list[Edit]]
) -> tuple[Subject, RobotModel]:
    """The subject with the leg links in its file as found, if they are asked for, and the robot that this file describes.

    Args:
        robot: robot that the file describes as it is.
        edit: function that gives a link, by its name, another inertial.

    Raises:
        SettingsError: legs are asked for without the base, which was found with them.
        ModelError: the file has other links than the run's.
        NotEstimatedError: no body near enough can be what a link gets, and that is not overridden.
    """
    if LEGS not in subject.parts:
        return subject, robot
    if BASE not in subject.parts:
        raise SettingsError("legs are found with the base that goes with them: write both, with --what base,legs")
    assert subject.file is not None
    document = Document(subject.file.content, subject.file.path)
    edits = [change for name, body in _leg_links(subject, robot) for change in edit(document, name, body)]
    content = document.edited(edits)
    subject = replace(subject, file=replace(subject.file, content=content))
    return subject, read_robot(subject, content)


def _leg_links(subject: Subject, robot: RobotModel) -> Iterator[tuple[str, InertialParameters]]:
    """Names of the links that are edited, and what each gets, in its own frame.

    A link and all that is fixed to it then have the mass and the first moment that were found, and an inertia about their
    CoM that went with the mass.
    """
    model, found = robot.full_pinocchio, subject.result.links
    names = link_names(model)
    for leg in robot.legs.values():
        for joint in map(model.getJointId, leg.joint_names):
            if (name := names.get(joint, "")) not in found:
                raise ModelError(f"{robot.source.path.name} has a leg link {name!r}, which the run knows nothing of")
            edited, total, body = edited_link(robot, joint), model.inertias[joint], found[name]
            mass = float(body.mass.value or total.mass)
            moment = np.array([one.value for one in body.moment], dtype=float)
            wanted = InertialParameters(mass, moment / mass, mass / total.mass * np.array(total.inertia))
            what = f"link {edited.name!r} of {robot.source.path.name}"
            vector = edited.vector + wanted.vector - np.array(total.toDynamicParameters())
            own, _ = subject.nearest_body(vector, what, "what is fixed to it takes more than there is")
            yield edited.name, seen_from(own, edited.placement)
