"""Steps that record evidence of a parameter: sensing, and the conversion that reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from palpate.parameter import Parameter
from palpate.planning.check.walk import evidence_amount
from palpate.planning.symbolic.shortest import Tail
from palpate.planning.symbolic.steps import Step
from palpate.vocabulary.base import Primitive, Surroundings
from palpate.vocabulary.registry import Vocabulary
from palpate.vocabulary.state import SymbolicState, during


def yielding(
    parameter: Parameter, operators: Sequence[Primitive], words: Vocabulary, around: Surroundings
) -> Tail:
    """Tail of steps that sense and convert a parameter, alone or beside one of the motions."""
    chains = list(recording_chains(parameter.quantity, words, around))
    motions = [operator for operator in operators if "arm" in operator.claims]

    def tail(state: SymbolicState) -> list[Step] | None:
        for first, *others in chains:
            following = [Step((primitive,)) for primitive in others]
            steps = [Step((first,)), *following]
            if adds_evidence(parameter, steps, state):
                return steps
            for operator in motions:
                steps = [Step((operator, first)), *following]
                if not state.contact and adds_evidence(parameter, steps, state):
                    return steps
        return None

    return tail


def recording_chains(
    quantity: str, words: Vocabulary, around: Surroundings
) -> Iterator[tuple[Primitive, ...]]:
    """Sensing and conversion that end in `quantity`; of a derived quantity, the sensing alone."""

    def grounded(classes: Iterable[type[Primitive]]) -> Iterator[Primitive]:
        for cls in classes:
            yield from cls.groundings(around)

    known = around.state.scene.catalogue[quantity]
    if known.derived:
        for buffer in dict.fromkeys(evidence.buffer for evidence in known.evidence):
            for sensing in grounded(words.sensors(buffer)):
                yield (sensing,)
    for conversion in grounded(words.converters(quantity)):
        if conversion.reads is None:
            yield (conversion,)
            continue
        for sensing in grounded(words.sensors(conversion.reads)):
            yield sensing, conversion


def adds_evidence(parameter: Parameter, steps: Iterable[Step], state: SymbolicState) -> bool:
    """True if the steps can be made and add evidence of the parameter."""
    before, quantity = evidence_amount(parameter, state), state.scene.catalogue[parameter.quantity]
    for step in steps:
        written = [primitive.writes for primitive in step.primitives if primitive.writes]
        if written and quantity.evidence:
            # Before the slower trial: the context of the recording shows whether it can be evidence.
            context = during(step.moving, state).context()
            if not any(quantity.piece(parameter, buffer, context) for buffer in written):
                return False
        after = step.applied(state)
        if after is None:
            return False
        state = after
    return evidence_amount(parameter, state) > before
