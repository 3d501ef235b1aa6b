"""Evidence of a quantity: the recordings that its estimator needs, declared once with the quantity.

The check of plans, the symbolic search, the prompt, the conversions and the judgement of studies all
read it from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.trace.recording import Activity, Context

GRIPPER = "gripper"
"""Subject of recordings with an empty gripper."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Kind of recording from which a quantity is estimated.

    Attributes:
        buffer: what is logged.
        how: how that is done, in words for prompts and explanations.
        activity: what goes on meanwhile; anything when empty.
        empty: whether it is made with an empty hand where it would hold the object.
        holding: whether it is about the object held; otherwise it is about the surface touched, or
            about what moves, held object or gripper.
        distinct: what of the context tells several such recordings apart, the grasp or the place;
            None when they are all alike.
        count: how many different ones it takes.
        better: how many different ones are worth having where they come easily.
        place: X, of evidence that is recorded at `<object>_X`; anywhere when empty.
        as_grasped: of what is held, it is recorded where that was grasped, or right above.
        optional: it is recorded where the scene has room for it, and told without it.
    """

    buffer: str
    how: str
    activity: tuple[Activity, ...] = ()
    holding: bool = False
    distinct: Literal["grasp", "place"] | None = None
    count: int = 1
    better: int = 1
    empty: bool = False
    place: str = ""
    as_grasped: bool = False
    optional: bool = False

    def about(self, context: Context) -> str | None:
        """The object or surface that a recording made in `context` is evidence of; None when it is
        none."""
        if self.activity and context.activity not in self.activity:
            return None
        if self.empty:
            return context.place_of if context.holding is None else None
        if self.as_grasped and context.is_elsewhere:
            return None
        if self.holding:
            subject = context.holding
        elif context.activity == "contact":
            subject = context.support
        else:
            subject = context.holding or GRIPPER
        return subject if self._is_there(context, subject) else None

    def _is_there(self, context: Context, subject: str | None) -> bool:
        """The recording about `subject` is made at the required place."""
        at = context.grasp if self.holding else context.at
        return not self.place or (at or "").split(" ")[0] == f"{subject}_{self.place}"

    def key(self, context: Context) -> str | None:
        """Grasp or place that distinguishes a recording from others of its kind; empty where they
        are all alike, None if unknown."""
        if self.distinct is None:
            return ""
        return context.grasp if self.distinct == "grasp" else context.at
