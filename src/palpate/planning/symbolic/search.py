"""Trees from the primitives' own preconditions and effects.

A parameter is chained backwards from its conversion, to the buffer that it reads, to the sensing
that fills it; a search over the grounded motion and gripper primitives then finds the shortest path
to a state in which that chain holds. Parameters are reached one after another, so the cost grows
with their number and not with their combinations; the steps found for one object are tried first for
the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.quantity import Effort
from palpate.planning.check.walk import evidence_amount, has_measurement, useful_evidence
from palpate.planning.plan import Node
from palpate.planning.symbolic.efforts import with_effort, yielding
from palpate.planning.symbolic.shortest import (
    Goal,
    Refusal,
    Tail,
    at_rest,
    find_first_refusal,
    obstacle,
    placement_goal,
    reason,
    shortest,
    when,
)
from palpate.planning.symbolic.steps import (
    NEARER,
    SIDEWAYS,
    Step,
    approach,
    balance_expressions,
    corners,
    domains,
    exists,
    nodes,
    places,
    stands_on_seam,
)
from palpate.primitives.base import Primitive, Surroundings
from palpate.primitives.registry import Vocabulary, vocabulary
from palpate.primitives.rules.clearance import blockers
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.support import clear_of_support
from palpate.primitives.state import HOME_CONFIG, SymbolicState
from palpate.scene.load import TEMPORARY
from palpate.scene.scene import Scene

MAX_DETOURS = 20
"""Paths that one search finds and sees refused before it gives up."""

LIFTS = ("", " + z_offset", " + 1.5*z_offset", " + 2.5*z_offset")
"""Offsets at which a tool is taken, and to which it is lifted before it is carried."""

Task = tuple[bool, frozenset[str]]
"""Key of a solved task: slides to the other side first, and the measured quantities."""


@dataclass(eq=False)
class Backchainer:
    """Builds one plan, object by object, over one symbolic state.

    Attributes:
        scene: the scene that the plan runs in.
        words: the vocabulary that it may use.
        mirrored: slides go to the other side first. A dragged object lags behind, and is left a little
            off towards where it came from: alternate sides even that out.
        balances: an object that is also weighed is grasped last where the run finds it to balance.
        extras: optional evidence is recorded, too.
        omitted: optional recordings without room, in words.
        state, steps: the plan so far, and the state after it.
    """

    scene: Scene
    words: Vocabulary = field(default_factory=vocabulary)
    mirrored: bool = False
    balances: bool = True
    extras: bool = True
    omitted: list[str] = field(default_factory=list[str], init=False)
    state: SymbolicState = field(init=False)
    steps: list[Step] = field(default_factory=list[Step], init=False)
    _solved: dict[Task, tuple[str, list[Step]]] = field(
        default_factory=dict[Task, tuple[str, list[Step]]], init=False
    )
    """First object of each task, and its steps."""
    _began: tuple[int, SymbolicState] = field(init=False)
    """Number of steps before the last path that was searched, and the state then."""
    _refusal: str = field(default="", init=False)
    """Reason against the last path that was found."""

    def __post_init__(self) -> None:
        self.state = SymbolicState(self.scene)
        self._began = 0, self.state

    def tree(self) -> Node:
        """The steps so far, as one Sequence."""
        return Node("Sequence", children=tuple(nodes(self.steps)))

    def go_home(self) -> None:
        """Move to the home configuration, the hand open and empty."""

        def home(state: SymbolicState) -> bool:
            return state.at == HOME_CONFIG and state.gripper == "open" and not state.holding

        self._reach(self._operators("", []), when(home), f"'{HOME_CONFIG}' cannot be reached")

    def measure(
        self, name: str, parameters: Sequence[Parameter], effort: Effort | None = None
    ) -> None:
        """Measure `parameters` of one object or surface, with some `effort`, and leave the scene as
        it was found.

        Raises:
            PlanRejected: there is no path; the message says which parameter.
        """
        state, done = self.state, len(self.steps)
        try:
            if not self._transfer(name, parameters):
                self._search(name, parameters)
        except PlanRejected:
            self.state = state
            del self.steps[done:]
            raise
        if effort is not None:
            self.steps[done:], self.state = with_effort(
                state, self.steps[done:], self.state, name, effort
            )

    def hold(self, tool: str, spots: Sequence[str]) -> None:
        """Take a tool, hold it at each of some places, and put it back.

        Raises:
            PlanRejected: there is no path.
        """
        away = self._clear(tool, (tool,))
        taken = [f"{tool}_pose{above}" for above in LIFTS]
        for spot in spots:
            operators = self._operators(tool, [*taken, spot])
            held = when(lambda state, at=spot: state.holding == tool and state.at == at)
            self._reach(operators, held, f"'{tool}' cannot be held at '{spot}'")
        operators = self._operators(tool, taken)
        self._reach(operators, when(at_rest(tool)), f"'{tool}' cannot be put back")
        for blocker, place in reversed(away):
            self._carry(blocker, place, at_rest(blocker))

    def repeat(self, name: str, parameters: Sequence[Parameter]) -> None:
        """Measure again as `measure`, independent of earlier recordings, with slides to the other
        side than last time; nothing where there is no path."""
        state = self.state
        self.mirrored = not self.mirrored
        # Without its recordings, the parameter counts as unmeasured.
        self.state = replace(state, logged=(), converted=frozenset())
        with suppress(PlanRejected):
            self.measure(name, parameters)
        self.state = replace(
            self.state,
            logged=(*state.logged, *self.state.logged),
            converted=state.converted | self.state.converted,
        )

    def _search(self, name: str, parameters: Sequence[Parameter]) -> None:
        """Clear the way to an object, measure it, put it back, and put back what was in the way."""
        floating = name in self.scene.objects and clear_of_support(
            self.state, name, self.state.pose_of(name)
        )
        if floating:
            raise PlanRejected(
                f"'{name}' hangs in the air; say where it lies, in its pos or by --poses"
            )
        first = len(self.steps)
        away = self._clear(name, (name,)) if name in self.scene.bodies else []
        extras, added = self._extras(name, parameters), False
        # Mass and com alone: the last grasp is at the balance point, where the weight's torque on the
        # fingers is least.
        weighed = {"mass", "com"} == {wanted.quantity for wanted in parameters}
        for parameter in parameters:
            while not has_measurement(parameter, self.state):
                if not (self.balances and weighed and self._record_at_balance(parameter)):
                    self._acquire(parameter)
                if not added and self._hangs_level(name):
                    added = self._add_extra(parameters, extras)
            self._improve(parameter)
            self._enrich(parameter)
        if extras and not (added or self._add_extra(parameters, extras)):
            kinds = " and ".join(dict.fromkeys(type(extra).__name__ for extra in extras))
            self.omitted.append(f"There is no room for {kinds} with '{name}'.")
        operators = self._operators(name, next(domains(self.scene, name)))
        self._reach(operators, when(at_rest(name)), f"'{name}' cannot be put back")
        if not away:
            self._solved[self._task(parameters)] = (name, self.steps[first:])
        for blocker, place in reversed(away):
            self._carry(blocker, place, at_rest(blocker))

    def _transfer(self, name: str, parameters: Sequence[Parameter]) -> bool:
        """Repeat the steps of the same task for this object; False where they do not work for it."""
        other, steps = self._solved.get(self._task(parameters), ("", []))
        if not steps:
            return False
        state, done = self.state, list[Step]()
        for step in steps:
            moved = tuple(primitive.transferred(other, name) for primitive in step.primitives)
            again = Step(moved, step.touches)
            # The exact judgement too: other objects stand around this one.
            after = again.applied(state)
            if after is None or again.harm(state) is not None:
                return False
            state = after
            done.append(again)
        complete = all(has_measurement(parameter, state) for parameter in parameters)
        if not complete or not at_rest(name)(state):
            return False
        self.state = state
        self.steps += done
        return True

    def _task(self, parameters: Iterable[Parameter]) -> Task:
        return self.mirrored, frozenset(parameter.quantity for parameter in parameters)

    def _acquire(self, parameter: Parameter) -> None:
        """Acquire one more piece of evidence, with as few places as possible."""
        self._refusal = ""
        tried: list[Sequence[str]] = []
        for expressions in places(self.scene, parameter, self.state):
            if self._record(parameter, expressions):
                return
            tried.append(expressions)
        # A third party's primitive whose arguments no `groundings` name is never tried.
        around = self._surroundings(parameter.object, [])
        mute: list[str] = []
        for cls in self.words.converters(parameter.quantity):
            for user in (cls, *self.words.sensors(cls.reads or "")):
                if not list(user.groundings(around)):
                    mute.append(user.__name__)
        if mute:
            raise PlanRejected(
                f"no sequence of primitives measures {parameter}; {' and '.join(mute)} would need "
                "`groundings`"
            )
        kinds = self.scene.catalogue[parameter.quantity].evidence
        slides = any("sliding" in kind.activity for kind in kinds)
        if slides and stands_on_seam(self.scene, parameter.object):
            raise PlanRejected(
                "it stands on several surfaces, and there is no free place to slide it on one of them"
            )
        operators = (self._operators(parameter.object, expressions) for expressions in tried)
        reasons = (obstacle(self.state, each) for each in operators)
        raise PlanRejected(
            self._refusal
            or next(filter(None, reasons), f"no sequence of primitives measures {parameter}")
        )

    def _record(self, parameter: Parameter, expressions: Sequence[str]) -> bool:
        """Acquire one more piece of evidence at some of these places, if there is a path."""
        operators = self._operators(parameter.object, expressions)
        around = self._surroundings(parameter.object, expressions)
        return self._reach(operators, yielding(parameter, operators, self.words, around))

    def _record_at_balance(self, parameter: Parameter) -> bool:
        """Acquire the last piece of evidence where an object balances, if there is a path."""
        spots = balance_expressions(self.scene, parameter, self.state)
        return any(self._record(parameter, expressions) for expressions in spots)

    def _improve(self, parameter: Parameter) -> None:
        """Record more evidence than needed, where one step from here yields it."""
        sides = "-+" if self.mirrored else "+-"
        for axis in SIDEWAYS:
            for corner in corners(self.scene, parameter.object, axis, self.state, sides):
                if evidence_amount(parameter, self.state) >= useful_evidence(parameter, self.state):
                    return
                operators = self._operators(parameter.object, [corner])
                around = self._surroundings(parameter.object, [corner])
                tail = yielding(parameter, operators, self.words, around)
                self._take(tail(self.state) or ())

    def _enrich(self, parameter: Parameter) -> None:
        """Record optional evidence at a place of its own, where there is room."""
        for evidence in self.scene.catalogue[parameter.quantity].evidence:
            place = f"{parameter.object}_{evidence.place}"
            if evidence.optional and exists(self.scene, place):
                with suppress(PlanRejected):
                    self._acquire(parameter)

    def _take(self, steps: Sequence[Step]) -> bool:
        """Append some steps, where there are any and the exact judgement passes them."""
        if not steps or find_first_refusal(self.state, steps) is not None:
            return False
        self.steps += steps
        for step in steps:
            self.state = step.effect(self.state)
        return True

    def _extras(self, name: str, parameters: Iterable[Parameter]) -> Sequence[Primitive]:
        """Primitives that yield only optional evidence of some of the parameters."""
        evidence = (
            one
            for parameter in parameters
            for one in self.scene.catalogue[parameter.quantity].evidence
        )
        # Evidence with a place of its own is recorded there (`_enrich`).
        if not (self.extras and any(one.optional and not one.place for one in evidence)):
            return []
        return self._ground_primitives(self._surroundings(name, []), extra=True)

    def _hangs_level(self, name: str) -> bool:
        """True if an object is held at its believed balance point: the less it turns in the fingers,
        the longer it is held."""
        held = self.state.pose_tcp_object
        if self.state.holding != name or held is None:
            return False
        return abs(held.apply(solids(self.scene).centre_of_mass(name))[0]) < NEARER

    def _add_extra(self, parameters: Iterable[Parameter], extras: Iterable[Primitive]) -> bool:
        """Record optional evidence here with the held object, and with the empty hand before; False
        where none can be recorded."""
        for operator, steps in self._yielding(self.state, parameters, extras):
            if self._take(steps):
                self._add_before(parameters, operator)
                return True
        return False

    def _add_before(self, parameters: Iterable[Parameter], operator: Primitive) -> None:
        """Insert the same recording with the empty hand, where the last path passed this pose: the
        joints' friction is then the same with the object and without."""
        count, before = self._began
        passed: tuple[int, SymbolicState] | None = None
        for i, step in enumerate(self.steps[count:], start=count + 1):
            before = step.effect(before)
            if before.at == self.state.at and not before.holding:
                passed = i, before
        if passed is None:
            return
        i, there = passed
        for _, steps in self._yielding(there, parameters, [operator]):
            if find_first_refusal(there, steps) is None:
                self.steps[i:i] = steps
                logged = steps[-1].effect(there).logged[len(there.logged) :]
                self.state = replace(self.state, logged=(*self.state.logged, *logged))

    def _yielding(
        self, state: SymbolicState, parameters: Iterable[Parameter], operators: Iterable[Primitive]
    ) -> Iterator[tuple[Primitive, Sequence[Step]]]:
        """Operators that record evidence of a parameter in a state, with their steps."""
        for parameter in parameters:
            around = self._surroundings(parameter.object, [])
            for operator in operators:
                steps = yielding(parameter, [operator], self.words, around)(state)
                if steps:
                    yield operator, steps

    def _clear(self, name: str, waiting: tuple[str, ...]) -> list[tuple[str, str]]:
        """Carry away the objects that block `name`, each after its own blockers; return their names,
        with the temporary places."""
        away: list[tuple[str, str]] = []
        resolve = self.scene.symbols.resolve
        above, spot = (resolve(expression) for expression in approach(self.scene, name))
        while found := blockers(self.state, name, above, spot):
            blocker = found[0]
            if blocker in waiting or blocker in dict(away):
                raise PlanRejected(
                    f"'{blocker}' blocks '{name}' and cannot be carried out of its way"
                )
            away += self._clear(blocker, (*waiting, blocker))
            place = f"{blocker}{TEMPORARY}"
            if not exists(self.scene, place):
                raise PlanRejected(
                    f"'{blocker}' is in the way, and there is no free place to put it"
                )
            # The object moves and turns with the hand, from its grasp pose to the place.
            carried = resolve(place) @ resolve(f"{blocker}_pose").inverse()
            self._carry(
                blocker, place, placement_goal(blocker, carried @ self.state.pose_of(blocker))
            )
            away.append((blocker, place))
        return away

    def _carry(self, name: str, place: str, done: Goal) -> None:
        """Carry an object between its own pose and a place, until `done`."""
        spots = (f"{name}_pose", place)
        operators = self._operators(name, [e for at in spots for e in (f"{at} + z_offset", at)])
        self._reach(operators, when(done), f"'{name}' cannot be carried out of the way and back")

    def _surroundings(self, subject: str, expressions: Iterable[str]) -> Surroundings:
        """Surroundings of an object, with the poses where one is held or a surface is touched."""
        grasp = self.state.grasp
        here = [grasp, f"{grasp} + z_offset"] if grasp else []
        if self.state.contact and self.state.at:
            here.append(self.state.at)
        if grasp and self.state.at and TEMPORARY in self.state.at:
            here.append(f"{self.state.at} + z_offset")  # lifts it where it was slid
        poses = [name for name in dict.fromkeys([*expressions, *here]) if exists(self.scene, name)]
        return Surroundings(self.state, subject, tuple(poses))

    def _operators(self, subject: str, expressions: Iterable[str]) -> list[Primitive]:
        """Grounded motion and gripper primitives."""
        return self._ground_primitives(self._surroundings(subject, expressions), extra=False)

    def _ground_primitives(self, around: Surroundings, extra: bool) -> list[Primitive]:
        found: list[Primitive] = []
        for cls in self.words.primitives.values():
            if cls.claims and cls.extra == extra:
                found += cls.groundings(around)
        return found

    def _reach(self, operators: Sequence[Primitive], tail: Tail, failure: str = "") -> bool:
        """Append the fewest steps after which `tail` is reached, and its own; False if there are none.

        Raises:
            PlanRejected: there are none, and `failure` says what that means.
        """
        refused: set[Refusal] = set()
        refusal = ""
        for _ in range(MAX_DETOURS):
            found = shortest(self.state, operators, tail, refused)
            if found is None:
                break
            steps, after = found
            harm = find_first_refusal(self.state, steps)
            if harm is None:
                self._began = len(self.steps), self.state
                self.steps += steps
                self.state = after
                return True
            refused.add(harm[0])  # the next search avoids this step in this state
            self._refusal = refusal = reason(harm[1])
        if failure:
            why = refusal or obstacle(self.state, operators)
            raise PlanRejected(f"{failure}: {why}" if why else failure)
        return False
