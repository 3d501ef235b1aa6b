"""Remarks on the reading of a scene: interpretations, omissions, and reasons why nothing is missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.mjcf.compile import BASE_SITE, removed_with_robots
from palpate.mjcf.document import Element
from palpate.mjcf.elements import copy_mark
from palpate.scene.consistency import contradictions
from palpate.scene.describe import AN_OBJECT
from palpate.scene.named.places import reachable
from palpate.scene.scene import Scene

LISTED = 8
"""Most names in a sentence."""

SITE = f'<site name="{BASE_SITE}" pos="x y z"/>'
"""Element that places the arm in a scene."""


def remarks(scene: Scene) -> tuple[str, ...]:
    """Sentences that explain how the file was read."""
    parts = (_robots, _base, _others, _deviations, _copies, _refused, _contradictions, _why_nothing)
    return tuple(sentence for part in parts for sentence in part(scene))


def _robots(scene: Scene) -> Iterator[str]:
    roles = scene.resolved.description.roles
    if not roles.robots:
        return
    removed = removed_with_robots(scene.resolved.document, roles)
    listed = ", ".join(f"{number} {tag}" for tag, number in sorted(removed.items()))
    references = f" With it went what refers to it: {listed}." if listed else ""
    yield (
        f"Robot left out: {_names(map(_label, roles.robots))}; the {scene.arm.label} takes its place."
        f"{references}"
    )


def _base(scene: Scene) -> Iterator[str]:
    """Yield remarks on the arm's base where it is not stated, or too far from objects."""
    robots = scene.resolved.description.roles.robots
    no_site = scene.resolved.document.root.find(f".//site[@name='{BASE_SITE}']") is None
    if no_site and not robots:
        yield (
            f"There is no site '{BASE_SITE}' and no robot: the arm is taken to stand at the origin. "
            f"Where it does not, add {SITE} to the worldbody."
        )
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
            f"Out of the reach of the arm, which stands at ({x:.2f}, {y:.2f}, {z:.2f}) m: "
            f"{_names(map(_quoted, far))}. Where that is not so, {advice}."
        )


def _others(scene: Scene) -> Iterator[str]:
    """Yield remarks on bodies that are neither objects nor surfaces."""
    roles = scene.resolved.description.roles
    if roles.ignored:
        advice = ""
        if not roles.robots:
            advice = " If one of them is a robot, say so: --robot-body NAME."
        yield (
            "Neither object nor surface nor robot, as they have joints that are not free: "
            f"{_names(map(_label, roles.ignored))}. {_sentence(AN_OBJECT)}{advice}"
        )
    copies: list[str] = []
    for attach in roles.copied:
        content = attach.get("body") or attach.get("frame") or attach.get("model") or ""
        copies.append(f"'{attach.get('prefix') or ''}{content}'")
    if copies:
        yield (
            "Of what is attached more than once, the first stands for all, as one file states it: not "
            f"{_names(copies)}. Where one of them differs, give it a file of its own."
        )


def _deviations(scene: Scene) -> Iterator[str]:
    """Yield remarks on deviations from the file."""
    description = scene.resolved.description
    document = description.document
    if document.folder is not None and document.home not in (None, document.folder.resolve()):
        yield f"The scene's {len(document.files)} files are read from below '{document.home}'."
    for name in scene.objects:
        if reason := scene.catalogue["mass"].overruled(description.bodies[name]):
            yield f"What is measured of '{name}' in the hand would not be its own: {reason}."
    if description.lowered:
        yield (
            "Placed a little above what they stand on, and let down onto it: "
            f"{_names(map(_quoted, description.lowered))}."
        )


def _copies(scene: Scene) -> Iterator[str]:
    """Yield remarks on copies by `<replicate>`."""
    description = scene.resolved.description
    copied: list[str] = []
    for name, body in description.bodies.items():
        if any(copy_mark(part) for part in (body.elements.element, *body.elements.through)):
            copied.append(name)
    if copied:
        yield (
            "Of the copies that <replicate> makes, the first stands for all: "
            f"{_names(map(_quoted, copied))}."
        )
    if description.roles.replicated:
        yield (
            "No objects, as <replicate> makes their parts of one line: "
            f"{_names(map(_label, description.roles.replicated))}."
        )


def _refused(scene: Scene) -> Iterator[str]:
    refused = scene.resolved.description.refused
    if refused:
        reasons = [f"'{name}' ({reason})" for name, reason in refused.items()]
        yield f"Stands still and is no surface: {_names(reasons)}. {_sentence(AN_OBJECT)}"


def _contradictions(scene: Scene) -> Iterator[str]:
    return contradictions(scene.resolved)


def _why_nothing(scene: Scene) -> Iterator[str]:
    if not scene.objects:
        yield f"There is no object. {_sentence(AN_OBJECT)}"
    if not scene.surfaces:
        yield "There is no surface: nothing static has a name and a level top."
    if scene.bodies and not scene.missing and not scene.resolved.description.roles.untouchable:
        yield (
            "Nothing is missing: the file states all that palpate would measure unasked. What is "
            "written `?` is measured, and what a request asks for with --remeasure."
        )


def _names(names: Iterable[str]) -> str:
    """The first names with commas, and the number of the others."""
    listed = list(names)
    shown = ", ".join(listed[:LISTED])
    return shown if len(listed) <= LISTED else f"{shown} and {len(listed) - LISTED} more"


def _sentence(clause: str) -> str:
    return f"{clause[0].upper()}{clause[1:]}."


def _quoted(name: str) -> str:
    return f"'{name}'"


def _label(body: Element) -> str:
    name = body.get("name") or body.get("model")
    return _quoted(name) if name else f"a body in line {body.sourceline}"
