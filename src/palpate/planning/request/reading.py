"""State of understanding of a request, clause by clause."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.errors import PlanRejected
from palpate.parameter import Parameter
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.sentence.meaning import (
    Act,
    Again,
    Aside,
    Deed,
    Handled,
    It,
    Mention,
    Need,
    Pair,
    Quantity,
    Say,
    Simulated,
    Told,
    Unfelt,
)
from palpate.planning.request.things import Items, Things
from palpate.planning.request.wording import english

Subject = tuple[Quantity, Items]


@dataclass
class Reading:
    """State of understanding of a request.

    Attributes:
        asked: the parameters that are wanted, excluded: those that are not.
        simulated: deeds that are to be simulated, and with what.
        remarks: how something was read that was not quite said so.
        offered: parameters that would serve the purpose and that the scene assumes.
        looked: whether it asks for what is missing, be there any or not.
    """

    resolver: Resolver
    things: Things
    asked: list[Parameter] = field(default_factory=list[Parameter])
    excluded: set[Parameter] = field(default_factory=set[Parameter])
    simulated: list[tuple[str, Items]] = field(default_factory=list[tuple[str, Items]])
    remarks: list[str] = field(default_factory=list[str])
    offered: list[Parameter] = field(default_factory=list[Parameter])
    looked: bool = False
    _last: tuple[Quantity, ...] = ()
    _deed: str = ""
    _turning: bool = False
    _wanted: bool = False
    _needed: bool = False
    _alone: list[Items] = field(default_factory=list[Items])
    _handled: str = ""
    _told: bool = False
    _of_all: set[str] = field(default_factory=set[str])

    def take(self, act: Act) -> None:
        """Take in the next clause.

        Raises:
            InputError: it names a thing that is not there. PlanRejected: it asks for what is no
                measurement, or cannot be told.
        """
        match act:
            case Say():
                self._say(act)
            case Mention():
                found = self._found(act)
                if act.alone:
                    self._alone.append(found)
            case Simulated():
                said = self.things.spoken[-1] if self.things.spoken else ()
                objects = self.things.found(act.thing) if act.thing else said
                self.simulated.append((act.verb, objects))
            case Handled():
                self.things.found(act.thing)
                self._handled = self._handled or act.word
            case Deed():
                self._do(act)
            case Unfelt():
                self.resolver.cannot.append(self.resolver.not_felt(act.word))
            case Need():
                self._needed = True
            case Aside():
                self.things.unsure = True
                self.remarks.append(f"Set aside: '{act.said}'.")
            case Told():
                self._told = True
                self.remarks.append(f"Set aside: '{act.said}'.")
            case It():
                if not (self._wanted or self._needed):
                    raise PlanRejected("'it' stands for nothing that was asked; name the quantity")

    def finish(self) -> None:
        """Complete the list of parameters after the last clause.

        Raises:
            PlanRejected: nothing.
        """
        if self.simulated and not self._wanted:
            self._aim()
        elif self._needed and not self.simulated:
            self._miss(())
        elif self._alone and not self._wanted and not self._told:
            self._read_alone()
        self._require_alone()
        if not self._wanted and self._handled:
            raise PlanRejected(self.resolver.no_deed(self._handled))

    def _found(self, act: Mention) -> Items:
        return self.things.found(act.thing)

    def _say(self, act: Say) -> None:
        deed = act.deed
        self._turning = deed == "turn"
        if self._turning:
            self._require_turn()
            deed = "want"
        if deed in ("also", "about"):
            self._require_last(deed)
            deed = "want"
        for pair in act.pairs:
            self._require_no_other(pair)
            if deed == "want":
                self._want(pair)
            else:
                self._spare(pair)
        self._deed = deed

    def _require_no_other(self, pair: Pair) -> None:
        """Require that a thing named now does not leave open an earlier quantity of "all": "the
        mass, but not the friction of the mug".

        Raises:
            PlanRejected: it may be.
        """
        ids = {quantity.id for quantity in pair.quantities}
        if pair.thing is None or not ids or pair.again:
            return
        for id in self._of_all:
            may_be = self.resolver.can_have(self.things.found(pair.thing), Quantity(id, id))
            if id not in ids and may_be:
                raise PlanRejected(f"it is not clear of what the {id} is wanted; name it")

    def _require_last(self, deed: str) -> None:
        """Require an earlier wish, which "also the bottle" repeats; "what about the bottle?" also
        inverts an exclusion.

        Raises:
            PlanRejected: nothing was.
        """
        self._turning = deed == "about" and self._deed in ("know", "skip")
        if self._deed != "want" and not self._turning:
            raise PlanRejected("it is not clear what of it is wanted; say e.g. 'its mass'")

    def _require_turn(self) -> None:
        """Require an earlier exclusion, which "that of the other is not" inverts.

        Raises:
            PlanRejected: nothing was.
        """
        if self._deed not in ("know", "skip"):
            raise PlanRejected("it is not clear what of it is wanted; say e.g. 'measure the mass'")

    def _want(self, pair: Pair) -> None:
        if pair == Pair() or (self.simulated and pair == Pair((), Again("it"))):
            self._needed = True  # of what is simulated, or of everything
            return
        self._wanted = True
        if pair.quantities and not any(quantity.measurable for quantity in pair.quantities):
            self.resolver.cannot += map(self.resolver.not_measurable, pair.quantities)
            return
        objects = self.things.found(pair.thing) if pair.thing else ()
        for quantity in self._quantities(pair):
            of = objects
            if pair.thing is None and not pair.every:
                of = self._meant(quantity)
                if not of:
                    self._of_all.add(quantity.id)
            asked = self.resolver.parameters(quantity, of)
            self.asked += asked
            if self._turning:  # "we know all masses except that of the mug"
                self.excluded.difference_update(asked)
        if not self._quantities(pair):
            self._miss(objects, model=pair.every)

    def _quantities(self, pair: Pair) -> tuple[Quantity, ...]:
        """Quantities of a pair; "that of the mug" repeats the last ones.

        Raises:
            PlanRejected: none were.
        """
        if pair.again or (not pair.quantities and self._turning and pair.thing):
            if not self._last:
                raise PlanRejected("it is not said which quantity is meant; say e.g. 'the mass'")
            return self._last
        self._last = pair.quantities or self._last
        return pair.quantities

    def _spare(self, pair: Pair) -> None:
        self._last_thing = None
        objects: Items = ()
        if pair.thing is not None:
            before = len(self.things.spoken)
            objects = self.things.found(pair.thing)
            self.things.spared += objects
            if not pair.quantities:
                del self.things.spoken[before:]
        quantities = self._last if pair.again else pair.quantities
        if pair.again and not quantities:
            raise PlanRejected("it is not said which quantity is meant; say e.g. 'the mass'")
        if pair.thing is None and not pair.every and quantities and self.things.spoken:
            for quantity in quantities:
                self.excluded.update(self.resolver.exclusions(quantity, self._meant(quantity)))
            self._last = quantities
            return
        for quantity in quantities:
            self.excluded.update(self.resolver.exclusions(quantity, objects))
        if not quantities:
            self.excluded.update(self.resolver.exclusions(None, objects))
        self._last = quantities or self._last

    def _meant(self, quantity: Quantity) -> Items:
        """Last mentioned bodies that can have the quantity: the meaning of "it", or of no mention."""
        self.things.require_sure()
        for objects in reversed(self.things.spoken):
            if self.resolver.can_have(objects, quantity):
                return objects
        return ()

    def _miss(self, objects: Items, model: bool = False) -> None:
        """All that is missing of `objects`, or of the whole scene, also by a model of what carries
        all of it."""
        self._wanted = True
        found, remark = self.resolver.missing(objects, model)
        self.asked += found
        self.looked = True
        self.remarks.append(remark)

    def _read_alone(self) -> None:
        """Ask for everything missing of the bodies, in a request that names nothing else."""
        if len(self._alone) > 1 or self.things.spared:
            raise PlanRejected("it is not said what to measure of them; say e.g. 'their masses'")
        self._miss(self._alone[0])

    def _require_alone(self) -> None:
        """Require that no body was named without a quantity.

        Raises:
            PlanRejected: something was.
        """
        asked = {parameter.object for parameter in self.asked}
        for item in (item for items in self._alone for item in items):
            if not asked.issuperset(item.names):
                raise PlanRejected(f"it is not said what to measure of '{item.text}'")

    def _do(self, act: Deed) -> None:
        """A deed may follow a measurement, which it does not change; it is not done.

        Raises:
            PlanRejected: it comes first.
        """
        for thing in act.things:
            self.resolver.require_one(self.things.found(thing))
        if not self._wanted:
            raise PlanRejected(self.resolver.no_deed(act.word))
        self.resolver.cannot.append(self.resolver.no_deed(act.word))

    def _aim(self) -> None:
        """Ask for the quantities that a simulated action depends on; offer those that the scene has
        from an assumption, such as uniform density."""
        for verb, objects in self.simulated:
            ids = english().purposes.get(verb.split()[0], ())
            for id in ids:
                for one in self.resolver.parameters(Quantity(id, id), objects):
                    assumed = self.resolver.is_assumed(one)
                    (self.offered if assumed else self.asked).append(one)
            if not ids:
                self._miss(objects)
        if self.offered:
            listed = ",".join(str(one) for one in dict.fromkeys(self.offered))
            self.remarks.append(f"Assumed, not measured: {listed}; add --measure {listed}.")
        self.looked = self._wanted = True
