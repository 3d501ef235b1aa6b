"""Lattice of a sentence: the classes of `words/grammar.txt` to which each word may belong.

A word may be several things, a noun and a verb; the grammar tells which. A word that is nothing of
all that is unknown, and no part of any reading but of one that names a thing which is not there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import cast

from palpate.planning.request import lexicon
from palpate.planning.request.lexicon import COLOURS
from palpate.planning.request.nouns import Nouns
from palpate.planning.request.sentence.chart import Meanings
from palpate.planning.request.sentence.grammar import grammar
from palpate.planning.request.sentence.meaning import Quantity
from palpate.planning.request.sentence.remarks import remarks
from palpate.planning.request.tokens import forms, nearest_spelling, singulars
from palpate.planning.request.wording import Phrase, english, longest
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene

SHORTEST = 3
"""Words of the shortest background sentence."""

Edge = tuple[str, int, Meanings]
"""A class, the place where its words end, and what they mean."""


class Lattice:
    """The words that requests about one scene may use.

    Attributes:
        nouns: of its bodies.
    """

    def __init__(self, scene: Scene, colours: frozenset[str] = COLOURS) -> None:
        self.nouns = Nouns(scene, colours)
        self._english = colours == COLOURS  # in English, whose small words are all known
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

    def unknown(self, tokens: Sequence[str]) -> list[str]:
        """The words that are nothing at all here."""
        return [token for token in dict.fromkeys(tokens) if self._is_unknown(token)]

    def unfelt(self, tokens: Sequence[str]) -> Quantity | None:
        """The first property among the words that nothing measures."""
        for at in range(len(tokens)):
            for _, _, meanings in self._properties(tokens, at):
                for one in meanings:
                    if isinstance(one, Quantity) and not one.measurable:
                        return one
        return None

    def slips(self, tokens: Sequence[str]) -> dict[str, str]:
        """Known spelling of each unknown token."""
        known = self.nouns.names | {word for phrase in self._quantities for word in phrase}
        known = (known - lexicon.NO_NOUNS) | english().often | {"weigh"}
        known = {word for word in known if word.isalpha()}
        found: dict[str, str] = {}
        for token in self.unknown(tokens):
            meant = nearest_spelling(token, known)
            if meant is not None and token not in english().things:
                found[token] = meant
        return found

    def _is_unknown(self, token: str) -> bool:
        if token in _small_words() or token.startswith("§") or not token.isalpha():
            return False
        if self.nouns.known(token) or token in _quantitative():
            return False
        if not _parts().isdisjoint(singulars(token)):
            return False
        said = english()
        known = said.single | said.irregular.keys() | said.numbers.keys()
        return not any(lemma in known for lemma, _ in forms(token))

    def _edges(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        named = any(end > at + 1 for _, end, _ in self._whole_names(tokens, at))
        for edge in _words(tokens, at):
            if not (named and edge[0] == "SEL"):  # "the large parcel" may be its name
                yield edge
        yield from self._properties(tokens, at)
        yield from _comparing(tokens, at)
        yield from self._things(tokens, at)
        if self._english:
            yield from remarks(tokens, at, self._says_nothing, self._bears, self._asks)

    def _says_nothing(self, tokens: Sequence[str], at: int) -> bool:
        """Test for a word that names no body and no property, and neither asks nor excludes."""
        token = tokens[at]
        if token in english().telling or not token.isalpha() or token in _quantitative():
            return False
        named = self.nouns.meant((token,), True) and not self.nouns.otherwise((token,))
        if named or not self.nouns.names.isdisjoint(singulars(token)):
            return False
        return not any(True for _ in self._properties(tokens, at))

    def is_background(self, tokens: Sequence[str]) -> bool:
        """Test for a sentence that states facts and asks for nothing: "It is for a benchmark.",
        "Everything else is right."."""
        if "?" in tokens or len(tokens) < SHORTEST:
            return False
        words = {token for token in tokens if token.isalpha()}
        allowed = english().harmless
        if words & english().remaining:
            # "And the rest, too" asks for it; "the rest of my model is right" does not.
            if words.isdisjoint(english().settled):
                return False
            allowed = allowed | english().remaining | english().settled
        for at, token in enumerate(tokens):
            if token.isalpha() and token not in allowed and not self._says_nothing(tokens, at):
                return False
        return True

    def _bears(self, tokens: Sequence[str], at: int) -> bool:
        """Test for a word that neither asks nor excludes in a clause of reason or time."""
        bearing = tokens[at] in english().bearing and not self._asks(tokens, at)
        return bearing or self._says_nothing(tokens, at)

    def _asks(self, tokens: Sequence[str], at: int) -> bool:
        """Test for a word that asks for something, or names a body."""
        named = not self.nouns.names.isdisjoint(singulars(tokens[at]))
        asks = tokens[at] in english().asking
        return named or asks or any(True for _ in self._properties(tokens, at))

    def _properties(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """The longest synonym of a quantity, and properties that nothing measures."""
        for length in range(min(self._longest, len(tokens) - at), 0, -1):
            phrase = tuple(tokens[at : at + length])
            found = list(self._called(phrase, at + length))
            if found:
                yield from found
                return
        word = tokens[at]
        if self.nouns.known(word):
            return
        asked = english().asked.get(word, "")
        if asked in catalogue():
            yield "ADJQ", at + 1, (Quantity(asked, word),)
            return
        for form in singulars(word):
            label = lexicon.UNMEASURABLE.get(form)
            if label is not None:
                kind = "ADJQ" if form in lexicon.ADJECTIVES else "QUANT"
                yield kind, at + 1, (Quantity(label, word, measurable=False),)
                return

    def _called(self, phrase: Phrase, end: int) -> Iterator[Edge]:
        """The quantity that `phrase` is a synonym of, in the singular or the plural of its first or
        last word."""
        for last in singulars(phrase[-1]):
            first = singulars(phrase[0])[-1] if len(phrase) > 1 else last
            id = self._quantities.get((*phrase[:-1], last)) or self._quantities.get(
                (first, *phrase[1:])
            )
            if id is None:
                continue
            quantity = (Quantity(id, " ".join(phrase)),)
            if not lexicon.ADJECTIVES.isdisjoint(phrase[:1]):
                yield "ADJQ", end, quantity
            else:
                yield "QUANT", end, quantity
            if id == "com":
                yield "CENTRE", end, ()
            return

    def _things(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Every run of words that names things of the scene, and one that names what it lacks."""
        yield from self._whole_names(tokens, at)
        yield from self._runs(tokens, at)
        yield from self._described(tokens, at)
        yield from self._made(tokens, at)
        absent = self._absent(tokens, at)
        if absent:
            yield "ABSENT", at + len(absent), (absent,)

    def _described(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """ "The steel hammer", where no other hammer is."""
        describes = tokens[at] in english().describing and not self.nouns.known(tokens[at])
        if not describes or at + 1 == len(tokens):
            return
        for kind, end, meanings in self._things(tokens, at + 1):
            if kind == "OBJ" and len(self.nouns.fitting(tuple(tokens[at + 1 : end]))) <= 1:
                yield kind, end, meanings

    def _made(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """ "The bottle made of glass": one whose name says so, or the only one."""
        for kind, end, meanings in [*self._whole_names(tokens, at), *self._runs(tokens, at)]:
            run = cast("Phrase", meanings[0])
            behind = tuple(tokens[end : end + 3])
            material = english().materials.get(behind[-1] if behind else "", "")
            if kind != "OBJ" or behind[:2] != ("made", "of") or not material:
                continue
            told = [(word, *run) for word in (material, behind[-1])]
            named = [words for words in told if self.nouns.fitting(words)]
            if named or len(self.nouns.fitting(run)) == 1:
                yield "OBJ", end + 3, (named[0] if named else run,)

    def _whole_names(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Names of several words, together or apart: "redbox", "red box"; and those of one that was
        said in two, "note book"."""
        for own in self.nouns.named:
            if len(own) > 1 and tokens[at] == "".join(own):
                yield "OBJ", at + 1, (own,)
            elif len(own) > 1 and tuple(tokens[at : at + len(own)]) == own:
                yield "OBJ", at + len(own), (own,)
        two = tuple(tokens[at : at + 2])
        if len(two) == 2 and ("".join(two),) in self.nouns.named:
            yield "OBJ", at + 2, (("".join(two),),)

    def _runs(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        for end in range(at + 1, len(tokens) + 1):
            run = tuple(tokens[at:end])
            if not self.nouns.known(run[-1]):
                return
            if self.nouns.colours.issuperset(run) or self._tells(run):
                yield "COLOUR", end, (run,)
            elif self._is_behind(run):
                run = (*run[1:], run[0])
            if self.nouns.meant(run, plural=True):
                plural = not self.nouns.singular(run[-1]) or run[-1] in english().collective
                if self.nouns.names.isdisjoint([run]) or run not in self.nouns.named:
                    yield ("OBJS" if plural else "OBJ"), end, (run,)
                elif len(run) == 1:
                    yield "OBJ", end, (run,)

    def _tells(self, run: Phrase) -> bool:
        """Test for an adjective in the names of bodies: "the plastic one"."""
        return len(run) == 1 and run[0] in english().describing and run[0] in self.nouns.names

    def _is_behind(self, run: Phrase) -> bool:
        """Test for adjectives behind their noun, as in Spanish: "caja roja"."""
        if len(run) == 1 or self.nouns.meant(run, plural=True):
            return False
        return self.nouns.colours.issuperset(run[1:]) or not self._english

    def _absent(self, tokens: Sequence[str], at: int) -> Phrase:
        """The longest run that names a thing which is not there."""
        run: list[str] = []
        fits = True
        for token in tokens[at : at + 5]:
            unknown = self._is_unknown(token)
            if not (unknown or self.nouns.known(token)) or token in english().selecting:
                break
            if token in english().turning:
                break
            run.append(token)
            fits = fits and not unknown
        if fits and run and self._is_behind(tuple(run)):
            run = [*run[1:], run[0]]
        if not run or (
            fits and (self.nouns.meant(tuple(run), True) or self.nouns.colours.issuperset(run))
        ):
            return ()
        return tuple(run)


def _words(tokens: Sequence[str], at: int) -> Iterator[Edge]:
    """The classes of `words/en.yaml` that words here are of, inflected or not."""
    said = english()
    irregular = said.irregular.get(tokens[at])
    most = _longest_class()
    for lemma, tag in (*forms(tokens[at]), *([irregular] if irregular else [])):
        for length in range(1, most + 1):
            phrase = (lemma, *tokens[at + 1 : at + length])
            if len(phrase) < length:
                break
            for kind, inflects in said.classes.get(phrase, ()):
                if inflects:
                    valued = (lemma,) if kind in _VALUED else ()
                    yield kind + tag, at + length, valued
                elif lemma == tokens[at] or (kind in _PLURAL and tag == "_S"):
                    yield kind, at + length, (" ".join(phrase),) if kind in _VALUED else ()
    for length in range(_longest_relation(), 0, -1):
        phrase = tuple(tokens[at : at + length])
        if phrase in said.relations:
            yield "REL", at + len(phrase), (said.relations[phrase],)
            break
    if tokens[at] in said.selecting:
        yield "SEL", at + 1, (said.selecting[tokens[at]],)
    if tokens[at] in said.numbers:
        yield "NUM", at + 1, (said.numbers[tokens[at]],)
    if tokens[at] in ("§amount", "§mass"):
        yield "AMOUNT", at + 1, ()
    if tokens[at] == "§mass":
        yield "MASS", at + 1, ()


def _comparing(tokens: Sequence[str], at: int) -> Iterator[Edge]:
    """Words that compare: "heavier", "heaviest"."""
    word = tokens[at]
    id = english().compared.get(word, "")
    if id in catalogue():
        kind = "SUPQ" if word in english().superlatives else "CMPQ"
        yield kind, at + 1, (Quantity(id, word),)


_PLURAL = frozenset({"NNOUN", "WORLD"})
"""Classes of nouns."""
_VALUED = frozenset({"DEED", "HANDLE", "STATE"})


@cache
def _small_words() -> frozenset[str]:
    """Words of the grammar itself, and words that select one of several things."""
    said = english()
    rules = [rule for rules in grammar().named.values() for rule in rules]
    literals = {part for rule in rules for part in rule.parts}
    relating = {word for phrase in said.relations for word in phrase}
    return frozenset(literals | relating | said.selecting.keys() | said.describing)


@cache
def _quantitative() -> frozenset[str]:
    """Words that compare things, or ask for what they are like."""
    said = english()
    return frozenset([*said.compared, *said.asked, *lexicon.UNMEASURABLE])


@cache
def _longest_class() -> int:
    return longest(english().classes)


@cache
def _longest_relation() -> int:
    return longest(english().relations)


@cache
def _parts() -> frozenset[str]:
    """Words of the synonyms of quantities."""
    phrases = [s for q in catalogue().values() for s in q.words.get("en", ())]
    return frozenset(word for phrase in phrases for word in phrase.split())


def _quantities() -> dict[Phrase, str]:
    """The words of every synonym to the id of its quantity."""
    phrases: dict[Phrase, str] = {}
    for quantity in catalogue().values():
        for synonym in (*quantity.words.get("en", ()), quantity.id):
            if synonym not in lexicon.NO_NOUNS:
                phrases[tuple(synonym.split())] = quantity.id
    return phrases
