"""The one leaf of every tree: it drives a primitive's generator, and nothing else runs on the
robot."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.trace.recording import LeafRun
from palpate.vocabulary.base import Blackboard, LeafFailure, Primitive, Steps
from palpate.vocabulary.state import SymbolicState

log = logging.getLogger(__name__)

INTERRUPTED = "interrupted"
"""Message of a leaf that was stopped from outside."""


class PrimitiveLeaf(Behaviour):
    """A primitive's life in a tree.

    - first tick: its preconditions must hold and its resources be free, else FAILURE before
      anything moves;
    - every tick: its safety predicate and its timeout (robot time) are checked, then it runs one
      step;
    - it returns: its effects are applied to the cell's state, SUCCESS;
    - it raises, whatever: FAILURE with the reason as `feedback_message`;
    - stopped from outside (INVALID): its generator is closed.

    However it ends but by SUCCESS, an arm that it claimed is told to hold. Every life leaves one
    `LeafRun`.

    Args:
        primitive: what to run.
        blackboard: the robot, the symbolic state and the recorder, shared by all leaves of a run.
        node: path in the plan, e.g. `tree.children[3]`.
        name: shown to people; the primitive's label by default.
    """

    def __init__(
        self, primitive: Primitive, blackboard: Blackboard, node: str, name: str = ""
    ) -> None:
        super().__init__(name or primitive.label)
        self.primitive = primitive
        self.blackboard = blackboard
        self.node = node
        self.started = 0.0
        self._life: Steps | None = None

    def initialise(self) -> None:
        """Begin a new life; nothing moves before the first `update`."""
        self.feedback_message = ""
        self.started = self.blackboard.robot.state.t
        self._life = self._live()

    def update(self) -> Status:
        """One step."""
        assert self._life is not None
        logged = len(self.blackboard.recorder.recordings)
        try:
            next(self._life)
        except StopIteration as done:
            self.feedback_message = str(done.value)
            return Status.SUCCESS
        except LeafFailure as failure:
            return self._failed(str(failure))
        except Exception as error:
            log.exception("%s failed", self.name)
            return self._failed(f"{type(error).__name__}: {error}")
        except BaseException:
            self.terminate(Status.INVALID)
            raise
        finally:
            self._sign(logged)
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Close the generator and record the life, once."""
        life, self._life = self._life, None
        if life is None:
            return
        try:
            life.close()
        finally:
            self._record(new_status)

    def _live(self) -> Steps:
        self._require()
        before = self.blackboard.state
        claims = self.primitive.claims
        self.blackboard.owner.update(dict.fromkeys(claims, self))
        self.blackboard.motions += bool(claims)
        self.blackboard.state = during = self.primitive.during(before)
        try:
            message = yield from self._guarded()
            self.blackboard.state = merged(
                self.blackboard.state, during, self.primitive.effects(before)
            )
        except BaseException:
            if "arm" in claims:
                self.blackboard.robot.hold()
            raise
        finally:
            self.blackboard.motions -= bool(claims)
            for resource in claims:
                del self.blackboard.owner[resource]
        return message

    def _require(self) -> None:
        for resource in sorted(self.primitive.claims & self.blackboard.owner.keys()):
            owner = cast(PrimitiveLeaf, self.blackboard.owner[resource])
            raise LeafFailure(f"the {resource} is in use by {owner.name}: one motion at a time")
        if reasons := self.primitive.requires(self.blackboard.state):
            raise LeafFailure("; ".join(reasons))

    def _guarded(self) -> Steps:
        steps = self.primitive.run(self.blackboard)
        try:
            while True:
                self._check()
                try:
                    next(steps)
                except StopIteration as done:
                    return done.value
                yield
        finally:
            steps.close()

    def _check(self) -> None:
        if reason := self.primitive.unsafe(self.blackboard):
            raise LeafFailure(reason)
        limit = self.primitive.timeout
        if self.blackboard.robot.state.t - self.started > limit:
            raise LeafFailure(f"not done after {limit:g} s of robot time")

    def _failed(self, reason: str) -> Status:
        self.feedback_message = reason
        return Status.FAILURE

    def _sign(self, first: int) -> None:
        recordings = self.blackboard.recorder.recordings
        recordings[first:] = [replace(r, node=self.node) for r in recordings[first:]]

    def _record(self, status: Status) -> None:
        message = self.feedback_message or (INTERRUPTED if status is Status.INVALID else "")
        self.blackboard.recorder.leaves.append(
            LeafRun(
                self.node,
                type(self.primitive).__name__,
                self.name,
                self.started,
                self.blackboard.robot.state.t,
                status.name,  # pyright: ignore[reportArgumentType]
                message,
                self.blackboard.state.context(),
            )
        )


def merged(now: SymbolicState, base: SymbolicState, after: SymbolicState) -> SymbolicState:
    """`now` with what changed between `base` and `after`: leaves in a Parallel overlap in time."""
    changes = {
        f.name: _merged(getattr(now, f.name), getattr(base, f.name), getattr(after, f.name))
        for f in fields(SymbolicState)
        if getattr(after, f.name) is not getattr(base, f.name)
    }
    return replace(now, **changes)


def _merged(now: Any, base: Any, after: Any) -> Any:
    """Collections that only grow (buffers, logs, conversions) keep what others added meanwhile."""
    if isinstance(after, Mapping):
        entries = cast(Mapping[str, object], after)
        return {
            **now,
            **{key: value for key, value in entries.items() if base.get(key) is not value},
        }
    if isinstance(after, frozenset):
        return now | after
    if isinstance(after, tuple):
        return (*now, *after[len(base) :])
    return after
