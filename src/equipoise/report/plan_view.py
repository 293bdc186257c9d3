"""The plan view as JSON values, in millimetres; plan_view.js draws it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.plan_view import PlanLine, PlanMark, PlanOutline, PlanView
from equipoise.report.blocks import Block


def plan_view_block(view: PlanView | None) -> Block | None:
    """For the first screen; None of nothing."""
    if view is None:
        return None
    marks = [_mark(mark) for mark in view.marks]
    return {
        "type": "plan_view",
        **({} if view.outline is None else _outline(view.outline)),
        "lines": [{**_line(line), "feet": not view.balanced} for line in view.support_lines],
        "lifts": [_line(line) for line in view.lifts],
        "marks": marks,
        "zoom": {"centre": _mm(view.centre, 3), "half": round(1000 * view.half_width, 2)},
        "caption": _caption(marks, len(view.found) == 1),
    }


def _mark(mark: PlanMark) -> Block:
    block: Block = {"kind": mark.kind, "label": mark.label, "at": _mm(mark.position, 3)}
    if mark.ellipse is not None:
        major, minor = _mm([mark.ellipse.major, mark.ellipse.minor], 4)
        block["ellipse"] = {"major": major, "minor": minor, "angle": round(float(np.degrees(mark.ellipse.angle)), 2)}
    return block


def _line(line: PlanLine) -> Block:
    along = [round(float(value), 6) for value in line.direction]
    return {"diagonal": line.diagonal, "at": _mm(line.point), "along": along, "weight": round(line.weight, 2)}


def _outline(outline: PlanOutline) -> Block:
    return {
        "outline": _corners(outline.base),
        "legs": [_corners(leg) for leg in outline.legs],
        "feet": [
            {"name": foot.leg, "at": _mm(foot.position), "radius": round(1000 * foot.radius, 1)}
            for foot in outline.feet
        ],
    }


def _corners(outline: FloatArray) -> list[list[float]]:
    return [_mm(corner) for corner in outline]


def _mm(lengths: Iterable[float], decimals: int = 2) -> list[float]:
    return [round(1000 * float(length), decimals) for length in lengths]


def _caption(marks: list[Block], single: bool) -> str:
    places = [f"{mark['label']} x {mark['at'][0]:.1f}, y {mark['at'][1]:.1f} mm" for mark in marks]
    what = "feet, support lines and centre of mass" if single else "centres of mass of all runs"
    return f"Seen from above, forward is up: {what}. " + "; ".join(places) + "."
