"""Support planes in the scene: two of them as surfaces, those of all lifts as outlines."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import SupportPlane
from equipoise.figures.geometry import Mesh
from equipoise.figures.lift_planes import LiftPlanes
from equipoise.report.blocks import DASHES, SERIES, Block
from equipoise.report.meshes import merged
from equipoise.result.calibration import Calibration
from equipoise.robot.model import DIAGONALS

_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def surfaces(result: Calibration, found: LiftPlanes, com: FloatArray, half: tuple[float, float, float]) -> list[Block]:
    """One plane of each diagonal: as the search found it, or of the first lift on it.

    Args:
        half: how far they reach along the line, down and up from the CoM [m].
    """
    if result.support_lines:
        chosen = {
            name: SupportPlane(np.array(line.point), np.array(line.normal))
            for name, line in result.support_lines.items()
        }
    else:
        chosen = {lift.diagonal: lift.plane for lift in reversed(found)}  # the first one stays
    word = "found" if result.support_lines else "first lift"
    return [
        {
            **merged([Mesh(_square(plane, com, *half), np.array([[0, 1, 2], [0, 2, 3]]))], decimals=3),
            "name": f"plane {diagonal}, {word}", "color": _colour(diagonal), "opacity": 0.3, "showlegend": True,
            "hoverinfo": "name",
        }
        for diagonal in DIAGONALS if (plane := chosen.get(diagonal)) is not None
    ]  # fmt: skip


def outlines(found: LiftPlanes, com: FloatArray, reach: float) -> list[Block]:
    """The planes of all lifts on each diagonal, as squares about the points of them nearest to the CoM."""
    traces: list[Block] = []
    for index, diagonal in enumerate(DIAGONALS):
        planes = [lift.plane for lift in found if lift.diagonal == diagonal]
        paths = [_square(plane, com, reach, reach, reach)[[0, 1, 2, 3, 0]] for plane in planes]
        if paths:
            places = {
                axis: [value for path in paths for value in (*np.round(1000 * path[:, k], 3).tolist(), None)]
                for k, axis in enumerate("xyz")
            }
            style = {"color": _colour(diagonal), "width": 2, "dash": DASHES[index]}
            name = f"all {len(paths)} lifts on {diagonal}"
            traces.append(
                {"type": "scatter3d", "mode": "lines", **places, "line": style, "name": name, "hoverinfo": "name"}
            )
    return traces


def _square(plane: SupportPlane, com: FloatArray, along: float, down: float, up: float) -> FloatArray:
    """(4, 3) corners of a part of a plane around the point of it that is nearest to the CoM."""
    middle = com - plane.distance_to(com) * plane.normal
    level = np.cross(plane.normal, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    rise = np.cross(level, plane.normal)
    rise = rise if rise[2] > 0 else -rise
    return np.array([middle + along * a * level + (up if b > 0 else down) * b * rise for a, b in _CORNERS])


def _colour(diagonal: str) -> str:
    return SERIES[2 + list(DIAGONALS).index(diagonal)]
