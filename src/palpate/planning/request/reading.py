"""Meaning of a request: wanted and excluded parameters from the spots of its sentences.

A sentence is cut into fragments at commas, conjunctions and exceptions. Each fragment wants, excludes
or corrects. The quantities of successive wanting fragments are paired with their objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import quantities_by_verb
from palpate.planning.request.query import GRIPPER
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.spots import QUANTITIES, Spot, Thing
from palpate.planning.request.words import is_weight

_VERBS = (
    "W",
    "MEASURE",
    "WANT",
    "KNOWN",
    "TOKNOW",
    "SKIP",
    "NEEDLESS",
    "MISSING",
    "SIMULATE",
    "DEED",
    "VAGUE",
)
"""Classes of words that begin a statement of their own."""
_INERTIAL = ("mass", "com", "inertia")


@dataclass(slots=True)
class Fragment:
    """Part of a sentence with one polarity.

    Attributes:
        intro: classes of the words that separate it from the part before.
        spots: its words.
        wanted: True if it asks for its parameters, False if it excludes them.
    """

    intro: frozenset[str]
    spots: list[Spot] = field(default_factory=list[Spot])
    wanted: bool = True

    def has(self, *names: str) -> bool:
        """True if one of the words has one of these classes."""
        return any(spot.has(*names) for spot in self.spots)

    @property
    def things(self) -> list[Spot]:
        """Words that name bodies, without landmarks."""
        return [spot for spot in self.spots if spot.thing is not None and not spot.has("MARK")]

    @property
    def quantities(self) -> list[Spot]:
        """Words that name quantities."""
        return [spot for spot in self.spots if spot.is_quantity]

    def resumed_by(self, spot: Spot) -> bool:
        """True for a verb after an exception: "everything except the mug must be weighed"."""
        return (
            "EXCEPT" in self.intro
            and bool(self.things)
            and spot.has("W", "MISSING", "WANT", "MEASURE", "F")
            and not spot.has("DET")
        )

    @property
    def continues(self) -> bool:
        """True if it may belong to the list of the fragment before."""
        return not self.has(*_VERBS, "NOT", "C", "EVERYTHING", "ELSE", "ALL", "A")


def fragments(spots: Sequence[Spot]) -> list[Fragment]:
    """Cut a sentence into fragments."""
    found = [Fragment(frozenset())]
    for spot in spots:
        if found[-1].resumed_by(spot):
            found.append(Fragment(frozenset({"RESUME"})))
        rest = spots[spots.index(spot) :]
        if spot.has(":") and any(o.is_quantity for o in rest) and any(o.thing for o in rest):
            spot.classes = {**spot.classes, ",": ""}
        if spot.has(":") and "EXCEPT" in found[-1].intro and found[-1].things:
            found.append(Fragment(frozenset({"RESUME"})))
        separates = spot.has(",", "AND", "BUT", "RATHER", "EXCEPT", "CORRECT", "OR")
        last = found[-1].spots[-1] if found[-1].spots else None
        everything = last is not None and (
            last.has("EVERYTHING", "ALL", "ELSE") or (last.thing is not None and last.thing.plural)
        )
        if spot.has("EXCEPT") and spot.has("MORE") and not everything:
            separates = spot.has("AND", "BUT")  # "pesa menos"
        if spot.has("BUT") and everything:
            spot.classes = {"EXCEPT": ""}  # "everything but the mug"
        if spot.has("CORRECT") and spot.has("NOT") and len(spots) > 1:
            # A plain "no" negates; "no," corrects.
            separates = any(o.start == spot.end and o.has(",") for o in spots)
        if separates:
            spot.used = True
            if found[-1].spots:
                found.append(Fragment(frozenset()))
            found[-1].intro |= frozenset(spot.classes)
        else:
            found[-1].spots.append(spot)
    found = [one for one in found if one.spots]
    for one, following in pairwise(found):
        # "No, excuse me, the blue one."
        if "CORRECT" in one.intro and not one.things and not one.quantities:
            following.intro |= {"CORRECT"}
    return found


@dataclass
class Reading:
    """State of the interpretation of a request.

    Attributes:
        resolver: resolves quantities and bodies to parameters.
        compares: the request compares, so that every candidate is wanted.
        simulates: the request is for a simulation of an action.
        bare: the request consists of bodies alone.
        asked, excluded: the parameters.
        remarks: interpretations of implicit wishes.
        guessed: the reading needs the user's confirmation.
    """

    resolver: Resolver
    compares: bool = False
    simulates: bool = False
    bare: bool = False
    asked: list[Parameter] = field(default_factory=list[Parameter])
    excluded: set[Parameter] = field(default_factory=set[Parameter])
    remarks: list[str] = field(default_factory=list[str])
    guessed: bool = False
    looked: bool = False
    _mentions: list[list[Thing]] = field(default_factory=list[list[Thing]])
    _last: list[str] = field(default_factory=list[str])
    _seen: list[str] = field(default_factory=list[str])
    _previous: list[Parameter] = field(default_factory=list[Parameter])
    _base: bool = True
    _spared: bool = False
    _named: set[str] = field(default_factory=set[str])
    _quantified: bool = False
    _alone: list[Thing] = field(default_factory=list[Thing])
    _purposes: list[tuple[str, list[Thing]]] = field(default_factory=list[tuple[str, list[Thing]]])
    _missing: list[list[Thing]] = field(default_factory=list[list[Thing]])

    @property
    def wanted(self) -> tuple[Parameter, ...]:
        """Parameters that are requested and not excluded."""
        asked = self.resolver.order_parameters(self.asked)
        return tuple(one for one in asked if one not in self.excluded)

    def take(self, spots: Sequence[Spot], question: bool) -> None:
        """Interpret the next sentence.

        Raises:
            InputError: it names an unknown body.
            PlanRejected: it is ambiguous.
        """
        run: list[Fragment] = []
        before: Fragment | None = None
        says = {name for spot in spots for name in spot.classes}
        whole = any(
            part.has("KNOWN")
            and part.has("EVERYTHING", "ALL", "ELSE")
            and not part.has("W", "MEASURE")
            for part in fragments(spots)
        )
        if whole and "EXCEPT" in says and not question and not says & {"NOT", "TOKNOW", "MISSING"}:
            # "Apart from the mug, everything is known."
            for part in fragments(spots):
                if "EXCEPT" in part.intro:
                    self._missing.append(self._things(part.things))
            return
        for part in fragments(spots):
            part.wanted = self._polarity(part, before, question)
            if "CORRECT" in part.intro and (part.things or part.quantities):
                self._want(run, question)
                self._correct(part)
                run = []
            if part.wanted:
                run.append(part)
            else:
                self._exclude(part)
            seen = [id for spot in part.quantities for id in self._ids(spot)]
            self._seen = seen or self._seen
            before = part
        self._want([part for part in run if part.wanted], question)
        self._spared = before is not None and not before.wanted

    def _polarity(self, part: Fragment, before: Fragment | None, question: bool) -> bool:
        """Return True if a fragment asks for its parameters."""
        denied = part.has("NOT")
        if "RATHER" in part.intro or "CORRECT" in part.intro:
            self._base = True
            return True
        if part.has("SKIP", "NEEDLESS") and not part.has("MISSING"):
            return False
        if "RESUME" in part.intro:
            return True
        if "EXCEPT" in part.intro:
            return not self._base
        if denied and part.has("YET") and part.has("DONE"):
            return True
        stated = (
            part.has("AMOUNT")
            and not question
            and not part.has("WIDTH", "MORE", "C", "THAN", "ABOVE", "BELOW")
        )
        stated = stated and not any(
            spot.classes.get("AMOUNT", " ")[0] in "±+" for spot in part.spots
        )
        if stated and (part.things or part.quantities) and not part.has("WANT", "MEASURE"):
            self._base = False
            return False
        if part.has("KNOWN") and not part.has("TOKNOW"):
            wanted = denied or question or part.has("MISSING")
            self._base = wanted
            return wanted
        if denied and part.has("IDEA", "TOKNOW"):
            return True
        if denied and self.compares and question:
            return True
        if denied and part.has("WANT", "W", "MEASURE", "DEED", "MISSING", "DONE"):
            self._base = True
            return False
        if denied:
            # "but not the mug": the opposite of the statement before.
            if (
                not part.things
                and not part.quantities
                and before is not None
                and (before.things and before.continues and not before.quantities)
            ):
                before.wanted = not self._base
                if not before.wanted:
                    self._exclude(before)
                return before.wanted
            # "It does not wobble" excludes nothing.
            return not self._base or any(spot.unknown for spot in part.spots)
        if before is not None and not before.wanted and part.continues:
            # "all but the mug: masses"
            if "EXCEPT" in before.intro and part.quantities and not self._seen:
                return True
            # "except the mug and the box", but "not the mug, the box".
            contrast = (
                before.has("NOT", "NEEDLESS")
                and "AND" not in part.intro
                and "EXCEPT" not in before.intro
            )
            return contrast or bool(part.quantities and part.things and "AND" not in part.intro)
        if part.has(*_VERBS):
            self._base = True
        return True

    def _correct(self, part: Fragment) -> None:
        """Replace what was asked last."""
        self.asked = [one for one in self.asked if one not in self._previous]
        if part.quantities and not part.things:
            names = dict.fromkeys(one.object for one in self._previous)
            self._mentions.append([Thing(name, (name,)) for name in names])
        elif part.things:
            self._last = list(dict.fromkeys(one.quantity for one in self._previous)) or self._last

    # Pairing of quantities with bodies.

    def _want(self, run: Sequence[Fragment], question: bool) -> None:
        # "... of the mug, and of the box its friction" begins anew.
        for at, part in enumerate(run):
            begins = part.spots[0].has("OF") and part.things and part.quantities
            if at and begins and part.things[0].start < part.quantities[0].start:
                self._want(run[:at], question)
                self._want(run[at:], question)
                return
        spots = [spot for part in run for spot in part.spots]
        before = len(self.asked)
        for spot in spots:
            spot.used = spot.used or (self.simulates and bool(spot.classes.get("DEED")))
        pairs, alone = self._pair(spots)
        asks = question or any(spot.has("THAN", "ABOVE", "BELOW") for spot in spots)
        if (
            not pairs
            and asks
            and alone
            and any(is_weight(s.classes.get("AMOUNT", "")) for s in spots)
        ):
            pairs, alone = [(["mass"], alone, False)], list[Thing]()
        unweighed = any(part.has("YET") and part.has("DONE") and part.has("NOT") for part in run)
        if unweighed:  # "what was never weighed"
            pairs = [
                (ids, [one for one in things if one.text != "everything"], every)
                for ids, things, every in pairs or [(["mass"], list[Thing](), False)]
            ]
        for ids, things, every in pairs:
            self._quantified = True
            self._last = ids
            for id in ids:
                self._add(id, things, every or unweighed, spots)
        if pairs:
            self._alone_of(alone)
        elif alone or any(spot.has("EVERYTHING", "ALL", "ELSE") for spot in spots):
            self._without_quantity(run, spots, alone)
        elif any(part.has("MISSING", "VAGUE", "PARAMETERS", "SIMULATE") for part in run):
            self._missing.append([])
        self._previous = self.asked[before:] or self._previous

    def _alone_of(self, alone: list[Thing]) -> None:
        if alone:
            self._mentions.append(alone)

    def _without_quantity(
        self, run: Sequence[Fragment], spots: Sequence[Spot], alone: list[Thing]
    ) -> None:
        """Interpret bodies without a quantity: those of the last quantity, or all that is missing."""
        everything = [
            self._everything(spot)
            for spot in spots
            if spot.has("EVERYTHING", "ALL", "ELSE") and not spot.used
        ]
        things = alone or everything[:1]
        verb = next((spot.classes["DEED"] for spot in spots if spot.classes.get("DEED")), "")
        missing = any(part.has("MISSING", "VAGUE", "PARAMETERS") for part in run)
        if self.simulates and verb and alone:
            moved = [one for one in alone if one.text != "everything" and one.names != (GRIPPER,)]
            self._purposes.append((verb, moved or alone))
        elif missing or (
            any(part.has("MEASURE") for part in run)
            and not self._last
            and not any(spot.unknown for spot in spots)
        ):
            self._missing.append(things)
        elif self._last:
            # A mere body after an exclusion may be meant either way.
            self.guessed = self.guessed or (
                self._spared and not run[0].intro & {"BUT", "RATHER"} and not run[0].has("THATOF")
            )
            for id in self._last:
                self._add(id, things, True, spots)
        else:
            self._alone += things
        if alone:
            self._mentions.append(alone)

    def _everything(self, spot: Spot) -> Thing:
        names = tuple(self.resolver.scene.bodies)
        if spot.has("ELSE"):
            before = {name for things in self._mentions for one in things for name in one.names}
            names = tuple(name for name in names if name not in before | self._named)
        return Thing("everything", names, plural=True)

    def _pair(
        self, spots: Sequence[Spot]
    ) -> tuple[list[tuple[list[str], list[Thing], bool]], list[Thing]]:
        """Pair quantities with bodies; also return the bodies without a quantity."""
        groups: list[tuple[str, list[Spot]]] = []
        for at, spot in enumerate(spots):
            kind = "Q" if spot.is_quantity else "T" if self._is_thing(spot) else ""
            if self.simulates and spot.has("DEED") and kind == "Q" and not spot.has("N"):
                kind = ""
            if not kind:
                continue
            if kind == "Q" and self._ends_group(spots, at, groups):
                groups.append(("Q", []))
            # "The mass of the bottle and mug friction": the mug belongs to the friction.
            follows = at + 1 < len(spots) and spots[at + 1].start == spot.end
            adjacent = kind == "T" and follows and spots[at + 1].has("N", "'S")
            if adjacent and len(groups) > 1 and groups[-1][0] == "T":
                groups.append(("T", []))
            if not groups or groups[-1][0] != kind:
                groups.append((kind, []))
            groups[-1][1].append(spot)
        colon = next((at for at, spot in enumerate(spots) if spot.has(":")), len(spots))
        rest = spots[colon + 1 :]
        if any(self._is_thing(spot) for spot in rest) and any(spot.is_quantity for spot in rest):
            before = [spot for spot in spots[:colon] if self._is_thing(spot)]
            if before and not any(spot.is_quantity for spot in spots[:colon]):
                self._mentions.append(self._things(before))
                return self._pair(rest)
        if self.compares and len(groups) > 1:
            both = [
                [one for kind, members in groups if kind == each for one in members]
                for each in "QT"
            ]
            groups = [("Q", both[0]), ("T", both[1])] if all(both) else groups
        pairs: list[tuple[list[str], list[Thing], bool]] = []
        alone: list[Thing] = []
        used: set[int] = set()
        for at, (kind, members) in enumerate(groups):
            if kind != "Q":
                continue
            after = groups[at + 1] if at + 1 < len(groups) and groups[at + 1][0] == "T" else None
            prior = (
                groups[at - 1] if at and groups[at - 1][0] == "T" and at - 1 not in used else None
            )
            if self._has_its(spots, members[0]) or (
                prior is not None
                and after is not None
                and self._binds_back(spots, members, after, at + 1 == len(groups) - 1)
            ):
                after = None
            if after is not None and prior is not None:
                alone += self._things(prior[1])
                used.add(at - 1)
            chosen, place = (after, at + 1) if after is not None else (prior, at - 1)
            things: list[Thing] = []
            if chosen is not None:
                used.add(place)
                things = self._things(chosen[1])
                # "The mug's mass and that of the bottle".
                if (
                    place < at
                    and at + 1 < len(groups)
                    and groups[at + 1][0] == "T"
                    and at + 1 not in used
                    and at + 2 >= len(groups)
                ):
                    used.add(at + 1)
                    things += self._things(groups[at + 1][1])
            every = any(self._is_every(spots, member) for member in members)
            every = every or (
                not self._mentions and any("PLURAL" in one.classes for one in members)
            )
            ids = list(dict.fromkeys(id for member in members for id in self._ids(member)))
            for member in members:
                member.used = True
            pairs.append((ids, things, every))
            if things:
                self._mentions.append(things)
        for at, (kind, members) in enumerate(groups):
            if kind == "T" and at not in used:
                things = self._things(members)
                if (
                    pairs
                    and at > 0
                    and any(place < at for place in used)
                    and not members[0].has("EVERYTHING")
                ):
                    pairs[-1] = (pairs[-1][0], [*pairs[-1][1], *things], pairs[-1][2])
                else:
                    alone += things
        return pairs, alone

    def _ends_group(
        self, spots: Sequence[Spot], at: int, groups: Sequence[tuple[str, list[Spot]]]
    ) -> bool:
        """True if a quantity begins a group of its own: "its mass and the friction of the box"."""
        if not groups or groups[-1][0] != "Q":
            return False
        last = groups[-1][1][-1]
        if self._has_its(spots, last) != self._has_its(spots, spots[at]):
            return True
        # "The bottle's mass, the friction of the mug": the first belongs to the body before.
        back = len(groups) > 1 and groups[-2][0] == "T"
        return back and self._is_of(spots, at) and not self._is_of(spots, spots.index(last))

    def _is_thing(self, spot: Spot) -> bool:
        if spot.has("MARK"):
            return False
        if spot.thing is not None:
            return True
        return spot.has("EVERYTHING", "ELSE") and not spot.used

    def _things(self, spots: Sequence[Spot]) -> list[Thing]:
        found: list[Thing] = []
        for spot in spots:
            spot.used = True
            found.append(spot.thing if spot.thing is not None else self._everything(spot))
        # A general noun refers to what was named before: "that thing".
        objects = tuple(self.resolver.scene.objects)
        general = [t for t in found if t.names == objects and not t.plural and len(objects) > 1]
        if general and not self.compares and (self._mentions or len(found) > len(general)):
            found = [one for one in found if one not in general]
        self._named.update(name for one in found for name in one.names if one.text != "everything")
        return found

    def _is_of(self, spots: Sequence[Spot], at: int) -> bool:
        """True if a quantity is followed by "of"."""
        return at + 1 < len(spots) and spots[at + 1].has("OF", "REL")

    def _has_its(self, spots: Sequence[Spot], spot: Spot) -> bool:
        """True for "its mass"."""
        at = spots.index(spot)
        return at > 0 and spots[at - 1].has("ITS") and not spots[at - 1].has("DET")

    def _binds_back(
        self,
        spots: Sequence[Spot],
        members: Sequence[Spot],
        after: tuple[str, list[Spot]],
        last: bool,
    ) -> bool:
        """True if quantities belong to the bodies before them, not to those after."""
        first, end = spots.index(members[0]), spots.index(members[-1])
        if self._is_of(spots, end) or (
            members[-1].has("W")
            and end
            and spots[end - 1].thing is None
            and not spots[end - 1].has("NOT")
        ):
            return False
        return first > 0 and (
            spots[first - 1].thing is not None or spots[first - 1].has("'S", "W", "F")
        )

    def _is_every(self, spots: Sequence[Spot], spot: Spot) -> bool:
        """True for all of a quantity: "all masses", "the weights"."""
        at = spots.index(spot)
        for one in reversed(spots[:at]):
            if one.has("ALL") and one.thing is None:
                one.used = True
                return True
            if not one.has("DET", "OF", "F", "MISSING"):
                break
        return False

    def _ids(self, spot: Spot) -> tuple[str, ...]:
        if spot.has("INERTIAL"):
            return _INERTIAL
        return tuple(spot.classes[n] for n in (*QUANTITIES, "UNIT") if spot.classes.get(n))[:1]

    # Parameters.

    def _add(self, id: str, things: list[Thing], every: bool, spots: Sequence[Spot]) -> None:
        """Ask for a quantity of bodies, else of the last mentioned ones, else of all."""
        resolver = self.resolver
        things = [one for one in things if one.text]
        if absent := [one for one in things if not one.names]:
            raise resolver.absent(absent[0])
        every_object = tuple(resolver.scene.objects)
        if self.compares:
            things = [Thing(t.text, t.names, t.plural or t.names == every_object) for t in things]
        can = [one for one in things if resolver.can_have([one], id)]
        if things and not can and len(self._last) > 1:
            can = []
        elif things:
            self.asked += resolver.parameters(id, can or things)
            return
        # Without bodies: the last mentioned ones that can have the quantity.
        for before in reversed(self._mentions):
            fit = [one for one in before if one.names and resolver.can_have([one], id)]
            if fit and not every:
                fit = [Thing(t.text, t.names, True) for t in fit] if self.compares else fit
                self.asked += resolver.parameters(id, fit)
                return
        carriers = resolver.carriers(id)
        if len(carriers) == 1 or every or self.compares:
            self.asked += resolver.parameters(id, [])
            return
        raise PlanRejected(resolver.of_what(id))

    def _exclude(self, part: Fragment) -> None:
        """Exclude the parameters of a fragment."""
        things = [one for one in self._things(part.things) if one.names]
        things += [self._everything(spot) for spot in part.spots if spot.has("EVERYTHING", "ELSE")]
        ids = [id for spot in part.quantities for id in self._ids(spot)]
        for spot in part.quantities:
            spot.used = True
        if part.has("THATOF") and not ids:
            ids = self._seen
        refers = part.has("ITS") or part.spots[0].has("WHICH", "SOMETHING")
        if ids and not things and refers and self._mentions:
            things = self._mentions[-1]
        if things or ids:
            for id in ids or [None]:
                self.excluded.update(self.resolver.exclusions(id, things))
        if ids:
            self._last = ids
        if things:
            self._mentions.append(things)

    def finish(self) -> None:
        """Complete the parameters after the last sentence.

        Raises:
            PlanRejected: bodies were named without a quantity.
        """
        if self._purposes and not self._quantified:
            self._aim()
        elif not self._quantified and self._missing:
            for things in self._missing:
                self._miss(things)
        elif not self._quantified and self._alone and self.bare:
            self._miss(self._alone)
        elif self._missing:
            for things in self._missing:
                if things:
                    self._miss(things)

    def _miss(self, things: Iterable[Thing]) -> None:
        """Ask for all missing parameters of bodies, or of the whole scene."""
        things = list(things)
        if absent := [one for one in things if not one.names]:
            raise self.resolver.absent(absent[0])
        found, remark = self.resolver.missing(things)
        self.asked += found
        self.looked = True
        self.remarks.append(remark)

    def _aim(self) -> None:
        """Ask for the quantities that a simulated action depends on.

        Values from an assumption, such as uniform density, are only offered.
        """
        offered: list[Parameter] = []
        for verb, things in self._purposes:
            if absent := [one for one in things if not one.names]:
                raise self.resolver.absent(absent[0])
            for id in quantities_by_verb().get(verb, ()):
                for one in self.resolver.parameters(id, things):
                    (offered if self.resolver.is_assumed(one) else self.asked).append(one)
        if offered:
            listed = ",".join(str(one) for one in dict.fromkeys(offered))
            self.remarks.append(f"Assumed, not measured: {listed}; add --measure {listed}.")
        self.looked = True


__all__ = ["Fragment", "InputError", "Reading", "fragments"]
