"""Errands with a tool: what no primitive reads is read by a person, where the arm holds the tool.

A quantity names the tool and the place in its evidence. The request has to name the tool, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.errors import InputError, PlanRejected
from palpate.planning.request.grounding import ground
from palpate.quantities.catalogue import catalogue
from palpate.quantities.manual.temperature import Temperature
from palpate.quantities.quantity import Evidence, Quantity
from palpate.scene.scene import Scene

MANUAL: tuple[Quantity, ...] = (Temperature(),)
"""Quantities beside the catalogue that a person reads off a tool."""
_DENYING = re.compile(r"\b(?:not?|never|without|except|but|unless|if|instead|nor)\b|n't\b")
_JOINING = re.compile(r"\band\b|[,;.!?]")
_BEFORE_THING = re.compile(r"\b(?:of|in|inside|on|over|at)\b")


@dataclass(frozen=True, slots=True)
class Errand:
    """Carrying of a tool over some objects.

    Attributes:
        quantity: what a person reads off the tool.
        tool: the object that is carried.
        spots: pose expressions where it is held, in order.
        objects: the objects that are read there.
    """

    quantity: Quantity
    tool: str
    spots: tuple[str, ...]
    objects: tuple[str, ...]

    @property
    def explanation(self) -> str:
        """Explanation of the plan."""
        over = " and ".join(f"'{name}'" for name in self.objects)
        return (
            f"'{self.tool}' is fetched, held over {over} and returned. The {self.quantity.label} is to be read by "
            f"a person: no primitive reads it. {self.how.capitalize()}."
        )

    @property
    def how(self) -> str:
        """Instruction for the reading."""
        return "; ".join(evidence.how for evidence in self.quantity.evidence)


def errand(request: str, scene: Scene) -> Errand | None:
    """The errand that a request asks for, and nothing else; None for any other request.

    Raises:
        InputError: the scene has no place over an object where the tool is to be held.
    """
    said = " ".join(request.lower().split())
    if _DENYING.search(said):
        return None
    for quantity, evidence in tooled():
        tools = [
            name for name in scene.objects if evidence.tool in re.split(r"[\W_]+", name.lower())
        ]
        used = re.search(rf"\b(?:with|using) (?:the|a|my) {re.escape(evidence.tool)}\b", said)
        if used is None or len(tools) != 1:
            continue
        rest = (said[: used.start()] + said[used.end() :]).strip(" ,.?!")
        words = "|".join(quantity.words.get("en", ()))
        asked = re.search(rf"\b(?:{words})\b", rest)
        # What is joined before the quantity is a wish of its own.
        if asked is None or _JOINING.search(rest[: asked.start()]):
            continue
        objects = objects_of(rest[asked.end() :], scene)
        if not objects or tools[0] in objects:
            continue
        spots = tuple(f"{name}_{evidence.place}" for name in objects)
        for spot in spots:
            scene.symbols.resolve(spot)
        return Errand(quantity, tools[0], spots, objects)
    return None


def tooled() -> Iterator[tuple[Quantity, Evidence]]:
    """Quantities that no primitive reads, with the evidence that names their tool."""
    known = catalogue()
    every = [*MANUAL, *(each for each in known.values() if not each.identifiable)]
    for quantity in every:
        if quantity.id in known and known[quantity.id].identifiable:
            continue  # a package reads it
        for evidence in quantity.evidence:
            if evidence.tool:
                yield quantity, evidence


def objects_of(said: str, scene: Scene) -> tuple[str, ...]:
    """Objects that a phrase ends with, after the first of its prepositions that can be read: "of the
    water in both cups"."""
    for place in _BEFORE_THING.finditer(said):
        if _JOINING.search(said[: place.start()]):
            break
        phrase = said[place.end() :].strip()
        first, second = (quantified(id, phrase, scene) for id in ("mass", "friction"))
        # A wish within the phrase is the same whatever is asked of its objects.
        if first and first == second:
            return first
    return ()


def quantified(id: str, phrase: str, scene: Scene) -> tuple[str, ...]:
    """Objects of "the mass of (phrase)"; none where it asks for anything else."""
    try:
        found = ground(f"the {id} of {phrase}", scene)
    except (InputError, PlanRejected):
        return ()
    plain = not (found.remarks or found.cannot) and all(p.quantity == id for p in found.asked)
    return tuple(dict.fromkeys(one.object for one in found.asked)) if plain else ()
