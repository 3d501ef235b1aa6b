"""Cover of a sentence: clauses that the grammar derives, with the frame around them between.

A word that belongs to neither is left over. A sentence without one is understood; one with some of
them makes a proposal.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice, product
from typing import cast

from palpate.planning.request.sentence.actions import ACTIONS
from palpate.planning.request.sentence.grammar import MOST, Chart
from palpate.planning.request.sentence.lattice import Lattice
from palpate.planning.request.sentence.query import Act, Aside, Mention, Purpose, Say
from palpate.planning.request.wording import english

LEFT_OVER = 12
"""Cost of a word that is left over: more than any cost of a derivation (1 to 9), so that an unlikely
reading is preferred to none."""
MOST_READINGS = 64
"""Readings of a sentence that are looked into, more than are accepted of a request."""
CLAUSE = 2
"""Cost of a clause: one long one is better than two short ones."""
_BETWEEN = ("FILL", "SEP", "?", ".", "only")
"""Classes and words of the frame. A single word costs 1, a phrase and what separates nothing."""


@dataclass(frozen=True, slots=True)
class Clause:
    """A stretch of a sentence, and what each of its readings asks; none in the frame."""

    start: int
    end: int
    readings: tuple[tuple[Act, ...], ...] = ()

    @property
    def says(self) -> bool:
        """Test for a clause that is neither frame nor context."""
        return any(self.readings)

    @property
    def begins(self) -> bool:
        """Test for a clause that begins with a word of its own, for an exclusion or a purpose."""
        act = next((act for acts in self.readings for act in acts), None)
        return isinstance(act, Purpose) or (isinstance(act, Say) and act.how == "skip")


@dataclass(frozen=True, slots=True)
class Cover:
    """A sentence from end to end.

    Attributes:
        clauses: clauses and stretches of the frame, in order.
        left: places of the words that belong to neither.
        abrupt: whether two clauses stand side by side, with nothing between them.
    """

    cost: int = 0
    clauses: tuple[Clause, ...] = ()
    left: tuple[int, ...] = ()
    abrupt: bool = False

    @property
    def unsure(self) -> bool:
        """Test for words that are left over."""
        return bool(self.left) or self.abrupt

    @property
    def says(self) -> bool:
        """Test for a sentence that asks for anything."""
        acts = [act for clause in self.clauses for acts in clause.readings for act in acts]
        return any(not isinstance(act, Mention) for act in acts)

    def readings(self) -> Iterator[tuple[tuple[Act, Clause], ...]]:
        """Each choice of one reading a clause."""
        told = [clause for clause in self.clauses if clause.readings]
        for chosen in product(*(clause.readings for clause in told)):
            yield tuple((act, one) for one, acts in zip(told, chosen, strict=True) for act in acts)


@dataclass(frozen=True, slots=True)
class Sentence:
    """A sentence: as written, its words, and its covers; none of a background sentence."""

    own: str
    words: Sequence[str]
    covers: Sequence[Cover]

    @property
    def readings(self) -> Sequence[tuple[Act, ...]]:
        """The meanings of its clauses, in order."""
        each = chain.from_iterable(cover.readings() for cover in self.covers)
        found = [tuple(act for act, _ in one) for one in islice(each, MOST_READINGS)]
        return list(dict.fromkeys(found)) or [(Aside(self.own),)]

    @property
    def bare(self) -> bool:
        """Test for clauses alone, without a frame."""
        clauses = [clause for cover in self.covers for clause in cover.clauses]
        return all(one.says or self.words[one.start] in ("?", ",") for one in clauses)


def covered(words: Sequence[str], own: str, lattice: Lattice) -> Sentence:
    """Cover a sentence, which the user wrote as `own`; a background sentence is set aside."""
    background = lattice.is_background(words)
    if background and not english().sets["remaining"].isdisjoint(words):
        return Sentence(own, words, ())
    found = _covers(words, lattice)
    aside = background and (found[0].unsure or not found[0].says)
    return Sentence(own, words, () if aside else found)


def _covers(sentence: Sequence[str], lattice: Lattice) -> list[Cover]:
    """Cover a sentence at the least cost, from its end to its beginning; several ways if they cost
    the same."""
    chart = Chart(ACTIONS, lattice.edges(sentence))
    best: list[list[Cover]] = [[Cover()]]
    for at in reversed(range(len(sentence))):
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
    following = rest.clauses[0] if rest.clauses else None
    abrupt = bool(clause and following and clause.says and following.says)
    abrupt = abrupt and not (following and following.begins)
    return Cover(
        rest.cost + cost + LEFT_OVER * abrupt,
        (clause, *rest.clauses) if clause else rest.clauses,
        (*left, *rest.left),
        rest.abrupt or abrupt,
    )


def _distinct(choices: Iterable[Cover]) -> list[Cover]:
    """One cover for each set of clauses that say something."""
    found: dict[object, Cover] = {}
    for one in choices:
        told = tuple(clause for clause in one.clauses if clause.says)
        found.setdefault((told, one.left), one)
    return list(found.values())
