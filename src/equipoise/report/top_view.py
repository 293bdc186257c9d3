"""The picture from above, in millimetres: feet, support lines, and centres of mass with their ellipses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import SupportPlane
from equipoise.pictures.geometry import Mesh
from equipoise.report.blocks import Block
from equipoise.report.meshes import body
from equipoise.report.planes import Planes
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import PLANAR_95
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_SMALLEST_ZOOM, _WIDEST_ZOOM = 3.0, 60.0  # [mm] from the middle to the edge


def top_view(results: dict[str, Calibration], planes: Planes = ()) -> Block | None:
    """What is seen from above: of one result with model and truth, or of several over each other.

    Args:
        results: by the name to show.
        planes: of all lifts, if there is one result.

    Returns:
        None if none knows where its CoM is in the plane.
    """
    shown = {name: one for name, one in results.items() if np.isfinite(one.composite.com_in_base.values[:2]).all()}
    if not shown:
        return None
    first = next(iter(shown.values()))
    single = len(results) == 1
    marks = [_found(result, "estimate" if single else name) for name, result in shown.items()]
    marks += _others(first) if single else []
    zoom = _zoom(marks)
    return {
        "type": "top_view",
        **(_robot(first) or {}),
        "lines": _lines(first),
        "planes": _cuts(first, planes),
        "marks": marks,
        "zoom": zoom,
        "caption": _caption(marks, single),
    }


def _found(result: Calibration, label: str) -> Block:
    x, y = (1000 * float(value) for value in result.composite.com_in_base.values[:2])
    mark: Block = {"kind": "found", "label": label, "at": [round(x, 3), round(y, 3)]}
    if result.composite.covariance is not None:
        mark["ellipse"] = ellipse(result.composite.covariance[1:3, 1:3] * 1e6)
    return mark


def ellipse(covariance: FloatArray) -> Block:
    """95 % of a planar normal distribution: half axes [mm], and the angle of the first from x towards y [deg]."""
    values, vectors = np.linalg.eigh(covariance)
    major, minor = (PLANAR_95 * float(np.sqrt(max(value, 0.0))) for value in values[::-1])
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    return {"major": round(major, 4), "minor": round(minor, 4), "angle": round(angle, 2)}


def _others(result: Calibration) -> list[Block]:
    bodies = {"model": ("model file", result.nominal), "truth": ("truth", result.truth)}
    return [
        {"kind": kind, "label": label, "at": [round(1000 * float(v), 3) for v in body.composite.com[:2]]}
        for kind, (label, body) in bodies.items()
        if body is not None
    ]


def _zoom(marks: list[Block]) -> Block:
    """A square that holds all marks, unless one is so far away that the others would be one dot."""
    centre = np.mean([mark["at"] for mark in marks if mark["kind"] == "found"], axis=0)
    away = [float(np.abs(np.array(mark["at"]) - centre).max()) for mark in marks]
    around = [mark["ellipse"]["major"] if "ellipse" in mark else 0.0 for mark in marks]
    whole = max(far + wide for far, wide in zip(away, around, strict=True))
    half = min(_WIDEST_ZOOM, max(_SMALLEST_ZOOM, 1.3 * max(away + around), 1.1 * whole))
    return {"centre": [round(float(v), 3) for v in centre], "half": round(half, 2)}


def _robot(result: Calibration) -> Block | None:
    """Feet, legs and the base's outline; None without the robot's model."""
    robot = result.robot_model
    if robot is None:
        return None
    position = np.array([result.joint_position[name] for name in robot.joint_names])
    feet = foot_positions(robot, position) * 1000
    looks_like = body(result, robot)
    names = zip(LEG_NAMES, feet, robot.legs.values(), strict=True)
    return {
        "outline": _hull(looks_like.base),
        "legs": [_hull([mesh]) for mesh in looks_like.legs],
        "feet": [
            {"name": name, "at": _xy(foot), "radius": round(1000 * leg.foot_radius, 1)} for name, foot, leg in names
        ],
    }


def _hull(meshes: Sequence[Mesh]) -> list[list[float]]:
    """The convex outline of meshes, seen from above [mm]."""
    corners = np.concatenate([mesh.vertices for mesh in meshes])[:, :2] * 1000
    return [_xy(corner) for corner in corners[ConvexHull(corners).vertices]]


def _lines(result: Calibration) -> list[Block]:
    """Where each diagonal balances by the paper's search; else the lines through the feet of the stance."""
    if result.support_lines:
        height = float(result.nominal.composite.com[2])
        found = {
            name: cut(SupportPlane(np.array(line.point), np.array(line.normal)), height)
            for name, line in result.support_lines.items()
        }
        return [{"diagonal": name, **line} for name, line in found.items()]
    robot = result.robot_model
    return [] if robot is None else [_through_feet(robot, result, name) for name in DIAGONALS]


def _through_feet(robot: RobotModel, result: Calibration, diagonal: str) -> Block:
    position = np.array([result.joint_position[name] for name in robot.joint_names])
    feet = foot_positions(robot, position) * 1000
    a, b = (feet[LEG_NAMES.index(leg)][:2] for leg in DIAGONALS[diagonal])
    along = (a - b) / np.linalg.norm(a - b)
    return {"diagonal": diagonal, "at": _xy((a + b) / 2), "along": [round(float(v), 6) for v in along], "feet": True}


def _cuts(result: Calibration, planes: Planes) -> list[Block]:
    """The support planes of all lifts, cut at the height of the CoM."""
    z = result.composite.com_in_base.z
    height = float(result.nominal.composite.com[2]) if z.value is None else z.value
    return [
        {"diagonal": diagonal, **cut(plane, height)}
        for diagonal, plane in planes
        if np.linalg.norm(plane.normal[:2]) > 0.1
    ]


def cut(plane: SupportPlane, height: float) -> Block:
    """The line in which a plane meets the horizontal plane at a height [m]: a point [mm] and a direction."""
    flat = plane.normal[:2]
    point = plane.point[:2] + flat * plane.normal[2] * (plane.point[2] - height) / (flat @ flat)
    along = np.array([flat[1], -flat[0]]) / np.linalg.norm(flat)
    return {"at": _xy(1000 * point), "along": [round(float(v), 6) for v in along]}


def _xy(point: Any) -> list[float]:
    return [round(float(point[0]), 2), round(float(point[1]), 2)]


def _caption(marks: list[Block], single: bool) -> str:
    places = [f"{mark['label']} x {mark['at'][0]:.1f}, y {mark['at'][1]:.1f} mm" for mark in marks]
    what = "feet, support lines and centre of mass" if single else "centres of mass of all runs"
    return f"Seen from above, forward is up: {what}. " + "; ".join(places) + "."
