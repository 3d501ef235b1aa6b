"""What the hand can take."""

from __future__ import annotations

from palpate.mjcf.body import Body
from palpate.scene.scene import Scene
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import Violation


def ungraspable(state: SymbolicState, body: Body) -> list[Violation]:
    """What speaks against grasping an object: that it does not fit, or is known to be too heavy."""
    found: list[Violation] = []
    unfit, heavy = does_not_fit(state.scene, body.name), too_heavy(state.scene, body)
    if unfit:
        found.append(Violation("too-wide", unfit))
    if heavy:
        found.append(Violation("payload", f"{heavy}; it cannot be lifted"))
    return found


def does_not_fit(scene: Scene, name: str) -> str:
    """Why the hand cannot take the object, empty when it can."""
    reason = scene.symbols.ungraspable.get(name)
    return f"'{name}' cannot be grasped: {reason}" if reason else ""


def too_heavy(scene: Scene, body: Body) -> str:
    """That a known mass exceeds the payload, empty when it does not."""
    mass, payload = body.known.get("mass", (0.0,))[0], scene.arm.limits.payload
    if mass <= payload:
        return ""
    return f"'{body.name}' weighs {mass:g} kg, more than the payload of {payload:g} kg"
