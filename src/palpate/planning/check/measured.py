"""When is a gap discharged? By its conversion, or, for a derived quantity, by the recordings it is
derived from."""

from __future__ import annotations

from palpate.parameter import Parameter
from palpate.quantities.evidence import DERIVED, NEEDED, piece
from palpate.vocabulary.state import SymbolicState


def amount(parameter: Parameter, state: SymbolicState) -> int:
    """How much of the evidence for `gap` there is."""
    if parameter in state.converted:
        return max(NEEDED.values())
    return len({piece(parameter, buffer, context) for buffer, context in state.logged} - {None})


def measured(parameter: Parameter, state: SymbolicState) -> bool:
    """Whether what was recorded and converted so far yields `gap`."""
    if parameter.quantity not in DERIVED:
        return parameter in state.converted
    return amount(parameter, state) >= NEEDED[parameter.quantity]
