"""One arm with its hand, read from one folder and handed to whoever needs it.

Nobody else holds a number of an arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array
from palpate.robots.sheet import (
    Pace,
    ParallelHand,
    Reach,
    Sensors,
    Sheet,
    Stiffness,
    read_sheet,
)
from palpate.trace.recording import Hand

FILE = "description.yaml"
AXES = 7
"""Joints of an arm: with fewer, a pose fixes the elbow, and the null space this code uses is
gone."""


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What the arm may do.

    Attributes:
        q_min, q_max: (7,) joint range, rad. dq_max: (7,) rad/s. tau_max: (7,) N m.
        force_max: N, largest external force at the TCP in any commanded interaction.
        torque_max: N m, largest external torque at the TCP.
        free_force: N, more than this in free air is a collision.
        overload: N above the payload's weight, for the inertia of load and arm.
        speed_max: m/s, TCP speed.
        tracking_max: m, largest distance between commanded equilibrium and measured TCP.
        payload: kg, heaviest object to lift.
        workspace_min, workspace_max: (3,) m, box around the arm's base that the TCP stays in.
        stale_after: s, oldest sensor sample that may be acted upon.
    """

    q_min: Array
    q_max: Array
    dq_max: Array
    tau_max: Array
    force_max: float
    torque_max: float
    free_force: float
    overload: float
    speed_max: float
    tracking_max: float
    payload: float
    workspace_min: Array
    workspace_max: Array
    stale_after: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """A seven-axis arm with a parallel hand.

    Attributes:
        name: what `--arm` calls it. label: what people call it.
        mjcf: the arm's file. joints: its hinges, from the base on.
        base: the body that is put where the arm stands. links: bodies from it to the flange.
        home: (7,) rad, tool down.
        hand: the hand's names, drive and shape. nominal: what estimators need of it.
        reach: where the arm works well. postures: where the inverse kinematics looks.
        stiffness, pace: defaults of the controller and of commanded motions.
        sensors: how its joint torque signals deviate.
    """

    name: str
    label: str
    mjcf: Path
    joints: tuple[str, ...]
    base: str
    links: tuple[str, ...]
    home: Array
    limits: Limits
    hand: ParallelHand
    nominal: Hand
    reach: Reach
    stiffness: Stiffness
    pace: Pace
    sensors: Sensors
    postures: tuple[Array, ...]

    @property
    def tip(self) -> float:
        """m from the TCP to the end of the fingertips: where the pads end in the MJCF."""
        return self.nominal.tip_offset

    def __repr__(self) -> str:
        limits, hand = self.limits, self.hand
        return f"<arm {self.name}: {self.label}, {limits.payload:g} kg, opens {hand.opening:g} m>"

    def spec(self, gravity: Array | None = None) -> mujoco.MjSpec:
        """An editable copy of the arm's model, its options those of every world it is put in."""
        spec = mujoco.MjSpec.from_file(str(self.mjcf))
        spec.option.timestep = 0.001
        if gravity is not None:
            spec.option.gravity = gravity
        return spec


def read_description(folder: Path, name: str) -> RobotDescription:
    """The arm that a folder describes.

    Raises:
        InputError: the folder has no valid description, or its MJCF is not such an arm.
    """
    sheet = read_sheet(folder / FILE)
    mjcf = folder / sheet.mjcf
    return _description(name, mjcf, sheet, _compiled(mjcf))


def _description(name: str, mjcf: Path, sheet: Sheet, model: mujoco.MjModel) -> RobotDescription:
    _require_joints(mjcf, sheet, model)
    links = _links(model, sheet.joints)
    accuracy = sheet.accuracy
    return RobotDescription(
        name=name,
        label=sheet.label,
        mjcf=mjcf,
        joints=sheet.joints,
        base=links[0],
        links=links,
        home=sheet.home,
        limits=_limits(sheet, model),
        hand=sheet.hand,
        nominal=Hand(
            tip_offset=_tip(model, sheet.hand),
            force_repeatability=accuracy.force_repeatability,
            torque_gain=accuracy.torque_gain,
            pose_repeatability=accuracy.pose_repeatability,
            joints=sheet.joints,
            fingers=sheet.hand.fingers,
        ),
        reach=sheet.reach,
        stiffness=sheet.stiffness,
        pace=sheet.pace,
        sensors=sheet.sensors,
        postures=sheet.postures,
    )


def _limits(sheet: Sheet, model: mujoco.MjModel) -> Limits:
    """Joint ranges and torques are the MJCF's, the rest the description's."""
    joints = [model.joint(name) for name in sheet.joints]
    safety = sheet.safety
    return Limits(
        q_min=np.array([joint.range[0] for joint in joints]),
        q_max=np.array([joint.range[1] for joint in joints]),
        dq_max=sheet.velocity,
        tau_max=np.array([model.jnt_actfrcrange[joint.id, 1] for joint in joints]),
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
    )


@lru_cache(16)
def _compiled(mjcf: Path) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_xml_path(str(mjcf))
    except ValueError as error:
        raise InputError(f"{mjcf} is not an MJCF that MuJoCo accepts: {error}") from None


def _require_joints(mjcf: Path, sheet: Sheet, model: mujoco.MjModel) -> None:
    """Seven hinges and two slides, by their names."""
    if len(sheet.joints) != AXES:
        raise InputError(
            f"{mjcf.parent / FILE}: 'joints' names {len(sheet.joints)}; the arm must have "
            f"{AXES} axes and joint torque sensing, as Franka's and KUKA's iiwa have"
        )
    names = [model.joint(i).name for i in range(model.njnt)]
    for name in (*sheet.joints, *sheet.hand.fingers):
        if name not in names:
            raise unknown_name("joint", name, names, f"It is named in {mjcf.parent / FILE}.")


def _links(model: mujoco.MjModel, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the bodies from the base to the one that the last joint moves."""
    last = int(model.jnt_bodyid[model.joint(joints[-1]).id])
    chain: list[str] = []
    while last:
        chain.append(model.body(last).name)
        last = int(model.body_parentid[last])
    return tuple(reversed(chain))


def _tip(model: mujoco.MjModel, hand: ParallelHand) -> float:
    """How far the fingers' colliding shapes reach beyond the TCP along the tool, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tcp = data.site(hand.tcp)
    along = tcp.xmat.reshape(3, 3)[:, 2]
    fingers = [int(model.jnt_bodyid[model.joint(name).id]) for name in hand.fingers]
    ends: list[float] = []
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]) not in fingers or not model.geom_contype[geom]:
            continue
        rotation = data.geom_xmat[geom].reshape(3, 3)
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        centre = data.geom_xpos[geom] + rotation @ middle - tcp.xpos
        ends.append(float(along @ centre + np.abs(along @ rotation) @ half))
    if not ends:
        raise InputError(f"the fingers {', '.join(hand.fingers)} have no shape that collides")
    return round(max(ends), 6)
