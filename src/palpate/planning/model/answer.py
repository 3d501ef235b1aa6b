"""Reading of a model's answer: the plan amid prose and code fences, nested or as a flat list of nodes.

The answer is untrusted: its size and the number of attempts at reading it are bounded. Unambiguous
deviations from JSON, or from a plan's form, are repaired; all others are left for a finding.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from palpate.common.errors import InputError
from palpate.common.redaction import redact_document
from palpate.planning.model.normal import TOO_DEEP, is_plan, nest_tree, normalize_plan, unwrap_plan
from palpate.planning.plan import MAX_BYTES, MAX_NESTING, Plan, nesting, parse_plan, unique_json
from palpate.scene.detections import SceneObject, Shape

MAX_ATTEMPTS = 200
"""Opening braces from which JSON is tried to be read."""
MAX_REPAIRED = 8
"""Opening braces from which text is tried to be repaired."""
LARGEST_REPAIRED = 100_000
"""Characters of a text to be repaired; a plan of fifteen objects has some 20 000."""
MAX_COMMENTS = 200
"""Block comments to be removed; the search for the end of each may take the whole answer."""
MAX_OBJECTS = 100
"""Objects of a scene that a model may list."""

REASONING = "the answer holds reasoning alone; return the JSON object after it"
NO_JSON = "there is no JSON object in the answer; return one with parameters, explanation and tree"
NO_TREE = "the JSON object has no field 'tree'; return one with parameters, explanation and tree"
QUOTES = "JSON takes double quotes around names and texts; return the whole object again"

# A string without an end takes the rest: else each of its quotes would be tried as a beginning.
_STRING = r'"(?:[^"\\]|\\.)*(?:"|\Z)'
_BRACE = re.compile(r"\{")
_QUOTED = re.compile(r"\{\s*['‘“]")
_OPENING = re.compile(r"\{\s*[\"}]")
_DECODER = json.JSONDecoder()
_SINGLE = r"'(?:[^'\\]|\\.)*(?:'|\Z)"
_APART = re.compile(
    _STRING
    + "|"
    + _SINGLE
    + r"|//[^\n]*|/\*.*?\*/|\b(?:None|True|False)\b|[\u00a0\u200b\u2028\ufeff]",
    re.DOTALL,
)
_TRAILING = re.compile(_STRING + r"|,(?=\s*[}\]])", re.DOTALL)
_THOUGHT = "think|thought|reason|reflection|analysis|scratch_?pad|chain_of_thought"
_REASONING = re.compile(
    # <think>, </thinking>, <seed:think>, <|begin_of_thought|>; [THINK] and ◁think▷; channels of chat templates
    rf"<\|?\s*(?P<end>/|end_of_)?(?:\w+:|begin_of_)?(?:{_THOUGHT})\w*(?:\s[^<>]{{0,200}})?\|?>"
    r"|[\[◁](?P<end2>/)?think[\]▷]|<\|channel\|>analysis|<unused94>thought|<\|channel>thought"
    r"|(?P<end3><\|channel\|>final|<unused95>|<channel\|>)",
    re.IGNORECASE,
)
"""Tag that begins or ends a model's reasoning."""
_ESCAPED = {code: f"\\u{code:04x}" for code in range(0x20)}
_LITERALS = {"None": "null", "True": "true", "False": "false"}


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
    text = without_reasoning(text)
    if not text.strip():
        raise InputError(REASONING)
    source, written = plan_object(text)
    # Before any recursion over the document.
    if nesting(source) > MAX_NESTING:
        raise InputError(TOO_DEEP)
    unique_json(source)
    document = normalize_plan(written)
    plan = nest_tree(document) if "nodes" in document else document
    return Proposal(parse_plan(json.dumps(plan)), scene_objects(document.get("scene") or []))


def without_reasoning(text: str) -> str:
    """Remove a model's reasoning from its answer: text between two tags, before a single closing tag (a chat
    template may have opened it), and after a single opening tag (the answer was cut off)."""
    alone = text.strip("\ufeff \t\r\n")
    value, end, _ = decode_json(alone, 0)
    if value is not None and end == len(alone):
        return text  # its strings may hold tags
    kept: list[str] = []
    position, inside = 0, False
    for tag in _REASONING.finditer(text):
        closes = any(tag.groups())
        if not inside:
            kept = [] if closes else [*kept, text[position : tag.start()]]
        position, inside = tag.end(), not closes
    return "".join(kept) + ("" if inside else text[position:])


def decoded_objects(text: str) -> Iterator[tuple[int, int, object, str]]:
    """Attempts at the JSON objects in a text, those inside others left out: start and end, the value,
    and, where it is None, the fault."""
    position = 0
    for _ in range(MAX_ATTEMPTS):
        opening = _OPENING.search(text, position)
        if opening is None:
            return
        start = opening.start()
        value, end, fault = decode_json(text, start)
        yield start, end, value, fault
        # Behind a whole object, else into a broken one, which may hold whole ones.
        position = start + 1 if value is None else end


def json_objects(text: str) -> Iterator[dict[str, Any]]:
    """The JSON objects in an answer, those inside others and in reasoning left out."""
    for _, _, value, _ in decoded_objects(without_reasoning(text)):
        if isinstance(value, dict):
            yield cast("dict[str, Any]", value)


def plan_object(text: str) -> tuple[str, dict[str, Any]]:
    """The source and content of the last JSON object that is a plan, else of the first that is one
    after its repair.

    Raises:
        InputError: there is none; the fault is that of the longest attempt. Or an object that breaks
            off follows: the plan before may be a draft.
    """
    found: tuple[str, dict[str, Any]] | None = None
    problem = QUOTES if _QUOTED.search(text) else NO_JSON
    furthest = 0
    for start, end, whole, fault in decoded_objects(text):
        value = unwrap_plan(whole)
        if is_plan(value):  # a draft may come first: the last plan counts
            found = (text[start:end], cast("dict[str, Any]", value))
        elif found and "breaks off" in fault:
            raise InputError(fault)
        elif end - start > furthest:
            furthest, problem = end - start, fault
    if found is not None:
        return found
    # Repair is tried only where no answer is valid JSON as written.
    for opening in islice(
        _BRACE.finditer(text if len(text) <= LARGEST_REPAIRED else ""), MAX_REPAIRED
    ):
        source = repair_json(text[opening.start() :])
        whole, end, _ = decode_json(source, 0)
        value = unwrap_plan(whole)
        if is_plan(value):
            return source[:end], cast("dict[str, Any]", value)
    raise InputError(problem)


def decode_json(text: str, start: int) -> tuple[object, int, str]:
    """The JSON value at `start`, its end, and the message for one that is no plan. A broken one is None,
    with the place and the fault."""
    try:
        value, end = _DECODER.raw_decode(text, start)
    except json.JSONDecodeError as error:
        at_end = error.pos >= len(text.rstrip()) - 1
        what = "breaks off" if at_end or "Unterminated" in error.msg else "is not valid"
        near = text[max(start, error.pos - 40) : error.pos]
        fault = f"the JSON {what} after {near!r} ({error.msg}); return the whole object again"
        return None, error.pos, fault
    except RecursionError:
        return None, len(text), TOO_DEEP
    except ValueError as error:
        return None, start + 1, f"the JSON is not usable: {error}"
    return value, end, NO_TREE


def repair_json(text: str) -> str:
    """Remove from JSON comments, trailing commas and other kinds of blanks; translate Python's words for
    null, true and false, and its single quotes. In strings, only line ends and the like are escaped."""
    if text.count("/*") > MAX_COMMENTS:
        return text

    def replace_match(match: re.Match[str]) -> str:
        token = match[0]
        if token[0] == "'":
            token = to_double_quotes(token)
        return token.translate(_ESCAPED) if token[0] == '"' else _LITERALS.get(token, " ")

    text = _APART.sub(replace_match, text)
    return _TRAILING.sub(lambda match: match[0] if match[0][0] == '"' else "", text)


def to_double_quotes(token: str) -> str:
    """A string in single quotes as one in double quotes."""
    inner = re.sub(r"\\.|\"", lambda m: {"\\'": "'", '"': '\\"'}.get(m[0], m[0]), token[1:-1])
    return f'"{inner}"'


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


def scene_objects(value: object) -> tuple[SceneObject, ...]:
    """The detected objects that an answer lists.

    Raises:
        InputError: too many, or not of their form.
    """
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError("scene: must be a list of objects with name, shape and bbox")
    items = cast("Sequence[object]", value)
    if len(items) > MAX_OBJECTS:
        raise InputError(f"scene: lists {len(items)} objects, more than {MAX_OBJECTS}")
    found: list[SceneObject] = []
    for i, item in enumerate(items):
        try:
            read = _SceneObject.model_validate(redact_document(item))
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "object"
            raise InputError(f"scene[{i}]: {place}: {first['msg'][:200]}") from None
        found.append(SceneObject(read.name, read.shape, read.bbox, read.height, read.outline))
    return tuple(found)
