"""An arm's MJCF, checked and prepared for a world: its joints, links, hand and shapes alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array, Pose, components
from palpate.mjcf.bounds import require_bounded
from palpate.mjcf.reading import read_document
from palpate.robots.sheet import ParallelHand, Sheet
from palpate.trace.recording import Chain, Link, Triple

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription

LINK_DAMPING = 0.003
"""N m s/rad: friction of a joint behind the sensors. Damping and friction of a file are the gears',
before the sensors."""
PAD_FRICTION = (1.0, 0.01, 0.0001)  # of rubber: sliding, torsional (m) and rolling (m)
AXES = 7  # joints of an arm: with fewer, a pose fixes the elbow, and there is no null space
WORLD, OWN = 1, 1 << 20  # contact bits: the default one, and a rare one for the arm's own shapes
OVERLAPPING = 2  # joints between bodies whose shapes may overlap
LEVEL = 0.999  # cosine of the largest inclination of the tool at home
PREFIX = "robot/"  # of the arm's names in a world
TCP = "palpate_tcp"  # site of a TCP that a description gives as a position


def compiled(mjcf: Path) -> mujoco.MjModel:
    """Compile an MJCF file.

    Raises:
        InputError: MuJoCo does not accept the file, or it is larger than a robot's.
    """
    require_bounded(read_document(mjcf), str(mjcf))
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


def links_of(model: mujoco.MjModel, data: mujoco.MjData, hinges: Sequence[int]) -> Iterator[Link]:
    """Yield the links that the hinges move, in the current configuration."""
    mujoco.mj_comPos(model, data)
    for body in range(1, model.nbody):
        moved_by = [i for i, hinge in enumerate(hinges) if carries(model, hinge, body)]
        if moved_by and model.body_mass[body] > 0.0:
            here: Any = data.body(body)
            mass = float(model.body_mass[body])
            axes = np.asarray(here.ximat, dtype=np.float64).reshape(3, 3)
            moments = np.asarray(model.body_inertia[body], dtype=np.float64)
            xx, yy, zz, xy, xz, yz = components((axes * moments) @ axes.T)
            yield Link(moved_by[-1], mass, triple(here.xipos), (xx, yy, zz, xy, xz, yz))


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
    """Require seven hinges and a parallel hand, and no other joints.

    Raises:
        InputError: another kind of robot; the message names the reason.
    """
    if len(sheet.joints) != AXES:
        raise InputError(
            f"{where}: 'joints' names {len(sheet.joints)}; the arm must have {AXES} axes with "
            "joint torque sensing. Six-axis arms are out of scope: without a null space the elbow "
            "cannot stay where a measurement's reference had it"
        )
    joints = [model.joint(i).name for i in range(model.njnt)]
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    sites = [model.site(i).name for i in range(model.nsite)]
    for name in (*sheet.joints, *sheet.hand.fingers):
        if name not in joints:
            raise unknown_name("joint", name, joints, f"It is named in {where}.")
    if sheet.hand.body not in bodies:
        raise unknown_name("body", sheet.hand.body, bodies, f"It is named in {where}.")
    if isinstance(sheet.hand.tcp, str) and sheet.hand.tcp not in sites:
        raise unknown_name("site", sheet.hand.tcp, sites, f"It is named in {where}.")
    moving = (*sheet.joints, *sheet.hand.fingers)
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


def require_hand(where: Path, sheet: Sheet, model: mujoco.MjModel) -> None:
    """Require that the tool points down at home, and that the fingers move along its y, towards each
    other."""
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


def prepared(arm: RobotDescription) -> mujoco.MjSpec:
    """Return an editable copy of the arm: base at the origin, no actuators, no surroundings; its
    shapes collide with the world's, and with each other except for `neighbours`."""
    return _prepared(arm).copy()


@lru_cache(8)
def _prepared(arm: RobotDescription) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(arm.mjcf))
    option = spec.option
    option.timestep, option.impratio = 0.001, 20.0  # a grasped object does not creep with these
    option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    option.cone = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    strip(spec, arm.base)
    set_explicit_inertia(spec, arm.mjcf)
    for name, limit in zip(arm.joints, arm.limits.tau_max.tolist(), strict=True):
        joint = spec.joint(name)
        joint.damping[:], joint.frictionloss = (LINK_DAMPING, 0.0, 0.0), 0.0
        joint.actfrcrange = (-limit, limit)
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
    """Find the pairs of the arm's bodies whose shapes may touch: those up to `OVERLAPPING` joints
    apart, as simple solids overlap there, and those that touch at home. The bodies that the last
    joint moves count as one."""
    last = len(arm.links) - 1
    place = {body.name: last for body in spec.bodies if body.name not in ("", "world")}
    place |= {name: i for i, name in enumerate(arm.links)}
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
    """Delete everything but the arm, and put it at the origin."""
    driven = (*spec.actuators, *spec.sensors, *spec.equalities, *spec.tendons, *spec.keys)
    for element in (*driven, *spec.excludes, *spec.pairs):
        spec.delete(element)
    world = spec.worldbody
    around = [body for body in world.bodies if body.name != base]
    for element in (*around, *world.geoms, *world.lights, *world.cameras, *world.sites):
        spec.delete(element)
    spec.body(base).pos, spec.body(base).quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def set_explicit_inertia(spec: mujoco.MjSpec, mjcf: Path) -> None:
    """Set masses that a file leaves to its shapes: the nominal arm is computed without shapes."""
    open_bodies = [body for body in spec.bodies if body.name and not body.explicitinertial]
    if not open_bodies:
        return
    model = compiled(mjcf)
    for body in open_bodies:
        if body.name == "world":
            continue
        stated = model.body(body.name)
        body.mass, body.ipos, body.iquat = float(stated.mass[0]), stated.ipos, stated.iquat
        body.inertia, body.explicitinertial = stated.inertia, True


def set_pad(finger: mujoco.MjsBody, centre: Array, half: Array) -> None:
    """Replace a finger's colliding shapes by one box: with several, a grasped object creeps."""
    for geom in finger.geoms:
        geom.contype = geom.conaffinity = 0
    pad = finger.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=half, group=3, mass=0.0)
    pad.contype, pad.conaffinity, pad.priority, pad.condim = WORLD | OWN, OWN, 1, 4
    pad.friction = PAD_FRICTION
    pad.solref[:2], pad.solimp[:3] = (0.004, 1.0), (0.95, 0.99, 0.001)
