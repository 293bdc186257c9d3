"""The CoM search, seen from above."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, ConnectionPatch, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.paper.evidence import SearchEvidence
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
    evidence_of,
    new_figure,
)
from equipoise.result.calibration import Calibration
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_DIAGONAL_COLOURS: Mapping[str, str] = dict(zip(DIAGONALS, (BLUE, VERMILLION), strict=True))
_VERDICT_DASHES: Mapping[str, Any] = {"forward": "-", "backward": (0, (5, 2.5)), "balanced": (0, (1, 1.5))}
_VERDICT_SENSES: Mapping[str, int] = {"forward": 1, "backward": -1, "balanced": 0}
_VERDICT_WORDS: Mapping[str, str] = {
    "forward": "trial: tipped forward, the CoM is ahead",
    "backward": "trial: tipped backward, the CoM is behind",
    "balanced": "trial: balanced",
}
_FAINTEST = 0.35  # opacity of the first trial on a diagonal; the last is solid

_SMALLEST_ZOOM, _USUAL_ZOOM = 5.0, 12.0  # [mm] from the CoM to the edge; only a truth farther away widens it more
_SEARCH_SIZE = (11.5, 8.4)  # [inch]
_OVERVIEW_PLACE = (0.8, 0.65, 4.9, 6.5)  # left, bottom, width and height in the figure [inch]
_ZOOM_PLACE = (6.2, 2.7, 4.45, 4.45)
_LEGEND_PLACE = (8.42, 2.15)  # middle and top [inch]
_DEFAULT_FOOT_RADIUS = 0.02  # [m] where the robot model is not at hand


@dataclass(frozen=True, eq=False)
class _Line:
    """A support plane cut at the height of the CoM, seen from above.

    Attributes:
        middle: (2,) x, y of a point on it [mm].
        direction: (2,) unit, along it, pointing forward.
        normal: (2,) unit, pointing forward.
    """

    middle: FloatArray
    direction: FloatArray
    normal: FloatArray

    @classmethod
    def cut(cls, point: Iterable[float], normal: Iterable[float], height: float) -> _Line:
        """The line in which the plane through a point [m] meets the horizontal plane at a height [m]."""
        through, across = np.array([*point]), np.array([*normal])
        flat = across[:2]
        middle = through[:2] + flat * across[2] * (through[2] - height) / (flat @ flat)
        flat = flat / np.linalg.norm(flat)
        along = np.array([flat[1], -flat[0]])
        return cls(middle * 1000, along if along[0] > 0 else -along, flat)

    def distance_to(self, point: FloatArray) -> float:
        """Of a point, either side [mm]."""
        return abs(float(self.normal @ (point - self.middle)))

    def within(self, centre: FloatArray, half_width: float) -> tuple[FloatArray, FloatArray] | None:
        """Hindmost and foremost point inside a square [mm]; None if the line misses it."""
        ends = np.sort([(centre + sign * half_width - self.middle) / self.direction for sign in (-1, 1)], axis=0)
        first, last = float(ends[0].max()), float(ends[1].min())
        if first >= last:
            return None
        return self.middle + first * self.direction, self.middle + last * self.direction


@dataclass(frozen=True, eq=False)
class _TrialLine:
    """The line of one lift trial: its number, what came of it, and how solidly it is drawn."""

    number: int
    diagonal: str
    verdict: str
    opacity: float
    line: _Line


@dataclass(frozen=True, eq=False)
class _Mark:
    """A CoM [mm] and how it is drawn."""

    label: str
    position: FloatArray
    style: Mapping[str, Any]

    def scaled(self, scale: float) -> dict[str, Any]:
        """The style, smaller."""
        sizes = ("markersize", "markeredgewidth")
        return {key: value * scale if key in sizes else value for key, value in self.style.items()}


def draw_search(calibration: Calibration) -> Figure:
    """The CoM search seen from above, in the base frame: forward is up, left is left.

    Every lift trial shows as the line that its two feet held up; a final line per diagonal lies between the last to tip
    forward and the last to tip backward, and the CoM is where the two cross. Planes are cut at the height of
    the model's CoM.

    Raises:
        NotEstimatedError: the calibration came from a JSON file, or has no planar CoM.
    """
    evidence = evidence_of(calibration, SearchEvidence)
    trials, found, marks = _trial_lines(calibration, evidence), _found_lines(calibration), _marks(calibration)
    feet, centre, half_width = evidence.feet_in_base, marks[0].position, _zoom_half_width(marks, trials)
    figure = new_figure(*_SEARCH_SIZE)
    overview, zoom = (_place(figure, *place) for place in (_OVERVIEW_PLACE, _ZOOM_PLACE))
    figure.suptitle(_search_title(calibration), y=1 - 0.12 / _SEARCH_SIZE[1], fontsize=13)
    _draw_robot(overview, calibration, feet)
    reach = 1100 * float(np.linalg.norm(feet[:, :2], axis=1).max())
    _draw_lines(overview, trials, found, np.zeros(2), reach=reach, width=0.8)
    _draw_marks(overview, marks, 0.55)
    _frame_overview(overview, feet)
    _draw_lines(zoom, trials, found, centre, reach=2 * half_width, width=1.2)
    _draw_error(zoom, marks)
    _draw_marks(zoom, marks, 1.0)
    _draw_verdicts(zoom, trials, marks, half_width)
    _frame_zoom(zoom, centre, half_width, _zoom_title(calibration))
    _join(overview, zoom, centre, half_width)
    _draw_legend(figure, trials, marks)
    return figure


def _place(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place in inches: a layout engine would not keep two scales and their labels inside the figure."""
    across, up = _SEARCH_SIZE
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def _trial_lines(calibration: Calibration, evidence: SearchEvidence) -> list[_TrialLine]:
    """Every lift trial's line, in order."""
    height = float(calibration.nominal.composite.com[2])
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]
    counts = {diagonal: sum(lift.about == diagonal for lift in lifts) for diagonal in DIAGONALS}
    seen = dict.fromkeys(DIAGONALS, 0)
    lines: list[_TrialLine] = []
    for number, (lift, plane) in enumerate(zip(lifts, evidence.trial_planes, strict=True), start=1):
        seen[lift.about] += 1
        opacity = 1 - (1 - _FAINTEST) * (counts[lift.about] - seen[lift.about]) / max(1, counts[lift.about] - 1)
        line = _Line.cut(plane.point, plane.normal, height)
        lines.append(_TrialLine(number, lift.about, lift.verdict or "balanced", opacity, line))
    return lines


def _found_lines(calibration: Calibration) -> dict[str, _Line]:
    height = float(calibration.nominal.composite.com[2])
    return {name: _Line.cut(line.point, line.normal, height) for name, line in calibration.support_lines.items()}


def _found_com(calibration: Calibration) -> FloatArray:
    """(2,) x and y of the estimate [mm]."""
    found = calibration.composite.com_in_base.values[:2]
    if not np.isfinite(found).all():
        raise NotEstimatedError(
            "this calibration does not know composite.com_in_base.x and y; there is no search to draw"
        )
    return found * 1000


def _marks(calibration: Calibration) -> list[_Mark]:
    """The CoMs to show, the estimate first. They stay apart when they coincide: a plus in a ring in a diamond."""
    hollow = {"markerfacecolor": "none", "markeredgewidth": 2.0}
    plus = {"marker": "+", "color": BLACK, "markersize": 15, "markeredgewidth": 2.4, "zorder": 9}
    marks = [_Mark("CoM found", _found_com(calibration), plus)]
    if calibration.truth is not None:
        ring = {"marker": "o", "color": GREEN, "markersize": 11, "zorder": 8, **hollow}
        marks.append(_Mark("CoM, truth", calibration.truth.composite.com[:2] * 1000, ring))
    diamond = {"marker": "D", "color": PURPLE, "markersize": 14, "zorder": 7, **hollow}
    return [*marks, _Mark("CoM of the model file", calibration.nominal.composite.com[:2] * 1000, diamond)]


def _zoom_half_width(marks: list[_Mark], trials: list[_TrialLine]) -> float:
    """Wide enough for the truth, and for the last trials and the model's CoM if they are near [mm]."""
    found = marks[0].position
    reaches = [1.3 * float(np.abs(mark.position - found).max()) for mark in marks[1:]]
    reaches += [2.0 * trial.line.distance_to(found) for diagonal in DIAGONALS for trial in _last_two(trials, diagonal)]
    needed = [reaches[0]] if len(marks) > 2 else []
    return max(_SMALLEST_ZOOM, *needed, *(reach for reach in reaches if reach <= _USUAL_ZOOM))


def _last_two(trials: list[_TrialLine], diagonal: str) -> list[_TrialLine]:
    return [trial for trial in trials if trial.diagonal == diagonal][-2:]


def _search_title(calibration: Calibration) -> str:
    lifts = sum(trial.kind == "lift" for trial in calibration.trials)
    result = f"Centre of mass of {calibration.robot} in the base frame: {_planar(_found_com(calibration))}"
    how = f"method {calibration.method}, feet {calibration.feet}, {lifts} lift trials"
    return f"{textwrap.fill(result, 95)}\n{how}"


def _zoom_title(calibration: Calibration) -> str:
    if calibration.truth is None:
        return "Around the CoM"
    error = _found_com(calibration) - calibration.truth.composite.com[:2] * 1000
    x, y = (round(float(value), 1) + 0.0 for value in error)
    return f"Around the CoM: error {np.linalg.norm(error):.1f} mm (x {x:+.1f} mm, y {y:+.1f} mm)"


def _planar(position: FloatArray) -> str:
    x, y = (round(float(value), 1) + 0.0 for value in position)  # + 0.0 turns -0.0 into 0.0
    return f"x = {x:.1f} mm, y = {y:.1f} mm"


def _draw_robot(axes: Axes, calibration: Calibration, feet_in_base: FloatArray) -> None:
    """The feet with their names, and lightly the hips and what is between them."""
    robot = calibration.robot_model
    if robot is not None:
        _draw_hips(axes, _hips(robot, calibration.joint_position), feet_in_base)
    for leg, (x, y, _) in zip(LEG_NAMES, feet_in_base * 1000, strict=True):
        radius = 1000 * (robot.legs[leg].foot_radius if robot is not None else _DEFAULT_FOOT_RADIUS)
        axes.add_patch(Circle((y, x), radius, facecolor="#EDEDED", edgecolor=GREY, linewidth=1.2, zorder=2))
        outward, side = (1, "right") if y > 0 else (-1, "left")
        axes.annotate(
            leg, (y + outward * radius, x), (-5 * outward, 0), textcoords="offset points",
            ha=side, va="center", fontsize=12, fontweight="bold", color=GREY, zorder=6,
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )  # fmt: skip


def _hips(robot: RobotModel, joint_position: Mapping[str, float]) -> FloatArray:
    """(4, 3) origins of the legs' first joints in the base frame [m]."""
    position = np.array([joint_position[name] for name in robot.joint_names])
    poses = Kinematics(robot).joint_poses(position)
    return np.array([poses[robot.legs[leg].joint_ids[0]].translation for leg in LEG_NAMES])


def _draw_hips(axes: Axes, hips: FloatArray, feet_in_base: FloatArray) -> None:
    """The quadrangle of the hips, its front marked, and the legs."""
    fl, fr, rl, rr = hips[:, :2] * 1000
    corners = [(y, x) for x, y in (fl, fr, rr, rl)]
    axes.add_patch(Polygon(corners, facecolor="#F6F6F6", edgecolor=LIGHT_GREY, linewidth=1.5, zorder=0.5))
    for (x, y, _), (foot_x, foot_y, _) in zip(hips * 1000, feet_in_base * 1000, strict=True):
        axes.plot([y, foot_y], [x, foot_x], color=LIGHT_GREY, linewidth=5, solid_capstyle="round", zorder=0.6)
    front_x, front_y = (fl + fr) / 2
    axes.plot([front_y], [front_x], marker="^", markersize=13, color=LIGHT_GREY, zorder=0.7)
    axes.annotate(
        "front", (front_y, front_x), (0, 11), textcoords="offset points", ha="center", fontsize=SMALL, color=GREY
    )


def _draw_lines(
    axes: Axes,
    trials: list[_TrialLine],
    found: Mapping[str, _Line],
    centre: FloatArray,
    *,
    reach: float,
    width: float,
) -> None:
    """Every trial's line, early ones faded, and the final ones; as far as a reach from a centre [mm]."""
    for trial in trials:
        style = {"linestyle": _VERDICT_DASHES[trial.verdict], "linewidth": width, "alpha": trial.opacity, "zorder": 3}
        _draw_line(axes, trial.line, centre, reach, color=_DIAGONAL_COLOURS[trial.diagonal], **style)
    for diagonal, line in found.items():
        _draw_line(axes, line, centre, reach, color=_DIAGONAL_COLOURS[diagonal], linewidth=3 * width, zorder=4)


def _draw_line(axes: Axes, line: _Line, centre: FloatArray, reach: float, **style: Any) -> None:
    nearest = line.middle + (line.direction @ (centre - line.middle)) * line.direction
    ends = [nearest - reach * line.direction, nearest + reach * line.direction]
    axes.plot([y for _, y in ends], [x for x, _ in ends], solid_capstyle="butt", **style)


def _draw_marks(axes: Axes, marks: list[_Mark], scale: float) -> None:
    for mark in marks:
        x, y = mark.position
        axes.plot([y], [x], linestyle="none", **mark.scaled(scale))


def _draw_error(axes: Axes, marks: list[_Mark]) -> None:
    """From the truth, if it is known, to the estimate."""
    if len(marks) > 2:
        (x, y), (true_x, true_y) = marks[0].position, marks[1].position
        axes.plot([true_y, y], [true_x, x], color=GREEN, linewidth=2.0, solid_capstyle="butt", zorder=6)


def _frame_overview(axes: Axes, feet_in_base: FloatArray) -> None:
    """Room for the feet and their names, in the proportions of its place."""
    forward, left = np.abs(feet_in_base[:, :2]).max(axis=0) * 1000
    margin = 0.3 * max(forward, left)
    proportion = _OVERVIEW_PLACE[3] / _OVERVIEW_PLACE[2]
    half_length = max(forward + margin, proportion * (left + 1.25 * margin))
    _seen_from_above(axes, np.zeros(2), half_length, half_length / proportion)
    axes.set_title("Seen from above", fontsize=TEXT + 1)


def _frame_zoom(axes: Axes, centre: FloatArray, half_width: float, title: str) -> None:
    """A square around the CoM on millimetre paper."""
    _seen_from_above(axes, centre, half_width, half_width)
    step = next((step for step in (1, 2, 5, 10, 20, 50) if half_width / step <= 8), 100)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
        axis.grid(which="major", color=LIGHT_GREY, linewidth=0.8)
        if 1 < step <= 10:
            axis.set_minor_locator(MultipleLocator(1))
            axis.grid(which="minor", color="#EEEEEE", linewidth=0.5)
    axes.yaxis.tick_right()
    axes.yaxis.set_label_position("right")
    axes.set_title(title, fontsize=TEXT + 1)


def _seen_from_above(axes: Axes, centre: FloatArray, half_length: float, half_breadth: float) -> None:
    """Forward up and left to the left."""
    x, y = centre
    axes.set_xlim(y + half_breadth, y - half_breadth)
    axes.set_ylim(x - half_length, x + half_length)
    axes.set_aspect("equal", adjustable="box")
    axes.set_axisbelow(True)
    axes.set_xlabel("y, to the left [mm]", fontsize=TEXT)
    axes.set_ylabel("x, forward [mm]", fontsize=TEXT)
    axes.tick_params(labelsize=SMALL)


def _join(overview: Axes, zoom: Axes, centre: FloatArray, half_width: float) -> None:
    """Frame in the overview what the zoom shows, and join the two."""
    x, y = centre
    size = 2 * half_width
    frame = Rectangle(
        (y - half_width, x - half_width), size, size, fill=False, edgecolor=GREY, linewidth=1.0, zorder=10
    )
    overview.add_patch(frame)
    for corner, end in ((x - half_width, 0.0), (x + half_width, 1.0)):
        line = ConnectionPatch(
            xyA=(y - half_width, corner), coordsA=overview.transData, xyB=(0.0, end), coordsB=zoom.transAxes,
            color=GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=2.5, clip_on=False,
        )  # fmt: skip
        line.set_in_layout(False)
        overview.add_patch(line)


def _draw_verdicts(axes: Axes, trials: list[_TrialLine], marks: list[_Mark], half_width: float) -> None:
    """On each line the trial's number and an arrow to where the robot tipped; latest first, as far as there is room."""
    taken = [mark.position for mark in marks]
    for trial in reversed(trials):
        ends = trial.line.within(marks[0].position, half_width)
        if ends is None:
            continue
        room = float(np.linalg.norm(ends[1] - ends[0])) / half_width
        for back in np.arange(0.12, room - 0.24, 0.08):
            label = ends[1] - back * half_width * trial.line.direction
            foot = label - 0.16 * half_width * trial.line.direction
            tip = foot + _VERDICT_SENSES[trial.verdict] * 0.12 * half_width * trial.line.normal
            if all(np.linalg.norm(mine - other) > 0.15 * half_width for mine in (label, foot, tip) for other in taken):
                taken += [label, foot, tip]
                _draw_verdict(axes, trial, label, foot, tip)
                break


def _draw_verdict(axes: Axes, trial: _TrialLine, label: FloatArray, foot: FloatArray, tip: FloatArray) -> None:
    colour = _DIAGONAL_COLOURS[trial.diagonal]
    box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": colour, "linewidth": 0.8}
    axes.text(
        label[1], label[0], str(trial.number), ha="center", va="center", fontsize=8, color=colour, bbox=box, zorder=6
    )
    if _VERDICT_SENSES[trial.verdict]:
        arrow = {
            "arrowstyle": "-|>",
            "color": colour,
            "linewidth": 1.3,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 11,
        }
        axes.annotate("", (tip[1], tip[0]), (foot[1], foot[0]), arrowprops=arrow, zorder=5)


def _draw_legend(figure: Figure, trials: list[_TrialLine], marks: list[_Mark]) -> None:
    """Beside the drawing, with the CoMs in numbers."""
    handles: list[Artist] = [
        Line2D([], [], linestyle="none", label=f"{mark.label}: {_planar(mark.position)}", **mark.scaled(0.7))
        for mark in marks
    ]
    handles += [
        Line2D([], [], color=colour, linewidth=3.6, label=f"support line {diagonal}, found")
        for diagonal, colour in _DIAGONAL_COLOURS.items()
    ]
    verdicts = {trial.verdict for trial in trials}
    handles += [
        Line2D([], [], color=GREY, linewidth=1.2, linestyle=dashes, label=_VERDICT_WORDS[verdict])
        for verdict, dashes in _VERDICT_DASHES.items()
        if verdict in verdicts
    ]
    note = "Thin lines are trials as measured, numbered in order, the first faintest."
    if verdicts != {"balanced"}:
        note += "\nArrows show which way the robot tipped."
    middle_top = (_LEGEND_PLACE[0] / _SEARCH_SIZE[0], _LEGEND_PLACE[1] / _SEARCH_SIZE[1])
    legend = figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=middle_top, borderaxespad=0.0, fontsize=SMALL, title=note,
        title_fontsize=SMALL,
    )  # fmt: skip
    legend.get_frame().set_edgecolor(LIGHT_GREY)
