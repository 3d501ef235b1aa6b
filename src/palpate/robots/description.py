"""Description of an arm with its hand, read from one folder.

Nobody else holds a number of an arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
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
from palpate.robots.trajectory.posed import turned
from palpate.trace.recording import Hand
from palpate.trace.samples import STANDARD_GRAVITY

if TYPE_CHECKING:
    from palpate.robots.owner.config import EndEffector, RobotConfig


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Safety limits of the arm.

    Attributes:
        q_min, q_max: (7,) joint range, rad.
        dq_max: (7,) rad/s.
        tau_max: (7,) N m.
        force_max: N, largest external force at the TCP in any commanded interaction.
        torque_max: N m, largest external torque at the TCP.
        free_force: N, more than this in free air is a collision.
        overload: N above the payload's weight, for the inertia of load and arm.
        speed_max: m/s, TCP speed.
        tracking_max: m, largest distance between commanded equilibrium and measured TCP.
        payload: kg, heaviest object to lift.
        workspace_min, workspace_max: (3,) m, box around the arm's base that the TCP stays in.
        stale_after: s, oldest sensor sample that may be acted upon.
        reflexes: at what the arm stops itself.
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
    reflexes: Reflexes


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """A seven-axis arm with a parallel hand.

    Attributes:
        name: what `--arm` calls it.
        label: what people call it.
        mjcf: the arm's file.
        joints: its hinges, from the base on.
        base: the body that is put where the arm stands.
        links: bodies from it to the flange.
        home: (7,) rad, tool down.
        hand: the hand's names, drive and shape.
        nominal: what estimators need of it, as the arm's owner is told.
        accuracy: what the maker states.
        reach: where the arm works well.
        postures: where the inverse kinematics looks.
        stiffness, pace: defaults of the controller and of commanded motions.
        hardware: what a real arm has else, None where that is nothing.
        sensors: how its joint torque signals deviate.
        end_effector: what the last joint carries, where somebody weighed it.
        config: what was measured of this very arm; it is in the other attributes already.
        told: the arm without it. None where nothing was.
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
    accuracy: Accuracy
    reach: Reach
    stiffness: Stiffness
    pace: Pace
    sensors: Sensors
    postures: tuple[Array, ...]
    hardware: Hardware | None = None
    end_effector: EndEffector | None = None
    config: RobotConfig | None = None
    told: RobotDescription | None = None

    @property
    def tip(self) -> float:
        """m from the TCP to the end of the fingertips: where the pads end in the MJCF."""
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
        """m/s^2 where it stands, where somebody measured that."""
        measured = self.config.gravity if self.config is not None else None
        return measured.value if measured is not None else None

    def stands(self, pose_world_base: Pose) -> Pose:
        """Pose of the base that a scene states, with the measured tilt."""
        lean = self.config.base_lean if self.config is not None else None
        if lean is None:
            return pose_world_base
        turn = np.array([*lean.value, 0.0])
        quaternion = turned(pose_world_base.quaternion, turn[None])[0]
        return Pose(pose_world_base.position, quaternion)

    def cautious(self) -> RobotDescription:
        """The same arm, slow enough everywhere for things that no scene shows."""
        slower = dict(self.pace.cautious)
        return replace(self, pace=self.pace.model_copy(update=slower))

    def real(self) -> RobotDescription:
        """The same arm as it is where it is not simulated: on a real one's springs, and as far from
        its drawings as one is that nobody has calibrated; what its owner set or measured stays."""
        hardware, config = self.hardware, self.config
        if hardware is None:
            return self
        stiffness, nominal = hardware.stiffness, self.nominal
        if config is not None and config.stiffness is not None:
            stiffness = config.stiffness
        measured = config is not None and config.tip_offset is not None
        if not measured and hardware.tip_offset_std is not None:
            nominal = replace(nominal, tip_offset_std=hardware.tip_offset_std)
        return replace(self, stiffness=stiffness, nominal=nominal)

    def spec(self, gravity: Array | None = None) -> mujoco.MjSpec:
        """An editable copy of the arm's model, its options those of every world it is put in."""
        spec = prepared(self)
        if gravity is not None:
            spec.option.gravity = gravity
        if self.end_effector is not None:
            _weigh_hand(spec, self, self.end_effector)
        return spec


def read_description(folder: Path, name: str, known: Mapping[str, Path]) -> RobotDescription:
    """The arm that a folder describes; `known` are the folders of those that it may be like.

    Raises:
        InputError: the folder has no valid description, or its MJCF is not such an arm.
    """
    sheet = read_sheet(folder, known)
    mjcf = folder / sheet.mjcf
    model = compiled(mjcf)
    require_arm(folder / FILE, sheet, model)
    links = _links(model, sheet.joints)
    return RobotDescription(
        name=name,
        label=sheet.label,
        mjcf=mjcf,
        joints=sheet.joints,
        base=links[0],
        links=links,
        home=sheet.home,
        limits=_limits(folder / FILE, sheet, model),
        hand=sheet.hand,
        nominal=_nominal(sheet, model),
        accuracy=sheet.accuracy,
        reach=sheet.reach,
        stiffness=sheet.stiffness,
        pace=sheet.pace,
        sensors=sheet.sensors,
        postures=sheet.postures,
        hardware=sheet.hardware,
    )


def _nominal(sheet: Sheet, model: mujoco.MjModel) -> Hand:
    """Build the arm's data for the estimators, from its datasheet."""
    accuracy = sheet.accuracy
    return Hand(
        tip_offset=pads_end(model, sheet.hand),
        force_repeatability=accuracy.force_repeatability,
        torque_gain=accuracy.torque_gain,
        pose_repeatability=accuracy.pose_repeatability,
        joints=sheet.joints,
        fingers=sheet.hand.fingers,
        force_resolution=accuracy.force_resolution,
        force_accuracy=accuracy.force_accuracy,
        tip_offset_std=accuracy.tip_offset_std,
        chain=chain(model, sheet),
    )


def _limits(where: Path, sheet: Sheet, model: mujoco.MjModel) -> Limits:
    """Joint ranges and torques are the MJCF's, the rest the description's."""
    ids = [model.joint(name).id for name in sheet.joints]
    torque = model.jnt_actfrcrange[ids, 1] if sheet.torque is None else sheet.torque
    if not (torque > 0).all():
        raise InputError(
            f"{where}: 'torque' is missing, and the joints of {sheet.mjcf} state no "
            "actuatorfrcrange: give the seven joint torque limits, N m"
        )
    safety = sheet.safety
    # A joint without limits turns as far as one revolution either way.
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


def _weigh_hand(spec: mujoco.MjSpec, arm: RobotDescription, end: EndEffector) -> None:
    """Make the hand so heavy that it and its fingers are `end` together; its inertia about its own
    centre stays."""
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


def reflexes(said: ReflexSheet, payload: float) -> Reflexes:
    """Build the reflexes; with a load on the hand they allow for the weight of the payload, kg."""
    weight = payload * STANDARD_GRAVITY
    return Reflexes(
        free=Reflex(said.free.force, said.free.torque),
        carrying=Reflex(said.carrying.force, said.carrying.torque, weight),
        probing=Reflex(said.probing.force, said.probing.torque),
        contact=Reflex(said.contact.force, said.contact.torque, weight),
    )


def _links(model: mujoco.MjModel, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the bodies from the base to the one that the last joint moves."""
    last = int(model.jnt_bodyid[model.joint(joints[-1]).id])
    chain: list[str] = []
    while last:
        chain.append(model.body(last).name)
        last = int(model.body_parentid[last])
    return tuple(reversed(chain))


def pads_end(model: mujoco.MjModel, hand: ParallelHand) -> float:
    """Return the distance from the TCP to the end of the pads along the tool, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = tool_pose(model, data, hand)
    ends = [
        float(tool.rotation[:, 2] @ (corner - tool.position))
        for finger in hand.fingers
        for corner in _pad_corners(model, data, hand, finger)
    ]
    if not ends:
        raise InputError(
            f"the fingers {', '.join(hand.fingers)} have no shape that collides: give 'hand.pads'"
        )
    return round(max(ends), 6)


def _pad_corners(
    model: mujoco.MjModel, data: mujoco.MjData, hand: ParallelHand, finger: str
) -> list[Array]:
    """Corners (world) of the boxes around what a finger grasps with."""
    body = int(model.jnt_bodyid[model.joint(finger).id])
    if hand.pads is not None:
        rotation = data.xmat[body].reshape(3, 3)
        return _corners(data.xpos[body], rotation, hand.pads.centre, hand.pads.half)
    corners: list[Array] = []
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] == body and model.geom_contype[geom]:
            rotation = data.geom_xmat[geom].reshape(3, 3)
            middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            corners += _corners(data.geom_xpos[geom], rotation, middle, half)
    return corners


def _corners(position: Array, rotation: Array, centre: Array, half: Array) -> list[Array]:
    signs = product((-1.0, 1.0), repeat=3)
    return [position + rotation @ (centre + np.array(sign) * half) for sign in signs]
