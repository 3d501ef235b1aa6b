"""Grounding of a request: from its words to parameters of a scene.

A request in English is *sure* if every word belongs to one of the forms in `SURE`: quantities of
objects, comparisons, exceptions and what is missing. Any other request that names a known quantity
or object is a *proposal*, in one of five languages. The user confirms it, and sees the words that
were not used. Without a known quantity or object, the request is rejected.

1. Tokens, and the language with the most known words (`words`).
2. Spots of each sentence: quantities, bodies, words of scope (`spots`, `nouns`, `whereabouts`).
3. Fragments that want, exclude or correct; quantities paired with bodies (`reading`).
4. Parameters of the scene (`resolver`).

A quantity without a body applies to the last mentioned body that can have it. A comparison asks for
the quantity of everything compared. A purpose ("to simulate pushing the mug") asks for the
parameters that it depends on. A body alone asks for all its missing parameters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.estimation.quantities.within import Within, parse_width
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.request.nouns import Nouns
from palpate.planning.request.query import Grounded
from palpate.planning.request.reading import Reading
from palpate.planning.request.resolver import HINT, Resolver
from palpate.planning.request.spots import Spot, Spotter, Thing
from palpate.planning.request.words import amount, spoken, tokens
from palpate.scene.scene import Scene

_JOINED = ("together", "along", "one", "ones", "those")
"""Words after which "with" names no tool."""
LONGEST = 60
"""Maximum number of words in a sentence."""


@dataclass(frozen=True, slots=True)
class Sentence:
    """Sentence of a request: its words, their spots, and True for a question."""

    words: list[str]
    spots: list[Spot]
    question: bool

    def has(self, *names: str) -> bool:
        """True if one of the words has one of these classes."""
        return any(spot.has(*names) for spot in self.spots)

    def text(self, spot: Spot) -> str:
        """Return the words of a spot."""
        return " ".join(self.words[spot.start : spot.end])


def ground(request: str, scene: Scene) -> Grounded:
    """Ground a request in a scene.

    Raises:
        InputError: the request is empty or too long, or names an unknown object. The message lists
            the known ones.
        PlanRejected: the request is not sure. The message states the reason; `proposal` has the
            parameters that it may mean, and `not_used` the words that were not used.
    """
    if not request.strip():
        raise InputError("the request is empty; say what is unknown, e.g. 'the mass of the bottle'")
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters; say it in at most {MAX_REQUEST}"
        )
    spotter, sentences = parse(request, scene)
    resolver = Resolver(scene, request)
    _refuse(sentences, resolver)
    reading = Reading(
        resolver,
        compares=any(is_comparison(one) for one in sentences),
        simulates=any(one.has("SIMULATE") for one in sentences),
        bare=len(sentences) == 1 and _is_bare(sentences[0]) and not spotter.slips,
    )
    for sentence in sentences:
        reading.take(sentence.spots, sentence.question)
    reading.finish()
    unfelt = list(_unfelt(sentences, resolver))
    unused = [run for sentence in sentences for run in _unused(sentence)]
    if not reading.wanted and not reading.looked:
        cannot = (*resolver.cannot, *unfelt)
        if cannot and not reading.asked:
            if any(one.has("NOT") and not is_sure(one) for one in sentences):
                # "Do not take its temperature" does not request it.
                raise PlanRejected(" ".join(dict.fromkeys(cannot)))
            return Grounded((), tuple(dict.fromkeys(cannot)))
        raise reading.problems[0] if reading.problems else resolver.not_understood(unused)
    within = _within(sentences, reading)
    sure = spotter.code == "en" and all(is_sure(one) for one in sentences) and not reading.guessed
    if unused or not sure or reading.problems or len(spotter.slips) > 1:
        reason = f"I am not sure about '{' '.join(request.split())}'; please confirm"
        if unused:
            dead = [one.text(spot) for one in sentences for spot in one.spots if _is_dead(spot)]
            reason = str(resolver.not_understood(dead)).partition(HINT)[0]
        if reading.problems:
            reason = str(reading.problems[0]).partition(HINT)[0]
        raise PlanRejected(reason, reading.wanted, tuple(unused), within)
    slips = [f"'{word}' is read as '{meant}'." for word, meant in spotter.slips.items()]
    return Grounded(
        asked=reading.wanted,
        cannot=tuple(dict.fromkeys((*resolver.cannot, *unfelt))),
        remarks=tuple(dict.fromkeys((*slips, *spotter.remarks, *reading.remarks))),
        within=within,
    )


def parse(request: str, scene: Scene) -> tuple[Spotter, list[Sentence]]:
    """Find the spots of each sentence of a request.

    Raises PlanRejected: a sentence is too long, or describes a body that the scene does not have.
    """
    nouns = Nouns(scene)
    words = tokens(nouns.split_names(request))
    spotter = Spotter(scene, nouns, spoken(words, nouns.names))
    return spotter, [_sentence(part, spotter) for part in _sentences(words)]


def _sentences(words: Sequence[str]) -> Iterator[tuple[list[str], bool]]:
    """Yield the words of each sentence, and True for a question."""
    sentence: list[str] = []
    for word in [*words, "."]:
        if word not in ".;?!":
            sentence.append(word)
        elif sentence:
            if len(sentence) > LONGEST:
                raise PlanRejected(
                    f"a sentence of the request has {len(sentence)} words; say it in sentences of at "
                    f"most {LONGEST}"
                )
            yield sentence, word == "?"
            sentence = []


def _sentence(part: tuple[list[str], bool], spotter: Spotter) -> Sentence:
    words, question = part
    spots = spotter.spots(words)
    _find_absent(spots, words)
    _set_tools_aside(spots, words)
    return Sentence(words, spots, question)


def _find_absent(spots: list[Spot], words: Sequence[str]) -> None:
    """Mark nouns without a body where a body is expected; elsewhere they mean nothing."""
    for at, spot in enumerate(spots):
        known = spot.thing is not None
        if spot.thing.names if spot.thing is not None else not spot.unknown:
            continue
        start = at
        while start and spots[start - 1].has("DET", "NUM", "ALL") and not spots[start - 1].thing:
            start -= 1
        before, after = spots[:start][-2:], spots[at + 1 : at + 2]
        named = any(one.has("PRONOUN") or (one.thing and one.thing.names) for one in spots)
        first, last = (before or [spot])[0], (before or [spot])[-1]
        asked = last.has("W") or (last.has("F") and first.has("A", "C"))
        asked = asked or (last.has("OF") and first.is_quantity and not last.has("FOR"))
        listed = known and first.thing and last.has("AND", ",", "OR")
        expected = asked or listed or (not named and any(o.has("W", "'S", "N") for o in after))
        if expected and (start < at or known) and words[spot.start].isalpha():
            spot.thing = Thing(" ".join(words[spot.start : spot.end]), (), known=known)
        else:
            spot.thing, spot.classes = None, {}


def _set_tools_aside(spots: Sequence[Spot], words: Sequence[str]) -> None:
    """Do not use bodies as tools: "weigh the mug with the spoon" asks for the mug alone."""
    for at, spot in enumerate(spots):
        if spot.thing is None or spot.has("MARK"):
            continue
        start = at
        while start and spots[start - 1].has("DET", "ITS") and spots[start - 1].thing is None:
            start -= 1
        before = [" ".join(words[one.start : one.end]) for one in spots[max(start - 2, 0) : start]]
        if before[-1:] == ["with"] and before[0] not in _JOINED:
            spot.thing, spot.classes = None, {}


def _is_bare(sentence: Sentence) -> bool:
    """True for bodies alone: "the mug and the bottle"."""
    named = [one for one in sentence.spots if not one.has("DET", "ALL") or one.thing]
    kinds = "".join("T" if one.thing else "," if one.has("AND", ",") else "?" for one in named)
    return "?" not in kinds and "TT" not in kinds


def is_comparison(sentence: Sentence) -> bool:
    """True for a sentence that compares bodies, or a body with an amount."""
    if sentence.has("C") or sum(spot.has("THAN") for spot in sentence.spots) > 1:
        return any(spot.is_quantity for spot in sentence.spots)
    return sentence.has("MORE") and any(spot.is_quantity for spot in sentence.spots)


def _refuse(sentences: Sequence[Sentence], resolver: Resolver) -> None:
    """Reject requests for something else: parts, actions, choices, the past. Raises PlanRejected: the reason."""
    simulates = any(one.has("SIMULATE") for one in sentences)
    for one in sentences:
        spots, quantified = one.spots, any(spot.is_quantity for spot in one.spots)
        for at, spot in enumerate(spots):
            before = spots[at - 1] if at else None
            after = next(
                (other for other in spots[at + 1 :] if other.thing or not other.has("DET")), spot
            )
            # "How heavy was the mug", "one of the boxes".
            past = spot.has("PAST") and (before is None or before.has("A", "C", "W", "F"))
            otherwise = after.thing is not None and (past or spot.has("CHOICE"))
            deed = _is_deed(spots, at) and not simulates
            if otherwise or deed or spot.has("OPEN") or (quantified and _is_part(spots, at)):
                raise resolver.not_understood([one.text(spot)])
            joins = any(other.thing for other in spots[:at]) and any(
                other.thing for other in spots[at + 1 : at + 4]
            )
            denied = any(other.has("EXCEPT", "NOT", "SKIP", "NEEDLESS") for other in spots[:at])
            if spot.has("OR") and joins and not denied and not is_comparison(one):
                raise PlanRejected("'or' leaves it open which is meant; say 'and', or name one")


def _is_deed(spots: Sequence[Spot], at: int) -> bool:
    """True for an action at the start of a clause."""
    spot = spots[at]
    if not spot.has("DEED") or spot.has("HARMLESS", "A", "W", "MEASURE", "F"):
        return False
    before, rest = spots[at - 1] if at else None, spots[at + 1 :]
    if any(one.has("W") for one in rest) and spot.classes["DEED"] == "":
        return False  # "put the mug on the scales"
    if spot.classes["DEED"] in ("press", "push") and any(one.is_quantity for one in rest):
        return False  # "press on the mat to see if it is soft"
    return before is None or before.has(",", "AND", "COND") or (at == 1 and before.has("F"))


def _is_part(spots: Sequence[Spot], at: int) -> bool:
    """True for a part of a body: "the lid of the mug", "the mug's handle"."""
    spot = spots[at]
    absent = spot.unknown or (spot.thing is not None and not spot.thing.names)
    if not (spot.has("PART") or absent) or spot.has("DEED"):
        return False
    after = [one for one in spots[at + 1 : at + 4] if not one.has("DET") or one.has("OF")]
    owned = len(after) > 1 and after[1].thing is not None
    owned = owned and (after[0].has("OF") or (spot.has("PART") and after[0].has("REL")))
    noun = next((one for one in reversed(spots[:at]) if not one.unknown), spot)
    before = spots[at - 1] if at else Spot(0, 0)
    if (owned and noun is not spot and noun.has("DET", "OF")) or before.has("'S"):
        return True
    return spot.has("PART") and (before.has("ITS") or before.thing is not None)


def _unfelt(sentences: Sequence[Sentence], resolver: Resolver) -> Iterator[str]:
    """Yield a message for each property that nothing measures."""
    for one in sentences:
        for at, spot in enumerate(one.spots):
            adjective = any(after.thing for after in one.spots[at + 1 : at + 2])
            asks = not (spot.is_quantity or adjective or one.has("COND"))
            if spot.has("UNFELT") and asks:
                spot.used = True
                yield resolver.not_measurable(spot.classes["UNFELT"], one.text(spot))


def _within(sentences: Sequence[Sentence], reading: Reading) -> tuple[tuple[str, str], ...]:
    """Return the widths that the request states, by quantity."""
    found: dict[str, str] = {}
    ids = dict.fromkeys(parameter.quantity for parameter in reading.wanted)
    spots = [(one, spot.classes.get("AMOUNT", "")) for one in sentences for spot in one.spots]
    for sentence, text in spots:
        if text and (sentence.has("WIDTH") or text[0] in "±+"):
            value = amount(text.replace("~", " "))
            for id in ids:
                # A width in grams is that of a mass, not that of a height.
                with suppress(InputError):
                    parse_width(id, value)
                    found.setdefault(id, value)
    return tuple(found.items())


def stated_widths(request: str, scene: Scene) -> Within:
    """Return the half widths of intervals that a request states: "± 1 g", "to within 2 mm"."""
    try:
        found = ground(request, scene).within
    except PlanRejected as rejection:
        found = rejection.within
    except InputError:
        found = ()
    return Within.read(dict(found))


def _unused(sentence: Sentence) -> Iterator[str]:
    """Yield runs of words without a use, with the small words before them."""
    run: list[Spot] = []
    for spot in [*sentence.spots, Spot(0, 0, {".": ""})]:
        small = spot.thing is None and not spot.used and spot.has("DET", "OF")
        if small or _is_dead(spot) or (run and _is_dead(run[-1]) and spot.has("PRONOUN")):
            run.append(spot)
            continue
        while run and not _is_dead(run[-1]) and not run[-1].has("PRONOUN"):
            run.pop()
        if any(map(_is_dead, run)):
            yield " ".join(sentence.text(one) for one in run)
        run = []


def _is_dead(spot: Spot) -> bool:
    """True for a word that was not used."""
    if spot.unknown or spot.thing is not None:
        return not spot.used
    dead = spot.has("UNFELT", "PART", "DEED") and not spot.has("W", "A", "F", "MEASURE")
    return dead and not spot.used


_SYMBOLS = """
! COND OPEN PART CORRECT CHOICE PAST RATHER | d SIMULATE | k KNOWN IDEA | x EXCEPT | n NOT | l SKIP NEEDLESS
| c C MORE | t THAN ABOVE BELOW | w W | q N INERTIAL UNIT UNFELT | a A | e EVERYTHING ELSE | z MISSING VAGUE
| & AND , BUT : TOGETHER | o OR | r THATOF | f OF | i ITS PRONOUN | 9 AMOUNT | h HOW
"""
"""Symbols of classes in the forms of sure sentences, the most significant first."""
_THINGS = r"(?:[fr]*[Te](?:[&fr]+[Te])*)"
_PLAIN = r"(?:[Te](?:&+[Te])*)"
_QUANTITY = r"(?:i?q(?:&*i?q)*)"
_ASK = (
    rf"(?:{_QUANTITY}f*h?{_THINGS}|h*w+h?{_THINGS}h?|h?{_PLAIN}h?w|{_PLAIN}[&h]*{_QUANTITY}|h+[aq]h?f?{_THINGS}h?|"
    rf"h?{_PLAIN}&*h+a|h?{_PLAIN}a|w?ih?|h+iw+|iq|h+ah?i?h?|{_PLAIN}h*|f{_THINGS}&*{_QUANTITY}|r{_THINGS}|[frh]*zf?i?|"
    rf"{_PLAIN}?h+[aq]h?i?h*|{_PLAIN}?{_QUANTITY}h*z|h*z{_QUANTITY}f{_THINGS}|erh*z)"
)
_ASKED = rf"(?:{_ASK}(?:(?:h*&[&h]*|(?=h*i)){_ASK})*)"
_LESS = rf"&*(?:x|n|xn|nx)(?:i?[qa]*{_THINGS}q?|i?q+)h?"
_SAID = (
    rf"(?:n+k(?:{_ASKED})|k(?:{_ASKED})(?:{_LESS})*|(?:{_ASKED})h?n*k?|nw{_THINGS}|l(?:{_ASKED})|"
    rf"(?:{_ASKED})n?l|(?:{_ASKED})(?:{_LESS})*|(?:&*x{_THINGS}h?)+&*(?:{_ASKED})|"
    rf"(?=[^&]*h)[hcTewqao&9ifrt]*c[hcTewqao&9ifrt]*|h*t[aq]t[fTe]+|hTt[aq]tT|d+[hdiTeqa&z]*)"
)
SURE = re.compile(
    rf"h*{_QUANTITY}h*|{_QUANTITY}(?:&*(?:x|n|xn|nx){_THINGS})+|[&h]*{_SAID}(?:h*&[&h]*{_SAID})*[&h]*"
)
"""Forms of sure English sentences, as symbols of their spots."""


def is_sure(sentence: Sentence) -> bool:
    """True if all words of an English sentence belong to a form that has one meaning."""
    symbols = _symbols(sentence)
    # "Everything" beside a body is a remark, unless the body is an exception. Which of several
    # bodies an exception means may be open.
    mixed = {"e", "T"} <= set(symbols) and {"x", "n", "l"}.isdisjoint(symbols)
    mixed = mixed or (symbols.count("T") > 2 and not {"x", "l"}.isdisjoint(symbols))
    # "The mug is heavier than the bottle." may be a remark.
    remark = not sentence.question and is_comparison(sentence) and symbols.lstrip("&")[:1] == "T"
    return SURE.fullmatch(symbols) is not None and not mixed and not remark


def _symbols(sentence: Sentence) -> str:
    """Return the form of a sentence; small words and places have no symbol."""
    form, symbols = "", [row.split() for row in _SYMBOLS.split("|")]
    simulates = sentence.has("DEED")
    for at, spot in enumerate(sentence.spots):
        purpose = any(one.has("SIMULATE") for one in sentence.spots[at + 1 : at + 3])
        if spot.has("FOR") and purpose and not simulates:
            continue  # "for our simulation"
        if spot.has("AMOUNT") and (sentence.has("WIDTH") or spot.classes["AMOUNT"][0] in "±+"):
            continue  # "± 1 g"
        pronoun = spot.has("ONE") and form[-1:] == "T" and spot.thing is None
        if pronoun or (spot.has("FLOOR") and form[-1:] == "q"):
            continue  # "the red one"
        if spot.thing is not None and not spot.has("MARK"):
            form += "T"
        elif spot.unknown:
            form += "?"
        elif spot.has("REL") and not spot.used:
            form += "" if sentence.has("SIMULATE") else "?"
        elif spot.has("SIMULATE") and not simulates:
            continue
        elif not spot.has("MARK", "REL"):
            form += next((one for one, *names in symbols if spot.has(*names)), "")
    return form
