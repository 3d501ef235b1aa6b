"""A third party's primitives are planned for by what they say themselves, whatever arguments they
have: two fields, and kinds of argument that palpate has never seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import ModuleType
from typing import ClassVar

import pytest
from workbench import BOTTLE, MUG, actions, bench

from palpate.common.parameter import Parameter
from palpate.estimation.quantities import catalogue as catalogue_module
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.quantity import Quantity
from palpate.planning.check.check import check
from palpate.planning.plan import Plan, dump_plan, parse_plan
from palpate.planning.symbolic.planner import assemble
from palpate.primitives.base import ConversionPrimitive, Primitive, Steps, Surroundings
from palpate.primitives.motion import MoveJoints
from palpate.primitives.registry import Vocabulary, load_vocabulary
from palpate.primitives.state import SymbolicState, Violation


class Tap(Primitive):
    """Knock on an object, once from the middle of the room and so hard that it is heard."""

    group: ClassVar = "motion"
    claims: ClassVar = frozenset({"arm"})
    place: tuple[float, float, float]
    force: float

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Tap]:
        if around.subject in around.state.scene.objects:
            body = around.state.scene.body(around.subject)
            above = body.pose_world.translate((0.0, 0.0, 0.2))
            yield cls(place=tuple(above.position.tolist()), force=0.5)

    def effects(self, state: SymbolicState) -> SymbolicState:
        pose = state.scene.symbols.resolve("bottle_pose + z_offset")
        there = replace(pose, position=pose.position * 0 + self.place)
        return replace(state, at=f"tap {self.place}", pose_world_tcp=there, contact=None)

    def run(self, blackboard: object) -> Steps:
        yield
        return "knocked"


class Listen(Primitive):
    """Record a sound from one side."""

    group: ClassVar = "sensing"
    writes: ClassVar = "sound"
    seconds: float
    channels: frozenset[str]

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Listen]:
        yield cls(seconds=0.5, channels=frozenset({"left"}))

    def effects(self, state: SymbolicState) -> SymbolicState:
        return state.add_recording("sound")

    def run(self, blackboard: object) -> Steps:
        yield
        return "heard"


class Hollowness(Quantity):
    id, unit, subject = "hollowness", "1", "object"
    how = "Tap it and Listen"


class Sound2Hollowness(ConversionPrimitive):
    """Convert a sound made by a Tap into how hollow the object is."""

    reads: ClassVar = "sound"
    measures: ClassVar = Hollowness

    def subject(self, state: SymbolicState) -> str | None:
        context = state.buffers.get("sound")
        if context is None or not (context.at or "").startswith("tap"):
            return None
        for body in state.scene.objects.values():
            if f"({body.pose_world.position[0]}" in (context.at or ""):
                return body.name
        return None

    def requires(self, state: SymbolicState) -> list[Violation]:
        heard = self.subject(state)
        return [] if heard else [Violation("precondition", "Tap something before you Listen")]

    def effects(self, state: SymbolicState) -> SymbolicState:
        subject = self.subject(state)
        result = {Parameter(subject, "hollowness")} if subject else set[Parameter]()
        return replace(state, converted=state.converted | result)


class Shout(Primitive):
    """Record the echo of a word that only a person would think of."""

    group: ClassVar = "sensing"
    writes: ClassVar = "sound"
    word: str

    def run(self, blackboard: object) -> Steps:
        yield
        return "heard"


@pytest.fixture
def words(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Vocabulary]]:
    """Makes a vocabulary of palpate's primitives and others; the catalogue has their quantity."""
    for remembered in (catalogue, bench):
        remembered.cache_clear()
    monkeypatch.setattr(catalogue_module, "iter_entry_points", lambda group: [Hollowness])
    yield lambda *classes: load_vocabulary([module(*classes)])
    for remembered in (catalogue, bench):
        remembered.cache_clear()


def module(*things: type) -> ModuleType:
    """A package that brings these classes."""
    package = ModuleType("palpate_ear")
    for body in things:
        setattr(package, body.__name__, body)
    return package


def test_primitives_with_two_fields_and_new_kinds_of_arguments_are_planned_for(words) -> None:
    scene = bench(BOTTLE, MUG)
    known = words(Tap, Listen, Sound2Hollowness)
    wanted = [Parameter("bottle", "hollowness"), Parameter("mug", "hollowness")]
    assembly = assemble(scene, wanted, known)
    assert assembly.measured == tuple(wanted)
    assert assembly.failed == ()
    taken = [action.split()[0] for action in actions(assembly.tree)]
    assert taken.count("Tap") == taken.count("Listen") == taken.count("Sound2Hollowness") == 2
    kept = parse_plan(dump_plan(Plan(assembly.measured, assembly.tree, "hollow?")))
    assert check(kept, scene, words=known) == ()


def test_a_primitive_without_groundings_is_named_in_the_rejection(words) -> None:
    assembly = assemble(
        bench(BOTTLE), [Parameter("bottle", "hollowness")], words(Tap, Shout, Sound2Hollowness)
    )
    assert assembly.tree is None
    assert "Shout must define `groundings`" in assembly.failed[0].reason


def test_a_motion_of_a_third_party_is_judged_like_any_other() -> None:
    scene = bench(BOTTLE, MUG)
    low = Tap(place=(0.45, 0.25, 0.05), force=0.5)
    home = MoveJoints(joints="home_config").effects(SymbolicState(scene))
    start = replace(home, gripper="open")
    names = {violation.rule for violation in low.violations(start)}
    assert names == {"collision"}
