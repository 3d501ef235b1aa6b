"""Trees from the primitives' own preconditions and effects.

A gap is chained backwards from its conversion, to the buffer that converts, to the sensing that
fills it; a search over the grounded motion and gripper primitives then finds the shortest way to a
state in which that chain holds. Gaps are reached one after another, so the cost grows with their
number and not with their combinations; what was found for one object is tried first for the next.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from palpate.errors import InputError, PlanRejected
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.check.measured import amount, measured
from palpate.planning.nodes import beside, during, node_of
from palpate.planning.plan import Node
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import Motion, blockers, motion_to, straddled
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import converters, sensors, vocabulary
from palpate.vocabulary.state import RESTORED_POSITION, SymbolicState

HOME = "home_config"
TEMPORARY = "_temporary"
SLIDE = 0.06
"""m: how far an object is slid for its friction, at least."""
MAX_STATES = 5000
"""States that one search looks at before it gives up."""

Tail = Callable[[SymbolicState], "list[Step] | None"]
"""What is left to do in a state to reach the goal; None when the goal is not in reach from
there."""


@dataclass(frozen=True, slots=True)
class Step:
    """Primitives that run together (in a Parallel when several). `touches`: it ends in contact with
    a surface."""

    primitives: tuple[Primitive, ...]
    touches: bool = False

    @property
    def senses(self) -> bool:
        """Whether nothing moves."""
        return not any(p.claims for p in self.primitives)


class Backchainer:
    """Builds one plan, group by group, over one symbolic state."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.state = SymbolicState(scene)
        self.steps: list[Step] = []
        self._found: dict[frozenset[str], tuple[str, list[Step]]] = {}

    @classmethod
    def at_home(cls, scene: Scene) -> Backchainer:
        """One that has begun."""
        chainer = cls(scene)
        chainer.go_home()
        return chainer

    def tree(self) -> Node:
        """The steps so far: sensing is grouped with the contact it follows, as one Sequence."""
        return Node("Sequence", children=tuple(_nodes(self.steps)))

    def go_home(self) -> None:
        """At the home configuration, the hand open and empty."""
        self._reach(
            self._operators([]),
            _when(lambda s: s.at == HOME and s.gripper == "open" and not s.holding),
            f"'{HOME}' cannot be reached",
        )

    def measure(self, name: str, parameters: Sequence[Parameter]) -> None:
        """Discharge `gaps` of one object or surface and leave the scene as it was found.

        Raises:
            PlanRejected: there is no way; the message says which gap.
        """
        before = (self.state, len(self.steps))
        try:
            if not self._as_before(name, parameters):
                self._search(name, parameters)
        except PlanRejected:
            self.state = before[0]
            del self.steps[before[1] :]
            raise

    def _search(self, name: str, parameters: Sequence[Parameter]) -> None:
        first, away = (
            len(self.steps),
            self._clear(name, (name,)) if name in self.scene.bodies else [],
        )
        for parameter in parameters:
            while not measured(parameter, self.state):
                self._acquire(parameter)
        self._reach(
            self._operators(self._near(name)), _when(_at_rest(name)), f"'{name}' cannot be put back"
        )
        if not away:
            self._found[frozenset(g.quantity for g in parameters)] = (name, self.steps[first:])
        for blocker, place in reversed(away):
            self._carry(blocker, place, _at_rest(blocker))

    def _acquire(self, parameter: Parameter) -> None:
        domains = list(self._domains(parameter.object))
        for i, expressions in enumerate(domains):
            operators = self._operators(expressions)
            failure = (
                f"no sequence of primitives measures {parameter}" if i == len(domains) - 1 else ""
            )
            if self._reach(
                operators, lambda state, ops=operators: _chain(parameter, state, ops), failure
            ):
                return

    def _as_before(self, name: str, parameters: Sequence[Parameter]) -> bool:
        """Whether what was found for another object with the same gaps also holds for this one;
        then it is done."""
        other, steps = self._found.get(frozenset(g.quantity for g in parameters), ("", []))
        if not steps:
            return False
        state, done = self.state, list[Step]()
        for step in steps:
            step = Step(tuple(_renamed(p, other, name) for p in step.primitives), step.touches)
            after = _applied(step, state)
            if after is None:
                return False
            state = after
            done.append(step)
        if not all(measured(parameter, state) for parameter in parameters) or not _at_rest(name)(
            state
        ):
            return False
        self.state = state
        self.steps += done
        return True

    def _clear(self, name: str, waiting: tuple[str, ...]) -> list[tuple[str, str]]:
        """Carry away what blocks `name`, and first what blocks that; what was moved, with where
        to."""
        away: list[tuple[str, str]] = []
        approach, work = self._above(name)
        while found := blockers(self.state, name, self._resolve(approach), self._resolve(work)):
            blocker = found[0]
            if blocker in waiting or any(blocker == b for b, _ in away):
                raise PlanRejected(
                    f"'{blocker}' blocks '{name}' and cannot be carried out of its way"
                )
            away += self._clear(blocker, (*waiting, blocker))
            place = f"{blocker}{TEMPORARY}"
            if not self._exists(place):
                raise PlanRejected(
                    f"'{blocker}' is in the way, and there is no free place to put it"
                )
            turn = self._resolve(place) @ self._resolve(f"{blocker}_pose").inverse()
            self._carry(blocker, place, _placed(blocker, turn @ self.state.pose_of(blocker)))
            away.append((blocker, place))
        return away

    def _carry(self, name: str, place: str, done: Callable[[SymbolicState], bool]) -> None:
        expressions = [e for spot in (f"{name}_pose", place) for e in (f"{spot} + z_offset", spot)]
        self._reach(
            self._operators(expressions),
            _when(done),
            f"'{name}' cannot be carried out of the way and back",
        )

    def _above(self, name: str) -> tuple[str, str]:
        spot = f"{name}_pose" if name in self.scene.objects else f"{name}_approach"
        return f"{spot} + z_offset", spot

    def _near(self, name: str) -> list[str]:
        return next(self._domains(name))

    def _domains(self, name: str) -> Iterator[list[str]]:
        """Pose expressions around a thing, few first: above and at it, then shifted along its
        axes."""
        above, spot = self._above(name)
        if name not in self.scene.bodies:
            yield [self._above(other)[0] for other in self.scene.objects]
            return
        yield [above, spot] if name in self.scene.objects else [spot, above]
        axes = ("x_offset", "y_offset") if name in self.scene.objects else ()
        for axis in axes:
            length = float(np.linalg.norm(self.scene.symbols.offset(axis, spot)))
            factor = max(1, math.ceil(SLIDE / max(length, 1e-3)))
            yield [above, spot, *(f"{spot} {sign} {factor}*{axis}" for sign in "+-")]
        for axis in axes:
            near = [f"{spot} {sign} {axis}" for sign in "+-"]
            yield [above, spot, *(e for s in near for e in (f"{s} + z_offset", s))]

    def _operators(self, expressions: Iterable[str]) -> list[Primitive]:
        """Motion and gripper primitives with arguments that matter here."""
        here = [self.state.grasp, f"{self.state.grasp} + z_offset"] if self.state.grasp else []
        poses = [e for e in dict.fromkeys([*expressions, *here]) if self._exists(e)]
        domains = {"pose": poses, "joints": [HOME], "axis": ["-z"]}
        found: list[Primitive] = []
        for cls in vocabulary().primitives.values():
            if cls.group in ("motion", "gripper"):
                found += _grounded(cls, domains)
        return found

    def _exists(self, expression: str) -> bool:
        try:
            self._resolve(expression)
        except InputError:
            return False
        return True

    def _resolve(self, expression: str) -> Pose:
        return self.scene.symbols.resolve(expression)

    def _reach(self, operators: Sequence[Primitive], tail: Tail, failure: str) -> bool:
        """Append the fewest steps after which `tail` has nothing left but what it returns."""
        found = _shortest(self.state, operators, tail)
        if found is None:
            if failure:
                raise PlanRejected(failure)
            return False
        steps, self.state = found
        self.steps += steps
        return True


def _shortest(
    start: SymbolicState, operators: Sequence[Primitive], tail: Tail
) -> tuple[list[Step], SymbolicState] | None:
    """Breadth-first search; ties go to the order of `operators`."""
    queue: deque[tuple[SymbolicState, tuple[Step, ...]]] = deque([(start, ())])
    seen = {_key(start)}
    while queue and len(seen) < MAX_STATES:
        state, steps = queue.popleft()
        rest = tail(state)
        if rest is not None:
            for step in rest:
                state = _effect(step, state)
            return [*steps, *rest], state
        for operator in operators:
            after = _applied(Step((operator,)), state)
            if after is not None and (key := _key(after)) not in seen:
                seen.add(key)
                touches = after.contact is not None
                queue.append((after, (*steps, Step((operator,), touches))))
    return None


def _chain(
    parameter: Parameter, state: SymbolicState, operators: Sequence[Primitive]
) -> list[Step] | None:
    """The steps that sense and convert `gap` from `state`, alone or beside one of the motions."""
    for chain in _chains(parameter.quantity):
        steps = [Step((p,)) for p in chain]
        if _yields(parameter, steps, state):
            return steps
        for operator in operators:
            steps = [Step((operator, chain[0])), *(Step((p,)) for p in chain[1:])]
            if "arm" in operator.claims and not state.contact and _yields(parameter, steps, state):
                return steps
    return None


def _chains(quantity: str) -> Iterator[tuple[Primitive, ...]]:
    """Sensing and conversion that end in `quantity`."""
    known = catalogue()[quantity]
    if known.derived:
        for buffer in dict.fromkeys(evidence.buffer for evidence in known.evidence):
            for cls in sensors(buffer):
                for sensing in _grounded(cls, {}):
                    yield (sensing,)
    for cls in converters(quantity):
        for conversion in _grounded(cls, {}):
            if cls.reads is None:
                yield (conversion,)
            yield from (
                (s, conversion) for sensor in sensors(cls.reads) for s in _grounded(sensor, {})
            )


def _yields(parameter: Parameter, steps: Iterable[Step], state: SymbolicState) -> bool:
    before = amount(parameter, state)
    for step in steps:
        if not _may_concern(parameter, step, state):
            return False
        after = _applied(step, state)
        if after is None:
            return False
        state = after
    return amount(parameter, state) > before


def _may_concern(parameter: Parameter, step: Step, state: SymbolicState) -> bool:
    """Whether what a step records may be evidence for a derived gap: a quick look before the step
    is tried."""
    if not catalogue()[parameter.quantity].derived:
        return True
    context = during([p for p in step.primitives if p.claims], state).context()
    for primitive in step.primitives:
        if primitive.writes and catalogue().piece(parameter, primitive.writes, context):
            return True
    return False


def _applied(step: Step, state: SymbolicState) -> SymbolicState | None:
    """The state after a step whose preconditions hold and whose motion is clear; None when they do
    not."""
    moving = [p for p in step.primitives if p.claims]
    meanwhile = during(moving, state)
    for primitive in step.primitives:
        if not primitive.claims and primitive.requires(meanwhile):
            return None
    try:
        after = _effect(step, state)
    except InputError:
        return None
    if not all(_fits(p, state, after, recorded=len(step.primitives) > 1) for p in moving):
        return None
    return None if any(p.requires(state) for p in moving) else after


def _effect(step: Step, state: SymbolicState) -> SymbolicState:
    return beside(
        [p for p in step.primitives if p.claims],
        [p for p in step.primitives if not p.claims],
        state,
    )


def _fits(primitive: Primitive, state: SymbolicState, after: SymbolicState, recorded: bool) -> bool:
    """Whether a motion is one that this planner makes: sensible, vertical near things, and clear of
    them."""
    if "gripper" in primitive.claims:
        return after.holding is not None if after.gripper == "closed" else _may_open(state)
    end = after.pose_world_tcp
    between = None if state.holding else straddled(state, state.pose_world_tcp)
    if end is None:
        return not (between or state.contact or state.holding)
    if after.contact:
        return state.contact is None and between is None
    motion = motion_to(state, end)
    if motion is None or (after.at == state.at and not state.contact):
        return False
    entered = None if state.holding else straddled(state, end)
    if (
        between or entered or state.contact or state.lifted != after.lifted
    ) and not motion.vertical:
        return False
    if (
        state.holding
        and not state.lifted
        and not after.lifted
        and not _slide_fits(motion, after, recorded)
    ):
        return False
    return not motion.hits(ignoring=[n for n in (between, entered) if n])


def _may_open(state: SymbolicState) -> bool:
    """Objects are let go of where the scene has them, or at their temporary place."""
    held = state.holding
    return state.gripper != "open" and (
        held is None or not _away(state, held) or state.at == f"{held}{TEMPORARY}"
    )


def _slide_fits(motion: Motion, after: SymbolicState, recorded: bool) -> bool:
    """Objects are slid far enough to be felt, or back to where they were."""
    travel = motion.end.distance_to(motion.start)
    if recorded:
        return travel >= SLIDE - RESTORED_POSITION
    return (
        travel < 2 * SLIDE
        and not _away(after, after.holding or "")
        and not (after.grasp or "").endswith(TEMPORARY)
    )


def _away(state: SymbolicState, name: str) -> bool:
    return name in state.not_restored()


def _at_rest(name: str) -> Callable[[SymbolicState], bool]:
    """The hand empty, open and clear, and `name` where the scene has it."""
    return lambda s: _clear_of_all(s) and not _away(s, name)


def _placed(name: str, pose_world_object: Pose) -> Callable[[SymbolicState], bool]:
    return lambda s: (
        _clear_of_all(s) and s.pose_of(name).distance_to(pose_world_object) < RESTORED_POSITION
    )


def _clear_of_all(state: SymbolicState) -> bool:
    return (
        state.gripper == "open"
        and not state.holding
        and not state.contact
        and straddled(state, state.pose_world_tcp) is None
    )


def _when(done: Callable[[SymbolicState], bool]) -> Tail:
    return lambda state: [] if done(state) else None


def _key(state: SymbolicState) -> tuple[object, ...]:
    moved = tuple(
        (name, *np.round(pose.position, 4).tolist()) for name, pose in sorted(state.moved.items())
    )
    return state.at, state.gripper, state.holding, state.grasp, state.lifted, state.contact, moved


def _grounded(cls: type[Primitive], domains: dict[str, list[str]]) -> list[Primitive]:
    """Instances of a primitive with at most one argument, over the domain of that argument."""
    fields = list(cls.model_fields)
    if len(fields) > 1 or any(f not in domains for f in fields):
        return []
    try:
        return [cls(**{f: v}) for f in fields for v in domains[f]] if fields else [cls()]
    except ValidationError:
        return []


def _renamed(primitive: Primitive, old: str, new: str) -> Primitive:
    pose = getattr(primitive, "pose", None)
    if not isinstance(pose, str):
        return primitive
    head, *rest = pose.split(" ", 1)
    renamed = {f"{old}_pose": f"{new}_pose", f"{old}_approach": f"{new}_approach"}.get(head, head)
    return primitive.model_copy(update={"pose": " ".join([renamed, *rest])})


def _nodes(steps: Sequence[Step]) -> Iterator[Node]:
    group: list[Node] = []
    for i, step in enumerate(steps):
        made = tuple(node_of(p) for p in step.primitives)
        node = made[0] if len(made) == 1 else Node("Parallel", children=made)
        following = steps[i + 1] if i + 1 < len(steps) else None
        if (
            (step.senses or step.touches or len(made) > 1)
            and following is not None
            and following.senses
        ):
            group.append(node)
            continue
        yield Node("Sequence", children=(*group, node)) if group else node
        group = []
