"""Backward chaining of behavior trees from the primitives' preconditions and effects.

A parameter is chained backwards: from its conversion, to the buffer that it reads, to the sensing
that fills the buffer. A search over grounded motion and gripper primitives finds the shortest path
to a state where that chain holds.

Parameters are reached one after another. The cost grows with their number, not with their
combinations. The steps for one object are tried first for the next one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.quantity import Effort
from palpate.planning.check.walk import evidence_amount, has_measurement, useful_evidence
from palpate.planning.plan import Node
from palpate.planning.symbolic.efforts import conversion_tail, with_effort
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

MAX_DETOURS = 20  # Maximum number of refused paths per search
# Offsets of the grasp and lift poses of a tool, from which it is carried.
LIFTS = ("", " + z_offset", " + 1.5*z_offset", " + 2.5*z_offset")
# Key of a solved task: the slide direction flag (`mirrored`) and the measured quantities.
Task = tuple[bool, frozenset[str]]


@dataclass(eq=False)
class Backchainer:
    """Builds one plan over one symbolic state, object by object."""

    scene: Scene  # the scene of the plan
    words: Vocabulary = field(default_factory=vocabulary)  # the permitted vocabulary
    # Slides go to the opposite side first. A dragged object lags behind the hand and stays slightly
    # displaced. Alternate sides cancel this bias.
    mirrored: bool = False
    balances: bool = True  # the last grasp of a weighed object is at its estimated balance point
    extras: bool = True  # optional evidence is recorded too
    # Messages on optional recordings that have no free space.
    omitted: list[str] = field(default_factory=list[str], init=False)
    state: SymbolicState = field(init=False)  # the symbolic state after `steps`
    # The steps of the plan so far.
    steps: list[Step] = field(default_factory=list[Step], init=False)
    _solved: dict[Task, tuple[str, list[Step]]] = field(
        default_factory=dict[Task, tuple[str, list[Step]]], init=False
    )
    """Steps of each solved task, with the object they were found for."""
    _began: tuple[int, SymbolicState] = field(init=False)
    """Number of steps and the state before the last search."""
    _refusal: str = field(default="", init=False)
    """Reason why the last path was refused."""

    def __post_init__(self) -> None:
        self.state = SymbolicState(self.scene)
        self._began = 0, self.state

    def tree(self) -> Node:
        """Return the steps so far as one Sequence."""
        return Node("Sequence", children=tuple(nodes(self.steps)))

    def go_home(self) -> None:
        """Move to the home configuration with an open and empty hand."""

        def home(state: SymbolicState) -> bool:
            return state.at == HOME_CONFIG and state.gripper == "open" and not state.holding

        self._reach(self._operators("", []), when(home), f"'{HOME_CONFIG}' cannot be reached")

    def measure(
        self, name: str, parameters: Sequence[Parameter], effort: Effort | None = None
    ) -> None:
        """Measure `parameters` of one object or surface and restore the scene.

        Args:
            name: the object or surface.
            parameters: its parameters.
            effort: speed and number of cycles beyond the minimum; None for the minimum.

        Raises:
            PlanRejected: there is no path; the message names the parameter.
        """
        state, done = self.state, len(self.steps)
        try:
            if not self._transfer(name, parameters):
                self._search(name, parameters)
        except PlanRejected:
            self.state = state
            del self.steps[done:]
            raise
        # Replace the steps by slower and repeated ones, for a narrower interval.
        if effort is not None:
            self.steps[done:], self.state = with_effort(
                state, self.steps[done:], self.state, name, effort
            )

    def hold(self, tool: str, spots: Sequence[str]) -> None:
        """Take a tool, hold it at each of the `spots`, and put it back."""
        away = self._clear(tool, (tool,))
        taken = [f"{tool}_pose{above}" for above in LIFTS]
        # Search to each spot separately, so that every search stays short.
        for spot in spots:
            operators = self._operators(tool, [*taken, spot])
            goal = when(lambda state, at=spot: state.holding == tool and state.at == at)
            self._reach(operators, goal, f"'{tool}' cannot be held at '{spot}'")
        operators = self._operators(tool, taken)
        self._reach(operators, when(at_rest(tool)), f"'{tool}' cannot be put back")
        for blocker, place in reversed(away):
            self._carry(blocker, place, at_rest(blocker))

    def repeat(self, name: str, parameters: Sequence[Parameter]) -> None:
        """Measure again with slides to the opposite side, independent of earlier recordings, if there is a path."""
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
        """Search for the steps that measure an object; blocking objects are carried away and back."""
        # Reject an object without support: its stated pose is wrong.
        floating = name in self.scene.objects and clear_of_support(
            self.state, name, self.state.pose_of(name)
        )
        if floating:
            raise PlanRejected(
                f"'{name}' is in the air; correct its pos, or give its pose by --poses"
            )
        # Carry blocking objects away, and collect the optional recordings.
        first = len(self.steps)
        away = self._clear(name, (name,)) if name in self.scene.bodies else []
        extras, added = self._extras(name, parameters), False
        # For mass and centre of mass alone, the last grasp is at the balance point: there the
        # torque of the weight on the fingers is least.
        weighed = {"mass", "com"} == {wanted.quantity for wanted in parameters}
        # Record each parameter until it is measured. The first level grasp also serves optional
        # recordings.
        for parameter in parameters:
            while not has_measurement(parameter, self.state):
                spots = balance_expressions(self.scene, parameter, self.state)
                last = spots if self.balances and weighed else ()
                if not any(self._record(parameter, expressions) for expressions in last):
                    self._acquire(parameter)
                if not added and self._hangs_level(name):
                    added = self._add_extra(parameters, extras)
            self._improve(parameter)
            self._enrich(parameter)
        # Optional recordings without a level grasp follow at the last grasp, if there is space.
        if extras and not (added or self._add_extra(parameters, extras)):
            kinds = " and ".join(dict.fromkeys(type(extra).__name__ for extra in extras))
            self.omitted.append(f"There is no room for {kinds} with '{name}'.")
        # Restore the scene. Only a task without blocking objects can be transferred to another
        # object.
        operators = self._operators(name, next(domains(self.scene, name)))
        self._reach(operators, when(at_rest(name)), f"'{name}' cannot be put back")
        if not away:
            self._solved[self._task(parameters)] = (name, self.steps[first:])
        for blocker, place in reversed(away):
            self._carry(blocker, place, at_rest(blocker))

    def _transfer(self, name: str, parameters: Sequence[Parameter]) -> bool:
        """Repeat the steps of the same task for this object; return False where they do not apply."""
        other, steps = self._solved.get(self._task(parameters), ("", []))
        if not steps:
            return False
        state, done = self.state, list[Step]()
        for step in steps:
            transferred = tuple(primitive.transferred(other, name) for primitive in step.primitives)
            again = Step(transferred, step.touches)
            # The exact check is needed too, because this object has other neighbours.
            after = again.apply(state)
            if after is None or again.harm(state) is not None:
                return False
            state = after
            done.append(again)
        # Accept the steps only if they measure everything and restore the object.
        complete = all(has_measurement(parameter, state) for parameter in parameters)
        if not complete or not at_rest(name)(state):
            return False
        self.state = state
        self.steps += done
        return True

    def _task(self, parameters: Iterable[Parameter]) -> Task:
        return self.mirrored, frozenset(parameter.quantity for parameter in parameters)

    def _acquire(self, parameter: Parameter) -> None:
        """Acquire one more piece of evidence at as few places as possible; else raise `PlanRejected`."""
        self._refusal = ""
        tried: list[Sequence[str]] = []
        for expressions in places(self.scene, parameter, self.state):
            if self._record(parameter, expressions):
                return
            tried.append(expressions)
        # A primitive of another package without `groundings` is never tried: name it in the error.
        around = self._surroundings(parameter.object, [])
        mute: list[str] = []
        for cls in self.words.converters(parameter.quantity):
            for user in (cls, *self.words.sensors(cls.reads or "")):
                if not list(user.groundings(around)):
                    mute.append(user.__name__)
        if mute:
            raise PlanRejected(
                f"no sequence of primitives measures {parameter}; {' and '.join(mute)} must define `groundings`"
            )
        # Explain the failure: several supporting surfaces, the last refused path, or the first
        # obstacle.
        kinds = self.scene.catalogue[parameter.quantity].evidence
        slides = any("sliding" in kind.activity for kind in kinds)
        if slides and stands_on_seam(self.scene, parameter.object):
            raise PlanRejected("it is on several surfaces, and none has free space for a slide")
        operators = (self._operators(parameter.object, expressions) for expressions in tried)
        reasons = (obstacle(self.state, each) for each in operators)
        raise PlanRejected(
            self._refusal
            or next(filter(None, reasons), f"no sequence of primitives measures {parameter}")
        )

    def _record(self, parameter: Parameter, expressions: Sequence[str]) -> bool:
        """Acquire one more piece of evidence at one of these places; return False without a path."""
        operators = self._operators(parameter.object, expressions)
        around = self._surroundings(parameter.object, expressions)
        return self._reach(operators, conversion_tail(parameter, operators, self.words, around))

    def _improve(self, parameter: Parameter) -> None:
        """Record evidence beyond the minimum where a single step yields it."""
        sides = "-+" if self.mirrored else "+-"
        # Try a second slide at each corner, until more evidence no longer improves the estimate.
        for axis in SIDEWAYS:
            for corner in corners(self.scene, parameter.object, axis, self.state, sides):
                if evidence_amount(parameter, self.state) >= useful_evidence(parameter, self.state):
                    return
                operators = self._operators(parameter.object, [corner])
                around = self._surroundings(parameter.object, [corner])
                tail = conversion_tail(parameter, operators, self.words, around)
                self._take(tail(self.state) or ())

    def _enrich(self, parameter: Parameter) -> None:
        """Record optional evidence that has a dedicated place, if there is space."""
        for evidence in self.scene.catalogue[parameter.quantity].evidence:
            place = f"{parameter.object}_{evidence.place}"
            if evidence.optional and exists(self.scene, place):
                with suppress(PlanRejected):
                    self._acquire(parameter)

    def _take(self, steps: Sequence[Step]) -> bool:
        """Append steps that pass the exact check; return False for refused or empty steps."""
        if not steps or find_first_refusal(self.state, steps) is not None:
            return False
        self.steps += steps
        for step in steps:
            self.state = step.effect(self.state)
        return True

    def _extras(self, name: str, parameters: Iterable[Parameter]) -> Sequence[Primitive]:
        """Return the primitives that yield only optional evidence of these parameters."""
        evidence = (
            item
            for parameter in parameters
            for item in self.scene.catalogue[parameter.quantity].evidence
        )
        # Evidence with a dedicated place is recorded there (`_enrich`).
        if not (self.extras and any(item.optional and not item.place for item in evidence)):
            return []
        return self._ground_primitives(self._surroundings(name, []), extra=True)

    def _hangs_level(self, name: str) -> bool:
        """True if an object is held at its believed balance point."""
        # The less an object turns in the fingers, the longer it can be held.
        pose = self.state.pose_tcp_object
        if self.state.holding != name or pose is None:
            return False
        return abs(pose.apply(solids(self.scene).centre_of_mass(name))[0]) < NEARER

    def _add_extra(self, parameters: Iterable[Parameter], extras: Iterable[Primitive]) -> bool:
        """Record optional evidence with the held object, and before with the empty hand, if possible."""
        for operator, steps in self._yielding(self.state, parameters, extras):
            if self._take(steps):
                self._add_before(parameters, operator)
                return True
        return False

    def _add_before(self, parameters: Iterable[Parameter], operator: Primitive) -> None:
        """Insert the same recording with the empty hand where the last path passed this pose."""
        # The friction of the joints is then the same with and without the object.
        # Replay the last path to find the latest pass of this pose with an empty hand.
        count, before = self._began
        latest_step: tuple[int, SymbolicState] | None = None
        for i, step in enumerate(self.steps[count:], start=count + 1):
            before = step.effect(before)
            if before.at == self.state.at and not before.holding:
                latest_step = i, before
        if latest_step is None:
            return
        # Insert the recording there. Later states gain its log entries and stay the same otherwise.
        i, state = latest_step
        for _, steps in self._yielding(state, parameters, [operator]):
            if find_first_refusal(state, steps) is None:
                self.steps[i:i] = steps
                logged = steps[-1].effect(state).logged[len(state.logged) :]
                self.state = replace(self.state, logged=(*self.state.logged, *logged))

    def _yielding(
        self, state: SymbolicState, parameters: Iterable[Parameter], operators: Iterable[Primitive]
    ) -> Iterator[tuple[Primitive, Sequence[Step]]]:
        """Yield the operators that record evidence of a parameter in a state, with their steps."""
        for parameter in parameters:
            around = self._surroundings(parameter.object, [])
            for operator in operators:
                steps = conversion_tail(parameter, [operator], self.words, around)(state)
                if steps:
                    yield operator, steps

    def _clear(self, name: str, waiting: tuple[str, ...]) -> list[tuple[str, str]]:
        """Carry away the objects that block `name`, and their blockers first.

        Returns:
            The names of the carried objects with their temporary places, in order.

        Raises:
            PlanRejected: a blocker cannot be carried away, or there is no free place.
        """
        away: list[tuple[str, str]] = []
        resolve = self.scene.symbols.resolve
        above, spot = (resolve(expression) for expression in approach(self.scene, name))
        # Recompute the blockers after each carried object: the remaining ones may change.
        while obstacles := blockers(self.state, name, above, spot):
            blocker = obstacles[0]
            if blocker in waiting or blocker in dict(away):
                raise PlanRejected(f"'{blocker}' blocks '{name}' and cannot be carried away")
            away += self._clear(blocker, (*waiting, blocker))
            place = f"{blocker}{TEMPORARY}"
            if not exists(self.scene, place):
                raise PlanRejected(f"'{blocker}' is in the way, and has no free place to be put")
            # The object moves and turns with the hand, from its grasp pose to the place.
            carried = resolve(place) @ resolve(f"{blocker}_pose").inverse()
            self._carry(
                blocker, place, placement_goal(blocker, carried @ self.state.pose_of(blocker))
            )
            away.append((blocker, place))
        return away

    def _carry(self, name: str, place: str, done: Goal) -> None:
        """Carry an object between its original pose and a place, until `done`."""
        spots = (f"{name}_pose", place)
        operators = self._operators(name, [e for at in spots for e in (f"{at} + z_offset", at)])
        self._reach(operators, when(done), f"'{name}' cannot be carried away and back")

    def _surroundings(self, subject: str, expressions: Iterable[str]) -> Surroundings:
        """Return the surroundings of an object, including the poses of the current grasp and contact."""
        # Add the poses needed to release or lift: the grasp, the contact, and the temporary place.
        grasp = self.state.grasp
        near = [grasp, f"{grasp} + z_offset"] if grasp else []
        if self.state.contact and self.state.at:
            near.append(self.state.at)
        if grasp and self.state.at and TEMPORARY in self.state.at:
            near.append(f"{self.state.at} + z_offset")  # to lift it after a slide
        poses = [name for name in dict.fromkeys([*expressions, *near]) if exists(self.scene, name)]
        return Surroundings(self.state, subject, tuple(poses))

    def _operators(self, subject: str, expressions: Iterable[str]) -> list[Primitive]:
        """Return the grounded motion and gripper primitives."""
        return self._ground_primitives(self._surroundings(subject, expressions), extra=False)

    def _ground_primitives(self, around: Surroundings, extra: bool) -> list[Primitive]:
        primitives: list[Primitive] = []
        for cls in self.words.primitives.values():
            if cls.claims and cls.extra == extra:
                primitives += cls.groundings(around)
        return primitives

    def _reach(self, operators: Sequence[Primitive], tail: Tail, failure: str = "") -> bool:
        """Append the shortest path to a state where `tail` applies; without one raise `failure`, or return False."""
        # Search with fast box tests, then apply the exact check to the path. Each refused step is
        # excluded from the next search.
        refused: set[Refusal] = set()
        refusal = ""
        for _ in range(MAX_DETOURS):
            path = shortest(self.state, operators, tail, refused)
            if path is None:
                break
            steps, after = path
            harm = find_first_refusal(self.state, steps)
            if harm is None:
                self._began = len(self.steps), self.state
                self.steps += steps
                self.state = after
                return True
            refused.add(harm[0])  # excluded in the next search
            self._refusal = refusal = reason(harm[1])
        # Report the last refusal, or the first obstacle if no path was found at all.
        if failure:
            why = refusal or obstacle(self.state, operators)
            raise PlanRejected(f"{failure}: {why}" if why else failure)
        return False
