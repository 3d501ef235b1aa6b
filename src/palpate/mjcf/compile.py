"""The scene as a MuJoCo model: the robot taken out, changes applied, compiled from the scene's
folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import mujoco
from lxml import etree

from palpate.errors import InputError
from palpate.mjcf.defaults import standing_in
from palpate.mjcf.document import Document, Element, children, copy_root, elements
from palpate.mjcf.edits import Edit, Insert, apply
from palpate.mjcf.robots import attached_body, attached_names
from palpate.mjcf.roles import Roles

BASE_SITE = "robot_base"

_PLACING = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
"""Attributes that place a body or a site."""

_ASSETS = ("mesh", "material", "texture", "hfield")
"""The robot's, which would only cost time."""

_REFERRING = ("actuator", "sensor", "tendon", "equality", "contact", "deformable", "custom")
"""Sections whose entries refer to others; of `<custom>`, its tuples do."""


def model_tree(
    document: Document, roles: Roles, edits: Iterable[Edit | Insert]
) -> tuple[Element, dict[Element, Element]]:
    """A copy of the document without robots and keyframes, `edits` applied, and the copy of each
    element."""
    root, twin_of = copy_root(document)
    apply(edits, twin_of)
    _settle_defaults(root)
    _keep_all(root)
    robots = [twin_of[robot] for robot in roles.robots]
    _remove_robots(root, robots, roles)
    return root, twin_of


def removed_with_robots(document: Document, roles: Roles) -> dict[str, int]:
    """How many elements besides the robots themselves go with them, by tag."""
    root, twin_of = copy_root(document)
    robots = [twin_of[robot] for robot in roles.robots]
    before = Counter(str(part.tag) for part in elements(root))
    for robot in robots:
        before -= Counter(str(part.tag) for part in elements(robot))
    _remove_robots(root, robots, roles)
    after = Counter(str(part.tag) for part in elements(root))
    return {tag: number for tag, number in (before - after).items() if tag not in _ASSETS}


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
    """A `?` in a defaults class is answered on each element; MuJoCo must not see it."""
    for element in elements(root):
        for edit in standing_in(element):
            edit.apply(element)


def _keep_all(root: Element) -> None:
    """Every body and geom of the file is in the model: physics are the same without, and what is
    known of them is looked up there, in their own frames. `njmax`, which MuJoCo keeps for old files alone, says no more
    than how much memory to take (XMLreference, size-njmax): gigabytes, where it is 5000."""
    for tag, attributes in (
        ("compiler", ("discardvisual", "fusestatic", "alignfree")),
        ("size", ("njmax",)),
        (".//freejoint", ("align",)),
        (".//joint", ("align",)),
    ):
        for element in root.iterfind(tag):
            for attribute in attributes:
                element.attrib.pop(attribute, None)


def _remove_robots(root: Element, robots: list[Element], roles: Roles) -> None:
    removed: set[str] = set()
    for robot in robots:
        removed |= _names(robot) | attached_names(robot, roles.models)
        _leave_site(root, robot, roles)
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    if robots:
        _remove_watching(root, removed)
    while removed:
        removed = _remove_referring(root, removed)
    if robots:
        _remove_unused_assets(root)
        _remove_unused_plugins(root)


def _names(element: Element) -> set[str]:
    """Names of an element and all below it."""
    found = {part.get("name") for part in elements(element)}
    return {name for name in found if name}


def _leave_site(root: Element, robot: Element, roles: Roles) -> None:
    """The arm stands where the scene's own robot stood, unless a site says otherwise."""
    parent = robot.getparent()
    assert parent is not None
    if root.find(f".//site[@name='{BASE_SITE}']") is None:
        site = etree.Element("site", {"name": BASE_SITE})
        placed = robot
        if robot.tag == "attach":
            placed = attached_body(robot, roles.models)
            assert placed is not None
        for attribute in _PLACING:
            value = placed.get(attribute)
            if value is not None:
                site.set(attribute, value)
        parent.insert(parent.index(robot), site)
    parent.remove(robot)


def _remove_referring(root: Element, names: set[str]) -> set[str]:
    """Take out what refers to removed elements; the names that go with it."""
    gone: set[str] = set()
    for tag in _REFERRING:
        for section in root.iterfind(tag):
            for entry in list(children(section)):
                is_text = tag == "custom" and entry.tag != "tuple"
                if not is_text and _mentioned(entry) & names:
                    gone |= {entry.get("name") or ""} - {""}
                    section.remove(entry)
    return gone


def _remove_watching(root: Element, names: set[str]) -> None:
    """Take out cameras and lights that follow removed bodies, and skins that lie on them: all of
    those whose bodies stand in a file of their own."""
    for tag in ("camera", "light", "skin"):
        for watching in list(root.iter(tag)):
            parent = watching.getparent()
            unknown = tag == "skin" and watching.get("file") is not None
            if parent is not None and (unknown or _mentioned(watching) & names):
                parent.remove(watching)


def _mentioned(entry: Element) -> set[str]:
    """What an element and those below it refer to, or may."""
    found: set[str] = set()
    for part in elements(entry):
        found |= {str(value) for key, value in part.items() if key not in ("name", "class")}
    return found


def _remove_unused_assets(root: Element) -> None:
    """The robot's meshes and materials."""
    for tag in _ASSETS:
        used = _references(root, tag)
        for section in root.iterfind("asset"):
            for asset in section.findall(tag):
                name = asset.get("name") or Path(asset.get("file") or "").stem
                if name and name not in used and asset.get("type") != "skybox":
                    section.remove(asset)


def _remove_unused_plugins(root: Element) -> None:
    """What the robot's actuators and sensors were computed by."""
    used = _references(root, "instance")
    for instance in list(root.iterfind("extension/plugin/instance")):
        plugin = instance.getparent()
        if plugin is not None and instance.get("name") not in used:
            plugin.remove(instance)


def _references(root: Element, attribute: str) -> set[str]:
    """Every value of an attribute of that name."""
    return {str(e.get(attribute)) for e in elements(root) if e.get(attribute) is not None}
