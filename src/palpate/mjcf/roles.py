"""Which elements of a document are its objects, its surfaces and its robots.

A body with a free joint is an object; a static named body or geom that may carry things is a
surface; an articulated body that is driven, or ends in a hand, is a robot and neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

from palpate.errors import InputError, unknown_name
from palpate.mjcf.attached import ATTACH, Brought, around, brought, prefix
from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import (
    Document,
    Element,
    children,
    compiler_settings,
    elements,
    has_unknown,
    label,
)
from palpate.mjcf.robots import (
    NOBODY,
    TRANSPARENT,
    Robots,
    copy_mark,
    find_robots,
    has_joint,
    is_free,
    through_frames,
)

Role = Literal["object", "surface"]

FLOOR = "floor"
"""What a plane without a name is called."""


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """The elements of an object or a surface.

    Attributes:
        name: as compiled models know it; of several copies, that of the first, which stands for all.
        element: its body; of a surface, its geom when that stands in the worldbody.
        geoms: all geoms of its body and what is fixed to it; of a surface, those that may carry.
        colliding: those of them that can touch, else all.
        inertial: its `<inertial>`, if any.
        defaults: what its elements inherit.
        parts: an object's bodies besides its own, which move with it.
        through: the `<attach>`s that bring it from a model of its own, the outermost first.
    """

    name: str
    role: Role
    element: Element
    geoms: tuple[Element, ...]
    colliding: tuple[Element, ...]
    inertial: Element | None
    defaults: Defaults
    parts: tuple[Element, ...] = ()
    through: tuple[Element, ...] = ()

    def moved_by(self) -> Element | None:
        """What it stands in that has a place of its own, so that its own is not the world's; None for
        nothing."""
        for outer in around(self.element, self.through):
            moves = outer.tag == "replicate" or PLACING & set(outer.keys())
            if outer.tag in (*TRANSPARENT, "body") and moves:
                return outer
        return None


PLACING = frozenset({"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"})
"""Attributes that place a body, a frame or a site."""


@dataclass(slots=True, eq=False)
class Roles:
    """Who is what in a document, in its order.

    Attributes:
        root: the scene's.
        robots: the bodies that robots begin with, or the `<attach>`s that bring them.
        ignored: bodies with other joints, which are neither robot nor object: drawers and doors.
        replicated: free bodies of which `<replicate>` or `<attach>` makes the parts, so that one
            element is many shapes.
        brought: the parts of attached models.
        copied: the `<attach>`s of what is there already, where values are written.
    """

    root: Element
    defaults: Defaults
    bodies: dict[str, Elements] = field(default_factory=dict[str, Elements])
    robots: list[Element] = field(default_factory=list[Element])
    ignored: list[Element] = field(default_factory=list[Element])
    replicated: list[Element] = field(default_factory=list[Element])
    brought: list[Brought] = field(default_factory=list[Brought])
    copied: list[Element] = field(default_factory=list[Element])

    @property
    def objects(self) -> dict[str, Elements]:
        """Objects by name."""
        return self._of("object")

    @property
    def surfaces(self) -> dict[str, Elements]:
        """What may be a surface, by name."""
        return self._of("surface")

    def compiled_name(self, element: Element, own: str) -> str | None:
        """What an element called `own` is called in compiled models; None of what is in no model."""
        part = self._bringing(element)
        if part is None and element.getroottree().getroot() is not self.root:
            return None
        return compiled_name(element, own, () if part is None else part.through)

    def _bringing(self, element: Element) -> Brought | None:
        contents = {part.content: part for part in self.brought}
        around = (element, *element.iterancestors()) if contents else ()
        return next((contents[outer] for outer in around if outer in contents), None)

    def _of(self, role: Role) -> dict[str, Elements]:
        return {name: body for name, body in self.bodies.items() if body.role == role}


def find_roles(document: Document) -> Roles:
    """Sort the bodies and geoms of a document into objects, surfaces and robots.

    Raises:
        InputError: an object without a geom, a name used twice, a surface with several geoms of
            unknown height, a robot that is not there.
    """
    attached = [model.root for model in document.attached().values()]
    found = Roles(document.root, Defaults(document.root, *attached))
    robots = find_robots(document.root, document.robots, found.defaults)
    for world in document.root.iterfind("worldbody"):
        _walk(world, found, _Model(document, robots), world=True)
    _require_found(document, found)
    return found


def _beginning(robots: Iterable[Element], document: Document) -> Iterator[str]:
    """Names that bodies of robots have in the scene."""
    for robot in robots:
        part = brought(robot, document, ()) if robot.tag == ATTACH else None
        bodies = (robot,) if part is None else part.content.iter("body")
        for body in bodies:
            yield ("" if part is None else part.prefix) + (body.get("name") or "")


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The model whose elements are being sorted.

    Attributes:
        robots: what tells them in it.
        through: the `<attach>`s that bring it.
    """

    document: Document
    robots: Robots
    through: tuple[Element, ...] = ()

    def bringing(self, attach: Element) -> Brought | None:
        """What an `<attach>` of it brings."""
        return brought(attach, self.document, self.through)

    def inside(self, part: Brought) -> _Model:
        """The model that a part of it comes from."""
        robots = self.robots.within(part.through[-1].get("prefix") or "", part.model.root)
        return _Model(part.model, robots, part.through)

    def name(self, element: Element, own: str) -> str:
        """What an element is called in compiled models."""
        return compiled_name(element, own, self.through)


def compiled_name(element: Element, own: str, through: Sequence[Element]) -> str:
    """What an element called `own` is called that comes `through` some `<attach>`s."""
    marks = [copy_mark(part) for part in (element, *reversed(through))]
    return prefix(through) + own + "".join(marks)


def _require_found(document: Document, found: Roles) -> None:
    """The robots that were named are there."""
    names = {*_beginning(found.robots, document), NOBODY}
    others = [*found.ignored, *(body.element for body in found.bodies.values())]
    valid = {name for body in others if body.tag == "body" and (name := body.get("name"))}
    for name in document.robots:
        if name not in names:
            raise unknown_name("body that a robot begins with", name, {*valid, NOBODY})


def _walk(parent: Element, found: Roles, model: _Model, world: bool) -> None:
    for child in children(parent):
        if child.tag in TRANSPARENT:
            _walk(child, found, model, world)
        elif child.tag == "geom" and world and (child.get("name") or _is_floor(child, found)):
            _add_surface(child, (child,), found, model)
        elif child.tag == "body":
            _sort_body(child, found, model)
        elif child.tag == ATTACH:
            _sort_attached(child, found, model, world)


def _sort_attached(attach: Element, found: Roles, model: _Model, world: bool) -> None:
    """What an attached model brings is a robot, or is sorted as if it stood here."""
    part = model.bringing(attach)
    if part is None:
        return
    if _holds_robot(part, model):
        found.robots.append(attach)
    elif _is_there(part, found):
        found.copied.append(attach)
    else:
        found.brought.append(part)
        if part.content.tag == "body":
            _sort_body(part.content, found, model.inside(part))
        else:
            _walk(part.content, found, model.inside(part), world)


def _holds_robot(part: Brought, model: _Model) -> bool:
    """Whether a robot begins in an attached part, or in what that attaches."""
    pending, seen = [(part, model)], list[Brought]()
    while pending:
        part, model = pending.pop()
        inside = model.inside(part)
        if any(inside.robots.begin_with(body) for body in part.content.iter("body")):
            return True
        seen.append(part)
        for attach in () if part.is_own else part.content.iter(ATTACH):
            inner = inside.bringing(attach)
            if inner is not None and not any(inner.overlaps(other) for other in seen):
                pending.append((inner, inside))
    return False


def _is_there(part: Brought, found: Roles) -> bool:
    """Whether its elements are those of something else in the scene, too."""
    return part.is_own or any(part.overlaps(other) for other in found.brought)


def _is_floor(geom: Element, found: Roles) -> bool:
    """Whether it is the plane without a name that most models stand on, the first of them."""
    return found.defaults.attribute(geom, "type") == "plane" and FLOOR not in found.bodies


def _sort_body(body: Element, found: Roles, model: _Model) -> None:
    if model.robots.begin_with(body):
        found.robots.append(body)
    elif is_free(body, found.defaults):
        if _has_copies(body, found, model):
            found.replicated.append(body)
        else:
            _add_object(body, found, model)
    elif not has_joint(body):
        if body.get("name") and body.get("mocap") != "true":
            _add_surface(body, _own_geoms(body), found, model)
        _walk(body, found, model, world=not body.get("name"))
    else:
        found.ignored.append(body)


def _has_copies(body: Element, found: Roles, model: _Model) -> bool:
    """Whether one element of a body makes several parts of the scene."""
    if body.find(".//replicate") is not None:
        return True
    brings = [(part, model) for part in _brings(body, model)]
    seen: list[Brought] = []
    while brings:
        part, outer = brings.pop()
        if _is_there(part, found) or any(part.overlaps(other) for other in seen):
            return True
        seen.append(part)
        inside = outer.inside(part)
        brings += [(inner, inside) for inner in _brings(part.content, inside)]
    return False


def _brings(element: Element, model: _Model) -> Iterator[Brought]:
    """What is attached below an element."""
    for attach in element.iter(ATTACH):
        part = model.bringing(attach)
        if part is not None:
            yield part


def _own_geoms(body: Element) -> tuple[Element, ...]:
    return tuple(child for child in through_frames(body) if child.tag == "geom")


def _colliding(geoms: tuple[Element, ...], defaults: Defaults) -> tuple[Element, ...]:
    """The geoms that can touch something; all of them where none can."""
    touching = tuple(geom for geom in geoms if _touches(geom, defaults))
    return touching or geoms


def _touches(geom: Element, defaults: Defaults) -> bool:
    contype = defaults.attribute(geom, "contype") or "1"
    conaffinity = defaults.attribute(geom, "conaffinity") or "1"
    return contype.strip() != "0" or conaffinity.strip() != "0"


def _add_object(body: Element, found: Roles, model: _Model) -> None:
    all_parts = list(_parts(body, found, model))
    geoms = tuple(part for part in all_parts if part.tag == "geom")
    if not geoms:
        raise InputError(f"object {label(body)} has no geom, so it has no shape to touch")
    own = body.get("name") or _named(body, geoms[0], found, model)
    made = Elements(
        model.name(body, own),
        "object",
        body,
        geoms,
        _colliding(geoms, found.defaults),
        inertial_of(body),
        found.defaults,
        tuple(part for part in all_parts if part.tag == "body" and part is not body),
        model.through,
    )
    _register(made, found)


def _parts(body: Element, found: Roles, model: _Model) -> Iterator[Element]:
    """An object's elements, those that it attaches among them."""
    for element in elements(body):
        yield element
        part = model.bringing(element) if element.tag == ATTACH else None
        if part is not None:
            found.brought.append(part)
            yield from _parts(part.content, found, model.inside(part))


def _named(body: Element, geom: Element, found: Roles, model: _Model) -> str:
    """A name for a body that has none, after what it is, by which models compiled of the document
    know it, too."""
    shape = found.defaults.attribute(geom, "type") or "sphere"
    stem = geom.get("name") or found.defaults.attribute(geom, "mesh") or shape
    taken = {e.get("name") for e in elements(body.getroottree().getroot()) if e.tag == "body"}
    name, count = stem, 1
    while name in taken or prefix(model.through) + name in found.bodies:
        count += 1
        name = f"{stem}_{count}"
    body.set("name", name)
    return name


def inertial_of(body: Element) -> Element | None:
    """A body's `<inertial>`, where MuJoCo looks at it."""
    settings = compiler_settings(body.getroottree().getroot())
    if settings.get("inertiafromgeom") == "true":
        return None
    return body.find("inertial")


def _add_surface(element: Element, geoms: tuple[Element, ...], found: Roles, model: _Model) -> None:
    carrying = _carrying(element, _colliding(geoms, found.defaults), found.defaults)
    if carrying:
        name = model.name(element, element.get("name") or FLOOR)
        body = Elements(
            name,
            "surface",
            element,
            carrying,
            carrying,
            None,
            found.defaults,
            through=model.through,
        )
        _register(body, found)


def _carrying(
    element: Element, geoms: tuple[Element, ...], defaults: Defaults
) -> tuple[Element, ...]:
    """The geoms that may be a surface's top: the one whose own height is open, else all."""
    marked = tuple(geom for geom in geoms if has_open_height(geom, defaults))
    if len(marked) > 1:
        raise InputError(
            f"surface {label(element)} has `?` in several geoms; only one can be its top"
        )
    return marked or geoms


def has_open_height(geom: Element, defaults: Defaults) -> bool:
    """Whether its z or its half height is written `?`."""
    index = half_height_index(geom, defaults)
    open_size = index is not None and has_unknown(geom, "size", index)
    return open_size or has_unknown(geom, "pos", 2)


def half_height_index(geom: Element, defaults: Defaults) -> int | None:
    """Which number of `size` is the half height: box 2, cylinder 1, others None."""
    return {"box": 2, "cylinder": 1}.get(defaults.attribute(geom, "type") or "sphere")


def _register(body: Elements, found: Roles) -> None:
    if body.name in found.bodies:
        raise InputError(
            f"two objects or surfaces are called '{body.name[:80]}' ({label(body.element)} is the "
            "second); give each its own name"
        )
    found.bodies[body.name] = body
