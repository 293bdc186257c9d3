"""URDF of a simulated robot: drawn leg errors and payload included, links fixed together as one."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.tree import joint_axis
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.payload import Payload


def urdf(robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None) -> ElementTree.Element:
    """Return the robot with payload and drawn legs as URDF: links "base", "JOINT_link" and "LEG_foot"."""
    model, legs = robot.pinocchio, LegErrors.of(robot, stance, errors)
    root = ElementTree.Element("robot", name=robot.name)
    base = model.inertias[1]
    if payload is not None:
        base = base + pin.Inertia.FromDynamicParameters(payload.parameters.vector)
    _link(root, "base", base)
    for number, leg in enumerate(robot.legs.values()):
        parent, shift = "base", legs.hip_shift[number]
        for name, joint in zip(leg.joint_names, leg.joints, strict=True):
            index = model.getJointId(name)
            own = model.inertias[index]
            mass = own.mass * float(errors.leg_mass_scale[joint])
            inertia = errors.leg_mass_scale[joint] * errors.leg_inertia_scale[joint] * np.array(own.inertia)
            link = f"{name}_link"
            _link(root, link, pin.Inertia(mass, own.lever + legs.com_shift[joint], inertia))
            place = model.jointPlacements[index]
            axis = np.array(pin.exp3(legs.axis_turn[joint])) @ joint_axis(model, index)
            _joint(root, name, parent, link, np.array(place.translation) + shift, place.rotation, axis)
            parent, shift = link, legs.end_shift[joint]
        placement = model.frames[leg.foot_frame_id].placement
        foot, radius = f"{leg.name}_foot", leg.foot_radius + float(legs.foot_radius[number])
        _joint(root, f"{foot}_joint", parent, foot, np.array(placement.translation) + shift, placement.rotation, None)
        collision = ElementTree.SubElement(_link(root, foot, None), "collision")
        ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), "sphere", radius=str(radius))
    return root


def _link(root: ElementTree.Element, name: str, body: pin.Inertia | None) -> ElementTree.Element:
    link = ElementTree.SubElement(root, "link", name=name)
    inertial = ElementTree.SubElement(link, "inertial")
    if body is None:  # a foot, whose mass belongs to its link; engines need a positive mass
        mass, com, moments, axes = 1e-9, np.zeros(3), np.full(3, 1e-12), np.eye(3)
    else:
        mass, com = body.mass, np.array(body.lever)
        moments, axes = np.linalg.eigh(np.array(body.inertia))
        axes[:, 2] *= np.linalg.det(axes)
    _origin(inertial, com, axes)
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    diagonal = dict(zip(("ixx", "iyy", "izz"), (repr(float(value)) for value in moments), strict=True))
    ElementTree.SubElement(inertial, "inertia", ixy="0", ixz="0", iyz="0", **diagonal)
    return link


def _joint(
    root: ElementTree.Element,
    name: str,
    parent: str,
    child: str,
    place: FloatArray,
    rotation: FloatArray,
    axis: FloatArray | None,
) -> None:
    """Add a joint; without an axis it is fixed."""
    joint = ElementTree.SubElement(root, "joint", name=name, type="fixed" if axis is None else "continuous")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    _origin(joint, place, rotation)
    if axis is not None:
        ElementTree.SubElement(joint, "axis", xyz=_numbers(axis))


def _origin(element: ElementTree.Element, place: FloatArray, rotation: FloatArray) -> None:
    angles = Rotation.from_matrix(rotation).as_euler("xyz")
    ElementTree.SubElement(element, "origin", xyz=_numbers(place), rpy=_numbers(angles))


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
