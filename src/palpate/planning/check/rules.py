"""Catalogue of the rules of the check, with their numbers: source of the prompt and of
`docs/vocabulary.md`. Every number is the constant that the check itself uses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.scene.named.places import GUESSED
from palpate.vocabulary.admissible.collision import ARM, BESIDE, ENTERED, FIXED
from palpate.vocabulary.admissible.grasp import PUSHED
from palpate.vocabulary.admissible.motion import HELD_UPRIGHT
from palpate.vocabulary.admissible.profile import POSE_ERROR
from palpate.vocabulary.admissible.support import (
    AS_FOUND,
    EDGE,
    LIFTED,
    MIN_SLIDE,
    TIPPING,
    UPRIGHT,
)
from palpate.vocabulary.contact import PROBE_TRAVEL
from palpate.vocabulary.state import RESTORED_POSITION, SINKING
from palpate.vocabulary.violation import PRECONDITION


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule of the check.

    Attributes:
        id: name in findings.
        asks: requirement on a plan, in words for people and models alike.
        about: part of a plan that it judges.
        recipe: it prescribes a method of measurement, not safety, economy or form; the lean prompt
            leaves that to the model.
    """

    id: str
    asks: str
    about: Literal["parameters", "tree"] = "tree"
    recipe: bool = False


def mm(length: float) -> str:
    """Format a length in m as millimetres."""
    return f"{1e3 * length:.3g} mm"


_PARAMETERS = {
    "unknown-parameter": "Parameters name objects or surfaces of the scene, or `gripper`, and quantities of the "
    "catalogue.",
    "unmeasurable": "A parameter is a measurable quantity of its kind of thing: of an object, a surface or the "
    "gripper.",
    "duplicate-parameter": "A parameter is listed once.",
    "known": "What the scene states is no parameter and is not measured (unless asked for again).",
    "requested": "Without a request the parameters are all that the scene leaves out, no more and no fewer.",
    "undischarged": "The tree yields every parameter: by its conversion or, if it is derived, by all recordings "
    "that it needs. Without a tree there are no parameters.",
    "redundant": "Nothing is measured or logged twice, or that no parameter needs; at another place, or another "
    "grasp, it is not the same.",
    "untouched": "Only objects of the parameters are grasped, those that block them, and tools that are held while "
    "something else is measured; without parameters, one object that the explanation names.",
    "no-explanation": "A plan without a tree says why.",
}

_FORM = {
    "unknown-primitive": "Every node's type is a primitive or composite of the vocabulary.",
    "bad-argument": "A leaf's arguments are those that its primitive declares, of the declared types; composites "
    "have only `children`; any node may have a `name`.",
    "leaf-children": "Only composites have children.",
    "empty-composite": "A Sequence or Parallel has at least one child.",
    "one-owner": "At most one leaf below a Parallel moves the arm, and at most one the gripper.",
    "buffer-unwritten": "A conversion comes after the sensing that fills its buffer, not beside it.",
}

_ACTIONS = {
    "unknown-symbol": "Poses, offsets and joint configurations are named by symbols of the scene.",
    "unreachable": "The arm reaches every pose within its workspace and joint limits; Tilt keeps "
    "the wrist from straight.",
    "unknown-start": "Where a motion begins is known: a plan starts with MoveJoints to `home_config`; turning "
    "begins at a pose.",
    "gripper-state": "Fingers close only when open, at a pose, and on an object whose middle is within "
    f"{mm(PUSHED)} of theirs across it; they open only when what they hold stands; they do neither beside a motion.",
    "too-wide": "An object that is grasped fits the hand.",
    "payload": "An object that is grasped is not known to be heavier than the payload.",
    "twist": "A held object hangs near enough to its centre of mass not to twist in the grip.",
    PRECONDITION: "What else a primitive requires holds. MoveUntilContact: from a pose, with empty fingers, "
    f"something to touch within {1e3 * PROBE_TRAVEL:.0f} mm and its top no more than {mm(SINKING)} above the "
    "fingertips, no contact yet. MoveJoints: between a level hand and one that points down, the wrist is turned "
    "first. A conversion: the log shows its quantity; held still for a weight means "
    f"lifted by more than {mm(LIFTED)}.",
    "blocked": f"The hand, and what it holds, keeps {mm(BESIDE)} from every other object on its whole way; "
    "what stands on it is carried away first.",
    "collision": f"They keep {mm(ENTERED)} from what they pass between the fingers, {mm(FIXED)} from all that is "
    f"fixed (up to {mm(GUESSED)} above a surface of unknown height, which is only probed), the arm's links "
    f"{mm(ARM)} from everything; Tilt, Turn and Swing turn {mm(POSE_ERROR)} clear, in free air.",
    "self-collision": f"The arm keeps {mm(ARM)} from itself.",
    "unsupported": f"What is let go of stands within {mm(AS_FOUND)} of where it stood, or upright to "
    f"{np.degrees(UPRIGHT):.3g}° with its centre of mass {mm(TIPPING)} inside what carries it (unknown: all of it, "
    f"{mm(EDGE)}); what is slid stays so, too.",
    "tilted": f"What is held stays upright to {np.degrees(HELD_UPRIGHT):.3g}°, but for Tilt and Swing.",
    "short-slide": "A slide that is felt for friction is level, along one surface, and "
    f"{mm(MIN_SLIDE)} or longer.",
    "gripper-at-end": "At the end the gripper is empty and open.",
    "not-restored": f"At the end every object is within {mm(RESTORED_POSITION)} of where it was found.",
}

_RECIPES = ("short-slide",)

CATALOGUE: Mapping[str, Rule] = {
    **{id: Rule(id, asks, "parameters") for id, asks in _PARAMETERS.items()},
    **{id: Rule(id, asks, recipe=id in _RECIPES) for id, asks in {**_FORM, **_ACTIONS}.items()},
}
"""Every rule by its id, in the order in which people and models read them."""
