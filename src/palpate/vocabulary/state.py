"""The symbolic state: what a plan, or a run, may believe about the cell between two leaves.

The same effects that `check` folds over a plan are applied by the leaf at run time, so a
recording's context means the same thing on paper and on the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.scene.scene import Scene
from palpate.trace.recording import Context

GRASP_REACH = 0.02
"""m: how far outside an object's box the TCP may be and still have the object between the
fingers."""

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
        converted: gaps that a conversion has discharged.
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
        near = [
            (self._outside(body, pose_world_tcp), body)
            for body in self.scene.objects.values()
            if self._is_near(body, pose_world_tcp)
        ]
        best = min(near, key=lambda pair: pair[0], default=None)
        return best[1] if best is not None and best[0] <= GRASP_REACH else None

    def surface_below(self, pose_world_tcp: Pose) -> Body | None:
        """What a guarded descent from this pose meets first, by belief: a surface or an object's
        top."""
        x, y, z = pose_world_tcp.position.tolist()
        there = [
            (b, self.pose_of(b.name)) for b in self.scene.bodies.values() if b.name != self.holding
        ]
        under = [(b.top_z(pose), b) for b, pose in there if b.covers(x, y, pose)]
        met = max(
            (pair for pair in under if pair[0] < z + 0.05), key=lambda pair: pair[0], default=None
        )
        return met[1] if met else None

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


def merged(
    after: SymbolicState, sensed: Iterable[SymbolicState], before: SymbolicState
) -> SymbolicState:
    """The state `after` what moved, with all that was recorded and converted in `sensed` branches
    meanwhile."""
    for branch in sensed:
        after = replace(
            after,
            buffers={**after.buffers, **_new(branch, before)},
            logged=(*after.logged, *branch.logged[len(before.logged) :]),
            converted=after.converted | branch.converted,
        )
    return after


def _new(branch: SymbolicState, before: SymbolicState) -> dict[str, object]:
    return {
        name: context
        for name, context in branch.buffers.items()
        if before.buffers.get(name) is not context
    }
