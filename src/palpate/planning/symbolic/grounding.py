"""What a sentence asks for: from the words of a request to the parameters of a scene.

Deterministic and shallow on purpose: it pairs quantities with the objects they are said of, and
where it cannot, it says what it understood instead of guessing.

The grammar, from the outside in:

    request   = clause { turn clause }
    turn      = "." | ";" | "?" | "we know" | "is known" | "except" | "do not measure" | "but" | …
    clause    = { group | filler }           wanted, or, after "we know" and "except", not wanted
    group     = mention { list mention }     of quantities or of objects, never of both
    list      = "," | "and" | "or" | "plus", with articles beside it
    mention   = quantity | unmeasurable property | object | unknown object | pronoun | "everything"
    object    = { colour | shape | word of its name } noun

An object that fits several bodies is ambiguous, unless it is a plural ("the bottles") or stands
after "all", "both", "every".

A clause ends where a turn of phrase says that something else begins. "We know the height but not
the mass": what is known is taken out, and the "not" turns back to what is wanted. "All but the
bottle", "do not touch the box": taken out.

Which objects a group of quantities is said of, the first that applies:

1. those after it: a linking word stands between ("the mass *of* the bottle and the mug", "how
   heavy *is* the box"), or nothing but articles ("weigh the mug"), unless an object stands right
   before ("bottle mass");
2. those spoken of last that can have the quantity: "the bottle's mass and friction", "bottle
   mass", "the bottle is new, I need its mass". A pronoun names nothing, so it means the same;
3. none were spoken of: all that miss the quantity, or, where none does, all that can have it.

Two lists that only look like one are divided. A compound name belongs to the quantity after it:
in "the mass of the bottle and mug friction" the mug is the friction's. A quantity right after its
object is that object's: in "what does the cup weigh and how high is the table" the weight is the
cup's.

Objects named without any quantity mean all that the scene misses of them, "everything" and a goal
("build a simulation") all that it misses; either reading is remarked on. "Where" asks for a
position only where it opens a question, and not in "tell me where its balance point is".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.symbolic.clauses import Clause, clauses
from palpate.planning.symbolic.mentions import Item, Words
from palpate.planning.symbolic.resolver import Resolver
from palpate.planning.symbolic.tokens import tokens
from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Grounded:
    """What a request asks for.

    Attributes:
        asked: the parameters it names, whether or not the scene states them.
        cannot: one sentence for each thing asked that no plan can measure.
        remarks: how something unsaid was read.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


Objects = tuple[Item, ...]


@dataclass
class _Reading:
    """What has been understood so far.

    Attributes:
        pairs: quantities that are wanted, with the objects they are said of.
        excluded: likewise what is not wanted; no quantity stands for all of them.
        alone: objects that are named without a quantity.
        spoken: the objects of every group so far, which "it" may mean.
    """

    resolver: Resolver
    pairs: list[tuple[Item, Objects]] = field(default_factory=list[tuple[Item, Objects]])
    excluded: list[tuple[Item | None, Objects]] = field(
        default_factory=list[tuple[Item | None, Objects]]
    )
    alone: list[Item] = field(default_factory=list[Item])
    spoken: list[Objects] = field(default_factory=list[Objects])

    def read(self, clause: Clause) -> None:
        """Take in the next clause: its quantities with their objects, then the other objects."""
        used = self._read_quantities(clause)
        for at, group in enumerate(clause.groups):
            if at in used or group.of_quantities:
                continue
            if clause.wanted:
                self.alone += clause.property_of_next(at) or group.named
            else:
                self.excluded.append((None, group.named or self._last_spoken()))

    def _read_quantities(self, clause: Clause) -> set[int]:
        """Pair the quantities of a clause; the groups whose objects they are said of."""
        used: set[int] = set()
        for at, group in enumerate(clause.groups):
            if not group.of_quantities:
                self._speak_of(group.named)
                continue
            objects: Objects = ()
            if clause.said_of_next(at):
                objects = clause.groups[at + 1].named
                used.add(at + 1)
            for quantity in group.items:
                said_of = objects or self._meant(quantity)
                self._pair(quantity, said_of, clause.wanted)
                used |= _positions(said_of, clause, at)
        return used

    def _pair(self, quantity: Item, objects: Objects, wanted: bool) -> None:
        if wanted:
            self.pairs.append((quantity, objects))
        else:
            self.excluded.append((quantity, objects))

    def _speak_of(self, objects: Objects) -> None:
        if objects:
            self.spoken.append(objects)

    def _meant(self, quantity: Item) -> Objects:
        """What was spoken of last that can have `quantity`: the meaning of "it", or of saying
        nothing."""
        for objects in reversed(self.spoken):
            if self.resolver.can_have(objects, quantity):
                return objects
        return ()

    def _last_spoken(self) -> Objects:
        return self.spoken[-1] if self.spoken else ()


def ground(request: str, scene: Scene) -> Grounded:
    """What `request` asks for in `scene`.

    Raises:
        InputError: empty or too long, or it names an object that the scene does not have (the
            message lists those it has). PlanRejected: ambiguous, or nothing in it is understood;
            the message says what to say instead.
    """
    if not request.strip():
        raise InputError("the request is empty; say what is unknown, e.g. 'the mass of the bottle'")
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters; say it in at most {MAX_REQUEST}"
        )
    reading = _Reading(Resolver(scene))
    for clause in clauses(Words(scene).items(tokens(request))):
        reading.read(clause)
    return _answer(request, reading, reading.resolver)


def _positions(objects: Objects, clause: Clause, before: int) -> set[int]:
    """Which groups before group `before` name just these objects."""
    return {at for at, group in enumerate(clause.groups[:before]) if group.named == objects}


def _answer(request: str, reading: _Reading, resolver: Resolver) -> Grounded:
    """The parameters of what was understood, less what was excluded."""
    excluded: set[Parameter] = set()
    for quantity, objects in reading.excluded:
        excluded.update(resolver.exclusions(quantity, objects))
    asked: list[Parameter] = []
    for quantity, objects in reading.pairs:
        asked += resolver.parameters(quantity, objects)
    remark = ""
    everything = any(item.kind == "everything" for item in reading.alone)
    if everything or not reading.pairs:
        found, remark = resolver.without_quantity(request, reading.alone)
        asked += found
    if not (asked or resolver.cannot or remark):
        resolver.reject(request)
    return Grounded(
        asked=tuple(_less(resolver.ordered(asked), excluded)),
        cannot=tuple(dict.fromkeys(resolver.cannot)),
        remarks=(remark,) if remark else (),
    )


def _less(parameters: Sequence[Parameter], excluded: set[Parameter]) -> list[Parameter]:
    return [parameter for parameter in parameters if parameter not in excluded]
