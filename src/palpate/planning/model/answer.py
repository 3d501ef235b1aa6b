"""Finding the plan in what a model said: JSON amid prose and code fences, nested or as a flat list
of nodes.

The answer is untrusted: its size and the number of attempts at reading it are bounded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from palpate.errors import InputError
from palpate.planning.model.mending import mended, normal
from palpate.planning.plan import MAX_BYTES, MAX_NESTING, Plan, parse_plan
from palpate.redaction import redacted
from palpate.scene.pictured.objects import SceneObject, Shape

MAX_ATTEMPTS = 200
"""Opening braces from which JSON is tried to be read."""
MAX_MENDED = 8
"""Opening braces from which text is tried to be mended."""
LARGEST_MENDED = 100_000
"""Characters of a text that is; a plan of fifteen objects has some 20 000."""
MAX_OBJECTS = 100
"""Objects of a scene that a model may list."""

NO_JSON = "there is no JSON object in the answer; return one with parameters, explanation and tree"
NO_TREE = "the JSON object has no field 'tree'; return one with parameters, explanation and tree"

TOO_DEEP = f"the JSON is nested deeper than {MAX_NESTING} brackets; flatten the tree"
QUOTES = "JSON takes double quotes around names and texts; return the whole object again"

_BRACE = re.compile(r"\{")
_BRACKET = re.compile(r"[\[\]{}]")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_QUOTED = re.compile(r"\{\s*['‘“]")
_OPENING = re.compile(r"\{\s*[\"}]")
_DECODER = json.JSONDecoder()


@dataclass(frozen=True, slots=True)
class Proposal:
    """Content of an answer: a plan, and, without a scene, the detected objects."""

    plan: Plan
    scene: tuple[SceneObject, ...] = ()


def read_answer(text: str) -> Proposal:
    """The proposal in a model's answer: the last JSON object in it that has a `tree`, or a list of
    `nodes`.

    Raises:
        InputError: there is none, it is broken or not of a plan's form; worded so that the model
            can repair it.
    """
    if not text.strip():
        raise InputError(
            "the answer is empty; return one JSON object with parameters, explanation and tree"
        )
    if len(text) > MAX_BYTES:
        raise InputError(
            f"the answer has {len(text)} characters, more than {MAX_BYTES}; return the JSON object only"
        )
    source, written = _plan_object(text)
    if _depth(source) > MAX_NESTING:
        raise InputError(TOO_DEEP)
    document = normal(written)
    if "nodes" in document:
        source = json.dumps(nested(document))
    elif document != written:
        source = json.dumps(document)
    return Proposal(parse_plan(source), _scene_objects(document.get("scene") or []))


def nested(document: Mapping[str, Any]) -> dict[str, Any]:
    """A plan document whose tree is written as `nodes`, a list in which children are given by `id`,
    as a tree.

    Null arguments, which providers' strict schemas demand, are dropped. No nodes is no tree.

    Raises:
        InputError: an id is unknown or used twice, or the nodes do not form one tree.
    """
    plan = dict(document)
    nodes = _node_list(plan.pop("nodes"))
    if not nodes:
        return {**plan, "tree": None}
    below: list[int] = []
    for node in nodes.values():
        below += _children(node)
    roots = nodes.keys() - set(below)
    if len(roots) != 1 or len(below) != len(set(below)):
        raise InputError(
            "nodes: every node but one, the root, must be the child of exactly one other"
        )
    tree, used = _grown(roots.pop(), nodes, depth=0)
    if used != len(nodes):
        raise InputError("nodes: some are not below the root; every node must be")
    return {**plan, "tree": tree}


def json_objects(text: str) -> Iterator[dict[str, Any]]:
    """The JSON objects in a text, those inside others left out."""
    position = 0
    for _ in range(MAX_ATTEMPTS):
        opening = _OPENING.search(text, position)
        if opening is None:
            return
        value, end, _ = _decoded(text, opening.start())
        if isinstance(value, dict):
            yield cast("dict[str, Any]", value)
        position = opening.start() + 1 if value is None else end


def _plan_object(text: str) -> tuple[str, dict[str, Any]]:
    """The source and content of the last JSON object that is a plan, else of the first that is one
    once it is mended."""
    found: tuple[str, dict[str, Any]] | None = None
    problem = QUOTES if _QUOTED.search(text) else NO_JSON
    position = furthest = 0
    for _ in range(MAX_ATTEMPTS):
        opening = _OPENING.search(text, position)
        if opening is None:
            break
        start = opening.start()
        value, end, complaint = _decoded(text, start)
        if _is_plan(value):
            found = (text[start:end], cast("dict[str, Any]", value))
        elif end - start > furthest:
            furthest, problem = end - start, complaint
        position = start + 1 if value is None else end
    found = found or _mended_object(text)
    if found is None:
        raise InputError(problem)
    return found


def _mended_object(text: str) -> tuple[str, dict[str, Any]] | None:
    if len(text) > LARGEST_MENDED:
        return None
    for opening in islice(_BRACE.finditer(text), MAX_MENDED):
        source = mended(text[opening.start() :])
        value, end, _ = _decoded(source, 0)
        if _is_plan(value):
            return source[:end], cast("dict[str, Any]", value)
    return None


def _is_plan(value: object) -> bool:
    """True if it is an object with a tree, in any case."""
    if not isinstance(value, dict):
        return False
    fields = cast("dict[str, Any]", value)
    return any(key.strip().lower() in ("tree", "nodes") for key in fields)


def _depth(source: str) -> int:
    """Nesting depth of the brackets of JSON text."""
    depth = deepest = 0
    for bracket in _BRACKET.findall(_STRING.sub("", source)):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def _decoded(text: str, start: int) -> tuple[object, int, str]:
    """The JSON value at `start` with its end; None where it is broken, with the place and the
    complaint."""
    try:
        value, end = _DECODER.raw_decode(text, start)
    except json.JSONDecodeError as error:
        return None, error.pos, _complaint(error, text, start)
    except RecursionError:
        return None, len(text), TOO_DEEP
    except ValueError as error:
        return None, start + 1, f"the JSON is not usable: {error}"
    return value, end, NO_TREE


def _complaint(error: json.JSONDecodeError, text: str, start: int) -> str:
    """Fault in the JSON that begins at `start`, with its place."""
    at_end = error.pos >= len(text.rstrip()) - 1
    what = "breaks off" if at_end or "Unterminated" in error.msg else "is not valid"
    near = text[max(start, error.pos - 40) : error.pos]
    return f"the JSON {what} after {near!r} ({error.msg}); return the whole object again"


def _node_list(value: object) -> dict[int, dict[str, Any]]:
    """The nodes by id, all of whose children are there."""
    if not isinstance(value, list):
        raise InputError("nodes: must be a list")
    nodes: dict[int, dict[str, Any]] = {}
    for i, item in enumerate(cast("list[object]", value)):
        node = cast("dict[str, Any]", item) if isinstance(item, dict) else {}
        id = node.get("id")
        if not isinstance(id, int) or id in nodes:
            raise InputError(f"nodes[{i}]: needs an 'id' of its own, a whole number")
        nodes[id] = node
    for id, node in nodes.items():
        _require_children(id, node, nodes)
    return nodes


def _require_children(id: int, node: Mapping[str, Any], nodes: Mapping[int, object]) -> None:
    for child in _children(node):
        if not isinstance(child, int) or child not in nodes:
            raise InputError(
                f"nodes: node {id} has the child {str(child)[:40]}, which is not there"
            )


def _children(node: Mapping[str, Any]) -> list[Any]:
    children: object = node.get("children") or []
    if isinstance(children, list):
        return cast("list[Any]", children)
    return [children]


def _grown(
    id: int, nodes: Mapping[int, Mapping[str, Any]], depth: int
) -> tuple[dict[str, Any], int]:
    """The node with all that is below it, and how many nodes that is."""
    if depth > MAX_NESTING:
        raise InputError("nodes: the tree is nested too deep; flatten it")
    node: dict[str, Any] = {}
    for key, value in nodes[id].items():
        if value is not None and key not in ("id", "children"):
            node[key] = value
    children: list[dict[str, Any]] = []
    count = 1
    for child in _children(nodes[id]):
        below, how_many = _grown(child, nodes, depth + 1)
        children.append(below)
        count += how_many
    if children:
        node["children"] = children
    return node, count


class _SceneObject(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,59}$")
    shape: Shape
    bbox: tuple[float, float, float, float]
    height: float | None = Field(default=None, ge=-5.0, le=5.0)
    outline: tuple[tuple[float, float], ...] | None = Field(default=None, max_length=64)

    @model_validator(mode="after")
    def _is_a_box(self) -> _SceneObject:
        left, top, right, bottom = self.bbox
        if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
            raise ValueError("bbox must be [left, top, right, bottom] with fractions from 0 to 1")
        return self


def _scene_objects(value: object) -> tuple[SceneObject, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError("scene: must be a list of objects with name, shape and bbox")
    items = cast("Sequence[object]", value)
    if len(items) > MAX_OBJECTS:
        raise InputError(f"scene: lists {len(items)} objects, more than {MAX_OBJECTS}")
    return tuple(_scene_object(item, i) for i, item in enumerate(items))


def _scene_object(item: object, index: int) -> SceneObject:
    try:
        read = _SceneObject.model_validate(redacted(item))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "object"
        raise InputError(f"scene[{index}]: {place}: {first['msg'][:200]}") from None
    return SceneObject(read.name, read.shape, read.bbox, read.height, read.outline)
