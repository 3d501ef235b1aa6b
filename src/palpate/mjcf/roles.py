"""Which quantities of a scene are known, which are missing, and where in the MJCF each has its
place.

Roles: a body with a free joint is an object; a static named body or geom with a level top is a
surface; an articulated body that is actuated (or has six joints or more) is a robot and neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from palpate.errors import InputError
from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import (
    UNKNOWN,
    Document,
    Element,
    children,
    elements,
    has_unknown,
    label,
    tokens,
)

_TRANSPARENT = ("frame",)
_JOINTS = ("joint", "freejoint")
_ROBOT_JOINTS = 6

FLOOR = "floor"
"""What a plane without a name is called."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEntry:
    """An object's elements.

    Attributes:
        geoms: all geoms of its body and what is fixed to it. colliding: those that can touch, else
            all.
        inertial: its `<inertial>`, if any.
        unweighed: geoms that carry the missing mass. frictionless: geoms that lack a friction.
    """

    name: str
    element: Element
    geoms: tuple[Element, ...]
    colliding: tuple[Element, ...]
    inertial: Element | None
    unweighed: tuple[Element, ...]
    missing_friction: tuple[Element, ...]
    missing: frozenset[str]
    assumed: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEntry:
    """A static thing that may carry others.

    Attributes:
        element: its body, or its geom when the geom stands in the worldbody.
        geoms: candidates for the face that carries.
        unknown: which numbers of the height are `?`: `body`, `geom` (positions) and `size`.
    """

    name: str
    element: Element
    geoms: tuple[Element, ...]
    unknown: frozenset[str]

    @property
    def missing(self) -> frozenset[str]:
        """`height`, when one of its numbers is unknown."""
        return frozenset({"height"}) if self.unknown else frozenset()


@dataclass(slots=True, eq=False)
class Inventory:
    """What a document holds, by role, in document order."""

    defaults: Defaults
    objects: dict[str, ObjectEntry] = field(default_factory=dict[str, ObjectEntry])
    surfaces: dict[str, SurfaceEntry] = field(default_factory=dict[str, SurfaceEntry])
    robots: list[Element] = field(default_factory=list[Element])
    order: list[str] = field(default_factory=list[str])


def inventory(document: Document) -> Inventory:
    """Sort the bodies and geoms of a document into objects, surfaces and robots.

    Raises:
        InputError: an object without a name, a name used twice, a `?` where nothing can be
            measured.
    """
    found = Inventory(Defaults(document.root))
    actuated = _actuated_names(document.root)
    for world in document.root.iterfind("worldbody"):
        _walk(world, found, actuated, world=True)
    _refuse_other_unknowns(document, found)
    return found


def _walk(parent: Element, found: Inventory, actuated: frozenset[str], world: bool) -> None:
    for child in children(parent):
        if child.tag in _TRANSPARENT:
            _walk(child, found, actuated, world)
        elif child.tag == "geom" and world and (child.get("name") or _is_floor(child, found)):
            _add_surface(child, (child,), found)
        elif child.tag == "body":
            _sort_body(child, found, actuated)


def _is_floor(geom: Element, found: Inventory) -> bool:
    """Whether it is the plane without a name that most models stand on, the first of them."""
    return found.defaults.attribute(geom, "type") == "plane" and FLOOR not in found.order


def _sort_body(body: Element, found: Inventory, actuated: frozenset[str]) -> None:
    if _is_robot_root(body, actuated):
        found.robots.append(body)
    elif _is_free(body, found.defaults):
        _add_object(body, found)
    elif not any(child.tag in _JOINTS for child in _through_frames(body)):
        if body.get("name") and body.get("mocap") != "true":
            _add_surface(body, _own_geoms(body), found)
        _walk(body, found, actuated, world=not body.get("name"))


def _is_free(body: Element, defaults: Defaults) -> bool:
    return any(
        child.tag == "freejoint"
        or (child.tag == "joint" and defaults.attribute(child, "type") == "free")
        for child in _through_frames(body)
    )


def _is_robot_root(body: Element, actuated: frozenset[str]) -> bool:
    """A driven articulated body, or the fixed base that carries its first joint."""
    if not _is_robot(body, actuated):
        return False
    moving = (body, *(c for c in _through_frames(body) if c.tag == "body"))
    return any(child.tag in _JOINTS for part in moving for child in _through_frames(part))


def _is_robot(body: Element, actuated: frozenset[str]) -> bool:
    joints = [e for e in elements(body) if e.tag == "joint"]
    driven = any(
        e.get("name") in actuated for e in elements(body) if e.tag in ("joint", "site", "body")
    )
    return bool(joints) and (driven or len(joints) >= _ROBOT_JOINTS)


def _actuated_names(root: Element) -> frozenset[str]:
    """Names of joints, sites and bodies that an actuator drives, tendons followed."""
    driven: set[str] = set()
    tendons: set[str] = set()
    for actuator in (a for section in root.iterfind("actuator") for a in children(section)):
        driven |= {
            v for k, v in actuator.items() if k in ("joint", "jointinparent", "site", "body")
        }
        tendons |= {v for k, v in actuator.items() if k == "tendon"}
    for tendon in (t for section in root.iterfind("tendon") for t in children(section)):
        if tendon.get("name") in tendons:
            driven |= {
                v for part in children(tendon) for k, v in part.items() if k in ("joint", "site")
            }
    return frozenset(driven)


def _through_frames(body: Element) -> Iterator[Element]:
    for child in children(body):
        if child.tag in _TRANSPARENT:
            yield from _through_frames(child)
        else:
            yield child


def _own_geoms(body: Element) -> tuple[Element, ...]:
    return tuple(child for child in _through_frames(body) if child.tag == "geom")


def _colliding(geoms: tuple[Element, ...], defaults: Defaults) -> tuple[Element, ...]:
    def touches(geom: Element) -> bool:
        return any(
            (defaults.attribute(geom, mask) or "1").strip() != "0"
            for mask in ("contype", "conaffinity")
        )

    return tuple(geom for geom in geoms if touches(geom)) or geoms


def _add_object(body: Element, found: Inventory) -> None:
    name = body.get("name")
    if not name:
        raise InputError(
            f"{label(body)} has a free joint but no name; name it, so that it can be spoken of"
        )
    geoms = tuple(e for e in elements(body) if e.tag == "geom")
    if not geoms:
        raise InputError(f"object {label(body)} has no geom, so it has no shape to touch")
    colliding = _colliding(geoms, found.defaults)
    inertial = body.find("inertial")
    unweighed = _unweighed(geoms, inertial, found.defaults)
    missing_friction = _missing_friction(colliding, found.defaults)
    missing = {"mass"} if unweighed or _lacks(inertial, "mass") else set[str]()
    missing |= {"friction"} if missing_friction else set[str]()
    missing |= {"com"} if _lacks(inertial, "pos") else set[str]()
    missing |= {"inertia"} if inertial is not None and _inertia_unknown(inertial) else set[str]()
    missing |= {"position"} if has_unknown(body, "pos", 0, 1) else set[str]()
    assumed = frozenset({"com", "inertia"}) if inertial is None else frozenset[str]()
    _register(name, body, found)
    found.objects[name] = ObjectEntry(
        name,
        body,
        geoms,
        colliding,
        inertial,
        unweighed,
        missing_friction,
        frozenset(missing),
        assumed,
    )


def _lacks(inertial: Element | None, attribute: str) -> bool:
    return inertial is not None and (
        inertial.get(attribute) is None or has_unknown(inertial, attribute)
    )


def _inertia_unknown(inertial: Element) -> bool:
    stated = [a for a in ("diaginertia", "fullinertia") if inertial.get(a) is not None]
    return not stated or any(has_unknown(inertial, a) for a in stated)


def _unweighed(
    geoms: tuple[Element, ...], inertial: Element | None, defaults: Defaults
) -> tuple[Element, ...]:
    """Geoms marked `?`; else, when no geom states a mass or density above zero, all that do not
    state zero."""
    if inertial is not None:
        return ()
    stated = {
        geom: [v for a in ("mass", "density") if (v := defaults.attribute(geom, a)) is not None]
        for geom in geoms
    }
    marked = tuple(
        geom for geom, values in stated.items() if any(UNKNOWN in tokens(v) for v in values)
    )
    if marked:
        return marked
    if any(_number(v) > 0 for values in stated.values() for v in values):
        return ()
    return tuple(geom for geom, values in stated.items() if not values)


def _missing_friction(colliding: tuple[Element, ...], defaults: Defaults) -> tuple[Element, ...]:
    stated = {geom: tokens(defaults.attribute(geom, "friction")) for geom in colliding}
    marked = tuple(geom for geom, parts in stated.items() if parts[:1] == [UNKNOWN])
    return marked or (() if any(stated.values()) else colliding)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _add_surface(element: Element, geoms: tuple[Element, ...], found: Inventory) -> None:
    geoms = _colliding(geoms, found.defaults)
    marked = tuple(g for g in geoms if has_unknown(g, "pos", 2) or _size_unknown(g, found.defaults))
    if len(marked) > 1:
        raise InputError(
            f"surface {label(element)} has `?` in several geoms; only one can be its top"
        )
    carrier = marked or geoms
    unknown = {"body"} if element.tag == "body" and has_unknown(element, "pos", 2) else set[str]()
    unknown |= {"geom"} if marked and has_unknown(marked[0], "pos", 2) else set[str]()
    unknown |= {"size"} if marked and _size_unknown(marked[0], found.defaults) else set[str]()
    if not carrier:
        return
    name = element.get("name") or FLOOR
    _register(name, element, found)
    found.surfaces[name] = SurfaceEntry(name, element, carrier, frozenset(unknown))


def half_height_index(geom: Element, defaults: Defaults) -> int | None:
    """Which number of `size` is the half height: box 2, cylinder 1, others None."""
    return {"box": 2, "cylinder": 1}.get(defaults.attribute(geom, "type") or "sphere")


def _size_unknown(geom: Element, defaults: Defaults) -> bool:
    index = half_height_index(geom, defaults)
    return index is not None and has_unknown(geom, "size", index)


def _register(name: str, element: Element, found: Inventory) -> None:
    if name in found.order:
        raise InputError(
            f"two objects or surfaces are called '{name[:80]}' ({label(element)} is the second); "
            "give each its own name"
        )
    found.order.append(name)


def marked(found: Inventory) -> set[tuple[str, str]]:
    """(name, quantity) of everything missing that is written `?`, so that the file does not compile
    without it."""
    parameters: set[tuple[str, str]] = set()
    for thing in found.objects.values():
        stated = {"mass": ("mass", "density"), "friction": ("friction",)}
        for quantity, attributes in stated.items():
            if any(
                UNKNOWN in tokens(found.defaults.attribute(g, a))
                for g in thing.geoms
                for a in attributes
            ):
                parameters.add((thing.name, quantity))
        inertial = {"mass": ("mass",), "com": ("pos",), "inertia": ("diaginertia", "fullinertia")}
        parameters |= {
            (thing.name, q)
            for q, names in inertial.items()
            for a in names
            if has_unknown(thing.inertial, a)
        }
        parameters |= {(thing.name, "position")} & {(thing.name, q) for q in thing.missing}
    parameters |= {
        (surface.name, "height") for surface in found.surfaces.values() if surface.unknown
    }
    return {
        (name, q)
        for name, q in parameters
        if name in found.surfaces or q in found.objects[name].missing
    }


def measurable_slots(found: Inventory) -> set[tuple[Element, str]]:
    """Every (element, attribute) where a `?` stands for something that is measured or follows from
    it."""
    slots: set[tuple[Element, str]] = set()
    for thing in found.objects.values():
        slots |= {(thing.element, "pos")}
        slots |= {(g, a) for g in thing.geoms for a in ("mass", "density", "friction")}
        if thing.inertial is not None:
            slots |= {(thing.inertial, a) for a in ("pos", "mass", "diaginertia", "fullinertia")}
    for surface in found.surfaces.values():
        slots |= {(surface.element, "pos")} | {
            (g, a) for g in surface.geoms for a in ("pos", "size")
        }
    return slots


def _refuse_other_unknowns(document: Document, found: Inventory) -> None:
    slots = measurable_slots(found)
    robot = {e for root in found.robots for e in elements(root)}
    for element in elements(document.root):
        for attribute, value in element.items():
            if (
                UNKNOWN not in tokens(str(value))
                or element in robot
                or (element, attribute) in slots
            ):
                continue
            if attribute == "name" or (
                _in_default(element) and attribute in ("mass", "density", "friction")
            ):
                continue
            raise InputError(
                f'{label(element)}: {attribute}="{str(value)[:60]}" cannot be measured; `?` may stand for an object\'s '
                "mass, density, friction, <inertial> and pos, and for a surface's z in pos or half height in size"
            )
    _refuse_horizontal_unknowns(found)


def _refuse_horizontal_unknowns(found: Inventory) -> None:
    for surface in found.surfaces.values():
        for element in (surface.element, *surface.geoms):
            height = half_height_index(element, found.defaults) if element.tag == "geom" else None
            others = [i for i in range(3) if i != height]
            if has_unknown(element, "pos", 0, 1) or has_unknown(element, "size", *others):
                raise InputError(
                    f"{label(element)}: only the height of a surface can be measured; "
                    "replace the other `?` by numbers"
                )


def _in_default(element: Element) -> bool:
    return next(element.iterancestors("default"), None) is not None
