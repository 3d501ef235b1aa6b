"""The objects and surfaces of a document as it describes them, with the poses that came along."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.bounds import require_bounded
from palpate.mjcf.defaults import INHERITED
from palpate.mjcf.document import UNKNOWN, Document, Element, elements, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot
from palpate.mjcf.roles.elements import Elements
from palpate.mjcf.roles.roles import Roles
from palpate.mjcf.roles.sorting import find_roles
from palpate.mjcf.shapes import RESTING, Shapes, compile_shapes
from palpate.quantities.catalogue import Catalogue
from palpate.scene.places import APPROACH
from palpate.scene.poses import Poses
from palpate.scene.settle import let_down

CARRYING = 0.10
"""m: a static thing narrower than this is a surface only when something stands on it."""

MOUNT = 0.5
"""m: what the arm stands on is its mount, and no surface, when it is smaller than this and carries
nothing else."""

_ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """A document whose elements have their roles and its bodies their geometry.

    Attributes:
        shapes: compiled with stand-ins for everything unknown.
        bodies: objects and surfaces by name, in document order.
        placed: the changes that put bodies where the poses say, and down onto what they hang above.
        lowered: names of the latter.
        refused: what has a name and stands still and is yet no surface, with the reason.
    """

    document: Document
    roles: Roles
    shapes: Shapes
    bodies: dict[str, BodyDescription]
    placed: tuple[Edit, ...]
    lowered: tuple[str, ...]
    refused: dict[str, str]


def describe(
    document: Document, poses: Poses, catalogue: Catalogue, settled: bool = True
) -> Description:
    """Sort a document, take in the poses, and compile it once with stand-ins; `settled`: with objects
    that hang just above their support let down onto it, else exactly as the file has them.

    Raises:
        InputError: a `?` where nothing can be measured, names that do not match, scenes MuJoCo does
            not accept.
    """
    require_bounded(document)
    roles = find_roles(document)
    slots = list(_slots(roles, catalogue))
    _refuse_other_unknowns(document, roles, slots)
    _check_names(poses, roles)
    placed = tuple(_placements(poses, roles))
    edits: list[Edit] = []
    for slot in slots:
        edits += slot.placeholder()
    shapes = compile_shapes(document, roles, [*edits, *placed])
    bodies = _described(roles, shapes, poses)
    lowered = dict(let_down(bodies, shapes)) if settled else {}
    if lowered:
        placed = (*placed, *lowered.values())
        shapes = compile_shapes(document, roles, [*edits, *placed])
        bodies = _described(roles, shapes, poses)
    refused: dict[str, str] = {}
    for name, body in bodies.items():
        if body.role == "surface" and (reason := _no_surface(body)):
            refused[name] = reason
    for name in refused:
        del bodies[name]
    return Description(document, roles, shapes, bodies, placed, tuple(lowered), refused)


def _described(roles: Roles, shapes: Shapes, poses: Poses) -> dict[str, BodyDescription]:
    found: dict[str, BodyDescription] = {}
    for name, body in roles.bodies.items():
        given = poses.objects.get(name)
        approach = poses.places.get(f"{name}_approach")
        found[name] = BodyDescription(
            body,
            shapes,
            found,
            given=None if given is None else given.body_pose(),
            given_top=None if approach is None else approach.pos[2] - APPROACH,
        )
    return found


def _slots(roles: Roles, catalogue: Catalogue) -> Iterator[Slot]:
    for body in roles.bodies.values():
        for quantity in catalogue.of(body.role):
            yield from quantity.slots(body)


def _refuse_other_unknowns(document: Document, roles: Roles, slots: Iterable[Slot]) -> None:
    allowed: dict[tuple[Element, str], list[Slot]] = {}
    for slot in slots:
        allowed.setdefault((slot.element, slot.attribute), []).append(slot)
    robots: set[Element] = set()
    for robot in roles.robots:
        robots.update(elements(robot))
    for element in _all_elements(document, roles):
        if element in robots:
            continue
        for attribute, value in element.items():
            here = allowed.get((element, str(attribute)), [])
            inherited = attribute in INHERITED and _in_default(element)
            if attribute != "name" and not inherited and _is_uncovered(str(value), here):
                raise InputError(
                    f'{label(element)}: {attribute}="{str(value)[:60]}" cannot be measured; '
                    f"{_no_object(element, roles)}`?` may stand for an object's mass, density, "
                    "friction, <inertial>, pos, and size where it is one shape whose z is known; of a "
                    "surface only the height can be measured: z in pos, or half height in size"
                )


def _no_object(element: Element, roles: Roles) -> str:
    """Reason why the body of an element is no object; empty where that is not the reason."""
    for body in (element, *element.iterancestors("body")):
        called = body.get("name") or "its body"
        if body in roles.ignored:
            return (
                f"'{called}' has joints that are not free: with a <freejoint/> in their place it "
                "would be an object; "
            )
        if body in roles.replicated:
            return f"'{called}' has parts that one line makes several of: write each of them; "
        if body.get("mocap") == "true":
            return f"'{called}' is a mocap body, which nothing moves: take mocap away; "
    return ""


def _all_elements(document: Document, roles: Roles) -> Iterator[Element]:
    """All elements of the scene, and of the attached models that are no robots."""
    yield from elements(document.root)
    models = {part.model.root: part.model.root for part in roles.brought}
    for root in models:
        if root is not document.root:
            yield from elements(root)


def _is_uncovered(value: str, slots: list[Slot]) -> bool:
    """True if a `?` stands where no slot is."""
    unknown = {i for i, part in enumerate(tokens(value)) if part == UNKNOWN}
    for slot in slots:
        unknown -= {i for i in unknown if slot.covers(i)}
    return bool(unknown)


def _in_default(element: Element) -> bool:
    return next(element.iterancestors("default"), None) is not None


def _check_names(poses: Poses, roles: Roles) -> None:
    for name in poses.objects:
        if name not in roles.bodies:
            raise unknown_name("object in poses", name, roles.bodies)
    for name in poses.grasps:
        if name not in roles.objects:
            raise unknown_name("object in grasps", name, roles.objects)


def _placements(poses: Poses, roles: Roles) -> Iterator[Edit]:
    """Changes that put bodies where the poses say, but for a z that the file writes `?`."""
    for name, entry in poses.objects.items():
        element = roles.bodies[name].element
        _require_in_world(roles.bodies[name])
        pose = entry.body_pose()
        position = _numbered(pose.position)
        if has_unknown(element, "pos", 2):
            del position[2]
        for attribute in _ORIENTATIONS:
            if element.get(attribute) is not None:
                yield Edit(element, attribute, None)
        yield Edit(element, "pos", position, "0 0 0")
        yield Edit(element, "quat", _numbered(pose.quaternion), "1 0 0 0")


def _numbered(values: Array) -> dict[int, str]:
    """Numbers in full, by their position in an attribute."""
    return {i: repr(value) for i, value in enumerate(values.tolist())}


def _require_in_world(body: Elements) -> None:
    if body.moved_by() is not None or body.element.get("fromto"):
        raise InputError(
            f"{label(body.element)} is not placed by its own pos in the worldbody, so poses cannot "
            "move it"
        )


def _no_surface(body: BodyDescription) -> str:
    """Reason why a body is no surface: a surface has a level top that is wide enough or carries an
    object, and is not just the mount of the arm. Empty if it is one."""
    if body.top_is_open:
        return ""
    if not _is_level(body.shapes, body.carrier):
        return "its top is not level"
    for thing in body.objects():
        if _carries(body, thing.footing()):
            return ""
    extent = (body.cloud.max(axis=0) - body.cloud.min(axis=0))[:2]
    if np.max(extent) < MOUNT and _carries(body, body.shapes.base().position):
        return "the arm stands on it"
    if np.min(extent) < CARRYING:
        return f"it is narrower than {CARRYING:g} m and carries nothing"
    return ""


def _carries(surface: BodyDescription, point: Array) -> bool:
    return surface.reaches_over(point) and bool(abs(point[2] - surface.top_z) < RESTING)


def _is_level(shapes: Shapes, geom: Element) -> bool:
    """True if the geom has a level face on top."""
    kind = int(shapes.model.geom_type[shapes.geom_ids[geom]])
    up = np.abs(shapes.data.geom_xmat[shapes.geom_ids[geom]].reshape(3, 3)[2])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return bool(up.max() > 0.999)
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_PLANE):
        return bool(up[2] > 0.999)
    return kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
