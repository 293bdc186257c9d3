"""Plan view of a robot, its support lines and its CoM, in the base frame (x forward, y left)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.spatial import ConvexHull

from equipoise.conventions import FloatArray
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.reading import planes_through_com
from equipoise.experiments.tilt import SupportPlane
from equipoise.figures.blocks import DASHES, INK, MUTED, ROBOT, SERIES, Figure, Trace, number, plain, short
from equipoise.figures.geometry import MOST_FACES_ON_PAGE, Mesh, at_posture, drawn_shapes
from equipoise.method.reading import LiftPlane
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_SMALLEST, _WIDEST = 0.003, 0.060  # [m] limits of the half width of the close-up
_UPRIGHT = 0.1  # smallest horizontal part of a plane's unit normal, for a well-defined cut
_MARKERS: dict[str, Trace] = {
    "model": {"color": MUTED, "size": 11, "symbol": "square-open", "line": {"width": 2}},
    "truth": {"color": INK, "size": 9, "symbol": "x-thin", "line": {"width": 2, "color": INK}},
}


@dataclass(frozen=True, eq=False)
class PlanMark:
    """Marker of a centre of mass.

    Attributes:
        kind: "found" (estimate), "model" (model file) or "truth" (simulation).
        label: name to show.
        position: (2,) x and y in the base frame [m].
        ellipse: (n, 2) points on the 95 % ellipse around it [m], or None.
    """

    kind: Literal["found", "model", "truth"]
    label: str
    position: FloatArray
    ellipse: FloatArray | None = None

    @property
    def words(self) -> str:
        """Label and position [mm]."""
        x, y = (number(value, 1000, ".2f") for value in self.position)
        return f"{self.label} x {x}, y {y} mm"

    @property
    def reach(self) -> float:
        """Major half axis of the 95 % ellipse [m]; zero without one."""
        return 0.0 if self.ellipse is None else float(np.linalg.norm(self.ellipse - self.position, axis=1).max())


@dataclass(frozen=True, eq=False)
class PlanLine:
    """Line of one diagonal.

    Attributes:
        diagonal: "FL_RR" or "FR_RL".
        point: (2,) point on the line, in the base frame [m].
        direction: (2,) unit vector along the line, in the base frame.
        verdict: direction in which the robot tipped, "forward", "backward" or "balanced"; None: the CoM is on the line.
    """

    diagonal: str
    point: FloatArray
    direction: FloatArray
    verdict: str | None = None

    @classmethod
    def cut(cls, diagonal: str, plane: SupportPlane, height: float, verdict: str | None = None) -> PlanLine:
        """Return the intersection of a support plane with the horizontal plane at a height [m] in the base frame."""
        flat = plane.normal[:2]
        point = plane.point[:2] + flat * plane.normal[2] * (plane.point[2] - height) / (flat @ flat)
        return cls(diagonal, point, np.array([flat[1], -flat[0]]) / np.linalg.norm(flat), verdict)

    def nearest_to(self, position: FloatArray) -> FloatArray:
        """Return the (2,) point of the line nearest to a (2,) position [m]."""
        return self.point + self.direction * float(self.direction @ (position - self.point))

    def piece(self, centre: FloatArray, reach: float) -> FloatArray:
        """Return the (2, 2) ends of a segment, `reach` [m] to either side of the point nearest to a (2,) centre [m]."""
        return self.nearest_to(centre) + np.outer([-reach, reach], self.direction)


@dataclass(frozen=True, eq=False)
class PlanView:
    """Robot, lines and marks from above.

    Attributes:
        marks: centres of mass, estimates first.
        centre: (2,) centre of the close-up, in the base frame [m].
        half_width: half width of the close-up [m].
        lifts: line of each lift.
        support_lines: line of each diagonal.
        balanced: True if the robot balances on these lines; False if they run through its feet.
        feet: (2,) centre of each foot [m], by leg; empty without the robot's model.
        outlines: (n, 2) corners of the convex outlines of the base and of each part of a leg [m]; empty without the model.
    """

    marks: tuple[PlanMark, ...]
    centre: FloatArray
    half_width: float
    lifts: tuple[PlanLine, ...] = ()
    support_lines: tuple[PlanLine, ...] = ()
    balanced: bool = False
    feet: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    outlines: tuple[FloatArray, ...] = ()

    @property
    def found(self) -> list[PlanMark]:
        """Marks of the estimates."""
        return [mark for mark in self.marks if mark.kind == "found"]


def plan_view(results: Mapping[str, Calibration]) -> PlanView | None:
    """Return the view of one result with its lifts, model and truth, or of several results with the first robot.

    Args:
        results: results by the name to show.

    Returns:
        None if no result has an estimate of CoM x and y.
    """
    located = {name: one for name, one in results.items() if np.isfinite(one.composite.com_in_base.values[:2]).all()}
    if not located:
        return None
    first, alone = next(iter(located.values())), len(results) == 1
    marks = [_found(result, "estimate" if alone else name) for name, result in located.items()]
    marks += _others(first) if alone else []
    feet, outlines = ({}, ()) if first.robot_model is None else _robot(first, first.robot_model)
    z = first.composite.com_in_base.z
    height = float(first.nominal.composite.com[2]) if z.value is None else z.value
    cuts = [
        PlanLine.cut(lift.diagonal, lift.plane, height, lift.verdict)
        for lift in (lift_planes(first) if alone else ())
        if np.linalg.norm(lift.plane.normal[:2]) > _UPRIGHT
    ]
    lines = _balanced(first, height) or _through_feet(feet)
    balanced = bool(first.support_lines)
    return PlanView(tuple(marks), *_close_up(marks), tuple(cuts), tuple(lines), balanced, feet, outlines)


def lift_planes(result: Calibration) -> Sequence[LiftPlane]:
    """Return the support planes of `paper` lifts, or the planes through the CoM from `bayesian` lifts.

    The result is empty without evidence, as from a JSON file.
    """
    evidence, robot = result.evidence, result.robot_model
    if isinstance(evidence, SearchEvidence):
        lifts = [(index, trial) for index, trial in enumerate(result.trials) if trial.kind == "lift"]
        return [
            LiftPlane(index, lift.about, tried.plane, lift.verdict)
            for (index, lift), tried in zip(lifts, evidence.lifts, strict=True)
            if tried.plane is not None
        ]
    if isinstance(evidence, PosteriorEvidence) and robot is not None:
        return planes_through_com(robot, result.nominal.composite.com, evidence.posterior.motions)
    return []


def _robot(result: Calibration, robot: RobotModel) -> tuple[dict[str, FloatArray], tuple[FloatArray, ...]]:
    """Return the feet and the outlines of a result's robot at its stance."""
    joint_position = np.array([result.joint_position[name] for name in robot.joint_names])
    shapes = at_posture(robot, drawn_shapes(robot, MOST_FACES_ON_PAGE), joint_position)
    base = [shape for shape in shapes if shape.part == "base"]
    legs = [[shape] for shape in shapes if shape.part != "base"]
    feet: dict[str, FloatArray] = dict(zip(LEG_NAMES, foot_positions(robot, joint_position)[:, :2], strict=True))
    return feet, tuple(_hull(part) for part in (base, *legs))


def _found(result: Calibration, label: str) -> PlanMark:
    covariance = result.composite.covariance
    position = result.composite.com_in_base.values[:2]
    return PlanMark("found", label, position, None if covariance is None else _ellipse(position, covariance[1:3, 1:3]))


def _ellipse(centre: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return (n, 2) points on the 95 % ellipse of a (2, 2) covariance around a centre."""
    directions, half_axes = ellipsoid_95(covariance)
    around = np.linspace(0, 2 * np.pi, 73)
    return centre + np.column_stack([np.sin(around), np.cos(around)]) * half_axes @ directions.T


def _others(result: Calibration) -> list[PlanMark]:
    truth = [] if result.truth is None else [PlanMark("truth", "truth", result.truth.composite.com[:2])]
    return [PlanMark("model", "model file", result.nominal.composite.com[:2]), *truth]


def _close_up(marks: Sequence[PlanMark]) -> tuple[FloatArray, float]:
    """Return centre and half width [m] of a square with all marks, without a distant model value.

    The truth is always inside, so that a large error is visible.
    """
    centre = np.mean([mark.position for mark in marks if mark.kind == "found"], axis=0)
    away = [float(np.abs(mark.position - centre).max()) for mark in marks]
    whole = max(far + mark.reach for far, mark in zip(away, marks, strict=True))
    wanted = max(1.3 * max([*away, *(mark.reach for mark in marks)]), 1.1 * whole)
    truth = max((1.1 * far for far, mark in zip(away, marks, strict=True) if mark.kind == "truth"), default=0.0)
    return centre, max(_SMALLEST, min(_WIDEST, wanted), truth)


def _balanced(result: Calibration, height: float) -> list[PlanLine]:
    """Return the line of each diagonal on which the robot balances, from the paper's search."""
    return [
        PlanLine.cut(name, SupportPlane(np.array(line.point), np.array(line.normal)), height)
        for name, line in result.support_lines.items()
    ]


def _through_feet(feet: Mapping[str, FloatArray]) -> list[PlanLine]:
    ends = {name: [feet[leg] for leg in legs] for name, legs in DIAGONALS.items() if feet}
    return [PlanLine(name, (a + b) / 2, (a - b) / np.linalg.norm(a - b)) for name, (a, b) in ends.items()]


def _hull(meshes: Sequence[Mesh]) -> FloatArray:
    """Return (n, 2) corners of the convex outline of meshes, seen from above [m]."""
    corners = np.concatenate([mesh.vertices for mesh in meshes])[:, :2]
    return corners[ConvexHull(corners).vertices]


def plan_figures(view: PlanView | None) -> list[Figure]:
    """Return figures of the robot from above, if its model is available, and of a close-up around the CoM."""
    if view is None:
        return []
    caption = f"{'; '.join(mark.words for mark in view.marks)}."
    layout = _frame(view.centre, view.half_width, b=150)
    layout["xaxis"]["title"], layout["yaxis"]["title"] = {"text": "y, left [mm]"}, {"text": "x, forward [mm]"}
    close_up = Figure("Around the centre of mass", caption, _around_com(view), layout, 430)
    return [_overview(view), close_up] if view.feet else [close_up]


def _overview(view: PlanView) -> Figure:
    """Return a figure of the robot, with the close-up marked as a square."""
    base, *legs = view.outlines
    feet = np.array(list(view.feet.values()))
    reach = np.abs(np.concatenate([*view.outlines, feet])).max(axis=0) * [1.1, 1.5]
    (x0, y0), (x1, y1) = 1000 * (view.centre - view.half_width), 1000 * (view.centre + view.half_width)
    square = {"type": "rect", "x0": y0, "x1": y1, "y0": x0, "y1": x1, "line": {"width": 1, "color": INK}}
    sides = ["middle left" if y > 0 else "middle right" for y in feet[:, 1]]
    dot = {"size": 11, "color": "#ffffff", "line": {"color": INK, "width": 1.4}}
    data = [
        *(_path(leg, "leg", 0, ROBOT, fill="toself", fillcolor=f"{ROBOT}55") for leg in legs),
        _path(base, "base", 1, ROBOT, fill="toself", fillcolor=f"{ROBOT}33"),
        *(_support_line(line, view, np.zeros(2), 2 * float(reach.max())) for line in view.support_lines),
        _path(feet, "feet", mode="markers+text", text=list(view.feet), textposition=sides, marker=dot),
        *(_mark(view, mark) for mark in view.found),
    ]
    layout = {**_frame(np.zeros(2), reach, b=30), "showlegend": False, "shapes": [square]}
    return Figure("Top view", "Feet, support lines and centre of mass; the forward direction is up.", data, layout, 430)


def _around_com(view: PlanView) -> list[Trace]:
    reach = 3 * view.half_width
    lifts: list[Trace] = []
    for line in view.lifts:
        words = f"lift on {line.diagonal}" + ("" if line.verdict is None else f": {line.verdict}")
        first = not any(trace["legendgroup"] == line.diagonal for trace in lifts)
        group = {"legendgroup": line.diagonal, "showlegend": first, "text": words, "hoverinfo": "text"}
        piece = line.piece(view.centre, reach)
        lifts.append(_path(piece, f"lifts on {line.diagonal}", 1, _colour(line.diagonal), opacity=0.5, **group))
    lines = [_support_line(line, view, view.centre, reach) for line in view.support_lines if view.balanced]
    ellipses: list[Trace] = []
    for mark in view.found:
        if mark.ellipse is not None:
            colour = _series(view, mark)
            fill = {"fill": "toself", "fillcolor": f"{colour}33", "showlegend": False}
            ellipses.append(_path(mark.ellipse, f"95 % ellipse of {plain(mark.label)}", 1.5, colour, **fill))
    return [*lifts, *lines, *ellipses, *(_mark(view, mark) for mark in reversed(view.marks))]


def _path(points: FloatArray, name: str, width: float = 0, colour: str = INK, **more: Any) -> Trace:
    """Return a trace through (n, 2) points [m], with x (forward) up and y (left) to the left."""
    places = {"x": short(1000 * points[:, 1], 6), "y": short(1000 * points[:, 0], 6)}
    style = {"width": width, "color": colour}
    return {"type": "scatter", "mode": "lines", **places, "name": name, "line": style, "hoverinfo": "name", **more}


def _support_line(line: PlanLine, view: PlanView, centre: FloatArray, reach: float) -> Trace:
    trace = _path(line.piece(centre, reach), f"support line {line.diagonal}", 2.4, _colour(line.diagonal))
    trace["line"]["dash"] = DASHES[list(DIAGONALS).index(line.diagonal)]
    return trace if view.balanced else {**trace, "name": f"line through the feet {line.diagonal}"}


def _mark(view: PlanView, mark: PlanMark) -> Trace:
    marker = _MARKERS.get(mark.kind) or {"color": _series(view, mark), "size": 8}
    trace = _path(mark.position[None], f"CoM, {plain(mark.label)}", mode="markers", marker=marker)
    return {**trace, "hovertemplate": "x %{y:.2f}, y %{x:.2f} mm"}


def _series(view: PlanView, mark: PlanMark) -> str:
    return SERIES[view.found.index(mark) % len(SERIES)]


def _colour(diagonal: str) -> str:
    return SERIES[2 + list(DIAGONALS).index(diagonal)]


def _frame(centre: FloatArray, half: float | FloatArray, b: int) -> Trace:
    """Return a layout with equal scales, forward up and left to the left, and a bottom margin [px] for the legend."""
    (low_x, low_y), (high_x, high_y) = 1000 * (centre - half), 1000 * (centre + half)
    return {
        "xaxis": {"range": [high_y, low_y], "constrain": "domain"},
        "yaxis": {"range": [low_x, high_x], "constrain": "domain", "scaleanchor": "x"},
        "legend": {"yref": "container", "y": 0, "yanchor": "bottom"},
        "margin": {"t": 8, "r": 4, "l": 40, "b": b},
        "hovermode": "closest",
    }
