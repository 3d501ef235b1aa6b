"""Meaning of a request: wanted and excluded parameters from the spots of its sentences.

1. A sentence is cut into clauses at commas, conjunctions and exceptions.
2. Each clause wants or excludes (`_polarity`), or corrects the wish before it.
3. The quantities and bodies of a run of wanting clauses are paired (`pair`).
4. The wishes and exclusions become parameters after the last sentence (`finish`). A named body or
   quantity has priority over "everything" and "the rest".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import quantities_by_verb
from palpate.planning.request.query import GRIPPER
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.spots import QUANTITIES, Spot, Thing
from palpate.planning.request.words import is_weight

_VERBS = (
    *("W", "MEASURE", "WANT", "KNOWN", "TOKNOW", "SKIP", "NEEDLESS", "MISSING", "SIMULATE"),
    *("DEED", "VAGUE"),
)
"""Classes of words that begin a statement of their own."""
_WHOLE = ("EVERYTHING", "ALL", "ELSE")
_SEPARATORS = (",", "AND", "BUT", "RATHER", "EXCEPT", "CORRECT", "OR", ":")
_INERTIAL = ("mass", "com", "inertia")


@dataclass(slots=True)
class Clause:
    """Part of a sentence with one polarity.

    Attributes:
        intro: classes of the words that separate it from the part before.
        spots: its words.
        wanted: True if it asks for its parameters, False if it excludes them.
    """

    intro: frozenset[str] = frozenset()
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

    @property
    def continues(self) -> bool:
        """True if it may belong to the list of the clause before."""
        return not self.has(*_VERBS, "NOT", "C", "EVERYTHING", "ELSE", "ALL", "A")

    @property
    def states(self) -> bool:
        """True for a statement of an amount: "the mug weighs 300 g"."""
        amounts = [spot.classes["AMOUNT"] for spot in self.spots if spot.has("AMOUNT")]
        asks = self.has("HEDGE", "WIDTH", "MORE", "C", "THAN", "ABOVE", "BELOW", "WANT", "MEASURE")
        named = self.things or self.quantities
        return bool(amounts and named and not asks) and all(one[0] not in "±+" for one in amounts)


def clauses(spots: Sequence[Spot]) -> list[Clause]:
    """Cut a sentence into clauses."""
    found, excepts = [Clause()], False
    for at, spot in enumerate(spots):
        last, part = spots[at - 1] if at else None, found[-1]
        resumes = spot.has("W", "MISSING", "WANT", "MEASURE", "F") and not spot.has("DET")
        excepts = "EXCEPT" in part.intro or (excepts and part.intro <= {"AND", "OR", ","})
        if excepts and part.things and (resumes or spot.has(":")):
            # "Everything except the mug and the bottle must be weighed."
            found.append(Clause(frozenset({"RESUME"})))
        asks = last is not None and last.has("TOKNOW", "MEASURE", "IDEA", "AND", "OR", ",")
        if spot.has("COND") and part.quantities and not asks:
            found.append(Clause())
        separates = spot.has(*_SEPARATORS)
        whole = last is not None and (
            last.has(*_WHOLE) or (last.thing is not None and last.thing.plural)
        )
        ends = at + 1 == len(spots) or spots[at + 1].has(",", ":")
        if spot.has("EXCEPT") and spot.has("MORE") and not whole:
            separates = spot.has("AND", "BUT")  # "pesa menos"
        if spot.has("BUT") and whole:
            spot.classes = {"EXCEPT": ""}  # "everything but the mug"
        if spot.has("CORRECT") and spot.has("NOT") and len(spots) > 1:
            # A plain "no" negates; "no," corrects.
            separates = at + 1 < len(spots) and spots[at + 1].has(",")
        if spot.has("EXCEPT") and ends and part.things and not spot.has("MORE"):
            part.intro |= {"EXCEPT"}  # "the hammer excluded"
            spot.used = True
            continue
        if not separates:
            found[-1].spots.append(spot)
            continue
        spot.used = True
        carried: frozenset[str] = frozenset()
        if part.spots:
            filler = not part.things and not part.quantities
            if "CORRECT" in part.intro and filler:
                carried = frozenset({"CORRECT"})  # "No, excuse me, the blue one."
            found.append(Clause())
        found[-1].intro |= frozenset(spot.classes) | carried
    return [one for one in found if one.spots]


@dataclass(slots=True, eq=False)
class Link:
    """Quantities and bodies that belong together.

    Attributes:
        quantities, things: their words; a link without one of them is incomplete.
        after: the bodies follow the quantities.
        clause: number of its clause, which `joined` with "and".
    """

    quantities: list[Spot]
    things: list[Spot]
    after: bool
    clause: int
    joined: bool


def pair(run: Sequence[Clause], spots: Sequence[Spot], *, compares: bool) -> list[Link]:
    """Pair the quantities and bodies of successive clauses.

    Those of one clause belong together. The others join the nearest complete link of which they
    continue the list: "the mass of the mug, the box and the friction of the bottle".
    """
    links: list[Link] = []
    units: list[list[Spot]] = []
    for part in run:
        kinds = {_is_thing(one) for one in filter(_is_named, units[-1] if units else [])}
        if ":" in part.intro and len(kinds) == 1:
            units[-1] += part.spots  # "mug: mass"
        else:
            units.append([*part.spots])
    for number, unit in enumerate(units):
        groups = [list(ones) for _, ones in groupby(filter(_is_named, unit), _is_thing)]
        while groups:
            first, second, third = (*groups, [], [])[:3]
            if _is_thing(first[0]) and third and not _binds_back(spots, second):
                second = []  # "for the mug, measure the mass of the bottle"
            things, quantities = (first, second) if _is_thing(first[0]) else (second, first)
            begins = any("AND" in part.intro and part.spots[0] is unit[0] for part in run)
            links.append(Link(quantities, things, first is quantities, number, begins))
            del groups[: 2 if second else 1]
    complete = [one for one in links if one.quantities and one.things]
    if compares or not complete:
        every = [Link([], [], True, 0, False)] if links else []
        for one in links:
            every[0].quantities += one.quantities
            every[0].things += one.things
        return every
    for at, one in enumerate(links):
        if one not in complete:
            _attach(links, at, complete, spots)
    return [one for one in links if one.quantities or one.things]


def _attach(
    links: Sequence[Link], at: int, complete: Sequence[Link], spots: Sequence[Spot]
) -> None:
    """Move the members of an incomplete link to the complete one that it continues."""
    one = links[at]
    before = next((o for o in reversed(links[:at]) if o in complete), None)
    following = next((o for o in links[at + 1 :] if o in complete), None)
    if one.quantities:
        its = _has_its(spots, one.quantities[0])
        joins = following is not None and following.after and following.joined and not its
        chosen = following if joins else before or (None if its else following)
        if chosen is not None:
            chosen.quantities += one.quantities
            one.quantities = []
    else:
        same = following is not None and following.clause == one.clause
        chosen = before if before and (before.after or following is None) else following
        landmark = _is_landmark(spots, one.things[0])
        if chosen is not None and not landmark and not (same and chosen is following):
            chosen.things += one.things
            one.things = []


@dataclass(slots=True)
class Wish:
    """A quantity of bodies that the request asks for; without bodies, of all that can have it."""

    id: str
    things: list[Thing]


_Bodies = tuple[list[str], list[Thing]]
"""Quantities or a verb, with bodies."""
EVERYTHING = ("everything", "object")
"""Texts of mentions of all bodies."""


@dataclass
class Reading:
    """State of the interpretation of a request.

    Attributes:
        resolver: resolves quantities and bodies to parameters.
        compares: the request compares, so that every candidate is wanted.
        simulates: the request is for a simulation of an action.
        bare: the request consists of bodies alone.
        asked, wanted: the parameters, before and after the exclusions.
        remarks: interpretations of implicit wishes.
        problems: reasons why a wish has no parameters.
        guessed: the reading needs the user's confirmation.
        looked: a wish for missing values was read, even if nothing is missing.
    """

    resolver: Resolver
    compares: bool = False
    simulates: bool = False
    bare: bool = False
    asked: list[Parameter] = field(default_factory=list[Parameter])
    wanted: tuple[Parameter, ...] = ()
    remarks: list[str] = field(default_factory=list[str])
    problems: list[PlanRejected] = field(default_factory=list[PlanRejected])
    guessed: bool = False
    looked: bool = False
    _wishes: list[Wish] = field(default_factory=list[Wish])
    _excluded: list[_Bodies] = field(default_factory=list[_Bodies])
    _mentions: list[list[Thing]] = field(default_factory=list[list[Thing]])
    _last: list[str] = field(default_factory=list[str])
    _seen: list[str] = field(default_factory=list[str])
    _previous: list[Wish] = field(default_factory=list[Wish])
    _base: bool = True
    _spared: bool = False
    _specific: bool = False
    _knows: bool = False
    _named: set[str] = field(default_factory=set[str])
    _quantified: bool = False
    _alone: list[Thing] = field(default_factory=list[Thing])
    _purposes: list[_Bodies] = field(default_factory=list[_Bodies])
    _missing: list[list[Thing]] = field(default_factory=list[list[Thing]])

    def take(self, spots: Sequence[Spot], question: bool) -> None:
        """Interpret the next sentence."""
        run: list[Clause] = []
        before: Clause | None = None
        named: Clause | None = None
        parts = clauses(spots)
        known = any(_is_known(one) and one.has(*_WHOLE) for one in parts[1:])
        if known and "EXCEPT" in parts[0].intro:
            self._base = False  # "apart from the mug, everything is known"
        for part in parts:
            others = any(one.quantities for one in parts if one is not part)
            if part.spots[0].has("COND") and others:
                self._mentions += [[one.thing for one in part.things if one.thing is not None]]
                continue  # "if I tilt the table"
            part.wanted = self._polarity(part, before, question)
            if "CORRECT" in part.intro and (part.things or part.quantities):
                self._want(run, question)
                self._correct(part)
                run = []
            if part.wanted:
                run.append(part)
            else:
                self._exclude(part, named if named is not None and named.wanted else None)
            named = part if part.things else named
            self._seen = [id for spot in part.quantities for id in _ids(spot)] or self._seen
            if part.things or part.quantities or part.has(*_VERBS, "NOT", *_WHOLE):
                before = part
        self._want([part for part in run if part.wanted], question)
        self._spared = before is not None and not before.wanted

    def _polarity(self, part: Clause, before: Clause | None, question: bool) -> bool:
        """Return True if a clause asks for its parameters."""
        denied = part.has("NOT")
        if part.intro & {"RATHER", "CORRECT"} and not (denied and part.things):
            self._base = True
            return True
        if part.has("SKIP", "NEEDLESS") and not part.has("MISSING"):
            self._deny(part, before)
            return False
        if "EXCEPT" in part.intro:
            return not self._base
        if _is_unmeasured(part):
            return True
        if part.states and not question:
            self._base = False
            return False
        if part.has("KNOWN") and not part.has("TOKNOW"):
            self._base = denied or question or part.has("MISSING")
            return self._base
        if denied and (part.has("IDEA", "TOKNOW") or (self.compares and question)):
            return True
        if denied and part.has("WANT", "W", "MEASURE", "DEED", "MISSING", "DONE"):
            self._base = not part.has("NONE", "EVERYTHING")  # "nothing but the mug"
            return False
        if denied:
            if self._base and self._deny(part, before):
                return False
            # "It does not wobble" excludes nothing.
            named = part.things and part.spots.index(part.things[0]) < 4
            return not self._base or (not named and any(spot.unknown for spot in part.spots))
        if before is not None and not before.wanted and part.continues:
            if part.has("NOW") and part.things:
                return True  # "the mug is known, now the bottle"
            # "All but the mug: masses", "I know the mug, so do the box".
            listed = "EXCEPT" in before.intro and not self._seen
            if (part.quantities and (listed or ":" in part.intro)) or "BUT" in part.intro:
                return True
            if "AND" in part.intro or "EXCEPT" in before.intro:
                return bool(part.quantities and part.things and "AND" not in part.intro)
            if part.quantities and part.has("ITS"):
                return True  # "I know the mass of the mug, its friction not"
            # "Not the mug, the box", but "except the mug, the box".
            return before.has("NOT", "NEEDLESS") or bool(part.quantities and part.things)
        if part.has(*_VERBS):
            self._base = True
        return True

    def _deny(self, part: Clause, before: Clause | None) -> bool:
        """Exclude the bodies before a mere denial, "the mug not"; True if there are any."""
        mere = not (part.things or part.quantities or part.has(*_WHOLE))
        if not mere or not before or before.quantities or not (before.things and before.continues):
            return False
        before.wanted = False
        self._exclude(before, None)
        return True

    def _correct(self, part: Clause) -> None:
        """Replace what was asked last."""
        self._wishes = [one for one in self._wishes if one not in self._previous]
        if part.quantities and not part.things:
            self._mentions.append([thing for one in self._previous for thing in one.things])
        elif part.things:
            self._last = list(dict.fromkeys(one.id for one in self._previous)) or self._last

    # Wishes.

    def _want(self, run: Sequence[Clause], question: bool) -> None:
        """Interpret successive clauses that ask."""
        spots = [spot for part in run for spot in part.spots]
        self._specific = any(":" in part.intro or part.has("SPEC") for part in run)
        count = len(self._wishes)
        for spot in spots:
            simulated = self.simulates and spot.has("DEED")
            spot.used = spot.used or (simulated and bool(spot.classes.get("DEED")))
            if simulated and not spot.has("N"):
                spot.classes = {n: v for n, v in spot.classes.items() if n not in QUANTITIES}
        links = pair(run, spots, compares=self.compares)
        alone = [t for one in links if not one.quantities for t in self._things(one.things)]
        links = [one for one in links if one.quantities]
        weight = any(is_weight(spot.classes.get("AMOUNT", "")) for spot in spots)
        limited = question or any(spot.has("HEDGE", "THAN", "ABOVE", "BELOW") for spot in spots)
        if not links and alone and weight and limited:
            self._add("mass", alone, False)  # "is it over 400 g?"
            alone = []
        if not links and not alone and weight and self._alone and not self._quantified:
            self._add("mass", self._alone, False)  # "is the can full? it should be 400 g"
        unweighed = any(map(_is_unmeasured, run))
        if not links and unweighed:
            self._add("mass", [], True)
        for one in links:
            self._mentions += [alone] if alone and one is links[0] else []
            # An unknown word in a list is listed as not used.
            known = [o for o in one.things if not o.thing or o.thing.names or o.thing.known]
            lists = sum(any(o in part.spots for o in one.things) for part in run) > 1
            things = self._things(known if known and lists else one.things)
            if unweighed or any(map(_is_missing, run)):
                things = [t for t in things if not self._is_whole(t)]
            plural = not self._mentions and any(o.has("PLURAL") for o in one.quantities)
            every = any(_is_every(spots, member) for member in one.quantities)
            every = every or unweighed or plural or (bool(one.things) and not things)
            ids = list(dict.fromkeys(id for member in one.quantities for id in _ids(member)))
            for member in one.quantities:
                member.used = True
            self._mentions += [things] if things else []
            self._last, self._quantified = ids, True
            for id in ids:
                self._add(id, things, every)
        if not self._wishes[count:]:
            if alone or any(spot.has(*_WHOLE) for spot in spots):
                self._without_quantity(run, spots, alone)
            elif any(part.has("MISSING", "VAGUE", "PARAMETERS", "SIMULATE") for part in run):
                self._missing.append([])
        self._previous = self._wishes[count:] or self._previous

    def _without_quantity(
        self, run: Sequence[Clause], spots: Sequence[Spot], alone: list[Thing]
    ) -> None:
        """Interpret bodies without a quantity: those of the last quantity, or all that is missing."""
        everything = [spot for spot in spots if spot.has(*_WHOLE) and not spot.used][:1]
        things = alone or [self._everything(spot) for spot in everything]
        verb = next((spot.classes["DEED"] for spot in spots if spot.classes.get("DEED")), "")
        missing = any(part.has("MISSING", "VAGUE", "PARAMETERS") for part in run)
        measures = any(part.has("MEASURE") for part in run) and not self._last
        if self.simulates and verb and alone:
            moved = [one for one in alone if one.text not in EVERYTHING and one.names != (GRIPPER,)]
            self._purposes.append(([verb], moved or alone))
        elif missing or (measures and not any(spot.unknown for spot in spots)):
            self._missing.append(things)
        elif self._last:
            # A mere body after an exclusion may be meant either way.
            contrast = run[0].intro & {"BUT", "RATHER"} or run[0].has("THATOF")
            self.guessed = self.guessed or (self._spared and not contrast)
            for id in self._last:
                self._add(id, things, True)
        else:
            self._alone += things
        self._mentions += [alone] if alone else []

    def _everything(self, spot: Spot) -> Thing:
        names = tuple(self.resolver.scene.bodies)
        if spot.has("ELSE"):
            before = [one for things in self._mentions for one in things]
            before = {n for one in before if one.text not in EVERYTHING for n in one.names}
            names = tuple(name for name in names if name not in before | self._named)
        return Thing(EVERYTHING[0], names, plural=True)

    def _things(self, spots: Sequence[Spot]) -> list[Thing]:
        found: list[Thing] = []
        for spot in spots:
            spot.used = True
            found.append(spot.thing if spot.thing is not None else self._everything(spot))
        if self._specific and found and self._is_whole(found[0]):
            found = found[1:] or found  # "everything, that is the mug and the bottle"
        # A general noun refers to what was named before: "that thing".
        objects = tuple(self.resolver.scene.objects)
        general = [t for t in found if t.names == objects and not t.plural and len(objects) > 1]
        if general and not self.compares and (self._mentions or len(found) > len(general)):
            found = [one for one in found if one not in general]
        for one in found:
            self._named.update(() if one.text in EVERYTHING else one.names)
        return found

    def _is_whole(self, thing: Thing) -> bool:
        objects = set(self.resolver.scene.objects)
        return len(objects) > 1 and set(thing.names) >= objects

    def _add(self, id: str, things: list[Thing], every: bool) -> None:
        """Ask for a quantity of bodies, else of the last mentioned ones, else of all."""
        resolver = self.resolver
        objects = tuple(resolver.scene.objects)
        if self.compares:
            things = [replace(t, plural=t.plural or t.names == objects) for t in things]
        can = [one for one in things if not one.names or resolver.can_have([one], id)]
        if things and (can or len(self._last) < 2):
            self._wishes.append(Wish(id, can or things))
            return
        # Without bodies: the last mentioned ones that can have the quantity.
        for before in reversed(self._mentions if not every else []):
            fit = [one for one in before if one.names and resolver.can_have([one], id)]
            if fit:
                fit = [replace(one, plural=one.plural or self.compares) for one in fit]
                self._wishes.append(Wish(id, fit))
                return
        if len(resolver.carriers(id)) == 1 or every or self.compares:
            self._wishes.append(Wish(id, []))
        else:
            self.problems.append(PlanRejected(resolver.of_what(id)))

    def _exclude(self, part: Clause, named: Clause | None) -> None:
        """Exclude the parameters of a clause; `named` has the bodies before it, if wanted."""
        things = [one for one in self._things(part.things) if one.names]
        for spot, after in zip(part.spots, [*part.spots[1:], None], strict=True):
            # An unknown word after "anything" restricts it.
            if spot.has("EVERYTHING", "ELSE") and not (after is not None and after.unknown):
                things.append(self._everything(spot))
        ids = [id for spot in part.quantities for id in _ids(spot)]
        for spot in part.quantities:
            spot.used = True
        self._knows = self._knows or _is_known(part)
        for spot in part.spots if not things else ():
            spot.classes = {} if spot.has("ADJ") else spot.classes  # it is listed as not used
        if part.has("THATOF") and not ids:
            ids = self._seen
        if ids and not things and (named is not None or self._mentions):
            # "The mug: I know its mass already."
            things = self._things(named.things) if named is not None else self._mentions[-1]
        if things or ids:
            self._excluded.append((ids, things))
        self._last = ids or self._last
        self._mentions += [things] if things else []

    # Parameters.

    def finish(self) -> None:
        """Complete the parameters after the last sentence.

        Raises InputError: a wish names a body that the scene does not have.
        """
        for wish in self._wishes:
            self._require_present(wish.things)
        if self._purposes and not self._quantified:
            self._aim()
        else:
            self._ask()
        # "The rest is known" excludes no body that a wish names.
        wished = [one.things for one in self._wishes]
        wished += [] if self._quantified else [self._alone]
        specific = [one for things in wished for one in things if one.text not in EVERYTHING]
        named = {name for one in specific for name in one.names}
        excluded: set[Parameter] = set()
        for ids, things in self._excluded:
            for id in ids or [None]:
                for thing in things or [
                    Thing(EVERYTHING[0], tuple(self.resolver.carriers(ids[0])))
                ]:
                    found = self.resolver.exclusions(id, thing)
                    general = thing.text in EVERYTHING
                    excluded.update(one for one in found if not general or one.object not in named)
        asked = self.resolver.order_parameters(self.asked)
        self.wanted = tuple(one for one in asked if one not in excluded)

    def _ask(self) -> None:
        for wish in self._wishes:
            try:
                self.asked += self.resolver.parameters(wish.id, wish.things)
            except PlanRejected as problem:
                self.problems.append(problem)
        # Beside a quantity, "what is missing" without bodies is a remark.
        missing = [one for one in self._missing if one or not self._quantified]
        if not self._quantified and not missing and self._alone and (self.bare or self._knows):
            missing = [self._alone]
        for things in missing:
            self._require_present(things)
            try:
                found, remark = self.resolver.missing(things)
            except PlanRejected as problem:
                self.problems.append(problem)
                continue
            self.asked += found
            self.looked = True
            self.remarks.append(remark)

    def _require_present(self, things: Iterable[Thing]) -> None:
        if absent := [one for one in things if not one.names and one.text not in EVERYTHING]:
            raise self.resolver.absent(absent[0])

    def _aim(self) -> None:
        """Ask for the quantities that a simulated action depends on.

        Values from an assumption, such as uniform density, are only offered.
        """
        offered: list[Parameter] = []
        for (verb,), things in self._purposes:
            self._require_present(things)
            for id in quantities_by_verb().get(verb, ()):
                for one in self.resolver.parameters(id, things):
                    (offered if self.resolver.is_assumed(one) else self.asked).append(one)
        if offered:
            listed = ",".join(str(one) for one in dict.fromkeys(offered))
            self.remarks.append(f"Assumed, not measured: {listed}; add --measure {listed}.")
        self.looked = True


def _is_known(part: Clause) -> bool:
    """True for a clause that states what is known."""
    return part.has("KNOWN") and not part.has("NOT", "TOKNOW", "MISSING")


def _is_missing(part: Clause) -> bool:
    """True for "that is missing" and "that is not given"."""
    return part.has("MISSING") or (part.has("NOT") and part.has("KNOWN"))


def _is_unmeasured(part: Clause) -> bool:
    """True for "what was never weighed" and "what has no mass yet"."""
    yet = part.has("NOT") and part.has("YET")
    return yet and (part.has("DONE") or bool(part.quantities and not part.things))


def _ids(spot: Spot) -> tuple[str, ...]:
    if spot.has("INERTIAL"):
        return _INERTIAL
    return tuple(spot.classes[n] for n in (*QUANTITIES, "UNIT") if spot.classes.get(n))[:1]


def _is_thing(spot: Spot) -> bool:
    """True for words that name bodies, or all of them."""
    if spot.has("MARK") or spot.is_quantity:
        return False
    return spot.thing is not None or (spot.has("EVERYTHING", "ELSE") and not spot.used)


def _is_named(spot: Spot) -> bool:
    return spot.is_quantity or _is_thing(spot)


def _has_its(spots: Sequence[Spot], spot: Spot) -> bool:
    """True for "its mass"."""
    at = spots.index(spot)
    return at > 0 and spots[at - 1].has("ITS") and not spots[at - 1].has("DET")


def _is_landmark(spots: Sequence[Spot], spot: Spot) -> bool:
    """True for a body after a relation: "off the board"."""
    before = [one for one in spots[: spots.index(spot)] if not one.has("DET")][-1:]
    return any(one.has("REL") and not one.has("OF", "F") for one in before)


def _binds_back(spots: Sequence[Spot], members: Sequence[Spot]) -> bool:
    """True if quantities belong to the bodies before them, not to those after."""
    first, end = spots.index(members[0]), spots.index(members[-1])
    before = spots[first - 1]
    verb = members[-1].has("W") and before.thing is None and not before.has("NOT")
    following = spots[end + 1] if end + 1 < len(spots) else members[-1]
    if following.has("OF") or (following.has("REL") and members[-1].has("N")) or verb:
        return False
    return before.thing is not None or before.has("'S", "W", "F")


def _is_every(spots: Sequence[Spot], spot: Spot) -> bool:
    """True for all of a quantity: "all masses", "the weights"."""
    for one in reversed(spots[: spots.index(spot)]):
        if one.has("ALL") and one.thing is None:
            one.used = True
            return True
        if not one.has("DET", "OF", "F", "MISSING"):
            break
    return False
