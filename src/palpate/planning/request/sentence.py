"""Lattice of a sentence, and its cover by clauses of the grammar."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, islice, product
from typing import cast

from palpate.estimation.quantities.catalogue import catalogue
from palpate.planning.request.grammar import ACTIONS, MOST, DerivationChart, Meanings, literals
from palpate.planning.request.query import Act, Aside, Mention, NamedPurpose, NamedQuantity, Say
from palpate.planning.request.selection import Nouns
from palpate.planning.request.words import (
    Phrase,
    english,
    lemmas,
    longest,
    nearest_spelling,
    singulars,
)
from palpate.scene.scene import Scene

SHORTEST = 3
"""Minimum number of words of a background sentence."""
LONGEST_NAME = 6
"""Maximum number of words that describe a body."""
_NO_NOUNS = frozenset({"place", "where", "level", "weigh", "lean"})
"""Synonyms of quantities with other frequent uses; `words/grammar.txt` covers them."""

Edge = tuple[str, int, Meanings]
"""Class, end position of its words, and meanings."""


class Lattice:
    """Words that requests about one scene may use.

    Attributes:
        nouns: nouns of its bodies.
    """

    def __init__(self, scene: Scene, colours: frozenset[str]) -> None:
        self.nouns = Nouns(scene, colours)
        self._quantities = _quantities()
        self._longest = longest(self._quantities)

    def edges(self, tokens: Sequence[str]) -> list[dict[str, list[tuple[int, Meanings]]]]:
        """Return the lattice edges that begin at each word."""
        lattice: list[dict[str, list[tuple[int, Meanings]]]] = []
        for at, token in enumerate(tokens):
            begins: dict[str, list[tuple[int, Meanings]]] = {token: [(at + 1, ())]}
            for kind, end, meanings in self._edges(tokens, at):
                begins.setdefault(kind, []).append((end, meanings))
            lattice.append(begins)
        return lattice

    def unfelt(self, tokens: Sequence[str]) -> NamedQuantity | None:
        """Return the first property among the words that nothing measures."""
        for at in range(len(tokens)):
            for _, _, (quantity, *_) in self._properties(tokens, at):
                if isinstance(quantity, NamedQuantity) and not quantity.measurable:
                    return quantity
        return None

    def slips(self, tokens: Sequence[str]) -> dict[str, str]:
        """Return the known spelling of each unknown token."""
        sets = english().sets
        # Correct only to names, quantities and frequent words.
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
        """True for a word without a meaning in this scene."""
        if not token.isalpha() or self.nouns.known(token):
            return False
        return _small_words().isdisjoint([*lemmas(token), *singulars(token)])

    def is_background(self, tokens: Sequence[str]) -> bool:
        """True for a sentence of facts without a request: "It is for a benchmark.", "Everything
        else is right.".
        """
        # A question is a request, and very short sentences are ambiguous.
        if "?" in tokens or len(tokens) < SHORTEST:
            return False
        sets = english().sets
        # "The rest" is harmless only together with a word for correct or finished.
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
        """True for a word that names no body or property, and neither asks nor excludes."""
        token = tokens[at]
        if token in english().sets["telling"] or not token.isalpha() or token in english().compared:
            return False
        named = self.nouns.meant((token,), True) and not self.nouns.is_synonym((token,))
        if named or not self.nouns.names.isdisjoint(singulars(token)):
            return False
        return not any(True for _ in self._properties(tokens, at))

    def _edges(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        # Classes of single words, properties, names, runs of words, and unknown nouns.
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
        """Yield the longest synonym of a quantity, and properties that nothing measures."""
        # Try the longest phrase first.
        for length in range(min(self._longest, len(tokens) - at), 0, -1):
            phrase = tuple(tokens[at : at + length])
            if phrase in self._quantities:
                id, plural = self._quantities[phrase]
                quantity = NamedQuantity(id, " ".join(phrase))
                adjective = phrase[0] in english().sets["adjectives"]
                yield "ADJQ" if adjective else "QUANT", at + length, (quantity,)
                if plural:
                    yield "QUANTS", at + length, (quantity,)
                return
        word = tokens[at]
        if self.nouns.known(word):
            return
        if word in english().labels["asked"]:
            yield "ADJQ", at + 1, (NamedQuantity(english().labels["asked"][word], word),)
            return
        for form in singulars(word):
            label = english().labels["unfelt"].get(form)
            if label is not None:
                kind = "ADJQ" if form in english().sets["adjectives"] else "QUANT"
                yield kind, at + 1, (NamedQuantity(label, word, measurable=False),)
                return

    def _whole_names(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Yield names of several words, joined or separate ("redbox", "red box"), and a single name
        split in two ("note book").
        """
        # Names of several words, also written without spaces.
        for own in self.nouns.named:
            if len(own) > 1 and tokens[at] == "".join(own):
                yield "OBJ", at + 1, (own,)
            elif len(own) > 1 and tuple(tokens[at : at + len(own)]) == own:
                yield "OBJ", at + len(own), (own,)
        # A name of one word, written as two.
        two = "".join(tokens[at : at + 2])
        if len(tokens) > at + 1 and (two,) in self.nouns.named:
            yield "OBJ", at + 2, ((two,),)

    def _runs(self, tokens: Sequence[str], at: int) -> Iterator[Edge]:
        """Yield runs of words that describe bodies of the scene."""
        for end in range(at + 1, min(at + LONGEST_NAME, len(tokens)) + 1):
            run = list(tokens[at:end])
            if not self.nouns.known(run[-1]):
                return
            # Colours and material adjectives can stand alone: "the red one".
            if self.nouns.colours.issuperset(run) or self._tells(run):
                yield "COLOUR", end, (tuple(run),)
            elif len(run) > 1 and not self.nouns.meant(tuple(run), plural=True):
                run = [*run[1:], run[0]]  # adjectives behind their noun: "caja roja"
            # A run that describes at least one body is a noun phrase, singular or plural.
            words, noun = tuple(run), run[-1]
            whole = words in self.nouns.named
            if self.nouns.meant(words, plural=True) and not (whole and len(run) > 1):
                plural = noun in english().sets["collective"] or not self.nouns.singular(noun)
                yield ("OBJS" if plural and not whole else "OBJ"), end, (words,)

    def _tells(self, run: Sequence[str]) -> bool:
        """True for an adjective in the names of bodies: "the plastic one"."""
        return len(run) == 1 and run[0] in english().sets["describing"] & self.nouns.names

    def _absent(self, tokens: Sequence[str], at: int) -> Phrase:
        """Return the longest run that names an unknown body."""
        # At most two nouns: one is unknown, or together they describe no body.
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
    """Yield the classes of `words/en.yaml` for the words at a position."""
    said, word = english(), tokens[at]
    for end in range(at + 1, min(at + _longest_class(), len(tokens)) + 1):
        for kind, meanings in said.classes.get(tuple(tokens[at:end]), ()):
            yield kind, end, meanings
    # Frame words, verbs, amounts and comparatives depend on the form of the word.
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
        yield kind, at + 1, (NamedQuantity(said.compared[word], word),)


@cache
def deeds() -> frozenset[str]:
    """Return the verbs of actions."""
    return english().sets["deeds"].union(english().purposes)


@cache
def _small_words() -> frozenset[str]:
    """Return the words with a meaning in any scene."""
    said = english()
    known = {word for phrase in (*said.classes, *_quantities()) for word in phrase}
    sets = [words for name, words in said.sets.items() if name != "things"]
    return frozenset(known).union(literals(), *sets, *said.labels.values())


@cache
def _longest_class() -> int:
    return longest(english().classes)


def _quantities() -> dict[Phrase, tuple[str, bool]]:
    """Map every synonym to its quantity id and a plural flag.

    The plural is formed of the first or the last word.
    """
    phrases: dict[Phrase, tuple[str, bool]] = {}
    for quantity in catalogue().values():
        # Singular and plural forms of all English synonyms.
        for synonym in {*quantity.words.get("en", ()), quantity.id} - _NO_NOUNS:
            *others, last = synonym.split()
            phrases[*others, last] = quantity.id, False
            phrases[*others, _plural(last)] = quantity.id, True
            if others:
                phrases[_plural(others[0]), *others[1:], last] = quantity.id, True
    return phrases


def _plural(word: str) -> str:
    return word + ("es" if word.endswith("s") else "s")


# Cover of a sentence by clauses of the grammar and the frame between them.


LEFT_OVER = 12
"""Cost of a leftover word. It exceeds the cost of any derivation (1 to 9), so that an unlikely
reading is preferred to none.
"""
MOST_READINGS = 64
"""Maximum number of examined readings of a sentence, more than are accepted of a request."""
CLAUSE = 2
"""Cost of a clause; one long clause is better than two short ones."""
_BETWEEN = ("FILL", "SEP", "?", ".", "only")
"""Classes and words of the frame. A single word costs 1; a phrase or separator costs nothing."""


@dataclass(frozen=True, slots=True)
class Clause:
    """Stretch of a sentence with its readings; the frame has none."""

    start: int
    end: int
    readings: tuple[tuple[Act, ...], ...] = ()

    @property
    def says(self) -> bool:
        """True for a clause with a meaning, neither frame nor context."""
        return any(self.readings)

    @property
    def begins(self) -> bool:
        """True for a clause with an introductory word: an exclusion or a purpose."""
        act = next((act for acts in self.readings for act in acts), None)
        return isinstance(act, NamedPurpose) or (isinstance(act, Say) and act.how == "skip")


@dataclass(frozen=True, slots=True)
class Cover:
    """Complete cover of a sentence.

    Attributes:
        cost: total cost.
        clauses: clauses and frame stretches, in order.
        left: positions of the leftover words.
        abrupt: two clauses are adjacent without a separator.
    """

    cost: int = 0
    clauses: tuple[Clause, ...] = ()
    left: tuple[int, ...] = ()
    abrupt: bool = False

    @property
    def unsure(self) -> bool:
        """True if words are left over or clauses are not separated."""
        return bool(self.left) or self.abrupt

    @property
    def says(self) -> bool:
        """True for a sentence with a request."""
        acts = [act for clause in self.clauses for acts in clause.readings for act in acts]
        return any(not isinstance(act, Mention) for act in acts)

    def readings(self) -> Iterator[tuple[tuple[Act, Clause], ...]]:
        """Yield all combinations of one reading per clause."""
        told = [clause for clause in self.clauses if clause.readings]
        for chosen in product(*(clause.readings for clause in told)):
            yield tuple((act, one) for one, acts in zip(told, chosen, strict=True) for act in acts)


@dataclass(frozen=True, slots=True)
class Sentence:
    """Sentence as written, its words, and its covers; a background sentence has none."""

    own: str
    words: Sequence[str]
    covers: Sequence[Cover]

    @property
    def readings(self) -> Sequence[tuple[Act, ...]]:
        """Meanings of its clauses, in order."""
        each = chain.from_iterable(cover.readings() for cover in self.covers)
        found = [tuple(act for act, _ in one) for one in islice(each, MOST_READINGS)]
        return list(dict.fromkeys(found)) or [(Aside(self.own),)]

    @property
    def bare(self) -> bool:
        """True for clauses without a frame."""
        clauses = [clause for cover in self.covers for clause in cover.clauses]
        return all(one.says or self.words[one.start] in ("?", ",") for one in clauses)


def cover_sentence(words: Sequence[str], own: str, lattice: Lattice) -> Sentence:
    """Cover a sentence, written as `own`; a background sentence is set aside."""
    # A background sentence about "the rest" is never a request.
    background = lattice.is_background(words)
    if background and not english().sets["remaining"].isdisjoint(words):
        return Sentence(own, words, ())
    found = _covers(words, lattice)
    aside = background and (found[0].unsure or not found[0].says)
    return Sentence(own, words, () if aside else found)


def _covers(sentence: Sequence[str], lattice: Lattice) -> list[Cover]:
    """Return the covers of minimum cost, by dynamic programming from the end of the sentence."""
    # best[i] holds the cheapest covers of the words from position i on.
    chart = DerivationChart(ACTIONS, lattice.edges(sentence))
    best: list[list[Cover]] = [[Cover()]]
    for at in reversed(range(len(sentence))):
        # Best cover of the remainder, extended by a leftover word, a frame stretch, or a clause.
        rest = best[0]
        choices = [_before(one, LEFT_OVER, left=(at,)) for one in rest]
        for name in _BETWEEN:
            for end in chart.derived(name, at):
                cost = int(name == "FILL" and end == at + 1)
                choices += [_before(one, cost, Clause(at, end)) for one in best[end - at - 1]]
        for end, found in chart.derived("<clause>", at).items():
            readings = tuple(cast("tuple[Act, ...]", acts) for acts in found.meanings)
            clause = Clause(at, end, readings)
            cost = CLAUSE + found.cost
            choices += [_before(one, cost, clause) for one in best[end - at - 1]]
        least = min(one.cost for one in choices)
        best.insert(0, _distinct(one for one in choices if one.cost == least)[:MOST])
    return best[0]


def _before(
    rest: Cover, cost: int, clause: Clause | None = None, left: tuple[int, ...] = ()
) -> Cover:
    """Prepend a clause or leftover words to a cover."""
    following = rest.clauses[0] if rest.clauses else None
    # Adjacent clauses without a separator have a penalty, except before an introductory word.
    abrupt = bool(clause and following and clause.says and following.says)
    abrupt = abrupt and not (following and following.begins)
    return Cover(
        rest.cost + cost + LEFT_OVER * abrupt,
        (clause, *rest.clauses) if clause else rest.clauses,
        (*left, *rest.left),
        rest.abrupt or abrupt,
    )


def _distinct(choices: Iterable[Cover]) -> list[Cover]:
    """Keep one cover for each set of meaningful clauses."""
    found: dict[object, Cover] = {}
    for one in choices:
        told = tuple(clause for clause in one.clauses if clause.says)
        found.setdefault((told, one.left), one)
    return list(found.values())
