"""The robot at its stance in three dimensions, with support planes and the CoM's ellipsoid; millimetres, base frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.geometry import Mesh, robot_meshes
from equipoise.figures.lift_planes import LiftPlanes
from equipoise.report.blocks import SERIES, Block, figure
from equipoise.report.meshes import ellipsoid, merged
from equipoise.report.scene_planes import outlines, surfaces
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.kinematics import foot_positions

_SEEN = 0.12  # size at which the ellipsoid is drawn beside the robot, over the hip height


def scene(result: Calibration, found: LiftPlanes) -> Block | None:
    """The interactive scene, with the planes of all lifts; None without the robot's model."""
    robot = result.robot_model
    if robot is None:
        return None
    position = np.array([result.joint_position[name] for name in robot.joint_names])
    feet = foot_positions(robot, position)
    size = float(-feet[:, 2].mean())
    looks_like = robot_meshes(robot, position)
    com = _com(result)
    near, far, said = _ellipsoids(result, com, size)
    reach = _reach(result, com)
    robot_and_planes = [
        _body(looks_like.base, "base", 0.25), _body(looks_like.legs, "leg", 0.55),
        *surfaces(result, found, com, (0.8 * size, size, 0.5 * size)),
    ]  # fmt: skip
    whole = [*robot_and_planes, *far]
    close = [*near, *surfaces(result, found, com, (reach, reach, reach)), *outlines(found, com, reach)]
    marks = _marks(result, com)
    looks = {
        "whole robot": _scene(_extent(robot_and_planes, 0.05 * size)),
        "around the CoM": _scene([(value - reach, value + reach) for value in com]),
    }
    views = [
        {
            "label": name, "layout": {"scene": look},
            "visible": [*([first] * len(whole)), *([True] * len(marks)), *([not first] * len(close))],
        }
        for (name, look), first in zip(looks.items(), (True, False), strict=True)
    ]  # fmt: skip
    layout = {
        "scene": looks["whole robot"],
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"y": 0, "yanchor": "top"},  # below the robot, not over it
    }
    source = "" if looks_like.own else " Links without a shape that can be read are drawn as stand-ins."
    caption = f"The robot at its nominal stance; drag to turn, scroll to zoom. {said}{source}"
    data = [*whole, *marks, *close]
    return figure("Support planes and centre of mass", caption, data, layout, height=560, views=views, webgl=True)


def _com(result: Calibration) -> FloatArray:
    """As found; what was not found is the model's."""
    found = result.composite.com_in_base.values
    return np.where(np.isnan(found), result.nominal.composite.com, found)


def _body(meshes: Sequence[Mesh], part: str, opacity: float) -> Block:
    return {
        **merged(meshes),
        "name": part,
        "color": "--robot",
        "opacity": opacity,
        "hoverinfo": "skip",
        "flatshading": True,
    }


def _marks(result: Calibration, com: FloatArray) -> list[Block]:
    places = [
        ("CoM found", com, SERIES[0], "circle"),
        ("model file", result.nominal.composite.com, "--muted", "square"),
    ]
    if result.truth is not None:
        places.append(("truth", result.truth.composite.com, SERIES[1], "cross"))
    return [
        {
            "type": "scatter3d", "mode": "markers", "name": name, "showlegend": True,
            **{axis: [round(1000 * float(value), 3)] for axis, value in zip("xyz", place, strict=True)},
            "marker": {"color": colour, "symbol": symbol, "size": 5},
            "hovertemplate": f"{name}: %{{x:.2f}}, %{{y:.2f}}, %{{z:.2f}} mm<extra></extra>",
        }
        for name, place, colour, symbol in places
    ]  # fmt: skip


def _ellipsoids(result: Calibration, com: FloatArray, size: float) -> tuple[list[Block], list[Block], str]:
    """At its true size, and enlarged so that it is seen beside the robot; and by how much."""
    covariance = result.composite.covariance
    if covariance is None:
        return [], [], ""
    directions, half_axes = ellipsoid_95(covariance[1:4, 1:4])
    times = max(1.0, 10.0 * round(_SEEN * size / float(half_axes.max()) / 10))
    look = {"color": SERIES[0], "opacity": 0.45, "showlegend": True, "hoverinfo": "name", "flatshading": False}
    near = {**ellipsoid(com, half_axes, directions), "name": "95 % of the CoM", **look}
    far = {
        **ellipsoid(com, times * half_axes, directions),
        "name": f"95 % of the CoM, {times:.0f} times as large",
        **look,
    }
    axes = " x ".join(f"{1000 * half:.2f}" for half in half_axes[::-1])
    return (
        [near],
        [far],
        f"The ellipsoid holds the CoM with 95 %: half axes {axes} mm, drawn {times:.0f} times as large beside the robot.",
    )


def _reach(result: Calibration, com: FloatArray) -> float:
    """Half the side of the box around the CoM [m]: wide enough for the truth and, if it is near, the model's."""
    others = [result.nominal.composite.com] + ([] if result.truth is None else [result.truth.composite.com])
    far = [1.3 * float(np.abs(other - com).max()) for other in others]
    return max(0.003, *(one for one in far if one < 0.03), far[-1] if result.truth is not None else 0.0)


def _extent(meshes: list[Block], margin: float) -> list[tuple[float, float]]:
    """From the least to the greatest x, y and z of meshes [m], and a margin."""
    places = [np.concatenate([mesh[axis] for mesh in meshes]) / 1000 for axis in "xyz"]
    return [(float(place.min()) - margin, float(place.max()) + margin) for place in places]


def _scene(ranges: list[tuple[float, float]]) -> Block:
    titles = ("x forward [mm]", "y left [mm]", "z up [mm]")
    named = {
        f"{axis}axis": {"title": {"text": title}, "range": [round(1000 * float(v), 2) for v in limits], "nticks": 6}
        for axis, title, limits in zip("xyz", titles, ranges, strict=True)
    }
    return {
        **named,
        "aspectmode": "data",
        "camera": {"eye": {"x": 1.2, "y": 1.4, "z": 0.6}, "center": {"x": 0, "y": 0, "z": -0.12}},
    }
