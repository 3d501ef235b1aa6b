"""The scene as a MuJoCo model: the robot taken out, changes applied, compiled from the scene's
folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import mujoco
from lxml import etree

from palpate.errors import InputError
from palpate.geometry.pose import Array
from palpate.mjcf.attached import ATTACH, attached_names, brought
from palpate.mjcf.bounds import HULL_POINTS, LARGE_MESHES, mesh_bytes
from palpate.mjcf.defaults import standing_in
from palpate.mjcf.document import (
    Document,
    Element,
    children,
    compiler_settings,
    copy_root,
    elements,
)
from palpate.mjcf.edits import Edit, Insert, apply
from palpate.mjcf.roles.elements import PLACING
from palpate.mjcf.roles.roles import Roles

BASE_SITE = "robot_base"

_ASSETS = ("mesh", "material", "texture", "hfield", "model")
"""The robot's, which would only cost time."""

_REFERRING = ("actuator", "sensor", "tendon", "equality", "contact", "deformable", "custom")
"""Sections whose entries refer to others; of `<custom>`, its tuples do."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelTree:
    """A document's elements copied, to be changed and compiled.

    Attributes:
        root: the scene's.
        attached: those of the models that it attaches, by where they lie.
        twin_of: the copy of each element.
        folder: where relative file names start.
        mesh_bytes: size of all meshes, robots' among them.
    """

    root: Element
    attached: dict[Path, Element]
    twin_of: dict[Element, Element]
    folder: Path | None
    mesh_bytes: float

    @classmethod
    def of(cls, document: Document) -> ModelTree:
        """An unchanged copy."""
        root, twin_of = copy_root(document)
        attached: dict[Path, Element] = {}
        for path, model in document.attached().items():
            attached[path], twins = copy_root(model)
            twin_of |= twins
        return cls(root, attached, twin_of, document.folder, mesh_bytes(document))

    def text(self) -> str:
        """The scene's own."""
        return etree.tostring(self.root, encoding="unicode")

    def parts(self) -> dict[str, str]:
        """The texts of what it attaches, by the names that it calls them by."""
        found: dict[str, str] = {}
        for path, root in self.attached.items():
            found[str(path)] = etree.tostring(root, encoding="unicode")
        return found


def model_tree(document: Document, roles: Roles, edits: Iterable[Edit | Insert]) -> ModelTree:
    """A copy of the document without robots and keyframes, `edits` applied."""
    tree = ModelTree.of(document)
    apply(edits, tree.twin_of)
    for root in (tree.root, *tree.attached.values()):
        _settle_defaults(root)
        _keep_all(root)
        for keyframe in root.findall("keyframe"):
            root.remove(keyframe)
    _remove_robots(tree, document, roles)
    return tree


def removed_with_robots(document: Document, roles: Roles) -> dict[str, int]:
    """Number of elements removed together with the robots, by tag."""
    tree = ModelTree.of(document)
    before = Counter(str(part.tag) for part in elements(tree.root))
    for robot in roles.robots:
        before -= Counter(str(part.tag) for part in elements(tree.twin_of[robot]))
    _remove_robots(tree, document, roles)
    after = Counter(str(part.tag) for part in elements(tree.root))
    return {tag: number for tag, number in (before - after).items() if tag not in _ASSETS}


def compile_spec(tree: ModelTree) -> mujoco.MjSpec:
    """An editable model; files are found below the tree's folder.

    Raises:
        InputError: MuJoCo does not accept the scene; the message is MuJoCo's.
    """
    include = {name: text.encode("utf-8") for name, text in tree.parts().items()}
    try:
        spec = mujoco.MjSpec.from_string(tree.text(), include=include)
    except (ValueError, mujoco.FatalError) as error:
        raise refused(error) from None
    if tree.folder is not None:
        spec.modelfiledir = str(tree.folder)
    if tree.mesh_bytes > LARGE_MESHES:
        # The hull of a hostile mesh takes minutes; bounding it changes no mesh of a usual size.
        for mesh in spec.meshes:
            if not 0 <= mesh.maxhullvert <= HULL_POINTS:
                mesh.maxhullvert = HULL_POINTS
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


def _remove_robots(tree: ModelTree, document: Document, roles: Roles) -> None:
    """Take out the robots, all of which begin in the scene's own tree, and what refers to them."""
    if not roles.robots:
        return
    root = tree.root
    removed: set[str] = set()
    for robot in roles.robots:
        removed |= _names(robot) | attached_names(robot, document)
        _leave_site(root, robot, tree.twin_of[robot], document)
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    _remove_watching(root, removed)
    while removed:
        removed = _remove_referring(root, removed)
    _remove_unused_assets(root)
    _remove_unused_plugins(root)


def _names(element: Element) -> set[str]:
    """Names of an element and all below it."""
    found = {part.get("name") for part in elements(element)}
    return {name for name in found if name}


def _leave_site(root: Element, original: Element, robot: Element, document: Document) -> None:
    """The arm stands where the scene's own robot stood, unless a site says otherwise."""
    parent = robot.getparent()
    assert parent is not None
    if root.find(f".//site[@name='{BASE_SITE}']") is None:
        places = _attached_place(original, document)
        if original.tag != ATTACH:
            places = {name: original.get(name) or "" for name in PLACING & set(original.keys())}
        site = etree.Element("site", {"name": BASE_SITE, **places})
        parent.insert(parent.index(robot), site)
    parent.remove(robot)


def _attached_place(attach: Element, document: Document) -> dict[str, str]:
    """Pose of the first body of an attached robot, from its `<attach>`: its model may use another
    angle unit."""
    part = brought(attach, document, ())
    body = None if part is None else next(part.content.iter("body"), None)
    if part is None or body is None:
        return {}
    above = [outer for outer in body.iterancestors() if part.content in outer.iterancestors()]
    inner = etree.Element("mujoco")
    inner.append(etree.Element("compiler", compiler_settings(part.model.root)))
    at = etree.SubElement(inner, "worldbody")
    for outer in (*reversed(above), body):
        placing = {name: outer.get(name) or "" for name in PLACING & set(outer.keys())}
        at = etree.SubElement(at, "frame", placing)
    etree.SubElement(at, "site", name=BASE_SITE)
    model = compile_model(mujoco.MjSpec.from_string(etree.tostring(inner, encoding="unicode")))
    site = model.site(BASE_SITE)
    return {"pos": _text(site.pos), "quat": _text(site.quat)}


def _text(numbers: Array) -> str:
    return " ".join(repr(number) for number in numbers.tolist())


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
    """Names to which an element and those below it refer, or may refer."""
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
                name = asset.get("name") or _name_by_file(asset)
                if name and name not in used and asset.get("type") != "skybox":
                    section.remove(asset)


def _name_by_file(asset: Element) -> str:
    """MuJoCo's name of an asset without a name; a model has its own name."""
    return "" if asset.tag == "model" else Path(asset.get("file") or "").stem


def _remove_unused_plugins(root: Element) -> None:
    """Remove the plugins of the robot's actuators and sensors."""
    used = _references(root, "instance")
    for instance in list(root.iterfind("extension/plugin/instance")):
        plugin = instance.getparent()
        if plugin is not None and instance.get("name") not in used:
            plugin.remove(instance)


def _references(root: Element, attribute: str) -> set[str]:
    """Every value of an attribute of that name."""
    return {str(e.get(attribute)) for e in elements(root) if e.get(attribute) is not None}
