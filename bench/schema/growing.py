"""Random scenes over MuJoCo's schema: a table with things on it, to which elements and attributes are
added as long as MuJoCo compiles it."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import mujoco
from lxml import etree

Element = etree._Element

BODIES = ("worldbody", "body", "frame", "replicate")
"""Elements that `(world)body` of the schema stands for."""
UNSAFE = frozenset({"include", "plugin", "attach", "model", "hfield", "skin", "bone", "flexcomp"})
"""Elements that need files or libraries."""
FILES = frozenset({"file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"})
SKIPPED = FILES | {"content_type", "memory", "nstack", "nconmax", "njmax", "plugin", "simple"}
"""Attributes that name files, or take much memory."""
REFERENCES = {
    "mesh": "mesh",
    "material": "material",
    "texture": "texture",
    "class": "default",
    "childclass": "default",
    "tendon": "tendon",
    "actuator": "actuator",
    "sensor": "sensor",
    "body": "body",
    "target": "body",
    "joint": "joint",
    "site": "site",
    "geom": "geom",
    "camera": "camera",
}
"""Kind of element that an attribute refers to, by its name without a digit at the end."""
SECTIONS = {
    "tendon": ("spatial", "fixed"),
    "actuator": ("general", "motor", "position", "velocity", "damper"),
    "mesh": ("mesh",),
    "default": ("default",),
}


Tags = tuple[str, ...]

INDENT = 3
LINE = re.compile(r"^( *)(\S+) \((.)\) *(.*)$")
LABEL = re.compile(r"^\.\. _([\w-]+):")
ATTRIBUTE = re.compile(r"^:at:`(\w+)`: :at-val:`(.*)`")


@dataclass(frozen=True)
class Kind:
    """An element of the schema.

    Attributes:
        path: tags from the root to it.
        often: number in its parent: `!` one, `?` at most one, `*` any, `R` any, and in itself, too.
    """

    path: Tags
    often: str
    attributes: tuple[str, ...]

    @property
    def tag(self) -> str:
        return self.path[-1]


@cache
def kinds() -> tuple[Kind, ...]:
    """All elements, as `mj_printSchema` lists them."""
    found: list[tuple[Tags, str, list[str]]] = []
    path: list[str] = []
    module: Any = mujoco  # this one is missing in its stubs
    for line in module.mj_printSchema(False, False).splitlines():
        match = LINE.match(line)
        if match is None:
            found[-1][2].extend(line.split())
            continue
        depth = len(match[1]) // INDENT
        path = [*path[:depth], match[2]]
        found.append((tuple(path), match[3], match[4].split()))
    return tuple(Kind(path, often, tuple(attributes)) for path, often, attributes in found)


@cache
def types() -> dict[tuple[str, str], str]:
    """Types of attributes in MuJoCo's reference, such as `real(3), "0 0 0"`, by element and name."""
    reference = Path(mujoco.__file__).parent / "doc" / "XMLreference.rst"
    found: dict[tuple[str, str], str] = {}
    element = ""
    for line in reference.read_text("utf-8").splitlines():
        if label := LABEL.match(line):
            parts = label[1].split("-")
            element = parts[-2] if len(parts) > 1 else parts[-1]
        elif attribute := ATTRIBUTE.match(line):
            found[element, attribute[1]] = attribute[2]
    return found


@dataclass(slots=True)
class Grower:
    """A growing scene.

    Attributes:
        random: generator of all choices.
        root: the scene.
        used: element and attribute names that were added from the schema.
        count: number of names given.
    """

    random: Random
    root: Element = field(default_factory=lambda: etree.Element("mujoco"))
    used: set[tuple[str, str]] = field(default_factory=set)
    count: int = 0

    def grow(self, steps: int) -> None:
        """Make a tabletop, and try `steps` times to add an element or an attribute."""
        self._begin()
        assert compiles(self.root), etree.tostring(self.root)
        for _ in range(steps):
            tried = copy.deepcopy(self.root)
            added = self._added(tried)
            if added and compiles(tried):
                self.root = tried
                self.used |= added

    # The initial scene.

    def _begin(self) -> None:
        random = self.random
        if random.random() < 0.5:
            self.root.set("model", random.choice(["cell", "Küche", "a & b", "x<y"]))
        if random.random() < 0.4:
            etree.SubElement(self.root, "compiler", {"angle": random.choice(["radian", "degree"])})
        default = etree.SubElement(self.root, "default")
        if random.random() < 0.4:
            attributes = {"friction": "0.7 0.01 0.0002"} if random.random() < 0.5 else {}
            etree.SubElement(default, "geom", attributes | {"solref": "0.01 1"})
        light = etree.SubElement(default, "default", {"class": "light"})
        etree.SubElement(light, "geom", {"density": "300"})
        asset = etree.SubElement(self.root, "asset")
        etree.SubElement(asset, "mesh", {"name": "wedge", "vertex": _WEDGE})
        etree.SubElement(asset, "material", {"name": "red", "rgba": "1 0 0 1"})
        world = etree.SubElement(self.root, "worldbody")
        etree.SubElement(world, "site", {"name": "robot_base"})
        etree.SubElement(world, "site", {"name": "mark", "pos": "1 1 1"})
        etree.SubElement(world, "camera", {"name": "eye", "pos": "0 0 2"})
        etree.SubElement(world, "geom", {"name": "ground", "type": "plane", "size": "2 2 .1"})
        for i in range(random.randint(1, 2)):
            self._add_stand(world, i)
        for i in range(random.randint(1, 3)):
            self._add_thing(world, i)
        if random.random() < 0.5:
            door = etree.SubElement(world, "body", {"name": "door", "pos": "1.5 1 0.5"})
            etree.SubElement(door, "joint", {"name": "hinge", "axis": "0 0 1"})
            etree.SubElement(door, "geom", {"name": "panel", "type": "box", "size": ".01 .2 .3"})
            etree.SubElement(door, "site", {"name": "handle", "pos": "0 .1 0"})
        for section in _SECTIONS:
            if random.random() < 0.5:
                etree.SubElement(self.root, section)

    def _add_stand(self, world: Element, number: int) -> None:
        """Add a table, as a geom of the world or as a body."""
        half, top = 0.02, 0.1 + 0.1 * number
        place, size = f"0.5 {0.7 * number} {top - half:.3f}", f".3 .3 {half}"
        name = f"stand_{number}"
        shape = {"type": "box", "size": size}
        if self.random.random() < 0.5:
            etree.SubElement(world, "geom", {"name": name, "pos": place, **shape})
        else:
            body = etree.SubElement(world, "body", {"name": name, "pos": place})
            etree.SubElement(body, "geom", shape)

    def _add_thing(self, world: Element, number: int) -> None:
        """Add an object on the first table, of one or several shapes, its mass stated in one of several
        ways."""
        random = self.random
        parent = world
        if random.random() < 0.2:
            parent = etree.SubElement(world, "frame", {"pos": "0 0 0"})
        x, y = 0.35 + 0.12 * number, random.uniform(-0.15, 0.15)
        body = etree.SubElement(
            parent, "body", {"name": f"thing_{number}", "pos": f"{x:.3f} {y:.4f} 0.13"}
        )
        joints = (("freejoint", {}), ("joint", {"type": "free"}))
        tag, attributes = random.choice(joints)
        etree.SubElement(body, tag, attributes)
        if random.random() < 0.3:
            etree.SubElement(body, "inertial", random.choice(_INERTIALS))
        inside = body
        if random.random() < 0.2:
            inside = etree.SubElement(body, "body", {"pos": "0 0 0.001"})
        weighing = random.choice(["mass", "density", "class", "none"])
        for part in range(random.choice([1, 1, 2, 3])):
            shape = random.choice(_SHAPES)
            geom = etree.SubElement(inside, "geom", shape)
            if "fromto" not in shape:
                geom.set("pos", f"0 {0.01 * part} 0")
            if weighing == "mass":
                geom.set("mass", f"{random.uniform(0.02, 0.4):.4g}")
            elif weighing == "density":
                geom.set("density", f"{random.uniform(200, 2000):.4g}")
            elif weighing == "class":
                geom.set("class", "light")
            if random.random() < 0.6:
                geom.set("friction", f"{random.uniform(0.2, 1):.3f} 0.005 0.0001")

    # Additions.

    def _added(self, root: Element) -> set[tuple[str, str]]:
        """Add an element or an attribute; return the added names."""
        if self.random.random() < 0.45:
            return self._add_attribute(root)
        return self._add_element(root)

    def _add_element(self, root: Element) -> set[tuple[str, str]]:
        kind = self.random.choice(kinds()[1:])
        if kind.tag in UNSAFE or "plugin" in kind.path or kind.tag in ("worldbody", "freejoint"):
            return set()
        parents = [e for e in _all(root) if _fits(e, kind.path[:-1])]
        if not parents:
            return set()
        parent = self.random.choice(parents)
        if kind.often in "!?" and parent.find(kind.tag) is not None:
            return set()
        if kind.tag == "(world)body":
            return set()
        element = etree.SubElement(parent, kind.tag)
        used = {(kind.tag, "")}
        for attribute in kind.attributes:
            required = "required" in self._type(kind, attribute)
            if attribute == "name" or required or self.random.random() < 0.25:
                used |= self._set(root, element, kind, attribute)
        self._add_needed(root, element, kind)
        return used

    def _add_needed(self, root: Element, element: Element, kind: Kind) -> None:
        """Add children that MuJoCo requires."""
        if kind.tag == "spatial":
            for name in self._names(root, "site")[:2]:
                etree.SubElement(element, "site", {"site": name})
        if kind.tag == "fixed":
            for name in self._names(root, "joint")[:1]:
                etree.SubElement(element, "joint", {"joint": name, "coef": "1"})
        if kind.tag == "tuple":
            name = self.random.choice(self._names(root, "body"))
            etree.SubElement(element, "element", {"objtype": "body", "objname": name})

    def _add_attribute(self, root: Element) -> set[tuple[str, str]]:
        element = self.random.choice(list(_all(root)))
        fitting = [kind for kind in kinds() if _fits(element, kind.path)]
        if not fitting:
            return set()
        kind = self.random.choice(fitting)
        free = [a for a in kind.attributes if a not in element.attrib and a != "name"]
        if not free:
            return set()
        return self._set(root, element, kind, self.random.choice(free))

    def _set(
        self, root: Element, element: Element, kind: Kind, attribute: str
    ) -> set[tuple[str, str]]:
        if attribute in SKIPPED:
            return set()
        value = self._value(root, kind, attribute)
        if value is None:
            return set()
        element.set(attribute, value)
        return {(kind.tag, attribute)}

    def _type(self, kind: Kind, attribute: str) -> str:
        known = types()
        if (kind.tag, attribute) in known:
            return known[kind.tag, attribute]
        alike = [t for (_, name), t in known.items() if name == attribute]
        return alike[0] if alike else "real, optional"

    def _value(self, root: Element, kind: Kind, attribute: str) -> str | None:
        random, said = self.random, self._type(kind, attribute)
        if attribute == "name":
            self.count += 1
            return f"{kind.tag}_{self.count}"
        referred = REFERENCES.get(attribute.rstrip("12"))
        if referred is not None and not said.startswith("["):
            names = self._names(root, referred)
            return random.choice(names) if names else None
        if said.startswith("["):
            choices = said[1 : said.index("]")].split(",")
            return random.choice(choices).strip()
        default = re.search(r'"([^"]*)"', said)
        if said.startswith("int"):
            return _numbers(random, said, default and default[1], whole=True)
        if said.startswith("real"):
            return _numbers(random, said, default and default[1], whole=False)
        return default[1] if default and default[1] else random.choice(["x", "1", "xyz"])

    def _names(self, root: Element, tag: str) -> list[str]:
        found: list[str] = []
        for element in _all(root):
            in_defaults = next(element.iterancestors("default"), None) is not None
            if element.tag in SECTIONS.get(tag, (tag,)) and (not in_defaults or tag == "default"):
                found.append(element.get("class" if tag == "default" else "name") or "")
        return [name for name in found if name]


_SECTIONS = [
    "option",
    "size",
    "visual",
    "statistic",
    "contact",
    "equality",
    "tendon",
    "actuator",
    "sensor",
    "keyframe",
    "custom",
    "deformable",
]
_NUMBER = r"[-+]?\d*\.?\d+(e[-+]?\d+)?"
_WEDGE = "-.03 -.03 -.03 .03 -.03 -.03 -.03 .03 -.03 .03 .03 -.03 -.03 0 .03 .03 0 .03"
_SHAPES = (
    {"type": "box", "size": "0.02 0.025 0.03"},
    {"type": "cylinder", "size": "0.025 0.03"},
    {"type": "sphere", "size": "0.03"},
    {"size": "0.03"},
    {"type": "capsule", "size": "0.02 0.01"},
    {"type": "ellipsoid", "size": "0.02 0.025 0.03"},
    {"type": "mesh", "mesh": "wedge"},
    {"type": "capsule", "fromto": "-.02 0 -.01 .02 0 -.01", "size": "0.02"},
)
_INERTIALS = (
    {"pos": "0 0 0.005", "mass": "0.21", "diaginertia": "1e-4 1.1e-4 1.2e-4"},
    {"pos": "0 0 0.005", "mass": "0.21", "fullinertia": "1e-4 1.1e-4 1.2e-4 1e-6 0 0"},
    {"pos": ".001 0 0", "quat": "1 .1 0 0", "mass": ".3", "diaginertia": "1e-4 1e-4 1e-4"},
)


def compiles(root: Element) -> bool:
    """True if MuJoCo compiles it, and positions and masses are finite."""
    try:
        model = mujoco.MjModel.from_xml_string(etree.tostring(root, encoding="unicode"))
    except (ValueError, mujoco.FatalError):
        return False
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return all(math.isfinite(x) for x in (*data.xpos.ravel(), *model.body_mass))


def _all(root: Element) -> Iterator[Element]:
    return root.iter(etree.Element)


def _fits(element: Element, path: tuple[str, ...]) -> bool:
    """True if an element is the schema's at `path`."""
    tags = [element.tag, *(above.tag for above in element.iterancestors())][::-1]
    if path[-1] == "(world)body":
        return element.tag in BODIES
    if "(world)body" in path:
        below = path[path.index("(world)body") + 1 :]
        ends_so = len(tags) > len(below) and tags[-len(below) :] == list(below)
        return ends_so and tags[-len(below) - 1] in BODIES
    if path[:2] == ("mujoco", "default"):
        inner = [tag for tag in tags if tag != "default"]
        return "default" in tags and inner == [tag for tag in path if tag != "default"]
    return tags == list(path)


def _numbers(random: Random, said: str, default: str | None, whole: bool) -> str:
    stated = (default or "").split()
    if stated and all(re.fullmatch(_NUMBER, part) for part in stated):
        values = [float(part) * random.choice([1.0, 0.5, 1.3]) for part in stated]
    else:
        length = re.match(r"\w+\((\d+)\)", said)
        values = [random.uniform(0.05, 1.0) for _ in range(int(length[1]) if length else 1)]
        if whole:
            values = [float(random.randint(0, 4)) for _ in values]
    return " ".join(_hand(random, round(v) if whole else v) for v in values)


def _hand(random: Random, value: float) -> str:
    """Format a number in one of the ways in which people write it."""
    if isinstance(value, int):
        return str(value)
    text = random.choice([f"{value:.4g}", f"{value:.6f}", f"{value:.3e}", f"{value:+.4g}"])
    return text.replace("0.", ".", 1) if text.startswith("0.") and random.random() < 0.3 else text
