"""The plan view: a robot, its support lines and its centre of mass from above, in the base frame, x forward, y left.

What is in it and where is decided here, once; pictures, the report and the live view only draw it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import SupportPlane
from equipoise.figures.geometry import Mesh, robot_meshes
from equipoise.figures.lift_planes import LiftPlanes
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_SMALLEST, _WIDEST = 0.003, 0.060  # [m] from the middle of the close-up to its edge
_UPRIGHT = 0.1  # of a plane's normal that must be level for its cut to mean anything
_FAINTEST = 0.35  # weight of the first lift of a bisection


@dataclass(frozen=True, eq=False)
class Ellipse:
    """What holds 95 % of a normal distribution in the plane.

    Attributes:
        major, minor: half axes [m].
        angle: angle of the major axis, from x towards y [rad].
    """

    major: float
    minor: float
    angle: float

    @classmethod
    def of(cls, covariance: FloatArray) -> Ellipse:
        """From a (2, 2) covariance of x and y [m2]."""
        directions, (minor, major) = ellipsoid_95(covariance)
        return cls(float(major), float(minor), float(np.arctan2(directions[1, 1], directions[0, 1])))


@dataclass(frozen=True, eq=False)
class PlanMark:
    """A centre of mass.

    Attributes:
        kind: "found"; "model", by the model file; "truth", as simulated.
        label: words for it.
        position: (2,) x and y in the base frame [m].
        ellipse: ellipse that holds it with 95 %, or None.
        bracket: (2,) half sides along x and y of the box that brackets it [m], or None.
    """

    kind: Literal["found", "model", "truth"]
    label: str
    position: FloatArray
    ellipse: Ellipse | None = None
    bracket: FloatArray | None = None

    @property
    def reach(self) -> float:
        """How far it may be from its position [m]."""
        return 0.0 if self.ellipse is None else self.ellipse.major


@dataclass(frozen=True, eq=False)
class PlanLine:
    """A line, of one diagonal.

    Attributes:
        diagonal: "FL_RR" or "FR_RL".
        point: (2,) point on it, in the base frame [m].
        direction: (2,) unit vector along it, in the base frame.
        verdict: way that the robot tipped in this lift, "forward", "backward" or "balanced"; None: the CoM is on the line.
        weight: how solidly to draw it, above 0 up to 1: a bisection's lifts come nearer to the CoM one by one.
    """

    diagonal: str
    point: FloatArray
    direction: FloatArray
    verdict: str | None = None
    weight: float = 1.0

    @classmethod
    def cut(
        cls, diagonal: str, plane: SupportPlane, height: float, verdict: str | None = None, weight: float = 1.0
    ) -> PlanLine:
        """The line in which a support plane meets the horizontal plane at a height [m] in the base frame."""
        flat = plane.normal[:2]
        point = plane.point[:2] + flat * plane.normal[2] * (plane.point[2] - height) / (flat @ flat)
        return cls(diagonal, point, np.array([flat[1], -flat[0]]) / np.linalg.norm(flat), verdict, weight)

    def nearest_to(self, position: FloatArray) -> FloatArray:
        """(2,) its point nearest to a (2,) position [m]."""
        return self.point + self.direction * float(self.direction @ (position - self.point))

    def piece(self, centre: FloatArray, reach: float) -> FloatArray:
        """(2, 2) the ends of it that are a reach [m] to either side of its point nearest to a (2,) centre [m]."""
        return self.nearest_to(centre) + np.outer([-reach, reach], self.direction)


@dataclass(frozen=True, eq=False)
class PlanFoot:
    """A foot.

    Attributes:
        leg: "FL", "FR", "RL" or "RR".
        position: (2,) its centre, in the base frame [m].
        radius: its radius [m].
    """

    leg: str
    position: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class PlanOutline:
    """The robot at its nominal stance.

    Attributes:
        base: (n, 2) corners of the base's convex outline, in the base frame [m].
        legs: (n, 2) corners likewise, of each part of a leg.
        feet: all four, in the order of LEG_NAMES.
    """

    base: FloatArray
    legs: tuple[FloatArray, ...]
    feet: tuple[PlanFoot, ...]

    @classmethod
    def of(cls, robot: RobotModel, joint_position: FloatArray) -> PlanOutline:
        """At (nj,) joint positions [rad]."""
        meshes = robot_meshes(robot, joint_position)
        places = zip(LEG_NAMES, foot_positions(robot, joint_position), robot.legs.values(), strict=True)
        feet = tuple(PlanFoot(name, place[:2], leg.foot_radius) for name, place, leg in places)
        return cls(_hull(meshes.base), tuple(_hull([mesh]) for mesh in meshes.legs), feet)


@dataclass(frozen=True, eq=False)
class PlanView:
    """What is seen.

    Attributes:
        marks: centres of mass, those found first.
        centre: (2,) middle of the close-up, in the base frame [m].
        half_width: distance from there to its edges [m].
        lifts: line of each lift.
        support_lines: line of each diagonal.
        balanced: whether those are where the robot balances; else they run through its feet.
        outline: the robot; None: its model is not at hand.
        trail: (k, 2) estimates so far, in order, in the base frame [m].
    """

    marks: tuple[PlanMark, ...]
    centre: FloatArray
    half_width: float
    lifts: tuple[PlanLine, ...] = ()
    support_lines: tuple[PlanLine, ...] = ()
    balanced: bool = False
    outline: PlanOutline | None = None
    trail: FloatArray = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def found(self) -> list[PlanMark]:
        """The estimates."""
        return [mark for mark in self.marks if mark.kind == "found"]


def plan_view(results: Mapping[str, Calibration], lifts: LiftPlanes = ()) -> PlanView | None:
    """Of one result with model and truth, or of several over each other, of which the first one's robot is drawn.

    Args:
        results: results by the name to show.
        lifts: planes of all lifts, if there is one result.

    Returns:
        None if none knows where its CoM is in the plane.
    """
    known = {name: one for name, one in results.items() if np.isfinite(one.composite.com_in_base.values[:2]).all()}
    if not known:
        return None
    first, alone = next(iter(known.values())), len(results) == 1
    marks = [_found(result, "estimate" if alone else name) for name, result in known.items()]
    marks += _others(first) if alone else []
    robot, outline = first.robot_model, None
    if robot is not None:
        outline = PlanOutline.of(robot, np.array([first.joint_position[name] for name in robot.joint_names]))
    z = first.composite.com_in_base.z
    height = float(first.nominal.composite.com[2]) if z.value is None else z.value
    lines = _balanced(first, height) or ([] if outline is None else _through_feet(outline))
    return PlanView(
        tuple(marks), *_close_up(marks), tuple(_cuts(lifts, height)), tuple(lines), bool(first.support_lines), outline
    )


def _found(result: Calibration, label: str) -> PlanMark:
    covariance = result.composite.covariance
    ellipse = None if covariance is None else Ellipse.of(covariance[1:3, 1:3])
    return PlanMark("found", label, result.composite.com_in_base.values[:2], ellipse)


def _others(result: Calibration) -> list[PlanMark]:
    truth = [] if result.truth is None else [PlanMark("truth", "truth", result.truth.composite.com[:2])]
    return [PlanMark("model", "model file", result.nominal.composite.com[:2]), *truth]


def _close_up(marks: Sequence[PlanMark]) -> tuple[FloatArray, float]:
    """Middle and half width of a square that holds all marks, unless one is so far away that the others would be one dot.

    The truth is always in it: a result that is far off is to be seen as such.
    """
    centre = np.mean([mark.position for mark in marks if mark.kind == "found"], axis=0)
    away = [float(np.abs(mark.position - centre).max()) for mark in marks]
    whole = max(far + mark.reach for far, mark in zip(away, marks, strict=True))
    wanted = max(1.3 * max([*away, *(mark.reach for mark in marks)]), 1.1 * whole)
    truth = max((1.1 * far for far, mark in zip(away, marks, strict=True) if mark.kind == "truth"), default=0.0)
    return centre, max(_SMALLEST, min(_WIDEST, wanted), truth)


def _balanced(result: Calibration, height: float) -> list[PlanLine]:
    """Where each diagonal balances by the paper's search."""
    return [
        PlanLine.cut(name, SupportPlane(np.array(line.point), np.array(line.normal)), height)
        for name, line in result.support_lines.items()
    ]


def _through_feet(outline: PlanOutline) -> list[PlanLine]:
    at = {foot.leg: foot.position for foot in outline.feet}
    ends = {name: [at[leg] for leg in legs] for name, legs in DIAGONALS.items()}
    return [PlanLine(name, (a + b) / 2, (a - b) / np.linalg.norm(a - b)) for name, (a, b) in ends.items()]


def _cuts(lifts: LiftPlanes, height: float) -> list[PlanLine]:
    """The support planes of all lifts, cut at the height of the CoM [m]."""
    counts = Counter(lift.diagonal for lift in lifts)
    seen: Counter[str] = Counter()
    lines: list[PlanLine] = []
    for lift in lifts:
        later = (counts[lift.diagonal] - 1 - seen[lift.diagonal]) / max(1, counts[lift.diagonal] - 1)
        seen[lift.diagonal] += 1
        if np.linalg.norm(lift.plane.normal[:2]) > _UPRIGHT:
            weight = 1.0 if lift.verdict is None else 1 - (1 - _FAINTEST) * later
            lines.append(PlanLine.cut(lift.diagonal, lift.plane, height, lift.verdict, weight))
    return lines


def _hull(meshes: Sequence[Mesh]) -> FloatArray:
    """(n, 2) corners of the convex outline of meshes, seen from above [m]."""
    corners = np.concatenate([mesh.vertices for mesh in meshes])[:, :2]
    return corners[ConvexHull(corners).vertices]
