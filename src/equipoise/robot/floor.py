"""Floor normal in base axes from the foot positions, and the CoM position of a robot on three feet.

There are two computations of the normal, which agree for feet in one plane. They differ in the feet that they accept, and in
speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray

Vector = tuple[float, float, float]


def floor_normal_by_diagonals(feet_in_base: FloatArray) -> Vector:
    """Return the upward unit normal of both diagonals; two diagonal feet may be lifted by the same height.

    It uses plain numbers, because NumPy takes five times as long and the guard calls it at every step.

    Args:
        feet_in_base: (4, 3) foot positions FL FR RL RR in the base frame [m].
    """
    front_left, front_right, rear_left, rear_right = feet_in_base.tolist()
    ax, ay, az = (a - b for a, b in zip(rear_left, front_right, strict=True))
    bx, by, bz = (a - b for a, b in zip(front_left, rear_right, strict=True))
    x, y, z = az * by - ay * bz, ax * bz - az * bx, ay * bx - ax * by
    length = max((x * x + y * y + z * z) ** 0.5, 1e-9)
    return x / length, y / length, z / length


def floor_normals_by_fit(feet_in_base: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return, for many postures, the planes nearest to the feet, all on the floor; three or four feet, in any order.

    Args:
        feet_in_base: (n, 3 or 4, 3) foot positions in the base frame [m]; the base is above them.

    Returns:
        (n, 3) upward unit normals in base axes, and (n,) unevenness of the feet, over their distances.
    """
    centred = feet_in_base - feet_in_base.mean(axis=1, keepdims=True)
    _, sizes, axes = np.linalg.svd(centred)
    normal = axes[:, 2]
    normal = normal * np.sign(-np.einsum("ni,ni->n", normal, feet_in_base.mean(axis=1)))[:, None]
    return normal, sizes[:, 2] / sizes[:, 1]


def floor_normal_of(feet_in_base: FloatArray, standing: Sequence[int]) -> Vector:
    """Return the upward unit normal of the floor under the standing feet, of (4, 3) in the base frame [m].

    Three feet determine their plane; for two or four it is that of `floor_normal_by_diagonals`.
    """
    if len(standing) != 3:
        return floor_normal_by_diagonals(feet_in_base)
    first, second, third = feet_in_base[list(standing)]
    normal = np.cross(second - first, third - first)
    x, y, z = (normal * np.sign(normal[2]) / np.linalg.norm(normal)).tolist()
    return x, y, z


def over_three_feet(feet: FloatArray, lifted: int, share: float) -> FloatArray:
    """Return the (2,) place for the CoM of a robot that lifts one foot [m].

    Args:
        feet: (4, 2) places of the feet [m].
        lifted: index of the foot that is lifted.
        share: part of the way from the middle of four feet to that of the three that stand.
    """
    return np.asarray(share * np.delete(feet, lifted, axis=0).mean(axis=0) + (1 - share) * feet.mean(axis=0))


def margin_inside(corners: FloatArray, place: FloatArray) -> float:
    """Return the distance of a (2,) place from the nearest edge of a triangle of (3, 2) corners; negative outside [m]."""
    a, b = corners, np.roll(corners, -1, axis=0)
    edge, to_place = b - a, place - a
    across = edge[:, 0] * to_place[:, 1] - edge[:, 1] * to_place[:, 0]
    third = np.roll(corners, -2, axis=0) - a
    turn = np.sign(edge[:, 0] * third[:, 1] - edge[:, 1] * third[:, 0])
    return float((turn * across / np.linalg.norm(edge, axis=1)).min())
