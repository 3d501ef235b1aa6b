"""What the hand can take."""

from __future__ import annotations

from palpate.mjcf.body import Body
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import Violation


def ungraspable(state: SymbolicState, body: Body) -> list[Violation]:
    """What speaks against grasping an object: that it does not fit, or is known to be too heavy."""
    found: list[Violation] = []
    reason = state.scene.symbols.ungraspable.get(body.name)
    if reason:
        found.append(Violation("too-wide", f"'{body.name}' cannot be grasped: {reason}"))
    mass, payload = body.known.get("mass", (0.0,))[0], state.scene.arm.limits.payload
    if mass > payload:
        found.append(
            Violation(
                "payload",
                f"'{body.name}' weighs {mass:g} kg, more than the payload of {payload:g} kg; it "
                "cannot be lifted",
            )
        )
    return found
