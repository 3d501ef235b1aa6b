"""How a scene was read: what was taken for what, what was left out, and why nothing may be missing."""

from __future__ import annotations

import os
from collections.abc import Iterator

from palpate.mjcf.compile import BASE_SITE, removed_with_robots
from palpate.mjcf.document import Element
from palpate.mjcf.roles import Roles
from palpate.scene.scene import Scene


def remarks(scene: Scene) -> tuple[str, ...]:
    """Sentences for whoever wonders what palpate made of the file."""
    document, roles = scene.resolved.document, scene.resolved.description.roles
    found: list[str] = []
    if roles.robots:
        found.append(_robots_left_out(scene, roles))
    base = document.root.find(f".//site[@name='{BASE_SITE}']")
    if base is None and not roles.robots:
        found.append(
            f"There is no site '{BASE_SITE}' and no robot: the arm is taken to stand at the origin. "
            f'Where it does not, add <site name="{BASE_SITE}" pos="x y z"/> to the worldbody.'
        )
    if roles.ignored:
        names = ", ".join(_called(body) for body in roles.ignored)
        found.append(
            f"Neither object nor surface nor robot, as they have joints that are not free: {names}."
        )
    found += _why_nothing(scene)
    if scene.files and document.folder is not None:
        folder = document.folder.resolve()
        common = os.path.commonpath([folder, *scene.files])
        if common != str(folder):
            found.append(f"Its files are read from below '{common}'.")
    return tuple(found)


def _robots_left_out(scene: Scene, roles: Roles) -> str:
    names = ", ".join(_called(robot) for robot in roles.robots)
    gone = removed_with_robots(scene.resolved.document, roles)
    listed = ", ".join(f"{number} {tag}" for tag, number in sorted(gone.items()))
    besides = f" With it went what refers to it: {listed}." if listed else ""
    return f"Robot left out: {names}; the {scene.arm.label} takes its place.{besides}"


def _why_nothing(scene: Scene) -> Iterator[str]:
    if not scene.objects:
        yield "There is no object: no body has a free joint."
    if not scene.surfaces:
        yield "There is no surface: nothing static has a name and a level top."
    if scene.bodies and not scene.missing:
        yield "Nothing is missing: the file states all that palpate would measure unasked."


def _called(body: Element) -> str:
    name = body.get("name")
    return f"'{name}'" if name else f"a body in line {body.sourceline}"
