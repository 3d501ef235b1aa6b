"""Description of an arm: its MJCF, prepared for a world, and its numbers from one folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.pose import Array, Pose, components
from palpate.mjcf.bounds import require_limits
from palpate.mjcf.reading import read_document
from palpate.robots.sheet import (
    FILE,
    Accuracy,
    ControllerStiffness,
    Hardware,
    MotionLimits,
    OwnReflex,
    ParallelHand,
    Reach,
    Reflex,
    Reflexes,
    ReflexSheet,
    SensorErrors,
    Sheet,
    WristSheet,
    read_sheet,
)
from palpate.robots.trajectory import rotate_quaternion
from palpate.trace.recording import Chain, ChainLink, NominalHand, Triple, WrenchSensor
from palpate.trace.samples import STANDARD_GRAVITY

if TYPE_CHECKING:
    from palpate.robots.robot_config import EndEffector, RobotConfig


# N m s/rad: joint damping behind the sensors. Damping and friction of a file belong to the gears,
# before the sensors.
LINK_DAMPING = 0.003
PAD_FRICTION = (1.0, 0.01, 0.0001)  # of rubber: sliding, torsional (m) and rolling (m)
# Joints of an arm, and of one with a six-axis sensor. With six joints, a pose fixes the elbow: joint
# torques then have no reference in the same configuration, and the sensor weighs instead.
AXES, SENSED_AXES = 7, (6, 7)
WORLD, OWN = 1, 1 << 20  # contact bits: the default one, and a rare one for the arm's own shapes
OVERLAPPING = 2  # joints between bodies whose shapes may overlap
MISPLACED = 0.003  # m by which TCP and palm may differ from the shapes of the hand
LEVEL = 0.999  # cosine of the largest inclination of the tool at home
PREFIX = "robot/"  # prefix of the arm's names in a world
SENSOR = "palpate_wrench_sensor"  # body and site of a six-axis sensor
TCP = "palpate_tcp"  # site of a TCP that a description gives as a position


def mount_sensor(spec: mujoco.MjSpec, hand: ParallelHand, sensor: WristSheet) -> None:
    """Mount a six-axis sensor before the hand: its body on the flange, its site in the hand's body.

    The site measures what the flange exerts on the hand and on everything below it.
    """
    body = spec.body(hand.body)
    parent, along = body.parent, Pose.of((0.0, 0.0, 0.0), body.quat).rotation[:, 2]
    if sensor.mass or sensor.height:
        half = max(sensor.height, 1e-3) / 2.0
        casing = parent.add_body(name=SENSOR, pos=body.pos + half * along, quat=body.quat)
        size = [sensor.radius, half, 0.0]
        shape = casing.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, mass=sensor.mass)
        shape.contype, shape.conaffinity = 1, 0
        # A uniform cylinder.
        across = sensor.mass * (3.0 * sensor.radius**2 + (2.0 * half) ** 2) / 12.0
        inertia = [across, across, sensor.mass * sensor.radius**2 / 2.0]
        casing.mass, casing.inertia[:], casing.explicitinertial = sensor.mass, inertia, True
        body.pos = body.pos + sensor.height * along
    body.add_site(name=SENSOR, group=4)


def compile_arm(mjcf: Path, sheet: Sheet) -> mujoco.MjModel:
    """Compile an arm's file with the sensor that its description mounts.

    Raises InputError: MuJoCo does not accept the file, or it is larger than a robot's.
    """
    model = compile_mjcf(mjcf)
    names = [model.body(i).name for i in range(model.nbody)]
    if sheet.wrench_sensor is None or sheet.hand.body not in names:
        return model
    spec = mujoco.MjSpec.from_file(str(mjcf))
    mount_sensor(spec, sheet.hand, sheet.wrench_sensor)
    return spec.compile()


def sensor_of(model: mujoco.MjModel, sheet: Sheet) -> WrenchSensor | None:
    """Return the six-axis sensor of an arm as its owner knows it, None without one."""
    if sheet.wrench_sensor is None:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    place = data.site(SENSOR).xpos.copy()
    site = Pose(place, data.body(sheet.hand.body).xquat.copy())
    pose = tool_pose(model, data, sheet.hand).inverse() @ site
    stated = sheet.wrench_sensor
    return WrenchSensor(
        stated.label, tuple(pose.vector.tolist()), stated.gain, stated.crosstalk, stated.mounting
    )


def compile_mjcf(mjcf: Path) -> mujoco.MjModel:
    """Compile an MJCF file. Raises InputError: MuJoCo does not accept the file, or it is larger than a robot's."""
    require_limits(read_document(mjcf), str(mjcf))
    try:
        return mujoco.MjModel.from_xml_path(str(mjcf))
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{mjcf} is not an MJCF that MuJoCo accepts: {error}") from None


def tool_pose(model: mujoco.MjModel, data: mujoco.MjData, hand: ParallelHand) -> Pose:
    """Return the TCP's pose: position of its site or in the hand's body, orientation of that body."""
    body = data.body(hand.body)
    if isinstance(hand.tcp, str):
        return Pose(data.site(hand.tcp).xpos.copy(), body.xquat.copy())
    frame = Pose(body.xpos.copy(), body.xquat.copy())
    return Pose(frame.apply(hand.tcp), frame.quaternion)


def chain(model: mujoco.MjModel, sheet: Sheet) -> Chain:
    """Return axes, anchors, tool and links of the arm in `model`, which holds the arm alone."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = [model.joint(name).id for name in sheet.joints]
    tool = tool_pose(model, data, sheet.hand)
    return Chain(
        tuple(triple(data.xaxis[i]) for i in ids),
        tuple(triple(data.xanchor[i]) for i in ids),
        triple(tool.position),
        (triple(tool.rotation[0]), triple(tool.rotation[1]), triple(tool.rotation[2])),
        tuple(links_of(model, data, ids)),
    )


def links_of(
    model: mujoco.MjModel, data: mujoco.MjData, hinges: Sequence[int]
) -> Iterator[ChainLink]:
    """Yield the links that the hinges move, in the current configuration."""
    mujoco.mj_comPos(model, data)
    for body in range(1, model.nbody):
        # A link belongs to the last hinge that moves it; massless bodies are left out.
        moved_by = [i for i, hinge in enumerate(hinges) if carries(model, hinge, body)]
        if moved_by and model.body_mass[body] > 0.0:
            here: Any = data.body(body)
            mass = float(model.body_mass[body])
            # Inertia about the centre of mass, rotated from principal axes to the world: R diag(I) R^T.
            axes = np.asarray(here.ximat, dtype=np.float64).reshape(3, 3)
            moments = np.asarray(model.body_inertia[body], dtype=np.float64)
            xx, yy, zz, xy, xz, yz = components((axes * moments) @ axes.T)
            yield ChainLink(moved_by[-1], mass, triple(here.xipos), (xx, yy, zz, xy, xz, yz))


def carries(model: mujoco.MjModel, joint: int, body: int) -> bool:
    """Test if a joint moves a body."""
    carried = int(model.jnt_bodyid[joint])
    while body > carried:
        body = int(model.body_parentid[body])
    return body == carried


def triple(vector: Array) -> Triple:
    """Convert a vector (3,) to a tuple."""
    x, y, z = vector.tolist()
    return x, y, z


def require_arm(where: Path, sheet: Sheet, model: mujoco.MjModel) -> None:
    """Require hinges and a parallel hand, and no other joints.

    Raises InputError: another kind of robot; the message names the reason.
    """
    require_axes(where, sheet)
    # Every named part exists.
    joints = [model.joint(i).name for i in range(model.njnt)]
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    sites = [model.site(i).name for i in range(model.nsite)]
    moving, tcp = (*sheet.joints, *sheet.hand.fingers), sheet.hand.tcp
    named = [("joint", name, joints) for name in moving]
    named += [("body", sheet.hand.body, bodies)]
    named += [("site", tcp, sites)] if isinstance(tcp, str) else []
    for kind, name, known in named:
        if name not in known:
            raise unknown_name(kind, name, known, f"It is named in {where}.")
    # No other joints exist, and joints have the right types.
    others = [name for name in joints if name not in moving]
    if others:
        raise InputError(f"{where}: nothing else may move, but {', '.join(others)} does")
    kinds = {
        **dict.fromkeys(sheet.joints, ("hinge", mujoco.mjtJoint.mjJNT_HINGE)),
        **dict.fromkeys(sheet.hand.fingers, ("slide", mujoco.mjtJoint.mjJNT_SLIDE)),
    }
    for name, (kind, wanted) in kinds.items():
        if model.joint(name).type[0] != int(wanted):
            raise InputError(f"{where}: '{name}' must be a {kind}")
    require_hand(where, sheet, model)


def require_axes(where: Path, sheet: Sheet) -> None:
    """Require a number of joints that can weigh, and as many figures of each kind.

    Raises InputError: too few or too many joints, or a list of another length.
    """
    count = len(sheet.joints)
    if count not in ((AXES,) if sheet.wrench_sensor is None else SENSED_AXES):
        raise InputError(
            f"{where}: 'joints' names {count}; give an arm with {AXES} joints, or one with 6 and a "
            "six-axis sensor at the wrist, as 'wrench_sensor'. With 6 joints a pose fixes the elbow, "
            "and joint torques alone have no reference for a weight"
        )
    lists = {
        "home": sheet.home,
        "velocity": sheet.velocity,
        "torque": sheet.torque,
        "ripple_cycles": sheet.ripple_cycles,
        "stiffness.joints": sheet.stiffness.joints,
        "hardware.stiffness.joints": sheet.hardware and sheet.hardware.stiffness.joints,
        "sensors.torque_noise": sheet.sensors.torque_noise,
        "sensors.friction": sheet.sensors.friction,
        **{f"postures[{i}]": row for i, row in enumerate(sheet.postures)},
    }
    for name, values in lists.items():
        if values is not None and len(values) != count:
            like = "; 'like' took it over from another arm" if "." in name or "[" in name else ""
            raise InputError(
                f"{where}: '{name}': give a list of {count} numbers, one a joint, not "
                f"{len(values)}{like}"
            )


def require_hand(where: Path, sheet: Sheet, model: mujoco.MjModel) -> None:
    """Require that the tool points down at home, and that the fingers move along its y axis, towards each
    other.
    """
    data = at_home(model, sheet.joints, sheet.home)
    mujoco.mj_kinematics(model, data)
    tool = tool_pose(model, data, sheet.hand).rotation
    if tool[2, 2] > -LEVEL:
        raise InputError(
            f"{where}: at 'home' the hand's z axis must point down, not along "
            f"{np.round(tool[:, 2], 3).tolist()}"
        )
    ways = [float(data.xaxis[model.joint(name).id] @ tool[:, 1]) for name in sheet.hand.fingers]
    if min(map(abs, ways)) < LEVEL or ways[0] * ways[1] > 0:
        raise InputError(
            f"{where}: the fingers must move against each other along the y axis of "
            f"'{sheet.hand.body}'"
        )


def at_home(model: mujoco.MjModel, joints: Sequence[str], home: Array) -> mujoco.MjData:
    """Make data with the joints at `home`."""
    data = mujoco.MjData(model)
    for name, angle in zip(joints, home.tolist(), strict=True):
        data.qpos[int(model.joint(name).qposadr[0])] = angle
    return data


def prepare_spec(arm: RobotDescription) -> mujoco.MjSpec:
    """Return an editable copy of the arm: base at the origin, no actuators, no surroundings.

    Its shapes collide with the world's, and with each other except for `neighbours`.
    """
    return _prepare_spec(arm).copy()


@lru_cache(8)
def _prepare_spec(arm: RobotDescription) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(arm.mjcf))
    if arm.wrench_sensor is not None:
        mount_sensor(spec, arm.hand, arm.wrench_sensor)
    option = spec.option
    option.timestep, option.impratio = 0.001, 20.0  # a grasped object does not creep with these
    option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    option.cone = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    # Remove the surroundings, and give all bodies explicit inertias.
    strip(spec, arm.base)
    set_explicit_inertia(spec, arm.mjcf)
    # The controller drives the joints: only their damping and torque limits stay.
    for name, limit in zip(arm.joints, arm.limits.tau_max.tolist(), strict=True):
        joint = spec.joint(name)
        joint.damping[:], joint.frictionloss = (LINK_DAMPING, 0.0, 0.0), 0.0
        joint.actfrcrange = (-limit, limit)
    # Shapes collide with the world by the default bit, with each other by the arm's own.
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = WORLD | OWN, OWN
    if not isinstance(arm.hand.tcp, str):
        spec.body(arm.hand.body).add_site(name=TCP, pos=arm.hand.tcp, group=4)
    if arm.hand.pads is not None:
        for finger in arm.hand.fingers:
            set_pad(spec.joint(finger).parent, arm.hand.pads.centre, arm.hand.pads.half)
    return spec


def neighbours(spec: mujoco.MjSpec, arm: RobotDescription) -> set[frozenset[str]]:
    """Find the pairs of the arm's bodies whose shapes may touch.

    They are pairs up to `OVERLAPPING` joints apart, whose simple solids overlap, and pairs that touch at
    home. All bodies that the last joint moves count as one.
    """
    # Number of joints between the base and each body.
    last = len(arm.links) - 1
    place = {body.name: last for body in spec.bodies if body.name not in ("", "world")}
    place |= {name: i for i, name in enumerate(arm.links)}
    # Pairs that touch at home.
    model = spec.compile()
    data = at_home(model, arm.joints, arm.home)
    mujoco.mj_forward(model, data)
    touching = model.geom_bodyid[data.contact.geom].tolist()
    found = {frozenset(model.body(int(body)).name for body in pair) for pair in touching}
    for (one, i), (other, j) in combinations(place.items(), 2):
        if abs(i - j) <= OVERLAPPING:
            found.add(frozenset({one, other}))
    return found


def strip(spec: mujoco.MjSpec, base: str) -> None:
    """Delete all elements except the arm, and move it to the origin."""
    driven = (*spec.actuators, *spec.sensors, *spec.equalities, *spec.tendons, *spec.keys)
    for element in (*driven, *spec.excludes, *spec.pairs):
        spec.delete(element)
    world = spec.worldbody
    around = [body for body in world.bodies if body.name != base]
    for element in (*around, *world.geoms, *world.lights, *world.cameras, *world.sites):
        spec.delete(element)
    spec.body(base).pos, spec.body(base).quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def set_explicit_inertia(spec: mujoco.MjSpec, mjcf: Path) -> None:
    """Set masses that a file derives from its shapes: the nominal arm is computed without shapes."""
    open_bodies = [body for body in spec.bodies if body.name and not body.explicitinertial]
    if not open_bodies:
        return
    model = compile_mjcf(mjcf)
    for body in open_bodies:
        if body.name == "world":
            continue
        stated = model.body(body.name)
        body.mass, body.ipos, body.iquat = float(stated.mass[0]), stated.ipos, stated.iquat
        body.inertia, body.explicitinertial = stated.inertia, True


def set_pad(finger: mujoco.MjsBody, centre: Array, half: Array) -> None:
    """Replace a finger's colliding shapes by one box: with several shapes, a grasped object creeps."""
    for geom in finger.geoms:
        geom.contype = geom.conaffinity = 0
    pad = finger.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=half, group=3, mass=0.0)
    pad.contype, pad.conaffinity, pad.priority, pad.condim = WORLD | OWN, OWN, 1, 4
    pad.friction = PAD_FRICTION
    pad.solref[:2], pad.solimp[:3] = (0.004, 1.0), (0.95, 0.99, 0.001)


# Description of an arm with its hand, read from one folder: the only source of an arm's numbers.


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Safety limits of the arm."""

    q_min: Array  # (7,) joint range, rad
    q_max: Array
    dq_max: Array  # (7,) rad/s
    tau_max: Array  # (7,) N m
    force_max: float  # N, largest external force at the TCP in any commanded interaction
    torque_max: float  # N m, largest external torque at the TCP
    free_force: float  # N: more than this in free air is a collision
    overload: float  # N above the payload's weight, for the inertia of load and arm
    speed_max: float  # m/s, TCP speed
    tracking_max: float  # m, largest distance between commanded equilibrium and measured TCP
    payload: float  # kg, heaviest object to lift
    workspace_min: Array  # (3,) m, box around the arm's base that the TCP stays in
    workspace_max: Array
    stale_after: float  # s, oldest sensor sample that may be acted upon
    reflexes: Reflexes


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """An arm with six or seven axes and a parallel hand."""

    name: str  # for `--arm`
    label: str  # title
    mjcf: Path  # the arm's file
    joints: tuple[str, ...]  # its hinges, from the base on
    base: str  # the body at the position of the arm
    links: tuple[str, ...]  # bodies from the base to the flange
    home: Array  # (7,) rad, tool down
    limits: Limits
    hand: ParallelHand
    nominal: NominalHand  # data for the estimators, as the arm's owner knows them
    accuracy: Accuracy  # stated by the manufacturer
    reach: Reach
    stiffness: ControllerStiffness  # default of the controller
    pace: MotionLimits  # default of commanded motions
    sensors: SensorErrors
    postures: tuple[Array, ...]  # seeds of the inverse kinematics
    hardware: Hardware | None = None  # values of a real arm, where they differ
    wrench_sensor: WristSheet | None = None  # six-axis sensor before the hand, if any
    rest_torque: float = 0.0  # N m that friction and ripple leave in each joint at rest, if stated
    end_effector: EndEffector | None = None  # weighed load of the last joint
    config: RobotConfig | None = None  # figures of robot.yaml, applied in the other attributes
    described: RobotDescription | None = None  # the arm without figures of robot.yaml

    @property
    def tip(self) -> float:
        """Distance, m, from the TCP to the end of the fingertips, where the pads end in the MJCF."""
        return self.nominal.tip_offset

    def __repr__(self) -> str:
        limits, hand = self.limits, self.hand
        return f"<arm {self.name}: {self.label}, {limits.payload:g} kg, opens {hand.opening:g} m>"

    @property
    def tcp(self) -> str:
        """The site at the TCP."""
        return self.hand.tcp if isinstance(self.hand.tcp, str) else TCP

    @property
    def pose_flange_tcp(self) -> Pose:
        """Pose of the TCP in the flange: the origin of the hand's body, in the axes of the last link."""
        model = _prepare_spec(self).compile()
        hand = model.body(self.hand.body)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        parent = data.body(int(model.body_parentid[hand.id]))
        # A sensor before the hand lies between both.
        along, sensor = data.body(hand.id).xmat.reshape(3, 3)[:, 2], self.wrench_sensor
        place = data.body(hand.id).xpos - (sensor.height if sensor else 0.0) * along
        flange = Pose(place, parent.xquat.copy())
        return flange.inverse() @ tool_pose(model, data, self.hand)

    @property
    def gravity(self) -> float | None:
        """Measured gravity at the arm's place, m/s^2; None if not measured."""
        measured = self.config.gravity if self.config is not None else None
        return measured.value if measured is not None else None

    def stands(self, pose_world_base: Pose) -> Pose:
        """Return the base's pose with the measured tilt, for the pose that a scene states."""
        lean = self.config.base_lean if self.config is not None else None
        if lean is None:
            return pose_world_base
        turn = np.array([*lean.value, 0.0])
        quaternion = rotate_quaternion(pose_world_base.quaternion, turn[None])[0]
        return Pose(pose_world_base.position, quaternion)

    @cache  # noqa: B019 (arms live as long as the process, and results are cached by their identity)
    def cautious(self) -> RobotDescription:
        """Return the arm at a pace that is slow enough for objects that no scene shows."""
        return replace(self, pace=self.pace.model_copy(update=dict(self.pace.cautious)))

    @cache  # noqa: B019
    def real(self) -> RobotDescription:
        """Return the real arm: with its springs, and its deviation from the drawings before calibration.

        Settings and measurements of its owner stay.
        """
        hardware, config = self.hardware, self.config
        if hardware is None:
            return self
        stiffness, nominal = hardware.stiffness, self.nominal
        if config is not None and config.stiffness is not None:
            stiffness = config.stiffness
        measured = config is not None and config.tip_offset is not None
        if not measured and hardware.tip_offset_std is not None:
            nominal = replace(nominal, tip_offset_std=hardware.tip_offset_std)
        rest_torque = hardware.rest_torque
        return replace(self, stiffness=stiffness, nominal=nominal, rest_torque=rest_torque)

    def spec(self, gravity: Array | None = None) -> mujoco.MjSpec:
        """Return an editable copy of the arm's model, with the physics options for its world."""
        spec = prepare_spec(self)
        if gravity is not None:
            spec.option.gravity = gravity
        if self.end_effector is not None:
            set_hand_mass(spec, self, self.end_effector)
        return spec


def read_description(folder: Path, name: str, known: Mapping[str, Path]) -> RobotDescription:
    """Read the arm that a folder describes; `known` has the folders of the arms that it may be `like`.

    Raises InputError: the folder has no valid description, or its MJCF is not such an arm.
    """
    sheet = read_sheet(folder, known)
    mjcf = folder / sheet.mjcf
    model = compile_arm(mjcf, sheet)
    require_arm(folder / FILE, sheet, model)
    require_shapes(folder / FILE, mjcf, sheet, model)
    links: list[str] = []  # from the base to the body that the last joint moves
    body = int(model.jnt_bodyid[model.joint(sheet.joints[-1]).id])
    while body:
        links.insert(0, model.body(body).name)
        body = int(model.body_parentid[body])
    nominal = NominalHand(
        tip_offset=pads_end(model, sheet.hand),
        joints=sheet.joints,
        fingers=sheet.hand.fingers,
        chain=chain(model, sheet),
        ripple_cycles=sheet.ripple_cycles,
        payload=sheet.payload,
        wrench_sensor=sensor_of(model, sheet),
        **dict(sheet.accuracy),
    )
    return RobotDescription(
        name=name,
        label=sheet.label,
        mjcf=mjcf,
        joints=sheet.joints,
        base=links[0],
        links=tuple(links),
        home=sheet.home,
        limits=limits_of(folder / FILE, sheet, model),
        hand=sheet.hand,
        nominal=nominal,
        accuracy=sheet.accuracy,
        reach=sheet.reach,
        stiffness=sheet.stiffness,
        pace=sheet.pace,
        sensors=sheet.sensors,
        postures=sheet.postures,
        hardware=sheet.hardware,
        wrench_sensor=sheet.wrench_sensor,
    )


def limits_of(where: Path, sheet: Sheet, model: mujoco.MjModel) -> Limits:
    """Collect the arm's limits: joint ranges and torques from the MJCF, the rest from the sheet."""
    ids = [model.joint(name).id for name in sheet.joints]
    torque = model.jnt_actfrcrange[ids, 1] if sheet.torque is None else sheet.torque
    if not (torque > 0).all():
        raise InputError(
            f"{where}: 'torque' is missing, and the joints of {sheet.mjcf} state no "
            "actuatorfrcrange: give the torque limits of the joints, N m"
        )
    safety = sheet.safety
    # A joint without limits turns one revolution in either direction.
    limited = model.jnt_limited[ids].astype(bool)
    return Limits(
        q_min=np.where(limited, model.jnt_range[ids, 0], -2.0 * np.pi),
        q_max=np.where(limited, model.jnt_range[ids, 1], 2.0 * np.pi),
        dq_max=sheet.velocity,
        tau_max=np.array(torque),
        force_max=safety.force,
        torque_max=safety.torque,
        free_force=safety.free_force,
        overload=safety.overload,
        speed_max=safety.speed,
        tracking_max=safety.tracking,
        payload=sheet.payload,
        workspace_min=sheet.workspace.min,
        workspace_max=sheet.workspace.max,
        stale_after=safety.stale,
        reflexes=Reflexes(**reflexes(sheet.reflex, sheet.payload)),
    )


def set_hand_mass(spec: mujoco.MjSpec, arm: RobotDescription, end: EndEffector) -> None:
    """Set mass and centre of the hand so that hand and fingers together equal `end`.

    The inertia of the hand about its own centre stays.
    """
    # Positions of the fingers, half open, in the frame of the hand.
    model = spec.compile()
    data = mujoco.MjData(model)
    for name in arm.hand.fingers:
        data.qpos[int(model.joint(name).qposadr[0])] = arm.hand.opening / 4
    mujoco.mj_kinematics(model, data)
    hand = data.body(arm.hand.body)
    # Subtract the fingers' masses and first moments from those of the whole.
    rest, moment = end.mass, end.mass * end.centre
    for name in arm.hand.fingers:
        finger = spec.joint(name).parent
        centre = hand.xmat.reshape(3, 3).T @ (data.body(finger.name).xipos - hand.xpos)
        rest, moment = rest - finger.mass, moment - finger.mass * centre
    if rest <= 0.0:
        raise InputError(f"end_effector: {end.mass:g} kg is less than the fingers alone weigh")
    body = spec.body(arm.hand.body)
    body.mass, body.ipos = rest, moment / rest


def reflexes(sheet: ReflexSheet | OwnReflex, payload: float) -> dict[str, Reflex]:
    """Build the stated reflexes. With a load on the hand they allow for the weight of the payload, kg."""
    loads = {"carrying": payload * STANDARD_GRAVITY, "contact": payload * STANDARD_GRAVITY}
    stated = {name: one for name, one in sheet if one is not None}
    return {
        name: Reflex(one.force, one.torque, loads.get(name, 0.0)) for name, one in stated.items()
    }


def pads_end(model: mujoco.MjModel, hand: ParallelHand) -> float:
    """Return the distance from the TCP to the end of the pads along the tool, m."""
    fingers = finger_bodies(model, hand)
    ends = [float(box[1, 2]) for body, box in tool_boxes(model, hand) if body in fingers]
    if not ends:
        raise InputError(
            f"the fingers {', '.join(hand.fingers)} have no shape that collides: give 'hand.pads'"
        )
    return round(max(ends), 6)


def finger_bodies(model: mujoco.MjModel, hand: ParallelHand) -> list[int]:
    """Return the ids of the bodies that the fingers' joints move."""
    return [int(model.jnt_bodyid[model.joint(name).id]) for name in hand.fingers]


def tool_boxes(model: mujoco.MjModel, hand: ParallelHand) -> Iterator[tuple[int, Array]]:
    """Yield body and box of each colliding geom: lowest and highest corner (2, 3) in the tool frame, m.

    The stated pads of a hand replace the geoms of its fingers.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool, fingers, pads = tool_pose(model, data, hand), finger_bodies(model, hand), hand.pads
    boxes = [
        (body, data.geom_xpos[geom], data.geom_xmat[geom], *np.split(model.geom_aabb[geom], 2))
        for geom, body in enumerate(model.geom_bodyid.tolist())
        if model.geom_contype[geom] and not (pads is not None and body in fingers)
    ]
    if pads is not None:
        boxes += [(i, data.xpos[i], data.xmat[i], pads.centre, pads.half) for i in fingers]
    # Rotate each box into the tool frame, and take the box around it.
    for body, position, rotation, centre, half in boxes:
        turn = tool.rotation.T @ rotation.reshape(3, 3)
        middle = tool.rotation.T @ (position - tool.position) + turn @ centre
        yield body, np.array([middle - np.abs(turn) @ half, middle + np.abs(turn) @ half])


def require_shapes(where: Path, mjcf: Path, sheet: Sheet, model: mujoco.MjModel) -> None:
    """Require that TCP and palm agree with the colliding shapes of the hand.

    Raises InputError: they do not; the message names the figure and both files.
    """
    hand, end, fingers = sheet.hand, pads_end(model, sheet.hand), finger_bodies(model, sheet.hand)
    boxes = list(tool_boxes(model, hand))
    # The TCP is midway between the fingers, and before their end.
    sides = np.array([box.mean(axis=0) for body, box in boxes if body in fingers])
    x, y = ((sides.min(axis=0) + sides.max(axis=0)) / 2.0)[:2].tolist()
    if max(abs(x), abs(y)) > MISPLACED or end < 0.0:
        raise InputError(
            f"{where}: 'hand.tcp' is not between the fingers of {mjcf}: their middle is at x {x:.4f}, y {y:.4f} m from "
            f"it, and their end {end:.4f} m beyond it"
        )
    # Nothing that moves with the hand, except the fingers, reaches below the palm between them.
    last, *slides = (int(model.joint(name).id) for name in (sheet.joints[-1], *hand.fingers))
    room = np.array([hand.pad, hand.opening / 2.0])
    for body, box in boxes:
        is_hand = carries(model, last, body) and not any(carries(model, i, body) for i in slides)
        is_between = bool((box[0, :2] < room).all() and (box[1, :2] > -room).all())
        if is_hand and is_between and -box[1, 2] < hand.palm - MISPLACED:
            raise InputError(
                f"{where}: 'hand.palm' is {hand.palm:g} m, and in {mjcf} a shape of '{model.body(body).name}' is "
                f"{-box[1, 2]:.4f} m above the TCP: objects would be pushed against it; give at most that"
            )


# Physics of a world that a robot needs.


PLUMB = 0.01  # rad, largest inclination of gravity
# Features of MuJoCo that a robot needs.
NEEDED = (
    *("gravity", "contact", "constraint", "equality", "limit"),
    *("frictionloss", "actuation", "spring", "damper"),
)


def require_physics(option: mujoco.MjOption) -> None:
    """Require gravity that points down, and the features of MuJoCo that a robot needs."""
    x, y, z = option.gravity
    if z >= 0 or max(abs(x), abs(y)) > -PLUMB * z:
        raise InputError(
            f"the world's gravity is ({x:g}, {y:g}, {z:g}) m/s²; it must point down, as in "
            '<option gravity="0 0 -9.81"/>: released objects have to fall, and weighing needs a weight'
        )
    bits = {name: int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}")) for name in NEEDED}
    disabled = [name for name, bit in bits.items() if option.disableflags & bit]
    if disabled:
        raise InputError(
            f"the world's <option><flag> disables {', '.join(disabled)}, without which nothing can be "
            "grasped and weighed; leave it enabled"
        )
