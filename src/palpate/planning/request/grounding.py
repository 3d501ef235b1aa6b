"""Grounding of a request: from its words to parameters of a scene.

A reading is *sure* if every word of every sentence belongs to a clause of the grammar
(`words/grammar.txt`) or to its frame. A background sentence is set aside as a whole
(`Lattice.is_background`). With words left over, the reading is a *proposal* if it names parameters;
the user confirms it. Otherwise the request is rejected. A request with two readings for different
parameters is rejected too.

1. Words: phrases of other languages are translated in place, misspelt words are corrected
   (`words`).
2. Lattice: the classes of each word (`sentence`): noun of the scene, quantity, relation, …
3. Cover of each sentence by the cheapest clauses (`grammar`, `sentence`).
4. Queries (`query`): a quantity of selected bodies, wanted or excluded, clause by clause
   (`reading`).
5. Selectors resolved to bodies of the scene (`selection`, `whereabouts`).

A quantity without a body applies to the last mentioned body that can have it ("The bottle is new. I
need its mass."), else to all bodies that miss it. A comparison requests the quantity of everything
compared. A purpose ("to simulate pushing the mug") requests the missing parameters that it depends
on. A body alone requests all its missing parameters. The last two are stated in a remark.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice, product

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.request.query import Act, Aside, Grounded
from palpate.planning.request.reading import Reading
from palpate.planning.request.resolver import HINT, Resolver
from palpate.planning.request.selection import Selection
from palpate.planning.request.sentence import (
    Clause,
    Cover,
    Lattice,
    Sentence,
    cover_sentence,
    deeds,
)
from palpate.planning.request.words import (
    colours,
    english,
    in_english,
    lemmas,
    sentences,
    spoken,
    tokens,
)
from palpate.scene.scene import Scene

LONGEST = 60
"""Maximum number of words in a sentence."""
MOST = 24
"""Maximum number of examined readings of a request; one with more is rejected."""


def ground(request: str, scene: Scene) -> Grounded:
    """Ground a request in a scene.

    Raises:
        InputError: the request is empty or too long, or names an unknown object. The message lists
            the known ones.
        PlanRejected: the request is ambiguous or not understood. The message states the words and
            an alternative; `proposal` has the candidate parameters.
    """
    if not request.strip():
        raise InputError("the request is empty; say what is unknown, e.g. 'the mass of the bottle'")
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters; say it in at most {MAX_REQUEST}"
        )
    # Translate to English, correct misspelt words, and split into sentences.
    language = spoken(request)
    lattice = Lattice(scene, colours(language))
    said = tokens(in_english(lattice.nouns.apart(request), lattice.nouns.names, language))
    slips = lattice.slips(said)
    dropped = english().sets["dropped"] - lattice.nouns.names
    words = [slips.get(word, word) for word in said if word not in dropped]
    parts = _sentences(request, list(sentences(words)), lattice)
    # Ground every reading; all must agree. On failure, offer a proposal.
    try:
        acts = _readings(parts, request, lattice, Resolver(scene))
        found = _agreed([_ground_acts(one, scene, lattice, request, parts) for one in acts])
    except PlanRejected as rejection:
        parameters, not_used = _propose(parts, scene, lattice)
        if not parameters:
            raise
        reason = str(rejection).partition(HINT)[0]
        raise PlanRejected(reason, parameters, not_used) from None
    remarks = [f"'{word}' is read as '{meant}'." for word, meant in slips.items()]
    return replace(found, remarks=(*remarks, *found.remarks))


def _sentences(request: str, parts: Sequence[Sequence[str]], lattice: Lattice) -> list[Sentence]:
    """Cover each sentence by clauses."""
    # Pair each sentence with its original text, if the counts agree.
    own = [part.strip() for part in re.split(r"(?<=[.;?!])\s+", request) if part.strip()]
    own = own if len(own) == len(parts) else [request] * len(parts)
    longest = max(map(len, parts), default=0)
    if longest > LONGEST:
        raise PlanRejected(
            f"a sentence of the request has {longest} words; say it in sentences of at most {LONGEST}"
        )
    return [
        cover_sentence(words, written, lattice) for words, written in zip(parts, own, strict=True)
    ]


def _readings(
    parts: Sequence[Sentence], request: str, lattice: Lattice, resolver: Resolver
) -> list[list[Act]]:
    """Return all combinations of one reading per sentence.

    Raises:
        PlanRejected: a word belongs to no clause, or there are too many combinations.
    """
    for part in parts:
        if part.covers and part.covers[0].unsure:
            # Explain the failure: a quantity that nothing measures, an unknown word, or a leftover
            # word.
            unfelt = lattice.unfelt(part.words)
            if unfelt is not None:
                raise PlanRejected(resolver.not_measurable(unfelt))
            left = [part.words[at] for at in part.covers[0].left]
            unknown = [word for word in part.words if lattice.is_unknown(word)]
            raise resolver.not_understood(unknown or left, part.own)
    # Limit the number of combinations, which grows exponentially.
    choices = list(islice(product(*(part.readings for part in parts)), MOST + 1))
    if len(choices) > MOST:
        raise PlanRejected("the request can be read in too many ways; say it in short sentences")
    chosen = [[act for acts in choice for act in acts] for choice in choices]
    if all(isinstance(act, Aside) for acts in chosen for act in acts):
        resolver.reject(request)
    return chosen


def _agreed(found: Sequence[Grounded]) -> Grounded:
    """Return the common meaning of all readings.

    Raises:
        PlanRejected: two readings ask for different parameters.
    """
    first = found[0]
    for other in found:
        if set(other.asked) != set(first.asked):
            raise PlanRejected(
                f"the request may mean {_list_parameters(first.asked)} or {_list_parameters(other.asked)}; say it in "
                "two sentences"
            )
    return first


def _ground_acts(
    acts: Sequence[Act], scene: Scene, lattice: Lattice, request: str, parts: Sequence[Sentence]
) -> Grounded:
    """Return the parameters of one reading."""
    resolver = Resolver(scene)
    bare = all(part.bare for part in parts)
    reading = Reading(resolver, Selection(scene, lattice.nouns), bare)
    for act in acts:
        reading.take(act)
    reading.finish()
    if not (reading.wanted or resolver.cannot or reading.looked):
        resolver.reject(request)
    return Grounded(
        asked=reading.wanted,
        cannot=tuple(dict.fromkeys(resolver.cannot)),
        remarks=tuple(dict.fromkeys((*reading.selection.remarks, *reading.remarks))),
    )


def _propose(
    parts: Sequence[Sentence], scene: Scene, lattice: Lattice
) -> tuple[tuple[Parameter, ...], tuple[str, ...]]:
    """Return the candidate parameters of a partly understood request, and its unused words.

    A proposal may be wrong. It is shown and confirmed before use.
    """
    reading = Reading(Resolver(scene), Selection(scene, lattice.nouns))
    not_used: list[str] = []
    for part in parts:
        cover = part.covers[0] if part.covers else Cover()
        unused = set(cover.left)
        # A leftover word that changes the wish excludes a proposal.
        if any(_asks_otherwise(part.words, at) for at in unused):
            return (), ()
        for act, clause in next(cover.readings()):
            reading.selection.unsure = False  # the user confirms the references
            try:
                # A leftover word next to a clause could change its bodies.
                if _is_part(part.words, clause, unused) or (unused and reading.is_of_all(act)):
                    raise PlanRejected("the words left over may make it another")
                reading.take(act)
            except (InputError, PlanRejected):
                unused.update(range(clause.start, clause.end))
        not_used += _runs(part.words, unused)
    with suppress(InputError, PlanRejected):
        reading.finish()
    return reading.wanted, tuple(dict.fromkeys(not_used))


def _asks_otherwise(words: Sequence[str], at: int) -> bool:
    """True for a word that leaves the wish open, or commands another action."""
    if not english().sets["open"].isdisjoint(lemmas(words[at])):
        return True
    # A verb at the start of a clause is a command.
    commands = at == 0 or words[at - 1] in ("and", "then", ",", "you")
    return commands and words[at] in deeds()


def _is_part(words: Sequence[str], clause: Clause, left: set[int]) -> bool:
    """True if a leftover word changes the bodies of a clause: "the lid of the mug"."""
    before, relating = clause.start - 1, english().classes.get((words[clause.start - 1],), [])
    related = before in left and any(kind in ("OF", "REL") for kind, _ in relating)
    return related or (clause.end in left and words[clause.end] == "'s")


def _runs(words: Sequence[str], places: Iterable[int]) -> list[str]:
    """Join words at successive positions."""
    # Successive positions have equal differences to their index.
    runs: dict[int, list[str]] = {}
    for count, at in enumerate(sorted(places)):
        runs.setdefault(at - count, []).append(words[at].replace("§amount", "an amount"))
    return [" ".join(run) for run in runs.values()]


def _list_parameters(parameters: Sequence[Parameter]) -> str:
    return " and ".join(str(parameter) for parameter in parameters) or "nothing"
