"""What the words of a request stand for: quantities, objects, "everything", and what marks their
roles."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from palpate.mjcf.body import Body
from palpate.planning.symbolic import lexicon
from palpate.planning.symbolic.lexicon import COLOURS, DETERMINERS, EVERY, STOP
from palpate.planning.symbolic.tokens import is_within, name_words, singulars
from palpate.quantities.catalogue import catalogue
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

LONGEST_PHRASE = 7
"""Words of the longest synonym of a quantity: "centre of mass in all three axes"."""


@dataclass(frozen=True, slots=True)
class Item:
    """A stretch of the request.

    Attributes:
        words: the stretch itself.
        names: what it may stand for: quantity ids, or bodies (several when it is ambiguous or a
            plural).
        plural: it means all of `names`.
    """

    kind: Kind
    words: tuple[str, ...]
    names: tuple[str, ...] = ()
    plural: bool = False

    @property
    def text(self) -> str:
        """The stretch as it was said."""
        return " ".join(self.words)

    @property
    def links(self) -> bool:
        """Whether this word ties a quantity to the object after it."""
        return self.kind == "stop" and self.words[0] in lexicon.LINKS

    @property
    def of_quantity(self) -> bool:
        """Whether it names a property, measurable or not."""
        return self.kind in ("quantity", "unmeasurable")


class Words:
    """The words that name things in one scene."""

    def __init__(self, scene: Scene) -> None:
        self._own = {name: name_words(name) for name in scene.bodies}
        self._said = {name: self._said_of(body) for name, body in scene.bodies.items()}
        self._nouns = _NOUNS.union(*self._said.values())
        self._named: dict[tuple[str, ...], list[str]] = defaultdict(list)
        for name, own in self._own.items():
            self._named[own].append(name)
        several = [own for own in self._named if len(own) > 1]
        self._long_names = sorted(several, key=len, reverse=True)
        self._phrases = _phrases()

    def items(self, tokens: Sequence[str]) -> list[Item]:
        """The request as items, in order."""
        found: list[Item] = []
        at = 0
        while at < len(tokens):
            item = self._item(tokens, at, found)
            found.append(item)
            at += len(item.words)
        return _without_fillers(_joined(found))

    def _item(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item:
        word = tokens[at]
        if word.startswith("§"):
            return Item("mark", (word,))
        if word in ".;:?!":
            return Item("break", (word,))
        if word in lexicon.LIST:
            return Item("list", (word,))
        return (
            self._whole_name(tokens, at)
            or self._quantity(tokens, at)
            or self._unmeasurable(tokens, at)
            or self._mention(tokens, at, before)
            or self._plain(tokens, at)
        )

    def _said_of(self, body: Body) -> frozenset[str]:
        """Every word that may be said of a body: of its name, its looks and its kind."""
        said = set(self._own[body.name])
        for phrase in body.words:
            said.update(phrase.split())
        return _KIND_NOUNS[body.role] | said

    def _whole_name(self, tokens: Sequence[str], at: int) -> Item | None:
        """A body's name of several words, the longest first, together or apart: "redbox", "red
        box".

        A name of one word is a noun like others, for its article tells it from a look-alike: "the
        can", "can you".
        """
        for own in self._long_names:
            names = (self._named[own][0],)
            joined = "".join(own)
            if tokens[at] == joined and joined not in STOP:
                return Item("object", (joined,), names)
            if tuple(tokens[at : at + len(own)]) == own:
                return Item("object", own, names)
        return None

    def _quantity(self, tokens: Sequence[str], at: int) -> Item | None:
        """The longest synonym of a quantity at this place, in the singular or the plural."""
        longest = min(LONGEST_PHRASE, len(tokens) - at)
        for length in range(longest, 0, -1):
            phrase = tuple(tokens[at : at + length])
            for last in singulars(phrase[-1]):
                id = self._quantity_called(phrase, last)
                if id and (length > 1 or _counts(last, tokens, at)):
                    return Item("quantity", phrase, (id,), plural=last != phrase[-1])
        return None

    def _quantity_called(self, phrase: tuple[str, ...], last: str) -> str | None:
        """The quantity that `phrase` is a synonym of, with its `last` or its first word in the
        singular: "balance points", "moments of inertia"."""
        first = singulars(phrase[0])[-1]
        found = self._phrases.get((*phrase[:-1], last))
        return found or self._phrases.get((first, *phrase[1:]))

    def _unmeasurable(self, tokens: Sequence[str], at: int) -> Item | None:
        """A property that nothing here can measure: "temperature", "how hot"."""
        for form in singulars(tokens[at]):
            label = lexicon.UNMEASURABLE.get(form)
            if label is None or form in self._nouns:
                continue
            if form not in lexicon.ADJECTIVES or _after_how(tokens, at):
                return Item("unmeasurable", (tokens[at],), (label,))
        return None

    def _mention(self, tokens: Sequence[str], at: int, before: Sequence[Item]) -> Item | None:
        """The longest run of words that together fit some body; adjectives never stand apart from
        their noun."""
        if tokens[at] in STOP and not _is_determined(before):
            return None
        run = self._run(tokens[at:])
        if not run:
            return None
        plural = _is_every(before) or self._is_plural(run[-1])
        names = self._matching(run, plural)
        return Item("object" if names else "unknown", run, names, plural)

    def _run(self, tokens: Sequence[str]) -> tuple[str, ...]:
        run: tuple[str, ...] = ()
        for word in tokens:
            if not self._is_noun(word):
                break
            longer = (*run, word)
            # "light" alone may fit nothing; what counts is whether "light blue box" does.
            if run and not COLOURS.issuperset(run) and not self._matching(longer, plural=False):
                break
            run = longer
        return run

    def _is_noun(self, word: str) -> bool:
        return any(form in self._nouns or self._is_within(form) for form in singulars(word))

    def _is_plural(self, word: str) -> bool:
        """Whether a noun is known in the singular alone."""
        return word not in self._nouns and not self._is_within(word)

    def _is_within(self, noun: str) -> bool:
        """Whether some body's name is a compound of the noun."""
        return any(self._is_compound(name, (noun,)) for name in self._own)

    def _is_compound(self, name: str, forms: Sequence[str]) -> bool:
        """Whether a part of the body's name is a compound of one of a noun's forms."""
        nouns = [form for form in forms if form not in STOP]
        return any(is_within(noun, part) for part in self._own[name] for noun in nouns)

    def _matching(self, words: tuple[str, ...], plural: bool) -> tuple[str, ...]:
        """The bodies that `words` may mean: the one called exactly so, else those whose name has
        the noun, or a compound of it, else those of which all words may be said."""
        exact = self._named.get(words)
        if exact and not plural:
            return tuple(exact)
        if self._is_gripper(words[-1]):
            return (GRIPPER,)
        fitting = [name for name in self._own if self._fits(name, words)]
        noun = singulars(words[-1])
        called = [name for name in fitting if self._is_called(name, noun)]
        return tuple(called or fitting)

    def _is_called(self, name: str, forms: Sequence[str]) -> bool:
        """Whether a body's name has a noun in one of its forms, or a compound of it."""
        return not set(self._own[name]).isdisjoint(forms) or self._is_compound(name, forms)

    def _is_gripper(self, noun: str) -> bool:
        """Whether the noun means the robot's hand, and no body of the scene is called so."""
        taken = any(noun in own for own in self._own.values())
        return noun in lexicon.GRIPPER_NOUNS and not taken

    def _fits(self, name: str, words: tuple[str, ...]) -> bool:
        """Whether each of `words` may be said of the body."""
        said = self._said[name]
        for word in words:
            forms = singulars(word)
            if said.isdisjoint(forms) and not self._is_compound(name, forms):
                return False
        return True

    def _plain(self, tokens: Sequence[str], at: int) -> Item:
        """A word that names nothing by itself."""
        word = tokens[at]
        if word in lexicon.EVERYTHING or self._is_all(tokens, at):
            return Item("everything", (word,))
        if word in lexicon.PRONOUNS:
            return Item("pronoun", (word,))
        if word in _FILLERS:
            return Item("stop", (word,))
        return Item("word", (word,))

    def _is_all(self, tokens: Sequence[str], at: int) -> bool:
        """Whether "all", "every" … has no object's noun after it: "all masses", "all that is
        missing"."""
        if tokens[at] not in ("all", "every", "each"):
            return False
        for word in tokens[at + 1 : at + 4]:
            if word not in DETERMINERS and word not in ("of", "missing", "unknown"):
                return not self._is_noun(word)
        return True


_KIND_NOUNS: Mapping[str, frozenset[str]] = {
    "object": lexicon.OBJECT_NOUNS,
    "surface": lexicon.SURFACE_NOUNS,
}
_NOUNS = COLOURS.union(lexicon.OBJECT_NOUNS, lexicon.SURFACE_NOUNS, lexicon.GRIPPER_NOUNS)
"""Words that may belong to the name of a thing in any scene."""
_FILLERS = STOP | DETERMINERS | EVERY | {"'s"}
_EDGE = Item("break", ("",))
"""What stands before the first item and after the last."""


def _phrases() -> dict[tuple[str, ...], str]:
    """The words of every synonym to the id of its quantity."""
    phrases: dict[tuple[str, ...], str] = {}
    for quantity in catalogue().values():
        for synonym in (*quantity.words.get("en", ()), quantity.id):
            phrases[tuple(synonym.split())] = quantity.id
    return phrases


def _after_how(tokens: Sequence[str], at: int) -> bool:
    return at > 0 and tokens[at - 1] == "how"


def _counts(synonym: str, tokens: Sequence[str], at: int) -> bool:
    """Whether a one-word synonym is a quantity here, and not an attribute ("the heavy box") or a
    verb ("place it")."""
    following = tokens[at + 1 : at + 2]
    if not following:
        return True  # nothing is left that it could describe or act on
    if synonym in lexicon.ADJECTIVES:
        return _after_how(tokens, at)
    if synonym == "where":
        return True
    return synonym not in lexicon.WEAK or following[0] == "of"


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


def _joined(items: Sequence[Item]) -> list[Item]:
    """Runs of words that mean nothing here as one unknown item each."""
    joined: list[Item] = []
    for before, item in zip([_EDGE, *items], items, strict=False):
        if item.kind != "word":
            joined.append(item)
        elif before.kind == "word":
            joined[-1] = Item("unknown", (*joined[-1].words, *item.words))
        else:
            joined.append(Item("unknown", item.words))
    return joined


def _without_fillers(items: Sequence[Item]) -> list[Item]:
    """The items without those unknown words that only describe or fill."""
    padded = [_EDGE, *items, _EDGE]
    kept: list[Item] = []
    for before, item, after in zip(padded, items, padded[2:], strict=False):
        if item.kind != "unknown" or _stands(before, after):
            kept.append(item)
    return kept


def _stands(before: Item, after: Item) -> bool:
    """Whether an unknown run between these two names something that the scene does not have.

    Beside an object it describes it ("the steel hammer"); after a determiner, "of", a list or a
    quantity, or before `'s`, it stands for a thing of its own ("the mass of the spoon").
    """
    if after.kind == "object" or before.kind in ("object", "unknown"):
        return False
    if after.text == "'s":
        return True
    determined = before.text in DETERMINERS | EVERY
    return determined or before.links or before.kind == "list" or before.of_quantity
