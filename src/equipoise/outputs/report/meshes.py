"""Triangles of primitive shapes, for Plotly's mesh3d; few of them, in tenths of millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from equipoise.outputs.report.blocks import Block
from equipoise.robot.shapes import Shape

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int_]
Mesh = tuple[FloatArray, IntArray]
"""(n, 3) corners [m], and (m, 3) triangles of their indices."""

_AROUND, _RINGS = 12, 4  # points of a circle, and rings of half a sphere


def mesh_of(shape: Shape) -> Mesh:
    """In the base frame."""
    corners, triangles = _box(shape.size) if shape.kind == "box" else _round(_profile(shape))
    return shape.position + corners @ shape.rotation.T, triangles


def ellipsoid(middle: FloatArray, half_axes: FloatArray, directions: FloatArray) -> Block:
    """A trace; directions are columns."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 4 * _RINGS)
    corners, triangles = _round(np.column_stack([np.cos(angle), np.sin(angle)]), 2 * _AROUND)
    return merged([(middle + (corners * half_axes) @ directions.T, triangles)], decimals=3)


def merged(meshes: Sequence[Mesh], decimals: int = 1) -> Block:
    """One trace of many meshes, in millimetres."""
    corners: list[FloatArray] = []
    triangles: list[IntArray] = []
    count = 0
    for mine, faces in meshes:
        corners.append(mine)
        triangles.append(faces + count)
        count += len(mine)
    points = 1000 * np.concatenate(corners) if corners else np.zeros((0, 3))
    faces = np.concatenate(triangles) if triangles else np.zeros((0, 3), dtype=int)
    places = {axis: np.round(points[:, k], decimals).tolist() for k, axis in enumerate("xyz")}
    return {"type": "mesh3d", **places, **{name: faces[:, k].tolist() for k, name in enumerate("ijk")}}


def _box(half: tuple[float, float, float]) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])


def _profile(shape: Shape) -> FloatArray:
    """(n, 2) radius and height along z of a shape that is round about z, from its bottom to its top."""
    radius, _, half = shape.size
    if shape.kind == "cylinder":
        return np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]])
    angle = np.linspace(-np.pi / 2, 0, _RINGS)
    tall = half if shape.kind == "capsule" else 0.0
    bottom = np.column_stack([radius * np.cos(angle), radius * np.sin(angle) - tall])
    return np.concatenate([bottom, bottom[::-1] * [1, -1]])


def _round(profile: FloatArray, around: int = _AROUND) -> Mesh:
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.column_stack([radius * circle, np.full(around, height)]) for radius, height in profile]
    faces: list[tuple[int, int, int]] = []
    for ring in range(len(profile) - 1):
        for k in range(around):
            a, b = ring * around + k, ring * around + (k + 1) % around
            faces += [(a, b, b + around), (a, b + around, a + around)]
    return np.concatenate(rings), np.array(faces)
