"""Covers what equipoise uses of Pinocchio 3.3 to 4."""

from collections.abc import Iterator, Sequence
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from . import rpy as rpy

_T = TypeVar("_T")
_FloatArray = NDArray[np.float64]

__version__: str

# Stands for the StdVec_* classes; slices are views.
class _StdVec(Generic[_T]):
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[_T]: ...
    @overload
    def __getitem__(self, index: int) -> _T: ...
    @overload
    def __getitem__(self, index: slice) -> _StdVec[_T]: ...
    def __setitem__(self, index: int, value: _T) -> None: ...

class FrameType(int):
    OP_FRAME: FrameType
    JOINT: FrameType
    FIXED_JOINT: FrameType
    BODY: FrameType
    SENSOR: FrameType

class GeometryType(int):
    VISUAL: GeometryType
    COLLISION: GeometryType

class ReferenceFrame(int): ...

LOCAL_WORLD_ALIGNED: ReferenceFrame

class Motion:
    linear: _FloatArray
    angular: _FloatArray

class Inertia:
    mass: float
    lever: _FloatArray
    inertia: _FloatArray
    @overload
    def __init__(self, mass: float, lever: _FloatArray, inertia: _FloatArray, /) -> None: ...
    @overload
    def __init__(self, clone: Inertia, /) -> None: ...
    @staticmethod
    def Zero() -> Inertia: ...
    def __add__(self, other: Inertia, /) -> Inertia: ...
    def __sub__(self, other: Inertia, /) -> Inertia: ...

class SE3:
    rotation: _FloatArray
    translation: _FloatArray
    @overload
    def __init__(self, rotation: _FloatArray, translation: _FloatArray, /) -> None: ...
    @overload
    def __init__(self, clone: SE3, /) -> None: ...
    @staticmethod
    def Identity() -> SE3: ...
    def inverse(self) -> SE3: ...
    def __mul__(self, other: SE3, /) -> SE3: ...
    @overload
    def act(self, point: _FloatArray, /) -> _FloatArray: ...
    @overload
    def act(self, inertia: Inertia, /) -> Inertia: ...

class Frame:
    name: str
    parentJoint: int
    parentFrame: int
    placement: SE3
    type: FrameType
    inertia: Inertia
    def __init__(
        self, name: str, parent_joint: int, parent_frame: int, placement: SE3, type: FrameType, /
    ) -> None: ...

class JointData:
    S: _FloatArray

class JointModel:
    nq: int
    nv: int
    idx_q: int
    idx_v: int
    def createData(self) -> JointData: ...
    def calc(self, data: JointData, q: _FloatArray, /) -> None: ...

class JointModelFreeFlyer: ...

class GeometryObject:
    name: str
    parentJoint: int
    placement: SE3
    geometry: Any  # a shape of coal or, up to Pinocchio 3.3, of hppfcl

class GeometryModel:
    geometryObjects: _StdVec[GeometryObject]

class Data:
    oMi: _StdVec[SE3]
    oMf: _StdVec[SE3]
    Ig: Inertia

class Model:
    nq: int
    nv: int
    njoints: int
    names: _StdVec[str]
    parents: _StdVec[int]
    joints: _StdVec[JointModel]
    jointPlacements: _StdVec[SE3]
    inertias: _StdVec[Inertia]
    frames: _StdVec[Frame]
    gravity: Motion
    lowerPositionLimit: _FloatArray
    upperPositionLimit: _FloatArray
    velocityLimit: _FloatArray
    effortLimit: _FloatArray
    def copy(self) -> Model: ...
    def createData(self) -> Data: ...
    def addFrame(self, frame: Frame, /) -> int: ...
    def existFrame(self, name: str, /) -> bool: ...
    def getFrameId(self, name: str, /) -> int: ...
    def getJointId(self, name: str, /) -> int: ...

def buildModelFromXML(urdf: str, root_joint: JointModelFreeFlyer, /) -> Model: ...
def buildModelFromMJCF(filename: str, /) -> Model: ...
def buildGeomFromUrdfString(model: Model, urdf: str, type: GeometryType, /) -> GeometryModel: ...
def buildGeomFromMJCF(model: Model, filename: str, type: GeometryType, /) -> GeometryModel: ...
def buildReducedModel(
    model: Model, geometries: Sequence[GeometryModel], joints_to_lock: Sequence[int], configuration: _FloatArray, /
) -> tuple[Model, _StdVec[GeometryModel]]: ...
def neutral(model: Model, /) -> _FloatArray: ...
def forwardKinematics(model: Model, data: Data, q: _FloatArray, /) -> None: ...
def framesForwardKinematics(model: Model, data: Data, q: _FloatArray, /) -> None: ...
def updateFramePlacements(model: Model, data: Data, /) -> None: ...
def computeJointJacobians(model: Model, data: Data, q: _FloatArray, /) -> _FloatArray: ...
def getFrameJacobian(
    model: Model, data: Data, frame_id: int, reference_frame: ReferenceFrame, /
) -> _FloatArray: ...
def computeTotalMass(model: Model, /) -> float: ...
def centerOfMass(model: Model, data: Data, q: _FloatArray, /) -> _FloatArray: ...
def ccrba(model: Model, data: Data, q: _FloatArray, v: _FloatArray, /) -> _FloatArray: ...
def computeGeneralizedGravity(model: Model, data: Data, q: _FloatArray, /) -> _FloatArray: ...
def skew(vector: _FloatArray, /) -> _FloatArray: ...
def exp3(vector: _FloatArray, /) -> _FloatArray: ...
