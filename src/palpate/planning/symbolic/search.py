"""Trees from the primitives' own preconditions and effects.

A parameter is chained backwards from its conversion, to the buffer that it reads, to the sensing
that fills it; a search over the grounded motion and gripper primitives then finds the shortest way
to a state in which that chain holds. Parameters are reached one after another, so the cost grows
with their number and not with their combinations; what was found for one object is tried first for
the next.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.errors import InputError, PlanRejected
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.check.measured import amount, enough, measured
from palpate.planning.plan import Node
from palpate.planning.symbolic.passes import with_effort
from palpate.planning.symbolic.steps import ASIDE, SLIDE, TEMPORARY, Step, is_away, is_clear, nodes
from palpate.quantities.precision.effort import Effort
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import blockers
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.base import Primitive, Surroundings
from palpate.vocabulary.motion import HOME_CONFIG
from palpate.vocabulary.registry import Vocabulary, vocabulary
from palpate.vocabulary.state import RESTORED_POSITION, SymbolicState, during
from palpate.vocabulary.violation import PRECONDITION

SPOT = 1.5
"""Offsets between the spots of a surface that are touched: 75 mm, of which three make a plane."""

MAX_STATES = 5000
"""States that one search looks at before it gives up."""

FEW_STATES = 60
"""That it looks at again, to say why."""

SIDEWAYS = ("y_offset", "x_offset")
"""Offsets along which things are slid."""

MAX_DETOURS = 20
"""Ways that one search finds and sees refused before it gives up."""

Goal = Callable[[SymbolicState], bool]
Refusal = tuple[tuple[object, ...], str]
"""A state, and the label of a step that does harm there."""
Kind = tuple[bool, frozenset[str]]
"""Whether things are slid to the other side first, and the quantities that are measured."""
Tail = Callable[[SymbolicState], "list[Step] | None"]
"""What is left to do in a state to reach the goal; None when the goal is not in reach from
there."""


@dataclass(eq=False)
class Backchainer:
    """Builds one plan, thing by thing, over one symbolic state.

    Attributes:
        scene: where it is to run.
        words: the vocabulary that it may use.
        mirrored: things are slid aside to the other side first. What is dragged lags behind, and is
            left a little to where it came from: in turn, that evens out.
        state, steps: the plan so far, and what is believed after it.
    """

    scene: Scene
    words: Vocabulary = field(default_factory=vocabulary)
    mirrored: bool = False
    state: SymbolicState = field(init=False)
    steps: list[Step] = field(default_factory=list[Step], init=False)
    _found: dict[Kind, tuple[str, list[Step]]] = field(
        default_factory=dict[Kind, tuple[str, list[Step]]], init=False
    )
    """The object for which the like was measured first, and how."""
    _hindrance: str = field(default="", init=False)
    """What the last way that was found would have run into."""

    def __post_init__(self) -> None:
        self.state = SymbolicState(self.scene)

    @classmethod
    def at_home(cls, scene: Scene, words: Vocabulary) -> Backchainer:
        """One that has begun."""
        chainer = cls(scene, words)
        chainer.go_home()
        return chainer

    def tree(self) -> Node:
        """The steps so far, as one Sequence."""
        return Node("Sequence", children=tuple(nodes(self.steps)))

    def go_home(self) -> None:
        """At the home configuration, the hand open and empty."""

        def home(state: SymbolicState) -> bool:
            return state.at == HOME_CONFIG and state.gripper == "open" and not state.holding

        self._reach(self._operators("", []), _when(home), f"'{HOME_CONFIG}' cannot be reached")

    def measure(
        self, name: str, parameters: Sequence[Parameter], effort: Effort | None = None
    ) -> None:
        """Measure `parameters` of one object or surface, with some `effort`, and leave the scene as
        it was found.

        Raises:
            PlanRejected: there is no way; the message says which parameter.
        """
        state, done = self.state, len(self.steps)
        try:
            if not self._as_before(name, parameters):
                self._search(name, parameters)
        except PlanRejected:
            self.state = state
            del self.steps[done:]
            raise
        if effort is not None:
            self.steps[done:], self.state = with_effort(
                state, self.steps[done:], self.state, name, effort
            )

    def measure_anew(self, name: str, parameters: Sequence[Parameter]) -> None:
        """As `measure`, as if nothing had been recorded yet, things being slid to the other side
        than last time; nothing where there is no way."""
        state = self.state
        self.mirrored = not self.mirrored
        self.state = replace(state, logged=(), converted=frozenset())
        with suppress(PlanRejected):
            self.measure(name, parameters)
        logged, converted = self.state.logged, self.state.converted
        self.state = replace(
            self.state,
            logged=(*state.logged, *logged),
            converted=state.converted | converted,
        )

    def _search(self, name: str, parameters: Sequence[Parameter]) -> None:
        if name in self.scene.objects and clear_of_support(
            self.state, name, self.state.pose_of(name)
        ):
            raise PlanRejected(
                f"'{name}' hangs in the air; say where it lies, in its pos or by --poses"
            )
        first = len(self.steps)
        away = self._clear(name, (name,)) if name in self.scene.bodies else []
        for parameter in parameters:
            while not measured(parameter, self.state):
                self._acquire(parameter)
            self._improve(parameter)
            self._enrich(parameter)
        operators = self._operators(name, next(self._domains(name)))
        self._reach(operators, _when(_at_rest(name)), f"'{name}' cannot be put back")
        if not away:
            self._found[self._kind(parameters)] = (name, self.steps[first:])
        for blocker, place in reversed(away):
            self._carry(blocker, place, _at_rest(blocker))

    def _acquire(self, parameter: Parameter) -> None:
        """One more piece of evidence, with as few places to go to as will do."""
        self._hindrance = ""
        for expressions in self._places(parameter):
            operators = self._operators(parameter.object, expressions)
            around = self._around(parameter.object, expressions)
            if self._reach(operators, _yielding(parameter, operators, self.words, around)):
                return
        why = self._mute(parameter) or self._hindrance
        raise PlanRejected(f"no sequence of primitives measures {parameter}{why}")

    def _improve(self, parameter: Parameter) -> None:
        """More evidence than it takes, where one step from here yields it."""
        for corner in self._corners(parameter.object):
            if amount(parameter, self.state) >= enough(parameter, self.state):
                return
            operators = self._operators(parameter.object, [corner])
            around = self._around(parameter.object, [corner])
            steps = _yielding(parameter, operators, self.words, around)(self.state)
            if steps and _first_refused(self.state, steps) is None:
                self.steps += steps
                for step in steps:
                    self.state = step.effect(self.state)

    def _enrich(self, parameter: Parameter) -> None:
        """What more there is to record of it, where there is room for that."""
        quantity = self.scene.catalogue[parameter.quantity]
        for evidence in quantity.evidence:
            if not evidence.optional or not self._exists(f"{parameter.object}_{evidence.place}"):
                continue
            with suppress(PlanRejected):
                self._acquire(parameter)

    def _mute(self, parameter: Parameter) -> str:
        """Which primitives would have to say with which arguments they are to be tried."""
        around = self._around(parameter.object, [])
        names: list[str] = []
        for cls in self.words.converters(parameter.quantity):
            for user in (cls, *self.words.sensors(cls.reads or "")):
                if not list(user.groundings(around)):
                    names.append(user.__name__)
        return f"; {' and '.join(names)} would need `groundings`" if names else ""

    def _as_before(self, name: str, parameters: Sequence[Parameter]) -> bool:
        """Whether what was found for another object also measures these quantities of this one;
        then it is done."""
        other, steps = self._found.get(self._kind(parameters), ("", []))
        if not steps:
            return False
        state, done = self.state, list[Step]()
        for step in steps:
            moved = tuple(primitive.transferred(other, name) for primitive in step.primitives)
            again = Step(moved, step.touches)
            after = again.applied(state)
            if after is None or again.harm(state) is not None:
                return False
            state = after
            done.append(again)
        complete = all(measured(parameter, state) for parameter in parameters)
        if not complete or not _at_rest(name)(state):
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
            if blocker in waiting or blocker in dict(away):
                raise PlanRejected(
                    f"'{blocker}' blocks '{name}' and cannot be carried out of its way"
                )
            away += self._clear(blocker, (*waiting, blocker))
            away.append((blocker, self._carry_away(blocker)))
        return away

    def _carry_away(self, name: str) -> str:
        """Carry an object to its temporary place; the name of that place."""
        place = f"{name}{TEMPORARY}"
        if not self._exists(place):
            raise PlanRejected(f"'{name}' is in the way, and there is no free place to put it")
        # The object moves and turns with the hand, from its grasp pose to the place.
        carried = self._resolve(place) @ self._resolve(f"{name}_pose").inverse()
        self._carry(name, place, _placed(name, carried @ self.state.pose_of(name)))
        return place

    def _carry(self, name: str, place: str, done: Goal) -> None:
        expressions: list[str] = []
        for spot in (f"{name}_pose", place):
            expressions += [f"{spot} + z_offset", spot]
        operators = self._operators(name, expressions)
        self._reach(operators, _when(done), f"'{name}' cannot be carried out of the way and back")

    def _above(self, name: str) -> tuple[str, str]:
        """Pose expressions above a thing and at it."""
        spot = f"{name}_pose" if name in self.scene.objects else f"{name}_approach"
        return f"{spot} + z_offset", spot

    def _places(self, parameter: Parameter) -> Iterator[list[str]]:
        """Pose expressions where the evidence that is missing has to be recorded, if it says so; else
        around the thing."""
        quantity, name = self.scene.catalogue[parameter.quantity], parameter.object
        if any(one.distinct == "place" and one.count > 1 for one in quantity.evidence):
            yield from self._spots(name)
            return
        if not any(evidence.place for evidence in quantity.evidence):
            yield from self._domains(name)
            return
        done = {kind for kind, _ in quantity.pieces(parameter, self.state.logged)}
        for kind, evidence in enumerate(quantity.evidence):
            spot = f"{name}_{evidence.place}"
            if kind not in done:
                yield [f"{spot} + z_offset", spot] if evidence.holding else [spot]

    def _spots(self, name: str) -> Iterator[list[str]]:
        """Three spots of a surface that are not in line, in four ways."""
        _, spot = self._above(name)
        first, other = SIDEWAYS
        for sign in "+-":
            for across in "+-":
                yield [spot, f"{spot} {sign} {SPOT}*{first}", f"{spot} {across} {SPOT}*{other}"]

    def _domains(self, name: str) -> Iterator[list[str]]:
        """Pose expressions around a thing, few first: above and at it, then shifted along its
        axes."""
        above, spot = self._above(name)
        if name not in self.scene.bodies:
            yield [self._above(other)[0] for other in self.scene.objects]
        elif name not in self.scene.objects:
            yield [spot, above]
        else:
            yield [above, spot]
            yield from self._slid(above, spot)
            yield from self._beside(above, spot)

    def _slid(self, above: str, spot: str) -> Iterator[list[str]]:
        """Places to which an object can be slid far enough to be felt; first along the direction in
        which the fingers close, across which it may tip in their grip."""
        for axis in SIDEWAYS:
            factor = self._times(axis, spot, SLIDE)
            yield [above, spot, *(f"{spot} {sign} {factor}*{axis}" for sign in "+-")]

    def _corners(self, name: str) -> Iterator[str]:
        """Places beside where an object stood, to which it can be slid on after it was slid: a third
        slide, along the other axis, closes a triangle."""
        _, spot = self._above(name)
        for axis, other in (SIDEWAYS, SIDEWAYS[::-1]):
            there, aside = self._times(axis, spot, SLIDE), self._times(other, spot, ASIDE)
            if self.state.at in [f"{spot} {sign} {there}*{axis}" for sign in "+-"]:
                yield from (f"{spot} {sign} {aside}*{other}" for sign in self._sides)

    def _kind(self, parameters: Iterable[Parameter]) -> Kind:
        return self.mirrored, frozenset(parameter.quantity for parameter in parameters)

    @property
    def _sides(self) -> str:
        return "-+" if self.mirrored else "+-"

    def _times(self, axis: str, spot: str, way: float) -> int:
        """How often an offset makes a way of so many m, at least."""
        length = float(np.linalg.norm(self.scene.symbols.offset(axis, spot)))
        return max(1, math.ceil(way / max(length, 1e-3)))

    def _beside(self, above: str, spot: str) -> Iterator[list[str]]:
        """Other places at which an object can be grasped and lifted."""
        for axis in ("x_offset", "y_offset"):
            expressions = [above, spot]
            for sign in "+-":
                shifted = f"{spot} {sign} {axis}"
                expressions += [f"{shifted} + z_offset", shifted]
            yield expressions

    def _around(self, subject: str, expressions: Iterable[str]) -> Surroundings:
        """The surroundings of a thing, and of where an object is held or something is touched."""
        grasp = self.state.grasp
        here = [grasp, f"{grasp} + z_offset"] if grasp else []
        if self.state.contact and self.state.at:
            here.append(self.state.at)
        poses = [name for name in dict.fromkeys([*expressions, *here]) if self._exists(name)]
        return Surroundings(self.state, subject, tuple(poses))

    def _operators(self, subject: str, expressions: Iterable[str]) -> list[Primitive]:
        """What can move, with arguments that matter here."""
        around = self._around(subject, expressions)
        found: list[Primitive] = []
        for cls in self.words.primitives.values():
            if cls.claims:
                found += cls.groundings(around)
        return found

    def _exists(self, expression: str) -> bool:
        try:
            self._resolve(expression)
        except InputError:
            return False
        return True

    def _resolve(self, expression: str) -> Pose:
        return self.scene.symbols.resolve(expression)

    def _reach(self, operators: Sequence[Primitive], tail: Tail, failure: str = "") -> bool:
        """Append the fewest steps after which `tail` has nothing left but what it returns.

        Raises:
            PlanRejected: there are none, and `failure` says what that means.
        """
        refused: set[Refusal] = set()
        hindrance = ""
        for _ in range(MAX_DETOURS):
            found = _shortest(self.state, operators, tail, refused)
            if found is None:
                break
            steps, after = found
            refusal = _first_refused(self.state, steps)
            if refusal is None:
                self.steps += steps
                self.state = after
                return True
            refused.add(refusal[0])
            self._hindrance = hindrance = f": {refusal[1]}"
        if failure:
            raise PlanRejected(failure + (hindrance or _obstacle(self.state, operators)))
        return False


def _obstacle(state: SymbolicState, operators: Sequence[Primitive]) -> str:
    """What of the things themselves speaks against an action on the way, where none leads on: that one
    would tip, fall or turn in the grip; not the order of actions."""
    queue, seen = deque([state]), {_key(state)}
    while queue and len(seen) < FEW_STATES:
        here = queue.popleft()
        for operator in operators:
            taking = "gripper" in operator.claims
            for violation in operator.requires(here) if taking else ():
                if violation.rule not in (PRECONDITION, "gripper-state", "unknown-start"):
                    return f": {violation}"
            after = Step((operator,)).applied(here)
            if after is not None and _key(after) not in seen:
                seen.add(_key(after))
                queue.append(after)
    return ""


def _first_refused(state: SymbolicState, steps: Iterable[Step]) -> tuple[Refusal, str] | None:
    """The first of some steps that the exact judgement does not let pass, and why; it is too slow
    to be asked at every step of a search."""
    for step in steps:
        harm = step.harm(state)
        if harm is not None:
            return (_key(state), step.label), str(harm)
        state = step.effect(state)
    return None


def _is_refused(state: SymbolicState, steps: Iterable[Step], refused: set[Refusal]) -> bool:
    for step in steps if refused else ():
        if (_key(state), step.label) in refused:
            return True
        state = step.effect(state)
    return False


def _shortest(
    start: SymbolicState, operators: Sequence[Primitive], tail: Tail, refused: set[Refusal]
) -> tuple[list[Step], SymbolicState] | None:
    """Breadth-first search; ties go to the order of `operators`."""
    queue: deque[tuple[SymbolicState, tuple[Step, ...]]] = deque([(start, ())])
    seen = {_key(start)}
    while queue and len(seen) < MAX_STATES:
        state, steps = queue.popleft()
        rest = tail(state)
        if rest is not None and not _is_refused(state, rest, refused):
            for step in rest:
                state = step.effect(state)
            return [*steps, *rest], state
        for operator in operators:
            after = Step((operator,)).applied(state)
            if after is None or (_key(state), operator.label) in refused:
                continue
            key = _key(after)
            if key not in seen:
                seen.add(key)
                step = Step((operator,), touches=after.contact is not None)
                queue.append((after, (*steps, step)))
    return None


def _key(state: SymbolicState) -> tuple[object, ...]:
    """What tells two states apart: poses to a tenth of a millimetre."""
    moved: list[object] = []
    for name, pose in sorted(state.moved.items()):
        moved.append((name, *np.round(pose.position, 4).tolist()))
    hand = (state.at, state.gripper, state.holding, state.grasp, state.lifted, state.contact)
    return *hand, *moved


def _yielding(
    parameter: Parameter,
    operators: Sequence[Primitive],
    words: Vocabulary,
    around: Surroundings,
) -> Tail:
    """The steps that sense and convert a parameter, alone or beside one of the motions."""
    chains = list(_chains(parameter.quantity, words, around))
    motions = [operator for operator in operators if "arm" in operator.claims]

    def tail(state: SymbolicState) -> list[Step] | None:
        for first, *others in chains:
            following = [Step((primitive,)) for primitive in others]
            steps = [Step((first,)), *following]
            if _yields(parameter, steps, state):
                return steps
            for operator in motions:
                steps = [Step((operator, first)), *following]
                if not state.contact and _yields(parameter, steps, state):
                    return steps
        return None

    return tail


def _chains(
    quantity: str, words: Vocabulary, around: Surroundings
) -> Iterator[tuple[Primitive, ...]]:
    """Sensing and conversion that end in `quantity`."""
    known = around.state.scene.catalogue[quantity]
    if known.derived:
        for buffer in dict.fromkeys(evidence.buffer for evidence in known.evidence):
            for sensing in _grounded(words.sensors(buffer), around):
                yield (sensing,)
    for conversion in _grounded(words.converters(quantity), around):
        if conversion.reads is None:
            yield (conversion,)
            continue
        for sensing in _grounded(words.sensors(conversion.reads), around):
            yield sensing, conversion


def _grounded(classes: Iterable[type[Primitive]], around: Surroundings) -> Iterator[Primitive]:
    for cls in classes:
        yield from cls.groundings(around)


def _yields(parameter: Parameter, steps: Iterable[Step], state: SymbolicState) -> bool:
    before = amount(parameter, state)
    for step in steps:
        if not _may_concern(parameter, step, state):
            return False
        after = step.applied(state)
        if after is None:
            return False
        state = after
    return amount(parameter, state) > before


def _may_concern(parameter: Parameter, step: Step, state: SymbolicState) -> bool:
    """Whether what a step records may be evidence for a derived parameter: a quick look before the
    step is tried."""
    catalogue = state.scene.catalogue
    if not catalogue[parameter.quantity].derived:
        return True
    context = during(step.moving, state).context()
    for primitive in step.primitives:
        if primitive.writes and catalogue.piece(parameter, primitive.writes, context):
            return True
    return False


def _at_rest(name: str) -> Goal:
    """The hand empty, open and clear, and `name` where the scene has it."""

    def reached(state: SymbolicState) -> bool:
        return is_clear(state) and not is_away(state, name)

    return reached


def _placed(name: str, pose_world_object: Pose) -> Goal:
    """The hand empty, open and clear, and `name` at that pose."""

    def reached(state: SymbolicState) -> bool:
        distance = state.pose_of(name).distance_to(pose_world_object)
        return is_clear(state) and distance < RESTORED_POSITION

    return reached


def _when(done: Goal) -> Tail:
    """Nothing is left to do once `done` holds."""

    def tail(state: SymbolicState) -> list[Step] | None:
        return [] if done(state) else None

    return tail
