"""Proposal of what a request may ask for, where the grammar does not derive all of it.

Its sentences are covered by islands, the stretches that the grammar does derive (clauses, quantities of
things), so that as few words as possible are left over. A proposal is shown and confirmed before it is
used; it may be wrong, and is never silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import cast

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.request.reading import Reading
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.sentence.actions import ACTIONS
from palpate.planning.request.sentence.chart import Chart
from palpate.planning.request.sentence.grammar import grammar
from palpate.planning.request.sentence.lattice import Lattice
from palpate.planning.request.sentence.meaning import Act, Mention, Pair, Say
from palpate.planning.request.things import Things
from palpate.planning.request.wording import english
from palpate.scene.scene import Scene

SKIPPED = 12
"""Cost of a word that is left over: more than any cost of a derivation (1 to 9), so that an unlikely
reading is preferred to none."""
ISLAND = 6
"""Cost of an island: one long one is better than two short ones."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Parameters that a request may ask for, and its words that no island covers."""

    parameters: tuple[Parameter, ...]
    not_used: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Cover:
    """Islands over the rest of a sentence, and the places of the words between them.

    Attributes:
        acts: meanings of the islands, each with the places of its words.
    """

    cost: int
    acts: tuple[tuple[Act, range], ...] = ()
    skipped: tuple[int, ...] = ()


def propose(sentences: Sequence[Sequence[str]], scene: Scene, lattice: Lattice) -> Proposal | None:
    """Propose what some sentences of a request ask for; None if no island names a parameter."""
    resolver, things = Resolver(scene), Things(scene, lattice.nouns)
    reading = Reading(resolver, things)
    simulates = any(word.startswith("simul") for sentence in sentences for word in sentence)
    not_used: list[str] = []
    bare: list[Say] = []
    for sentence in sentences:
        cover = _cover(sentence, lattice, ("<clauses>", "<qnp>", "<event2>")[: 2 + simulates])
        unused = set(cover.skipped)
        for act, places in cover.acts:
            if _is_bare(act):
                bare.append(cast("Say", act))
                continue
            things.unsure = False  # the user confirms what a pronoun is taken for
            try:
                reading.take(act)
            except (InputError, PlanRejected):
                unused.update(places)
        not_used += _runs(sentence, sorted(unused))
    # A quantity alone is that of a thing named beside it, never of everything.
    for act in bare:
        if things.spoken:
            with suppress(InputError, PlanRejected):
                reading.take(act)
    with suppress(InputError, PlanRejected):
        if reading.simulated:
            reading.finish()
    asked = [one for one in resolver.ordered(reading.asked) if one not in reading.excluded]
    return Proposal(tuple(asked), tuple(dict.fromkeys(not_used))) if asked else None


def _is_bare(act: Act) -> bool:
    """Test for a wish that names no thing."""
    pairs = act.pairs if isinstance(act, Say) and act.deed == "want" else ()
    return bool(pairs) and all(pair.thing is None and not pair.every for pair in pairs)


def _cover(sentence: Sequence[str], lattice: Lattice, islands: Sequence[str]) -> _Cover:
    """Cover a sentence with islands at the least cost, from its end to its beginning."""
    chart = Chart(grammar(), ACTIONS, lattice.edges(sentence))
    best = [_Cover(0)]
    for at in reversed(range(len(sentence))):
        rest = best[0]
        choices = [_Cover(rest.cost + SKIPPED, rest.acts, (at, *rest.skipped))]
        for name in islands:
            for end, found in chart.derived(name, at).items():
                rest = best[end - at - 1]
                acts = _acts(next(iter(found.meanings)))
                if _is_denied(sentence, at):
                    acts = tuple(_denied(act) for act in acts)
                meant = tuple((act, range(at, end)) for act in acts)
                cost = rest.cost + found.cost + ISLAND
                choices.append(_Cover(cost, (*meant, *rest.acts), rest.skipped))
        best.insert(0, min(choices, key=lambda cover: cover.cost))
    return best[0]


def _is_denied(sentence: Sequence[str], at: int) -> bool:
    """Test for a word right before a place that excludes what follows: "except", "nor", "not of"."""
    before = [word for word in sentence[max(at - 3, 0) : at] if word.isalpha()]
    words = [word for word in before[-2:] if word not in ("of", "from", "for", "the")]
    return any(word in english().denying for word in words[-1:])


def _denied(act: Act) -> Act:
    """A wish, or a mention, as an exclusion."""
    if isinstance(act, Say) and act.deed == "want":
        return replace(act, deed="skip")
    if isinstance(act, Mention):
        return Say("skip", (Pair((), act.thing),))
    return act


def _acts(meanings: tuple[object, ...]) -> tuple[Act, ...]:
    """Acts of an island; quantities of things alone are wanted."""
    pairs = tuple(one for one in meanings if isinstance(one, Pair))
    if pairs:
        return (Say("want", pairs),)
    return cast("tuple[Act, ...]", meanings)


def _runs(sentence: Sequence[str], places: Sequence[int]) -> list[str]:
    """Words at successive places, joined."""
    runs: list[list[int]] = []
    for place in places:
        if runs and runs[-1][-1] == place - 1:
            runs[-1].append(place)
        else:
            runs.append([place])
    return [" ".join(sentence[place] for place in run) for run in runs]
