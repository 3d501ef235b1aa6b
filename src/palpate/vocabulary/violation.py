"""What speaks against an action where it stands, and the rules that it may break."""

from __future__ import annotations

from dataclasses import dataclass

PRECONDITION = "precondition"

RULES: dict[str, str] = {
    "unknown-symbol": "Poses and joint configurations are named by symbols of the scene.",
    "unreachable": "The arm reaches every pose within its joint limits.",
    "gripper-state": "Fingers close only when open and on an object, and open only when nothing would fall.",
    "too-wide": "An object that is grasped fits the hand.",
    "payload": "An object that is grasped is not known to be heavier than the payload.",
    "buffer-unwritten": "A conversion comes after the sensing that fills its buffer.",
    PRECONDITION: "What else a primitive requires at its place in the plan holds.",
    "sideways": "Objects are approached from straight above and left straight upwards.",
    "short-slide": "A slide beside a force log is long enough to feel friction.",
    "blocked": "The hand, and what it holds, meets no other object on its way.",
    "collision": "The arm, the hand, its fingers and what they hold keep clear of everything on the whole way.",
    "self-collision": "The arm keeps clear of itself.",
    "unknown-start": "Where a motion begins is known: a plan starts with MoveJoints to 'home_config'.",
    "unsupported": "What is let go of, or stands on what is moved, has its centre of mass well over its support.",
    "tilted": "What is held stays upright.",
    "twist": "A held object hangs near enough to its centre of mass not to twist in the grip.",
}
"""Rules of single actions: id to what each demands. The rules of whole plans are in
`planning.check`."""


@dataclass(frozen=True, slots=True)
class Violation:
    """One rule that an action would break where it stands.

    Attributes:
        rule: its id, one of `RULES`; a third party's primitive mostly uses `precondition`.
        message: what is wrong and what to do, so that a model or a person can repair the plan.
    """

    rule: str
    message: str

    def __str__(self) -> str:
        return self.message
