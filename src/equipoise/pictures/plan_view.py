"""The plan view as a picture, for slides and for those who have no browser: the robot, and millimetres around its CoM."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Polygon, Rectangle
from matplotlib.patheffects import withStroke

from equipoise.conventions import FloatArray
from equipoise.figures.lift_planes import lift_planes
from equipoise.figures.plan_view import PlanLine, PlanMark, PlanOutline, PlanView, plan_view
from equipoise.pictures.figure import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    PURPLE,
    SMALL,
    TEXT,
    VERMILLION,
    new_figure,
)
from equipoise.result.calibration import Calibration
from equipoise.robot.model import DIAGONALS

_COLOURS: Mapping[str, str] = dict(zip(DIAGONALS, (BLUE, VERMILLION), strict=True))
_DASHES: Mapping[str | None, Any] = {None: "-", "forward": "-", "backward": (0, (5, 2.5)), "balanced": (0, (1, 1.5))}
_TIPPED: Mapping[str | None, int] = {"forward": 1, "backward": -1}
_WORDS: Mapping[str | None, str] = {
    None: "lift: the CoM is on it, but for sensor errors",
    "forward": "lift: tipped forward, the CoM is ahead",
    "backward": "lift: tipped backward, the CoM is behind",
    "balanced": "lift: balanced",
}
# They stay apart when they coincide: a plus in a ring in a diamond.
_MARKS: Mapping[str, Mapping[str, Any]] = {
    "found": {"marker": "+", "color": BLACK, "markersize": 13, "markeredgewidth": 2.2, "zorder": 9},
    "truth": {"marker": "o", "color": GREEN, "markersize": 10, "markeredgewidth": 2, "mfc": "none", "zorder": 8},
    "model": {"marker": "D", "color": PURPLE, "markersize": 12, "markeredgewidth": 2, "mfc": "none", "zorder": 7},
}


def draw_plan_view(calibration: Calibration) -> Figure | None:
    """The robot from above with its support lines, and the millimetres around its CoM; forward is up, left is left.

    Lengths are in mm, in the base frame. Without the robot's model there is the close-up alone; None if the result does not
    know where its CoM is in the plane.
    """
    view = plan_view({calibration.robot: calibration}, lift_planes(calibration))
    if view is None:
        return None
    figure = new_figure(11.5, 7.0)
    figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08, rect=(0.01, 0.01, 0.98, 0.98)))
    figure.suptitle(_title(calibration), fontsize=12)
    if view.outline is not None:
        overview, close_up = figure.subplots(1, 2, width_ratios=[1.0, 1.35])
        _draw_overview(overview, view, view.outline)
    else:
        close_up = figure.subplots()
    _draw_close_up(close_up, view)
    close_up.set_title(_error(calibration), fontsize=TEXT)
    figure.legend(
        handles=_legend(view), loc="outside lower center", ncols=2, fontsize=SMALL, frameon=False, markerscale=0.7
    )
    return figure


def _title(calibration: Calibration) -> str:
    lifts = sum(trial.kind == "lift" for trial in calibration.trials)
    feet = f", feet {calibration.feet}" if calibration.feet is not None else ""
    mass = calibration.composite.mass
    parts = [] if mass.value is None else [_said("mass", mass.value, mass.half, "kg")]
    parts += [
        _said(f"CoM {axis}", 1000 * one.value, None if one.half is None else 1000 * one.half, "mm")
        for axis, one in zip("xyz", calibration.composite.com_in_base, strict=True)
        if one.value is not None
    ]
    how = textwrap.fill(f"{calibration.robot}: method {calibration.method}{feet}, {lifts} lifts", 95)
    return f"{how}\n{', '.join(parts)}"


def _said(name: str, value: float, half: float | None, unit: str) -> str:
    return f"{name} {value:.2f} {unit}" if half is None else f"{name} {value:.2f} \u00b1 {half:.2f} {unit}"


def _error(calibration: Calibration) -> str:
    errors = calibration.composite.com_in_base.errors[:2] * 1000
    if not np.isfinite(errors).all():
        return "Around the CoM"
    x, y = (round(float(error), 1) + 0.0 for error in errors)  # + 0.0 turns -0.0 into 0.0
    return f"Around the CoM: error {np.linalg.norm(errors):.1f} mm (x {x:+.1f} mm, y {y:+.1f} mm)"


def _draw_overview(axes: Axes, view: PlanView, outline: PlanOutline) -> None:
    """The robot, with the close-up as a square on it."""
    for part in outline.legs:
        axes.add_patch(Polygon(_across_up(part), facecolor=LIGHT_GREY, alpha=0.6, zorder=1))
    axes.add_patch(Polygon(_across_up(outline.base), facecolor="#F6F6F6", edgecolor=GREY, linewidth=0.8, zorder=1.1))
    corners = np.concatenate([outline.base, *outline.legs])
    reach = 1.15 * float(np.abs(corners).max())
    for line in view.support_lines:
        _draw_line(axes, line, np.zeros(2), 2 * reach, 2.0)
    for foot in outline.feet:
        x, y = 1000 * foot.position
        radius = 1000 * foot.radius
        axes.add_patch(Circle((y, x), radius, facecolor="white", edgecolor=BLACK, linewidth=1.2, zorder=3))
        outward, side = (1, "right") if y > 0 else (-1, "left")
        axes.annotate(
            foot.leg, (y + outward * radius, x), (-5 * outward, 0), textcoords="offset points", ha=side, va="center",
            fontsize=12, fontweight="bold", color=GREY, zorder=6, path_effects=[withStroke(linewidth=3, foreground="white")],
        )  # fmt: skip
    x, y = 1000 * (view.centre - view.half_width)
    side = 2000 * view.half_width
    axes.add_patch(Rectangle((y, x), side, side, facecolor="none", edgecolor=BLACK, linewidth=1, zorder=7))
    _frame(axes, np.zeros(2), reach)
    axes.set_title("Seen from above, forward is up", fontsize=TEXT)


def _draw_close_up(axes: Axes, view: PlanView) -> None:
    reach = 2 * view.half_width
    for line in view.lifts:
        _draw_line(axes, line, view.centre, reach, 1.0, 0.7 * line.weight)
        _draw_side(axes, line, view)
    for line in view.support_lines if view.balanced else ():
        _draw_line(axes, line, view.centre, reach, 3.0)
    for mark in view.marks:
        _draw_mark(axes, mark)
    axes.grid(color=LIGHT_GREY, linewidth=0.6)
    _frame(axes, view.centre, view.half_width)


def _draw_line(
    axes: Axes, line: PlanLine, centre: FloatArray, reach: float, width: float, opacity: float | None = None
) -> None:
    ends = _across_up(line.piece(centre, reach))
    axes.plot(
        *ends.T, color=_COLOURS[line.diagonal], linestyle=_DASHES[line.verdict], linewidth=width, alpha=opacity,
        zorder=4 if opacity is None else 2, solid_capstyle="butt",
    )  # fmt: skip


def _draw_side(axes: Axes, line: PlanLine, view: PlanView) -> None:
    """An arrow from a lift's line to the side that the robot tipped to."""
    sense = _TIPPED.get(line.verdict)
    if sense is None:
        return
    forward = line.direction * np.sign(line.direction[0])
    start = line.nearest_to(view.centre) + 0.7 * view.half_width * forward
    ahead = np.array([-line.direction[1], line.direction[0]])
    ends = _across_up(np.array([start, start + sense * 0.12 * view.half_width * ahead]))
    arrow = {"arrowstyle": "-|>", "color": _COLOURS[line.diagonal], "alpha": line.weight, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", ends[1], ends[0], arrowprops=arrow, zorder=5, annotation_clip=True)


def _draw_mark(axes: Axes, mark: PlanMark) -> None:
    x, y = 1000 * mark.position
    axes.plot([y], [x], linestyle="none", **_MARKS[mark.kind])
    if mark.ellipse is not None:
        width, height = 2000 * mark.ellipse.minor, 2000 * mark.ellipse.major
        # Its height lies along x; Matplotlib turns it from y, which is its first coordinate, towards x.
        angle = -float(np.degrees(mark.ellipse.angle))
        fill = {"facecolor": "#00000018", "edgecolor": BLACK, "linewidth": 1.2}
        axes.add_patch(Ellipse((y, x), width, height, angle=angle, zorder=6, **fill))


def _across_up(points: FloatArray) -> FloatArray:
    """(n, 2) y and x in mm, as they are drawn, of x and y in m."""
    return 1000 * points[:, ::-1]


def _frame(axes: Axes, centre: FloatArray, half_width: float) -> None:
    """A square, forward up and left to the left."""
    x, y = 1000 * centre
    half = 1000 * half_width
    axes.set_xlim(y + half, y - half)
    axes.set_ylim(x - half, x + half)
    axes.set_aspect("equal", adjustable="box")
    axes.set_axisbelow(True)
    axes.set_xlabel("y, to the left [mm]", fontsize=TEXT)
    axes.set_ylabel("x, forward [mm]", fontsize=TEXT)
    axes.tick_params(labelsize=SMALL)


def _legend(view: PlanView) -> list[Artist]:
    """Beneath the drawing, with the CoMs in numbers."""
    marks = [
        Line2D([], [], linestyle="none", label=f"CoM, {mark.label}: {_planar(mark)}", **_MARKS[mark.kind])
        for mark in view.marks
    ]
    told = "support line found" if view.balanced else "line through the feet"
    lines = [
        Line2D([], [], color=_COLOURS[line.diagonal], linewidth=2.5, label=f"{told}, {line.diagonal}")
        for line in view.support_lines
    ]
    verdicts = dict.fromkeys(line.verdict for line in view.lifts)
    lifts = [
        Line2D([], [], color=GREY, linewidth=1, linestyle=_DASHES[verdict], label=_WORDS[verdict])
        for verdict in verdicts
    ]
    return [*marks, *lines, *lifts]


def _planar(mark: PlanMark) -> str:
    x, y = (round(1000 * float(value), 1) + 0.0 for value in mark.position)
    return f"x = {x:.1f} mm, y = {y:.1f} mm" + ("" if mark.ellipse is None else ", 95 % ellipse")
