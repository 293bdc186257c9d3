"""Meshes as traces of Plotly's mesh3d, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.geometry import Mesh, sphere
from equipoise.report.blocks import Block


def ellipsoid(middle: FloatArray, half_axes: FloatArray, directions: FloatArray) -> Block:
    """A trace; directions are columns."""
    ball = sphere(1.0)
    return merged([Mesh(middle + (ball.vertices * half_axes) @ directions.T, ball.faces)], decimals=3)


def merged(meshes: Sequence[Mesh], decimals: int = 1) -> Block:
    """One trace of many meshes, in millimetres."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    points = 1000 * np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
    none = np.zeros((0, 3), dtype=np.int64)
    faces = np.concatenate([none, *(mesh.faces + start for mesh, start in zip(meshes, first, strict=False))])
    places = {axis: np.round(points[:, k], decimals).tolist() for k, axis in enumerate("xyz")}
    return {"type": "mesh3d", **places, **{name: faces[:, k].tolist() for k, name in enumerate("ijk")}}
