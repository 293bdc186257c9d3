"""The plan view as SVG: the CoM from above, where it may be, and what each lift said of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.plan_view import Ellipse, PlanLine, PlanMark, PlanView
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.view.colours import COM, VERDICTS, html

SIZE = 300  # of the picture, in its own units
_HALF_WIDTHS = (0.002, 0.005, 0.010, 0.020, 0.050, 0.100)  # [m]
_COM = html(COM)


def plan_view(history: Sequence[ComEstimate], planes: Sequence[LiftPlane], nominal_com_in_base: FloatArray) -> str:
    """Forward is up, the robot's left is left.

    Args:
        history: estimates in order; the newest is in the middle of the picture.
        planes: planes of the lifts so far.
        nominal_com_in_base: (3,) CoM by the model [m].
    """
    view = seen_from_above(history, planes, nominal_com_in_base)
    sheet = _Sheet(view.centre, SIZE / 2 / view.half_width)
    parts = [sheet.grid(view.half_width / 2), *(sheet.line(line, view.half_width) for line in view.lifts)]
    parts += [sheet.cross(mark) for mark in view.marks if mark.kind == "model"]
    parts += [sheet.trail(view.trail), *(sheet.found(mark) for mark in view.found)]
    square = f"{500 * view.half_width:g}"
    caption = f"CoM from above: forward is up, left is left; a square is {square} mm. Cross: the model's."
    svg = f'<svg viewBox="0 0 {SIZE} {SIZE}" width="100%" xmlns="http://www.w3.org/2000/svg" role="img">'
    return f"{svg}<title>Centre of mass from above</title>{''.join(parts)}</svg><small>{caption}</small>"


def seen_from_above(
    history: Sequence[ComEstimate], planes: Sequence[LiftPlane], nominal_com_in_base: FloatArray
) -> PlanView:
    """What is known at a moment; arguments as above."""
    model = PlanMark("model", "model file", nominal_com_in_base[:2])
    newest = history[-1] if history else None
    com = nominal_com_in_base if newest is None else newest.com
    lifts = [PlanLine.cut(lift.diagonal, lift.plane, float(com[2]), lift.verdict) for lift in planes]
    trail = np.array([estimate.com[:2] for estimate in history]).reshape(-1, 2)
    marks = (model,) if newest is None else (_found(newest), model)
    return PlanView(marks, com[:2], _half_width(newest), tuple(lifts), trail=trail)


def _found(estimate: ComEstimate) -> PlanMark:
    if estimate.covariance is None:
        return PlanMark("found", "estimate", estimate.com[:2], bracket=estimate.half[:2])
    return PlanMark("found", "estimate", estimate.com[:2], Ellipse.of(estimate.covariance[:2, :2]))


def _half_width(newest: ComEstimate | None) -> float:
    """Such that the newest interval fills a third of the picture [m]; one of a few, so that it seldom jumps."""
    wanted = 3 * float(np.nanmax(newest.half[:2])) if newest is not None else 0.03
    return next((half for half in _HALF_WIDTHS if half >= wanted), _HALF_WIDTHS[-1])


class _Sheet:
    """Where what is seen is in the picture.

    Args:
        centre: (2,) of the picture, in the base frame [m].
        scale: of the picture's units to a metre.
    """

    def __init__(self, centre: FloatArray, scale: float) -> None:
        self._centre, self._scale = centre, scale

    def at(self, position: FloatArray) -> tuple[float, float]:
        """Where a (2,) position in the base frame [m] is in the picture."""
        x, y = self._scale * (position - self._centre)
        return SIZE / 2 - float(y), SIZE / 2 - float(x)

    def grid(self, step: float) -> str:
        """Lines through the middle and a step [m] beside it."""
        return "".join(
            f'<path d="M{v:.1f} 0V{SIZE}M0 {v:.1f}H{SIZE}" stroke="#888888" stroke-opacity="0.25" fill="none"/>'
            for v in (SIZE / 2 + k * step * self._scale for k in (-1, 0, 1))
        )

    def line(self, line: PlanLine, half_width: float) -> str:
        (x1, y1), (x2, y2) = (self.at(end) for end in line.piece(self._centre, 4 * half_width))
        return (
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{html(VERDICTS[line.verdict])}" '
            'stroke-width="1.2" stroke-opacity="0.6"/>'
        )

    def cross(self, mark: PlanMark) -> str:
        x, y = self.at(mark.position)
        return f'<path d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10" stroke="#555555" stroke-width="1.5"/>'

    def trail(self, positions: FloatArray) -> str:
        path = " ".join("{:.1f},{:.1f}".format(*self.at(position)) for position in positions)
        return f'<polyline points="{path}" fill="none" stroke="{_COM}" stroke-opacity="0.5"/>' if path else ""

    def found(self, mark: PlanMark) -> str:
        """The ellipse that holds 95 %, or the bracket's box, and a dot in it."""
        x, y = self.at(mark.position)
        fill = f'fill="{_COM}" fill-opacity="0.15" stroke="{_COM}"'
        around = ""
        if mark.bracket is not None:
            high, wide = self._scale * mark.bracket
            around = (
                f'<rect x="{x - wide:.1f}" y="{y - high:.1f}" width="{2 * wide:.1f}" height="{2 * high:.1f}" {fill}/>'
            )
        elif mark.ellipse is not None:
            small, large = self._scale * mark.ellipse.minor, self._scale * mark.ellipse.major
            turn = f"rotate({-np.degrees(mark.ellipse.angle):.1f} {x:.1f} {y:.1f})"  # from up towards left
            around = f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{small:.1f}" ry="{large:.1f}" transform="{turn}" {fill}/>'
        return f'{around}<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{_COM}"/>'
