"""Goes through a document, the models that it attaches among it, and says who is what."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from palpate.errors import InputError, unknown_name
from palpate.mjcf.attached import ATTACH, Brought, brought, prefix
from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Document, Element, children, elements, label
from palpate.mjcf.roles.elements import Elements, carrying, colliding, inertial_of, own_geoms
from palpate.mjcf.roles.robots import (
    NOBODY,
    TRANSPARENT,
    Robots,
    find_robots,
    has_joint,
    is_free,
)
from palpate.mjcf.roles.roles import Roles, compiled_name

FLOOR = "floor"
"""Name of a plane without a name."""


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
        """Content of an `<attach>`."""
        return brought(attach, self.document, self.through)

    def inside(self, part: Brought) -> _Model:
        """The model that a part of it comes from."""
        robots = self.robots.within(part.through[-1].get("prefix") or "", part.model.root)
        return _Model(part.model, robots, part.through)

    def name(self, element: Element, own: str) -> str:
        """Compiled name of an element."""
        return compiled_name(element, own, self.through)


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
    """Sort an attached model: as a robot, or like the scene's own bodies."""
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
            _add_surface(body, own_geoms(body), found, model)
        _walk(body, found, model, world=not body.get("name"))
    else:
        found.ignored.append(body)


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
        colliding(geoms, found.defaults),
        inertial_of(body),
        found.defaults,
        tuple(part for part in all_parts if part.tag == "body" and part is not body),
        model.through,
    )
    _register(made, found)


def _add_surface(element: Element, geoms: tuple[Element, ...], found: Roles, model: _Model) -> None:
    tops = carrying(element, colliding(geoms, found.defaults), found.defaults)
    if tops:
        name = model.name(element, element.get("name") or FLOOR)
        body = Elements(
            name,
            "surface",
            element,
            tops,
            tops,
            None,
            found.defaults,
            through=model.through,
        )
        _register(body, found)


def _register(body: Elements, found: Roles) -> None:
    if body.name in found.bodies:
        raise InputError(
            f"two objects or surfaces are called '{body.name[:80]}' ({label(body.element)} is the "
            "second); give each its own name"
        )
    found.bodies[body.name] = body


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


def _is_floor(geom: Element, found: Roles) -> bool:
    """True if it is the plane without a name that most models stand on, the first of them."""
    return found.defaults.attribute(geom, "type") == "plane" and FLOOR not in found.bodies


def _is_there(part: Brought, found: Roles) -> bool:
    """True if its elements are those of something else in the scene, too."""
    return part.is_own or any(part.overlaps(other) for other in found.brought)


def _holds_robot(part: Brought, model: _Model) -> bool:
    """True if a robot begins in an attached part, or in what that attaches."""
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


def _has_copies(body: Element, found: Roles, model: _Model) -> bool:
    """True if one element of a body makes several parts of the scene."""
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
    """Attached content below an element."""
    for attach in element.iter(ATTACH):
        part = model.bringing(attach)
        if part is not None:
            yield part


def _require_found(document: Document, found: Roles) -> None:
    """The robots that were named are there."""
    names = {*_beginning(found.robots, document), NOBODY}
    others = [*found.ignored, *(body.element for body in found.bodies.values())]
    valid = {name for body in others if body.tag == "body" and (name := body.get("name"))}
    for name in document.robots:
        if name not in names:
            raise unknown_name("body that a robot begins with", name, {*valid, NOBODY})


def _beginning(robots: Iterable[Element], document: Document) -> Iterator[str]:
    """Names that bodies of robots have in the scene."""
    for robot in robots:
        part = brought(robot, document, ()) if robot.tag == ATTACH else None
        if part is None:
            yield robot.get("name", "")
            continue
        for body in part.content.iter("body"):
            yield part.prefix + body.get("name", "")
