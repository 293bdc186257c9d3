"""The CoM from above, in millimetres, as SVG: support planes as lines, the estimates so far, and where the newest may be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.result.statistics import PLANAR_95
from equipoise.view.colours import COM, VERDICTS, html

SIZE = 300  # of the picture, in its own units
_SPANS = (2, 5, 10, 20, 50, 100)  # [mm] from the middle to an edge
_COM = html(COM)


def plan_view(history: Sequence[ComEstimate], planes: Sequence[LiftPlane], nominal: FloatArray) -> str:
    """Forward is up, the robot's left is left.

    Args:
        history: estimates in order; the newest is in the middle of the picture.
        planes: of the lifts so far.
        nominal: (3,) CoM of the model, in the base frame [m].
    """
    centre = history[-1].com[:2] if history else nominal[:2]
    span = _span(history[-1] if history else None)
    view = _View(centre, span)
    parts = [view.axes()]
    parts += [view.line(plane, history[-1].com[2] if history else nominal[2]) for plane in planes]
    parts.append(view.cross(nominal[:2], "#555555"))
    if history:
        parts += [view.trail([estimate.com[:2] for estimate in history]), view.region(history[-1])]
        parts.append(view.dot(history[-1].com[:2]))
    caption = f"CoM from above: forward is up, left is left; a square is {span / 2:g} mm. Cross: the model's."
    svg = f'<svg viewBox="0 0 {SIZE} {SIZE}" width="100%" xmlns="http://www.w3.org/2000/svg" role="img">'
    return f"{svg}<title>Centre of mass from above</title>{''.join(parts)}</svg><small>{caption}</small>"


def _span(newest: ComEstimate | None) -> int:
    """[mm], such that the newest interval fills a third of the picture."""
    wanted = 3000 * float(np.nanmax(newest.half[:2])) if newest is not None else 30.0
    return next((span for span in _SPANS if span >= wanted), _SPANS[-1])


class _View:
    def __init__(self, centre: FloatArray, span: int) -> None:
        self._centre, self._span, self._scale = centre, span, SIZE / 2 / span

    def at(self, point: FloatArray) -> tuple[float, float]:
        """Where a point of the base frame [m] is in the picture."""
        x, y = 1000 * (point - self._centre)
        return SIZE / 2 - self._scale * float(y), SIZE / 2 - self._scale * float(x)

    def axes(self) -> str:
        step = self._span / 2 * self._scale
        lines = [SIZE / 2 + k * step for k in (-1, 0, 1)]
        grid = "".join(
            f'<path d="M{v:.1f} 0V{SIZE}M0 {v:.1f}H{SIZE}" stroke="#888888" stroke-opacity="0.25" fill="none"/>'
            for v in lines
        )
        return grid

    def line(self, plane: LiftPlane, height: float) -> str:
        """Where a support plane cuts the horizontal plane at a height [m]."""
        normal = plane.normal[:2]
        level = float(plane.normal @ plane.point - plane.normal[2] * height)
        foot = self._centre + normal * (level - normal @ self._centre) / float(normal @ normal)
        along = np.array([-normal[1], normal[0]]) / float(np.linalg.norm(normal)) * 4e-3 * self._span
        (x1, y1), (x2, y2) = self.at(foot - along), self.at(foot + along)
        colour = html(VERDICTS[plane.verdict])
        return (
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" stroke-width="1.2" '
            'stroke-opacity="0.6"/>'
        )

    def cross(self, point: FloatArray, colour: str) -> str:
        x, y = self.at(point)
        return f'<path d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10" stroke="{colour}" stroke-width="1.5"/>'

    def trail(self, points: Sequence[FloatArray]) -> str:
        path = " ".join("{:.1f},{:.1f}".format(*self.at(point)) for point in points)
        return f'<polyline points="{path}" fill="none" stroke="{_COM}" stroke-opacity="0.5"/>'

    def dot(self, point: FloatArray) -> str:
        x, y = self.at(point)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{_COM}"/>'

    def region(self, estimate: ComEstimate) -> str:
        """The ellipse that holds 95 %, or the bracket's box."""
        x, y = self.at(estimate.com[:2])
        fill = f'fill="{_COM}" fill-opacity="0.15" stroke="{_COM}"'
        if estimate.covariance is None:
            high, wide = 1000 * estimate.half[:2] * self._scale
            return (
                f'<rect x="{x - wide:.1f}" y="{y - high:.1f}" width="{2 * wide:.1f}" height="{2 * high:.1f}" {fill}/>'
            )
        values, vectors = np.linalg.eigh(estimate.covariance[:2, :2])
        small, large = 1000 * PLANAR_95 * np.sqrt(np.maximum(values, 0)) * self._scale
        ux, uy = -vectors[1, 1], -vectors[0, 1]  # of the large axis, in the picture
        angle = float(np.degrees(np.arctan2(uy, ux)))
        return (
            f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{large:.1f}" ry="{small:.1f}" '
            f'transform="rotate({angle:.1f} {x:.1f} {y:.1f})" {fill}/>'
        )
