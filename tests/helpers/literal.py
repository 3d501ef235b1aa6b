"""A reader that knows no more than the text of a prompt: its primitives, quantities, named poses and offsets,
and follows its recipes to the letter. What a request means is told to it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from obedient import leaf, move

Node = dict[str, Any]
Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NUMBER = r"-?\d+(?:\.\d+)?"
PLACE = re.compile(rf"^(\S+): ({NUMBER}) ({NUMBER}) ({NUMBER}), ({NUMBER})$", re.MULTILINE)
PATTERN = re.compile(r"^X(_\w+): .*; X: (.+)$", re.MULTILINE)
OFFSETS = re.compile(
    rf"^([^:\n]+): ((?:\w+_offset {NUMBER} {NUMBER} {NUMBER}(?:, )?)+)$", re.MULTILINE
)
OFFSET = re.compile(rf"(\w+) ({NUMBER}) ({NUMBER}) ({NUMBER})")


class Unread(Exception):
    """The prompt does not say it."""


@dataclass(frozen=True)
class Reader:
    """What a prompt tells.

    Attributes:
        primitives: arguments of each, by name.
        quantities: names of those that can be measured.
        places: position in the world (3,) m, and direction of x in degrees, where one is told.
        poses: every name that a pose expression may begin with.
        offsets: vectors (3,) m in the world by name, by object or place.
    """

    primitives: dict[str, list[str]]
    quantities: set[str]
    places: dict[str, tuple[Array, float]]
    poses: set[str]
    offsets: dict[str, dict[str, Array]]

    @classmethod
    def of(cls, system: str, user: str) -> Reader:
        listed = re.findall(r"^- (\w+)\((.*?)\): ", system, re.MULTILINE)
        primitives = {name: [a for a in args.split(", ") if a] for name, args in listed}
        quantities = set(re.findall(r"^- (\w+)(?: \S+)?, of (?:an?|the)\b", system, re.MULTILINE))
        told = user.partition("# Named poses")[2]
        places = {
            name: (np.array([float(x), float(y), float(z)]), float(yaw))
            for name, x, y, z, yaw in PLACE.findall(told)
        }
        objects = [name.removesuffix("_pose") for name in places if name.endswith("_pose")]
        poses = set(places)
        for ending, whose in PATTERN.findall(told):
            having = objects if whose == "any object" else whose.split(", ")
            poses |= {f"{name}{ending}" for name in having}
        offsets: dict[str, dict[str, Array]] = {}
        for names, vectors in OFFSETS.findall(told.partition("Offsets, ")[2]):
            found = {n: np.array([float(v) for v in xyz]) for n, *xyz in OFFSET.findall(vectors)}
            offsets |= dict.fromkeys(names.split(", "), found)
        return cls(primitives, quantities, places, poses, offsets)

    @classmethod
    def without_scene(cls, system: str, user: str, scene: list[dict[str, Any]]) -> Reader:
        """What a prompt without D tells of the things that the reader lists itself."""
        told = re.search(
            r"X there has the poses (.+), a plane X has (\w+), and each has its own (.+),", user
        )
        if told is None:
            raise Unread("no poses of what is listed")
        reader = cls.of(system, user)
        for thing in scene:
            endings = told[2] if thing["shape"] == "plane" else told[1]
            reader.poses.update(f"{thing['name']}{end}" for end in re.findall(r"X(_\w+)", endings))
            vectors = dict.fromkeys(re.findall(r"\w_offset", told[3]), np.zeros(3))
            reader.offsets[thing["name"]] = vectors
        return reader

    def pose(self, name: str, **factors: float) -> str:
        """A pose expression, of names that the prompt has."""
        if name not in self.poses:
            raise Unread(f"no pose {name}")
        subject = next((s for s in self.offsets if name in (s, f"{s}_{name[len(s) + 1 :]}")), None)
        for offset in factors:
            if subject is None or offset not in self.offsets[subject]:
                raise Unread(f"no {offset} of {name}")
        return name + "".join(f" + {factor:g}*{offset}" for offset, factor in factors.items())

    def steps(self, name: str, length: float, offset: str) -> int:
        """Number of offsets of an object that make a length, m."""
        return math.ceil(length / float(np.linalg.norm(self.offsets[name][offset])))

    def leaf(self, type: str, **arguments: str) -> Node:
        if not set(arguments) <= set(self.primitives.get(type, ["-"])):
            raise Unread(f"no primitive {type}({', '.join(arguments)})")
        return leaf(type, **arguments)

    def taken(self, name: str, ending: str = "pose", **aside: float) -> list[Node]:
        at = self.pose(f"{name}_{ending}", **aside)
        above = self.pose(f"{name}_{ending}", **aside, z_offset=1.0)
        return [move(above), move(at), self.leaf("CloseGripper"), move(above)]

    def put(self, name: str, ending: str = "pose", **aside: float) -> list[Node]:
        above, at, _, _ = self.taken(name, ending, **aside)
        return [above, at, self.leaf("OpenGripper"), dict(above)]

    def visit(self, name: str, wanted: set[str]) -> list[Node]:
        """All that is wanted of one body."""
        for quantity in wanted:
            if quantity not in self.quantities:
                raise Unread(f"no quantity {quantity}")
        log, grasp = self.leaf("MeasureForces"), f"{name}_pose"
        if wanted & {"height", "stiffness", "contact_damping"}:
            there = move(self.pose(f"{name}_approach"))
            probe = [self.leaf("MoveUntilContact", axis="-z"), self.leaf("MeasureGripperPose")]
            read = [self.leaf("Pose2Height")] if "height" in wanted else []
            return [there, *probe, *read, dict(there)]
        if wanted & {"frictionloss", "damping"}:
            passes = {"type": "MoveHandle", "passes": 2}
            logged = {"type": "Parallel", "children": [passes, dict(log)]}
            above = move(self.pose(grasp, z_offset=1.0))
            return [move(self.pose(grasp)), logged, above, dict(logged)]
        weighed = [dict(log), *([self.leaf("Force2Mass")] if "mass" in wanted else [])]
        if "com" in wanted:
            steps: list[Node] = []
            for factor in (0.0, 1.0, -1.0):
                aside = {"x_offset": factor} if factor else {}
                held = weighed if not factor else [dict(log)]
                steps += [*self.taken(name, **aside), *held, *self.put(name, **aside)]
            return steps
        steps = [*self.taken(name), *weighed]
        if "friction" in wanted:
            steps.append(move(self.pose(grasp)))
            for offset, length in (("y_offset", 0.06), ("x_offset", 0.03)):
                goal = self.pose(grasp, **{offset: float(self.steps(name, length, offset))})
                steps.append({"type": "Parallel", "children": [move(goal), dict(log)]})
        return [*steps, *self.put(name)]

    def answer(
        self, parameters: list[str], explanation: str, blocking: str = "", tool: str = ""
    ) -> dict[str, Any]:
        """The plan for the parameters: `blocking` is carried away and back, the `tool` to every place
        of its use."""
        wanted: dict[str, set[str]] = {}
        for parameter in parameters:
            name, _, quantity = parameter.rpartition(".")
            wanted.setdefault(name, set()).add(quantity)
        # Heights first: what stands on a surface may be higher than is believed.
        order = sorted(wanted, key=lambda name: "height" not in wanted[name])
        body = [step for name in order for step in self.visit(name, wanted[name])]
        if blocking:
            away = [*self.taken(blocking), *self.put(blocking, "temporary")]
            body = [*away, *body, *self.taken(blocking, "temporary"), *self.put(blocking)]
        if tool:
            uses = [move(name) for name in self.places if name.endswith("_probe")]
            body = [*self.taken(tool), *uses, *self.put(tool)]
        home = self.leaf("MoveJoints", joints="home_config")
        children = [home, self.leaf("OpenGripper"), *body, dict(home)]
        listed = [
            {"object": name, "quantity": quantity}
            for name, _, quantity in (one.rpartition(".") for one in parameters)
        ]
        tree = {"type": "Sequence", "children": children} if body else None
        outcome = "measure" if tree else "cannot"
        return {"outcome": outcome, "parameters": listed, "explanation": explanation, "tree": tree}
