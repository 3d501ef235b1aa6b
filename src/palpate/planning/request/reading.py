"""Interpretation of the clauses of a request, in order: wanted and excluded parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.common.parameter import Parameter, PlanRejected
from palpate.planning.request.query import (
    AGAIN,
    Act,
    Again,
    Aside,
    Mention,
    NamedPurpose,
    NamedQuantity,
    Need,
    Query,
    Say,
)
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.selection import Items, Selection
from palpate.planning.request.words import english


@dataclass
class Reading:
    """State of the interpretation of a request.

    Attributes:
        resolver: resolves mentions to parameters.
        selection: resolves selectors to bodies.
        bare: only bodies are named, without a verb.
        asked: the wanted parameters.
        excluded: the excluded parameters.
        remarks: interpretations of implicit wishes.
        looked: the request asks for missing parameters, even if there are none.
    """

    resolver: Resolver
    selection: Selection
    bare: bool = False
    asked: list[Parameter] = field(default_factory=list[Parameter])
    excluded: set[Parameter] = field(default_factory=set[Parameter])
    remarks: list[str] = field(default_factory=list[str])
    looked: bool = False
    _purposes: list[tuple[str, Items]] = field(default_factory=list[tuple[str, Items]])
    _alone: list[Items] = field(default_factory=list[Items])
    _of_all: list[NamedQuantity] = field(default_factory=list[NamedQuantity])
    _last: tuple[NamedQuantity, ...] = ()
    _how: str = ""
    _turning: bool = False
    _wanted: bool = False
    _needed: bool = False
    _lacking: bool = False

    @property
    def wanted(self) -> tuple[Parameter, ...]:
        """Parameters that are requested and not excluded."""
        asked = self.resolver.order_parameters(self.asked)
        return tuple(one for one in asked if one not in self.excluded)

    def take(self, act: Act) -> None:
        """Interpret the next clause.

        Raises:
            InputError: it names an unknown body.
            PlanRejected: it requests no measurement, or is ambiguous.
        """
        # Clauses change the parameters; mentions and asides only change the references.
        match act:
            case Say():
                self._say(act)
            case Mention(selector=Again(), alone=True) if self._wanted or self._lacking:
                pass  # "Measure it."
            case Mention():
                found = self.selection.found(act.selector)
                if act.alone:
                    self._alone.append(found)
            case NamedPurpose():
                self._purposes.append((act.verb, self.selection.found(act.selector)))
            case Need():
                self._needed = True
            case Aside():
                self.selection.unsure = True
                self.remarks.append(f"Set aside: '{act.said}'.")

    def finish(self) -> None:
        """Complete the parameters after the last clause.

        Raises:
            PlanRejected: bodies were named without a quantity.
        """
        # Fallbacks without a named quantity: the purpose, all that is missing, or a body alone.
        if self._purposes and not self._wanted:
            self._aim()
        elif self._lacking or (self._needed and not self._wanted):
            self._miss(())
        elif self._alone and not self._wanted and self.bare:
            if len(self._alone) > 1 or self.selection.spared:
                raise PlanRejected(
                    "it is not said what to measure of them; say e.g. 'their masses'"
                )
            self._miss(self._alone[0])
        # Every body named alone must have a requested parameter.
        asked = {parameter.object for parameter in self.asked}
        for item in (item for items in self._alone for item in items):
            if not asked.issuperset(item.names):
                raise PlanRejected(f"it is not said what to measure of '{item.text}'")

    def is_of_all(self, act: Act) -> bool:
        """True for a quantity without any named body."""
        queries = act.queries if isinstance(act, Say) and act.how == "want" else ()
        alone = any(one.quantity and not (one.selector or one.every) for one in queries)
        return alone and not self.selection.spoken

    def _say(self, act: Say) -> None:
        how = act.how
        # An inversion follows an exclusion: "we know all masses except that of the mug".
        self._turning = how == "turn" or (how == "about" and self._how in ("know", "skip"))
        # "About" and "also" need an earlier statement, "turn" an exclusion.
        if (how == "about" and not self._how) or (how == "also" and self._how != "want"):
            raise PlanRejected("it is not clear what of it is wanted; say e.g. 'its mass'")
        if how == "turn" and self._how not in ("know", "skip"):
            raise PlanRejected("it is not clear what of it is wanted; say e.g. 'measure the mass'")
        # Add the queries to the wanted or to the excluded parameters.
        wanted = how not in ("know", "skip")
        for query in act.queries:
            if wanted:
                self._want(query)
            else:
                self._spare(query)
        if act.queries and act.queries[0].quantity not in (None, AGAIN):
            self._last = tuple(query.quantity for query in act.queries if query.quantity)
        self._how = "want" if wanted else how

    def _quantities(self, query: Query) -> tuple[NamedQuantity | None, ...]:
        """Return the quantities of a query; "that of the mug" repeats the last ones."""
        if query.quantity is not AGAIN:
            return (query.quantity,)
        if not self._last:
            raise PlanRejected("it is not said which quantity is meant; say e.g. 'the mass'")
        return self._last

    def _want(self, query: Query) -> None:
        # A query without quantity and body means everything, or everything for a purpose.
        if query == Query():
            self._lacking = True  # of the purpose, or of everything
            return
        self._wanted = True
        # An unmeasurable property is reported, not rejected.
        if query.quantity and not query.quantity.measurable:
            self.resolver.cannot.append(self.resolver.not_measurable(query.quantity))
            return
        objects = self._find_bodies(query)
        # Without a body, take the last mentioned one that can have the quantity, else all.
        for quantity in self._quantities(query):
            if quantity is None:
                self._miss(objects)
                continue
            of = objects
            if query.selector is None and not query.every:
                of = self._meant(quantity)
                if not of:
                    self._of_all.append(quantity)
            asked = self.resolver.parameters(quantity, of)
            self.asked += asked
            if self._turning:  # "we know all masses except that of the mug"
                self.excluded.difference_update(asked)

    def _find_bodies(self, query: Query) -> Items:
        """Return the bodies of a query.

        Raises:
            PlanRejected: an earlier quantity has no body and may refer to these: "the mass, but not
                the friction of the mug".
        """
        objects = self.selection.found(query.selector) if query.selector else ()
        for quantity in self._of_all:
            if query.quantity and objects and self.resolver.can_have(objects, quantity):
                raise PlanRejected(
                    f"it is not clear of what the {quantity.word} is wanted; name it"
                )
        return objects

    def _spare(self, query: Query) -> None:
        before = len(self.selection.spoken)
        objects = self._find_bodies(query)
        self.selection.spared += objects
        # Bodies excluded as a whole are no reference for "it".
        if query.quantity is None:
            del self.selection.spoken[before:]
        for quantity in self._quantities(query):
            of = objects
            if quantity is not None and not (query.selector or query.every):
                of = self._meant(quantity)
            self.excluded.update(self.resolver.exclusions(quantity, of))

    def _meant(self, quantity: NamedQuantity) -> Items:
        """Return the last named bodies that can have the quantity, as the reference of "it"."""
        self.selection.require_sure()
        for objects in reversed(self.selection.spoken):
            if self.resolver.can_have(objects, quantity):
                return objects
        return ()

    def _miss(self, objects: Items) -> None:
        """Request all missing parameters of `objects`, or of the whole scene."""
        found, remark = self.resolver.missing(objects)
        self.asked += found
        self.looked = self._wanted = True
        self.remarks.append(remark)

    def _aim(self) -> None:
        """Request the quantities that a simulated action depends on.

        Values from an assumption, such as uniform density, are only offered.
        """
        offered: list[Parameter] = []
        for verb, objects in self._purposes:
            # An unknown purpose requests all missing parameters.
            ids = english().purposes.get(verb, ())
            if not ids:
                self._miss(objects)
            for id in ids:
                for one in self.resolver.parameters(NamedQuantity(id, id), objects):
                    (offered if self.resolver.is_assumed(one) else self.asked).append(one)
        if offered:
            listed = ",".join(str(one) for one in dict.fromkeys(offered))
            self.remarks.append(f"Assumed, not measured: {listed}; add --measure {listed}.")
        self.looked = self._wanted = True
