"""Covers what equipoise uses of coal 3."""

import numpy as np
from numpy.typing import NDArray

class CollisionGeometry:
    aabb_center: NDArray[np.float64]
    aabb_radius: float
    def computeLocalAABB(self) -> None: ...

class Box(CollisionGeometry):
    halfSide: NDArray[np.float64]
    def __init__(self, x: float, y: float, z: float, /) -> None: ...

class Sphere(CollisionGeometry):
    radius: float
    def __init__(self, radius: float, /) -> None: ...

class Capsule(CollisionGeometry):
    radius: float
    halfLength: float
    def __init__(self, radius: float, length: float, /) -> None: ...

class Cylinder(CollisionGeometry):
    radius: float
    halfLength: float

class Halfspace(CollisionGeometry):
    def __init__(self, normal: NDArray[np.float64], offset: float, /) -> None: ...

class Transform3s:
    def __init__(self, *placement: NDArray[np.float64]) -> None: ...

class DistanceRequest: ...

class DistanceResult:
    min_distance: float

def distance(
    first: CollisionGeometry,
    first_pose: Transform3s,
    second: CollisionGeometry,
    second_pose: Transform3s,
    request: DistanceRequest,
    result: DistanceResult,
    /,
) -> float: ...
