"""Lattice of a sentence: the classes of `words/grammar.txt` to which each word may belong.

A word may be several things, a noun and a verb; the grammar tells which. A word that is nothing of
all that is unknown, and no part of any reading but of one that names a thing which is not there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

from palpate.planning.request.nouns import Nouns
from palpate.planning.request.sentence.grammar import Meanings, literals
from palpate.planning.request.sentence.query import Quantity
from palpate.planning.request.tokens import lemmas, nearest_spelling, singulars
from palpate.planning.request.wording import Phrase, english, longest
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene

SHORTEST = 3
"""Words of the shortest background sentence."""
LONGEST_NAME = 6
"""Words of the longest name of a body that is put together of its words."""
_NO_NOUNS = frozenset({"place", "where", "level", "weigh", "lean"})
"""Synonyms of quantities that sentences use for other things, too; `words/grammar.txt` has them."""

Edge = tuple[str, int, Meanings]
"""A class, the place where its words end, and what they mean."""


class Lattice:
    """The words that requests about one scene may use.

    Attributes:
        nouns: of its bodies.
    """

    def __init__(self, scene: Scene, colours: frozenset[str]) -> None:
        self.nouns = Nouns(scene, colours)
        self._quantities = _quantities()
        self._longest = longest(self._quantities)

    def edges(self, tokens: Sequence[str]) -> list[dict[str, list[tuple[int, Meanings]]]]:
        """Lattice edges that begin at each word."""
        lattice: list[dict[str, list[tuple[int, Meanings]]]] = []
        for at, token in enumerate(tokens):
            begins: dict[str, list[tuple[int, Meanings]]] = {token: [(at + 1, ())]}
            for kind, end, meanings in self._edges(tokens, at):
                begins.setdefault(kind, []).append((end, meanings))
            lattice.append(begins)
        return lattice

    def unfelt(self, tokens: Sequence[str]) -> Quantity | None:
        """The first property among the words that nothing measures."""
        for at in range(len(tokens)):
            for _, _, (quantity, *_) in self._properties(tokens, at):
                if isinstance(quantity, Quantity) and not quantity.measurable:
                    return quantity
        return None

    def slips(self, tokens: Sequence[str]) -> dict[str, str]:
        """Known spelling of each unknown token."""
        sets = english().sets
        known = self.nouns.names | {word for phrase in self._quantities for word in phrase}
        known = {word for word in known - _NO_NOUNS | sets["often"] if word.isalpha()}
        found: dict[str, str] = {}
        for token in dict.fromkeys(tokens):
            if self.is_unknown(token) and token not in sets["things"]:
                meant = nearest_spelling(token, known)
                if meant is not None:
                    found[token] = meant
        return found

    def is_unknown(self, token: str) -> bool:
        """Test for a word that is nothing at all here."""
        if not token.isalpha() or self.nouns.known(token):
            return False
        return _small_words().isdisjoint([*lemmas(token), *singulars(token)])

    def is_background(self, tokens: Sequence[str]) -> bool:
        """Test for a sentence that states facts and asks for nothing: "It is for a benchmark.",
        "Everything else is right."."""
        if "?" in tokens or len(tokens) < SHORTEST:
            return False
        sets = english().sets
        words = {token for token in tokens if token.isalpha()}
        allowed = sets["harmless"]
        if words & sets["remaining"]:
            # "And the rest, too" asks for it; "the rest of my model is right" does not.
            if words.isdisjoint(sets["settled"]):
                return False
            allowed = allowed | sets["remaining"] | sets["settled"]
        return all(
            token in allowed or self._says_nothing(tokens, at)
            for at, token in enumerate(tokens)
            if token.isalpha() or token.startswith("§")
        )

    def _says_nothing(self, tokens: Sequence[str], at: int) -> bool:
        """Test for a word that names no body and no property, and neither asks nor excludes."""
        token = tokens[at]
        if token in english().sets["telling"] or not token.isalpha() or token in english().compared:
            return False
        named = self.nouns.meant((token,), True) and not self.nouns.otherwise((token,))
        if named or not self.nouns.names.isdisjoint(singulars(token)):
            return False
        return not any(True for _ in self._properties(tokens, at))

    def _edges(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        named = any(end > at + 1 for _, end, _ in self._whole_names(tokens, at))
        for edge in _words(tokens, at):
            if not (named and edge[0] in ("SEL", "NADJ")):  # "the large parcel" may be its name
                yield edge
        yield from self._properties(tokens, at)
        yield from self._whole_names(tokens, at)
        yield from self._runs(tokens, at)
        absent = self._absent(tokens, at)
        if absent:
            yield "ABSENT", at + len(absent), (absent,)

    def _properties(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """The longest synonym of a quantity, and properties that nothing measures."""
        for length in range(min(self._longest, len(tokens) - at), 0, -1):
            phrase = tuple(tokens[at : at + length])
            if phrase in self._quantities:
                id, plural = self._quantities[phrase]
                quantity = Quantity(id, " ".join(phrase))
                adjective = phrase[0] in english().sets["adjectives"]
                yield "ADJQ" if adjective else "QUANT", at + length, (quantity,)
                if plural:
                    yield "QUANTS", at + length, (quantity,)
                return
        word = tokens[at]
        if self.nouns.known(word):
            return
        if word in english().labels["asked"]:
            yield "ADJQ", at + 1, (Quantity(english().labels["asked"][word], word),)
            return
        for form in singulars(word):
            label = english().labels["unfelt"].get(form)
            if label is not None:
                kind = "ADJQ" if form in english().sets["adjectives"] else "QUANT"
                yield kind, at + 1, (Quantity(label, word, measurable=False),)
                return

    def _whole_names(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Names of several words, together or apart: "redbox", "red box"; and those of one that was
        said in two, "note book"."""
        for own in self.nouns.named:
            if len(own) > 1 and tokens[at] == "".join(own):
                yield "OBJ", at + 1, (own,)
            elif len(own) > 1 and tuple(tokens[at : at + len(own)]) == own:
                yield "OBJ", at + len(own), (own,)
        two = "".join(tokens[at : at + 2])
        if len(tokens) > at + 1 and (two,) in self.nouns.named:
            yield "OBJ", at + 2, ((two,),)

    def _runs(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Runs of words that name things of the scene."""
        for end in range(at + 1, min(at + LONGEST_NAME, len(tokens)) + 1):
            run = list(tokens[at:end])
            if not self.nouns.known(run[-1]):
                return
            if self.nouns.colours.issuperset(run) or self._tells(run):
                yield "COLOUR", end, (tuple(run),)
            elif len(run) > 1 and not self.nouns.meant(tuple(run), plural=True):
                run = [*run[1:], run[0]]  # adjectives behind their noun: "caja roja"
            words, noun = tuple(run), run[-1]
            whole = words in self.nouns.named
            if self.nouns.meant(words, plural=True) and not (whole and len(run) > 1):
                plural = noun in english().sets["collective"] or not self.nouns.singular(noun)
                yield ("OBJS" if plural and not whole else "OBJ"), end, (words,)

    def _tells(self, run: Sequence[str]) -> bool:
        """Test for an adjective in the names of bodies: "the plastic one"."""
        return len(run) == 1 and run[0] in english().sets["describing"] & self.nouns.names

    def _absent(self, tokens: Sequence[str], at: int) -> Phrase:
        """The longest run that names a thing which is not there."""
        run: list[str] = []
        fits = True
        for token in tokens[at : at + 2]:
            unknown = self.is_unknown(token)
            if not (unknown or self.nouns.known(token)):
                break
            run.append(token)
            fits = fits and not unknown
        if not run or (fits and (self.nouns.meant(tuple(run), True) or len(run) == 1)):
            return ()
        return tuple(run)


def _words(tokens: Sequence[str], at: int) -> Iterator[Edge]:
    """The classes of `words/en.yaml` that words here are of."""
    said, word = english(), tokens[at]
    for end in range(at + 1, min(at + _longest_class(), len(tokens)) + 1):
        for kind, meanings in said.classes.get(tuple(tokens[at:end]), ()):
            yield kind, end, meanings
    stems = (*lemmas(word), said.labels["irregular"].get(word, word))
    inflected = word.endswith("ing") or (at > 0 and tokens[at - 1] in ("be", "been"))
    if not said.sets["frame"].isdisjoint(stems if inflected else (word,)):
        yield "FILL", at + 1, ()
    verbs = [stem for stem in stems if stem in deeds()]
    if verbs:
        yield "DEED", at + 1, (verbs[0],)
    if word == "§amount":
        yield "AMOUNT", at + 1, ()
    if word in said.compared:
        kind = "SUPQ" if word.endswith("st") else "CMPQ"
        yield kind, at + 1, (Quantity(said.compared[word], word),)


@cache
def deeds() -> frozenset[str]:
    """Verbs of actions."""
    return english().sets["deeds"].union(english().purposes)


@cache
def _small_words() -> frozenset[str]:
    """Words that have a meaning in any scene."""
    said = english()
    known = {word for phrase in (*said.classes, *_quantities()) for word in phrase}
    sets = [words for name, words in said.sets.items() if name != "things"]
    return frozenset(known).union(literals(), *sets, *said.labels.values())


@cache
def _longest_class() -> int:
    return longest(english().classes)


def _quantities() -> dict[Phrase, tuple[str, bool]]:
    """The words of every synonym to the id of its quantity, and whether they are plural, in their
    first or last word."""
    phrases: dict[Phrase, tuple[str, bool]] = {}
    for quantity in catalogue().values():
        for synonym in {*quantity.words.get("en", ()), quantity.id} - _NO_NOUNS:
            *others, last = synonym.split()
            phrases[*others, last] = quantity.id, False
            phrases[*others, _plural(last)] = quantity.id, True
            if others:
                phrases[_plural(others[0]), *others[1:], last] = quantity.id, True
    return phrases


def _plural(word: str) -> str:
    return word + ("es" if word.endswith("s") else "s")
