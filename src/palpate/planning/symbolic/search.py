"""Trees from the primitives' own preconditions and effects.

A parameter is chained backwards from its conversion, to the buffer that it reads, to the sensing
that fills it; a search over the grounded motion and gripper primitives then finds the shortest way
to a state in which that chain holds. Parameters are reached one after another, so the cost grows
with their number and not with their combinations; what was found for one object is tried first for
the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from palpate.errors import PlanRejected
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.check.measured import amount, enough, measured
from palpate.planning.plan import Node
from palpate.planning.symbolic.goals import Goal, Tail, at_rest, placed, when
from palpate.planning.symbolic.passes import with_effort
from palpate.planning.symbolic.places import (
    NEARER,
    SIDEWAYS,
    approach,
    balanced,
    corners,
    domains,
    exists,
    places,
)
from palpate.planning.symbolic.recording import yielding
from palpate.planning.symbolic.shortest import (
    Refusal,
    first_refused,
    obstacle,
    reason,
    shortest,
)
from palpate.planning.symbolic.steps import TEMPORARY, Step, nodes
from palpate.quantities.quantity import Effort
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import blockers
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.base import Primitive, Surroundings
from palpate.vocabulary.registry import Vocabulary, vocabulary
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState

MAX_DETOURS = 20
"""Ways that one search finds and sees refused before it gives up."""

Kind = tuple[bool, frozenset[str]]
"""Key of a solved task: slides to the other side first, and the measured quantities."""


@dataclass(eq=False)
class Backchainer:
    """Builds one plan, thing by thing, over one symbolic state.

    Attributes:
        scene: where it is to run.
        words: the vocabulary that it may use.
        mirrored: things are slid aside to the other side first. What is dragged lags behind, and is
            left a little to where it came from: in turn, that evens out.
        finds_out: an object that is weighed, too, is grasped last where it turns out to balance.
        extras: what is worth having besides is recorded, too.
        spared: what of that there is no room for, in words.
        state, steps: the plan so far, and what is believed after it.
    """

    scene: Scene
    words: Vocabulary = field(default_factory=vocabulary)
    mirrored: bool = False
    finds_out: bool = True
    extras: bool = True
    spared: list[str] = field(default_factory=list[str], init=False)
    state: SymbolicState = field(init=False)
    steps: list[Step] = field(default_factory=list[Step], init=False)
    _found: dict[Kind, tuple[str, list[Step]]] = field(
        default_factory=dict[Kind, tuple[str, list[Step]]], init=False
    )
    """The object for which the like was measured first, and how."""
    _began: tuple[int, SymbolicState] = field(init=False)
    """The steps before the last way that was searched, and the state then."""
    _hindrance: str = field(default="", init=False)
    """Reason against the last path that was found."""

    def __post_init__(self) -> None:
        self.state = SymbolicState(self.scene)
        self._began = 0, self.state

    @classmethod
    def at_home(cls, scene: Scene, words: Vocabulary) -> Backchainer:
        """Search that starts at home."""
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

        self._reach(self._operators("", []), when(home), f"'{HOME_CONFIG}' cannot be reached")

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
        """Measure again as `measure`, independent of earlier recordings, with slides to the other
        side than last time; nothing where there is no path."""
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
        """Clear the way to a thing, measure it, put it back, and put back what was in the way."""
        self._require_support(name)
        first = len(self.steps)
        away = self._clear(name, (name,)) if name in self.scene.bodies else []
        extras, added = self._extras(name, parameters), False
        for parameter in parameters:
            while not measured(parameter, self.state):
                if not (self._weighs(parameters) and self._balances(parameter)):
                    self._acquire(parameter)
                if not added and self._hangs_level(name):
                    added = self._add_extra(parameters, extras)
            self._improve(parameter)
            self._enrich(parameter)
        if extras and not (added or self._add_extra(parameters, extras)):
            kinds = " and ".join(dict.fromkeys(type(extra).__name__ for extra in extras))
            self.spared.append(f"There is no room for {kinds} with '{name}'.")
        operators = self._operators(name, next(domains(self.scene, name)))
        self._reach(operators, when(at_rest(name)), f"'{name}' cannot be put back")
        if not away:
            self._found[self._kind(parameters)] = (name, self.steps[first:])
        for blocker, place in reversed(away):
            self._carry(blocker, place, at_rest(blocker))

    def _require_support(self, name: str) -> None:
        if name not in self.scene.objects:
            return
        if clear_of_support(self.state, name, self.state.pose_of(name)):
            raise PlanRejected(
                f"'{name}' hangs in the air; say where it lies, in its pos or by --poses"
            )

    def _acquire(self, parameter: Parameter) -> None:
        """Acquire one more piece of evidence, with as few places as possible."""
        self._hindrance = ""
        tried: list[Sequence[str]] = []
        for expressions in places(self.scene, parameter, self.state):
            if self._recorded(parameter, expressions):
                return
            tried.append(expressions)
        mute = self._mute(parameter)
        if not mute:
            operators = (self._operators(parameter.object, expressions) for expressions in tried)
            reasons = (obstacle(self.state, each) for each in operators)
            if found := self._hindrance or next(filter(None, reasons), ""):
                raise PlanRejected(found)
        raise PlanRejected(f"no sequence of primitives measures {parameter}{mute}")

    def _recorded(self, parameter: Parameter, expressions: Sequence[str]) -> bool:
        """Acquire one more piece of evidence at some of these places, if there is a path."""
        operators = self._operators(parameter.object, expressions)
        around = self._around(parameter.object, expressions)
        return self._reach(operators, yielding(parameter, operators, self.words, around))

    def _weighs(self, parameters: Iterable[Parameter]) -> bool:
        """True if a weight is to be felt where its torque is least, and nothing beside it."""
        return self.finds_out and {"mass", "com"} == {wanted.quantity for wanted in parameters}

    def _balances(self, parameter: Parameter) -> bool:
        """The last piece of evidence where an object balances, where that can be had."""
        return any(
            self._recorded(parameter, expressions)
            for expressions in balanced(self.scene, parameter, self.state)
        )

    def _improve(self, parameter: Parameter) -> None:
        """More evidence than it takes, where one step from here yields it."""
        for axis in SIDEWAYS:
            for corner in corners(self.scene, parameter.object, axis, self.state, self._sides):
                if amount(parameter, self.state) >= enough(parameter, self.state):
                    return
                self._record_at(corner, parameter)

    def _record_at(self, place: str, parameter: Parameter) -> None:
        """Record evidence on the way to a place, where that can be done."""
        operators = self._operators(parameter.object, [place])
        around = self._around(parameter.object, [place])
        self._take(yielding(parameter, operators, self.words, around)(self.state) or ())

    def _take(self, steps: Sequence[Step]) -> bool:
        """Append some steps, where there are any and nothing speaks against them."""
        if not steps or first_refused(self.state, steps) is not None:
            return False
        self.steps += steps
        for step in steps:
            self.state = step.effect(self.state)
        return True

    def _add_extra(self, parameters: Iterable[Parameter], extras: Iterable[Primitive]) -> bool:
        """True if one of some operators, done here with what is held, yields something that is
        worth having besides; it is done with the empty hand, too, where that came here: the joints'
        friction is then left alike on the way down and up, with the object and without."""
        for operator, steps in self._yielding(self.state, parameters, extras):
            if self._take(steps):
                self._add_before(parameters, operator)
                return True
        return False

    def _add_before(self, parameters: Iterable[Parameter], operator: Primitive) -> None:
        count, before = self._began
        came: list[tuple[int, SymbolicState]] = []
        for i, step in enumerate(self.steps[count:], start=count + 1):
            before = step.effect(before)
            if before.at == self.state.at and not before.holding:
                came.append((i, before))
        for i, there in came[-1:]:
            for _, steps in self._yielding(there, parameters, [operator]):
                if first_refused(there, steps) is None:
                    self.steps[i:i] = steps
                    logged = steps[-1].effect(there).logged[len(there.logged) :]
                    self.state = replace(self.state, logged=(*self.state.logged, *logged))

    def _yielding(
        self, state: SymbolicState, parameters: Iterable[Parameter], operators: Iterable[Primitive]
    ) -> Iterator[tuple[Primitive, Sequence[Step]]]:
        """Each operator that, done in a state, yields something of a parameter, with its steps."""
        for parameter in parameters:
            around = self._around(parameter.object, [])
            for operator in operators:
                steps = yielding(parameter, [operator], self.words, around)(state)
                if steps:
                    yield operator, steps

    def _extras(self, name: str, parameters: Iterable[Parameter]) -> Sequence[Primitive]:
        """Primitives that yield only optional evidence of some of the parameters."""
        if not (self.extras and any(self._would_tell_more(one) for one in parameters)):
            return []
        return self._grounded(self._around(name, []), extra=True)

    def _hangs_level(self, name: str) -> bool:
        """True if an object is held, as it is believed, where it balances: the less it turns in the
        fingers, the longer it is held."""
        held = self.state.pose_tcp_object
        if self.state.holding != name or held is None:
            return False
        return abs(held.apply(solids(self.scene).centre_of_mass(name))[0]) < NEARER

    def _would_tell_more(self, parameter: Parameter) -> bool:
        """True if there is evidence of it that is worth having wherever it can be had."""
        evidence = self.scene.catalogue[parameter.quantity].evidence
        return any(one.optional and not one.place for one in evidence)

    def _enrich(self, parameter: Parameter) -> None:
        """Record optional evidence of it, where there is room."""
        quantity = self.scene.catalogue[parameter.quantity]
        for evidence in quantity.evidence:
            place = f"{parameter.object}_{evidence.place}"
            if evidence.optional and exists(self.scene, place):
                with suppress(PlanRejected):
                    self._acquire(parameter)

    def _mute(self, parameter: Parameter) -> str:
        """Names of primitives without `groundings`."""
        around = self._around(parameter.object, [])
        names: list[str] = []
        for cls in self.words.converters(parameter.quantity):
            for user in (cls, *self.words.sensors(cls.reads or "")):
                if not list(user.groundings(around)):
                    names.append(user.__name__)
        return f"; {' and '.join(names)} would need `groundings`" if names else ""

    def _as_before(self, name: str, parameters: Sequence[Parameter]) -> bool:
        """True if what was found for another object also measures these quantities of this one;
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
        if not complete or not at_rest(name)(state):
            return False
        self.state = state
        self.steps += done
        return True

    def _clear(self, name: str, waiting: tuple[str, ...]) -> list[tuple[str, str]]:
        """Carry away what blocks `name`, and first what blocks that; what was moved, with where
        to."""
        away: list[tuple[str, str]] = []
        before, work = approach(self.scene, name)
        while found := blockers(self.state, name, self._resolve(before), self._resolve(work)):
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
        if not exists(self.scene, place):
            raise PlanRejected(f"'{name}' is in the way, and there is no free place to put it")
        # The object moves and turns with the hand, from its grasp pose to the place.
        carried = self._resolve(place) @ self._resolve(f"{name}_pose").inverse()
        self._carry(name, place, placed(name, carried @ self.state.pose_of(name)))
        return place

    def _carry(self, name: str, place: str, done: Goal) -> None:
        expressions: list[str] = []
        for spot in (f"{name}_pose", place):
            expressions += [f"{spot} + z_offset", spot]
        operators = self._operators(name, expressions)
        self._reach(operators, when(done), f"'{name}' cannot be carried out of the way and back")

    def _kind(self, parameters: Iterable[Parameter]) -> Kind:
        return self.mirrored, frozenset(parameter.quantity for parameter in parameters)

    @property
    def _sides(self) -> str:
        return "-+" if self.mirrored else "+-"

    def _around(self, subject: str, expressions: Iterable[str]) -> Surroundings:
        """The surroundings of a thing, and of where an object is held or something is touched."""
        grasp = self.state.grasp
        here = [grasp, f"{grasp} + z_offset"] if grasp else []
        if self.state.contact and self.state.at:
            here.append(self.state.at)
        poses = [name for name in dict.fromkeys([*expressions, *here]) if exists(self.scene, name)]
        return Surroundings(self.state, subject, tuple(poses))

    def _operators(self, subject: str, expressions: Iterable[str]) -> list[Primitive]:
        """Grounded motion and gripper primitives."""
        return self._grounded(self._around(subject, expressions), extra=False)

    def _grounded(self, around: Surroundings, extra: bool) -> list[Primitive]:
        found: list[Primitive] = []
        for cls in self.words.primitives.values():
            if cls.claims and cls.extra == extra:
                found += cls.groundings(around)
        return found

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
            found = shortest(self.state, operators, tail, refused)
            if found is None:
                break
            steps, after = found
            refusal = first_refused(self.state, steps)
            if refusal is None:
                self._began = len(self.steps), self.state
                self.steps += steps
                self.state = after
                return True
            refused.add(refusal[0])
            self._hindrance = hindrance = reason(refusal[1])
        if failure:
            why = hindrance or obstacle(self.state, operators)
            raise PlanRejected(f"{failure}: {why}" if why else failure)
        return False
