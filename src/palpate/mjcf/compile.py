"""The scene as a MuJoCo model: the robot taken out, changes applied, compiled from the scene's
folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import mujoco
from lxml import etree

from palpate.errors import InputError
from palpate.mjcf.defaults import answered_elsewhere
from palpate.mjcf.document import Document, Element, children, copy_root, elements
from palpate.mjcf.edits import Edit, Insert, apply
from palpate.mjcf.roles import Roles

BASE_SITE = "robot_base"

_REFERRING = ("actuator", "sensor", "tendon", "equality", "contact", "deformable")


def model_tree(
    document: Document, roles: Roles, edits: Iterable[Edit | Insert]
) -> tuple[Element, dict[Element, Element]]:
    """A copy of the document without robots and keyframes, `edits` applied, and the copy of each
    element."""
    root, twin_of = copy_root(document)
    apply(edits, twin_of)
    _settle_defaults(root)
    _remove_robots(root, [twin_of[robot] for robot in roles.robots])
    return root, twin_of


def compile_spec(root: Element, folder: Path | None) -> mujoco.MjSpec:
    """An editable model; files are found below `folder`.

    Raises:
        InputError: MuJoCo does not accept the scene; the message is MuJoCo's.
    """
    try:
        spec = mujoco.MjSpec.from_string(etree.tostring(root, encoding="unicode"))
    except (ValueError, mujoco.FatalError) as error:
        raise refused(error) from None
    if folder is not None:
        spec.modelfiledir = str(folder)
    return spec


def compile_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The compiled model.

    Raises:
        InputError: MuJoCo does not accept the scene.
    """
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise refused(error) from None


def refused(error: Exception) -> InputError:
    """MuJoCo's complaint in one line."""
    return InputError(f"MuJoCo does not accept the scene: {' '.join(str(error).split())[:600]}")


def _settle_defaults(root: Element) -> None:
    """A `?` in a defaults class has been answered on each element; MuJoCo must not see it."""
    for element in elements(root):
        for edit in answered_elsewhere(element):
            edit.apply(element)


def _remove_robots(root: Element, robots: list[Element]) -> None:
    removed = {str(e.get("name")) for robot in robots for e in elements(robot) if e.get("name")}
    for robot in robots:
        _leave_site(root, robot)
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    while removed:
        removed = _remove_referring(root, removed)
    if robots:
        _remove_unused_assets(root)


def _leave_site(root: Element, robot: Element) -> None:
    """The arm stands where the scene's own robot stood, unless a site says otherwise."""
    parent = robot.getparent()
    assert parent is not None
    place = {
        k: str(v)
        for k, v in robot.items()
        if k in ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
    }
    if root.find(f".//site[@name='{BASE_SITE}']") is None:
        parent.insert(parent.index(robot), etree.Element("site", {"name": BASE_SITE, **place}))
    parent.remove(robot)


def _remove_referring(root: Element, names: set[str]) -> set[str]:
    """Take out what refers to removed elements; the names that go with it."""
    gone: set[str] = set()
    for entry in [
        e for tag in _REFERRING for section in root.iterfind(tag) for e in children(section)
    ]:
        mentioned = {
            str(v)
            for part in elements(entry)
            for k, v in part.items()
            if k not in ("name", "class")
        }
        if mentioned & names:
            gone |= {str(entry.get("name"))} if entry.get("name") else set()
            section = entry.getparent()
            assert section is not None
            section.remove(entry)
    return gone


def _remove_unused_assets(root: Element) -> None:
    """The robot's meshes and materials, which would only cost time."""
    for tag in ("mesh", "material", "texture", "hfield"):
        used = _references(root, tag)
        for asset in [a for section in root.iterfind("asset") for a in section.findall(tag)]:
            name = asset.get("name") or Path(asset.get("file") or "").stem
            section = asset.getparent()
            if name and name not in used and asset.get("type") != "skybox" and section is not None:
                section.remove(asset)


def _references(root: Element, attribute: str) -> set[str]:
    return {str(v) for e in elements(root) for k, v in e.items() if k == attribute}
