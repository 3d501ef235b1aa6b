"""Contradictions inside a scene's file, which make measured values wrong or impossible, and their remedies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.mjcf.document import Element, compiler_settings, has_unknown, label, tokens
from palpate.scene.resolve import ResolvedScene

DEEP = 0.003
"""m of penetration from which bodies overlap: stated poses are about as accurate, and MuJoCo's contacts at
rest are less deep."""
MOVED = 0.001
"""m: an object nearer to its place in a keyframe, or to the top below it, is there."""
TURNED = 0.01
"""rad: an object turned less from its orientation in a keyframe has it."""
NUMBERS = {"freejoint": 7, "free": 7, "ball": 4}
"""Numbers in `qpos` of a joint, by its kind; one for the others."""
GENERATED = ("replicate", "attach", "flexcomp", "composite")
"""Elements from which MuJoCo makes joints that are not in the file."""


def contradictions(scene: ResolvedScene) -> Iterator[str]:
    """Yield a sentence for each contradiction, with its remedy."""
    total = compiler_settings(scene.document.root).get("settotalmass", "")
    if total and not total.strip().startswith("-"):
        yield (
            f'<compiler settotalmass="{total}"> scales every mass: no mass acts as it '
            "is written, and a measured one cannot be stated; remove it."
        )
    for untouchable, reason in scene.description.roles.untouchable.items():
        called = untouchable.get("name")
        shown = f"'{called}'" if called else label(untouchable)
        yield f"Nothing is measured of {shown}: {reason}."
    for key, names in placed_by_keyframes(scene).items():
        listed = ", ".join(f"'{name}'" for name in names)
        yield (
            f"The keyframe '{key}' places {listed} elsewhere than the file's pos, or turned. Keyframes are not "
            "read: write the places into pos and quat, or give them by --poses."
        )
    for sentence in overlaps(scene).values():
        yield f"{sentence}."
    for name, body in scene.description.bodies.items():
        if body.role == "object" and _has_open_z(scene, name):
            placed = replace(body, shapes=scene.shapes)
            for other in (replace(other, shapes=scene.shapes) for other in body.objects()):
                apart = abs(other.top_z - placed.bottom_z)
                if apart < MOVED and other.reaches_over(placed.footing()):
                    yield f"The z of '{name}' is `?`: it is taken to stand on '{other.name}', whose z is written."


def overlap_of(scene: ResolvedScene, name: str) -> str:
    """Sentence on the deepest overlap of a body; empty without one."""
    return next((sentence for pair, sentence in overlaps(scene).items() if name in pair), "")


def overlaps(scene: ResolvedScene) -> dict[tuple[str, str], str]:
    """Describe each object that is inside another body, the deepest first, by the names of object and body."""
    model, data = scene.shapes.model, mujoco.MjData(scene.shapes.model)
    mujoco.mj_fwdPosition(model, data)
    bodies, ids = scene.description.bodies, scene.shapes.geom_ids
    owners = {ids[geom]: name for name, body in bodies.items() for geom in body.elements.geoms}
    objects = [name for name, body in bodies.items() if body.role == "object"]
    geoms: list[list[int]] = data.contact.geom.reshape(-1, 2).tolist()
    found: dict[tuple[str, str], str] = {}
    for depth, pair in sorted(zip((-data.contact.dist).tolist(), geoms, strict=True), reverse=True):
        names = [owners.get(geom) or model.body(model.geom_bodyid[geom]).name for geom in pair]
        first, second = sorted(names, key=lambda name: name not in objects)
        if depth < DEEP or first == second or first not in objects or (first, second) in found:
            continue
        remedy = "correct the pos of one of them"
        if _has_open_z(scene, first) or _has_open_z(scene, second):
            remedy = (
                "one whose z is `?` stands on the surface below it, or on an object there whose z is "
                "written; write the z of the lower one"
            )
        found[first, second] = (
            f"'{first}' and '{second}' overlap by {1e3 * depth:.0f} mm where the scene has them: {remedy}"
        )
    return found


def placed_by_keyframes(scene: ResolvedScene) -> dict[str, list[str]]:
    """Find the objects that a keyframe places elsewhere than their pos or turns, by the keyframe's name. None
    is found in a file with `GENERATED` joints.

    Raises:
        InputError: a keyframe's `qpos` is no numbers, or not as many as the joints have.
    """
    root, defaults = scene.document.root, scene.description.roles.defaults
    # Each joint's place in qpos: MuJoCo counts the joints in the order of the file.
    starts: dict[Element, int] = {}
    at = 0
    for world in root.iterfind("worldbody"):
        for joint in world.iter("joint", "freejoint", *GENERATED):
            if joint.tag in GENERATED:
                return {}
            starts[next(joint.iterancestors("body"), world)] = at
            kind = str(joint.tag) if joint.tag == "freejoint" else defaults.attribute(joint, "type")
            at += NUMBERS.get(kind or "hinge", 1)
    total, found = at, dict[str, list[str]]()
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
            at = starts.get(body.elements.element, len(qpos))
            if body.role == "object" and len(qpos) >= at + 7 and any(qpos[at + 3 : at + 7]):
                there = Pose.of(qpos[at : at + 3], qpos[at + 3 : at + 7])
                pose = scene.shapes.body_pose(name)
                moved = np.linalg.norm(pose.position - there.position)
                if moved > MOVED or pose.angle_to(there) > TURNED:
                    found.setdefault(key.get("name") or "without a name", []).append(name)
    return found


def _has_open_z(scene: ResolvedScene, name: str) -> bool:
    body = scene.description.bodies.get(name)
    return body is not None and has_unknown(body.elements.element, "pos", 2)
