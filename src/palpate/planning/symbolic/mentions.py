"""What the words of a request stand for: quantities, objects, "everything", and what marks their
roles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from palpate.mjcf.body import Body
from palpate.planning.symbolic import lexicon
from palpate.planning.symbolic.lexicon import (
    COLOURS,
    DETERMINERS,
    EVERY,
    STOP,
    name_words,
    singulars,
)
from palpate.quantities.quantity import QUANTITIES
from palpate.scene.scene import Scene

Kind = Literal[
    "quantity",
    "unmeasurable",
    "object",
    "unknown",
    "pronoun",
    "everything",
    "mark",
    "stop",
    "break",
    "list",
    "word",
]

GRIPPER = "gripper"
"""The subject of quantities that the empty hand itself has."""

WEAK = lexicon.word_set("place where level grip location")
"""Synonyms that are quantities only before "of", or, for "where", with nothing stronger in the
clause."""

_LINKS = lexicon.word_set("of for between is are was were does do did has have")


@dataclass(frozen=True, slots=True)
class Item:
    """A stretch of the request.

    Attributes:
        words: the stretch itself.
        names: what it may stand for: quantity ids, or bodies (several when it is ambiguous or a
            plural).
        plural: it means all of `names`. possessive: it is followed by `'s`.
    """

    kind: Kind
    words: tuple[str, ...]
    names: tuple[str, ...] = ()
    plural: bool = False

    @property
    def text(self) -> str:
        return " ".join(self.words)

    @property
    def links(self) -> bool:
        """Whether this word ties a quantity to the object after it."""
        return self.kind == "stop" and self.words[0] in _LINKS


class Words:
    """The words that name things in one scene."""

    def __init__(self, scene: Scene) -> None:
        self.bodies: Mapping[str, Body] = scene.bodies
        self._own = {name: name_words(name) for name in scene.bodies}
        self._all = {
            name: frozenset(w for phrase in body.words for w in phrase.split())
            | frozenset(self._own[name])
            for name, body in scene.bodies.items()
        }

    @cached_property
    def _phrases(self) -> dict[tuple[str, ...], str]:
        return {tuple(s.split()): q.id for q in QUANTITIES.values() for s in (*q.synonyms, q.id)}

    @cached_property
    def _lexicon(self) -> frozenset[str]:
        words = {word for said in self._all.values() for word in said}
        return frozenset(
            words | COLOURS | lexicon.OBJECT_NOUNS | lexicon.SURFACE_NOUNS | lexicon.GRIPPER_NOUNS
        )

    def items(self, tokens: Sequence[str]) -> list[Item]:
        """The request as items, in order."""
        found: list[Item] = []
        at = 0
        while at < len(tokens):
            item = self._item(tokens, at, found)
            found.append(item)
            at += len(item.words)
        return _merge_unknown(found)

    def _item(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item:
        word = tokens[at]
        if word.startswith("§"):
            return Item("mark", (word,))
        if word in ".;:?!":
            return Item("break", (word,))
        if word in (",", "and", "or", "plus"):
            return Item("list", (word,))
        return (
            self._named(tokens, at)
            or self._quantity(tokens, at)
            or self._mention(tokens, at, before)
            or self._plain(tokens, at)
        )

    def _named(self, tokens: Sequence[str], at: int) -> Item | None:
        """A body's whole name, longest first; a one-letter name needs no article's look-alike."""
        for name, own in sorted(self._own.items(), key=lambda pair: -len(pair[1])):
            joined = "".join(own)
            if tokens[at] == joined and joined not in STOP and len(own) > 1:
                return Item("object", (tokens[at],), (name,))
            if len(own) > 1 and tuple(tokens[at : at + len(own)]) == own:
                return Item("object", own, (name,))
        return None

    def _quantity(self, tokens: Sequence[str], at: int) -> Item | None:
        after_how = at > 0 and tokens[at - 1] == "how"
        for length in (3, 2, 1):
            phrase = tuple(tokens[at : at + length])
            for form in singulars(phrase[-1]):
                id = self._phrases.get((*phrase[:-1], form)) or self._phrases.get(
                    (singulars(phrase[0])[-1], *phrase[1:])
                )
                if id and _counts(
                    form if length == 1 else "", after_how, tokens[at + length : at + length + 1]
                ):
                    return Item("quantity", phrase, (id,), plural=form != phrase[-1])
        for form in singulars(tokens[at]):
            label = lexicon.UNMEASURABLE.get(form)
            if (
                label
                and (form not in lexicon.ADJECTIVES or after_how)
                and form not in self._lexicon
            ):
                return Item("unmeasurable", (tokens[at],), (label,))
        return None

    def _mention(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item | None:
        """The longest run of words that together fit some body; adjectives never stand apart from
        their noun."""
        run: list[str] = []
        if tokens[at] in STOP and not _is_determined(before):
            return None
        for word in tokens[at:]:
            if not any(form in self._lexicon for form in singulars(word)):
                break
            if run and not self._fits([*run, word]) and not all(w in COLOURS for w in run):
                break
            run.append(word)
        if not run:
            return None
        plural = _is_every(before) or run[-1] not in self._lexicon
        names = self._matching(run, plural)
        return Item("object" if names else "unknown", tuple(run), names, plural)

    def _fits(self, words: Sequence[str]) -> bool:
        return bool(self._matching(words, plural=False))

    def _matching(self, words: Iterable[str], plural: bool) -> tuple[str, ...]:
        words = tuple(words)
        exact = tuple(name for name, own in self._own.items() if words == own)
        if exact and not plural:
            return exact
        if words[-1] in lexicon.GRIPPER_NOUNS and not any(
            words[-1] in own for own in self._own.values()
        ):
            return (GRIPPER,)
        fits = [name for name in self.bodies if all(self._is_said(word, name) for word in words)]
        called = [
            name for name in fits if any(form in self._own[name] for form in singulars(words[-1]))
        ]
        return tuple(called or fits)

    def _is_said(self, word: str, name: str) -> bool:
        return any(
            form in self._all[name] or _is_class(form, self.bodies[name])
            for form in singulars(word)
        )

    def _plain(self, tokens: Sequence[str], at: int) -> Item:
        word = tokens[at]
        if word in ("everything", "anything", "whatever") or (
            word in EVERY and self._is_alone(tokens, at)
        ):
            return Item("everything", (word,))
        if word in lexicon.PRONOUNS and (
            word not in DETERMINERS or word in ("its", "their", "his", "her")
        ):
            return Item("pronoun", (word,))
        return Item(
            "stop"
            if word in STOP or word in DETERMINERS or word in EVERY or word == "'s"
            else "word",
            (word,),
        )

    def _is_alone(self, tokens: Sequence[str], at: int) -> bool:
        """Whether "all", "every" … has no object's noun after it: "all masses", "all that is
        missing"."""
        if tokens[at] not in ("all", "every", "each"):
            return False
        following = [
            t
            for t in tokens[at + 1 : at + 4]
            if t not in DETERMINERS and t not in ("of", "missing", "unknown")
        ]
        return not (following and any(form in self._lexicon for form in singulars(following[0])))


def _counts(synonym: str, after_how: bool, following: Sequence[str]) -> bool:
    """Whether a one-word synonym is a quantity here, and not an attribute ("the heavy box") or a
    verb."""
    if synonym in lexicon.ADJECTIVES:
        return after_how
    if synonym == "where":
        return True
    return synonym not in WEAK or list(following) == ["of"]


def _is_every(before: Sequence[Item]) -> bool:
    """Whether the words just before say "all of them"."""
    for item in reversed(before):
        if item.text in EVERY:
            return True
        if item.kind != "stop" or item.text not in DETERMINERS | {"of"}:
            return False
    return False


def _is_determined(before: Sequence[Item]) -> bool:
    """Whether the word just before makes a noun of the next: "the can", not "can you"."""
    return bool(before) and before[-1].text in DETERMINERS | EVERY


def _is_class(word: str, body: Body) -> bool:
    return word in (lexicon.OBJECT_NOUNS if body.role == "object" else lexicon.SURFACE_NOUNS)


def _merge_unknown(items: Sequence[Item]) -> list[Item]:
    """Runs of words that mean nothing here: beside an object they describe it, after a determiner,
    "of" or before `'s` they name something that the scene does not have."""
    merged: list[Item] = []
    for i, item in enumerate(items):
        if item.kind != "word":
            merged.append(item)
            continue
        if merged and merged[-1].kind == "unknown" and items[i - 1].kind == "word":
            merged[-1] = Item("unknown", (*merged[-1].words, *item.words))
            continue
        merged.append(Item("unknown", item.words))
    return [
        item
        for i, item in enumerate(merged)
        if item.kind != "unknown" or item.names or _stands(merged, i)
    ]


def _stands(items: Sequence[Item], at: int) -> bool:
    """Whether an unknown run stands for a thing of its own."""
    before = items[at - 1] if at else None
    after = items[at + 1] if at + 1 < len(items) else None
    if (after and after.kind == "object") or (
        before and before.kind in ("object", "unknown") and at > 0
    ):
        return False
    determined = before is not None and (
        before.text in DETERMINERS | EVERY
        or before.links
        or before.kind == "list"
        or before.kind in ("quantity", "unmeasurable")
    )
    return determined or (after is not None and after.text == "'s")
