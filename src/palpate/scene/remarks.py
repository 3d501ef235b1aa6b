"""Remarks on a scene: contradictions, interpretations and omissions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import replace

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.mjcf.compile import BASE_SITE, count_removed
from palpate.mjcf.contacts import find_constraint, standing_contacts
from palpate.mjcf.document import Element, compiler_settings, has_unknown, label, tokens
from palpate.mjcf.elements import copy_mark
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import require_physics
from palpate.scene.describe import AN_OBJECT
from palpate.scene.places import reachable
from palpate.scene.resolve import ResolvedScene
from palpate.scene.scene import Scene
from palpate.trace.samples import STANDARD_GRAVITY

# m, least penetration of overlapping bodies. Stated poses have about this accuracy, and MuJoCo's
# contacts at rest are less deep.
DEEP = 0.003
# m, largest distance at which an object is at its place in a keyframe, or on the top below it.
MOVED = 0.001
TURNED = 0.01  # rad, largest turn at which an object has its orientation in a keyframe
# Count of numbers in `qpos` by kind of joint; one for all others.
NUMBERS = {"freejoint": 7, "free": 7, "ball": 4}
# Elements that make MuJoCo generate joints that are not in the file.
GENERATED = ("replicate", "attach", "flexcomp", "composite")


def contradictions(scene: ResolvedScene) -> Iterator[str]:
    """Yield a sentence for each contradiction, with its remedy."""
    # A total mass rescales all masses, the measured ones included.
    total = compiler_settings(scene.document.root).get("settotalmass", "")
    if total and not total.strip().startswith("-"):
        yield (
            f'<compiler settotalmass="{total}"> scales every mass, so a measured mass cannot be written; '
            "remove it."
        )
    # Bodies that no plan may touch.
    for untouchable, reason in scene.description.roles.untouchable.items():
        called = untouchable.get("name")
        shown = f"'{called}'" if called else label(untouchable)
        yield f"{shown} is not measured: {reason}."
    # Keyframes that place objects elsewhere, and bodies inside each other.
    for key, names in placed_by_keyframes(scene).items():
        listed = ", ".join(f"'{name}'" for name in names)
        yield (
            f"The keyframe '{key}' moves or turns {listed} away from the file's pos. Keyframes are not "
            "read: write the poses into pos and quat, or give them by --poses."
        )
    for sentence in overlaps(scene).values():
        yield f"{sentence}."
    for name, body in scene.description.bodies.items():
        # An open z is resolved by the top of the body below.
        if body.role == "object" and _has_open_z(scene, name):
            placed = replace(body, shapes=scene.shapes)
            for other in (replace(other, shapes=scene.shapes) for other in body.objects()):
                gap = abs(other.top_z - placed.bottom_z)
                if gap < MOVED and other.reaches_over(placed.footing()):
                    yield f"The z of '{name}' is `?`: it is assumed to be on '{other.name}', whose z is written."


def overlap_of(scene: ResolvedScene, name: str) -> str:
    """Sentence on the deepest overlap of a body; empty without one."""
    return next((sentence for pair, sentence in overlaps(scene).items() if name in pair), "")


def overlaps(scene: ResolvedScene) -> dict[tuple[str, str], str]:
    """Describe overlaps of objects with other bodies by MuJoCo's contacts, the deepest first, by both names."""
    model, data = scene.shapes.model, mujoco.MjData(scene.shapes.model)
    mujoco.mj_fwdPosition(model, data)
    bodies, ids = scene.description.bodies, scene.shapes.geom_ids
    owners = {ids[geom]: name for name, body in bodies.items() for geom in body.elements.geoms}
    objects = [name for name, body in bodies.items() if body.role == "object"]
    geoms: list[list[int]] = data.contact.geom.reshape(-1, 2).tolist()
    remarks: dict[tuple[str, str], str] = {}
    for depth, pair in sorted(zip((-data.contact.dist).tolist(), geoms, strict=True), reverse=True):
        names = [owners.get(geom) or model.body(model.geom_bodyid[geom]).name for geom in pair]
        # One sentence for each pair, with the object first.
        first, second = sorted(names, key=lambda name: name not in objects)
        if depth < DEEP or first == second or first not in objects or (first, second) in remarks:
            continue
        remedy = "correct the pos of one of them"
        if _has_open_z(scene, first) or _has_open_z(scene, second):
            remedy = (
                "a body with z `?` is placed on the surface below it, or on an object there whose z is "
                "written; write the z of the lower body"
            )
        remarks[first, second] = (
            f"'{first}' and '{second}' overlap by {1e3 * depth:.0f} mm in the scene: {remedy}"
        )
    return remarks


def placed_by_keyframes(scene: ResolvedScene) -> dict[str, list[str]]:
    """Find the objects that a keyframe moves or turns away from their pose, by the keyframe's name.

    The result is empty for a file with `GENERATED` joints, whose order in `qpos` is unknown.
    Raises InputError: a keyframe's `qpos` has no numbers, or another count than the joints.
    """
    root, defaults = scene.document.root, scene.description.roles.defaults
    # Start of each joint's numbers in qpos: MuJoCo counts the joints in the order of the file.
    starts: dict[Element, int] = {}
    at = 0
    for world in root.iterfind("worldbody"):
        for joint in world.iter("joint", "freejoint", *GENERATED):
            if joint.tag in GENERATED:
                return {}
            starts[next(joint.iterancestors("body"), world)] = at
            kind = str(joint.tag) if joint.tag == "freejoint" else defaults.attribute(joint, "type")
            at += NUMBERS.get(kind or "hinge", 1)
    total, names_of = at, dict[str, list[str]]()
    for key in root.iterfind("keyframe/key"):
        try:
            qpos = [float(number) for number in tokens(key.get("qpos"))]
        except ValueError as error:
            raise InputError(f"{label(key)}: qpos: {error}; give numbers") from None
        if qpos and len(qpos) != total:
            raise InputError(
                f"{label(key)}: qpos has {len(qpos)} numbers, the scene's joints {total}; give {total}"
            )
        for name, body in scene.description.bodies.items():
            # Compare the seven numbers of a free joint with the pose of the file.
            at = starts.get(body.elements.element, len(qpos))
            if body.role == "object" and len(qpos) >= at + 7 and any(qpos[at + 3 : at + 7]):
                keyed = Pose.of(qpos[at : at + 3], qpos[at + 3 : at + 7])
                pose = scene.shapes.body_pose(name)
                distance = np.linalg.norm(pose.position - keyed.position)
                if distance > MOVED or pose.angle_to(keyed) > TURNED:
                    names_of.setdefault(key.get("name") or "without a name", []).append(name)
    return names_of


def _has_open_z(scene: ResolvedScene, name: str) -> bool:
    body = scene.description.bodies.get(name)
    return body is not None and has_unknown(body.elements.element, "pos", 2)


# Remarks on the interpretation of a scene, on omissions, and on scenes without unknowns.


LISTED = 8  # Largest number of names in a sentence
OTHER_GRAVITY = 0.01
"""Relative difference from standard gravity that is remarked; on Earth it varies by 0.3 %."""
LARGEST_FRICTION = 3.0
"""Sliding friction of soft rubber on a rough surface."""

SITE = f'<site name="{BASE_SITE}" pos="x y z"/>'  # Element that places the arm in a scene


def remarks(scene: Scene) -> tuple[str, ...]:
    """Sentences that explain the interpretation of the file."""
    parts = (
        _robots,
        _base,
        _others,
        _deviations,
        _physics,
        _unusual_contacts,
        _driven_fixtures,
        _copies,
        _refusal_remarks,
        _contradictions,
        _explain_empty_list,
    )
    return tuple(sentence for part in parts for sentence in part(scene))


def _robots(scene: Scene) -> Iterator[str]:
    roles = scene.resolved.description.roles
    if not roles.robots:
        return
    # Elements elsewhere in the file that refer to the removed robot go as well.
    removed = count_removed(scene.resolved.document, roles)
    listed = ", ".join(f"{number} {tag}" for tag, number in sorted(removed.items()))
    references = f" Its references are removed too: {listed}." if listed else ""
    yield (
        f"Robot removed: {_names(map(_label, roles.robots))}; the {scene.arm.label} replaces it."
        f"{references}"
    )
    # A drawer with a motor looks like a robot.
    driven = [robot for robot in roles.robots if len(list(robot.iter("joint"))) == 1]
    if driven:
        yield (
            f"An actuator drives the only joint of {_names(map(_label, driven))}: if it is furniture, keep it by "
            "--robot-body none."
        )


def _base(scene: Scene) -> Iterator[str]:
    """Yield remarks on an arm's base that is not stated, or too far from objects."""
    # Without a site, the base is that of the scene's own robot, or the origin.
    robots = scene.resolved.description.roles.robots
    no_site = scene.resolved.document.root.find(f".//site[@name='{BASE_SITE}']") is None
    if no_site and not robots:
        yield (
            f"There is no site '{BASE_SITE}' and no robot: the arm's base is assumed at the origin. "
            f"If it is elsewhere, add {SITE} to the worldbody."
        )
    # Objects out of reach are often a sign of a wrong base.
    far: list[str] = []
    for name, body in scene.objects.items():
        spot = body.pose_world.position[None, :2]
        if not reachable(scene.arm.reach, spot, body.top_z(), scene.pose_world_base)[0]:
            far.append(name)
    if far:
        x, y, z = scene.pose_world_base.position
        advice = f"move the site '{BASE_SITE}'"
        if no_site:
            advice = f"place it with {SITE} in the worldbody"
        yield (
            f"Out of reach of the arm at ({x:.2f}, {y:.2f}, {z:.2f}) m: "
            f"{_names(map(_quote, far))}. If the arm is elsewhere, {advice}."
        )


def _others(scene: Scene) -> Iterator[str]:
    """Yield remarks on bodies that are neither objects nor surfaces."""
    roles = scene.resolved.description.roles
    # Bodies with other joints than a free one: one may be a robot.
    if roles.ignored:
        advice = ""
        if not roles.robots:
            advice = " If one of them is a robot, give --robot-body NAME."
        yield (
            "Ignored, because of joints that are not free: "
            f"{_names(map(_label, roles.ignored))}. {_sentence(AN_OBJECT)}{advice}"
        )
    # Models that are attached several times share one text.
    copies: list[str] = []
    for attach in roles.copied:
        content = attach.get("body") or attach.get("frame") or attach.get("model") or ""
        copies.append(f"'{attach.get('prefix') or ''}{content}'")
    if copies:
        yield (
            "A file attached more than once states one set of values, measured at the first copy: not at "
            f"{_names(copies)}. If a copy differs, give it its own file."
        )


def _deviations(scene: Scene) -> Iterator[str]:
    """Yield remarks on deviations from the file."""
    description = scene.resolved.description
    document = description.document
    if document.folder is not None and document.home not in (None, document.folder.resolve()):
        yield f"The scene's {len(document.files)} files are read from below '{document.home}'."
    for name in scene.objects:
        if reason := scene.catalogue["mass"].overruled(description.bodies[name]):
            yield f"A measurement of '{name}' in the hand would be wrong: {reason}."
    if description.lowered:
        yield (f"Lowered onto the support just below: {_names(map(_quote, description.lowered))}.")


def _physics(scene: Scene) -> Iterator[str]:
    """Yield remarks on options that change gravity, contacts or masses."""
    model, settings = scene.resolved.shapes.model, compiler_settings(scene.resolved.document.root)
    try:
        require_physics(model.opt)
    except InputError as error:
        yield f"No run in this scene as a world, and none in its twin: {error}."
    pull = float(np.linalg.norm(model.opt.gravity))
    if pull > 0.0 and abs(pull / STANDARD_GRAVITY - 1.0) > OTHER_GRAVITY:
        yield (
            f"<option gravity> is {pull:.4g} m/s², not {STANDARD_GRAVITY:.4g}: every mass is a weight "
            "divided by it, on a real arm as well."
        )
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        yield (
            '<flag override="enable"/>: o_margin, o_solref, o_solimp and o_friction act in every contact. '
            "Friction and stiffness of a body have no effect, are not measured alone, and cannot be stated."
        )
    # Bodies whose mass or inertia the compiler raised to the bound.
    for setting, values in (("boundmass", model.body_mass), ("boundinertia", model.body_inertia)):
        bound = float(settings.get(setting, 0.0))
        raised = np.isclose(np.reshape(values, (model.nbody, -1)).min(axis=1), bound, rtol=1e-9)
        names = [f"'{model.body(i).name}'" for i in np.flatnonzero(raised[1:] & (bound > 0.0)) + 1]
        if bound > 0.0:
            yield (
                f'<compiler {setting}="{bound:g}"> raises smaller values'
                f"{f', as of {_names(names)}' * bool(names)}: the raised ones act and are measured, and a "
                "smaller one cannot be stated."
            )


def _unusual_contacts(scene: Scene) -> Iterator[str]:
    """Yield remarks on objects that nothing carries, and on impossible friction."""
    shapes, bodies = scene.resolved.shapes, scene.resolved.description.bodies
    # The first variant of the model in which MuJoCo finds a support names the cause: none, exclusion, bits.
    colliding, included = copy(shapes.model), copy(shapes.model)
    included.exclude_signature[:] = colliding.exclude_signature[:] = 0
    for types, affinities in (
        (colliding.geom_contype, colliding.geom_conaffinity),
        (colliding.body_contype, colliding.body_conaffinity),
    ):
        types[:] = affinities[:] = (types | affinities) != 0
    falls = "passes through what it stands on: {}. It falls, and no contact there is measured"
    variants = {
        "": shapes.model,
        falls.format("<exclude>"): included,
        falls.format("their contype and conaffinity share no bit"): colliding,
    }
    above = f"stands on nothing within {1e3 * RESTING:.0f} mm: it falls. Correct its pos"
    flags = (mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    collides = not any(shapes.model.opt.disableflags & int(flag) for flag in flags)
    for name in scene.objects if collides else ():
        tries = ((reason, replace(shapes, model=model)) for reason, model in variants.items())
        placed = ((reason, replace(bodies[name], shapes=variant)) for reason, variant in tries)
        reason = next(
            (reason for reason, body in placed if find_constraint(body) or standing_contacts(body)),
            above,
        )
        if reason:
            yield f"'{name}' {reason}."
    for name, body in bodies.items():
        ids = [shapes.geom_ids[geom] for geom in body.elements.colliding]
        for sliding in np.unique(shapes.model.geom_friction[ids, 0]).tolist():
            if not 0.0 <= sliding <= LARGEST_FRICTION:
                yield (
                    f"The friction of '{name}' is {sliding:g}, and materials have 0 to {LARGEST_FRICTION:g}. "
                    "MuJoCo lets the larger one of a contact act."
                )


def _driven_fixtures(scene: Scene) -> Iterator[str]:
    """Yield remarks on fixtures that another constraint or force than their own joint holds or moves."""
    shapes, bodies = scene.resolved.shapes, scene.resolved.description.bodies
    model = shapes.model
    for name in [name for name, body in bodies.items() if body.role == "fixture"]:
        joint = int(model.body(name).jntadr[0])
        ties = (model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0
        drives = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
        acting = {
            "<equality> of its joint": ties
            & ((model.eq_obj1id == joint) | (model.eq_obj2id == joint)),
            "<equality> that ties it": np.array(
                [find_constraint(replace(bodies[name], shapes=shapes)) != ""]
            ),
            "<actuator>": drives & (model.actuator_trnid[:, 0] == joint),
            "gravcomp": model.body_gravcomp[[model.body(name).id]] != 0.0,
        }
        if reasons := ", ".join(reason for reason, acts in acting.items() if acts.any()):
            yield (
                f"More than its own joint acts on '{name}': {reasons}. What is measured of its friction, damping "
                "and spring contains that."
            )


def _copies(scene: Scene) -> Iterator[str]:
    """Yield remarks on copies by `<replicate>`."""
    description = scene.resolved.description
    copied: list[str] = []
    for name, body in description.bodies.items():
        # Copies of a body share the text that states their values.
        if any(copy_mark(part) for part in (body.elements.element, *body.elements.attachments)):
            copied.append(name)
    if copied:
        yield (
            "Of the copies made by <replicate>, the first represents all: "
            f"{_names(map(_quote, copied))}."
        )
    if description.roles.replicated:
        yield (
            "Not objects, because one element in <replicate> makes several parts: "
            f"{_names(map(_label, description.roles.replicated))}."
        )


def _refusal_remarks(scene: Scene) -> Iterator[str]:
    refused = scene.resolved.description.refused
    if refused:
        reasons = [f"'{name}' ({reason})" for name, reason in refused.items()]
        yield f"Static but not a surface: {_names(reasons)}. {_sentence(AN_OBJECT)}"


def _contradictions(scene: Scene) -> Iterator[str]:
    return contradictions(scene.resolved)


def _explain_empty_list(scene: Scene) -> Iterator[str]:
    # The reasons for an empty list of missing parameters.
    if not scene.objects:
        yield f"There is no object. {_sentence(AN_OBJECT)}"
    if not scene.surfaces:
        yield "There is no surface: no static body has a name and a level top."
    if scene.bodies and not scene.missing and not scene.resolved.description.roles.untouchable:
        yield (
            "No value is missing, so there is nothing to measure by default. Write `?` for a value to "
            "measure, or request a stated one with --remeasure."
        )


def _names(names: Iterable[str]) -> str:
    """The first names with commas, and the number of the others."""
    listed = list(names)
    shown = ", ".join(listed[:LISTED])
    return shown if len(listed) <= LISTED else f"{shown} and {len(listed) - LISTED} more"


def _sentence(clause: str) -> str:
    return f"{clause[0].upper()}{clause[1:]}."


def _quote(name: str) -> str:
    return f"'{name}'"


def _label(body: Element) -> str:
    name = body.get("name") or body.get("model")
    return _quote(name) if name else f"a body in line {body.sourceline}"
