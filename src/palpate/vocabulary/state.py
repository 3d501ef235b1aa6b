"""The symbolic state: what a plan, or a run, may believe about the cell between two leaves.

The same effects that `check` folds over a plan are applied by the leaf at run time, and branches
of a Parallel are merged by the same function, so a recording's context means the same thing on
paper and on the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import numpy as np

from palpate.geometry.pose import Array, Pose, digits
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.robots.kinematics import forward_kinematics
from palpate.scene.raised import learned, moves, raised, risen
from palpate.scene.scene import Scene
from palpate.trace.recording import Activity, Context
from palpate.vocabulary.admissible.grip import Grip, grip
from palpate.vocabulary.admissible.solids import solids

if TYPE_CHECKING:
    from palpate.vocabulary.base import Primitive

T = TypeVar("T")

HOME_CONFIG = "home_config"
"""The joint configuration from which every pose is reached safely."""

SINKING = 0.05
"""m: how far above the TCP a top may be and still be below the hand, by a belief about heights that
a contact corrects."""

RESTORED_POSITION = 0.005
"""m: an object within this distance of where it was found counts as restored."""

SAGS = 0.01
"""m and rad by which an arm that says where it is may be off its joint angles."""

SAME_POSE = 1e-4
"""m and rad: poses that differ by less are one."""


@dataclass(frozen=True, slots=True)
class SymbolicState:
    """Immutable; `replace` makes the next one.

    Attributes:
        scene: what is believed about the cell at rest.
        at: pose expression or joint configuration last reached.
        pose_world_tcp: where that is; None before the first motion of a plan.
        joints: (7,) rad, the joint configuration last moved to as such; None at a pose, where the
            controller bends the arm.
        gripper: typestate of the hand.
        holding, grasp: object held, and the pose expression where it was grasped.
        pose_tcp_object: the held object's pose in the TCP frame.
        lifted: the held object is clear of its support.
        contact: surface touched by the last guarded motion, until the arm moves on.
        moved: poses of objects that are not where the scene has them.
        activity: what a sensing leaf that starts now would record.
        buffers: the context in which each buffer was last written.
        logged: every recording so far, `(buffer, context)`.
        converted: parameters that a conversion has measured.
        reaches: whether the arm reaches a pose of the TCP (world); None for its own inverse
            kinematics.
        bound: m along its line, of every pose that the run has found out (`Symbols.lines`).
    """

    scene: Scene
    at: str | None = None
    pose_world_tcp: Pose | None = None
    joints: Array | None = None
    gripper: Literal["open", "closed", "unknown"] = "unknown"
    holding: str | None = None
    grasp: str | None = None
    pose_tcp_object: Pose | None = None
    lifted: bool = False
    contact: str | None = None
    moved: Mapping[str, Pose] = field(default_factory=dict[str, Pose])
    activity: Activity = "still"
    buffers: Mapping[str, Context] = field(default_factory=dict[str, Context])
    logged: tuple[tuple[str, Context], ...] = ()
    converted: frozenset[Parameter] = frozenset()
    reaches: Callable[[Pose], bool] | None = None
    bound: Mapping[str, float] = field(default_factory=dict[str, float])

    def standing(self, q: Array, pose_world_tcp: Pose) -> SymbolicState:
        """State with the arm's configuration `q` (7,), rad, reported by the arm where it was
        unknown."""
        if self.pose_world_tcp is not None:
            return self
        return replace(self, pose_world_tcp=pose_world_tcp, joints=q)

    def context(self) -> Context:
        """The context a recording made now would carry."""
        return Context(
            activity=self.activity,
            at=self.at,
            holding=self.holding,
            grasp=self.grasp,
            support=self.contact if self.contact else self._slid_on(),
        )

    def resolve(self, expression: str) -> Pose:
        """The TCP pose in the world that a pose expression stands for now.

        Raises:
            InputError: as `Symbols.resolve`.
        """
        return self.scene.symbols.resolve(expression, self.bound)

    def pose_of(self, name: str) -> Pose:
        """Believed pose of an object now."""
        return self.moved.get(name) or self.scene.body(name).pose_world

    def raised(self, surface: str, top: float) -> SymbolicState:
        """With the top of a surface at world z `top`, m, and what stands on it now with it."""
        rises = risen(self.scene, surface, top, self.pose_of)
        moved = {
            name: pose.translated((0.0, 0.0, rises.get(name, 0.0)))
            for name, pose in self.moved.items()
        }
        return replace(self, scene=raised(self.scene, surface, top), moved=moved)

    def learned(self, parameter: Parameter, value: tuple[float, ...]) -> SymbolicState:
        """Once a parameter has been measured: see `scene.raised.learned`."""
        if moves(self.scene, parameter):
            return self.raised(parameter.object, value[0])
        return replace(self, scene=learned(self.scene, parameter, value))

    @property
    def is_bent(self) -> bool:
        """True if the arm is where a joint motion took it, and not at a pose."""
        if self.joints is None or self.pose_world_tcp is None:
            return False
        bent = pose_of_joints(self.scene, self.joints)
        there = self.pose_world_tcp
        return bent.distance_to(there) < SAGS and bent.angle_to(there) < SAGS

    @property
    def q(self) -> Array | None:
        """(7,) rad: how the arm is bent; None before the first motion of a plan, and where the arm
        does not get."""
        if self.is_bent or self.pose_world_tcp is None:
            return self.joints
        return solids(self.scene).configuration(self.pose_world_tcp)

    @property
    def placed(self) -> tuple[tuple[str, bytes], ...]:
        """The objects that were moved and where they are, for a key."""
        moved = sorted(self.moved.items())
        return tuple((name, pose.digits) for name, pose in moved)

    @property
    def arrangement(self) -> tuple[object, ...]:
        """Key of the arrangement of arm, hand and objects."""
        pose, held = self.pose_world_tcp, self.pose_tcp_object
        return (
            None if pose is None else pose.digits,
            digits(self.joints) if self.is_bent and self.joints is not None else None,
            self.gripper,
            self.holding,
            None if held is None else held.digits,
            *self.placed,
        )

    def object_at(self, pose_world_tcp: Pose) -> Body | None:
        """The object that closing the fingers at this pose would grasp: the one between the pads,
        of several the one in their middle."""
        key = ("between", pose_world_tcp.digits, *self.placed)
        return solids(self.scene).cached(key, lambda: self._between(pose_world_tcp))

    def grip_of(self, body: Body, pose_world_tcp: Pose) -> Grip | None:
        """Contact of the pads with an object at this pose of the TCP; None where it is not between
        them."""
        pose = self.pose_of(body.name)
        x, y, _ = (pose_world_tcp.position - pose.position).tolist()
        if not body.is_near(x, y, self.scene.arm.hand.opening):
            return None
        return grip(solids(self.scene), body.name, pose_world_tcp.inverse() @ pose)

    def _between(self, pose_world_tcp: Pose) -> Body | None:
        found, least = None, np.inf
        for body in self.scene.objects.values():
            held = self.grip_of(body, pose_world_tcp)
            if held is not None and abs(held.aside) < least:
                found, least = body, abs(held.aside)
        return found

    def surface_below(self, pose_world_tcp: Pose) -> Body | None:
        """First believed contact of a guarded descent from this pose: a surface or an object's top."""
        x, y, z = pose_world_tcp.position.tolist()
        met, highest = None, -np.inf
        for body in self.scene.bodies.values():
            if body.name == self.holding:
                continue
            pose = self.pose_of(body.name)
            top = self.top_of(body) if body.covers(x, y, pose) else -np.inf
            if highest < top < z + SINKING:
                met, highest = body, top
        return met

    def top_of(self, body: Body) -> float:
        """World z, m, of the top of an object or surface."""
        return body.top_z(self.pose_of(body.name))

    def not_restored(self) -> dict[str, Pose]:
        """Objects left away from where the scene has them, with where they are."""
        return {
            name: pose
            for name, pose in self.moved.items()
            if pose.distance_to(self.scene.body(name).pose_world) > RESTORED_POSITION
        }

    def wrote(self, buffer: str) -> SymbolicState:
        """After a sensing leaf filled `buffer` in the present context."""
        context = self.context()
        return replace(
            self,
            buffers={**self.buffers, buffer: context},
            logged=(*self.logged, (buffer, context)),
        )

    def _slid_on(self) -> str | None:
        if self.activity != "sliding" or self.pose_world_tcp is None:
            return None
        below = self.surface_below(self.pose_world_tcp)
        return below.name if below else None


def pose_of_joints(scene: Scene, joints: Array) -> Pose:
    """Pose of the TCP (world) at joint angles (7,), rad."""
    return scene.pose_world_base @ forward_kinematics(scene.arm, tuple(joints.tolist()))


def during(moving: Iterable[Primitive], state: SymbolicState) -> SymbolicState:
    """State while `moving` run, as a sensing leaf beside them records it."""
    for primitive in moving:
        state = primitive.during(state)
    return state


def parallel(
    before: SymbolicState,
    meanwhile: SymbolicState,
    moving: Sequence[T],
    branches: Iterable[Sequence[T]],
    fold: Callable[[T, SymbolicState], SymbolicState],
) -> SymbolicState:
    """The state after a Parallel of leaves that move and branches that sense what is so meanwhile.

    `fold` gives the state after one leaf. The order in which branches end makes no difference: each
    adds what it changed.
    """
    sensed: list[SymbolicState] = []
    for branch in branches:
        state = meanwhile
        for leaf in branch:
            state = fold(leaf, state)
        sensed.append(state)
    now = before
    for leaf in moving:
        now = fold(leaf, now)
    for state in sensed:
        now = merged(now, meanwhile, state)
    return now


def merged(now: SymbolicState, base: SymbolicState, after: SymbolicState) -> SymbolicState:
    """`now` with what changed between `base` and `after`: leaves in a Parallel overlap in time."""
    if after is base:
        return now
    changes: dict[str, Any] = {}
    for name in _FIELDS:
        old, new = getattr(base, name), getattr(after, name)
        if new is not old:
            changes[name] = _joined(getattr(now, name), old, new)
    return replace(now, **changes)


def _joined(now: Any, old: Any, new: Any) -> Any:
    """Collections that only grow (buffers, logs, conversions) keep what others added meanwhile."""
    if isinstance(new, Mapping):
        entries = cast(Mapping[str, object], new)
        added = {key: value for key, value in entries.items() if old.get(key) is not value}
        return {**now, **added}
    if isinstance(new, frozenset):
        return now | new
    if isinstance(new, tuple):
        return (*now, *new[len(old) :])
    return new


_FIELDS = tuple(field.name for field in fields(SymbolicState))
