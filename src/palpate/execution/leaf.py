"""The one leaf of every tree: it drives a primitive's generator, and nothing else runs on the
robot."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.trace.recording import LeafRun
from palpate.vocabulary.base import Blackboard, LeafFailure, Primitive, Steps
from palpate.vocabulary.state import SymbolicState, merged

log = logging.getLogger(__name__)

INTERRUPTED = "interrupted"
"""Message of a leaf that was stopped from outside."""


class PrimitiveLeaf(Behaviour):
    """A primitive's life in a tree.

    - first tick: what of its arguments is open is found out; its preconditions must hold and its
      resources be free, else FAILURE before anything moves;
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
        self._earlier: str | None = None
        """A reflex from before, which no motion has cleared yet."""

    def initialise(self) -> None:
        """Begin a new life; nothing moves before the first `update`."""
        self.feedback_message = ""
        self.started = self.blackboard.robot.state.t
        self._earlier = self.blackboard.robot.state.reflex
        self._life = self._live()

    def update(self) -> Status:
        """Do one step; none beside a leaf that has failed, which is about to end this one, too."""
        assert self._life is not None
        if self.blackboard.failed:
            return Status.RUNNING
        logged = len(self.blackboard.recorder.recordings)
        try:
            next(self._life)
        except StopIteration as done:
            self.feedback_message = str(done.value)
            return Status.SUCCESS
        except LeafFailure as failure:
            return self._failed(str(failure))
        except Exception as error:
            log.debug("%s failed", self.name, exc_info=True)
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
        """The whole life: from the preconditions to the effects, whatever happens between."""
        self.primitive.bind(self.blackboard)
        self._require()
        before, during = self._begin()
        try:
            message = yield from self._guarded()
            self._apply(before, during)
        except BaseException:
            if "arm" in self.primitive.claims:
                self.blackboard.robot.hold()
            raise
        finally:
            self._release()
        return message

    def _require(self) -> None:
        """Fail before anything moves: what it claims must be free, and nothing may speak against
        it."""
        for resource in sorted(self.primitive.claims & self.blackboard.owner.keys()):
            owner = cast(PrimitiveLeaf, self.blackboard.owner[resource])
            raise LeafFailure(f"the {resource} is in use by {owner.name}: one motion at a time")
        if self.primitive.claims:
            # Before the first motion only the robot knows where it is.
            robot = self.blackboard.robot.state
            state = self.blackboard.state.standing(robot.q, robot.pose_world_tcp)
            self.blackboard.state = state
        violations = self.primitive.violations(self.blackboard.state)
        if violations:
            raise LeafFailure("; ".join(str(violation) for violation in violations))

    def _begin(self) -> tuple[SymbolicState, SymbolicState]:
        """Claim the resources; the state before, and what is so from now on."""
        blackboard, claims = self.blackboard, self.primitive.claims
        before = blackboard.state
        for resource in claims:
            blackboard.owner[resource] = self
        blackboard.motions += bool(claims)
        blackboard.state = self.primitive.during(before)
        return before, blackboard.state

    def _apply(self, before: SymbolicState, during: SymbolicState) -> None:
        """The effects, as the check folds them; what other leaves changed meanwhile stays."""
        after = self.primitive.observed(self.primitive.effects(before), self.blackboard.robot.state)
        self.blackboard.state = merged(self.blackboard.state, during, after)

    def _release(self) -> None:
        self.blackboard.motions -= bool(self.primitive.claims)
        for resource in self.primitive.claims:
            del self.blackboard.owner[resource]

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
        # What the predicate says of a state in which the arm stopped itself is more than that it did.
        if reason := self.primitive.unsafe(self.blackboard) or self._reflex():
            raise LeafFailure(reason)
        limit = self.primitive.timeout
        if self.blackboard.robot.state.t - self.started > limit:
            raise LeafFailure(f"not done after {limit:g} s of robot time")

    def _reflex(self) -> str | None:
        """Reason why the arm stopped itself since this leaf began."""
        reflex = self.blackboard.robot.state.reflex
        if reflex is None:
            self._earlier = None
        return reflex if reflex != self._earlier else None

    def _failed(self, reason: str) -> Status:
        self.feedback_message = reason
        self.blackboard.failed = True
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
                self._now(),
                status.name,  # pyright: ignore[reportArgumentType]
                message,
                self.blackboard.state.context(),
            )
        )

    def _now(self) -> float:
        """Robot time, or, from a robot that does not answer any more, when the life began."""
        try:
            return self.blackboard.robot.state.t
        except Exception:
            return self.started
