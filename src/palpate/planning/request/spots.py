"""Spots of a sentence: quantities, objects and words of scope, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from palpate.common.parameter import PlanRejected
from palpate.planning.request.nouns import LONGEST_NAME, Nouns, Phrase
from palpate.planning.request.whereabouts import farthest, standing
from palpate.planning.request.words import (
    Classes,
    languages,
    nearest_spelling,
    singulars,
)
from palpate.scene.scene import Scene

QUANTITIES = ("W", "A", "C", "N", "INERTIAL")
"""Classes of words that name a quantity."""
_BEFORE_ADJECTIVE = (
    "DET",
    "ALL",
    "AND",
    "OR",
    ",",
    "THATOF",
    "ONE",
    "EXCEPT",
    "NOT",
    "NUM",
    "WHICH",
    "SEL",
    "W",
    "BUT",
)
SIDES = ("left", "right", "near", "far")
"""Values of `SEL` that need no noun."""
_BEFORE_NOUN = frozenset(
    (
        "DET",
        "OF",
        "W",
        "ALL",
        "NUM",
        "ITS",
        "EXCEPT",
        "N",
        "REL",
        "AND",
        "OR",
        "SEL",
        "THATOF",
        "WHICH",
    )
)
"""Classes after which a word that is also a noun is read as one."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Bodies of a mention.

    Attributes:
        text: words of the mention.
        names: the bodies; several if it is a plural or ambiguous, none if the scene has none.
        plural: all of `names` are meant.
        known: the noun is a known word.
    """

    text: str
    names: tuple[str, ...]
    plural: bool = False
    known: bool = True


@dataclass(slots=True)
class Spot:
    """Words of a sentence with one meaning.

    Attributes:
        start, end: positions of the words.
        classes: classes of the words, each with its value; none for unknown words.
        thing: the bodies that the words name.
        noun: False for a mere adjective, such as "the red".
    """

    start: int
    end: int
    classes: Classes = field(default_factory=dict[str, str])
    thing: Thing | None = None
    noun: bool = True
    used: bool = False

    def has(self, *names: str) -> bool:
        """True if the words have one of these classes."""
        return any(name in self.classes for name in names)

    @property
    def unknown(self) -> bool:
        """True for words without a meaning."""
        return not self.classes and self.thing is None

    @property
    def is_quantity(self) -> bool:
        """True for words that name a quantity."""
        return self.has(*QUANTITIES) or bool(self.classes.get("UNIT"))


class Spotter:
    """Finds the spots of sentences about one scene.

    Attributes:
        remarks: readings that differ from the literal words.
        slips: the correct spelling of misspelt words.
    """

    def __init__(self, scene: Scene, nouns: Nouns, code: str) -> None:
        self.scene, self.nouns, self.code = scene, nouns, code
        self.language = languages()[code]
        self.remarks: list[str] = []
        self.slips: dict[str, str] = {}
        self._last: list[Spot] = []

    def spots(self, words: list[str]) -> list[Spot]:
        """Return the spots of a sentence; corrects the spelling of its unknown words in place."""
        found: list[Spot] = []
        self._repair_all(words)
        at = 0
        while at < len(words):
            spot = self._spot(words, at, found)
            found.append(spot)
            at = spot.end
        self._complete(found, words)
        self._quantify(found)
        self._select(found, words)
        return found

    def _quantify(self, spots: list[Spot]) -> None:
        """Resolve quantities that depend on their neighbours."""
        named = [spot for spot in spots if spot.is_quantity]
        for spot, following in pairwise(named):
            ids = [
                {v for n, v in one.classes.items() if n in QUANTITIES} for one in (spot, following)
            ]
            # "The height of the centre of mass", and "the smallest mass".
            if "height" in ids[0] and "com" in ids[1]:
                spot.classes, following.classes = {"F": ""}, {"A": "com_3d"}
            elif spot.has("C") and following.has("N") and spot.end == following.start:
                spot.classes = {"MORE": ""}
            elif ids[0] & {"size", "height"} and spot.has("A") and following.has("N"):
                between = spots[spots.index(spot) + 1 : spots.index(following)]
                if all(one.has("F", "DET") for one in between):
                    spot.classes = {"F": ""}
        if any(spot.has("WHERE") for spot in spots) and any(
            "com" in one.classes.values() for one in named
        ):
            for spot in named:
                if {"size", "position"} & set(spot.classes.values()):
                    spot.classes = {"F": ""}
        if not named:
            for spot in spots:
                if spot.has("FLOOR"):
                    spot.classes = {"A": "height"}
                after = next(
                    (o for o in spots[spots.index(spot) + 1 :] if not o.has("F", "DET")), None
                )
                if spot.has("WHERE") and (after is None or after.thing is not None):
                    spot.classes = {"W": "position"}

    def _repair_all(self, words: list[str]) -> None:
        """Correct unknown words, and join the parts of a name: "note book"."""
        for at in range(len(words) - 1, -1, -1):
            joined = "".join(words[at : at + 2])
            if (
                joined in self.nouns.names
                and words[at] not in self.nouns.names
                and joined != words[at]
            ):
                words[at : at + 2] = [joined]
            elif length := self._noun_of_words(words, at):
                words[at : at + length] = ["_".join(words[at : at + length])]
            elif not self._is_known(words, at):
                self._repair(words, at)

    def _noun_of_words(self, words: Sequence[str], at: int) -> int:
        """Return the number of words of a noun such as "chiave inglese"; 0 for none."""
        return next((n for n in (4, 3, 2) if "_".join(words[at : at + n]) in self.language.nouns), 0)

    def _is_known(self, words: Sequence[str], at: int) -> bool:
        if not words[at].isalpha() or self.nouns.match(words, at, self.code):
            return True
        if any(
            self.language.match(words, start)[0] > at - start
            for start in range(max(0, at - 4), at + 1)
        ):
            return True
        return self._plural(words, at, 0, {})[0] > 0

    def _spot(self, words: list[str], at: int, found: Sequence[Spot]) -> Spot:
        word = words[at]
        if word[0] == "§" or not word[0].isalnum():
            name = {"§": "AMOUNT", "'": "'S", "!": ".", ";": "."}.get(word[0], word)
            return Spot(at, at + 1, {name: word[1:]})
        length, classes = self.language.match(words, at)
        if not classes or "N" in classes:
            length, classes = self._plural(words, at, length, classes)
        phrase = self._narrowed(self.nouns.match(words, at, self.code), words, at)
        if length == 0 and phrase is None and self.code != "en":
            length, classes = languages()["en"].match(words, at)
            classes = {n: v for n, v in classes.items() if n in (*QUANTITIES, "PART")}
            length = length if classes else 0
        if phrase is not None and length < phrase.length:
            length, classes = 0, {}
        if phrase is not None and self._is_noun(words, at, classes, found, phrase):
            thing = Thing(" ".join(words[at : at + phrase.length]), phrase.names, phrase.plural)
            if (
                phrase.inexact
                and self.code == "en"
                and "object" not in thing.text
                and "thing" not in thing.text
            ):
                means = " and ".join(f"'{name}'" for name in phrase.names)
                verb = "are taken to be" if phrase.plural else "is taken for"
                self.remarks.append(f"'{thing.text}' {verb} {means}.")
            kept = {"NUM": classes["NUM"]} if "NUM" in classes else {}
            sel = {"SEL": classes["SEL"]} if "SEL" in classes and not phrase.noun else {}
            return Spot(at, at + phrase.length, {**kept, **sel}, thing, phrase.noun)
        if length:
            return Spot(at, at + length, classes)
        if phrase is not None and not phrase.noun:
            return Spot(at, at + phrase.length, {"ADJ": ""})
        return Spot(at, at + 1)

    def _narrowed(self, phrase: Phrase | None, words: Sequence[str], at: int) -> Phrase | None:
        """Return the bodies of a noun with a noun of contents: "box of tea" for `tea_box`."""
        if phrase is None or len(phrase.names) < 2 or at + phrase.length + 1 >= len(words):
            return phrase
        end = at + phrase.length
        if "OF" in self.language.match(words, end)[1]:
            said = self.nouns.find([*words[at:end], words[end + 1]], self.code)
            if said is not None and said.names and set(said.names) < set(phrase.names):
                return replace(phrase, length=phrase.length + 2, names=said.names)
        return phrase

    def _joins(self, words: Sequence[str], at: int) -> bool:
        """True for "and" or "or" before another body: "can or carabiner"."""
        joins = at + 1 < len(words) and self.language.match(words, at)[1].keys() & {"AND", "OR"}
        return (
            bool(joins)
            and words[at] not in ","
            and self.nouns.match(words, at + 1, self.code) is not None
        )

    def _plural(
        self, words: Sequence[str], at: int, length: int, classes: Classes
    ) -> tuple[int, Classes]:
        """Mark the plural of a quantity: "the masses"."""
        for form in singulars(words[at])[1:]:
            _, single = self.language.match([form], 0)
            if "N" in single and (not classes or single["N"] == classes["N"]):
                return 1, {**classes, "N": single["N"], "PLURAL": ""}
        return length, classes

    def _is_noun(
        self, words: Sequence[str], at: int, classes: Classes, found: Sequence[Spot], phrase: Phrase
    ) -> bool:
        """True if a word with other meanings is a noun here: "the can" against "can you"."""
        before = found[-1] if found else None
        if not phrase.noun:
            introduced = before is not None and before.has(*_BEFORE_ADJECTIVE)
            # "The one of steel".
            made_of = len(found) > 1 and found[-2].has("DET", "THATOF", "ONE", "AND", "OR")
            introduced = introduced or (before is not None and before.has("OF") and made_of)
            return introduced and (not classes or ("SEL" in classes and bool(phrase.names)))
        if not classes or set(classes) <= {"PART"}:
            return bool(phrase.names) or "PART" not in classes
        if not phrase.names:
            return before is not None and before.has("DET", "OF") and "DEED" in classes
        if self._joins(words, at + phrase.length):
            return True
        if before is not None and before.has(","):
            return len(found) > 1 and found[-2].thing is not None
        return before is not None and (before.has(*_BEFORE_NOUN) or before.thing is not None)

    def _repair(self, words: list[str], at: int) -> None:
        """Correct the spelling of an unknown word, or split a compound noun, in place."""
        word = words[at]
        if self.code == "de" and (parts := self.language.parts(word)):
            words[at : at + 1] = list(parts)
            return
        meant = nearest_spelling(word, self.nouns.names | self.language.words)
        if meant is not None:
            self.slips[word] = words[at] = meant

    def _complete(self, spots: list[Spot], words: Sequence[str]) -> None:
        """Find the noun of adjectives: "the red and the blue box", "the red box or the blue"."""
        for at, spot in enumerate(spots):
            if spot.thing is None or spot.noun:
                continue
            others = [o for o in (*reversed(spots[:at]), *spots[at + 1 :]) if o.thing and o.noun]
            others += self._last
            text = spot.thing.text.split()
            for other in others:
                assert other.thing is not None
                head = other.thing.text.split()
                found = [
                    phrase
                    for said in ([*text, head[-1]], [*text, head[0]])
                    if (phrase := self.nouns.find(said, self.code)) and phrase.noun and phrase.names
                ]
                if found:
                    spot.thing = replace(spot.thing, names=found[0].names)
                    break
            else:
                names = tuple(n for n in spot.thing.names if n in self.scene.objects)
                spot.thing = replace(spot.thing, names=names or spot.thing.names)
            spot.noun = True
        self._last = [spot for spot in reversed(spots) if spot.thing is not None] or self._last

    def _select(self, spots: list[Spot], words: Sequence[str]) -> None:
        """Restrict bodies by "all", numbers, sides, and their position relative to others."""
        for at, spot in enumerate(spots):
            said = at > 0 and spots[at - 1].has("HOW")  # "that is all"
            if spot.has("ALL") and spot.thing is None and not said and not self._applies(spots, at):
                spot.classes = {"EVERYTHING": ""}
            if spot.thing is None:
                continue
            before = self._before(spots, at, ("DET", "OF", "NUM", "SEL", "ALL", "F"))
            if not before:
                self._inherit(spots, at)
            chosen = self._before(
                spots, at, ("DET", "OF", "NUM", "SEL", "ALL", "F", "C", "MORE", "A")
            )
            if any(
                one.has("WHICH", "C") or (one.has("MORE") and not one.has("F")) for one in chosen
            ):
                spot.thing = replace(spot.thing, plural=True)
            if any(one.has("ALL") for one in before):
                spot.thing = replace(spot.thing, plural=True)
                _use(before)
            number = next((one.classes["NUM"] for one in before if one.has("NUM")), "")
            if number and spot.thing.names:
                spot.thing = self._counted(spot.thing, int(number))
            sides = [one for one in before if one.has("SEL")]
            for one in spots[at + 1 : at + 6]:
                if one.has("SEL") and not one.has("REL"):
                    sides.append(one)
                if not one.has("DET", "F", "SEL"):
                    break
            _use(sides)
            wide = self.nouns.find(spot.thing.text.split(), self.code) if sides else None
            if wide is not None and len(wide.names) > 1 and len(spot.thing.names) == 1:
                spot.thing = replace(spot.thing, names=wide.names)
            if sides and len(spot.thing.names) > 1:
                name, remark = farthest(
                    sides[0].classes["SEL"], spot.thing.names, self.scene, spot.thing.text
                )
                self.remarks += [remark] if remark else []
                spot.thing = Thing(spot.thing.text, (name,))
        self._relate(spots)
        loose = [
            one for one in spots if one.has("SEL") and not one.used and one.classes["SEL"] in SIDES
        ]
        if loose and any(one.has("EVERYTHING", "SOMETHING", "ONE") for one in spots):
            name, remark = farthest(
                loose[0].classes["SEL"], tuple(self.scene.objects), self.scene, "object"
            )
            self.remarks += [remark] if remark else []
            loose[0].thing, loose[0].used = Thing("object", (name,)), False
            for one in spots:
                if one.has("EVERYTHING"):
                    one.classes = {"F": ""}

    def _inherit(self, spots: Sequence[Spot], at: int) -> None:
        """Extend "every" to the next noun of a list: "every tool and can"."""
        spot = spots[at]
        if at > 1 and spot.thing is not None and spots[at - 1].has("AND"):
            other = spots[at - 2].thing
            if other is not None and other.plural:
                spot.thing = replace(spot.thing, plural=True)

    def _applies(self, spots: Sequence[Spot], at: int) -> bool:
        """True for "all" before bodies or a quantity."""
        for one in spots[at + 1 :]:
            if one.thing is not None or one.is_quantity or one.has("PARAMETERS", "MISSING"):
                return True
            if not one.has("DET", "OF", "NUM", "F", "ALL"):
                return False
        return False

    def _counted(self, thing: Thing, number: int) -> Thing:
        if len(thing.names) != number:
            raise PlanRejected(
                f"the scene has {len(thing.names)} of '{thing.text}', not {number}: "
                f"{', '.join(thing.names)}; name those that are meant"
            )
        return replace(thing, plural=True)

    def _before(self, spots: Sequence[Spot], at: int, names: Sequence[str]) -> list[Spot]:
        """Return the spots of these classes directly before a position."""
        found: list[Spot] = []
        for spot in reversed(spots[:at]):
            if spot.thing is not None or not spot.has(*names):
                break
            found.append(spot)
        return found

    def _relate(self, spots: list[Spot]) -> None:
        """Restrict bodies by a relation to others: "the box next to the mug"."""
        if any(spot.has("DEED") for spot in spots) and not any(o.is_quantity for o in spots):
            return  # "put the mug on the box"
        for at, spot in enumerate(spots):
            if not spot.has("REL") or spot.used:
                continue
            if spot.classes["REL"] == "between" and self._is_of(spots, at):
                spot.classes = {"OF": ""}
                continue
            marks = self._marks(spots, at)
            if not marks:
                continue
            relation = spot.classes["REL"]
            names = [name for one in marks if one.thing for name in one.thing.names]
            on_surface = all(name in self.scene.surfaces for name in names)
            subject = self._subject(spots, at, on_surface)
            others = [s for s in spots if s.thing and s not in marks and s.thing.names]
            if subject is None:
                if names and self._anything(spots, at, marks):
                    thing = Thing("object", tuple(self.scene.objects), relation in ("on", "in"))
                    subject = Spot(spot.start, spot.start, {}, thing)
                    spots.insert(at, subject)
                elif not (others and on_surface):
                    continue
            for one in marks:
                one.used, one.classes = True, {**one.classes, "MARK": ""}
            spot.used = True
            if subject is not None and subject.thing is not None and subject.thing.names:
                found, remark = standing(
                    relation, subject.thing.text, subject.thing.names, names, self.scene
                )
                self.remarks += [remark] if remark else []
                subject.thing = replace(subject.thing, names=found)

    def _anything(self, spots: Sequence[Spot], at: int, marks: Sequence[Spot]) -> bool:
        """True for "what stands next to the mug" and "next to the mug is something"."""
        for one in reversed(spots[:at]):
            if one.has("SOMETHING", "EVERYTHING"):
                if one.has("EVERYTHING"):
                    one.classes = {"F": ""}
                return True
            if not one.has("F", "TOKNOW", "WHERE", "DET", "SEL"):
                break
        end = spots.index(marks[-1])
        for one in spots[end + 1 :]:
            if one.has("SOMETHING"):
                return True
            if not one.has("F", "WHERE", "DET"):
                break
        return False

    def _is_of(self, spots: Sequence[Spot], at: int) -> bool:
        """True for "between" after a quantity: "friction between the mug and the table"."""
        return at > 0 and (spots[at - 1].is_quantity or spots[at - 1].has("MORE"))

    def _marks(self, spots: Sequence[Spot], at: int) -> list[Spot]:
        """Return the bodies to which a relation refers; two after "between"."""
        marks: list[Spot] = []
        wanted = 2 if spots[at].classes["REL"] == "between" else 1
        for spot in spots[at + 1 :]:
            if spot.thing is not None:
                marks.append(spot)
                if len(marks) == wanted or len(spot.thing.names) >= wanted == 2:
                    return marks
            elif not spot.has("DET", "AND", "NUM", "ALL", "ONE", "F", "OF"):
                break
        return []

    def _subject(self, spots: Sequence[Spot], at: int, on_surface: bool) -> Spot | None:
        """Return the bodies before a relation, if only verbs of position stand between."""
        for spot in reversed(spots[:at]):
            if spot.thing is not None:
                return None if spot.has("MARK") else spot
            between = spot.has("F", "DET", "REL", "SEL", "TOKNOW", "ONE")
            if not between and not (on_surface and (spot.is_quantity or spot.unknown)):
                return None
        return None


def _use(spots: Sequence[Spot]) -> None:
    for spot in spots:
        spot.used = True


__all__ = ["LONGEST_NAME", "Spot", "Spotter", "Thing"]
