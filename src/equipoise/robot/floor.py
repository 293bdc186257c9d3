"""The floor that feet stand on, by where the joints put them: its normal in base axes.

There are two readings. On feet in one plane they agree; they differ in which feet they may be asked about, and in time.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray

Vector = tuple[float, float, float]


def floor_normal_by_diagonals(feet_in_base: FloatArray) -> Vector:
    """Upward unit normal of both diagonals: of four feet, both on one diagonal may be lifted by the same height.

    In plain numbers: for three of them NumPy takes five times as long, and the guard asks at every step.

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
    """Of many postures, the planes nearest to the feet, which all stand; three feet or four, in any order.

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
