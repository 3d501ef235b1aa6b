"""Plans of a confused or hostile model: valid plans, changed at random by a seeded generator."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.faults.bases import Base
from palpate.planning.plan import plan_json
from palpate.scene.scene import Scene

Document = dict[str, Any]
Siblings = list[Document]
Place = tuple[Siblings, int]
"""A node: its list of siblings, and its index in it."""

MOST = 3
"""Most changes of one plan."""
SPOILT = 0.08
"""Share of plans with, in addition, a value of another type, which makes them unreadable."""
GARBLED = 0.04
"""Share of plans with, in addition, damaged text."""
DEEPEST = 40
"""Most composites around one node."""
FACTORS = (-20.0, -3.0, -2.0, -1.0, -0.5, 0.0, 0.2, 0.37, 0.5, 0.8, 1.5, 2.0, 3.0, 5.0, 16.0, 1e6)
NUMBERS = (0.0, -1.0, 1.0, 7.3, 1e9, 1e308, -1e308, 1e-308)
SCRAWLS = ("1e999", "nan", "-inf", "0x10", "1_0", "٣", "½", "1,5", "--1", "")
"""Text in place of a factor."""
ANYTHING: tuple[Any, ...] = (
    None,
    True,
    "",
    "null",
    [],
    {},
    [[]],
    {"type": "MovePose"},
    float("nan"),
    10**400,
)
"""Values of another type."""
MISSPELLINGS: tuple[Callable[[str], str], ...] = (
    str.upper,
    str.title,
    lambda name: name.replace("a", "\u0430").replace("o", "\u043e"),  # Cyrillic letters
    lambda name: name[:3] + "\u200b" + name[3:],  # zero-width space
    lambda name: "\u202e" + name,  # right-to-left override
    lambda name: f" {name}\n",
    lambda name: name + "\u0301",  # combining accent
    lambda name: 300 * name,
    lambda name: name.replace("_", "."),
)
QUANTITIES = ("mass", "friction", "height", "com", "inertia", "position", "velocity", "nonsense")
SENSING = ("MeasureForces", "MeasureGripperPose")
CONVERSIONS = ("Force2Mass", "Force2Velocity", "Force2Momentum", "Pose2Height", "Pose2Plan")
AXES = ("+x", "-x", "+y", "-y", "+z", "-z", "+w")


@dataclass(frozen=True, slots=True)
class Corrupted:
    """A plan's text, and its changes in words."""

    text: str
    changes: tuple[str, ...]


class Corruption:
    """Random changes of one document, in place; each returns its description."""

    def __init__(self, document: Document, scene: Scene, random: np.random.Generator) -> None:
        self.document, self.scene, self.random = document, scene, random

    def delete(self) -> str:
        siblings, i = self._leaf()
        gone = siblings.pop(i)
        return f"deleted {_shown(gone)}"

    def duplicate(self) -> str:
        siblings, i = self._leaf()
        siblings.insert(i, deepcopy(siblings[i]))
        return f"twice {_shown(siblings[i])}"

    def swap(self) -> str:
        (first, i), (second, j) = self._leaf(), self._leaf()
        first[i], second[j] = second[j], first[i]
        return f"swapped {_shown(first[i])} and {_shown(second[j])}"

    def replace(self) -> str:
        siblings, i = self._leaf()
        old, siblings[i] = siblings[i], self._any_leaf()
        return f"{_shown(old)} became {_shown(siblings[i])}"

    def insert(self) -> str:
        siblings, i = self._leaf()
        siblings.insert(i, self._any_leaf())
        return f"inserted {_shown(siblings[i])}"

    def elsewhere(self) -> str:
        """Replace the base pose, keep the offsets."""
        node = self._one("MovePose")
        old = str(node["pose"])
        head, *rest = old.split(" ", 1)
        node["pose"] = " ".join([self._choice(self.scene.symbols.names), *rest])
        return f"{old} became {node['pose']} instead of {head}"

    def offset(self) -> str:
        """Add an offset."""
        node = self._one("MovePose")
        old = str(node["pose"])
        node["pose"] = old + self._term()
        return f"{old} became {node['pose']}"

    def without_offset(self) -> str:
        node = self._one("MovePose")
        old = str(node["pose"])
        node["pose"] = old.split(" ", 1)[0]
        return f"{old} became {node['pose']}"

    def sign(self) -> str:
        node = self._one("MovePose")
        old = str(node["pose"])
        signs = {"+": "-", "-": "+"}
        node["pose"] = "".join(signs.get(c, c) for c in old)
        return f"{old} became {node['pose']}"

    def scrawl(self) -> str:
        """Add a factor that is not a number, or not written as one."""
        node = self._one("MovePose")
        offset = self._choice(self.scene.symbols.offset_names)
        node["pose"] = f"{node['pose']} + {self._choice(SCRAWLS)}*{offset}"
        return f"scrawled {node['pose']}"

    def misspell(self) -> str:
        """Write a name in other letters."""
        node = self._one("MovePose")
        head, *rest = str(node["pose"]).split(" ", 1)
        node["pose"] = " ".join([self._choice(MISSPELLINGS)(head), *rest])
        return f"misspelt {ascii(node['pose'])[:80]}"

    def axis(self) -> str:
        node = self._one("MoveUntilContact")
        node["axis"] = self._choice(AXES)
        return f"a probe along {node['axis']}"

    def joints(self) -> str:
        """Replace a configuration's name by angles: near home, or anywhere."""
        node = self._one("MoveJoints")
        home = self.scene.arm.home
        if self.random.random() < 0.6:
            angles = home + self.random.normal(0, self._choice((0.05, 0.2, 0.6)), len(home))
        else:
            angles = self.random.uniform(-2.9, 2.9, len(home))
        node["joints"] = [round(float(angle), 3) for angle in angles]
        return f"joints {node['joints']}"

    def beside(self) -> str:
        """Put neighbours into a Parallel."""
        siblings, i = self._leaf()
        end = i + int(self.random.integers(2, 4))
        together = siblings[i:end]
        siblings[i:end] = [{"type": "Parallel", "children": together}]
        return f"at once: {', '.join(_shown(node) for node in together)}"

    def gripper(self) -> str:
        other = {"OpenGripper": "CloseGripper", "CloseGripper": "OpenGripper"}
        nodes = [n for n in self._nodes() if n["type"] in other]
        if not nodes:
            return self.insert()
        node = self._choice(nodes)
        node["type"] = other[node["type"]]
        return f"{other[node['type']]} became {node['type']}"

    def truncate(self) -> str:
        siblings, i = self._leaf()
        del siblings[i:]
        return f"cut off after {i} children"

    def parameters(self) -> str:
        choice = int(self.random.integers(0, 3))
        if choice == 0:
            self.document["parameters"] = []
            return "no parameters"
        one = {"object": self._thing(), "quantity": self._choice(QUANTITIES)}
        if choice == 1:
            self.document["parameters"].append(one)
            return f"also {one['object']}.{one['quantity']}"
        self.document["parameters"] = [one]
        return f"only {one['object']}.{one['quantity']}"

    def number(self) -> str:
        """Put a number in place of another value."""
        siblings, i = self._leaf()
        fields = [key for key in siblings[i] if key != "type"] or ["extra"]
        siblings[i][self._choice(fields)] = self._choice(NUMBERS)
        return f"a number in {_shown(siblings[i])}"

    def nest(self) -> str:
        siblings, i = self._leaf()
        kind = self._choice(("Sequence", "Parallel"))
        siblings[i] = {"type": kind, "children": [siblings[i]]}
        return f"a {kind} about one node"

    def bury(self) -> str:
        """Put a node into many nested composites."""
        siblings, i = self._leaf()
        levels = int(self.random.integers(2, DEEPEST))
        for _ in range(levels):
            siblings[i] = {"type": "Sequence", "children": [siblings[i]]}
        return f"{levels} Sequences about one node"

    def field(self) -> str:
        """Add a field that the node does not have."""
        siblings, i = self._leaf()
        name = self._choice(("speed", "pose", "axis", "joints", "name", "force"))
        siblings[i][name] = self._choice(("", "+x", 1.0, [], "home_config"))
        return f"a {name} in {_shown(siblings[i])}"

    def spoil(self) -> str:
        """Delete a field, or set it to a value of another type; no change can follow."""
        holders: list[Document] = [self.document, *self._nodes(), *self.document["parameters"]]
        holder = self._choice(holders)
        name = self._choice(list(holder))
        if self.random.random() < 0.3:
            del holder[name]
            return f"no {name}"
        holder[name] = self._choice(ANYTHING)
        return f"{name} became {str(holder[name])[:40]}"

    def shuffle(self) -> str:
        siblings, _ = self._leaf()
        order = self.random.permutation(len(siblings))
        siblings[:] = [siblings[int(k)] for k in order]
        return "shuffled siblings"

    def _nodes(self) -> Iterator[Document]:
        waiting: list[Document] = [self.document["tree"]]
        while waiting:
            node: Document = waiting.pop()
            yield node
            waiting += node.get("children", [])

    def _leaf(self) -> Place:
        """Choose a leaf of a composite; make one in a tree without any."""
        places: list[Place] = []
        for node in self._nodes():
            children: Siblings = node.get("children", [])
            for i, child in enumerate(children):
                if "children" not in child:
                    places.append((children, i))
        if not places:
            alone: Siblings = [self._any_leaf()]
            self.document["tree"] = {"type": "Sequence", "children": alone}
            places.append((alone, 0))
        return self._choice(places)

    def _one(self, kind: str) -> Document:
        """Choose a node of a kind; insert one if there is none."""
        nodes = [node for node in self._nodes() if node["type"] == kind]
        if nodes:
            return self._choice(nodes)
        siblings, i = self._leaf()
        siblings.insert(i, self._leaf_of(kind))
        return siblings[i]

    def _any_leaf(self) -> Document:
        kinds = ("MovePose", "MovePose", "MoveJoints", "MoveUntilContact", "OpenGripper")
        return self._leaf_of(self._choice((*kinds, "CloseGripper", *SENSING, *CONVERSIONS)))

    def _leaf_of(self, kind: str) -> Document:
        if kind == "MovePose":
            pose = self._choice(self.scene.symbols.names)
            if self.random.random() < 0.7:
                pose += self._term()
            return {"type": kind, "pose": pose}
        if kind == "MoveJoints":
            home = self.scene.arm.home + self.random.normal(0, 0.5, 7)
            return {"type": kind, "joints": [round(float(a), 3) for a in home]}
        if kind == "MoveUntilContact":
            return {"type": kind, "axis": self._choice(AXES)}
        return {"type": kind}

    def _term(self) -> str:
        factor = self._choice(FACTORS)
        if self.random.random() < 0.4:
            factor = round(float(self.random.normal(0, 1.5)), 2)
        sign = "-" if factor < 0 else "+"
        return f" {sign} {abs(factor):g}*{self._choice(self.scene.symbols.offset_names)}"

    def _thing(self) -> str:
        return self._choice((*self.scene.bodies, "nobody"))

    def _choice(self, options: Any) -> Any:
        return options[int(self.random.integers(0, len(options)))]


CHANGES: tuple[Callable[[Corruption], str], ...] = (
    Corruption.delete,
    Corruption.duplicate,
    Corruption.swap,
    Corruption.replace,
    Corruption.insert,
    Corruption.elsewhere,
    Corruption.offset,
    Corruption.offset,
    Corruption.without_offset,
    Corruption.sign,
    Corruption.axis,
    Corruption.joints,
    Corruption.beside,
    Corruption.gripper,
    Corruption.truncate,
    Corruption.parameters,
    Corruption.number,
    Corruption.nest,
    Corruption.shuffle,
    Corruption.scrawl,
    Corruption.misspell,
    Corruption.bury,
    Corruption.field,
)


def corrupted(base: Base, random: np.random.Generator) -> Corrupted:
    """Corrupt a plan by one to three changes, most often one."""
    document = deepcopy(plan_json(base.plan))
    corruption = Corruption(document, base.scene, random)
    changes: list[str] = []
    for _ in range(min(MOST, int(random.geometric(0.6)))):
        change = CHANGES[int(random.integers(0, len(CHANGES)))]
        changes.append(change(corruption))
    if random.random() < SPOILT:
        changes.append(corruption.spoil())
    text = json.dumps(document, ensure_ascii=False)
    if random.random() < GARBLED:
        text, where = _garbled(text, random)
        changes.append(where)
    return Corrupted(text, tuple(changes))


def _garbled(text: str, random: np.random.Generator) -> tuple[str, str]:
    """Replace a part of the text by random characters."""
    start = int(random.integers(0, len(text)))
    length = int(random.integers(0, 12))
    noise = "".join(chr(int(c)) for c in random.integers(0, 0x2FF, int(random.integers(0, 6))))
    return text[:start] + noise + text[start + length :], f"text damaged at {start}"


def _shown(node: Document) -> str:
    arguments = ", ".join(str(v) for k, v in node.items() if k not in ("type", "name", "children"))
    return f"{node['type']}({arguments})" if arguments else str(node["type"])
