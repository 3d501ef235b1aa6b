"""Spots of a sentence: quantities, objects and words of scope, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from palpate.common.parameter import PlanRejected
from palpate.planning.request.nouns import Nouns, Phrase
from palpate.planning.request.whereabouts import farthest, standing
from palpate.planning.request.words import Classes, languages, nearest_spelling, singulars
from palpate.scene.scene import Scene

QUANTITIES = ("W", "A", "C", "N", "INERTIAL")
"""Classes of words that name a quantity."""
_BEFORE_NOUN = (
    *("DET", "OF", "W", "ALL", "NUM", "ITS", "EXCEPT", "N", "REL"),
    *("AND", "OR", "SEL", "THATOF", "WHICH"),
)
"""Classes after which a word that is also a noun is read as one."""
_BEFORE_ADJECTIVE = (
    *("DET", "ALL", "AND", "OR", ",", "THATOF", "ONE", "EXCEPT", "NOT", "NUM"),
    *("WHICH", "SEL", "W", "BUT"),
)
"""Classes after which an adjective stands for a body: "the red"."""
_WITH = ("with", "mit", "avec", "con")
"""Words before the contents of a container."""
_SMALL = ("DET", "OF", "NUM", "SEL", "ALL", "F")


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
        used: the meaning is part of the reading.
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

    @property
    def ids(self) -> set[str]:
        """Quantities that the words may name."""
        return {value for name, value in self.classes.items() if name in QUANTITIES}


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
        for at in range(len(words) - 1, -1, -1):
            self._repair(words, at)
        found: list[Spot] = []
        while (at := found[-1].end if found else 0) < len(words):
            found.append(self._spot(words, at, found))
        self._complete(found)
        self._quantify(found)
        for at, spot in enumerate(found):
            said = at > 0 and found[at - 1].has("HOW")  # "that is all"
            if spot.has("ALL") and spot.thing is None and not said and not _applies(found, at):
                pair = spot.classes["ALL"] and self._last and at > 0
                # "The mug and the box: mass each", but "except the mug, weigh all".
                excepts = any(one.has("EXCEPT", "SKIP", "NOT") for one in found[:at])
                floats = not excepts and any(one.thing for one in found[:at])
                spot.classes = {"PRONOUN": "many"} if pair or floats else {"EVERYTHING": ""}
            if spot.thing is not None:
                spot.thing = self._restricted(spot.thing, found, at)
        self._describe_everything(found, words)
        self._relate(found)
        self._find_side(found)
        return found

    def _repair(self, words: list[str], at: int) -> None:
        """Join the words of a noun, split a compound, and correct the spelling, in place."""
        word, joined = words[at], "".join(words[at : at + 2])
        names = self.nouns.names
        if joined in names and word not in names and joined != word:
            words[at : at + 2] = [joined]  # "note book"
            return
        for length in (4, 3, 2):
            if (noun := "_".join(words[at : at + length])) in self.language.nouns:
                words[at : at + length] = [noun]  # "chiave inglese"
                return
        known = names | self.language.words
        compound = self.code == "de" and known.isdisjoint(singulars(word))
        parts = self.language.parts(word) if compound else None
        if parts is not None and (not self._is_known(words, at) or self.language.is_noun(parts[1])):
            words[at : at + 1] = list(parts)
        elif self._is_known(words, at):
            return
        elif meant := nearest_spelling(word, known):
            self.slips[word] = words[at] = meant
        elif self.code == "de":
            # The head of a compound: "Kasten" for "Probenkasten".
            tails = (word[start:] for start in range(3, len(word) - 2))
            words[at] = next(filter(self.language.is_noun, tails), word)

    def _is_known(self, words: Sequence[str], at: int) -> bool:
        if not words[at].isalpha() or self.nouns.match(words, at, self.code):
            return True
        starts = range(max(0, at - 4), at + 1)
        covered = any(self.language.match(words, one)[0] > at - one for one in starts)
        return covered or self._plural(words[at], {})[0] > 0

    def _spot(self, words: list[str], at: int, found: Sequence[Spot]) -> Spot:
        word = words[at]
        if word[0] == "§" or not word[0].isalnum():
            name = {"§": "AMOUNT", "'": "'S", "!": ".", ";": "."}.get(word[0], word)
            return Spot(at, at + 1, {name: word[1:]})
        length, classes = self.language.match(words, at)
        if not classes or "N" in classes:
            plural, more = self._plural(word, classes)
            length, classes = (plural, more) if plural else (length, classes)
        phrase = self._narrowed(self.nouns.match(words, at, self.code), words, at)
        if length == 0 and phrase is None and self.code != "en":
            # Quantities are often said in English.
            length, classes = languages()["en"].match(words, at)
            classes = {n: v for n, v in classes.items() if n in (*QUANTITIES, "PART")}
        if phrase is not None and length < phrase.length:
            classes = {}
        modal = phrase is not None and length > phrase.length and phrase.noun
        if phrase is not None and not modal and self._is_noun(words, at, classes, found, phrase):
            thing = Thing(" ".join(words[at : at + phrase.length]), phrase.names, phrase.plural)
            if phrase.inexact and self.code == "en" and word.rstrip("s") not in ("object", "thing"):
                means = " and ".join(f"'{name}'" for name in phrase.names)
                verb = "are taken to be" if phrase.plural else "is taken for"
                self.remarks.append(f"'{thing.text}' {verb} {means}.")
            kept = ("NUM",) if phrase.noun else ("NUM", "SEL")
            kept = {name: classes[name] for name in kept if name in classes}
            return Spot(at, at + phrase.length, kept, thing, phrase.noun)
        if classes:
            return Spot(at, at + length, classes)
        if phrase is not None and not phrase.noun:
            return Spot(at, at + phrase.length, {"ADJ": ""})
        return Spot(at, at + 1)

    def _narrowed(self, phrase: Phrase | None, words: Sequence[str], at: int) -> Phrase | None:
        """Return the bodies of a noun with a noun of contents: "box of tea" for `tea_box`."""
        if phrase is None or len(phrase.names) < 2 or at + phrase.length + 1 >= len(words):
            return phrase
        end = at + phrase.length
        if words[end] in _WITH or "OF" in self.language.match(words, end)[1]:
            said = self.nouns.find([*words[at:end], words[end + 1]], self.code)
            if said is not None and said.names and set(said.names) < set(phrase.names):
                return replace(phrase, length=phrase.length + 2, names=said.names)
        return phrase

    def _plural(self, word: str, classes: Classes) -> tuple[int, Classes]:
        """Return the class of the plural of a quantity: "masses"; 0 words for none."""
        for form in singulars(word, self.language.is_english)[1:]:
            _, single = self.language.match([form], 0)
            if "N" in single and (not classes or single["N"] == classes["N"]):
                return 1, {**classes, "N": single["N"], "PLURAL": ""}
        return 0, classes

    def _is_noun(
        self, words: Sequence[str], at: int, classes: Classes, found: Sequence[Spot], phrase: Phrase
    ) -> bool:
        """True if a word with other meanings is a noun here: "the can" against "can you"."""
        before = found[-1] if found else Spot(0, 0)
        if not phrase.noun:
            # "The one of steel".
            ones = ("DET", "THATOF", "ONE", "AND", "OR", "SOMETHING")
            made_of = len(found) > 1 and found[-2].has(*ones)
            of = before.has("OF") or (at > 0 and words[at - 1] in _WITH)
            introduced = before.has(*_BEFORE_ADJECTIVE) or (of and made_of)
            return introduced and (not classes or ("SEL" in classes and bool(phrase.names)))
        if not classes or set(classes) <= {"PART"}:
            return bool(phrase.names) or "PART" not in classes
        if not phrase.names:
            return before.has("DET", "OF") and "DEED" in classes
        return before.has(*_BEFORE_NOUN) or before.thing is not None

    def _complete(self, spots: list[Spot]) -> None:
        """Find the noun of adjectives: "the red and the blue box", "the red box or the blue"."""
        for at, spot in enumerate(spots):
            if spot.thing is None or spot.noun:
                continue
            others = [o for o in (*reversed(spots[:at]), *spots[at + 1 :]) if o.thing and o.noun]
            text = spot.thing.text.split()
            # "The boxes and the cans, but not the red ones": those of the bodies named before.
            lists = [o.thing.names for o in spots[:at] if o.thing and o.noun and o.thing.plural]
            names = tuple(n for n in spot.thing.names if any(n in one for one in lists))
            for head in [o.thing.text.split() for o in (*others, *self._last) if o.thing]:
                for noun in (head[-1], head[0]):
                    found = self.nouns.find([*text, noun], self.code)
                    names = names or (found.names if found and found.noun else ())
            prior = next((o for o in reversed(spots[:at]) if o.thing and o.noun), None)
            if prior and prior.thing and spots[at - 1].has("THATOF", "ONE", "OF"):
                fits = tuple(n for n in prior.thing.names if n in spot.thing.names)
                if fits and not prior.thing.plural:
                    prior.thing = replace(prior.thing, names=fits)  # "the cube, the one of steel"
            objects = tuple(name for name in spot.thing.names if name in self.scene.objects)
            spot.thing = replace(spot.thing, names=names or objects or spot.thing.names)
            spot.noun = True
        self._last = [spot for spot in reversed(spots) if spot.thing is not None] or self._last

    def _quantify(self, spots: list[Spot]) -> None:
        """Resolve quantities that depend on their neighbours."""
        self._settle(spots)
        named = [spot for spot in spots if spot.is_quantity]
        for spot, following in pairwise(named):
            if "height" in spot.ids and "com" in following.ids:
                # "The height of the centre of mass".
                spot.classes, following.classes = {"F": ""}, {"A": "com_3d"}
            elif spot.has("C") and following.has("N") and spot.end == following.start:
                spot.classes = {"MORE": ""}  # "the smallest mass"
            elif spot.ids & {"size", "height"} and spot.has("A") and following.has("N"):
                between = spots[spots.index(spot) + 1 : spots.index(following)]
                if all(one.has("F", "DET") for one in between):
                    spot.classes = {"F": ""}  # "a large mass"
        places = [spot for spot in spots if spot.has("WHERE")]
        if places and any("com" in spot.ids for spot in named):
            for spot in named:
                if {"size", "position"} & spot.ids:
                    spot.classes = {"F": ""}
        for spot in spots if not named else ():
            if spot.has("FLOOR"):
                spot.classes = {"A": "height"}
        for spot in places if not named else ():
            rest = [one for one in spots[spots.index(spot) + 1 :] if not one.has("F", "DET")]
            if not rest or rest[0].thing is not None:
                spot.classes = {"W": "position"}

    def _settle(self, spots: list[Spot]) -> None:
        """Choose between the meanings of adjectives, and of verbs that are also nouns."""
        done = any(spot.has("DONE") for spot in spots)
        effort = [spot for spot in spots if spot.has("EFFORT")]
        moved = next((spot for spot in spots if spot.has("MOVED")), None)
        if effort and moved is not None:
            # "How hard is it to open?"
            effort[0].classes, moved.classes = {"A": moved.classes["MOVED"]}, {"F": ""}
        mentioned = {name for one in spots if one.thing for name in one.thing.names}
        is_fixture = bool(mentioned) and mentioned <= set(self.scene.fixtures)
        for before, spot, after in zip([None, *spots], spots, [*spots[1:], None], strict=False):
            others = any(one.is_quantity for one in spots if one is not spot)
            if spot.has("DEED") and spot.has("N") and after is not None and after.has("OF"):
                spot.classes = {"N": spot.classes["N"]}  # "the grip of the mug"
            elif spot.has("KNOWN") and after and after.unknown and not done:
                spot.classes = {"F": ""}  # "I have lost the data sheet"
            elif spot.has("MORE") and after and after.thing and before and before.has("DET"):
                spot.classes = {"F": ""}  # "of the same box"
            elif spot.classes.get("UNFELT") == "viscosity" and is_fixture:
                spot.classes = {"A": "damping"}
            elif others and after and after.thing and spot.has("SEL") and spot.is_quantity:
                spot.classes = {"SEL": spot.classes["SEL"]}  # "the mass of the tallest can"
            elif others and spot.has("A") and before is not None and before.has("'S"):
                spot.classes = {"F": ""}  # "how stiff the drawer's slide is"

    def _restricted(self, thing: Thing, spots: list[Spot], at: int) -> Thing:
        """Restrict bodies by "all", numbers and sides."""
        before = _before(spots, at, _SMALL)
        chosen = _before(spots, at, (*_SMALL, "C", "MORE", "A"))
        above = spots[at - 2].thing if at > 1 and not before and spots[at - 1].has("AND") else None
        listed = above is not None and above.plural  # "every tool and can"
        if listed or any(o.has("WHICH", "C") or (o.has("MORE") and not o.has("F")) for o in chosen):
            thing = replace(thing, plural=True)
        if any(one.has("ALL") for one in before):
            thing = replace(thing, plural=True)
            for one in before:
                one.used = True
        if self.code == "de" and len(thing.names) > 1 and self._is_unmarked(spots, at, thing):
            thing = replace(thing, plural=True)
        number = next((one.classes["NUM"] for one in before if one.has("NUM")), "")
        if number and thing.names:
            if len(thing.names) != int(number):
                raise PlanRejected(
                    f"the scene has {len(thing.names)} of '{thing.text}', not {number}: "
                    f"{', '.join(thing.names)}; name those that are meant"
                )
            thing = replace(thing, plural=True)
        sides = [one for one in before if one.has("SEL")]
        for one in spots[at + 1 : at + 6]:
            if one.has("SEL") and not one.has("REL"):
                sides.append(one)
            if not one.has("DET", "F", "SEL"):
                break
        for one in sides:
            one.used = True
        wide = self.nouns.find(thing.text.split(), self.code) if sides else None
        if wide is not None and len(wide.names) > 1 and len(thing.names) == 1:
            thing = replace(thing, names=wide.names)  # `left_box` is not "the left box"
        if sides and len(thing.names) > 1:
            return self._at_side(sides[0], thing.names, thing.text)
        return thing

    def _describe_everything(self, spots: list[Spot], words: list[str]) -> None:
        """Restrict "everything" by an adjective after it: "everything made of metal"."""
        for at, spot in enumerate(spots):
            for one in spots[at + 1 : at + 7] if spot.has("EVERYTHING") else ():
                if one.has("ADJ"):
                    said = words[one.start : one.end]
                    found = self.nouns.find(said, self.code)
                    spot.thing = Thing(" ".join(said), found.names if found else (), plural=True)
                    spot.classes, one.used = {}, True
                if not one.unknown and not one.has("DET", "F", "OF", "HOW", "SOMETHING", "REL"):
                    break

    def _is_unmarked(self, spots: Sequence[Spot], at: int, thing: Thing) -> bool:
        """True for a German noun that may be a plural: "Würfel wiegen", "Massen der Werkzeuge"."""
        plural = any(one.has("PLURAL", "MANY") for one in spots[:at])
        bare = at == 0 or not spots[at - 1].has("DET")
        return thing.text.endswith(("e", "el", "er", "en")) and (plural or bare)

    def _at_side(self, side: Spot, names: Sequence[str], text: str) -> Thing:
        name, remark = farthest(side.classes["SEL"], names, self.scene, text)
        self.remarks += [remark] if remark else []
        return Thing(text, (name,))

    def _find_side(self, spots: list[Spot]) -> None:
        """Resolve a side without a noun: "what is leftmost"."""
        loose = [one for one in spots if one.has("SEL") and not (one.used or one.thing)]
        if loose and any(one.has("EVERYTHING", "SOMETHING", "ONE") for one in spots):
            loose[0].thing = self._at_side(loose[0], tuple(self.scene.objects), "object")
            loose[0].used = False
            _drop_everything(spots)

    def _relate(self, spots: list[Spot]) -> None:
        """Restrict bodies by a relation to others: "the box next to the mug"."""
        acts = any(spot.classes.get("DEED") == "" for spot in spots)
        if acts and not any(spot.is_quantity for spot in spots):
            return  # "put the mug on the box"
        for at, spot in enumerate(spots):
            if not spot.has("REL") or spot.used:
                continue
            relation = spot.classes["REL"]
            if relation == "between" and at and spots[at - 1].has(*QUANTITIES, "MORE"):
                spot.classes = {"OF": ""}  # "friction between the mug and the table"
                continue
            marks = _marks(spots, at, 2 if relation == "between" else 1)
            names = [name for one in marks if one.thing for name in one.thing.names]
            on_surface = all(name in self.scene.surfaces for name in names)
            subject = _subject(spots, at, on_surface)
            if subject is None and names and _is_anything(spots, at, marks):
                thing = Thing("object", tuple(self.scene.objects), relation in ("on", "in"))
                subject = Spot(spot.start, spot.start, {}, thing)
                spots.insert(at, subject)
            if subject and subject.thing and set(names) >= set(subject.thing.names) != set():
                subject.thing, subject.classes = None, {}  # "tea in the tea box"
                continue
            others = [s for s in spots if s.thing and s not in marks and s.thing.names]
            if not marks or (subject is None and not (others and on_surface)):
                continue
            for one in marks:
                one.used, one.classes = True, {**one.classes, "MARK": ""}
            spot.used = True
            if subject is not None and subject.thing is not None and subject.thing.names:
                thing = subject.thing
                found, remark = standing(relation, thing.text, thing.names, names, self.scene)
                self.remarks += [remark] if remark else []
                subject.thing = replace(thing, names=found)


def _applies(spots: Sequence[Spot], at: int) -> bool:
    """True for "all" before bodies or a quantity."""
    for one in spots[at + 1 :]:
        if one.thing is not None or one.is_quantity or one.has("PARAMETERS", "MISSING"):
            return True
        if not one.has("DET", "OF", "NUM", "F", "ALL"):
            return False
    return False


def _before(spots: Sequence[Spot], at: int, names: Sequence[str]) -> list[Spot]:
    """Return the spots of these classes directly before a position."""
    start = at
    while start and spots[start - 1].thing is None and spots[start - 1].has(*names):
        start -= 1
    return list(reversed(spots[start:at]))


def _marks(spots: Sequence[Spot], at: int, count: int) -> list[Spot]:
    """Return the bodies to which a relation refers; two after "between"."""
    marks: list[Spot] = []
    for spot in spots[at + 1 :]:
        if spot.thing is not None:
            marks.append(spot)
            if len(marks) == count or len(spot.thing.names) >= count == 2:
                return marks
        elif not spot.has("DET", "AND", "NUM", "ALL", "ONE", "F", "OF"):
            break
    return []


def _subject(spots: Sequence[Spot], at: int, on_surface: bool) -> Spot | None:
    """Return the bodies before a relation, if only verbs of position stand between."""
    for spot in reversed(spots[:at]):
        if spot.thing is not None:
            return None if spot.has("MARK") else spot
        between = spot.has("F", "DET", "REL", "SEL", "TOKNOW", "ONE")
        if not between and not (on_surface and (spot.is_quantity or spot.unknown)):
            return None
    return None


def _is_anything(spots: Sequence[Spot], at: int, marks: Sequence[Spot]) -> bool:
    """True for "what stands next to the mug" and "next to the mug is something"."""
    small = ("F", "TOKNOW", "WHERE", "DET", "SEL")
    for run in (list(reversed(spots[:at])), spots[spots.index(marks[-1]) + 1 :]):
        one = next((one for one in run if not one.has(*small) or one.has("SOMETHING")), Spot(0, 0))
        if one.has("SOMETHING") or (one.has("EVERYTHING") and one in spots[:at]):
            _drop_everything([one])
            return True
    return False


def _drop_everything(spots: Sequence[Spot]) -> None:
    for one in spots:
        if one.has("EVERYTHING"):
            one.classes = {"F": ""}
