"""Findings about a model: unphysical, placeholder and asymmetric inertias, and missing limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.bodies import LinkInertial, RigidBody, hip_positions
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.inertial import InertialParameters, base_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.limits import limits_not_mirrored
from equipoise.robot.links import equal_round_moment, radius_of_gyration_of
from equipoise.robot.model import RobotModel
from equipoise.robot.shape_findings import coms_outside, trunk_unlike_its_shapes
from equipoise.robot.stance import Stance

Severity = Literal["error", "warning", "note"]
_SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

# A link with less than this share of its body's mass and inertia can be wrong without effect on a controller: the
# cameras of ANYmal C have 0.6 %, the thighs of the Mini Cheetah are their whole body.
_MATTERS = 0.05
# The rms distance of mass from its CoM is at most half the extent of its volume, and 0.29 of a rod's length. Parts
# reach past the joints, so half as much again is allowed; bodies of the catalogue have 0.10 to 0.51.
_LARGEST_RADIUS_RATIO = 0.75
# Steel [kg/m3]: motors and frames are steel and copper with much air, so no link is as compact as a solid steel ball.
# The most compact body of the catalogue, Laikago's hip, has a radius of gyration 40 % above the ball's.
_DENSEST = 7850.0
# Left and right are compared to 1 % in mass, 1 mm on an A1 (0.4 m legs) in CoM, the resolution of a calibration,
# and 2 % in inertia. Below that CAD exports differ by rounding (HyQ: 0.7 %).
_SAME_MASS, _SAME_COM_RATIO, _SAME_INERTIA = 0.01, 0.0025, 0.02
# Five times that is not rounding: 5 mm, or a twentieth of a link's mass.
_LOPSIDED = 5.0
# A stance whose feet or joints are less mirrored than this fraction of the leg length does not compare CoMs and axes.
_MIRRORED_POSTURE_RATIO = 0.0025
_FLIP_Y = np.array([1.0, -1.0, 1.0])
_SMALLEST_OFFSET = 1e-4  # [m]; a CoM this near the middle is in the middle for every purpose


@dataclass(frozen=True)
class ModelFinding:
    """Finding about a model.

    Attributes:
        severity: "error" unphysical, or cannot be calibrated; "warning" probably wrong; "note" correct, but worth knowing.
        body: the link, or several separated by commas; empty for the whole robot.
        text: statement about the links or the robot.
    """

    severity: Severity
    body: str
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.body}: {self.text}" if self.body else f"{self.severity}: {self.text}"


def find(
    robot: RobotModel,
    bodies: dict[int, RigidBody],
    links: list[LinkInertial],
    composite: InertialParameters | None,
    stance: Stance | None,
) -> tuple[ModelFinding, ...]:
    """Return all findings about a model, errors first.

    Args:
        bodies: base and leg links, by Pinocchio joint.
        links: links of the file that have mass.
        composite: inertial parameters of the whole robot at the stance; None without a stance.
        stance: the nominal stance.
    """
    impossible = [*_impossible_in_file(robot, links), *_impossible_as_read(bodies.values(), links)]
    if robot.defect_of_base is not None:
        impossible.append(ModelFinding("error", robot.base_link, robot.defect_of_base))
    suspects = {finding.body for finding in impossible}
    made_up = [
        *_placeholders([link for link in links if link.name not in suspects]),
        *_too_compact([body for body in bodies.values() if body.name not in suspects]),
    ]
    suspects |= {finding.body for finding in made_up}
    return _merged(
        [
            *impossible,
            *made_up,
            *_misplaced(robot, suspects),
            *_asymmetries(robot, bodies, stance),
            *_limits(robot),
            *_lateral_offsets(robot, composite),
            *_missing_limits(robot),
        ]
    )


def _impossible_in_file(robot: RobotModel, links: list[LinkInertial]) -> Iterator[ModelFinding]:
    """Yield findings about elements that the reader repaired (inertias) or ignored."""
    for repair in robot.source.repairs:
        for link in links:
            prefix = f"link {link.name!r} has "
            if repair.startswith(prefix):
                yield ModelFinding(_severity_of_impossible(link), link.name, repair.removeprefix(prefix))
                break
        else:
            yield ModelFinding("note", "", repair)


def _impossible_as_read(bodies: Iterable[RigidBody], links: list[LinkInertial]) -> Iterator[ModelFinding]:
    """Yield findings about unphysical values that the reader did not repair: MJCF inertias, and missing masses."""
    for link in links:
        defect = link.parameters.physical_defect()
        if defect is not None:
            yield ModelFinding(_severity_of_impossible(link), link.name, f"an inertia that no body can have: {defect}")
    for body in bodies:
        if body.mass <= 0:
            yield ModelFinding("error", body.name, "no mass, though it moves")


def _severity_of_impossible(link: LinkInertial) -> Severity:
    return "error" if max(link.mass_share, link.inertia_share) >= _MATTERS else "warning"


def _placeholders(links: list[LinkInertial]) -> Iterator[ModelFinding]:
    """Yield placeholder inertias: multiples of the identity, or too large for the link."""
    for link in links:
        reasons: list[str] = []
        moment = equal_round_moment(link.parameters.inertia)
        matters = link.inertia_share >= _MATTERS
        if moment is not None and matters:  # small round parts, as feet modelled as balls, are correct
            reasons.append(f"Ixx = Iyy = Izz = {moment:g} kg m2")
        radius = radius_of_gyration_of(link.parameters.mass, link.parameters.principal_moments)
        if radius > _LARGEST_RADIUS_RATIO * link.body.extent:
            reasons.append(
                f"{link.parameters.mass:g} kg with a radius of gyration of {radius * 1000:.0f} mm on a body that is "
                f"about {link.body.extent * 1000:.0f} mm long"
            )
        if reasons:
            share = "" if matters else f"; it is {link.inertia_share:.1%} of that body's inertia"
            text = f"an inertia that looks like a placeholder: {' and '.join(reasons)}{share}"
            yield ModelFinding("warning" if matters else "note", link.name, text)


def _too_compact(bodies: list[RigidBody]) -> Iterator[ModelFinding]:
    for body in bodies:
        radius = body.radius_of_gyration
        # A ball of radius r has the radius of gyration sqrt(3/5) r.
        ball = math.sqrt(0.6) * (3 * max(body.mass, 0.0) / (4 * math.pi * _DENSEST)) ** (1 / 3)
        if radius < ball:
            text = (
                f"an inertia too small for its mass: {body.mass:g} kg with a radius of gyration of "
                f"{radius * 1000:.1f} mm, where a solid steel ball of that mass has {ball * 1000:.1f} mm"
            )
            yield ModelFinding("warning", body.name, text)


def _misplaced(robot: RobotModel, suspects: set[str]) -> Iterator[ModelFinding]:
    for link, text in (*coms_outside(robot), *trunk_unlike_its_shapes(robot)):
        if link not in suspects:
            yield ModelFinding("warning", link, text)


def _asymmetries(robot: RobotModel, bodies: dict[int, RigidBody], stance: Stance | None) -> Iterator[ModelFinding]:
    """Compare left leg links with right ones, mirrored in the vertical plane between the hips at the nominal stance."""
    # Without a stance the zero posture is used, if the legs are mirrored there, which is checked below.
    posture = np.zeros(len(robot.joint_names)) if stance is None else stance.joint_position
    middle = float(hip_positions(robot)[:, 1].mean())
    kinematics = Kinematics(robot)
    poses = kinematics.joint_poses(posture)
    feet = dict(zip(robot.legs, kinematics.foot_positions(posture), strict=True))
    for left, right in ((robot.legs["FL"], robot.legs["FR"]), (robot.legs["RL"], robot.legs["RR"])):
        points_left, points_right = (
            np.array([*(poses[joint].translation for joint in leg.joint_ids), feet[leg.name]]) for leg in (left, right)
        )
        gap = np.linalg.norm(points_left - _mirror_points(points_right, middle), axis=1).max()
        placed = bool(gap <= _MIRRORED_POSTURE_RATIO * robot.leg_length)
        if not placed and stance is not None:
            text = f"the {left.name} and {right.name} legs are {gap * 1000:.1f} mm from mirror images at the stance"
            yield ModelFinding("note", "", f"{text}: of their links only masses and principal moments were compared")
        for one, other in zip(left.joint_ids, right.joint_ids, strict=True):
            finding = _compare_sides(robot, poses, (one, other), middle, placed)
            if finding is not None:
                severity, text = finding
                yield ModelFinding(severity, f"{bodies[one].name}, {bodies[other].name}", text)


def _compare_sides(
    robot: RobotModel, poses: list[pin.SE3], joints: tuple[int, int], middle: float, placed: bool
) -> tuple[Severity, str] | None:
    """Compare the bodies of a left and a right joint; None if they are mirror images in the plane y = middle [m].

    If the legs are not `placed` as mirror images, only masses and principal moments are compared.
    """
    left, right = (
        InertialParameters.from_pinocchio(poses[joint].act(robot.pinocchio.inertias[joint])) for joint in joints
    )
    mirrored = _mirror(right, middle)
    mass = abs(left.mass - right.mass) / max(left.mass, right.mass, 1e-12)
    com = float(np.linalg.norm(left.com - mirrored.com)) if placed else 0.0
    difference = left.inertia - mirrored.inertia if placed else left.principal_moments - right.principal_moments
    inertia = float(np.linalg.norm(difference)) / max(float(np.linalg.norm(left.inertia)), 1e-12)
    scores = (mass / _SAME_MASS, com / (_SAME_COM_RATIO * robot.leg_length), inertia / _SAME_INERTIA)
    if max(scores) < 1:
        return None
    parts = (
        f"masses {left.mass:g} and {right.mass:g} kg",
        f"CoMs {com * 1000:.1f} mm from being mirrored"
        + _copied([poses[joint] for joint in joints], (left, right), com),
        f"inertias {inertia:.1%} from being mirrored" if placed else f"principal moments {inertia:.1%} apart",
    )
    text = "; ".join(part for part, score in zip(parts, scores, strict=True) if score >= 1)
    return ("warning" if max(scores) >= _LOPSIDED else "note"), f"left and right are not mirror images: {text}"


def _copied(poses: list[pin.SE3], sides: tuple[InertialParameters, InertialParameters], com: float) -> str:
    """Return a remark if both links have one CoM, copied from side to side without a change of the sign of y."""
    left, right = (side.com - np.array(pose.translation) for side, pose in zip(sides, poses, strict=True))
    same = np.linalg.norm(left - right) < 0.01 * com
    return f" (both at y = {left[1] * 1000:+.1f} mm from their joints; is a minus missing?)" if same else ""


def _mirror_points(points: FloatArray, middle: float) -> FloatArray:
    return points * _FLIP_Y + np.array([0.0, 2 * middle, 0.0])


def _mirror(body: InertialParameters, middle: float) -> InertialParameters:
    """Return a body mirrored in the plane y = middle of the base frame."""
    return InertialParameters(body.mass, _mirror_points(body.com, middle), body.inertia * np.outer(_FLIP_Y, _FLIP_Y))


def _lateral_offsets(robot: RobotModel, composite: InertialParameters | None) -> Iterator[ModelFinding]:
    """Yield offsets of the CoMs and of the hips from the base frame's middle; y points left."""
    named = [("the whole robot", composite), (f"the base ({robot.base_link})", base_parameters(robot))]
    offsets = [(what, float(body.com[1])) for what, body in named if body is not None]
    if max(abs(y) for _, y in offsets) >= _SMALLEST_OFFSET:
        text = " and ".join(f"{y * 1000:+.1f} mm for {what}" for what, y in offsets)
        yield ModelFinding("note", "", f"y of the CoM in the base frame (positive: left) is {text}")
    middle = float(hip_positions(robot)[:, 1].mean())
    if abs(middle) >= _SMALLEST_OFFSET:
        yield ModelFinding("note", "", f"the hips' middle is at y = {middle * 1000:+.1f} mm in the base frame")


def _limits(robot: RobotModel) -> Iterator[ModelFinding]:
    """Yield position limits that are not mirrored, and joints without any."""
    for text in limits_not_mirrored(robot.pinocchio, robot.legs, robot.leg_length):
        yield ModelFinding("warning", "", text)
    spans = zip(robot.joint_names, robot.lower_limit, robot.upper_limit, strict=True)
    endless = [name for name, low, high in spans if max(low, -high) <= -UNLIMITED_JOINT_RANGE]
    if endless:
        which = "all leg joints" if len(endless) == len(robot.joint_names) else ", ".join(endless)
        text = f"no position limit within two turns of {which}; joint_limits in a robot configuration sets one"
        yield ModelFinding("note", "", text)


def _missing_limits(robot: RobotModel) -> Iterator[ModelFinding]:
    """Yield leg joints without plausible torque or speed limits for the guard. MJCF has no speed limits."""
    urdf = robot.source.format == "urdf"
    place = "effort [Nm] of their <limit>" if urdf else "forcerange [Nm] of their actuators"
    limits = [("torque", robot.effort_limit, "excessive torques", place)]
    if urdf:
        place = "velocity [rad/s] of their <limit>"
        limits.append(("speed", robot.velocity_limit, "excessive speeds or jumps of targets", place))
    for what, limit, unseen, place in limits:
        joints = [name for name, most in zip(robot.joint_names, limit, strict=True) if not math.isfinite(most)]
        if joints:
            which = "any leg joint" if len(joints) == len(robot.joint_names) else ", ".join(joints)
            text = f"no plausible {what} limit of {which}: the guard cannot detect {unseen}; give it as {place}"
            yield ModelFinding("warning", "", text)


def _merged(findings: list[ModelFinding]) -> tuple[ModelFinding, ...]:
    """Return findings with the errors first, and equal findings about several links merged."""
    bodies: dict[tuple[Severity, str], list[str]] = {}
    for finding in findings:
        bodies.setdefault((finding.severity, finding.text), []).append(finding.body)
    merged = [ModelFinding(severity, ", ".join(names), text) for (severity, text), names in bodies.items()]
    return tuple(sorted(merged, key=lambda finding: _SEVERITIES.index(finding.severity)))
