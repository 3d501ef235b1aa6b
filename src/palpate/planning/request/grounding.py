"""Grounding: from the words of a request to parameters of a scene.

A reading is sure if the grammar derives every sentence as a whole, except background sentences, which
are set aside (`Lattice.is_background`). Otherwise the request is rejected, with a proposal (`proposal`)
if parts of it are derived. A sentence with two derivations that ask for different parameters is rejected.

1. Words: phrases of other languages are translated in place (`languages`), misspelt words are corrected
   (`tokens`).
2. Lattice: the classes of each word (`lattice`): noun of the scene, quantity, relation, …
3. Derivations of each sentence by `words/grammar.txt` (`grammar`, `chart`), the cheapest of several.
4. Meanings (`meaning`), resolved to bodies of the scene (`things`, `whereabouts`).
5. Wishes and exclusions, sentence by sentence (`reading`).

A quantity without a body is that of the last mentioned body that can have it ("The bottle is new. I need
its mass."), else of all that miss it. A comparison asks for the quantity of everything compared. A purpose
("to simulate pushing the mug") asks for the missing parameters that it depends on; a body alone for all
that is missing of it. Both are remarked on.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import cast

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.request.languages import colours, in_english, spoken
from palpate.planning.request.proposal import propose
from palpate.planning.request.reading import Reading
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.sentence.actions import ACTIONS
from palpate.planning.request.sentence.chart import Chart
from palpate.planning.request.sentence.grammar import grammar
from palpate.planning.request.sentence.lattice import Lattice
from palpate.planning.request.sentence.meaning import Act, Aside
from palpate.planning.request.things import Things
from palpate.planning.request.tokens import sentences, tokens
from palpate.planning.request.wording import english
from palpate.scene.scene import Scene

LONGEST = 60
"""Words of the longest sentence that is read."""
MOST = 24
"""Readings of a whole request that are looked into; with more it is refused."""

Acts = tuple[Act, ...]


@dataclass(frozen=True, slots=True)
class Grounded:
    """Parameters that a request asks for.

    Attributes:
        asked: the parameters it names, whether or not the scene states them.
        cannot: one sentence for each thing asked that no plan can measure.
        remarks: how something unsaid was read.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def ground(request: str, scene: Scene) -> Grounded:
    """Ground a request in a scene.

    Raises:
        InputError: empty or too long, or it names an object that the scene does not have (the
            message lists those it has). PlanRejected: ambiguous, or not understood; the message
            says what was not, and what to say instead.
    """
    if not request.strip():
        raise InputError("the request is empty; say what is unknown, e.g. 'the mass of the bottle'")
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters; say it in at most {MAX_REQUEST}"
        )
    language = spoken(request)
    lattice = Lattice(scene, colours(language))
    said = tokens(in_english(lattice.nouns.apart(request), lattice.nouns.names, language))
    slips = lattice.slips(said)
    remarks = [f"'{word}' is read as '{meant}'." for word, meant in slips.items()]
    parts = list(sentences([slips.get(word, word) for word in said]))
    resolver = Resolver(scene)
    readings: list[list[Acts]] = []
    try:
        for sentence, own in zip(parts, _own(request, len(parts)), strict=True):
            readings.append(_derived(sentence, own, lattice, resolver))
        if not readings:
            resolver.reject(request)
        return _agreed(readings, scene, lattice, remarks, request)
    except PlanRejected as rejection:
        proposal = propose(parts, scene, lattice)
        if proposal is None:
            raise
        raise PlanRejected(str(rejection), proposal.parameters, proposal.not_used) from None


def _own(request: str, count: int) -> list[str]:
    """Split a request into sentences as written; the whole request for each if the number of
    sentences differs."""
    own = [part.strip() for part in re.split(r"(?<=[.;?!])\s+", request) if part.strip()]
    return own if len(own) == count else [request] * count


def _derived(sentence: Sequence[str], own: str, lattice: Lattice, resolver: Resolver) -> list[Acts]:
    """Derive the readings of a sentence, which the user wrote as `own`.

    Raises:
        PlanRejected: nothing; the message names what was not understood.
    """
    if len(sentence) > LONGEST:
        raise PlanRejected(
            f"a sentence of the request has {len(sentence)} words; say it in sentences of at most "
            f"{LONGEST}"
        )
    remains = not english().remaining.isdisjoint(sentence)
    if remains and lattice.is_background(sentence):
        return [(Aside(own),)]
    chart = Chart(grammar(), ACTIONS, lattice.edges(sentence))
    found = [cast("Acts", acts) for acts in chart.whole("<sentence>")]
    if found:
        return found
    if not remains and lattice.is_background(sentence):
        return [(Aside(own),)]
    unfelt = lattice.unfelt(sentence)
    if unfelt is not None:
        raise PlanRejected(resolver.not_measurable(unfelt))
    unknown = lattice.unknown(sentence)
    unknown = [word for word in unknown if word in own.lower()]
    if not unknown:
        unknown = [sentence[min(chart.furthest, len(sentence) - 1)]]
    raise resolver.not_understood(unknown, own)


def _agreed(
    readings: Sequence[Sequence[Acts]],
    scene: Scene,
    lattice: Lattice,
    remarks: Sequence[str],
    request: str,
) -> Grounded:
    """Combine the readings; all must ask for the same parameters.

    Raises:
        InputError, PlanRejected: none of them can be; or they come to different things.
    """
    found: dict[frozenset[Parameter], Grounded] = {}
    refusal: InputError | PlanRejected | None = None
    for acts in _all_of(readings):
        try:
            grounded = _grounded(acts, scene, lattice, remarks, request)
        except (InputError, PlanRejected) as refused:
            refusal = refusal or refused
            continue
        found.setdefault(frozenset(grounded.asked), grounded)
    if len(found) == 1 and refusal is None:
        return next(iter(found.values()))
    if refusal is not None:
        raise refusal
    first, second = list(found.values())[:2]
    raise PlanRejected(
        f"the request may mean {_listed(first.asked)} or {_listed(second.asked)}; say it in two "
        "sentences"
    )


def _all_of(readings: Sequence[Sequence[Acts]]) -> list[list[Act]]:
    """Each choice of one reading a sentence.

    Raises:
        PlanRejected: there are too many.
    """
    chosen: list[list[Act]] = []
    for sentences_ in product(*readings):
        chosen.append([act for acts in sentences_ for act in acts])
        if len(chosen) > MOST:
            raise PlanRejected(
                "the request can be read in too many ways; say it in short sentences"
            )
    return chosen


def _grounded(
    acts: Sequence[Act], scene: Scene, lattice: Lattice, remarks: Sequence[str], request: str
) -> Grounded:
    """Parameters that one reading asks for."""
    resolver = Resolver(scene)
    things = Things(scene, lattice.nouns)
    reading = Reading(resolver, things)
    for act in acts:
        reading.take(act)
    reading.finish()
    asked = [one for one in resolver.ordered(reading.asked) if one not in reading.excluded]
    told = (*remarks, *things.remarks, *reading.remarks)
    if not (asked or resolver.cannot or reading.looked):
        resolver.reject(request)
    return Grounded(
        asked=tuple(asked),
        cannot=tuple(dict.fromkeys(resolver.cannot)),
        remarks=tuple(dict.fromkeys(told)),
    )


def _listed(parameters: Sequence[Parameter]) -> str:
    return " and ".join(str(parameter) for parameter in parameters) or "nothing"
