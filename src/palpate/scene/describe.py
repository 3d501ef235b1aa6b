"""Objects and surfaces of a document, and the words that may name them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.pose import Array, Pose
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.bounds import require_limits
from palpate.mjcf.compile import without_robots
from palpate.mjcf.document import UNKNOWN, Document, Element, elements, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Slot
from palpate.mjcf.elements import INHERITED, PLACING, Defaults
from palpate.mjcf.roles import Roles, find_roles
from palpate.mjcf.shapes import RESTING, Shapes, compile_shapes
from palpate.scene.places import APPROACH
from palpate.scene.poses import Poses

_COLOURS = {
    "red": (0.85, 0.1, 0.1),
    "green": (0.1, 0.65, 0.15),
    "blue": (0.1, 0.2, 0.8),
    "yellow": (0.95, 0.85, 0.1),
    "orange": (0.95, 0.5, 0.05),
    "purple": (0.5, 0.1, 0.6),
    "pink": (1.0, 0.55, 0.7),
    "brown": (0.45, 0.28, 0.12),
    "black": (0.05, 0.05, 0.05),
    "white": (0.97, 0.97, 0.97),
    "grey": (0.5, 0.5, 0.5),
    "light blue": (0.55, 0.78, 0.95),
    "light green": (0.6, 0.9, 0.6),
    "dark blue": (0.05, 0.08, 0.4),
    "dark green": (0.03, 0.3, 0.08),
    "dark red": (0.45, 0.03, 0.05),
    "cyan": (0.1, 0.8, 0.85),
    "beige": (0.9, 0.82, 0.65),
}
_SPELLINGS = {"grey": "gray", "purple": "violet"}
_SHAPES = {
    "box": ("box", "block", "cube"),
    "cylinder": ("cylinder", "can"),
    "sphere": ("ball", "sphere"),
    "ellipsoid": ("ellipsoid",),
    "capsule": ("capsule",),
}


def name_words(name: str) -> set[str]:
    """Words of a name: green and bottle of `greenBottle_2`; and the name itself."""
    # Words start at capitals; letters of other scripts make words too, digits do not.
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_a-zA-Z]+", name)
    words = {part.lower() for part in parts}
    return words | {name.lower(), " ".join(part.lower() for part in parts)} - {""}


def body_words(
    name: str, element: Element, geoms: tuple[Element, ...], defaults: Defaults, shapes: bool = True
) -> frozenset[str]:
    """Words for the body or geom `name` with `geoms` and named parts; `shapes` adds `box`, `ball`, …"""
    # Names of all parts, and colours of the geoms.
    words = name_words(name)
    root = element.getroottree().getroot()
    for part in element.iterdescendants("body"):
        words |= name_words(part.get("name") or "")
    for geom in geoms:
        rgb = _rgb(geom, defaults, root)
        if rgb is not None:
            words |= colour_words(rgb)
    # The name and shape of the only geom describe the body.
    if len(geoms) == 1:
        (only,) = geoms
        words |= name_words(only.get("name") or "")
        if shapes:
            words.update(_SHAPES.get(defaults.attribute(only, "type") or "sphere", ()))
    return frozenset(words)


def colour_words(rgb: tuple[float, float, float]) -> set[str]:
    """Words of the nearest basic colour; for `light blue` also `blue`."""

    def distance(name: str) -> float:
        return float(np.linalg.norm(np.array(_COLOURS[name]) - np.array(rgb)))

    nearest = min(_COLOURS, key=distance)
    words = {nearest, nearest.split()[-1]}
    return words | {_SPELLINGS[w] for w in words if w in _SPELLINGS}


def _rgb(geom: Element, defaults: Defaults, root: Element) -> tuple[float, float, float] | None:
    """Colour of a geom, else of its material; None where neither states one."""
    # The geom's own colour takes precedence over that of its material.
    stated = defaults.attribute(geom, "rgba")
    if stated is None:
        name = defaults.attribute(geom, "material")
        for material in root.iterfind("asset/material") if name is not None else ():
            if material.get("name") == name:
                stated = defaults.attribute(material, "rgba")
                break
    try:
        r, g, b = (float(part) for part in tokens(stated)[:3])
    except ValueError:
        return None
    return r, g, b


# Description of a document: objects and surfaces at the poses of poses.yaml.


AN_OBJECT = "an object needs a body with a <freejoint/>, and no other joint"
# Elements with numeric attributes, and their attributes that are not numeric. MuJoCo reads `nan` as
# absent.
PHYSICAL, NAMES = ("geom", "inertial", "joint"), ("name", "class", "mesh", "material", "hfield")
CARRYING = 0.10  # m, least width of an empty surface; a narrower static body must carry an object
# m, size below which the body under the arm is its mount and no surface, if it carries no object.
MOUNT = 0.5
HANGING = 0.001  # m, largest gap between an object and its support at which the object rests on it
SECONDS = 0.5  # s, simulated time in which objects come to rest; a fall of `RESTING` takes 0.06 s
MOST_STEPS = 2_000  # Largest number of steps of that simulation, at any timestep of the scene
# m to the side, and cosine of a turn, that an object may move in that simulation. With a larger
# motion it falls over or rolls, and keeps the file's pose.
ASIDE, UPRIGHT = 0.005, float(np.cos(np.radians(3.0)))


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """A document whose elements have roles and whose bodies have geometry."""

    document: Document
    roles: Roles
    shapes: Shapes  # geometry compiled with placeholders for all unknowns
    bodies: dict[str, BodyDescription]  # objects, surfaces and fixtures by name, in document order
    # Changes that move bodies to the given poses, and down onto their support.
    placed: tuple[Edit, ...]
    lowered: tuple[str, ...]  # names of the lowered bodies
    refused: dict[str, str]  # named static bodies that are no surfaces, with the reason

    def explain_refusal(self, name: str) -> str:
        """Sentence with the reason why a body of the file is not measured; empty for others."""
        # Reasons by name of the body; the request may use a part of the name.
        roles = self.roles
        reasons = {static: f"'{static}' is static; {AN_OBJECT}" for static in self.refused}
        for body in (*roles.ignored, *roles.replicated, *roles.untouchable):
            reasons[body.get("name", "")] = _no_object(body, roles)
        for static, reason in reasons.items():
            if name.replace(" ", "_").lower() in (static.lower(), *static.lower().split("_")):
                return f"{reason}."
        return ""


def describe(
    document: Document, poses: Poses, catalogue: Catalogue, settled: bool = True
) -> Description:
    """Classify a document's bodies, apply the poses, and compile it with placeholders.

    With `settled`, objects just above their support are lowered onto it.

    Raises:
        InputError: too large, a `?` where nothing can be measured, names that do not match, scenes
            that MuJoCo does not accept.
    """
    # Limits of the elements first, then of the loaded files without the robots and textures.
    require_limits(document, loaded=())
    roles = find_roles(document)
    kept = without_robots(document, roles).loaded_elements()
    require_limits(document, loaded={element for element in kept if element.tag != "texture"})
    # Slots are the places where a quantity may be written `?`.
    slots: list[Slot] = []
    for body in roles.bodies.values():
        for quantity in catalogue.of(body.role):
            slots += quantity.slots(body)
    _refuse_other_unknowns(document, roles, slots, catalogue)
    for names, kind, valid in (
        (poses.objects, "object in poses", roles.bodies),
        (poses.grasps, "object in grasps", roles.graspable),
    ):
        for name in names:
            if name not in valid:
                raise unknown_name(kind, name, valid)
    placed = tuple(_placements(poses, roles))
    # With a placeholder for each `?`, the scene compiles before any value is known.
    edits: list[Edit] = []
    for slot in slots:
        edits += slot.placeholder()
    shapes = compile_shapes(document, roles, [*edits, *placed])
    bodies = _describe_bodies(roles, shapes, poses)
    # Lower hanging objects, and compile again if any pose changed.
    lowered = dict(drop_bodies(bodies, shapes)) if settled else {}
    if lowered:
        placed = (*placed, *lowered.values())
        shapes = compile_shapes(document, roles, [*edits, *placed])
        bodies = _describe_bodies(roles, shapes, poses)
    # Static bodies that cannot be surfaces are left out, with the reason.
    refused: dict[str, str] = {}
    for name, body in bodies.items():
        if body.role == "surface" and (reason := _no_surface(body)):
            refused[name] = reason
    for name in refused:
        del bodies[name]
    return Description(
        document=document,
        roles=roles,
        shapes=shapes,
        bodies=bodies,
        placed=placed,
        lowered=tuple(lowered),
        refused=refused,
    )


def _describe_bodies(roles: Roles, shapes: Shapes, poses: Poses) -> dict[str, BodyDescription]:
    bodies: dict[str, BodyDescription] = {}
    for name, body in roles.bodies.items():
        # Poses and tops of poses.yaml take precedence over the file's.
        given = poses.objects.get(name)
        approach = poses.places.get(f"{name}_approach")
        bodies[name] = BodyDescription(
            body,
            shapes,
            bodies,
            given=None if given is None else given.body_pose(),
            given_top=None if approach is None else approach.pos[2] - APPROACH,
        )
    return bodies


def _refuse_other_unknowns(
    document: Document, roles: Roles, slots: Iterable[Slot], catalogue: Catalogue
) -> None:
    """Refuse `nan`, and a `?` outside all slots; in a world, which has an empty catalogue, every `?`."""
    allowed: dict[tuple[Element, str], list[Slot]] = {}
    for slot in slots:
        allowed.setdefault((slot.element, slot.attribute), []).append(slot)
    # Robots are replaced by the arm, so their attributes do not matter.
    robots: set[Element] = set()
    for robot in roles.robots:
        robots.update(elements(robot))
    # Attached models that are robots are not examined.
    roots = dict.fromkeys([document.root, *(part.model.root for part in roles.attached)])
    for element in (element for root in roots for element in elements(root)):
        if element in robots:
            continue
        in_default = next(element.iterancestors("default"), None) is not None
        for key, value in element.items():
            attribute, text = str(key), str(value)
            is_number = element.tag in PHYSICAL and attribute not in NAMES
            if is_number and "nan" in tokens(text.lower()):
                raise InputError(
                    f'{label(element)}: {attribute}="{text[:60]}" is not a number; remove the attribute, or write '
                    "`?` for a value to measure"
                )
            if attribute == "name" or (attribute in INHERITED and in_default and catalogue):
                continue
            # Positions of `?` in the attribute that no slot covers.
            unknown = {i for i, part in enumerate(tokens(text)) if part == UNKNOWN}
            for slot in allowed.get((element, attribute), []) if unknown else ():
                unknown -= {i for i in unknown if slot.covers(i)}
            if unknown and not catalogue:
                raise InputError(
                    f'the world states no value of {label(element)}: {attribute}="{text[:60]}"; a world is simulated '
                    "as MuJoCo compiles it: write a number or remove the attribute. Without a world, unknowns "
                    "of the scene are drawn from priors"
                )
            if unknown:
                reason = _no_object(element, roles)
                raise InputError(
                    f'{label(element)}: {attribute}="{text[:60]}" cannot be measured; '
                    f"{reason}{'; ' * bool(reason)}`?` may stand for an object's mass, density, friction, <inertial>, "
                    "pos, and size if it is one shape whose z is known; for a surface's height: z in pos, or half "
                    "height in size; for damping, frictionloss, stiffness and range of a drawer's or door's joint"
                )


def _no_object(element: Element, roles: Roles) -> str:
    """Reason why the body of an element is no object; empty if it is one."""
    for body in (element, *element.iterancestors("body")):
        called = body.get("name") or "its body"
        if body in roles.ignored:
            return (
                f"'{called}' has joints that are not free: an object has a <freejoint/> instead, a drawer or "
                "door a name and one slide or hinge joint"
            )
        if any(body is part.element and part.role == "fixture" for part in roles.bodies.values()):
            return f"'{called}' slides or turns on a joint: an object has a <freejoint/> instead"
        if body in roles.untouchable:
            return f"'{called}' is not an object: {roles.untouchable[body]}"
        if body in roles.replicated:
            return f"'{called}' has parts that one element copies: write each of them"
        if body.get("mocap") == "true":
            return f"'{called}' is a mocap body, which contacts do not move: remove mocap"
    return ""


def _placements(poses: Poses, roles: Roles) -> Iterator[Edit]:
    """Yield the changes that move bodies to the given poses, except a z that the file writes `?`."""
    for name, entry in poses.objects.items():
        element = roles.bodies[name].element
        if roles.bodies[name].posed_ancestor() is not None or element.get("fromto"):
            raise InputError(
                f"{label(element)} is not placed by its own pos in the worldbody, so poses cannot move it"
            )
        pose = entry.body_pose()
        position = _format_numbers(pose.position)
        if has_unknown(element, "pos", 2):
            del position[2]
        # An orientation in another form would contradict the quat.
        for attribute in sorted(PLACING - {"pos", "quat"}):
            if element.get(attribute) is not None:
                yield Edit(element, attribute, None)
        yield Edit(element, "pos", position, "0 0 0")
        yield Edit(element, "quat", _format_numbers(pose.quaternion), "1 0 0 0")


def _format_numbers(values: Array) -> dict[int, str]:
    """Numbers in full precision, by their position in an attribute."""
    return {i: repr(value) for i, value in enumerate(values.tolist())}


def drop_bodies(
    bodies: Mapping[str, BodyDescription], shapes: Shapes
) -> Iterator[tuple[str, Edit]]:
    """Yield the changes, by name, that lower objects onto a support of known height.

    The objects are less than `RESTING` above it. The new pose is that after a simulated fall, if the
    fall is straight down.
    """
    hanging = [body for body in bodies.values() if _is_floating(body)]
    if not hanging:
        return
    data = mujoco.MjData(shapes.model)
    steps = min(int(SECONDS / shapes.model.opt.timestep), MOST_STEPS)
    mujoco.mj_step(shapes.model, data, steps)
    # All objects fall together, so that stacks settle as a whole.
    for body in hanging:
        before, fallen = shapes.body_pose(body.name), data.body(body.name)
        after = Pose.of(fallen.xpos, fallen.xquat)
        drop = float(before.position[2] - after.position[2])
        aside = float(np.linalg.norm((before.position - after.position)[:2]))
        upright = float(np.abs(before.rotation.T @ after.rotation).diagonal().min())
        # The stated z is lowered by the drop; x, y and orientation stay as stated.
        if 0.0 < drop < 2 * RESTING and aside < ASIDE and upright > UPRIGHT:
            element = body.elements.element
            if body.given is not None:
                stated_z = float(body.given.position[2])
            else:
                stated_z = float(tokens(element.get("pos") or "0 0 0")[2])
            yield body.name, Edit(element, "pos", {2: repr(stated_z - drop)}, "0 0 0")


def _is_floating(body: BodyDescription) -> bool:
    """True if an object has a stated pose in the world's axes, just above a support."""
    if body.role != "object" or body.elements.posed_ancestor() is not None:
        return False
    if has_unknown(body.elements.element, "pos"):
        return False
    # On a surface of open height, the object moves with the measured height.
    below = body.surfaces_below()
    if any(surface.top_is_open for surface in below):
        return False  # its height will be measured, and the object moves with it
    # Gaps to all surfaces and lower objects below.
    gaps = [body.bottom_z - surface.top_z for surface in below]
    foot = body.footing()
    for other in body.objects():
        if other is not body and other.bottom_z < body.bottom_z and other.reaches_over(foot):
            gaps.append(body.bottom_z - other.top_z)
    return bool(gaps) and HANGING < min(gaps, key=abs) < RESTING


def _no_surface(body: BodyDescription) -> str:
    """Reason why a static body is no surface; empty if it is one."""
    # A surface has a level top that is wide enough or carries an object, and is not the arm's
    # mount.
    if body.top_is_open:
        return ""
    ids = [body.shapes.geom_ids[geom] for geom in body.elements.geoms]
    if not (body.shapes.model.geom_contype[ids] | body.shapes.model.geom_conaffinity[ids]).any():
        return "it has no collisions"
    if not _is_level(body.shapes, body.carrier):
        return "its top is not level"
    for item in body.objects():
        if _supports_point(body, item.footing()):
            return ""
    # Without an object on it, the size decides: mounts and narrow bodies are no surfaces.
    extent = (body.cloud.max(axis=0) - body.cloud.min(axis=0))[:2]
    if np.max(extent) < MOUNT and _supports_point(body, body.shapes.base().position):
        return "it is the arm's mount"
    if np.min(extent) < CARRYING:
        return f"it is narrower than {CARRYING:g} m and carries no object"
    return ""


def _supports_point(surface: BodyDescription, point: Array) -> bool:
    return surface.reaches_over(point) and bool(abs(point[2] - surface.top_z) < RESTING)


def _is_level(shapes: Shapes, geom: Element) -> bool:
    """True if the geom has a level top: a level box, an upright cylinder or plane; any mesh or height field."""
    kind = int(shapes.model.geom_type[shapes.geom_ids[geom]])
    up = np.abs(shapes.data.geom_xmat[shapes.geom_ids[geom]].reshape(3, 3)[2])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return bool(up.max() > 0.999)
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_PLANE):
        return bool(up[2] > 0.999)
    return kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
