"""Rules of economy: nothing known is measured again, nothing twice, nothing touched in vain."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.parameter import Parameter
from palpate.planning.check.case import Case
from palpate.planning.check.finding import Finding
from palpate.planning.check.walk import Action, Walk
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Piece
from palpate.vocabulary.admissible.clearance import needed_away


def known(case: Case, walk: Walk) -> Iterator[Finding]:
    """Reject the measurement of known quantities, unless re-measuring is asked for."""
    for action, parameter in _conversions(walk):
        if _is_stray(parameter, case):
            message = f"{parameter} is stated by the scene; do not measure it"
            yield Finding.of(action.path, "known", message)


def redundant(case: Case, walk: Walk) -> Iterator[Finding]:
    """Reject repeated measurements, and those that no parameter needs."""
    made: set[Parameter] = set()
    for action, parameter in _conversions(walk):
        if not _is_stray(parameter, case):
            if parameter in made and not case.repeated:
                message = f"{parameter} is measured already; remove this"
                yield Finding.of(action.path, "redundant", message)
            elif parameter not in case.plan.parameters and not case.unclear:
                message = f"this yields {parameter}, which is not among the parameters; remove it"
                yield Finding.of(action.path, "redundant", message)
        made.add(parameter)
    for action in _unused_recordings(case, walk):
        if not walk.doubts(action.path):
            message = f"no parameter needs what is logged here, {_circumstances(action)}; remove it"
            yield Finding.of(action.path, "redundant", message)


def untouched(case: Case, walk: Walk) -> Iterator[Finding]:
    """Only objects among the parameters are grasped, those that block them, and tools for measuring them;
    without parameters, one tool that the explanation names."""
    assert case.scene is not None
    if case.unclear:
        return
    concerned = {parameter.object for parameter in case.plan.parameters}
    tools = _tools(case, walk) if concerned else _told(case, walk)
    strange = _grasped(walk, concerned | tools)
    if strange:
        away = needed_away(case.scene, concerned)
        for path, name in strange:
            if name not in away:
                message = (
                    f"'{name}' is not among the parameters' objects and blocks none of them; "
                    "leave it alone"
                )
                yield Finding.of(path, "untouched", message)


def _conversions(walk: Walk) -> Iterator[tuple[Action, Parameter]]:
    for action in walk.actions:
        parameter = action.conversion
        if parameter is not None:
            yield action, parameter


def _is_stray(parameter: Parameter, case: Case) -> bool:
    """True if the scene states it and nobody asked for it."""
    if case.remeasure or parameter in case.plan.parameters:
        return False
    return case.is_known(parameter)


def _circumstances(action: Action) -> str:
    """Circumstances of a recording, in words."""
    _, context = action.after.logged[-1]
    of = f"of '{context.holding}' in the hand" if context.holding else "of the empty hand"
    return f"{of}, {context.activity}, at '{context.at}'"


def _unused_recordings(case: Case, walk: Walk) -> Iterator[Action]:
    """Sensing leaves that neither a conversion nor a derived parameter needs."""
    converted = _converted_recordings(walk)
    seen: set[tuple[Parameter, Piece]] = set()
    for action in walk.actions:
        if not action.records:
            continue
        evidence: set[tuple[Parameter, Piece]] = set()
        for parameter in case.plan.parameters:
            piece = _piece(parameter, action)
            if piece is not None:
                evidence.add((parameter, piece))
        if action.path not in converted and evidence <= seen:
            yield action
        if not case.repeated:
            seen |= evidence


def _piece(parameter: Parameter, action: Action) -> Piece | None:
    """Piece of evidence for a parameter that an action records: of a derived one, or one of several
    that count together."""
    logged = action.after.logged[-1]
    quantity = catalogue().get(parameter.quantity)
    if quantity is None or quantity.derived:
        return catalogue().piece(parameter, *logged)
    piece = quantity.piece(parameter, *logged)
    if piece is None or quantity.evidence[piece[0]].distinct is None:
        return None
    return piece


def _converted_recordings(walk: Walk) -> set[str]:
    """Paths of sensing leaves whose recording a conversion reads: each reads the latest that its
    branch knows of."""
    paths = {id(action.after.logged[-1]): action.path for action in walk.actions if action.records}
    converted: set[str] = set()
    for action in walk.actions:
        if action.primitive.measures is None:
            continue
        read = [entry for entry in action.before.logged if entry[0] == action.primitive.reads]
        if read and id(read[-1]) in paths:
            converted.add(paths[id(read[-1])])
    return converted


def _grasped(walk: Walk, expected: set[str]) -> list[tuple[str, str]]:
    """Grasps of objects other than the `expected` ones."""
    found: list[tuple[str, str]] = []
    for action in walk.actions:
        if action.grasps and action.grasps not in expected:
            found.append((action.path, action.grasps))
    return found


def _told(case: Case, walk: Walk) -> set[str]:
    """The one object that a plan without parameters takes into the hand, where it says so."""
    grasped = {name for _, name in _grasped(walk, set())}
    named = {name for name in grasped if name in case.plan.explanation}
    return named if len(grasped) == 1 else set()


def _tools(case: Case, walk: Walk) -> set[str]:
    """Objects that were held while a parameter of something else was measured."""
    found: set[str] = set()
    for action, parameter in _conversions(walk):
        held = action.before.holding
        if held and held != parameter.object and parameter in case.plan.parameters:
            found.add(held)
    return found
