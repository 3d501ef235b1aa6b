"""Roles of a document's elements: objects, surfaces, fixtures and robots."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from palpate.common.errors import InputError, unknown_name
from palpate.mjcf.document import (
    ATTACH,
    AttachedPart,
    Document,
    Element,
    children,
    elements,
    find_attached,
    label,
    prefix,
)
from palpate.mjcf.elements import (
    TRANSPARENT,
    Defaults,
    Elements,
    Role,
    carrying,
    colliding,
    copy_mark,
    has_joint,
    hinged_by,
    inertial_of,
    is_free,
    iter_children,
    meets_hand,
)

NO_ROBOT = "none"  # Stated in place of a body's name for a scene without a robot
# Words of a body's name that identify the end of an arm.
HANDS = frozenset({"hand", "gripper", "finger", "fingers"})


@dataclass(frozen=True, slots=True, eq=False)
class Robots:
    """Evidence that distinguishes robots from furniture."""

    named: tuple[str, ...]  # root bodies of robots as named by the user; only these are robots then
    driven: frozenset[str]  # names of joints, sites and bodies that an actuator drives
    defaults: Defaults

    def is_robot_root(self, body: Element) -> bool:
        """Test if a body is the root of a robot: it has the robot's first joint, or is the fixed base of the
        body with that joint.
        """
        if self.named:
            return body.get("name") in self.named
        if has_joint(body):
            return self._is_robot(body)
        moving = (c for c in iter_children(body) if c.tag == "body" and has_joint(c))
        return any(self._is_robot(child) for child in moving)

    def select_attached(self, prefix: str, root: Element) -> Robots:
        """Return the evidence for the robots of an attached model, `root`, whose names get a prefix in the scene."""
        # Names of the user that belong to the attached model, without its prefix.
        named = [name.removeprefix(prefix) for name in self.named if name.startswith(prefix)]
        if self.named and not named:
            named = [NO_ROBOT]
        return Robots(tuple(named), find_driven_names(root), self.defaults)

    def _is_robot(self, body: Element) -> bool:
        """Test if a body with joints is a robot: an actuator drives a part of it, or it ends in a hand and is
        not free.
        """
        # An actuator on any part identifies a robot.
        parts = [part for part in elements(body) if part.tag in ("joint", "site", "body")]
        if any(part.get("name") in self.driven for part in parts):
            # A drone is driven as a whole, by its site, and has only a free joint.
            return any(part.tag == "joint" for part in parts)
        words: set[str] = set()
        for part in parts:
            if part.tag == "body":  # whole words: a `handle` is no hand
                words |= set(re.findall(r"[A-Z]?[a-z]+|[A-Z]+", part.get("name") or ""))
        ends_in_hand = not HANDS.isdisjoint(word.lower() for word in words)
        return ends_in_hand and not is_free(body, self.defaults)


def find_driven_names(root: Element) -> frozenset[str]:
    """Return the names of joints, sites and bodies that an actuator drives, directly or by tendons."""

    def referenced_names(element: Element, *attributes: str) -> set[str]:
        return {str(value) for key, value in element.items() if key in attributes}

    names: set[str] = set()
    tendons: set[str] = set()
    # Transmissions of the actuators, and the tendons that they drive.
    for section in root.iterfind("actuator"):
        for actuator in children(section):
            names |= referenced_names(
                actuator, "joint", "jointinparent", "site", "body", "cranksite"
            )
            tendons |= referenced_names(actuator, "tendon")
    # Joints and sites along the driven tendons.
    for section in root.iterfind("tendon"):
        for tendon in children(section):
            if tendon.get("name") in tendons:
                for part in children(tendon):
                    names |= referenced_names(part, "joint", "site")
    return frozenset(names)


# Roles of a document's elements: objects, surfaces, fixtures and robots.


FLOOR = "floor"  # Name of a plane without a name


@dataclass(slots=True, eq=False)
class Roles:
    """Roles of the bodies in a document, in its order.

    Attributes:
        root: the scene's root element.
        robots: root bodies of robots, or the `<attach>` elements that bring them.
        ignored: bodies with other joints, which are neither robot nor object.
        untouchable: free or hinged bodies that a hand cannot touch, with the reason.
        replicated: free bodies whose parts `<replicate>` or `<attach>` copies, so that one element
            becomes many shapes.
        attached: parts of attached models.
        copied: `<attach>` elements whose content is already in the scene, where values are written.
    """

    root: Element
    defaults: Defaults
    bodies: dict[str, Elements] = field(default_factory=dict[str, Elements])
    robots: list[Element] = field(default_factory=list[Element])
    ignored: list[Element] = field(default_factory=list[Element])
    untouchable: dict[Element, str] = field(default_factory=dict[Element, str])
    replicated: list[Element] = field(default_factory=list[Element])
    attached: list[AttachedPart] = field(default_factory=list[AttachedPart])
    copied: list[Element] = field(default_factory=list[Element])

    @property
    def objects(self) -> dict[str, Elements]:
        return self._of("object")

    @property
    def graspable(self) -> dict[str, Elements]:
        """Objects, and fixtures by their handles, by name."""
        return self.objects | self._of("fixture")

    @property
    def surfaces(self) -> dict[str, Elements]:
        """Candidates for surfaces, by name."""
        return self._of("surface")

    def _of(self, role: Role) -> dict[str, Elements]:
        return {name: body for name, body in self.bodies.items() if body.role == role}

    def compiled_name(self, element: Element, own: str) -> str | None:
        """Return the compiled name of an element called `own`; None if it is in no model."""
        # Find the attached part that contains the element.
        contents = {part.content: part for part in self.attached}
        outers = (element, *element.iterancestors()) if contents else ()
        part = next((contents[outer] for outer in outers if outer in contents), None)
        if part is None and element.getroottree().getroot() is not self.root:
            return None
        return compiled_name(element, own, () if part is None else part.attachments)


def compiled_name(element: Element, own: str, attachments: Sequence[Element]) -> str:
    """Return the compiled name of an element called `own` that the `<attach>` elements `attachments` bring."""
    marks = [copy_mark(part) for part in (element, *reversed(attachments))]
    return prefix(attachments) + own + "".join(marks)


def find_roles(document: Document) -> Roles:
    """Sort the bodies and geoms of a document into objects, surfaces and robots.

    Raises InputError: a name used twice, a surface with several geoms of unknown height, or a missing robot.
    """
    # Defaults of all models, and evidence for the robots of the main one.
    attached = [model.root for model in document.attached().values()]
    roles = Roles(document.root, Defaults(document.root, *attached))
    robots = Robots(document.robots, find_driven_names(document.root), roles.defaults)
    for world in document.root.iterfind("worldbody"):
        _walk(world, roles, _Model(document, robots), world=True)
    _require_named_robots(document, roles)
    return roles


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The model whose elements are sorted."""

    document: Document
    robots: Robots  # evidence of its robots
    attachments: tuple[Element, ...] = ()  # the `<attach>` elements that bring it

    def resolve(self, attach: Element) -> AttachedPart | None:
        """Return the content of an `<attach>`."""
        return find_attached(attach, self.document, self.attachments)

    def iter_attached(self, element: Element) -> Iterator[AttachedPart]:
        """Yield the attached content below an element."""
        for attach in element.iter(ATTACH):
            part = self.resolve(attach)
            if part is not None:
                yield part

    def inside(self, part: AttachedPart) -> _Model:
        """Return the model that an attached part comes from."""
        robots = self.robots.select_attached(
            part.attachments[-1].get("prefix") or "", part.model.root
        )
        return _Model(part.model, robots, part.attachments)


def _walk(parent: Element, roles: Roles, model: _Model, world: bool) -> None:
    """Sort the children of an element; `world` is True if they are fixed in the world without a named body."""
    for child in children(parent):
        if child.tag in TRANSPARENT:
            _walk(child, roles, model, world)
        elif child.tag == "geom" and world:
            # Most models include a plane without a name as the ground; the first of them is the floor.
            is_plane = roles.defaults.attribute(child, "type") == "plane"
            if child.get("name") or (is_plane and FLOOR not in roles.bodies):
                _add_surface(child, (child,), roles, model)
        elif child.tag == "body":
            _sort_body(child, roles, model)
        # Attached content is a robot, a copy of present content, or new content.
        elif child.tag == ATTACH and (part := model.resolve(child)) is not None:
            if _holds_robot(part, model):
                roles.robots.append(child)
            elif _shares_elements(part, roles):
                roles.copied.append(child)
            else:
                roles.attached.append(part)
                if part.content.tag == "body":
                    _sort_body(part.content, roles, model.inside(part))
                else:
                    _walk(part.content, roles, model.inside(part), world)


def _sort_body(body: Element, roles: Roles, model: _Model) -> None:
    if model.robots.is_robot_root(body):
        roles.robots.append(body)
    elif is_free(body, roles.defaults):
        # A value can be written only if one element becomes one part of the scene.
        if _has_copies(body, roles, model):
            roles.replicated.append(body)
        else:
            _add_object(body, roles, model)
    elif not has_joint(body):  # fixed in the world: it may carry objects
        if body.get("name") and body.get("mocap") != "true":
            _add_surface(
                body,
                tuple(child for child in iter_children(body) if child.tag == "geom"),
                roles,
                model,
            )
        _walk(body, roles, model, world=not body.get("name"))
    elif body.get("name") and (joint := hinged_by(body, roles.defaults)) is not None:
        _add_fixture(body, joint, roles, model)
    else:
        roles.ignored.append(body)


def _add_object(body: Element, roles: Roles, model: _Model) -> None:
    # Geoms and bodies of the object, including attached content.
    all_parts = list(_parts(body, roles, model))
    geoms = tuple(part for part in all_parts if part.tag == "geom")
    if _is_untouchable(body, geoms, roles):
        return
    own = body.get("name") or _name_body(body, geoms[0], roles, model)
    parts = tuple(part for part in all_parts if part.tag == "body" and part is not body)
    _register("object", body, own, geoms, roles, model, parts=parts)


def _add_surface(element: Element, geoms: tuple[Element, ...], roles: Roles, model: _Model) -> None:
    # Only geoms that can collide make a surface.
    tops = carrying(element, colliding(geoms, roles.defaults), roles.defaults)
    if tops:
        _register("surface", element, element.get("name") or FLOOR, tops, roles, model)


def _add_fixture(body: Element, joint: Element, roles: Roles, model: _Model) -> None:
    # Fixtures of attached models are not supported.
    geoms = tuple(body.iter("geom"))
    if not geoms or body.getroottree().getroot() is not roles.root:
        roles.ignored.append(body)
        return
    if not _is_untouchable(body, geoms, roles):
        _register("fixture", body, body.get("name", ""), geoms, roles, model, joint=joint)


def _is_untouchable(body: Element, geoms: tuple[Element, ...], roles: Roles) -> bool:
    """Test if a hand cannot touch a body, and record the reason."""
    if any(meets_hand(geom, roles.defaults) for geom in geoms):
        return False
    masks = "no geom of it collides with the hand: give one contype and conaffinity 1, the default"
    roles.untouchable[body] = masks if geoms else "it has no geom"
    return True


def _register(
    role: Role,
    element: Element,
    own: str,
    geoms: tuple[Element, ...],
    roles: Roles,
    model: _Model,
    parts: tuple[Element, ...] = (),
    joint: Element | None = None,
) -> None:
    """Add a body, called `own` in its model, under its compiled name."""
    name = compiled_name(element, own, model.attachments)
    if name in roles.bodies:
        raise InputError(
            f"two bodies are called '{name[:80]}' ({label(element)} is the second); give each its own name"
        )
    roles.bodies[name] = Elements(
        name,
        role,
        element,
        geoms,
        colliding(geoms, roles.defaults),
        None if role == "surface" else inertial_of(element),
        roles.defaults,
        parts,
        model.attachments,
        joint,
    )


def _parts(body: Element, roles: Roles, model: _Model) -> Iterator[Element]:
    """Yield an object's elements, including those that it attaches."""
    for element in elements(body):
        yield element
        part = model.resolve(element) if element.tag == ATTACH else None
        if part is not None:
            roles.attached.append(part)
            yield from _parts(part.content, roles, model.inside(part))


def _name_body(body: Element, geom: Element, roles: Roles, model: _Model) -> str:
    """Name a body after its geom, mesh or shape, also in the tree, so that compiled models have the name."""
    # The name is that of the geom, of its mesh, or of its shape, with a number if it is taken.
    shape = roles.defaults.attribute(geom, "type") or "sphere"
    stem = geom.get("name") or roles.defaults.attribute(geom, "mesh") or shape
    taken = {e.get("name") for e in elements(body.getroottree().getroot()) if e.tag == "body"}
    name, count = stem, 1
    while name in taken or prefix(model.attachments) + name in roles.bodies:
        count += 1
        name = f"{stem}_{count}"
    body.set("name", name)
    return name


def _shares_elements(part: AttachedPart, roles: Roles) -> bool:
    """Test if an attached part shares elements with another part of the scene."""
    return part.is_own or any(part.overlaps(other) for other in roles.attached)


def _holds_robot(part: AttachedPart, model: _Model) -> bool:
    """Test if an attached part, or content that it attaches, has the root of a robot."""
    # Depth-first search through attached content, each part once.
    pending, seen = [(part, model)], list[AttachedPart]()
    while pending:
        part, model = pending.pop()
        inside = model.inside(part)
        if any(inside.robots.is_robot_root(body) for body in part.content.iter("body")):
            return True
        seen.append(part)
        for inner in () if part.is_own else inside.iter_attached(part.content):
            if not any(inner.overlaps(other) for other in seen):
                pending.append((inner, inside))
    return False


def _has_copies(body: Element, roles: Roles, model: _Model) -> bool:
    """Test if one element of a body becomes several parts of the scene."""
    if body.find(".//replicate") is not None:
        return True
    # Attached content that repeats or overlaps is a copy.
    pending = [(part, model) for part in model.iter_attached(body)]
    seen: list[AttachedPart] = []
    while pending:
        part, outer = pending.pop()
        if _shares_elements(part, roles) or any(part.overlaps(other) for other in seen):
            return True
        seen.append(part)
        inside = outer.inside(part)
        pending += [(inner, inside) for inner in inside.iter_attached(part.content)]
    return False


def _require_named_robots(document: Document, roles: Roles) -> None:
    """Require that each robot named by the user is in the scene."""
    # Names of the robots found, and of the other bodies, which are valid choices.
    names = {NO_ROBOT}
    for robot in roles.robots:
        part = find_attached(robot, document, ()) if robot.tag == ATTACH else None
        if part is None:
            names.add(robot.get("name", ""))
        else:
            names |= {part.prefix + body.get("name", "") for body in part.content.iter("body")}
    others = [*roles.ignored, *roles.untouchable, *(body.element for body in roles.bodies.values())]
    valid = {name for body in others if body.tag == "body" and (name := body.get("name"))}
    for name in document.robots:
        if name not in names:
            raise unknown_name("robot body", name, {*valid, NO_ROBOT})
