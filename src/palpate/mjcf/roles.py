"""Which elements of a document are its objects, its surfaces and its robots.

A body with a free joint is an object; a static named body or geom that may carry things is a
surface; an articulated body that is driven, or ends in a hand, is a robot and neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from palpate.errors import InputError, unknown_name
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
    attached_body,
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
    """

    name: str
    role: Role
    element: Element
    geoms: tuple[Element, ...]
    colliding: tuple[Element, ...]
    inertial: Element | None
    defaults: Defaults


@dataclass(slots=True, eq=False)
class Roles:
    """Who is what in a document, in its order.

    Attributes:
        robots: the bodies that robots begin with. ignored: bodies with other joints, which are
            neither robot nor object: drawers and doors. replicated: free bodies of which
            `<replicate>` makes the parts, so that one element is many shapes. attached: the
            `<attach>`s of what is taken as it is in its own file. models: those that it attaches.
    """

    defaults: Defaults
    bodies: dict[str, Elements] = field(default_factory=dict[str, Elements])
    robots: list[Element] = field(default_factory=list[Element])
    ignored: list[Element] = field(default_factory=list[Element])
    replicated: list[Element] = field(default_factory=list[Element])
    attached: list[Element] = field(default_factory=list[Element])
    models: Mapping[str, Element] = field(default_factory=dict[str, Element])

    @property
    def objects(self) -> dict[str, Elements]:
        """Objects by name."""
        return self._of("object")

    @property
    def surfaces(self) -> dict[str, Elements]:
        """What may be a surface, by name."""
        return self._of("surface")

    def _of(self, role: Role) -> dict[str, Elements]:
        return {name: body for name, body in self.bodies.items() if body.role == role}


def find_roles(document: Document) -> Roles:
    """Sort the bodies and geoms of a document into objects, surfaces and robots.

    Raises:
        InputError: an object without a geom, a name used twice, a surface with several geoms of
            unknown height, a robot that is not there.
    """
    found = Roles(Defaults(document.root), models=document.models)
    robots = find_robots(document.root, document.robots, found.defaults)
    for world in document.root.iterfind("worldbody"):
        _walk(world, found, robots, world=True)
    _require_found(document, found)
    return found


def _require_found(document: Document, found: Roles) -> None:
    """The robots that were named are there."""
    names = {robot.get("name") for robot in found.robots} | {NOBODY}
    others = [*found.ignored, *(body.element for body in found.bodies.values())]
    valid = {name for body in others if body.tag == "body" and (name := body.get("name"))}
    for name in document.robots:
        if name not in names:
            raise unknown_name("body that a robot begins with", name, {*valid, NOBODY})


def _walk(parent: Element, found: Roles, robots: Robots, world: bool) -> None:
    for child in children(parent):
        if child.tag in TRANSPARENT:
            _walk(child, found, robots, world)
        elif child.tag == "geom" and world and (child.get("name") or _is_floor(child, found)):
            _add_surface(child, (child,), found)
        elif child.tag == "body":
            _sort_body(child, found, robots)
        elif child.tag == "attach":
            _sort_attached(child, found, robots)


def _sort_attached(attach: Element, found: Roles, robots: Robots) -> None:
    """What an attached model brings is a robot, or stands as its own file has it."""
    body = attached_body(attach, found.models)
    if body is not None:
        own = body.getroottree().getroot()
        if find_robots(own, robots.named, Defaults(own)).are_attached(body):
            found.robots.append(attach)
            return
    found.attached.append(attach)


def _is_floor(geom: Element, found: Roles) -> bool:
    """Whether it is the plane without a name that most models stand on, the first of them."""
    return found.defaults.attribute(geom, "type") == "plane" and FLOOR not in found.bodies


def _sort_body(body: Element, found: Roles, robots: Robots) -> None:
    if robots.begin_with(body):
        found.robots.append(body)
    elif is_free(body, found.defaults):
        if body.find(".//replicate") is None:
            _add_object(body, found)
        else:
            found.replicated.append(body)
    elif not has_joint(body):
        if body.get("name") and body.get("mocap") != "true":
            _add_surface(body, _own_geoms(body), found)
        _walk(body, found, robots, world=not body.get("name"))
    else:
        found.ignored.append(body)


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


def _add_object(body: Element, found: Roles) -> None:
    geoms = tuple(e for e in elements(body) if e.tag == "geom")
    if not geoms:
        raise InputError(f"object {label(body)} has no geom, so it has no shape to touch")
    name = (body.get("name") or _named(body, geoms[0], found)) + copy_mark(body)
    colliding = _colliding(geoms, found.defaults)
    inertial = inertial_of(body)
    _register(Elements(name, "object", body, geoms, colliding, inertial, found.defaults), found)


def _named(body: Element, geom: Element, found: Roles) -> str:
    """A name for a body that has none, after what it is, by which models compiled of the document
    know it, too."""
    shape = found.defaults.attribute(geom, "type") or "sphere"
    stem = geom.get("name") or found.defaults.attribute(geom, "mesh") or shape
    taken = {e.get("name") for e in elements(body.getroottree().getroot()) if e.tag == "body"}
    name, count = stem, 1
    while name in taken or name in found.bodies:
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


def _add_surface(element: Element, geoms: tuple[Element, ...], found: Roles) -> None:
    carrying = _carrying(element, _colliding(geoms, found.defaults), found.defaults)
    if carrying:
        name = (element.get("name") or FLOOR) + copy_mark(element)
        body = Elements(name, "surface", element, carrying, carrying, None, found.defaults)
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
