"""Which unknown words of a request stand for something, and which cannot be left aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from palpate.planning.request.item import EDGE, Item
from palpate.planning.request.lexicon import DETERMINERS, EVERY


def understood(items: Sequence[Item]) -> tuple[list[Item], list[str]]:
    """The items that count, and the words among the others that nobody understood.

    An unknown word before an object that it cannot tell from another describes it ("the steel
    hammer") and may be left aside. One that stands for a thing of its own is kept.
    """
    kept: list[Item] = []
    unread: list[str] = []
    padded = [EDGE, *items, EDGE]
    for at, item in enumerate(items, 1):
        before, after = padded[at - 1], padded[at + 1]
        if item.kind == "filler":
            if _is_owner(padded[:at]):
                kept.append(replace(item, kind="unknown"))
            else:
                kept.append(replace(item, kind="stop"))
        elif item.kind == "aside":
            kept.append(replace(item, kind="stop"))
        elif item.kind != "unknown" or _stands(before, after):
            kept.append(item)
        elif not _describes(after):
            unread.append(item.text)
    return kept, unread


def _is_owner(before: Sequence[Item]) -> bool:
    """Whether a property was named right before, and a word that ties it to this: "the weight of
    the"."""
    rest = list(before)
    while rest and rest[-1].text in DETERMINERS | EVERY:
        rest.pop()
    linked = bool(rest) and rest[-1].links
    return linked and len(rest) > 1 and rest[-2].of_quantity


def _describes(after: Item) -> bool:
    """Whether what follows is one object, whatever is said of it."""
    return after.kind == "object" and len(after.fitting) <= 1


def _stands(before: Item, after: Item) -> bool:
    """Whether an unknown run between these two names something that the scene does not have.

    After a determiner, "of", a list or a quantity, or before `'s`, it stands for a thing of its
    own ("the mass of the spoon"); beside an object it does not.
    """
    if after.kind == "object" or before.kind in ("object", "unknown"):
        return False
    if after.text == "'s":
        return True
    determined = before.text in DETERMINERS | EVERY
    return determined or before.links or before.kind == "list" or before.of_quantity
