"""What palpate uses of MuJoCo 4, which ships no types. Names and arguments as in the bindings."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, SupportsFloat, SupportsIndex, SupportsInt, overload

import numpy as np
from numpy.typing import NDArray

_Doubles = NDArray[np.float64]
_Floats = NDArray[np.float32]
_Ints = NDArray[np.int32]
_Int = SupportsInt | SupportsIndex
_Float = SupportsFloat | SupportsIndex
_Vector = Sequence[float] | _Doubles

class FatalError(Exception): ...

# Enumerations: no `enum.Enum`, but equal to and hashed like their integers

class _Enum:
    __members__: ClassVar[Mapping[str, _Enum]]
    def __init__(self, value: _Int) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

class mjtGeom(_Enum):
    mjGEOM_PLANE: ClassVar[mjtGeom]
    mjGEOM_HFIELD: ClassVar[mjtGeom]
    mjGEOM_SPHERE: ClassVar[mjtGeom]
    mjGEOM_CAPSULE: ClassVar[mjtGeom]
    mjGEOM_ELLIPSOID: ClassVar[mjtGeom]
    mjGEOM_CYLINDER: ClassVar[mjtGeom]
    mjGEOM_BOX: ClassVar[mjtGeom]
    mjGEOM_MESH: ClassVar[mjtGeom]
    mjGEOM_SDF: ClassVar[mjtGeom]

class mjtJoint(_Enum):
    mjJNT_FREE: ClassVar[mjtJoint]
    mjJNT_BALL: ClassVar[mjtJoint]
    mjJNT_SLIDE: ClassVar[mjtJoint]
    mjJNT_HINGE: ClassVar[mjtJoint]

class mjtObj(_Enum):
    mjOBJ_BODY: ClassVar[mjtObj]
    mjOBJ_XBODY: ClassVar[mjtObj]
    mjOBJ_JOINT: ClassVar[mjtObj]
    mjOBJ_GEOM: ClassVar[mjtObj]
    mjOBJ_SITE: ClassVar[mjtObj]
    mjOBJ_CAMERA: ClassVar[mjtObj]

class mjtCamera(_Enum):
    mjCAMERA_FIXED: ClassVar[mjtCamera]

class mjtCatBit(_Enum):
    mjCAT_ALL: ClassVar[mjtCatBit]

class mjtRndFlag(_Enum):
    mjRND_SEGMENT: ClassVar[mjtRndFlag]
    mjRND_IDCOLOR: ClassVar[mjtRndFlag]

class mjtFramebuffer(_Enum):
    mjFB_OFFSCREEN: ClassVar[mjtFramebuffer]

class mjtFontScale(_Enum):
    mjFONTSCALE_50: ClassVar[mjtFontScale]

class mjtIntegrator(_Enum):
    mjINT_IMPLICITFAST: ClassVar[mjtIntegrator]

class mjtInertiaFromGeom(_Enum):
    mjINERTIAFROMGEOM_AUTO: ClassVar[mjtInertiaFromGeom]

class mjtOrientation(_Enum):
    mjORIENTATION_QUAT: ClassVar[mjtOrientation]

class mjtCone(_Enum):
    mjCONE_ELLIPTIC: ClassVar[mjtCone]

class mjtEq(_Enum):
    mjEQ_CONNECT: ClassVar[mjtEq]
    mjEQ_WELD: ClassVar[mjtEq]
    mjEQ_JOINT: ClassVar[mjtEq]

class mjtTrn(_Enum):
    mjTRN_JOINT: ClassVar[mjtTrn]
    mjTRN_SITE: ClassVar[mjtTrn]
    mjTRN_TENDON: ClassVar[mjtTrn]

class mjtDisableBit(_Enum):
    mjDSBL_CONSTRAINT: ClassVar[mjtDisableBit]
    mjDSBL_EQUALITY: ClassVar[mjtDisableBit]
    mjDSBL_FRICTIONLOSS: ClassVar[mjtDisableBit]
    mjDSBL_LIMIT: ClassVar[mjtDisableBit]
    mjDSBL_CONTACT: ClassVar[mjtDisableBit]
    mjDSBL_SPRING: ClassVar[mjtDisableBit]
    mjDSBL_DAMPER: ClassVar[mjtDisableBit]
    mjDSBL_GRAVITY: ClassVar[mjtDisableBit]
    mjDSBL_ACTUATION: ClassVar[mjtDisableBit]

class mjtSensor(_Enum):
    mjSENS_CONTACT: ClassVar[mjtSensor]
    mjSENS_JOINTACTFRC: ClassVar[mjtSensor]

class mjtConDataField(_Enum):
    mjCONDATA_FOUND: ClassVar[mjtConDataField]
    mjCONDATA_FORCE: ClassVar[mjtConDataField]

class mjtState(_Enum):
    mjSTATE_FULLPHYSICS: ClassVar[mjtState]

class mjtEnableBit(_Enum):
    mjENBL_OVERRIDE: ClassVar[mjtEnableBit]
    mjENBL_SLEEP: ClassVar[mjtEnableBit]

class mjtCtrlChart(_Enum):
    mjCHART_EXPMAP: ClassVar[mjtCtrlChart]
    mjCHART_QUAT: ClassVar[mjtCtrlChart]

class mjtTexture(_Enum):
    mjTEXTURE_2D: ClassVar[mjtTexture]
    mjTEXTURE_CUBE: ClassVar[mjtTexture]
    mjTEXTURE_SKYBOX: ClassVar[mjtTexture]

class mjtTextureRole(_Enum):
    mjTEXROLE_RGB: ClassVar[mjtTextureRole]
    def __index__(self) -> int: ...

class mjtMeshInertia(_Enum):
    mjMESH_INERTIA_SHELL: ClassVar[mjtMeshInertia]

class mjtLightType(_Enum):
    mjLIGHT_DIRECTIONAL: ClassVar[mjtLightType]

class mjtBuiltin(_Enum):
    mjBUILTIN_GRADIENT: ClassVar[mjtBuiltin]

# Compiled model

def get_mju_user_warning() -> Callable[[str], None] | None: ...
def set_mju_user_warning(warn: Callable[[str], None] | None) -> None: ...

class MjOption:
    disableflags: int
    enableflags: int
    timestep: float
    gravity: _Doubles
    integrator: int
    cone: int
    impratio: float
    ccd_tolerance: float
    o_margin: float

class MjVisual:
    class Global:
        fovy: float
        offwidth: int
        offheight: int

    class Map:
        znear: float
        zfar: float
        shadowclip: float
        shadowscale: float

    class Quality:
        shadowsize: int
        numslices: int
        numstacks: int

    class Headlight:
        ambient: _Floats
        diffuse: _Floats
        specular: _Floats

    global_: Global
    quality: Quality
    map: Map
    headlight: Headlight

class _Named:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...

class _MjModelBodyViews(_Named):
    pos: _Doubles
    quat: _Doubles
    ipos: _Doubles
    subtreemass: _Doubles
    iquat: _Doubles
    mass: _Doubles
    inertia: _Doubles
    jntadr: _Ints
    geomadr: _Ints
    geomnum: _Ints

class _MjModelJointViews(_Named):
    qposadr: _Ints
    dofadr: _Ints
    type: _Ints
    range: _Doubles

class _MjModelSiteViews(_Named):
    pos: _Doubles
    quat: _Doubles

class _MjModelGeomViews(_Named): ...
class _MjModelTendonViews(_Named): ...
class _MjModelActuatorViews(_Named): ...
class _MjModelGeomViews(_Named): ...

class _MjModelNumericViews(_Named):
    data: _Doubles

class _MjModelSensorViews:
    adr: _Ints

class _MjModelCameraViews(_Named):
    id: int
    fovy: _Doubles

class _MjStatistic:
    extent: float

class MjModel:
    opt: MjOption
    stat: _MjStatistic
    cam_fovy: _Doubles
    site_size: _Doubles
    vis: MjVisual

    nq: int
    nv: int
    nu: int
    njnt: int
    nsite: int
    nbody: int
    nsensordata: int
    ngeom: int
    nnumeric: int
    nmesh: int

    qpos0: _Doubles
    qpos_spring: _Doubles
    body_parentid: _Ints
    body_rootid: _Ints
    body_weldid: _Ints
    body_dofnum: _Ints
    body_jntnum: _Ints
    body_jntadr: _Ints
    body_dofadr: _Ints
    body_geomnum: _Ints
    body_geomadr: _Ints
    body_pos: _Doubles
    body_quat: _Doubles
    body_iquat: _Doubles
    body_ipos: _Doubles
    body_mass: _Doubles
    body_subtreemass: _Doubles
    body_inertia: _Doubles
    body_margin: _Doubles
    jnt_type: _Ints
    jnt_bodyid: _Ints
    jnt_actfrcrange: _Doubles
    jnt_qposadr: _Ints
    jnt_dofadr: _Ints
    jnt_axis: _Doubles
    jnt_range: _Doubles
    jnt_stiffness: _Doubles
    actuator_trnid: _Ints
    actuator_trntype: _Ints
    jnt_limited: _Ints
    jnt_pos: _Doubles
    dof_armature: _Doubles
    dof_damping: _Doubles
    dof_frictionloss: _Doubles
    geom_type: _Ints
    geom_contype: _Ints
    geom_conaffinity: _Ints
    geom_bodyid: _Ints
    site_bodyid: _Ints
    neq: int
    eq_type: _Ints
    eq_obj1id: _Ints
    eq_obj2id: _Ints
    eq_objtype: _Ints
    eq_active0: NDArray[np.bool_]
    geom_priority: _Ints
    geom_margin: _Doubles
    geom_solref: _Doubles
    geom_solimp: _Doubles
    geom_condim: _Ints
    pair_dim: _Ints
    pair_geom1: _Ints
    pair_geom2: _Ints
    pair_friction: _Doubles
    pair_margin: _Doubles
    exclude_signature: _Ints
    body_contype: _Ints
    body_conaffinity: _Ints
    body_gravcomp: _Doubles
    geom_rbound: _Doubles
    geom_dataid: _Ints
    geom_group: _Ints
    site_group: _Ints
    geom_matid: _Ints
    geom_pos: _Doubles
    geom_quat: _Doubles
    geom_rgba: _Floats
    mat_rgba: _Floats
    geom_size: _Doubles
    geom_aabb: _Doubles
    geom_friction: _Doubles
    mesh_pos: _Doubles
    mesh_quat: _Doubles
    mesh_vertadr: _Ints
    mesh_vertnum: _Ints
    mesh_faceadr: _Ints
    mesh_facenum: _Ints
    mesh_vert: _Floats
    mesh_face: _Ints
    hfield_size: _Doubles
    hfield_adr: _Ints
    hfield_nrow: _Ints
    hfield_ncol: _Ints
    hfield_data: _Doubles
    light_pos: _Doubles
    actuator_ctrladr: _Ints
    actuator_gainprm: _Doubles
    actuator_forcerange: _Doubles
    actuator_biasprm: _Doubles
    tendon_adr: _Ints
    wrap_prm: _Doubles

    @staticmethod
    def from_xml_path(filename: str, assets: Mapping[str, bytes] | None = None) -> MjModel: ...
    @staticmethod
    def from_xml_string(xml: str, assets: Mapping[str, bytes] | None = None) -> MjModel: ...
    @overload
    def body(self, id: _Int, /) -> _MjModelBodyViews: ...
    @overload
    def body(self, name: str = "") -> _MjModelBodyViews: ...
    @overload
    def geom(self, id: _Int, /) -> _MjModelGeomViews: ...
    @overload
    def geom(self, name: str = "") -> _MjModelGeomViews: ...
    @overload
    def joint(self, id: _Int, /) -> _MjModelJointViews: ...
    @overload
    def joint(self, name: str = "") -> _MjModelJointViews: ...
    @overload
    def site(self, id: _Int, /) -> _MjModelSiteViews: ...
    @overload
    def site(self, name: str = "") -> _MjModelSiteViews: ...
    @overload
    def geom(self, id: _Int, /) -> _MjModelGeomViews: ...
    @overload
    def geom(self, name: str = "") -> _MjModelGeomViews: ...
    def sensor(self, name: str) -> _MjModelSensorViews: ...
    def camera(self, name: str) -> _MjModelCameraViews: ...
    @overload
    def actuator(self, id: _Int, /) -> _MjModelActuatorViews: ...
    @overload
    def actuator(self, name: str = "") -> _MjModelActuatorViews: ...
    def tendon(self, name: str) -> _MjModelTendonViews: ...
    @overload
    def numeric(self, id: _Int, /) -> _MjModelNumericViews: ...
    @overload
    def numeric(self, name: str = "") -> _MjModelNumericViews: ...

# State

class _MjDataBodyViews(_Named):
    xpos: _Doubles
    xquat: _Doubles
    xmat: _Doubles
    xipos: _Doubles

class _MjDataSiteViews(_Named):
    xpos: _Doubles
    xmat: _Doubles

class _MjContactList:
    """All contacts of a state, one row each."""

    geom: _Ints
    dist: _Doubles
    pos: _Doubles
    frame: _Doubles
    friction: _Doubles
    dim: _Ints

class MjData:
    time: float
    ncon: int
    ntree_awake: int
    contact: _MjContactList
    qpos: _Doubles
    qvel: _Doubles
    ctrl: _Doubles
    qfrc_actuator: _Doubles
    xfrc_applied: _Doubles
    qfrc_applied: _Doubles
    qfrc_bias: _Doubles
    qfrc_passive: _Doubles
    qfrc_gravcomp: _Doubles
    qacc_warmstart: _Doubles
    sensordata: _Doubles
    qfrc_constraint: _Doubles
    qacc: _Doubles
    cvel: _Doubles
    efc_aref: _Doubles
    efc_D: _Doubles
    xpos: _Doubles
    xquat: _Doubles
    xmat: _Doubles
    xipos: _Doubles
    xanchor: _Doubles
    xaxis: _Doubles
    geom_xpos: _Doubles
    geom_xmat: _Doubles
    site_xpos: _Doubles
    site_xmat: _Doubles
    cam_xpos: _Doubles
    cam_xmat: _Doubles

    def __init__(self, model: MjModel, /) -> None: ...
    @property
    def model(self) -> MjModel: ...
    @overload
    def body(self, id: _Int, /) -> _MjDataBodyViews: ...
    @overload
    def body(self, name: str = "") -> _MjDataBodyViews: ...
    @overload
    def site(self, id: _Int, /) -> _MjDataSiteViews: ...
    @overload
    def site(self, name: str = "") -> _MjDataSiteViews: ...

# Editable model

class _SpecOption(MjOption):
    sleep_tolerance: float

class _SpecElement:
    name: str
    @property
    def id(self) -> int: ...

class MjsFrame(_SpecElement):
    pos: _Doubles
    quat: _Doubles

class MjsDefault: ...

class MjsFlex(_SpecElement):
    contype: int
    conaffinity: int

class MjsGeom(_SpecElement):
    parent: MjsBody
    type: mjtGeom
    size: _Doubles
    margin: float
    pos: _Doubles
    fromto: _Doubles
    contype: int
    conaffinity: int
    condim: int
    priority: int
    group: int
    mass: float
    solmix: float
    friction: _Vector
    solref: _Doubles
    solimp: _Doubles
    meshname: str
    material: str
    quat: _Doubles
    rgba: _Vector

class MjsCamera(_SpecElement): ...
class MjsSkin(_SpecElement): ...

class _SpecPlugin:
    active: bool

class _SpecOrientation:
    type: mjtOrientation

class MjsMesh(_SpecElement):
    file: str
    inertia: _Int
    maxhullvert: int
    content_type: str
    scale: _Vector
    refpos: _Vector
    refquat: _Vector
    uservert: _Vector
    userface: Sequence[int]
    usernormal: _Vector
    usertexcoord: _Vector
    userfacenormal: Sequence[int]
    userfacetexcoord: Sequence[int]
    @property
    def plugin(self) -> _SpecPlugin: ...
    def make_sphere(self, subdivision: int, /) -> None: ...

class MjsSensor(_SpecElement): ...
class MjsExclude(_SpecElement): ...

class MjsPair(_SpecElement):
    condim: int
    margin: float
    friction: _Vector
    solref: _Doubles
    solimp: _Doubles

class MjsSite(_SpecElement):
    size: _Doubles
    parent: MjsBody

class MjsLight(_SpecElement):
    dir: _Doubles
    diffuse: _Floats
    specular: _Floats

class MjsText(_SpecElement):
    data: str

class MjsMaterial(_SpecElement):
    rgba: _Vector
    texuniform: bool
    textures: list[str]

class MjsEquality(_SpecElement):
    data: _Doubles
    solref: _Doubles
    solimp: _Doubles

class MjsTendon(_SpecElement):
    def wrap_joint(self, name: str, coef: float) -> object: ...

class MjsKey(_SpecElement): ...

class MjsJoint(_SpecElement):
    actgravcomp: bool
    damping: _Doubles
    frictionloss: float
    actfrcrange: _Vector
    axis: _Doubles
    ref: float
    @property
    def parent(self) -> MjsBody: ...

class MjsTexture(_SpecElement):
    width: int
    height: int
    nchannel: int
    data: bytes
    @property
    def type(self) -> mjtTexture: ...
    @type.setter
    def type(self, value: _Int) -> None: ...

class MjsActuator(_SpecElement):
    gear: _Doubles
    def set_to_position(
        self,
        kp: _Float,
        kv: _Float = -1,
        dampratio: _Float = -1,
        timeconst: _Float = -1,
        inheritrange: bool = False,
    ) -> None: ...
    def set_to_orientation(
        self, kp: _Float, kv: _Float = -1, dampratio: _Float = -1, ctrlspec: _Int = 0
    ) -> None: ...

class MjsBody(_SpecElement):
    pos: _Doubles
    quat: _Doubles
    ipos: _Doubles
    iquat: _Doubles
    mass: float
    inertia: _Doubles
    explicitinertial: bool
    fullinertia: _Doubles
    gravcomp: float
    @property
    def parent(self) -> MjsBody: ...
    def add_freejoint(self) -> MjsJoint: ...
    @property
    def ialt(self) -> _SpecOrientation: ...
    def add_body(
        self,
        *,
        name: str | None = None,
        pos: _Vector | None = None,
        quat: _Vector | None = None,
        mass: _Float | None = None,
        ipos: _Vector | None = None,
        fullinertia: _Vector | None = None,
        explicitinertial: bool | None = None,
    ) -> MjsBody: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    @property
    def lights(self) -> list[MjsLight]: ...
    @property
    def cameras(self) -> list[MjsCamera]: ...
    @property
    def sites(self) -> list[MjsSite]: ...
    def add_geom(
        self,
        *,
        name: str | None = None,
        type: _Int | None = None,
        pos: _Vector | None = None,
        size: _Vector | None = None,
        group: _Int | None = None,
        mass: _Float | None = None,
        contype: _Int | None = None,
        conaffinity: _Int | None = None,
        material: str | None = None,
        meshname: str | None = None,
        quat: _Vector | None = None,
        rgba: _Vector | None = None,
    ) -> MjsGeom: ...
    def add_frame(
        self, *, name: str | None = None, pos: _Vector | None = None, quat: _Vector | None = None
    ) -> MjsFrame: ...
    def add_site(
        self,
        default: MjsDefault | None = None,
        *,
        name: str | None = None,
        pos: _Vector | None = None,
        quat: _Vector | None = None,
        group: _Int | None = None,
    ) -> MjsSite: ...
    def add_camera(
        self,
        *,
        name: str | None = None,
        pos: _Vector | None = None,
        quat: _Vector | None = None,
        fovy: float | None = None,
    ) -> object: ...
    def add_light(
        self,
        *,
        name: str | None = None,
        pos: _Vector | None = None,
        dir: _Vector | None = None,
        diffuse: _Vector | None = None,
        specular: _Vector | None = None,
        ambient: _Vector | None = None,
        type: _Int | None = None,
        cutoff: _Float | None = None,
        exponent: _Float | None = None,
        castshadow: _Int | None = None,
    ) -> MjsLight: ...

class _SpecCompiler:
    usethread: bool
    fusestatic: bool
    discardvisual: bool
    boundmass: float
    boundinertia: float
    settotalmass: float
    inertiafromgeom: mjtInertiaFromGeom

class MjSpec:
    modelfiledir: str
    modelname: str
    meshdir: str
    @property
    def sites(self) -> list[MjsSite]: ...
    @property
    def cameras(self) -> list[MjsCamera]: ...
    @property
    def skins(self) -> list[MjsSkin]: ...
    @property
    def joints(self) -> list[MjsJoint]: ...
    @property
    def meshes(self) -> list[MjsMesh]: ...
    @property
    def texts(self) -> list[MjsText]: ...
    @property
    def visual(self) -> MjVisual: ...
    def add_mesh(self, *, name: str | None = None) -> MjsMesh: ...
    def add_material(
        self,
        *,
        name: str | None = None,
        rgba: _Vector | None = None,
        specular: _Float | None = None,
        shininess: _Float | None = None,
        texrepeat: _Vector | None = None,
    ) -> MjsMaterial: ...
    def to_xml(self) -> str: ...
    @property
    def compiler(self) -> _SpecCompiler: ...
    @property
    def option(self) -> _SpecOption: ...
    @property
    def worldbody(self) -> MjsBody: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    @property
    def flexes(self) -> list[MjsFlex]: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    @property
    def lights(self) -> list[MjsLight]: ...
    @property
    def textures(self) -> list[MjsTexture]: ...
    @property
    def sensors(self) -> list[MjsSensor]: ...
    @property
    def excludes(self) -> list[MjsExclude]: ...
    @property
    def pairs(self) -> list[MjsPair]: ...
    @property
    def equalities(self) -> list[MjsEquality]: ...
    @property
    def tendons(self) -> list[MjsTendon]: ...
    @property
    def actuators(self) -> list[MjsActuator]: ...
    @property
    def keys(self) -> list[MjsKey]: ...
    @staticmethod
    def from_file(
        filename: str,
        include: Mapping[str, bytes] | None = None,
        assets: Mapping[str, bytes] | None = None,
    ) -> MjSpec: ...
    @staticmethod
    def from_string(
        xml: str,
        include: Mapping[str, bytes] | None = None,
        assets: Mapping[str, bytes] | None = None,
    ) -> MjSpec: ...
    def compile(self) -> MjModel: ...
    def copy(self) -> MjSpec: ...
    def delete(self, element: _SpecElement, /) -> None: ...
    def attach(
        self,
        child: MjSpec,
        prefix: str | None = None,
        suffix: str | None = None,
        site: MjsSite | str | None = None,
        frame: MjsFrame | str | None = None,
    ) -> MjsFrame: ...
    def body(self, name: str, /) -> MjsBody: ...
    def mesh(self, name: str, /) -> MjsMesh | None: ...
    def material(self, name: str, /) -> MjsMaterial | None: ...
    def joint(self, name: str, /) -> MjsJoint: ...
    def find_default(self, name: str, /) -> MjsDefault: ...
    def add_actuator(
        self,
        default: MjsDefault | None = None,
        *,
        name: str | None = None,
        trntype: _Int | None = None,
        target: str | None = None,
        refsite: str | None = None,
        ctrlrange: _Vector | None = None,
        forcerange: _Vector | None = None,
    ) -> MjsActuator: ...
    def add_sensor(
        self,
        *,
        name: str,
        type: mjtSensor,
        objtype: mjtObj = ...,
        objname: str = ...,
        intprm: Sequence[int] = ...,
    ) -> None: ...
    def add_exclude(self, *, bodyname1: str, bodyname2: str) -> MjsExclude: ...
    def add_pair(
        self, default: MjsDefault | None = None, *, geomname1: str, geomname2: str
    ) -> MjsPair: ...
    def add_tendon(
        self, default: MjsDefault | None = None, *, name: str | None = None
    ) -> MjsTendon: ...
    def add_equality(
        self, *, type: _Int | None = None, name1: str | None = None, name2: str | None = None
    ) -> MjsEquality: ...
    def add_texture(
        self,
        *,
        name: str | None = None,
        type: _Int | None = None,
        builtin: _Int | None = None,
        rgb1: _Vector | None = None,
        rgb2: _Vector | None = None,
        nchannel: _Int | None = None,
        width: _Int | None = None,
        height: _Int | None = None,
    ) -> MjsTexture: ...

# Pictures

class MjvCamera:
    type: _Int
    fixedcamid: int
    lookat: _Doubles
    distance: float
    azimuth: float
    elevation: float

class MjvOption: ...

class MjvGeom:
    segid: int
    objtype: int
    objid: int

class MjvScene:
    ngeom: int
    flags: NDArray[np.uint8]
    geoms: Sequence[MjvGeom]
    def __init__(self, model: MjModel, maxgeom: _Int) -> None: ...

class MjrRect:
    width: int
    height: int
    def __init__(self, left: _Int, bottom: _Int, width: _Int, height: _Int) -> None: ...

class MjrContext:
    def __init__(self, model: MjModel, fontscale: _Int) -> None: ...
    def free(self) -> None: ...

# Functions

def mjr_setBuffer(framebuffer: _Int, con: MjrContext) -> None: ...
def mjr_render(viewport: MjrRect, scn: MjvScene, con: MjrContext) -> None: ...
def mjr_readPixels(
    rgb: NDArray[np.uint8] | None, depth: _Floats | None, viewport: MjrRect, con: MjrContext
) -> None: ...
def mjv_updateScene(
    m: MjModel,
    d: MjData,
    opt: MjvOption,
    pert: None,
    cam: MjvCamera,
    catmask: _Int,
    scn: MjvScene,
) -> None: ...
def mj_stateSize(m: MjModel, sig: _Int) -> int: ...
def mj_getState(m: MjModel, d: MjData, state: _Doubles, sig: _Int) -> None: ...
def mj_step(m: MjModel, d: MjData, nstep: _Int = 1) -> None: ...
def mj_copyData(dest: MjData, m: MjModel, src: MjData) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_collision(m: MjModel, d: MjData) -> None: ...
def mj_applyFT(
    m: MjModel,
    d: MjData,
    force: _Doubles,
    torque: _Doubles,
    point: _Doubles,
    body: int,
    qfrc_target: _Doubles,
) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_comPos(m: MjModel, d: MjData) -> None: ...
def mj_crb(m: MjModel, d: MjData) -> None: ...
def mj_comVel(m: MjModel, d: MjData) -> None: ...
def mj_setConst(m: MjModel, d: MjData) -> None: ...
def mj_fwdPosition(m: MjModel, d: MjData) -> None: ...
def mj_fullM(m: MjModel, d: MjData, dst: _Doubles) -> None: ...
def mj_jac(
    m: MjModel, d: MjData, jacp: _Doubles | None, jacr: _Doubles | None, point: _Doubles, body: _Int
) -> None: ...
def mj_jacSite(
    m: MjModel, d: MjData, jacp: _Doubles | None, jacr: _Doubles | None, site: _Int
) -> None: ...
def mj_contactForce(m: MjModel, d: MjData, id: _Int, result: _Doubles) -> None: ...
def mj_jacBody(
    m: MjModel, d: MjData, jacp: _Doubles | None, jacr: _Doubles | None, body: _Int
) -> None: ...
def mj_rne(m: MjModel, d: MjData, flg_acc: _Int, result: _Doubles) -> None: ...
def mj_geomDistance(
    m: MjModel, d: MjData, geom1: _Int, geom2: _Int, distmax: _Float, fromto: _Doubles | None
) -> float: ...
def mj_name2id(m: MjModel, type: _Int, name: str) -> int: ...
def mju_euler2Quat(quat: _Doubles, euler: _Doubles, seq: str) -> None: ...
def mju_mat2Quat(quat: _Doubles, mat: _Doubles) -> None: ...
def mju_mulQuat(res: _Doubles, quat1: _Doubles, quat2: _Doubles) -> None: ...
def mju_quat2Mat(res: _Doubles, quat: _Doubles) -> None: ...
def mju_rotVecQuat(res: _Doubles, vec: _Doubles, quat: _Doubles) -> None: ...
def mju_quatIntegrate(quat: _Doubles, vel: _Doubles, scale: _Float) -> None: ...
def mju_subQuat(res: _Doubles, qa: _Doubles, qb: _Doubles) -> None: ...
def mju_cholFactor(mat: _Doubles, mindiag: float) -> int: ...
def mju_cholSolve(res: _Doubles, mat: _Doubles, vec: _Doubles) -> None: ...
