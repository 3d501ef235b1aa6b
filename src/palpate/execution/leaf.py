"""Behavior tree of a plan, and its leaves: the only code that drives the robot."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import cast

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Sequence
from pydantic import ValidationError

from palpate.common.errors import InputError
from palpate.planning.plan import Node
from palpate.primitives.base import Blackboard, LeafFailure, Primitive, Steps
from palpate.primitives.registry import Vocabulary
from palpate.primitives.state import merge_states
from palpate.trace.recording import LeafRun

log = logging.getLogger(__name__)

INTERRUPTED = "interrupted"  # Message of a leaf that was stopped from outside


class PrimitiveLeaf(Behaviour):
    """A primitive running in a tree.

    - First tick: arguments are bound. Its preconditions must hold and its resources be free;
      otherwise it returns FAILURE before any motion.
    - Every tick: its safety predicate and its timeout (robot time) are checked, then it runs one
      step.
    - Return: SUCCESS, and its effects are applied to the symbolic state.
    - Any exception: FAILURE with the reason as `feedback_message`.
    - Stop from outside (INVALID): its generator is closed.

    Except on SUCCESS, an arm that it claimed holds. Every run of the leaf records one `LeafRun`.

    Args:
        primitive: primitive to run.
        blackboard: the robot, the symbolic state and the recorder, shared by all leaves of a run.
        node: path in the plan, e.g. `tree.children[3]`.
        name: for people; the primitive's label by default.
    """

    def __init__(
        self, primitive: Primitive, blackboard: Blackboard, node: str, name: str = ""
    ) -> None:
        super().__init__(name or primitive.label)
        self.primitive = primitive
        self.blackboard = blackboard
        self.node = node
        self.started = 0.0
        self._steps: Steps | None = None
        # An earlier reflex, which no motion has cleared yet.
        self._earlier: str | None = None

    def initialise(self) -> None:
        """Begin a new run; nothing moves before the first `update`."""
        self.feedback_message = ""
        self.started = self.blackboard.robot.state.t
        self._earlier = self.blackboard.robot.state.reflex
        self._steps = self._run()

    def update(self) -> Status:
        """Run one step; no step after another leaf has failed, as the tree then ends this one."""
        assert self._steps is not None
        if self.blackboard.failed:
            return Status.RUNNING
        recordings = self.blackboard.recorder.recordings
        logged = len(recordings)
        try:
            self.blackboard.waits.append(next(self._steps) or 0.0)
        except StopIteration as done:
            self.feedback_message = str(done.value)
            return Status.SUCCESS
        except LeafFailure as failure:
            return self._fail(str(failure))
        except Exception as error:
            log.debug("%s failed", self.name, exc_info=True)
            return self._fail(f"{type(error).__name__}: {error}")
        except BaseException:
            self.terminate(Status.INVALID)
            raise
        finally:
            # The primitive does not know its own node.
            recordings[logged:] = [replace(r, node=self.node) for r in recordings[logged:]]
        return Status.RUNNING

    def _fail(self, reason: str) -> Status:
        self.feedback_message = reason
        self.blackboard.failed = True
        return Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """Close the generator and record the run, once."""
        steps, self._steps = self._steps, None
        if steps is None:
            return
        try:
            steps.close()
        finally:
            self._record(new_status)

    def _record(self, status: Status) -> None:
        message = self.feedback_message or (INTERRUPTED if status is Status.INVALID else "")
        # A robot without a response leaves the start time as the end.
        end = self.started
        with suppress(Exception):  # a robot that no longer responds has no time
            end = self.blackboard.robot.state.t
        run = LeafRun(
            self.node,
            type(self.primitive).__name__,
            self.name,
            start=self.started,
            end=end,
            status=status.name,  # pyright: ignore[reportArgumentType]
            message=message,
            context=self.blackboard.state.context(),
        )
        self.blackboard.recorder.leaves.append(run)

    def _run(self) -> Steps:
        """Whole run: preconditions, steps, effects."""
        blackboard, claims = self.blackboard, self.primitive.claims
        self.primitive.bind(blackboard)
        self._require()
        # Claim the resources, and enter the state of the motion.
        before = blackboard.state
        for resource in claims:
            blackboard.owner[resource] = self
        blackboard.motions += bool(claims)
        if "arm" in claims:
            blackboard.set_out()
        during = blackboard.state = self.primitive.during(before)
        try:
            message = yield from self._check_steps()
            after = self.primitive.effects(before)
            after = self.primitive.observed(after, blackboard.robot.state)
            # Fold the effects as the check does; keep changes by other leaves in the meantime.
            blackboard.state = merge_states(blackboard.state, during, after)
            if claims:
                blackboard.state = blackboard.settled(self.node, blackboard)
        except BaseException:
            if "arm" in claims:
                blackboard.robot.hold()
            raise
        finally:
            blackboard.motions -= bool(claims)
            for resource in claims:
                del blackboard.owner[resource]
        return message

    def _require(self) -> None:
        """Require free resources and no violation."""
        for resource in sorted(self.primitive.claims & self.blackboard.owner.keys()):
            owner = cast(PrimitiveLeaf, self.blackboard.owner[resource])
            raise LeafFailure(f"the {resource} is in use by {owner.name}: one motion at a time")
        if self.primitive.claims:
            # Before the first motion only the robot knows its pose.
            robot = self.blackboard.robot.state
            state = self.blackboard.state.standing(robot.q, robot.pose_world_tcp)
            self.blackboard.state = state
        violations = self.primitive.violations(self.blackboard.state)
        if violations:
            raise LeafFailure("; ".join(str(violation) for violation in violations))

    def _check_steps(self) -> Steps:
        """Steps of the primitive, each after a check of its safety predicate and timeout."""
        steps = self.primitive.run(self.blackboard)
        try:
            while True:
                self._check()
                try:
                    wait = next(steps)
                except StopIteration as done:
                    return done.value
                yield wait
        finally:
            steps.close()

    def _check(self) -> None:
        reflex = self.blackboard.robot.state.reflex
        if reflex is None:
            self._earlier = None
        # The reason of the predicate is more specific than that of a reflex.
        new_reflex = reflex if reflex != self._earlier else None
        if reason := self.primitive.unsafe(self.blackboard) or new_reflex:
            met = reason.startswith("unexpected contact")
            raise LeafFailure(
                reason + (self.primitive.contact_place(self.blackboard) if met else "")
            )
        limit = self.primitive.timeout
        if self.blackboard.robot.state.t - self.started > limit:
            raise LeafFailure(f"not done after {limit:g} s of robot time")


# The py_trees tree of a plan.


def build(node: Node, words: Vocabulary, blackboard: Blackboard, path: str = "tree") -> Behaviour:
    """The py_trees tree of a plan, its leaves bound to `blackboard`.

    A Sequence has memory. A Parallel succeeds with all of its children, and fails with the first.
    Inside a Parallel, motions are ticked before sensing leaves, whatever their order in the plan. A
    sensing leaf thus notices in the same tick that a motion has started or ended.

    Raises:
        InputError: unknown node type, arguments that do not fit, or an empty composite, which
            py_trees would take for a success.
    """
    if node.type not in words.composites:
        try:
            primitive = words.make(node.type, dict(node.args))
        except ValidationError as error:
            problem = error.errors()[0]
            where = ".".join(str(part) for part in problem["loc"])
            raise InputError(f"{path}: {node.type}: {where}: {problem['msg']}") from None
        return PrimitiveLeaf(primitive, blackboard, path, node.name)
    if not node.children:
        raise InputError(
            f"{path}: an empty {node.type} does nothing; give it children or remove it"
        )
    children = [
        build(child, words, blackboard, f"{path}.children[{i}]")
        for i, child in enumerate(node.children)
    ]
    name = node.name or node.type
    if node.type == "Sequence":
        return Sequence(name, memory=True, children=children)
    # Children with motions first; the sort is stable.
    children.sort(key=lambda child: not any(leaf.primitive.claims for leaf in leaves(child)))
    return Parallel(name, policy=ParallelPolicy.SuccessOnAll(), children=children)


def leaves(root: Behaviour) -> Iterator[PrimitiveLeaf]:
    """All leaves below and including `root`, in the order of ticks."""
    return (node for node in root.iterate() if isinstance(node, PrimitiveLeaf))
