"""Description of an arm with its hand, read from one folder: the only place of an arm's numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.model import TCP, chain, compiled, prepared, require_arm, tool_pose
from palpate.robots.reflex import Reflex, Reflexes
from palpate.robots.sheet import (
    FILE,
    Accuracy,
    Hardware,
    Pace,
    ParallelHand,
    Reach,
    ReflexSheet,
    Sensors,
    Sheet,
    Stiffness,
    read_sheet,
)
from palpate.robots.trajectory import turned
from palpate.trace.recording import Hand
from palpate.trace.samples import STANDARD_GRAVITY

if TYPE_CHECKING:
    from palpate.robots.owner.config import EndEffector, RobotConfig


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
    """A seven-axis arm with a parallel hand."""

    name: str  # for `--arm`
    label: str  # title
    mjcf: Path  # the arm's file
    joints: tuple[str, ...]  # its hinges, from the base on
    base: str  # the body at the arm's place
    links: tuple[str, ...]  # bodies from it to the flange
    home: Array  # (7,) rad, tool down
    limits: Limits
    hand: ParallelHand
    nominal: Hand  # data for the estimators, as the arm's owner knows them
    accuracy: Accuracy  # the manufacturer's
    reach: Reach
    stiffness: Stiffness  # default of the controller
    pace: Pace  # default of commanded motions
    sensors: Sensors
    postures: tuple[Array, ...]  # seeds of the inverse kinematics
    hardware: Hardware | None = None  # of a real arm, where it differs
    rest_torque: float = 0.0  # N m that friction and ripple leave in each joint at rest, if told
    end_effector: EndEffector | None = None  # weighed load of the last joint
    config: RobotConfig | None = None  # figures of robot.yaml, applied in the other attributes
    described: RobotDescription | None = None  # the arm without them; None without a robot.yaml

    @property
    def tip(self) -> float:
        """m from the TCP to the end of the fingertips, where the pads end in the MJCF."""
        return self.nominal.tip_offset

    def __repr__(self) -> str:
        limits, hand = self.limits, self.hand
        return f"<arm {self.name}: {self.label}, {limits.payload:g} kg, opens {hand.opening:g} m>"

    @property
    def tcp(self) -> str:
        """The site at the TCP."""
        return self.hand.tcp if isinstance(self.hand.tcp, str) else TCP

    @property
    def gravity(self) -> float | None:
        """m/s^2 at the arm's place, if measured."""
        measured = self.config.gravity if self.config is not None else None
        return measured.value if measured is not None else None

    def stands(self, pose_world_base: Pose) -> Pose:
        """Return the base's pose, stated by a scene, with the measured tilt."""
        lean = self.config.base_lean if self.config is not None else None
        if lean is None:
            return pose_world_base
        turn = np.array([*lean.value, 0.0])
        quaternion = turned(pose_world_base.quaternion, turn[None])[0]
        return Pose(pose_world_base.position, quaternion)

    def cautious(self) -> RobotDescription:
        """Return the arm at a pace that is slow enough for objects that no scene shows."""
        return replace(self, pace=self.pace.model_copy(update=dict(self.pace.cautious)))

    def real(self) -> RobotDescription:
        """Return the real arm: with its springs, and its deviation from the drawings without
        calibration; settings and measurements of its owner stay."""
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
        spec = prepared(self)
        if gravity is not None:
            spec.option.gravity = gravity
        if self.end_effector is not None:
            set_hand_mass(spec, self, self.end_effector)
        return spec


def read_description(folder: Path, name: str, known: Mapping[str, Path]) -> RobotDescription:
    """Read the arm that a folder describes; `known`: folders of the arms that it may be `like`.

    Raises:
        InputError: the folder has no valid description, or its MJCF is not such an arm.
    """
    sheet = read_sheet(folder, known)
    mjcf = folder / sheet.mjcf
    model = compiled(mjcf)
    require_arm(folder / FILE, sheet, model)
    links: list[str] = []  # from the base to the body that the last joint moves
    body = int(model.jnt_bodyid[model.joint(sheet.joints[-1]).id])
    while body:
        links.insert(0, model.body(body).name)
        body = int(model.body_parentid[body])
    nominal = Hand(
        tip_offset=pads_end(model, sheet.hand),
        joints=sheet.joints,
        fingers=sheet.hand.fingers,
        chain=chain(model, sheet),
        ripple_cycles=sheet.ripple_cycles,
        payload=sheet.payload,
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
    )


def limits_of(where: Path, sheet: Sheet, model: mujoco.MjModel) -> Limits:
    """Collect the arm's limits: joint ranges and torques from the MJCF, the rest from the sheet."""
    ids = [model.joint(name).id for name in sheet.joints]
    torque = model.jnt_actfrcrange[ids, 1] if sheet.torque is None else sheet.torque
    if not (torque > 0).all():
        raise InputError(
            f"{where}: 'torque' is missing, and the joints of {sheet.mjcf} state no "
            "actuatorfrcrange: give the seven joint torque limits, N m"
        )
    safety = sheet.safety
    # A joint without limits turns one revolution either way.
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
        reflexes=reflexes(sheet.reflex, sheet.payload),
    )


def set_hand_mass(spec: mujoco.MjSpec, arm: RobotDescription, end: EndEffector) -> None:
    """Set mass and centre of the hand so that it and its fingers are `end` together; its inertia
    about its own centre stays."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for name in arm.hand.fingers:
        data.qpos[int(model.joint(name).qposadr[0])] = arm.hand.opening / 4
    mujoco.mj_kinematics(model, data)
    hand = data.body(arm.hand.body)
    rest, moment = end.mass, end.mass * end.centre
    for name in arm.hand.fingers:
        finger = spec.joint(name).parent
        centre = hand.xmat.reshape(3, 3).T @ (data.body(finger.name).xipos - hand.xpos)
        rest, moment = rest - finger.mass, moment - finger.mass * centre
    if rest <= 0.0:
        raise InputError(f"end_effector: {end.mass:g} kg is less than the fingers alone weigh")
    body = spec.body(arm.hand.body)
    body.mass, body.ipos = rest, moment / rest


def reflexes(sheet: ReflexSheet, payload: float) -> Reflexes:
    """Build the reflexes; with a load on the hand they allow for the weight of the payload, kg."""
    weight = payload * STANDARD_GRAVITY
    return Reflexes(
        free=Reflex(sheet.free.force, sheet.free.torque),
        carrying=Reflex(sheet.carrying.force, sheet.carrying.torque, weight),
        probing=Reflex(sheet.probing.force, sheet.probing.torque),
        contact=Reflex(sheet.contact.force, sheet.contact.torque, weight),
    )


def pads_end(model: mujoco.MjModel, hand: ParallelHand) -> float:
    """Return the distance from the TCP to the end of the pads along the tool, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = tool_pose(model, data, hand)
    axis, ends = tool.rotation[:, 2], list[float]()
    for name in hand.fingers:
        body, pads = int(model.jnt_bodyid[model.joint(name).id]), hand.pads
        boxes = [
            (data.geom_xpos[geom], data.geom_xmat[geom], *np.split(model.geom_aabb[geom], 2))
            for geom in range(model.ngeom)
            if model.geom_bodyid[geom] == body and model.geom_contype[geom]
        ]
        if pads is not None:
            boxes = [(data.xpos[body], data.xmat[body], pads.centre, pads.half)]
        for position, rotation, centre, half in boxes:
            along = axis @ rotation.reshape(3, 3)
            far = axis @ (position - tool.position) + along @ centre + np.abs(along) @ half
            ends.append(float(far))
    if not ends:
        raise InputError(
            f"the fingers {', '.join(hand.fingers)} have no shape that collides: give 'hand.pads'"
        )
    return round(max(ends), 6)
