"""Steps that record evidence of a parameter: sensing, and the conversion that reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from palpate.parameter import Parameter
from palpate.planning.check.walk import evidence_amount
from palpate.planning.symbolic.goals import Tail
from palpate.planning.symbolic.steps import Step
from palpate.vocabulary.base import Primitive, Surroundings
from palpate.vocabulary.registry import Vocabulary
from palpate.vocabulary.state import SymbolicState, during


def yielding(
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
    before = evidence_amount(parameter, state)
    for step in steps:
        if not _may_concern(parameter, step, state):
            return False
        after = step.applied(state)
        if after is None:
            return False
        state = after
    return evidence_amount(parameter, state) > before


def _may_concern(parameter: Parameter, step: Step, state: SymbolicState) -> bool:
    """True if what a step records may be evidence for a derived parameter: a quick look before the
    step is tried."""
    catalogue = state.scene.catalogue
    if not catalogue[parameter.quantity].derived:
        return True
    context = during(step.moving, state).context()
    for primitive in step.primitives:
        if primitive.writes and catalogue.piece(parameter, primitive.writes, context):
            return True
    return False
