"""R on the scene's objects and the quantity catalogue: which gaps does a sentence ask for?

Deterministic and shallow on purpose: it pairs quantities with the objects they are said of, and
where it cannot, it says what it understood instead of guessing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.planner import MAX_REQUEST
from palpate.planning.symbolic import lexicon
from palpate.planning.symbolic.mentions import GRIPPER, Item, Words
from palpate.quantities.quantity import QUANTITIES
from palpate.scene.scene import Scene

_TURNS = lexicon.word_set("need want measure determine find estimate tell")
"""Verbs that end a remark about what is known already."""


@dataclass(frozen=True, slots=True)
class Grounded:
    """What a request asks for.

    Attributes:
        asked: the gaps it names, whether or not the scene states them.
        cannot: one sentence for each thing asked that no plan can measure.
        remarks: how something unsaid was read.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass
class _Group:
    """Quantities, or objects, that are listed together."""

    items: list[Item]
    start: int
    end: int

    @property
    def of_quantities(self) -> bool:
        return self.items[0].kind in ("quantity", "unmeasurable")


@dataclass
class _Reading:
    """What has been understood so far: quantities with what they are said of, and objects named
    alone."""

    pairs: list[tuple[Item, tuple[Item, ...]]] = field(
        default_factory=list[tuple[Item, tuple[Item, ...]]]
    )
    excluded: list[tuple[Item | None, tuple[Item, ...]]] = field(
        default_factory=list[tuple[Item | None, tuple[Item, ...]]]
    )
    alone: list[Item] = field(default_factory=list[Item])
    spoken: list[tuple[Item, ...]] = field(default_factory=list[tuple[Item, ...]])

    def meant(self, quantity: Item, resolver: _Resolver) -> tuple[Item, ...]:
        """What was spoken of last that can have `quantity`: the meaning of "it", or of saying
        nothing."""
        fits = (
            objects for objects in reversed(self.spoken) if resolver.can_have(objects, quantity)
        )
        return next(fits, ())


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
    reading, resolver = _Reading(), _Resolver(scene)
    for segment, positive in _segments(Words(scene).items(lexicon.tokens(request))):
        _read(segment, positive, reading, resolver)
    return _answer(request, reading, resolver)


def _segments(items: Sequence[Item]) -> Iterator[tuple[list[Item], bool]]:
    """Stretches of the request with whether they say what is wanted (or what is not)."""
    current: list[Item] = []
    mode = "want"
    for i, item in enumerate(items):
        turn = _turn(item, items[i + 1 :], mode)
        if turn is None:
            current.append(item)
            continue
        if item.text == "§was_known":
            mode = "know"
        yield current, mode == "want"
        current, mode = [], turn
    yield current, mode == "want"


def _turn(item: Item, following: Sequence[Item], mode: str) -> str | None:
    """The mode that begins at `item`, None when it goes on."""
    if item.kind == "mark":
        toggled = "want" if mode == "know" else "skip"
        return {"§want": "want", "§know": "know", "§was_known": "want", "§neg": toggled}[item.text]
    if item.kind == "break" and item.text != ":":
        return "want"
    if mode == "know" and (item.text in _TURNS or item.text == "but"):
        return "want" if not (following and following[0].text == "§neg") else None
    if mode == "skip" and (item.text == "but" or (item.text == "," and _names_quantity(following))):
        return "want"
    return None


def _names_quantity(following: Sequence[Item]) -> bool:
    content = [item for item in following if item.kind not in ("stop", "list")]
    return bool(content) and content[0].kind in ("quantity", "unmeasurable")


def _read(segment: list[Item], positive: bool, reading: _Reading, resolver: _Resolver) -> None:
    segment = [
        item for i, item in enumerate(segment) if item.text != "where" or _asks_where(segment, i)
    ]
    groups = _groups(segment)
    forward = {
        i + 1
        for i, group in enumerate(groups)
        if group.of_quantities and _forward(groups, i, segment)
    }
    used = set(forward)
    for i, group in enumerate(groups):
        if not group.of_quantities:
            reading.spoken += [named] if (named := _named(group)) else []
            continue
        for quantity in group.items:
            objects = _named(groups[i + 1]) if i + 1 in forward else ()
            objects = objects or reading.meant(quantity, resolver)
            used |= {k for k, other in enumerate(groups[:i]) if _named(other) == objects}
            if positive:
                reading.pairs.append((quantity, objects))
            else:
                reading.excluded.append((quantity, objects))
    for i, group in enumerate(groups):
        if i in used or group.of_quantities:
            continue
        if positive:
            reading.alone += _property_of(groups, i, segment) or _named(group)
        else:
            reading.excluded.append((None, _named(group) or next(reversed(reading.spoken), ())))


def _named(group: _Group) -> tuple[Item, ...]:
    return tuple(item for item in group.items if item.kind != "pronoun")


def _property_of(groups: Sequence[_Group], at: int, segment: Sequence[Item]) -> tuple[Item, ...]:
    """In "the wetness of the bottle", an unknown word that is a property and not an object."""
    item = groups[at].items[0]
    if item.kind != "unknown" or at + 1 >= len(groups) or lexicon.GOAL.search(item.text):
        return ()
    between = segment[groups[at].end + 1 : groups[at + 1].start]
    is_property = groups[at + 1].items[0].kind == "object" and between and between[0].text == "of"
    return (Item("unmeasurable", item.words, (item.text,)),) if is_property else ()


def _asks_where(segment: Sequence[Item], at: int) -> bool:
    """Whether a "where" asks for a position: not a relative clause, not "where its balance point
    is"."""
    opens = at == 0 or segment[at - 1].text in (
        "me",
        "out",
        "determine",
        "measure",
        "and",
        ",",
        "find",
        "see",
    )
    return opens and not any(
        item.kind in ("quantity", "unmeasurable") for item in segment[at + 1 :]
    )


def _groups(segment: Sequence[Item]) -> list[_Group]:
    groups: list[_Group] = []
    for i, item in enumerate(segment):
        if item.kind not in (
            "quantity",
            "unmeasurable",
            "object",
            "unknown",
            "pronoun",
            "everything",
        ):
            continue
        group = _Group([item], i, i)
        if (
            groups
            and groups[-1].of_quantities == group.of_quantities
            and _listed(segment[groups[-1].end + 1 : i])
        ):
            groups[-1] = _Group([*groups[-1].items, item], groups[-1].start, i)
        else:
            groups.append(group)
    return list(_split_compounds(groups, segment))


def _split_compounds(groups: Sequence[_Group], segment: Sequence[Item]) -> Iterator[_Group]:
    """In "the mass of the bottle and mug friction", the mug belongs to the friction; in "what does
    the cup weigh and how high is the table", the weight to the cup."""
    for i, group in enumerate(groups):
        following = groups[i + 1] if i + 1 < len(groups) else None
        compound = (
            following is not None
            and len(group.items) > 1
            and not group.of_quantities
            and i > 0
            and all(item.text == "'s" for item in segment[group.end + 1 : following.start])
            and not _forward(groups, i + 1, segment)
        )
        between = (
            len(group.items) > 1
            and group.of_quantities
            and _compound(groups, i, segment)
            and _forward(groups, i, segment)
        )
        if compound or between:
            listed = next(
                k for k in range(group.end - 1, group.start, -1) if segment[k].kind == "list"
            )
            yield _Group(group.items[:-1], group.start, listed - 1)
            yield _Group(group.items[-1:], group.end, group.end)
        else:
            yield group


def _listed(between: Sequence[Item]) -> bool:
    fillers = lexicon.DETERMINERS | lexicon.EVERY | {"of", "for", "also", "how"}
    return any(item.kind == "list" for item in between) and all(
        item.kind == "list" or item.text in fillers for item in between
    )


def _forward(groups: Sequence[_Group], at: int, segment: Sequence[Item]) -> bool:
    """Whether the quantities of group `at` are said of the objects after them."""
    if at + 1 >= len(groups) or groups[at + 1].of_quantities:
        return False
    between = segment[groups[at].end + 1 : groups[at + 1].start]
    if any(item.links for item in between):
        return True
    adjacent = all(item.text in lexicon.DETERMINERS | lexicon.EVERY for item in between)
    return adjacent and not _compound(groups, at, segment)


def _compound(groups: Sequence[_Group], at: int, segment: Sequence[Item]) -> bool:
    """Whether an object stands right before the quantities of group `at`: "bottle mass", "the
    bottle's mass"."""
    if at == 0 or groups[at - 1].of_quantities or groups[at - 1].items[-1].names == (GRIPPER,):
        return False
    return all(item.text == "'s" for item in segment[groups[at - 1].end + 1 : groups[at].start])


def _answer(request: str, reading: _Reading, resolver: _Resolver) -> Grounded:
    excluded = {
        parameter
        for quantity, objects in reading.excluded
        for parameter in resolver.exclusions(quantity, objects)
    }
    remarks: list[str] = []
    asked = [
        parameter
        for quantity, objects in reading.pairs
        for parameter in resolver.parameters(quantity, objects)
    ]
    if not reading.pairs or any(item.kind == "everything" for item in reading.alone):
        found, remark = resolver.without_quantity(request, reading.alone)
        asked += found
        remarks += [remark] if remark else []
    kept = tuple(parameter for parameter in resolver.ordered(asked) if parameter not in excluded)
    if not asked and not resolver.cannot and not remarks:
        resolver.reject(request)
    return Grounded(kept, tuple(dict.fromkeys(resolver.cannot)), tuple(remarks))


class _Resolver:
    """Mentions to gaps, with what stands in the way."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.cannot: list[str] = []

    def parameters(self, quantity: Item, objects: Sequence[Item]) -> list[Parameter]:
        """The gaps of one quantity said of some objects (of all that miss it, when none is
        named)."""
        if quantity.kind == "unmeasurable" or not QUANTITIES[quantity.names[0]].identifiable:
            self.cannot.append(self._not_measurable(quantity))
            return []
        id = quantity.names[0]
        if not objects:
            return self._missing_or_only(id)
        if any(item.kind == "everything" for item in objects):
            return [Parameter(name, id) for name in self._carriers(id)]
        for item in objects:
            if item.kind == "unknown":
                raise InputError(f"the scene has no '{item.text}'; it has {self._listed_bodies()}")
        found = [Parameter(name, id) for item in objects for name in self._names(item, id)]
        if not found:
            self.cannot.append(self._wrong_subject(id, objects))
        return found

    def can_have(self, objects: Sequence[Item], quantity: Item) -> bool:
        """Whether one of `objects` can have `quantity`."""
        id = quantity.names[0]
        return any(
            item.kind in ("everything", "unknown")
            or id not in QUANTITIES
            or any(self._carries(name, id) for name in item.names)
            for item in objects
        )

    def exclusions(self, quantity: Item | None, objects: Sequence[Item]) -> list[Parameter]:
        """The gaps that "except …" or "we know …" takes out."""
        ids = (
            list(QUANTITIES) if quantity is None else [i for i in quantity.names if i in QUANTITIES]
        )
        if not objects and quantity is not None:
            return [Parameter(name, id) for id in ids for name in self._carriers(id)]
        names = {
            name
            for item in objects
            for name in (self.scene.bodies if item.kind == "everything" else item.names)
        }
        return [Parameter(name, id) for name in names for id in ids]

    def without_quantity(self, request: str, alone: Sequence[Item]) -> tuple[list[Parameter], str]:
        """What a request means that names objects, a goal or "everything", but no quantity."""
        for item in alone:
            if item.kind == "unknown" and not any(other.names for other in alone):
                raise InputError(f"the scene has no '{item.text}'; it has {self._listed_bodies()}")
        properties = [item for item in alone if item.kind == "unmeasurable"]
        if properties:
            self.cannot += [self._not_measurable(item) for item in properties]
            return [], ""
        mentioned = list(
            dict.fromkeys(name for item in alone if item.names for name in self._names(item, None))
        )
        everything = self.scene.missing()
        if mentioned:
            parameters = [parameter for parameter in everything if parameter.object in mentioned]
            names = ", ".join(mentioned)
            return parameters, (
                f"The request names no quantity, so everything the scene misses of {names} is meant"
                + ("." if parameters else f"; nothing of {names} is missing.")
            )
        if any(item.kind == "everything" for item in alone) or lexicon.GOAL.search(request.lower()):
            return list(everything), "Everything that the scene misses is meant."
        return [], ""

    def ordered(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Surfaces first, then objects, both in document order; quantities as in the catalogue."""
        names = [*self.scene.surfaces, *self.scene.objects, GRIPPER]
        ids = list(QUANTITIES)
        return sorted(
            dict.fromkeys(parameters),
            key=lambda parameter: (names.index(parameter.object), ids.index(parameter.quantity)),
        )

    def reject(self, request: str) -> None:
        """Nothing was understood.

        Raises:
            PlanRejected: always; it says what can be asked.
        """
        shown = " ".join(request.split())[:80]
        raise PlanRejected(
            f"nothing in '{shown}' names a quantity or an object of this scene; ask for "
            f"{self._measurable()} of {self._listed_bodies()}"
        )

    def _names(self, item: Item, id: str | None) -> tuple[str, ...]:
        names = tuple(n for n in item.names if id is None or self._carries(n, id))
        if item.plural or len(names) <= 1:
            return names
        choices = " or ".join(f"'{name}'" for name in names)
        what = f"the {QUANTITIES[id].label} of " if id else ""
        raise PlanRejected(
            f"'the {item.text}' may be {choices}; name one, e.g. '{what}{names[0]}', or ask for all of "
            f"them, e.g. '{what}all of {', '.join(names)}'"
        )

    def _missing_or_only(self, id: str) -> list[Parameter]:
        missing = [parameter for parameter in self.scene.missing() if parameter.quantity == id]
        carriers = self._carriers(id)
        return missing or [Parameter(name, id) for name in carriers]

    def _carriers(self, id: str) -> list[str]:
        if QUANTITIES[id].subject == "gripper":
            return [GRIPPER]
        return [name for name in self.scene.bodies if self._carries(name, id)]

    def _carries(self, name: str, id: str) -> bool:
        subject = QUANTITIES[id].subject
        if name == GRIPPER:
            return subject == "gripper"
        return subject == self.scene.bodies[name].role or (
            subject == "gripper" and name in self.scene.objects
        )

    def _not_measurable(self, quantity: Item) -> str:
        id = quantity.names[0]
        reason = QUANTITIES[id].how if id in QUANTITIES else "no primitive of the robot senses it"
        label = QUANTITIES[id].label if id in QUANTITIES else id
        return f"The {label} cannot be measured: {reason}; what can be is {self._measurable()}."

    def _wrong_subject(self, id: str, objects: Sequence[Item]) -> str:
        subject = QUANTITIES[id].subject
        carriers = ", ".join(self._carriers(id)) or "none here"
        return (
            f"The {QUANTITIES[id].label} of '{objects[0].text}' cannot be measured: it is measured of "
            f"{'an' if subject[0] in 'aeiou' else 'a'} {subject} ({carriers})."
        )

    def _measurable(self) -> str:
        return ", ".join(q.label for q in QUANTITIES.values() if q.identifiable)

    def _listed_bodies(self) -> str:
        return ", ".join(self.scene.bodies) or "no objects at all"
