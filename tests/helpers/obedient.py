"""A model that thinks nothing: it does to the letter what findings say, and knows besides only what the
prompt tells, how things are taken, put down and measured.

It reads text alone: its own last answer, and the message that came back.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

from loopback import Loopback, Says

FINDING = re.compile(r"^- (\S+?)(?: \(the same at [^)]*\))?, ([\w-]+): (.*)$", re.MULTILINE)
INDEX = re.compile(r"\[(\d+)\]")

Node = dict[str, Any]


def move(pose: str) -> Node:
    return {"type": "MovePose", "pose": pose}


def leaf(type: str, **arguments: str) -> Node:
    return {"type": type, **arguments}


def taken(name: str, place: str = "pose") -> list[Node]:
    above, at = f"{name}_{place} + z_offset", f"{name}_{place}"
    return [move(above), move(at), leaf("CloseGripper"), move(above)]


def put(name: str, place: str = "pose") -> list[Node]:
    above, at = f"{name}_{place} + z_offset", f"{name}_{place}"
    return [move(above), move(at), leaf("OpenGripper"), move(above)]


def acquired(parameter: str, missing: str) -> list[Node]:
    """The recipe of the prompt for what a finding says is missing."""
    name, _ = parameter.split(".")
    if "Force2Mass" in missing:
        return [*taken(name), leaf("MeasureForces"), leaf("Force2Mass"), *put(name)]
    if "Pose2Height" in missing:
        probe = [leaf("MoveUntilContact", axis="-z"), leaf("MeasureGripperPose")]
        there = move(f"{name}_approach")
        return [there, *probe, leaf("Pose2Height"), dict(there)]
    steps = taken(name)
    if "held still in the air" in missing:
        steps.append(leaf("MeasureForces"))
    if "slides the held object" in missing:
        slide = move(f"{name}_pose + 12*x_offset")
        both = {"type": "Parallel", "children": [slide, leaf("MeasureForces")]}
        steps += [move(f"{name}_pose"), both, move(f"{name}_pose")]
    return [*steps, *put(name)]


class Answer:
    """A plan's document, edited one finding at a time; places are nodes, not indices, so that one
    edit does not move the next."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document

    def heed(self, message: str) -> None:
        """Do all that a message with findings says."""
        found = [(*self._place(path), rule, said) for path, rule, said in FINDING.findall(message)]
        done: set[tuple[int, str]] = set()
        for parent, thing, rule, said in found:
            if (id(thing), said) not in done:
                done.add((id(thing), said))
                self._obey(parent, thing, rule, said)

    def _place(self, path: str) -> tuple[list[Any] | None, Any]:
        """The list that something at a path stands in, and it."""
        steps = [int(index) for index in INDEX.findall(path)]
        if path.startswith("parameters"):
            listed = self.document["parameters"]
            return (listed, listed[steps[0]]) if steps else (None, listed)
        parent, node = None, self.document["tree"]
        for index in steps:
            parent, node = node["children"], node["children"][index]
        return parent, node

    def _obey(self, parent: list[Any] | None, thing: Any, rule: str, said: str) -> None:
        for pattern, edit in ORDERS:
            match = re.search(pattern, said)
            if match:
                edit(self, parent, thing, match)
                return

    @property
    def steps(self) -> list[Node]:
        return self.document["tree"]["children"]

    def parents(self, node: Node, below: Node | None = None) -> list[Node]:
        """The list of siblings in which a node stands."""
        below = below or self.document["tree"]
        for child in below.get("children", []):
            if child is node:
                return below["children"]
            if "children" in child and (found := self.parents(node, child)):
                return found
        return []

    def insert(self, before: Node, *nodes: Node) -> None:
        siblings = self.parents(before)
        for node in self.steps:
            if node["type"] == "Parallel" and before in node["children"]:
                before, siblings = node, self.steps
        place = next((i for i, each in enumerate(siblings) if each is before), None)
        if place is None:
            siblings, place = self.steps, self.home
        siblings[place:place] = nodes

    @property
    def home(self) -> int:
        """Where the way home at the end begins."""
        last = self.steps[-1]["type"] == "MoveJoints"
        return len(self.steps) - 1 if last else len(self.steps)


def _written(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """Write another argument: of this leaf, or of the first motion below."""
    while "children" in thing:
        thing = next(child for child in thing["children"] if child["type"] != "MeasureForces")
    thing["pose" if thing["type"] == "MovePose" else "joints"] = match[1]


def _inserted(type: str, argument: str = "") -> Callable[..., None]:
    def edit(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
        argued = {argument: match[1]} if argument else {}
        answer.insert(thing, leaf(type, **argued))

    return edit


def _carried(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """Carry something away before anything else, and back when all is done."""
    name = match[1]
    away = [*taken(name), *put(name, "temporary")]
    back = [*taken(name, "temporary"), *put(name)]
    if not any(step.get("pose") == f"{name}_temporary" for step in answer.steps):
        first = next(i for i, s in enumerate(answer.steps) if s["type"] == "OpenGripper") + 1
        answer.steps[answer.home : answer.home] = back
        answer.steps[first:first] = away


def _removed(answer: Answer, parent: list[Any], thing: Any, match: re.Match[str]) -> None:
    siblings = parent if "object" in thing else answer.parents(thing)
    siblings[:] = [each for each in siblings if each is not thing]


def _unmeasured(answer: Answer, parent: list[Any], thing: Any, match: re.Match[str]) -> None:
    """Remove a parameter with the visit that measures it."""
    _removed(answer, parent, thing, match)
    _visit_removed(answer, thing["object"])


def _left_alone(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    _visit_removed(answer, match[1])


def _visit_removed(answer: Answer, name: str) -> None:
    """Remove every step from the first pose of an object to the last."""
    of = [i for i, s in enumerate(answer.steps) if s.get("pose", "").startswith(f"{name}_")]
    if of:
        del answer.steps[of[0] : of[-1] + 1]


def _renamed(answer: Answer, parent: Any, thing: Any, match: re.Match[str]) -> None:
    """Replace a word by the one that was meant, wherever it stands below."""
    wrong, right = match[1], match[2]
    text = json.dumps(thing)
    new = json.loads(re.sub(rf"\b{re.escape(wrong)}\b", right, text))
    thing.clear()
    thing.update(new)


def _returned(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """What is still held is put back before the way home."""
    answer.steps[answer.home : answer.home] = [move(match[1]), leaf("OpenGripper")]


def _opened(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    answer.steps[answer.home : answer.home] = [leaf("OpenGripper")]


def _restored(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """The last place where an object is put becomes another, and so the way up from there."""
    opened = max(i for i, s in enumerate(answer.steps) if s["type"] == "OpenGripper")
    pose = match[1]
    answer.steps[opened:opened] = [move(f"{pose} + z_offset"), move(pose)]
    for step in answer.steps[opened + 3 :]:
        if step["type"] == "MovePose":
            step["pose"] = f"{pose} + z_offset"
            break


def _measured(answer: Answer, parent: Any, thing: Any, match: re.Match[str]) -> None:
    answer.steps[answer.home : answer.home] = acquired(match[1], match[0])


def _asked(answer: Answer, parent: Any, thing: list[Any], match: re.Match[str]) -> None:
    name, quantity = match[1].split(".")
    thing.append({"object": name, "quantity": quantity})


def _beside(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """A leaf's children become its siblings."""
    siblings = answer.parents(thing)
    place = next(i for i, each in enumerate(siblings) if each is thing) + 1
    siblings[place:place] = thing.pop("children")


def _sequential(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    thing["type"] = "Sequence"


def _dropped(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    for name in re.findall(r"'(\w+)'", match[1]):
        thing.pop(name, None)


def _explained(answer: Answer, parent: Any, thing: Any, match: re.Match[str]) -> None:
    answer.document["explanation"] = "Nothing senses it."


def _given_up(answer: Answer, parent: Any, thing: Any, match: re.Match[str]) -> None:
    answer.document["parameters"] = []


def _left_out(answer: Answer, parent: Any, thing: Any, match: re.Match[str]) -> None:
    """What cannot be done is not promised; without anything left there is no tree."""
    name = match[1]
    _visit_removed(answer, name)
    document = answer.document
    document["parameters"] = [p for p in document["parameters"] if p["object"] != name]
    document["explanation"] += f" {name} is left out."
    if not document["parameters"]:
        document["tree"] = None


LEAF = re.compile(r"([A-Z]\w+)(?: '([^']+)')?")
ARGUMENT = {"MovePose": "pose", "MoveJoints": "joints", "MoveUntilContact": "axis"}


def _first(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    """Several leaves before this one."""
    for type, argument in LEAF.findall(match[1]):
        answer.insert(thing, leaf(type, **({ARGUMENT[type]: argument} if argument else {})))


def _entered(answer: Answer, parent: Any, thing: Node, match: re.Match[str]) -> None:
    answer.insert(thing, move(match[2]))
    thing["pose"] = match[1]


ORDERS: list[tuple[str, Callable[..., None]]] = [
    (r"may follow from", lambda *_: None),
    (r"first: ((?:[A-Z]\w+(?: '[^']+')?(?:, )?)+)", _first),
    (r"write MovePose '([^']+)', and MovePose to '([^']+)' first", _entered),
    (r"write Move(?:Pose|Joints) '([^']+)'", _written),
    (r"remove (?:measurements that (?:grasp|move)|what needs) '(\w+)'", _left_out),
    (r"'(\S+?)'.* did you mean '?([\w-]+)'?\?", _renamed),
    (r"OpenGripper first|OpenGripper before", _inserted("OpenGripper")),
    (r"MovePose (?:it |higher up )?to '([^']+)' first", _inserted("MovePose", "pose")),
    (r"MoveJoints to '([^']+)' first", _inserted("MoveJoints", "joints")),
    (
        r"(MeasureForces|MeasureGripperPose) must come before",
        lambda a, p, t, m: a.insert(t, leaf(m[1])),
    ),
    (r"carry it to '(\w+)_temporary' first, and back", _carried),
    (r"'([\w-]+)' is not an object of the parameters.*do not grasp it", _left_alone),
    (r"remove it and its measurement", _unmeasured),
    (r"remove (?:this|it)|list it once|leave it out", _removed),
    (r"put it back to '([^']+)' and OpenGripper", _returned),
    (r"closed at the end; OpenGripper", _opened),
    (r"MovePose it back to '([^']+)'", _restored),
    (r"does not yield (\S+); .*", _measured),
    (r"(\S+) is requested and missing", _asked),
    (r"put them next to it", _beside),
    (r"put (?:the others|both) into a Sequence", _sequential),
    (r"takes only 'children' and 'name', not (.+)", _dropped),
    (r"explain in 'explanation'", _explained),
    (r"or no parameters and an explanation", _given_up),
]
"""What the findings order, and how it is done; the first that fits."""


class Model:
    """A model that answers `first`, and from then on does what the findings say."""

    def __init__(self, first: str) -> None:
        self.answers = [first]

    def said(self, message: str) -> str:
        """What it answers to a message."""
        asked_again = "or return the same answer again" in message
        if "The check refused the plan" in message and not asked_again:
            answer = Answer(json.loads(self.answers[-1]))
            answer.heed(message)
            self.answers.append(json.dumps(answer.document))
        return self.answers[-1]


def served(model: Model) -> Loopback:
    """It, behind a provider's wire."""
    return Loopback(answer=lambda request: Says(model.said(request.user)))
