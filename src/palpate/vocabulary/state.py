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

from palpate.geometry.pose import Pose
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.scene.scene import Scene
from palpate.trace.recording import Context

if TYPE_CHECKING:
    from palpate.vocabulary.base import Primitive

T = TypeVar("T")

GRASP_REACH = 0.02
"""m: how far outside an object's box the TCP may be and still have the object between the
fingers."""

SINKING = 0.05
"""m: how far above the TCP a top may be and still be below the hand, by a belief about heights that
a contact corrects."""

RESTORED_POSITION = 0.005
"""m: an object within this distance of where it was found counts as restored."""


@dataclass(frozen=True, slots=True)
class SymbolicState:
    """Immutable; `replace` makes the next one.

    Attributes:
        scene: what is believed about the cell at rest.
        at: pose expression or joint configuration last reached.
        pose_world_tcp: where that is, None for joint configurations.
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
    """

    scene: Scene
    at: str | None = None
    pose_world_tcp: Pose | None = None
    gripper: Literal["open", "closed", "unknown"] = "unknown"
    holding: str | None = None
    grasp: str | None = None
    pose_tcp_object: Pose | None = None
    lifted: bool = False
    contact: str | None = None
    moved: Mapping[str, Pose] = field(default_factory=dict[str, Pose])
    activity: Literal["still", "moving", "sliding", "contact"] = "still"
    buffers: Mapping[str, Context] = field(default_factory=dict[str, Context])
    logged: tuple[tuple[str, Context], ...] = ()
    converted: frozenset[Parameter] = frozenset()
    reaches: Callable[[Pose], bool] | None = None

    def context(self) -> Context:
        """The context a recording made now would carry."""
        return Context(
            activity=self.activity,
            at=self.at,
            holding=self.holding,
            grasp=self.grasp,
            support=self.contact if self.contact else self._slid_on(),
        )

    def pose_of(self, name: str) -> Pose:
        """Where an object is believed to be now."""
        return self.moved.get(name) or self.scene.body(name).pose_world

    def object_at(self, pose_world_tcp: Pose) -> Body | None:
        """The object that closing the fingers at this pose would grasp: the one whose box holds the
        TCP."""
        found, least = None, GRASP_REACH
        for body in self.scene.objects.values():
            if not self._is_near(body, pose_world_tcp):
                continue
            outside = self._outside(body, pose_world_tcp)
            if outside < least or (found is None and outside == least):
                found, least = body, outside
        return found

    def surface_below(self, pose_world_tcp: Pose) -> Body | None:
        """What a guarded descent from this pose meets first, by belief: a surface or an object's
        top."""
        x, y, z = pose_world_tcp.position.tolist()
        met, highest = None, -np.inf
        for body in self.scene.bodies.values():
            if body.name == self.holding:
                continue
            pose = self.pose_of(body.name)
            top = body.top_z(pose) if body.covers(x, y, pose) else -np.inf
            if highest < top < z + SINKING:
                met, highest = body, top
        return met

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

    def _is_near(self, body: Body, pose_world_tcp: Pose) -> bool:
        x, y, _ = pose_world_tcp.position.tolist()
        at_x, at_y, _ = self.pose_of(body.name).position.tolist()
        return body.is_near(x - at_x, y - at_y, GRASP_REACH)

    def _outside(self, body: Body, pose_world_tcp: Pose) -> float:
        """Distance from the TCP to the object's box, 0 inside, m."""
        local = self.pose_of(body.name).local(pose_world_tcp.position) - body.centre
        return float(np.linalg.norm(np.maximum(np.abs(local) - body.size / 2, 0.0)))


def during(moving: Iterable[Primitive], state: SymbolicState) -> SymbolicState:
    """What is so while `moving` run: what a sensing leaf beside them records."""
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
