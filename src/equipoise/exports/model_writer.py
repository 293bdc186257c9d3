"""Edits of bodies and joints in the user's own model file, for URDF and MJCF."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from equipoise.errors import ModelError, SettingsError
from equipoise.exports.model_file import composite_of, edited_link, new_inertial, payload, read_robot, require_composite
from equipoise.exports.parameters import BASE, LEGS, MOTORS
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, seen_from
from equipoise.exports.xml_edit import Document, Edit, Element
from equipoise.robot.forward import link_in_file
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.links import link_names
from equipoise.robot.model import RobotModel

_COMMENT = ("equipoise: mass and first moment as estimated, with the base",)
_LEGS = (
    "the leg links' <inertial> as estimated, each complete, values that are not identified close to the model's; their own "
    "inertias scaled with their masses, lengths unchanged"
)


@dataclass(frozen=True)
class ModelFormat:
    """One format of model files.

    Attributes:
        name: name of the format, "urdf" or "mjcf".
        link: name of a link's element.
        joints: words for the joint values that are written.
        attributes: name of each joint parameter by the attribute that holds it.
        find: function that returns the element of a link, by its name; the base's is given too.
        set_inertial: function that gives a link's element another inertial, with a comment before it.
        joints_of: function that returns the elements of all joints.
        set_joint: function that gives a joint's element the values of these attributes.
        add_link: function that adds a link that is fixed to the base, with a comment before it.
    """

    name: str
    link: str
    joints: str
    attributes: Mapping[str, str]
    find: Callable[[Document, str, str], Element]
    set_inertial: Callable[[Document, Element, InertialParameters, tuple[str, ...]], list[Edit]]
    joints_of: Callable[[Document], list[Element]]
    set_joint: Callable[[Document, Element, dict[str, str]], list[Edit]]
    add_link: Callable[[Document, str, InertialParameters, tuple[str, ...]], list[Edit]]


def write_model(subject: Subject, form: ModelFormat) -> Written:
    """Return the user's file with another inertial of the base, other joints and leg links, or with an additional link."""
    assert subject.file is not None
    robot = read_robot(subject, subject.file.content)
    if robot.source.format != form.name:
        raise SettingsError(f"{str(robot.source.path)!r} is {robot.source.format.upper()}, not {form.name.upper()}")
    if LEGS in subject.parts:
        subject = _with_legs(subject, robot, form)
        assert subject.file is not None
        robot = read_robot(subject, subject.file.content)
    document = Document(subject.file.content, subject.file.path)
    write = _write_joints if BASE not in subject.parts else _write_payload if subject.payload_link else _write_base
    return write(document, subject, robot, form)


def _write_joints(document: Document, subject: Subject, robot: RobotModel, form: ModelFormat) -> Written:
    content = document.edited(_joint_edits(document, subject, form, subject.header(form.joints)))
    require_composite(subject, content, composite_of(subject, robot).vector)
    return Written(content, form.joints)


def _write_payload(document: Document, subject: Subject, robot: RobotModel, form: ModelFormat) -> Written:
    base_link, place = link_in_file(robot.base_link, robot.source.forward)
    about = (
        f"{form.link} {PAYLOAD!r}, fixed to base {form.link} {base_link!r}, is the robot's difference from the model file, "
        f"in that {form.link}'s frame; nothing else was changed"
    )
    before = composite_of(subject, robot)
    body, notes = payload(subject, before)
    refuse_second_payload(document, document.root, form.link)
    edits = form.add_link(document, base_link, seen_from(body, place), subject.header(about, *notes))
    content = document.edited(edits)
    require_composite(subject, content, before.vector + body.vector)
    return Written(content, about, notes)


def _write_base(document: Document, subject: Subject, robot: RobotModel, form: ModelFormat) -> Written:
    link, body, notes, composite = new_inertial(subject, robot)
    others = {LEGS: _LEGS, MOTORS: form.joints}
    about = (
        f"the <inertial> of {form.link} {link!r}, such that the whole robot has the estimated composite; "
        f"{'; '.join(words for part, words in others.items() if part in subject.parts) or 'nothing else was changed'}"
    )
    element = form.find(document, link, robot.base_link)
    edits = form.set_inertial(document, element, body, subject.header(about, *notes))
    content = document.edited([*edits, *_joint_edits(document, subject, form)])
    require_composite(subject, content, composite)
    return Written(content, about, notes)


def _joint_edits(document: Document, subject: Subject, form: ModelFormat, header: tuple[str, ...] = ()) -> list[Edit]:
    """Return edits of the joints with an estimate that the format holds, with a comment before the first of them.

    Raises:
        ModelError: the file itself does not hold such a joint.
    """
    columns = {attribute: subject.column(name) for attribute, name in form.attributes.items()}
    joints = {joint.attributes.get("name"): joint for joint in form.joints_of(document)}
    edits: list[Edit] = []
    for name in subject.joints:
        values = {key: number(max(0.0, column[name])) for key, column in columns.items() if name in column}
        if values and name not in joints:
            raise ModelError(
                f"{str(document.path)!r} does not hold joint {name!r} by that name but includes it; write a single file "
                "with a name for each joint, and name it with --file"
            )
        if values:
            edits += [document.comment(joints[name], header)] if header and not edits else []
            edits += form.set_joint(document, joints[name], values)
    return edits


def refuse_second_payload(document: Document, within: Element, link: str) -> None:
    """Raise SettingsError if the file already has the payload of an earlier export.

    Args:
        link: name of a link's element.
    """
    if any(element.tag == link and element.attributes.get("name") == PAYLOAD for element in within.walk()):
        raise SettingsError(f"{str(document.path)!r} has a {link} {PAYLOAD!r} already; use the file without it")


def _with_legs(subject: Subject, robot: RobotModel, form: ModelFormat) -> Subject:
    """Return the subject with the estimated leg links in its file.

    Args:
        robot: robot of the unchanged file.

    Raises:
        SettingsError: legs are requested without the base, which was estimated with them.
        ModelError: the file has other links than the run's.
        NotEstimatedError: as `Subject.nearest_body` does.
    """
    if BASE not in subject.parts:
        raise SettingsError("legs are estimated together with the base: write both, with --parameters base,legs")
    assert subject.file is not None
    document = Document(subject.file.content, subject.file.path)
    edits = [
        edit
        for name, body in _leg_links(subject, robot)
        for edit in form.set_inertial(document, form.find(document, name, robot.base_link), body, _COMMENT)
    ]
    return replace(subject, file=replace(subject.file, content=document.edited(edits)))


def _leg_links(subject: Subject, robot: RobotModel) -> Iterator[tuple[str, InertialParameters]]:
    """Yield the names of the edited links, and the new body of each, in its own frame.

    A link and all that is fixed to it then have the estimated mass and first moment. Their inertia about the CoM is scaled
    with the mass.
    """
    model, estimated = robot.full_pinocchio, subject.result.links
    names = link_names(model)
    for leg in robot.legs.values():
        for joint in map(model.getJointId, leg.joint_names):
            if (name := names.get(joint, "")) not in estimated:
                raise ModelError(f"{robot.source.path.name} has a leg link {name!r}, which is not in the run")
            edited, own = edited_link(robot, joint)
            total, body = model.inertias[joint], estimated[name]
            mass = float(body.mass.value or total.mass)
            moment = np.array([one.value for one in body.moment], dtype=float)
            wanted = InertialParameters(mass, moment / mass, mass / total.mass * np.array(total.inertia))
            what = f"link {edited.name!r} of {robot.source.path.name}"
            vector = own + wanted.vector - np.array(total.toDynamicParameters())
            nearest, _ = subject.nearest_body(vector, what, "links that are fixed to it exceed the estimate")
            yield edited.name, seen_from(nearest, edited.placement)
