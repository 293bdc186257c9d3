"""Covers what equipoise uses of MuJoCo 3.3 to 4."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_FloatArray = NDArray[np.float64]
_IntArray = NDArray[np.int32]
_Floats = Sequence[float] | _FloatArray

__version__: str

# An array of a spec's element; any sequence of floats may be assigned to it.
class _FloatsField:
    def __get__(self, instance: object, owner: type | None = None) -> _FloatArray: ...
    def __set__(self, instance: object, value: _Floats) -> None: ...

class _Enum:
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...

class mjtState(_Enum):
    mjSTATE_FULLPHYSICS: mjtState
    mjSTATE_CTRL: mjtState
    mjSTATE_XFRC_APPLIED: mjtState
    mjSTATE_INTEGRATION: mjtState

class mjtIntegrator(_Enum):
    mjINT_EULER: mjtIntegrator

class mjtDisableBit(_Enum):
    mjDSBL_EULERDAMP: mjtDisableBit
    mjDSBL_MIDPHASE: mjtDisableBit

class mjtCone(_Enum):
    mjCONE_ELLIPTIC: mjtCone

class mjtJacobian(_Enum):
    mjJAC_SPARSE: mjtJacobian

class mjtJoint(_Enum):
    mjJNT_BALL: mjtJoint
    mjJNT_FREE: mjtJoint
    mjJNT_SLIDE: mjtJoint

class mjtGeom(_Enum):
    mjGEOM_PLANE: mjtGeom
    mjGEOM_SPHERE: mjtGeom
    mjGEOM_ELLIPSOID: mjtGeom
    mjGEOM_BOX: mjtGeom
    mjGEOM_CYLINDER: mjtGeom

class mjtLimited(_Enum):
    mjLIMITED_FALSE: mjtLimited
    mjLIMITED_TRUE: mjtLimited

class mjtOrientation(_Enum):
    mjORIENTATION_QUAT: mjtOrientation

class mjtTrn(_Enum):
    mjTRN_JOINT: mjtTrn

class mjtGain(_Enum):
    mjGAIN_FIXED: mjtGain

class mjtBias(_Enum):
    mjBIAS_AFFINE: mjtBias

class mjtSensor(_Enum):
    mjSENS_ACTUATORFRC: mjtSensor
    mjSENS_ACCELEROMETER: mjtSensor

class mjtObj(_Enum):
    mjOBJ_ACTUATOR: mjtObj
    mjOBJ_SITE: mjtObj

class MjOption:
    timestep: float
    integrator: int | mjtIntegrator
    disableflags: int | mjtDisableBit
    cone: int | mjtCone
    jacobian: int | mjtJacobian
    impratio: float
    gravity: _FloatsField

class _BodyView:
    name: str

class _JointView:
    id: int

class _GeomView:
    id: int
    name: str

class _SiteView:
    quat: _FloatArray

class _SensorView:
    adr: _IntArray

class MjModel:
    opt: MjOption
    nq: int
    nv: int
    nu: int
    nbody: int
    ngeom: int
    nsensordata: int
    qpos0: _FloatArray
    jnt_type: _IntArray
    jnt_bodyid: _IntArray
    jnt_qposadr: _IntArray
    jnt_dofadr: _IntArray
    jnt_axis: _FloatArray
    jnt_pos: _FloatArray
    jnt_stiffness: _FloatArray
    jnt_solref: _FloatArray
    jnt_solimp: _FloatArray
    body_parentid: _IntArray
    body_weldid: _IntArray
    body_sameframe: _IntArray
    body_pos: _FloatArray
    body_quat: _FloatArray
    body_mass: _FloatArray
    body_inertia: _FloatArray
    body_ipos: _FloatArray
    body_iquat: _FloatArray
    body_invweight0: _FloatArray
    geom_bodyid: _IntArray
    geom_sameframe: _IntArray
    geom_size: _FloatArray
    geom_pos: _FloatArray
    geom_friction: _FloatArray
    geom_priority: _IntArray
    geom_solref: _FloatArray
    geom_solimp: _FloatArray
    site_sameframe: _IntArray
    dof_frictionloss: _FloatArray
    dof_damping: _FloatArray
    dof_armature: _FloatArray
    dof_solref: _FloatArray
    dof_solimp: _FloatArray
    dof_invweight0: _FloatArray
    actuator_gainprm: _FloatArray
    actuator_biasprm: _FloatArray
    actuator_forcelimited: NDArray[np.bool_]
    actuator_forcerange: _FloatArray
    def body(self, name: str | int, /) -> _BodyView: ...
    def joint(self, name: str | int, /) -> _JointView: ...
    def geom(self, name: str | int, /) -> _GeomView: ...
    def site(self, name: str | int, /) -> _SiteView: ...
    def sensor(self, name: str | int, /) -> _SensorView: ...

class _Contact:
    dist: float

class MjData:
    time: float
    contact: Sequence[_Contact]
    xfrc_applied: _FloatArray
    xpos: _FloatArray
    qpos: _FloatArray
    qvel: _FloatArray
    qacc: _FloatArray
    qacc_warmstart: _FloatArray
    ctrl: _FloatArray
    sensordata: _FloatArray
    xipos: _FloatArray
    ximat: _FloatArray
    xmat: _FloatArray
    xanchor: _FloatArray
    xaxis: _FloatArray
    geom_xpos: _FloatArray
    subtree_com: _FloatArray
    def __init__(self, model: MjModel, /) -> None: ...

class MjsJoint:
    name: str
    type: mjtJoint
    frictionloss: float
    armature: float
    damping: float | _FloatArray
    stiffness: float | _FloatArray
    axis: _FloatsField
    pos: _FloatsField
    limited: int | mjtLimited
    range: _FloatsField
    actfrclimited: int | mjtLimited
    def delete(self) -> None: ...  # up to MuJoCo 3.3.0

class MjsGeom:
    type: mjtGeom
    pos: _FloatsField
    contype: int
    conaffinity: int

class MjsSite: ...
class MjsSensor: ...

class MjsOrientation:
    type: mjtOrientation

class MjsActuator:
    gaintype: mjtGain
    gainprm: _FloatsField
    biastype: mjtBias
    biasprm: _FloatsField
    forcelimited: int | mjtLimited
    forcerange: _FloatsField

class MjsTendon:
    stiffness: float
    def wrap_site(self, name: str, /) -> object: ...

class MjsBody:
    name: str
    pos: _FloatsField
    quat: _FloatsField
    alt: MjsOrientation
    mass: float
    ipos: _FloatsField
    inertia: _FloatsField
    fullinertia: _FloatsField
    explicitinertial: bool
    gravcomp: float
    @property
    def joints(self) -> list[MjsJoint]: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    def add_joint(self, *, name: str = ..., type: mjtJoint, axis: _Floats = ..., pos: _Floats = ...) -> MjsJoint: ...
    def first_body(self) -> MjsBody: ...
    def add_freejoint(self) -> MjsJoint: ...
    def add_body(self, *, name: str, pos: _Floats) -> MjsBody: ...
    def add_site(self, *, name: str, pos: _Floats, quat: _Floats = ...) -> MjsSite: ...
    def add_geom(
        self, *, name: str, type: mjtGeom, size: _Floats, pos: _Floats = ..., **properties: float | _Floats
    ) -> MjsGeom: ...

class MjsCompiler:
    fusestatic: bool

class MjSpec:
    option: MjOption
    compiler: MjsCompiler
    @property
    def worldbody(self) -> MjsBody: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    @property
    def joints(self) -> list[MjsJoint]: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    @staticmethod
    def from_string(xml: str, /) -> MjSpec: ...
    def body(self, name: str, /) -> MjsBody: ...
    def joint(self, name: str, /) -> MjsJoint: ...
    def compile(self) -> MjModel: ...
    def delete(self, element: MjsJoint, /) -> None: ...  # since MuJoCo 3.3.1
    def add_actuator(self, *, name: str, target: str, trntype: mjtTrn) -> MjsActuator: ...
    def add_tendon(self, *, name: str, springlength: _Floats) -> MjsTendon: ...
    def add_sensor(self, *, name: str, type: mjtSensor, objtype: mjtObj, objname: str) -> MjsSensor: ...

def mj_step(model: MjModel, data: MjData, /) -> None: ...
def mj_forward(model: MjModel, data: MjData, /) -> None: ...
def mj_kinematics(model: MjModel, data: MjData, /) -> None: ...
def mj_comPos(model: MjModel, data: MjData, /) -> None: ...
def mj_setConst(model: MjModel, data: MjData, /) -> None: ...
def mj_stateSize(model: MjModel, signature: int | mjtState, /) -> int: ...
def mj_getState(model: MjModel, data: MjData, state: _FloatArray, signature: int | mjtState, /) -> None: ...
def mj_setState(model: MjModel, data: MjData, state: _FloatArray, signature: int | mjtState, /) -> None: ...
def mju_rotVecQuat(result: _FloatArray, vector: _FloatArray, quat: _FloatArray, /) -> None: ...
def mju_mulQuat(result: _FloatArray, quat1: _FloatArray, quat2: _FloatArray, /) -> None: ...
def mju_axisAngle2Quat(result: _FloatArray, axis: _FloatArray, angle: float, /) -> None: ...
def mju_mat2Quat(result: _FloatArray, matrix: _FloatArray, /) -> None: ...
def mju_quat2Mat(result: _FloatArray, quat: _FloatArray, /) -> None: ...
def mj_resetData(model: MjModel, data: MjData, /) -> None: ...
def mj_jac(
    model: MjModel, data: MjData, jacp: _FloatArray, jacr: _FloatArray | None, point: _FloatArray, body: int, /
) -> None: ...
