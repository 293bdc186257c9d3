"""What a model file says of a robot's inertia, and what speaks against it: impossible, made-up and lopsided numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.errors import ReachError
from equipoise.robot.inertial import InertialParameters, base_parameters, nominal_inertia
from equipoise.robot.model import Leg, RobotModel
from equipoise.robot.source import NEGLIGIBLE_MASS_FRACTION
from equipoise.robot.stance import Stance, nominal_stance

FloatArray = NDArray[np.float64]
Severity = Literal["error", "warning", "note"]
_SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

# A link with less than this share of its body's mass and inertia can be wrong without a controller feeling it: the
# cameras of ANYmal C have 0.6 %, the thighs of the Mini Cheetah are their whole body.
_MATTERS = 0.05
# The rms distance of mass from its CoM is at most half the extent of what it fills, and 0.29 of a rod's length. Parts
# reach past the joints, so half as much again is allowed; bodies of the catalogue have 0.10 to 0.51.
_LARGEST_RADIUS_RATIO = 0.75
# A hip's two joints can be 14 mm apart (Solo) and its motors are far larger: no leg link counts as smaller than this
# fraction of the leg length.
_SMALLEST_EXTENT_RATIO = 0.25
# Steel [kg/m3]: motors and frames are steel and copper with much air, so no link is as compact as a solid steel ball.
# The most compact body of the catalogue, Laikago's hip, has a radius of gyration 40 % above the ball's.
_DENSEST = 7850.0
# Files print 4 to 9 digits, and a link's own inertia is found by subtracting what is fixed to it.
_EQUAL = 1e-6
# Left and right are compared to 1 % in mass, 1 mm on an A1 (0.4 m legs) in CoM, which is what a calibration resolves,
# and 2 % in inertia. Below that CAD exports differ by rounding (HyQ: 0.7 %).
_SAME_MASS, _SAME_COM_RATIO, _SAME_INERTIA = 0.01, 0.0025, 0.02
# Five times that is no rounding: 5 mm, or a twentieth of a link's mass.
_LOPSIDED = 5.0
# A stance whose feet or joints are less mirrored than this fraction of the leg length does not compare CoMs and axes.
_MIRRORED_POSTURE_RATIO = 0.0025
_FLIP_Y = np.array([1.0, -1.0, 1.0])
_SMALLEST_OFFSET = 1e-4  # [m]; a CoM this near the middle is in the middle for every purpose


@dataclass(frozen=True)
class Finding:
    """Something about a model that its user should know.

    Attributes:
        severity: "error" no robot can be so, or none can be calibrated so; "warning" it is probably wrong; "note" it is
            so, and worth knowing.
        body: the link it is about, or several with commas between; empty for the whole robot.
        text: what the links have, or what is the case.
    """

    severity: Severity
    body: str
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.body}: {self.text}" if self.body else f"{self.severity}: {self.text}"


@dataclass(frozen=True, eq=False)
class Body:
    """A body that moves as one: the base, or a leg link, with what is fixed to it.

    Attributes:
        name: of its link.
        mass: [kg].
        com_in_link: (3,) in the link's own frame, which for the base is the base frame [m].
        principal_moments: (3,) about the CoM, ascending [kg m2].
        extent: how long it is about: from its joint to the next one or the foot, or from hip to opposite hip [m].
    """

    name: str
    mass: float
    com_in_link: FloatArray
    principal_moments: FloatArray
    extent: float

    def __post_init__(self) -> None:
        self.com_in_link.setflags(write=False)
        self.principal_moments.setflags(write=False)

    @property
    def radius_of_gyration(self) -> float:
        """Root mean square distance of its mass from its CoM, sqrt(tr(I) / 2m) [m]; 0 without mass."""
        return _radius_of_gyration(self.mass, self.principal_moments)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "name": self.name,
            "mass": self.mass,
            "com_in_link": self.com_in_link.tolist(),
            "principal_moments": self.principal_moments.tolist(),
            "radius_of_gyration": self.radius_of_gyration,
            "extent": self.extent,
        }


@dataclass(frozen=True, eq=False)
class Audit:
    """What a model file says, and what speaks against it.

    Attributes:
        robot: its name.
        mass: of the whole robot [kg].
        base_link: name of the base link.
        base: with everything fixed to it, in the base frame.
        composite: the whole robot frozen at the nominal stance, in the base frame; None without a stance.
        stance_effective: base, hips and thighs at the nominal stance; None without a stance.
        stance: the nominal stance, or None; a finding says why.
        joint_names: (nj) of the stance's joint positions.
        bodies: the base, then the leg links in joint order.
        findings: errors first.
    """

    robot: str
    mass: float
    base_link: str
    base: InertialParameters
    composite: InertialParameters | None
    stance_effective: InertialParameters | None
    stance: Stance | None
    joint_names: tuple[str, ...]
    bodies: tuple[Body, ...]
    findings: tuple[Finding, ...]

    @property
    def ratio_composite_over_base(self) -> tuple[float, float, float] | None:
        """Ixx, Iyy and Izz of the composite over the base's, each about its own CoM; None where there is none."""
        moments = self.base.inertia.diagonal()
        if self.composite is None or moments.min() <= 0:
            return None
        x, y, z = (float(value) for value in self.composite.inertia.diagonal() / moments)
        return x, y, z

    @property
    def ratio_sentence(self) -> str | None:
        """The factor that a base inertia is often multiplied by in the hope of a composite one, in words."""
        ratio = self.ratio_composite_over_base
        if ratio is None:
            return None
        x, y, z = ratio
        return f"the composite's Ixx, Iyy, Izz are {x:.1f}, {y:.1f} and {z:.1f} x the base's (link {self.base_link!r})"

    def to_dict(self) -> dict[str, Any]:
        """JSON form; null where there is no stance."""
        ratio = self.ratio_composite_over_base
        return {
            "robot": self.robot,
            "mass": self.mass,
            "base_link": self.base_link,
            "composite": None if self.composite is None else _parameters_to_dict(self.composite),
            "base": _parameters_to_dict(self.base),
            "stance_effective": None if self.stance_effective is None else _parameters_to_dict(self.stance_effective),
            "ratio_composite_over_base": None if ratio is None else list(ratio),
            "bodies": [body.to_dict() for body in self.bodies],
            "findings": [{"severity": f.severity, "body": f.body, "text": f.text} for f in self.findings],
            "stance": None if self.stance is None else _stance_to_dict(self.stance, self.joint_names),
        }


def audit(robot: RobotModel) -> Audit:
    """Check the inertias of a model: those that no body can have, placeholders, and left against right.

    Front and rear legs may differ; many robots' do.

    Raises:
        SettingsError: the robot description gives a stance that cannot be used.
    """
    stance, findings = _find_stance(robot)
    inertia = None if stance is None else nominal_inertia(robot, stance.joint_position)
    bodies = {joint: _body(robot, joint) for joint in range(1, robot.pinocchio.njoints)}
    links = list(_links(robot, bodies))
    impossible = [*_impossible_in_file(robot, links), *_impossible_as_read(bodies.values(), links)]
    suspects = {finding.body for finding in impossible}
    composite = None if inertia is None else inertia.composite
    findings += [
        *impossible,
        *_placeholders([link for link in links if link.name not in suspects]),
        *_too_compact([body for body in bodies.values() if body.name not in suspects]),
        *_asymmetries(robot, bodies, stance),
        *_lateral_offsets(robot, composite),
    ]
    return Audit(
        robot=robot.name,
        mass=robot.mass,
        base_link=robot.base_link,
        base=base_parameters(robot),
        composite=composite,
        stance_effective=None if inertia is None else inertia.stance_effective,
        stance=stance,
        joint_names=robot.joint_names,
        bodies=tuple(bodies.values()),
        findings=_merged(findings),
    )


def _find_stance(robot: RobotModel) -> tuple[Stance | None, list[Finding]]:
    try:
        return nominal_stance(robot), []
    except ReachError as error:
        return None, [Finding("error", "", f"it has no nominal stance, so its composite inertia is unknown: {error}")]


# What moves, and the links it is made of


@dataclass(frozen=True, eq=False)
class _Link:
    """A link of the file that has mass, and the body that it moves with."""

    name: str
    body: Body
    parameters: InertialParameters

    @property
    def mass_share(self) -> float:
        """Of its body's."""
        return self.parameters.mass / self.body.mass if self.body.mass > 0 else 1.0

    @property
    def inertia_share(self) -> float:
        """Its own moments, about its own CoM, of its body's."""
        total = float(self.body.principal_moments.sum())
        return float(np.trace(self.parameters.inertia)) / total if total > 0 else 1.0


def _body(robot: RobotModel, joint: int) -> Body:
    inertia = robot.pinocchio.inertias[joint]
    com = np.array(inertia.lever)
    if joint == 1:
        name, extent = robot.base_link, _hip_diagonal(robot)
    else:
        name = _link_names(robot.full_pinocchio)[robot.full_pinocchio.getJointId(robot.pinocchio.names[joint])]
        # Mass is balanced about the CoM, so a body reaches about as far past it as its joint is before it.
        reach = 2 * float(np.linalg.norm(com))
        extent = max(_distance_to_next(robot, joint), reach, _SMALLEST_EXTENT_RATIO * robot.leg_length)
    return Body(name, float(inertia.mass), com, np.linalg.eigvalsh(np.array(inertia.inertia)), extent)


def _hip_diagonal(robot: RobotModel) -> float:
    """From a leg's first joint to the diagonally opposite one, on average [m]."""
    hips = _hips(robot)
    return 2 * float(np.linalg.norm(hips - hips.mean(axis=0), axis=1).mean())


def _hips(robot: RobotModel) -> FloatArray:
    """(4, 3) first joints of the legs FL FR RL RR in the base frame [m]."""
    return np.array([robot.pinocchio.jointPlacements[leg.joint_ids[0]].translation for leg in robot.legs.values()])


def _distance_to_next(robot: RobotModel, joint: int) -> float:
    """From a leg joint to the next one, or to the foot [m]."""
    leg = next(leg for leg in robot.legs.values() if joint in leg.joint_ids)
    place = leg.joint_ids.index(joint) + 1
    if place < len(leg.joint_ids):
        return float(np.linalg.norm(robot.pinocchio.jointPlacements[leg.joint_ids[place]].translation))
    return float(np.linalg.norm(robot.pinocchio.frames[leg.foot_frame_id].placement.translation))


def _link_names(model: pin.Model) -> dict[int, str]:
    """Name of the link that each joint moves, without those fixed to it."""
    return {
        int(frame.parentJoint): str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and model.frames[frame.parentFrame].type == pin.FrameType.JOINT
    }


def _links(robot: RobotModel, bodies: dict[int, Body]) -> Iterator[_Link]:
    """Every link that has mass, as the file gives it. Pinocchio keeps fixed links' inertias on their joints' frames.

    The model before joints were held is asked, for a held arm's links are links too; they belong to the base.
    """
    model = robot.full_pinocchio
    body_of = {robot.pinocchio.names[joint]: body for joint, body in bodies.items()}
    fixed_names = {frame.parentFrame: str(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY}
    own_names = _link_names(model)
    for joint in range(1, model.njoints):
        body = body_of.get(model.names[joint], bodies[1])
        own = pin.Inertia(model.inertias[joint])
        for index, frame in enumerate(model.frames):
            if frame.parentJoint == joint and frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass > 0:
                own -= frame.placement.act(frame.inertia)
                name = fixed_names.get(index, str(frame.name))
                yield _Link(name, body, InertialParameters.from_pinocchio(frame.inertia))
        if own.mass > NEGLIGIBLE_MASS_FRACTION * robot.mass:
            name = own_names.get(joint, str(model.names[joint]))
            yield _Link(name, body, InertialParameters.from_pinocchio(own))


# What speaks against them


def _impossible_in_file(robot: RobotModel, links: list[_Link]) -> Iterator[Finding]:
    """What the reader repaired (inertias) or passed over."""
    for repair in robot.source.repairs:
        for link in links:
            prefix = f"link {link.name!r} has "
            if repair.startswith(prefix):
                yield Finding(_severity_of_impossible(link), link.name, repair.removeprefix(prefix))
                break
        else:
            yield Finding("note", "", repair)


def _impossible_as_read(bodies: Iterable[Body], links: list[_Link]) -> Iterator[Finding]:
    """What the reader let pass: MJCF inertias are not repaired, and no reader invents a mass."""
    for link in links:
        defect = link.parameters.physical_defect()
        if defect is not None:
            yield Finding(_severity_of_impossible(link), link.name, f"an inertia that no body can have: {defect}")
    for body in bodies:
        if body.mass <= 0:
            yield Finding("error", body.name, "no mass, though it moves")


def _severity_of_impossible(link: _Link) -> Severity:
    return "error" if max(link.mass_share, link.inertia_share) >= _MATTERS else "warning"


def _placeholders(links: list[_Link]) -> Iterator[Finding]:
    """Inertias that somebody typed to satisfy a parser: the identity and its like, or too large for the link."""
    for link in links:
        reasons: list[str] = []
        moment = _equal_round_moment(link.parameters.inertia)
        matters = link.inertia_share >= _MATTERS
        if moment is not None and matters:  # small round parts, as feet taken for balls, are fair
            reasons.append(f"Ixx = Iyy = Izz = {moment:g} kg m2")
        radius = _radius_of_gyration(link.parameters.mass, link.parameters.principal_moments)
        if radius > _LARGEST_RADIUS_RATIO * link.body.extent:
            reasons.append(
                f"{link.parameters.mass:g} kg with a radius of gyration of {radius * 1000:.0f} mm on a body that is "
                f"about {link.body.extent * 1000:.0f} mm long"
            )
        if reasons:
            share = "" if matters else f"; it is {link.inertia_share:.1%} of that body's inertia"
            text = f"an inertia that looks like a placeholder: {' and '.join(reasons)}{share}"
            yield Finding("warning" if matters else "note", link.name, text)


def _equal_round_moment(inertia: FloatArray) -> float | None:
    """The value of an inertia v * identity whose v has one digit, as 1, 0.1 or 5e-4 [kg m2]; else None."""
    moment = float(np.trace(inertia)) / 3
    if moment <= 0 or np.abs(inertia - moment * np.eye(3)).max() > _EQUAL * moment:
        return None
    digits = moment / 10 ** math.floor(math.log10(moment * (1 + _EQUAL)))
    return moment if abs(digits - round(digits)) < 10 * _EQUAL else None


def _too_compact(bodies: list[Body]) -> Iterator[Finding]:
    for body in bodies:
        radius = body.radius_of_gyration
        # A ball of radius r has the radius of gyration sqrt(3/5) r.
        ball = math.sqrt(0.6) * (3 * max(body.mass, 0.0) / (4 * math.pi * _DENSEST)) ** (1 / 3)
        if radius < ball:
            text = (
                f"an inertia too small for its mass: {body.mass:g} kg with a radius of gyration of "
                f"{radius * 1000:.1f} mm, where a solid steel ball of that mass has {ball * 1000:.1f} mm"
            )
            yield Finding("warning", body.name, text)


def _asymmetries(robot: RobotModel, bodies: dict[int, Body], stance: Stance | None) -> Iterator[Finding]:
    """Left leg links against right ones, mirrored in the vertical plane between the hips at the nominal stance."""
    # Without a stance the zero posture serves, if the legs are mirrored there, which is looked at below.
    posture = np.zeros(len(robot.joint_names)) if stance is None else stance.joint_position
    middle = float(_hips(robot)[:, 1].mean())
    pin.framesForwardKinematics(robot.pinocchio, robot.pinocchio_data, robot.configuration(posture))
    for left, right in ((robot.legs["FL"], robot.legs["FR"]), (robot.legs["RL"], robot.legs["RR"])):
        points_left, points_right = _leg_points(robot, left), _leg_points(robot, right)
        apart = np.linalg.norm(points_left - _mirror_points(points_right, middle), axis=1).max()
        placed = bool(apart <= _MIRRORED_POSTURE_RATIO * robot.leg_length)
        if not placed and stance is not None:
            where = f"the {left.name} and {right.name} legs are {apart * 1000:.1f} mm from being mirrored at the stance"
            yield Finding("note", "", f"{where}: of their links only masses and principal moments were compared")
        for one, other in zip(left.joint_ids, right.joint_ids, strict=True):
            finding = _compare_sides(robot, (one, other), middle, placed)
            if finding is not None:
                severity, text = finding
                yield Finding(severity, f"{bodies[one].name}, {bodies[other].name}", text)


def _compare_sides(
    robot: RobotModel, joints: tuple[int, int], middle: float, placed: bool
) -> tuple[Severity, str] | None:
    """How the bodies of a left and a right joint differ, or None if they are mirror images in the plane y = middle [m].

    Pinocchio's data holds their placements. Where the legs are not `placed` as mirror images, only what does not depend
    on it is compared.
    """
    left, right = (_in_base(robot, joint) for joint in joints)
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
        f"CoMs {com * 1000:.1f} mm from being mirrored" + _copied(robot, joints, (left, right), com),
        f"inertias {inertia:.1%} from being mirrored" if placed else f"principal moments {inertia:.1%} apart",
    )
    text = "; ".join(part for part, score in zip(parts, scores, strict=True) if score >= 1)
    return ("warning" if max(scores) >= _LOPSIDED else "note"), f"left and right are no mirror images: {text}"


def _copied(
    robot: RobotModel, joints: tuple[int, int], sides: tuple[InertialParameters, InertialParameters], com: float
) -> str:
    """Says so where both links have one CoM, copied from side to side without turning the sign of y."""
    origins = [np.array(robot.pinocchio_data.oMi[joint].translation) for joint in joints]
    left, right = (side.com - origin for side, origin in zip(sides, origins, strict=True))
    same = np.linalg.norm(left - right) < 0.01 * com
    return f" (both at y = {left[1] * 1000:+.1f} mm from their joints; is a minus missing?)" if same else ""


def _in_base(robot: RobotModel, joint: int) -> InertialParameters:
    return InertialParameters.from_pinocchio(robot.pinocchio_data.oMi[joint].act(robot.pinocchio.inertias[joint]))


def _leg_points(robot: RobotModel, leg: Leg) -> FloatArray:
    """(n + 1, 3) the joints of a leg and its foot in the base frame [m]."""
    data = robot.pinocchio_data
    joints = [np.array(data.oMi[joint].translation) for joint in leg.joint_ids]
    return np.array([*joints, np.array(data.oMf[leg.foot_frame_id].translation)])


def _mirror_points(points: FloatArray, middle: float) -> FloatArray:
    return points * _FLIP_Y + np.array([0.0, 2 * middle, 0.0])


def _mirror(body: InertialParameters, middle: float) -> InertialParameters:
    """Mirrored in the plane y = middle of the base frame."""
    return InertialParameters(body.mass, _mirror_points(body.com, middle), body.inertia * np.outer(_FLIP_Y, _FLIP_Y))


def _lateral_offsets(robot: RobotModel, composite: InertialParameters | None) -> Iterator[Finding]:
    """How far the CoMs are from the base frame's middle, and the hips if they are; y points left."""
    named = [("the whole robot", composite), (f"the base ({robot.base_link})", base_parameters(robot))]
    offsets = [(what, float(body.com[1])) for what, body in named if body is not None]
    if max(abs(y) for _, y in offsets) >= _SMALLEST_OFFSET:
        text = " and ".join(f"{y * 1000:+.1f} mm for {what}" for what, y in offsets)
        yield Finding("note", "", f"y of the CoM in the base frame (positive: left) is {text}")
    middle = float(_hips(robot)[:, 1].mean())
    if abs(middle) >= _SMALLEST_OFFSET:
        yield Finding("note", "", f"the hips' middle is at y = {middle * 1000:+.1f} mm in the base frame")


def _merged(findings: list[Finding]) -> tuple[Finding, ...]:
    """Errors first; what is said in the same words of several links is said once."""
    bodies: dict[tuple[Severity, str], list[str]] = {}
    for finding in findings:
        bodies.setdefault((finding.severity, finding.text), []).append(finding.body)
    merged = [Finding(severity, ", ".join(names), text) for (severity, text), names in bodies.items()]
    return tuple(sorted(merged, key=lambda finding: _SEVERITIES.index(finding.severity)))


def _radius_of_gyration(mass: float, moments: FloatArray) -> float:
    return math.sqrt(max(float(moments.sum()), 0.0) / (2 * mass)) if mass > 0 else 0.0


def _parameters_to_dict(parameters: InertialParameters) -> dict[str, Any]:
    return {
        "mass": parameters.mass,
        "com_in_base": parameters.com.tolist(),
        "inertia": parameters.inertia.tolist(),
    }


def _stance_to_dict(stance: Stance, joint_names: tuple[str, ...]) -> dict[str, Any]:
    position = [float(value) for value in stance.joint_position]
    return {"joint_position": dict(zip(joint_names, position, strict=True)), "hip_height": stance.hip_height}
