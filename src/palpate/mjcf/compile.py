"""The scene as a MuJoCo model: robots removed, changes applied, compiled with the scene's folder."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
from lxml import etree

from palpate.common.errors import InputError
from palpate.mjcf.bounds import (
    HULL_POINTS,
    LARGE_MESHES,
    ElementSet,
    has_large_textures,
    mesh_bytes,
)
from palpate.mjcf.document import (
    ATTACH,
    Document,
    Element,
    attached_names,
    children,
    compiler_settings,
    elements,
    find_attached,
)
from palpate.mjcf.edits import Edit, Insert, apply
from palpate.mjcf.elements import PLACING, STAND_INS, replace_unknowns
from palpate.mjcf.roles import Roles

# Without a receiver MuJoCo prints its warnings, and writes MUJOCO_LOG.TXT into the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(
        lambda message: logging.getLogger(__name__).warning("MuJoCo: %s", message)
    )

BASE_SITE = "robot_base"
# Assets that are removed with a robot if no other element uses them.
_ASSETS = ("mesh", "material", "texture", "hfield", "model")
# Sections whose entries refer to other elements; in `<custom>` only tuples do.
_REFERRING = ("actuator", "sensor", "tendon", "equality", "contact", "deformable", "custom")


@dataclass(frozen=True, slots=True, eq=False)
class ModelTree:
    """A copy of a document's elements, to be changed and compiled."""

    root: Element  # the scene's root element
    attached: dict[Path, Element]  # root elements of attached models, by path
    twin_of: dict[Element, Element]  # copy of each element
    folder: Path | None  # start of relative file names
    mesh_bytes: float = 0.0  # size of its meshes

    @classmethod
    def of(cls, document: Document) -> ModelTree:
        """Make an unchanged copy."""
        # Copy each model, and map every element to its copy.
        twin_of: dict[Element, Element] = {}
        attached = document.attached()
        for model in (document, *attached.values()):
            twin_of |= zip(elements(model.root), elements(deepcopy(model.root)), strict=True)
        roots = {path: twin_of[model.root] for path, model in attached.items()}
        return cls(twin_of[document.root], roots, twin_of, document.folder)

    def loaded_elements(self) -> ElementSet:
        """Return the document's elements that are in this tree, or in a model that it still names."""
        # Models that are reachable by the names in `<asset>`.
        roots, pending = {self.root}, [self.root]
        while pending:
            for model in pending.pop().iterfind("asset/model"):
                named = self.attached.get(Path(model.get("file") or ""))
                if named is not None and named not in roots:
                    roots.add(named)
                    pending.append(named)
        # A removed element still has the document's root in lxml: only a walk shows the present elements.
        present = {element for root in roots for element in elements(root)}
        return {element for element, twin in self.twin_of.items() if twin in present}


def without_robots(document: Document, roles: Roles) -> ModelTree:
    """Return a copy of the document without robots and their assets."""
    tree = ModelTree.of(document)
    _remove_robots(tree, document, roles)
    return tree


def model_tree(
    document: Document, roles: Roles, edits: Iterable[Edit | Insert], is_drawn: bool = True
) -> ModelTree:
    """Copy the document without robots and keyframes, with `edits`; textures only if it `is_drawn` and they fit."""
    tree = ModelTree.of(document)
    apply(edits, tree.twin_of)
    for root in (tree.root, *tree.attached.values()):
        # Each element replaces a `?` of its defaults class, which MuJoCo must not read.
        for element in elements(root):
            for edit in replace_unknowns(element, STAND_INS):
                edit.apply(element)
        _keep_all(root)
        for keyframe in root.findall("keyframe"):
            root.remove(keyframe)
    _remove_robots(tree, document, roles)
    loaded = tree.loaded_elements()
    if not is_drawn or has_large_textures(document, loaded):
        for root in (tree.root, *tree.attached.values()):
            _remove_textures(root)
    return replace(tree, mesh_bytes=mesh_bytes(document, loaded))


def count_removed(document: Document, roles: Roles) -> dict[str, int]:
    """Count the elements removed together with the robots, by tag."""
    # Difference of the counts before and after, without the robots' own elements and assets.
    before = Counter(str(part.tag) for part in elements(document.root))
    for robot in roles.robots:
        before -= Counter(str(part.tag) for part in elements(robot))
    tree = without_robots(document, roles)
    after = Counter(str(part.tag) for part in elements(tree.root))
    return {tag: number for tag, number in (before - after).items() if tag not in _ASSETS}


def compile_spec(tree: ModelTree) -> mujoco.MjSpec:
    """Parse the tree into an editable model; files are found below its folder."""
    # Attached models are passed as text, by their paths.
    include: dict[str, bytes] = {}
    for path, root in tree.attached.items():
        include[str(path)] = etree.tostring(root, encoding="unicode").encode("utf-8")
    try:
        text = etree.tostring(tree.root, encoding="unicode")
        spec = mujoco.MjSpec.from_string(text, include=include)
    except (ValueError, mujoco.FatalError) as error:
        raise compile_error(error) from None
    if tree.folder is not None:
        spec.modelfiledir = str(tree.folder)
    if tree.mesh_bytes > LARGE_MESHES:
        # The hull of a hostile mesh takes minutes, so the points of each hull are bounded.
        for mesh in spec.meshes:
            if not 0 <= mesh.maxhullvert <= HULL_POINTS:
                mesh.maxhullvert = HULL_POINTS
    return spec


def compile_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model; an `InputError` has MuJoCo's message."""
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise compile_error(error) from None


def compile_error(error: Exception) -> InputError:
    """Make an error with MuJoCo's message in one line."""
    return InputError(f"MuJoCo does not accept the scene: {' '.join(str(error).split())[:600]}")


def _keep_all(root: Element) -> None:
    """Remove settings by which MuJoCo would leave out or turn bodies and geoms."""
    # They do not change the physics, and elements are looked up in the model in their own frames.
    # `memory` and the deprecated `njmax` only reserve memory (XMLreference, size): too little, or gigabytes.
    for tag, attributes in (
        ("compiler", ("discardvisual", "fusestatic", "alignfree")),
        ("size", ("memory", "njmax")),
        (".//freejoint", ("align",)),
        (".//joint", ("align",)),
    ):
        for element in root.iterfind(tag):
            for attribute in attributes:
                element.attrib.pop(attribute, None)


def _remove_textures(root: Element) -> None:
    """Remove textures, and the references of materials and lights to them."""
    for element in list(elements(root)):
        parent = element.getparent()
        if element.tag in ("texture", "layer") and parent is not None:
            parent.remove(element)
        elif element.tag in ("material", "light"):
            element.attrib.pop("texture", None)


def _remove_robots(tree: ModelTree, document: Document, roles: Roles) -> None:
    """Remove the robots, whose roots are in the scene's own tree, and all references to them."""
    if not roles.robots:
        return
    root = tree.root
    # Replace each robot by the site of its base, and collect the names of its elements.
    removed: set[str] = set()
    for robot in roles.robots:
        names = {part.get("name") for part in elements(robot)}
        removed |= {name for name in names if name} | attached_names(robot, document)
        _leave_site(root, robot, tree.twin_of[robot], document)
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    _remove_watching(root, removed)
    # A removed entry may itself be referred to, such as a tendon over the robot's joints by an actuator.
    while removed:
        removed = _remove_referring(root, removed)
    # Assets without a reference are removed.
    models = {str(model.path): name for name, model in document.models.items()}
    _remove_unused_assets(root, models)
    # Plugin instances of the robot's actuators and sensors.
    used = _references(root, "instance")
    for instance in list(root.iterfind("extension/plugin/instance")):
        plugin = instance.getparent()
        if plugin is not None and instance.get("name") not in used:
            plugin.remove(instance)


def _leave_site(root: Element, original: Element, robot: Element, document: Document) -> None:
    """Replace a robot by the site of the arm's base, unless the scene has that site."""
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
    """Compute the pose of the first body of an attached robot relative to its `<attach>`."""
    # Compile it with the settings of the attached model, which may use another angle unit.
    # The first body of the attached content is the robot's base.
    part = find_attached(attach, document, ())
    body = None if part is None else next(part.content.iter("body"), None)
    if part is None or body is None:
        return {}
    # The frames and bodies around it become frames of an otherwise empty model.
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
    pos, quat = (" ".join(map(repr, values.tolist())) for values in (site.pos, site.quat))
    return {"pos": pos, "quat": quat}


def _remove_referring(root: Element, names: set[str]) -> set[str]:
    """Remove entries that refer to removed elements; return the names of the entries."""
    # Texts and numbers in `<custom>` refer to nothing.
    gone: set[str] = set()
    for tag in _REFERRING:
        for section in root.iterfind(tag):
            for entry in list(children(section)):
                is_text = tag == "custom" and entry.tag != "tuple"
                if not is_text and _referenced_names(entry) & names:
                    gone |= {entry.get("name") or ""} - {""}
                    section.remove(entry)
    return gone


def _remove_watching(root: Element, names: set[str]) -> None:
    """Remove cameras and lights that follow removed bodies, and skins on them."""
    for tag in ("camera", "light", "skin"):
        for watching in list(root.iter(tag)):
            parent = watching.getparent()
            # The bodies of a skin in a file are not read.
            unknown = tag == "skin" and watching.get("file") is not None
            if parent is not None and (unknown or _referenced_names(watching) & names):
                parent.remove(watching)


def _referenced_names(entry: Element) -> set[str]:
    """Return the values of all attributes, in an element and below it, that may be references."""
    names: set[str] = set()
    for part in elements(entry):
        names |= {str(value) for key, value in part.items() if key not in ("name", "class")}
    return names


def _remove_unused_assets(root: Element, models: Mapping[str, str]) -> None:
    """Remove meshes, materials and other assets without a reference; `models` are attached models by file."""
    for tag in _ASSETS:
        # An asset is used if an attribute of its tag's name refers to it.
        used = _references(root, tag)
        for section in root.iterfind("asset"):
            for asset in section.findall(tag):
                # MuJoCo names an asset after its file; a model has its own name.
                file = asset.get("file") or ""
                name = asset.get("name") or models.get(file) or Path(file).stem
                if name and name not in used and asset.get("type") != "skybox":
                    section.remove(asset)


def _references(root: Element, attribute: str) -> set[str]:
    """Return all values of an attribute of that name."""
    return {str(e.get(attribute)) for e in elements(root) if e.get(attribute) is not None}
