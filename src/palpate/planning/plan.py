"""Plan as a type and as a file: parameters, explanation, tree.

The text of a plan comes from a file or a model and is untrusted. Its size, nesting depth and number
of nodes are bounded before anything is built from it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import Any, Literal, NoReturn, TypeVar, cast, get_args

from palpate.common.display import json_text
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.redaction import redact

T = TypeVar("T")
MAX_BYTES = 1_000_000
# Maximum depth of nested JSON brackets. A node uses two, so a tree may be about 30 deep.
MAX_NESTING = 64
MAX_NODES = 5000
MAX_REASON = 120  # Maximum number of characters of the explanation in the short form of a plan
# An unterminated string extends to the end of the text. Otherwise each later quote would be tried
# as a start, in quadratic time.
_STRING = re.compile(r'"(?:[^"\\]|\\.)*(?:"|\Z)', re.DOTALL)


@dataclass(frozen=True, slots=True)
class Node:
    """Node of a plan's tree."""

    type: str  # name of a primitive or composite
    # Arguments of a primitive (`{"pose": "bottle_pose + z_offset"}`).
    args: tuple[tuple[str, Any], ...] = ()
    children: tuple[Node, ...] = ()  # children of a composite, in order
    name: str = ""  # optional label

    def walk(self, path: str = "tree") -> Iterator[tuple[str, Node]]:
        """Yield this node and all below it, depth first, with paths (`tree.children[3]`)."""
        yield path, self
        for i, child in enumerate(self.children):
            yield from child.walk(f"{path}.children[{i}]")

    def __str__(self) -> str:
        """Format the tree as text, one node per line, with indented children."""
        lines: list[str] = []
        for path, node in self.walk():
            arguments = ", ".join(str(value) for _, value in node.args)
            depth = path.count(".children[")
            lines.append("  " * depth + node.type + (f"({arguments})" if arguments else ""))
        return "\n".join(lines)


# Outcome of a request: a tree, or no tree because all is known, nothing is measurable, or the
# request is ambiguous.
Outcome = Literal["measure", "nothing_missing", "cannot", "ambiguous"]
OUTCOMES: tuple[str, ...] = get_args(Outcome)


@dataclass(frozen=True, slots=True)
class UnmeasuredParameters:
    """Requested parameters that a plan does not measure, with a reason.

    A property without a quantity in the catalogue, such as the temperature, has no parameters.
    """

    reason: str
    parameters: tuple[Parameter, ...] = ()

    def __str__(self) -> str:
        names = ", ".join(str(parameter) for parameter in self.parameters)
        return f"{names}: {self.reason}" if names else self.reason


@dataclass(frozen=True, slots=True, repr=False)
class Plan:
    """Plan of a planner.

    `tree` is None if nothing is to be measured; the explanation gives the reason.
    """

    parameters: tuple[Parameter, ...]
    tree: Node | None
    explanation: str
    planner: str = ""
    notes: tuple[str, ...] = ()
    """Remarks for the result, e.g. that a requested quantity is known already."""
    declared: Outcome | None = None
    """Outcome declared by the author, if there is no tree."""
    proposal: tuple[Parameter, ...] = ()
    """Candidate parameters of a request that was only partly understood; to be confirmed."""
    not_used: tuple[str, ...] = ()
    """Words of that request that the proposal leaves out."""
    again: tuple[Parameter, ...] = ()
    """Elements of `parameters` that are measured again although the scene states them."""
    unmeasured: tuple[UnmeasuredParameters, ...] = ()
    """Requested parameters that are not in `parameters`; a run of the plan is then incomplete."""

    @property
    def outcome(self) -> Outcome:
        return "measure" if self.tree is not None else self.declared or "cannot"

    @property
    def satisfied(self) -> bool:
        """True if there is no tree because all requested parameters are known."""
        return self.outcome == "nothing_missing"

    @property
    def actions(self) -> int:
        """Number of atomic actions (leaves) of the tree."""
        if self.tree is None:
            return 0
        return sum(not node.children for _, node in self.tree.walk())

    def __repr__(self) -> str:
        by = f" by {self.planner}" if self.planner else ""
        if self.tree is None:
            what = "nothing to measure" if self.satisfied else "rejected"
            return f"<Plan{by}: {what}: {shorten(self.explanation, MAX_REASON, placeholder='…')}>"
        measures = ", ".join(str(parameter) for parameter in self.parameters) or "nothing"
        return f"<Plan{by}: {measures}, {self.actions} actions>"

    def __str__(self) -> str:
        """Format the short line, followed by the tree or the explanation."""
        below = self.explanation if self.tree is None else str(self.tree)
        return f"{self!r}\n{below}"


def parse_plan(text: str) -> Plan:
    """Parse a plan from JSON text: a plan file, a run's `plan.json`, or a model's answer.

    Other fields of the document (a provider's usage, findings, …) are ignored.
    Raises InputError: not JSON, too large, too deep, or not in the form of a plan; the message states the place.
    """
    # Bound the size before the text is searched.
    if len(text) > MAX_BYTES:
        raise InputError(f"the plan is larger than {MAX_BYTES // 1000} kB; shorten it")
    text = text.removeprefix("\ufeff")
    if nesting(text) > MAX_NESTING:  # before the recursive reader
        raise InputError(f"the plan is nested deeper than {MAX_NESTING} brackets; flatten its tree")
    try:
        document = unique_json(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"the plan is not JSON: {error.msg} at line {error.lineno}, column {error.colno}"
        ) from None
    except ValueError as error:
        raise InputError(f"the plan is not usable JSON: {error}") from None
    return plan_from(document)


def plan_from(document: object) -> Plan:
    """Make a plan from a parsed JSON document; an `InputError` states the place of the fault."""
    fields = _mapping(document, "a plan")
    for required in ("parameters", "tree"):
        if required not in fields:
            _fail("a plan", f"needs the field '{required}'; it has {_list_fields(fields)}")
    # Read the fields in order; each reader reports its path.
    listed = _each(_parameter, fields["parameters"], "parameters")
    parameters = tuple(parameter for parameter, _ in listed)
    again = tuple(parameter for parameter, marked in listed if marked)
    tree = fields["tree"]
    if tree is not None:
        tree = _node(tree, "tree", depth=0, budget=[MAX_NODES])
    explanation = _text(fields.get("explanation", ""), "explanation")
    planner = _text(fields.get("planner", ""), "planner")
    notes = _each(_text, fields.get("notes", []), "notes")
    # The declared outcome must agree with the presence of a tree.
    outcome = fields.get("outcome")
    if outcome is not None and outcome not in OUTCOMES:
        _fail("outcome", f"must be one of {', '.join(OUTCOMES)}")
    if tree is not None and outcome not in (None, "measure"):
        _fail("outcome", f"is '{outcome}', but there is a tree; with a tree it must be 'measure'")
    if tree is None and outcome == "measure":
        _fail("outcome", "is 'measure', but 'tree' is null; give a tree, or another outcome")
    # 'measure' and 'cannot' follow from the presence of a tree, so they are not stored.
    declared = None if outcome in (None, "measure", "cannot") else cast("Outcome", outcome)
    # Parameters that the author left out, with reasons.
    unmeasured = _each(_unmeasured, fields.get("unmeasured", []), "unmeasured")
    return Plan(
        parameters, tree, explanation, planner, notes, declared, again=again, unmeasured=unmeasured
    )


def plan_json(plan: Plan) -> dict[str, Any]:
    """Return the plan as plain JSON values; `plan_from` reads them back unchanged."""
    # Parameters that are measured again carry a mark.
    promised = zip(plan.parameters, _parameters_json(plan.parameters), strict=True)
    document: dict[str, Any] = {
        "parameters": [
            {**written, "again": True} if parameter in plan.again else written
            for parameter, written in promised
        ],
        "explanation": plan.explanation,
        "tree": _node_json(plan.tree) if plan.tree is not None else None,
        "outcome": plan.outcome,
    }
    if plan.planner:
        document["planner"] = plan.planner
    if plan.notes:
        document["notes"] = list(plan.notes)
    if plan.unmeasured:
        document["unmeasured"] = [
            {"parameters": _parameters_json(one.parameters), "reason": one.reason}
            for one in plan.unmeasured
        ]
    return document | proposal_json(plan)


def proposal_json(plan: Plan) -> dict[str, Any]:
    """Return the proposal of a plan as plain JSON values; empty without a proposal."""
    if not plan.proposal:
        return {}
    return {"proposal": _parameters_json(plan.proposal), "not_used": list(plan.not_used)}


def _parameters_json(parameters: Iterable[Parameter]) -> list[dict[str, str]]:
    return [{"object": one.object, "quantity": one.quantity} for one in parameters]


def dump_plan(plan: Plan, extra: Mapping[str, Any] | None = None) -> str:
    """Return the plan as deterministic JSON text; `extra` fields, such as a provider's usage, come last."""
    document = plan_json(plan)
    for key, value in (extra or {}).items():
        # Extra fields never replace fields of the plan.
        if key not in Plan.__slots__:
            document[key] = value
    return json_text(document, indent=2) + "\n"


def nesting(text: str) -> int:
    """Return the bracket depth of JSON text, without brackets in strings."""
    # Count brackets outside strings; unbalanced text is left to the JSON parser.
    depth = deepest = 0
    for bracket in re.findall(r"[\[\]{}]", _STRING.sub("", text)):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def unique_json(text: str) -> object:
    """Parse JSON text without duplicate fields.

    Raises:
        InputError: an object has a field twice, or a number is not finite.
        ValueError: not JSON, or too deep for the reader.
    """
    try:
        return json.loads(
            text, object_pairs_hook=_unique, parse_constant=_finite, parse_float=_finite
        )
    except RecursionError:
        raise ValueError("nested too deep") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # JSON allows duplicate fields, of which a parser would keep the last one silently.
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"the plan has the field '{key[:40]}' twice in one object; keep one")
        found[key] = value
    return found


def _finite(number: str) -> float:
    value = float(number)
    if not math.isfinite(value):
        raise InputError(f"the plan contains {number[:20]}; numbers must be finite")
    return value


FORM = (
    'a node is {"type": "MovePose", "pose": "cup_pose"}, or {"type": "Sequence", "children": [...]}'
)
"""Form of a node, for messages."""


def _node(value: object, path: str, depth: int, budget: list[int]) -> Node:
    """Read a node and its children within a depth limit and a shared node budget."""
    budget[0] -= 1  # shared by all nodes of the tree
    if budget[0] < 0:
        raise InputError(f"the plan has more than {MAX_NODES} nodes; split it")
    if depth > MAX_NESTING:
        _fail(path, "is nested too deep; flatten the tree")
    fields = _mapping(value, path)
    # Every node has a type and optionally a name.
    if "type" not in fields:
        _fail(path, f"needs the field 'type'; it has {_list_fields(fields)}; {FORM}")
    type = _text(fields["type"], f"{path}.type")
    name = _text(fields.get("name", ""), f"{path}.name")
    # All fields other than type, name and children are arguments.
    arguments: list[tuple[str, object]] = []
    for key, argument in fields.items():
        # Children under another name are a frequent error of models.
        if "children" not in fields and _lists_objects(argument):
            _fail(f"{path}.{key}", "is a list of objects; did you mean 'children'?")
        if key not in ("type", "name", "children"):
            arguments.append((_text(key, path), _frozen(argument, f"{path}.{key}")))

    def child(value: object, place: str) -> Node:
        return _node(value, place, depth + 1, budget)

    children = _each(child, fields.get("children", []), f"{path}.children")
    return Node(type, tuple(arguments), children, name)


def _lists_objects(value: object) -> bool:
    items = cast("list[object]", value) if isinstance(value, list) else []
    return bool(items) and all(isinstance(item, dict) for item in items)


def _parameter(value: object, path: str) -> tuple[Parameter, bool]:
    """Read a parameter and its mark `again`."""
    fields = _mapping(value, path)
    if set(fields) - {"again"} != {"object", "quantity"}:
        _fail(
            path,
            f"needs exactly 'object' and 'quantity', and may have 'again'; it has {_list_fields(fields)}",
        )
    again = fields.get("again")
    if not (again is None or isinstance(again, bool)):
        _fail(f"{path}.again", f"must be true or false, not {_kind(again)}")
    named = (_text(fields[key], f"{path}.{key}") for key in ("object", "quantity"))
    return Parameter(*named), bool(again)


def _unmeasured(value: object, path: str) -> UnmeasuredParameters:
    fields = _mapping(value, path)
    listed = _each(_parameter, fields.get("parameters", []), f"{path}.parameters")
    reason = _text(fields.get("reason", ""), f"{path}.reason")
    return UnmeasuredParameters(reason, tuple(parameter for parameter, _ in listed))


def _frozen(value: object, path: str) -> object:
    """Return a JSON value with arrays as tuples, so that nodes are comparable and immutable."""
    if isinstance(value, list):
        return tuple(_frozen(item, path) for item in cast("list[object]", value))
    if isinstance(value, dict):
        _fail(path, "is an object; arguments are texts, numbers or lists of them, next to 'type'")
    return _text(value, path) if isinstance(value, str) else value


def _node_json(node: Node) -> dict[str, Any]:
    # Fields in the order of the file format.
    document: dict[str, Any] = {"type": node.type}
    if node.name:
        document["name"] = node.name
    document.update(node.args)
    if node.children:
        document["children"] = [_node_json(child) for child in node.children]
    return document


def _mapping(value: object, path: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        _fail(path, f"must be a JSON object, not {_kind(value)}")
    return cast("dict[str, Any]", value)


def _each(read: Callable[[object, str], T], value: object, path: str) -> tuple[T, ...]:
    """Read every item of a list with its path."""
    if not isinstance(value, list):
        _fail(path, f"must be a list, not {_kind(value)}")
    items = cast("list[object]", value)
    return tuple(read(item, f"{path}[{i}]") for i, item in enumerate(items))


def _text(value: object, path: str) -> str:
    if not isinstance(value, str):
        _fail(path, f"must be text, not {_kind(value)}")
    # JSON escapes can make lone surrogates, which no UTF-8 file can hold.
    if any("\ud800" <= c <= "\udfff" for c in value):
        _fail(path, "contains half of a surrogate pair")
    return redact(value)  # an escaped key is complete here


def _kind(value: object) -> str:
    numbers: dict[type, str] = {bool: "true/false", int: "a number", float: "a number"}
    names = {dict: "an object", list: "a list", str: "text", **numbers}
    return names.get(type(value), "null")


def _list_fields(fields: Mapping[str, object]) -> str:
    return ", ".join(f"'{key[:40]}'" for key in list(fields)[:10]) or "none"


def _fail(path: str, problem: str) -> NoReturn:
    raise InputError(f"plan: {path[:120]} {problem}")


def part_of(plan: Plan, leaves: Collection[str]) -> Plan:
    """Reduce a plan to the leaves at the given paths (`tree.children[3]`), in their order.

    Branches of a Parallel stay together. Without any leaf, the plan has no tree.
    """
    if plan.tree is None:
        return plan
    return replace(plan, tree=_part(plan.tree, leaves, "tree"))


def _part(node: Node, leaves: Collection[str], path: str) -> Node | None:
    """Reduce a node to the wanted leaves; None without any."""
    # Leaves and Parallels are kept or removed as a whole.
    if node.type != "Sequence":
        wanted = any(found in leaves for found, _ in node.walk(path))
        return node if wanted else None
    # A Sequence keeps the children that contain wanted leaves.
    parts = [_part(child, leaves, f"{path}.children[{i}]") for i, child in enumerate(node.children)]
    kept = tuple(part for part in parts if part is not None)
    return replace(node, children=kept) if kept else None
