"""Meaning of a request: wanted and excluded parameters from the spots of its sentences.

A sentence is cut into fragments at commas, conjunctions and exceptions. Each fragment wants, excludes
or corrects. The quantities of successive wanting fragments are paired with their objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

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
_INERTIAL = ("mass", "com", "inertia")

Pair = tuple[list[str], list[Thing], bool]
"""Quantities, their bodies, and True for all bodies that have them."""


@dataclass(slots=True)
class Fragment:
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
        """True if it may belong to the list of the fragment before."""
        return not self.has(*_VERBS, "NOT", "C", "EVERYTHING", "ELSE", "ALL", "A")

    @property
    def states(self) -> bool:
        """True for a statement of an amount: "the mug weighs 300 g"."""
        amounts = [spot.classes["AMOUNT"] for spot in self.spots if spot.has("AMOUNT")]
        asks = self.has("WIDTH", "MORE", "C", "THAN", "ABOVE", "BELOW", "WANT", "MEASURE")
        named = bool(self.things or self.quantities)
        return bool(amounts) and named and not asks and not any(one[0] in "±+" for one in amounts)


def fragments(spots: Sequence[Spot]) -> list[Fragment]:
    """Cut a sentence into fragments."""
    found = [Fragment()]
    for at, spot in enumerate(spots):
        last, part = spots[at - 1] if at else None, found[-1]
        resumes = spot.has("W", "MISSING", "WANT", "MEASURE", "F") and not spot.has("DET")
        if "EXCEPT" in part.intro and part.things and (resumes or spot.has(":")):
            # "Everything except the mug must be weighed."
            found.append(Fragment(frozenset({"RESUME"})))
        separates = spot.has(",", "AND", "BUT", "RATHER", "EXCEPT", "CORRECT", "OR", ":")
        everything = last is not None and (
            last.has(*_WHOLE) or (last.thing is not None and last.thing.plural)
        )
        if spot.has("EXCEPT") and spot.has("MORE") and not everything:
            separates = spot.has("AND", "BUT")  # "pesa menos"
        if spot.has("BUT") and everything:
            spot.classes = {"EXCEPT": ""}  # "everything but the mug"
        if spot.has("CORRECT") and spot.has("NOT") and len(spots) > 1:
            # A plain "no" negates; "no," corrects.
            separates = at + 1 < len(spots) and spots[at + 1].has(",")
        ends = at + 1 == len(spots) or spots[at + 1].has(",", ":")
        if spot.has("EXCEPT") and ends and part.things:
            part.intro |= {"EXCEPT"}  # "the hammer excluded"
            spot.used = True
            continue
        if not separates:
            found[-1].spots.append(spot)
            continue
        spot.used = True
        carried: frozenset[str] = frozenset()
        if found[-1].spots:
            filler = not found[-1].things and not found[-1].quantities
            if "CORRECT" in found[-1].intro and filler:
                carried = frozenset({"CORRECT"})  # "No, excuse me, the blue one."
            found.append(Fragment())
        found[-1].intro |= frozenset(spot.classes) | carried
    return [one for one in found if one.spots]


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
        looked: a wish for missing values was read, even if nothing is missing.
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
        named: Fragment | None = None
        for part in fragments(spots):
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

    def _polarity(self, part: Fragment, before: Fragment | None, question: bool) -> bool:
        """Return True if a fragment asks for its parameters."""
        denied = part.has("NOT")
        if part.intro & {"RATHER", "CORRECT"} and not (denied and part.things):
            self._base = True
            return True
        if part.has("SKIP", "NEEDLESS") and not part.has("MISSING"):
            return False
        if "RESUME" in part.intro:
            return True
        if "EXCEPT" in part.intro:
            return not self._base
        if denied and part.has("YET") and part.has("DONE"):
            return True  # "what was never weighed"
        if part.states and not question:
            self._base = False
            return False
        if part.has("KNOWN") and not part.has("TOKNOW"):
            self._base = denied or question or part.has("MISSING")
            return self._base
        if denied and (part.has("IDEA", "TOKNOW") or (self.compares and question)):
            return True
        if denied and part.has("WANT", "W", "MEASURE", "DEED", "MISSING", "DONE"):
            self._base = True
            return False
        if denied:
            # "The mug not": the denial belongs to the bodies before.
            bare = not part.things and not part.quantities and before is not None
            if bare and before and before.things and before.continues and not before.quantities:
                before.wanted = not self._base
                if not before.wanted:
                    self._exclude(before, None)
                return before.wanted
            # "It does not wobble" excludes nothing.
            return not self._base or any(spot.unknown for spot in part.spots)
        if before is not None and not before.wanted and part.continues:
            # "All but the mug: masses", "I know the mug, so do the box".
            listed = "EXCEPT" in before.intro and not self._seen
            if (part.quantities and (listed or ":" in part.intro)) or "BUT" in part.intro:
                return True
            if "AND" in part.intro or "EXCEPT" in before.intro:
                return bool(part.quantities and part.things and "AND" not in part.intro)
            # "Not the mug, the box", but "except the mug, the box".
            return before.has("NOT", "NEEDLESS") or bool(part.quantities and part.things)
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
        for at, part in enumerate(run):
            begins = at and part.spots[0].has("OF") and part.things and part.quantities
            if begins and part.things[0].start < part.quantities[0].start:
                # "... of the mug, and of the box its friction" begins anew.
                self._want(run[:at], question)
                self._want(run[at:], question)
                return
        spots = [spot for part in run for spot in part.spots]
        before = len(self.asked)
        for spot in spots:
            spot.used = spot.used or (self.simulates and bool(spot.classes.get("DEED")))
        pairs, alone = self._pair(spots)
        weight = any(is_weight(spot.classes.get("AMOUNT", "")) for spot in spots)
        limited = question or any(spot.has("THAN", "ABOVE", "BELOW") for spot in spots)
        if not pairs and alone and weight and limited:
            pairs, alone = [(["mass"], alone, False)], list[Thing]()  # "is it over 400 g?"
        unweighed = any(part.has("YET") and part.has("DONE") and part.has("NOT") for part in run)
        if unweighed:
            pairs = pairs or [(["mass"], list[Thing](), False)]
            pairs = [(ids, [t for t in ts if t.text != "everything"], True) for ids, ts, _ in pairs]
        for ids, things, every in pairs:
            self._quantified = True
            self._last = ids
            for id in ids:
                self._add(id, things, every)
        if pairs:
            self._mentions += [alone] if alone else []
        elif alone or any(spot.has(*_WHOLE) for spot in spots):
            self._without_quantity(run, spots, alone)
        elif any(part.has("MISSING", "VAGUE", "PARAMETERS", "SIMULATE") for part in run):
            self._missing.append([])
        self._previous = self.asked[before:] or self._previous

    def _without_quantity(
        self, run: Sequence[Fragment], spots: Sequence[Spot], alone: list[Thing]
    ) -> None:
        """Interpret bodies without a quantity: those of the last quantity, or all that is missing."""
        everything = [spot for spot in spots if spot.has(*_WHOLE) and not spot.used][:1]
        things = alone or [self._everything(spot) for spot in everything]
        verb = next((spot.classes["DEED"] for spot in spots if spot.classes.get("DEED")), "")
        missing = any(part.has("MISSING", "VAGUE", "PARAMETERS") for part in run)
        measures = any(part.has("MEASURE") for part in run) and not self._last
        if self.simulates and verb and alone:
            moved = [one for one in alone if one.text != "everything" and one.names != (GRIPPER,)]
            self._purposes.append((verb, moved or alone))
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
            before = {name for things in self._mentions for one in things for name in one.names}
            names = tuple(name for name in names if name not in before | self._named)
        return Thing("everything", names, plural=True)

    def _pair(self, spots: Sequence[Spot]) -> tuple[list[Pair], list[Thing]]:
        """Pair quantities with bodies; also return the bodies without a quantity."""
        groups = self._groups(spots)
        pairs: list[Pair] = []
        alone: list[Thing] = []
        used: set[int] = set()
        for at, (kind, members) in enumerate(groups):
            if kind != "Q":
                continue
            after = at + 1 if at + 1 < len(groups) and groups[at + 1][0] == "T" else None
            prior = at - 1 if at and groups[at - 1][0] == "T" and at - 1 not in used else None
            back = prior is not None and _binds_back(spots, members)
            chosen = prior if after is None or back or _has_its(spots, members[0]) else after
            if chosen == after and prior is not None and chosen is not None:
                alone += self._things(groups[prior][1])
                used.add(prior)
            things: list[Thing] = []
            if chosen is not None:
                used.add(chosen)
                things = self._things(groups[chosen][1])
            every = any(_is_every(spots, member) for member in members) or (
                not self._mentions and any(one.has("PLURAL") for one in members)
            )
            for member in members:
                member.used = True
            ids = list(dict.fromkeys(id for member in members for id in _ids(member)))
            pairs.append((ids, things, every))
            self._mentions += [things] if things else []
        for at, (kind, members) in enumerate(groups):
            if kind == "T" and at not in used:
                things = self._things(members)
                if used and min(used) < at and pairs and not members[0].has("EVERYTHING"):
                    pairs[-1] = (pairs[-1][0], [*pairs[-1][1], *things], pairs[-1][2])
                else:
                    alone += things
        return pairs, alone

    def _groups(self, spots: Sequence[Spot]) -> list[tuple[str, list[Spot]]]:
        """Group successive quantities (`Q`) and successive bodies (`T`)."""
        groups: list[tuple[str, list[Spot]]] = []
        for at, spot in enumerate(spots):
            kind = "Q" if spot.is_quantity else "T" if _is_thing(spot) else ""
            if not kind or (
                self.simulates and spot.has("DEED") and kind == "Q" and not spot.has("N")
            ):
                continue
            # "The mass of the bottle and mug friction": the mug belongs to the friction.
            follows = at + 1 < len(spots) and spots[at + 1].start == spot.end
            adjacent = kind == "T" and follows and spots[at + 1].has("N", "'S")
            anew = adjacent and len(groups) > 1 and groups[-1][0] == "T"
            if anew or not groups or groups[-1][0] != kind or _ends_group(spots, at, kind, groups):
                groups.append((kind, []))
            groups[-1][1].append(spot)
        kinds = {kind for kind, _ in groups}
        if self.compares and len(kinds) > 1:
            return [(each, [o for k, ones in groups if k == each for o in ones]) for each in "QT"]
        return groups

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

    # Parameters.

    def _add(self, id: str, things: list[Thing], every: bool) -> None:
        """Ask for a quantity of bodies, else of the last mentioned ones, else of all."""
        resolver = self.resolver
        self._require_present(things)
        objects = tuple(resolver.scene.objects)
        if self.compares:
            things = [Thing(t.text, t.names, t.plural or t.names == objects) for t in things]
        can = [one for one in things if resolver.can_have([one], id)]
        if things and (can or len(self._last) < 2):
            self.asked += resolver.parameters(id, can or things)
            return
        # Without bodies: the last mentioned ones that can have the quantity.
        for before in reversed(self._mentions if not every else []):
            fit = [one for one in before if one.names and resolver.can_have([one], id)]
            if fit:
                fit = [Thing(t.text, t.names, True) for t in fit] if self.compares else fit
                self.asked += resolver.parameters(id, fit)
                return
        if len(resolver.carriers(id)) == 1 or every or self.compares:
            self.asked += resolver.parameters(id, [])
            return
        raise PlanRejected(resolver.of_what(id))

    def _require_present(self, things: Iterable[Thing]) -> None:
        if absent := [one for one in things if not one.names and one.text]:
            raise self.resolver.absent(absent[0])

    def _exclude(self, part: Fragment, named: Fragment | None) -> None:
        """Exclude the parameters of a fragment; `named` has the bodies before it, if wanted."""
        things = [one for one in self._things(part.things) if one.names]
        things += [self._everything(spot) for spot in part.spots if spot.has("EVERYTHING", "ELSE")]
        ids = [id for spot in part.quantities for id in _ids(spot)]
        for spot in part.quantities:
            spot.used = True
        if part.has("THATOF") and not ids:
            ids = self._seen
        refers = part.has("ITS") or part.spots[0].has("WHICH", "SOMETHING")
        if ids and not things and refers and (named is not None or self._mentions):
            # "The mug: I know its mass already."
            things = self._things(named.things) if named is not None else self._mentions[-1]
        if things or ids:
            for id in ids or [None]:
                self.excluded.update(self.resolver.exclusions(id, things))
        self._last = ids or self._last
        self._mentions += [things] if things else []

    def finish(self) -> None:
        """Complete the parameters after the last sentence.

        Raises:
            PlanRejected: bodies were named without a quantity.
        """
        if self._purposes and not self._quantified:
            self._aim()
            return
        # Beside a quantity, "what is missing" without bodies is a remark.
        missing = [one for one in self._missing if one or not self._quantified]
        if not self._quantified and not missing and self._alone and self.bare:
            missing = [self._alone]
        for things in missing:
            self._require_present(things)
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
            self._require_present(things)
            for id in quantities_by_verb().get(verb, ()):
                for one in self.resolver.parameters(id, things):
                    (offered if self.resolver.is_assumed(one) else self.asked).append(one)
        if offered:
            listed = ",".join(str(one) for one in dict.fromkeys(offered))
            self.remarks.append(f"Assumed, not measured: {listed}; add --measure {listed}.")
        self.looked = True


def _ids(spot: Spot) -> tuple[str, ...]:
    if spot.has("INERTIAL"):
        return _INERTIAL
    return tuple(spot.classes[n] for n in (*QUANTITIES, "UNIT") if spot.classes.get(n))[:1]


def _is_thing(spot: Spot) -> bool:
    if spot.has("MARK"):
        return False
    return spot.thing is not None or (spot.has("EVERYTHING", "ELSE") and not spot.used)


def _ends_group(
    spots: Sequence[Spot], at: int, kind: str, groups: Sequence[tuple[str, list[Spot]]]
) -> bool:
    """True if a quantity begins a group of its own: "its mass and the friction of the box"."""
    if kind != "Q":
        return False
    last = groups[-1][1][-1]
    if _has_its(spots, last) != _has_its(spots, spots[at]):
        return True
    # "The bottle's mass, the friction of the mug": the first belongs to the body before.
    back = len(groups) > 1 and groups[-2][0] == "T"
    return back and _is_of(spots, at) and not _is_of(spots, spots.index(last))


def _is_of(spots: Sequence[Spot], at: int) -> bool:
    """True if a quantity is followed by "of"."""
    return at + 1 < len(spots) and spots[at + 1].has("OF", "REL")


def _has_its(spots: Sequence[Spot], spot: Spot) -> bool:
    """True for "its mass"."""
    at = spots.index(spot)
    return at > 0 and spots[at - 1].has("ITS") and not spots[at - 1].has("DET")


def _binds_back(spots: Sequence[Spot], members: Sequence[Spot]) -> bool:
    """True if quantities belong to the bodies before them, not to those after."""
    first, end = spots.index(members[0]), spots.index(members[-1])
    before = spots[end - 1]
    verb = members[-1].has("W") and end and before.thing is None and not before.has("NOT")
    if _is_of(spots, end) or verb or not first:
        return False
    return spots[first - 1].thing is not None or spots[first - 1].has("'S", "W", "F")


def _is_every(spots: Sequence[Spot], spot: Spot) -> bool:
    """True for all of a quantity: "all masses", "the weights"."""
    for one in reversed(spots[: spots.index(spot)]):
        if one.has("ALL") and one.thing is None:
            one.used = True
            return True
        if not one.has("DET", "OF", "F", "MISSING"):
            break
    return False
