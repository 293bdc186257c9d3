"""3D figure of the robot at its stance, with support planes and the CoM ellipsoid, in the base frame [mm]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import SupportPlane
from equipoise.figures.blocks import DASHES, INK, MUTED, ROBOT, SERIES, Figure, Trace
from equipoise.figures.geometry import Mesh, robot_meshes, sphere
from equipoise.figures.lift_planes import LiftPlanes
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS

_SEEN = 0.12  # size of the enlarged ellipsoid, over the hip height
_COLOURS = dict(zip(DIAGONALS, SERIES[2:], strict=True))
_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def scene(result: Calibration, planes: LiftPlanes) -> list[Figure]:
    """Return a figure with two views, of the robot and around the CoM; empty without a robot model."""
    robot = result.robot_model
    if robot is None:
        return []
    position = np.array([result.joint_position[name] for name in robot.joint_names])
    size = float(-foot_positions(robot, position)[:, 2].mean())
    base, legs, own = robot_meshes(robot, position)
    com = np.where(np.isnan(found := result.composite.com_in_base.values), result.nominal.composite.com, found)
    reach = _reach(result, com)
    links = [_body(base, "base", 0.25), _body(legs, "leg", 0.55)]
    surfaces = _surfaces(result, planes, com, (0.8 * size, size, 0.5 * size))
    ellipsoids, words = _ellipsoids(result, com, size)
    whole = [*links, *surfaces, *ellipsoids[1:]]
    close = [*ellipsoids[:1], *_surfaces(result, planes, com, (reach, reach, reach)), *_outlines(planes, com, reach)]
    marks = _marks(result, com)
    looks = {
        "whole robot": (_scene(_extent([*links, *surfaces], 0.05 * size)), True),
        "around the CoM": (_scene([(value - reach, value + reach) for value in com]), False),
    }
    buttons = [
        {"label": name, "method": "update", "args": [
            {"visible": [robot] * len(whole) + [True] * len(marks) + [not robot] * len(close)}, {"scene": look},
        ]}
        for name, (look, robot) in looks.items()
    ]  # fmt: skip
    layout = {
        "scene": looks["whole robot"][0],
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"y": 0, "yanchor": "top"},
        "updatemenus": [
            {"type": "buttons", "direction": "right", "buttons": buttons, "x": 0, "xanchor": "left", "y": 1}
        ],
    }
    source = "" if own else " Links without a readable mesh are drawn as simple shapes."
    caption = f"The robot at its nominal stance; drag to turn, scroll to zoom.{words}{source}"
    data = [*whole, *marks, *({**trace, "visible": False} for trace in close)]
    return [Figure("Support planes and centre of mass", caption, data, layout, height=560)]


def _body(meshes: Sequence[Mesh], part: str, opacity: float) -> Trace:
    return {
        **merged(meshes),
        "name": part,
        "color": ROBOT,
        "opacity": opacity,
        "hoverinfo": "skip",
        "flatshading": True,
    }


def _marks(result: Calibration, com: FloatArray) -> list[Trace]:
    places = [
        ("estimated CoM", com, SERIES[0], "circle"),
        ("model file", result.nominal.composite.com, MUTED, "square"),
    ]
    if result.truth is not None:
        places.append(("truth", result.truth.composite.com, INK, "cross"))
    return [
        {
            "type": "scatter3d", "mode": "markers", "name": name, "showlegend": True,
            **{axis: [round(1000 * float(value), 3)] for axis, value in zip("xyz", place, strict=True)},
            "marker": {"color": colour, "symbol": symbol, "size": 5},
            "hovertemplate": f"{name}: %{{x:.2f}}, %{{y:.2f}}, %{{z:.2f}} mm<extra></extra>",
        }
        for name, place, colour, symbol in places
    ]  # fmt: skip


def _ellipsoids(result: Calibration, com: FloatArray, size: float) -> tuple[list[Trace], str]:
    """Return the 95 % ellipsoid at true size and enlarged, and its description."""
    covariance = result.composite.covariance
    if covariance is None:
        return [], ""
    directions, half_axes = ellipsoid_95(covariance[1:4, 1:4])
    times = max(1.0, 10.0 * round(_SEEN * size / float(half_axes.max()) / 10))
    look = {"color": SERIES[0], "opacity": 0.45, "showlegend": True, "hoverinfo": "name"}
    names = {"95 % ellipsoid of the CoM": 1.0, f"95 % ellipsoid of the CoM, enlarged {times:.0f}x": times}
    axes = " x ".join(f"{1000 * half:.2f}" for half in half_axes[::-1])
    words = (
        f" The 95 % ellipsoid of the CoM has half axes {axes} mm; the view of the whole robot enlarges it {times:.0f}x."
    )
    return [{**ellipsoid(com, one * half_axes, directions), "name": name, **look} for name, one in names.items()], words


def _reach(result: Calibration, com: FloatArray) -> float:
    """Return half the side of the box around the CoM [m]. It contains the truth and, within 30 mm, the model's CoM."""
    others = [result.nominal.composite.com] + ([] if result.truth is None else [result.truth.composite.com])
    far = [1.3 * float(np.abs(other - com).max()) for other in others]
    return max(0.003, *(one for one in far if one < 0.03), far[-1] if result.truth is not None else 0.0)


def _extent(meshes: list[Trace], margin: float) -> list[tuple[float, float]]:
    """Return the bounds of meshes along x, y and z, with a margin [m]."""
    places = [np.concatenate([mesh[axis] for mesh in meshes]) / 1000 for axis in "xyz"]
    return [(float(place.min()) - margin, float(place.max()) + margin) for place in places]


def _scene(ranges: list[tuple[float, float]]) -> Trace:
    titles = ("x forward [mm]", "y left [mm]", "z up [mm]")
    named = {
        f"{axis}axis": {"title": {"text": title}, "range": [round(1000 * float(v), 2) for v in limits], "nticks": 6}
        for axis, title, limits in zip("xyz", titles, ranges, strict=True)
    }
    camera = {"eye": {"x": 1.9, "y": 2.25, "z": 0.98}, "center": {"x": 0, "y": 0, "z": -0.12}}
    return {**named, "aspectmode": "data", "camera": camera}


def _surfaces(result: Calibration, found: LiftPlanes, com: FloatArray, half: tuple[float, float, float]) -> list[Trace]:
    """Return one plane for each diagonal: from the search, or from its first lift.

    Args:
        half: extent of a plane along the line, down and up from the CoM [m].
    """
    chosen = {lift.diagonal: lift.plane for lift in reversed(found)}  # the first one stays
    if result.support_lines:
        lines = result.support_lines.items()
        chosen = {name: SupportPlane(np.array(line.point), np.array(line.normal)) for name, line in lines}
    word = "estimate" if result.support_lines else "first lift"
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return [
        {
            **merged([Mesh(_square(chosen[diagonal], com, *half), faces)], decimals=3),
            "name": f"plane {diagonal}, {word}", "color": _COLOURS[diagonal], "opacity": 0.3, "showlegend": True,
            "hoverinfo": "name",
        }
        for diagonal in DIAGONALS if diagonal in chosen
    ]  # fmt: skip


def _outlines(found: LiftPlanes, com: FloatArray, reach: float) -> list[Trace]:
    """Return the planes of all lifts, as squares around their points nearest to the CoM."""
    traces: list[Trace] = []
    gap = np.full((1, 3), np.nan)
    for index, diagonal in enumerate(DIAGONALS):
        planes = [lift.plane for lift in found if lift.diagonal == diagonal]
        if planes:
            corners = [_square(plane, com, reach, reach, reach)[[0, 1, 2, 3, 0]] for plane in planes]
            path = 1000 * np.concatenate([part for square in corners for part in (square, gap)])
            places = {
                axis: [None if np.isnan(value) else round(float(value), 3) for value in path[:, k]]
                for k, axis in enumerate("xyz")
            }
            style = {"color": _COLOURS[diagonal], "width": 2, "dash": DASHES[index]}
            name = f"all {len(planes)} lifts on {diagonal}"
            traces.append(
                {"type": "scatter3d", "mode": "lines", **places, "line": style, "name": name, "hoverinfo": "name"}
            )
    return traces


def _square(plane: SupportPlane, com: FloatArray, along: float, down: float, up: float) -> FloatArray:
    """Return the (4, 3) corners of a rectangle in the plane around its point nearest to the CoM [m]."""
    middle = com - plane.distance_to(com) * plane.normal
    level = np.cross(plane.normal, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    rise = np.cross(level, plane.normal)
    rise = rise if rise[2] > 0 else -rise
    return np.array([middle + along * a * level + (up if b > 0 else down) * b * rise for a, b in _CORNERS])


def ellipsoid(middle: FloatArray, half_axes: FloatArray, directions: FloatArray) -> Trace:
    """Return the trace of an ellipsoid; the columns of `directions` are its axes."""
    ball = sphere(1.0)
    return merged([Mesh(middle + (ball.vertices * half_axes) @ directions.T, ball.faces)], decimals=3)


def merged(meshes: Sequence[Mesh], decimals: int = 1) -> Trace:
    """Return one trace of all meshes [mm]."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    points = 1000 * np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
    none = np.zeros((0, 3), dtype=np.int64)
    faces = np.concatenate([none, *(mesh.faces + start for mesh, start in zip(meshes, first, strict=False))])
    places = {axis: np.round(points[:, k], decimals).tolist() for k, axis in enumerate("xyz")}
    return {"type": "mesh3d", **places, **{name: faces[:, k].tolist() for k, name in enumerate("ijk")}}
