"""Completion of a parameter: by its conversion, or, for a derived quantity, by the recordings it is
derived from."""

from __future__ import annotations

from collections import Counter

from palpate.parameter import Parameter
from palpate.vocabulary.state import SymbolicState


def amount(parameter: Parameter, state: SymbolicState) -> int:
    """Amount of evidence for `parameter` so far."""
    quantity = state.scene.catalogue[parameter.quantity]
    needed = sum(evidence.count for evidence in quantity.evidence)
    if parameter in state.converted:
        return max(needed, 1)
    return len(quantity.pieces(parameter, state.logged)) if quantity.derived else 0


def enough(parameter: Parameter, state: SymbolicState) -> int:
    """Amount of evidence that is useful for `parameter`."""
    quantity = state.scene.catalogue[parameter.quantity]
    return sum(max(evidence.count, evidence.better) for evidence in quantity.evidence)


def measured(parameter: Parameter, state: SymbolicState) -> bool:
    """True if what was recorded and converted so far yields `parameter`."""
    if parameter in state.converted:
        return True
    quantity = state.scene.catalogue[parameter.quantity]
    return quantity.derived and quantity.is_evidenced(parameter, state.logged)


def lacking(parameter: Parameter, state: SymbolicState) -> tuple[str, ...]:
    """Recordings that a derived `parameter` still needs, in words, with the number of each so far."""
    quantity = state.scene.catalogue[parameter.quantity]
    kinds = Counter(kind for kind, _ in quantity.pieces(parameter, state.logged))
    found: list[str] = []
    for i, evidence in enumerate(quantity.evidence):
        if kinds[i] < evidence.count and not evidence.optional:
            found.append(f"{evidence.how} ({kinds[i]} of {evidence.count})")
    return tuple(found)
