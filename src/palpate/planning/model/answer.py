"""Parsing of a model's answer: a plan in prose or code fences, nested or as a flat list of nodes.

The answer is untrusted: its size and the number of parsing attempts are bounded. Unambiguous
deviations from JSON or from the form of a plan are repaired. All others result in a finding.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
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
"""Maximum number of opening braces at which JSON is parsed."""
MAX_REPAIRED = 8
"""Maximum number of opening braces at which text is repaired."""
LARGEST_REPAIRED = 100_000
"""Characters. Maximum length of a repaired text; a plan of fifteen objects has about 20 000."""
MAX_COMMENTS = 200
"""Maximum number of block comments; the search for each end may scan the whole answer."""
MAX_OBJECTS = 100
"""Maximum number of objects in a model's scene."""

REASONING = "the answer holds reasoning alone; return the JSON object after it"
NO_JSON = "there is no JSON object in the answer; return one with parameters, explanation and tree"
NO_TREE = "the JSON object has no field 'tree'; return one with parameters, explanation and tree"
QUOTES = "JSON takes double quotes around names and texts; return the whole object again"

# An unterminated string extends to the end of the text. Otherwise each later quote would be tried
# as a start.
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
    + r"|[{,]\s*[A-Za-z_]\w*\s*:"  # a key without quotes
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
"""Tag at the start or end of a model's reasoning."""
_MARKDOWN = re.compile(r"(?<!\\)\\([_*\[\]#.-])")
_ESCAPED = {code: f"\\u{code:04x}" for code in range(0x20)}
_LITERALS = {"None": "null", "True": "true", "False": "false"}


@dataclass(frozen=True, slots=True)
class Proposal:
    """Content of an answer: a plan and, without a scene, the detected objects."""

    plan: Plan
    scene: tuple[SceneObject, ...] = ()
    bare: bool = False  # only a tree, without parameters


def read_answer(text: str) -> Proposal:
    """Return the proposal in an answer: its last JSON object with a `tree` or a list of `nodes`.

    Raises:
        InputError: there is none, or it is broken or not in the form of a plan. The message enables
            the model to repair it.
    """
    if not text.strip():
        raise InputError(
            "the answer is empty; return one JSON object with parameters, explanation and tree"
        )
    if len(text) > MAX_BYTES:
        raise InputError(
            f"the answer has {len(text)} characters, more than {MAX_BYTES}; return the JSON object only"
        )
    # Find the plan outside the reasoning, which may contain drafts.
    text = without_reasoning(reply_text(text))
    if not text.strip():
        raise InputError(REASONING)
    source, written = plan_object(text)
    # Test the depth before any recursion over the document.
    if nesting(source) > MAX_NESTING:
        raise InputError(TOO_DEEP)
    unique_json(source)
    return proposal_from(written)


def proposal_from(written: Mapping[str, Any]) -> Proposal:
    """Return the proposal in the JSON document of an answer. Raises InputError: not in the form of a plan."""
    document = normalize_plan(written)
    plan = nest_tree(document) if "nodes" in document else document
    return Proposal(parse_plan(json.dumps(plan)), scene_objects(document.get("scene") or []))


# Fields with a model's text in replies of providers, among them the arguments of a tool call.
_TEXTS = ("content", "text", "response", "arguments", "refusal")
# Values of `role`, `type` and `thought` of other texts: messages of others, and reasoning.
_OTHERS = ("user", "system", "developer", "tool", "reasoning", "thinking", True)


def reply_text(text: str) -> str:
    """Return the model's text in a saved reply or dialogue of a provider's API; other texts as they are."""
    alone = text.strip("\ufeff \t\r\n")
    if not alone.startswith(("{", "[")) or nesting(alone) > MAX_NESTING:
        return text
    try:
        document = unique_json(alone)
    except ValueError:
        return text
    texts = [] if is_plan(unwrap_plan(document)) else list(reply_texts(document))
    return "\n".join(texts) if texts else text


def reply_texts(value: object, key: str = "") -> Iterator[str]:
    """Yield the texts and plans of the model in a reply, without its reasoning; `key` is the field's name."""
    if isinstance(value, str) and key in _TEXTS:
        yield value
    elif isinstance(value, list):
        for item in cast("list[object]", value):
            yield from reply_texts(item)
    elif is_plan(value):
        yield json.dumps(value)
    elif isinstance(value, dict):
        fields = cast("dict[str, object]", value)
        if not any(fields.get(kind) in _OTHERS for kind in ("role", "type", "thought")):
            for name, inner in fields.items():
                yield from reply_texts(inner, name)


def without_reasoning(text: str) -> str:
    """Remove a model's reasoning from its answer.

    The reasoning is the text between two tags, before a single closing tag, or after a single
    opening tag. A chat template may have opened the first one. The last one belongs to a truncated
    answer.
    """
    alone = text.strip("\ufeff \t\r\n")
    value, end, _ = decode_json(alone, 0)
    if value is not None and end == len(alone):
        return text  # its strings may have tags
    # Keep the text outside the tags; a closing tag alone discards all text before it.
    kept: list[str] = []
    position, inside = 0, False
    for tag in _REASONING.finditer(text):
        closes = any(tag.groups())
        if not inside:
            kept = [] if closes else [*kept, text[position : tag.start()]]
        position, inside = tag.end(), not closes
    return "".join(kept) + ("" if inside else text[position:])


def decode_objects(text: str) -> Iterator[tuple[int, int, object, str]]:
    """Yield attempts to decode the outermost JSON objects in a text.

    Each attempt has a start, an end, the value, and the error if the value is None.
    """
    position = 0
    for _ in range(MAX_ATTEMPTS):
        opening = _OPENING.search(text, position)
        if opening is None:
            return
        start = opening.start()
        value, end, fault = decode_json(text, start)
        yield start, end, value, fault
        # Continue after a complete object, or inside a broken one, which may contain complete ones.
        position = start + 1 if value is None else end


def json_objects(text: str) -> Iterator[dict[str, Any]]:
    """Yield the outermost JSON objects in an answer, without its reasoning."""
    for _, _, value, _ in decode_objects(without_reasoning(text)):
        if isinstance(value, dict):
            yield cast("dict[str, Any]", value)


def plan_object(text: str) -> tuple[str, dict[str, Any]]:
    """Return the source and content of the last plan in a text, else of the first repairable one.

    Raises:
        InputError: there is none; the error is that of the longest attempt. Or a truncated object
            follows, because the plan before it may be a draft.
    """
    # Keep the last plan, and the error of the longest broken object.
    candidate: tuple[str, dict[str, Any]] | None = None
    problem = QUOTES if _QUOTED.search(text) else NO_JSON
    furthest = 0
    for start, end, whole, fault in decode_objects(text):
        value = unwrap_plan(whole)
        if is_plan(value):  # the first may be a draft: keep the last
            candidate = (text[start:end], cast("dict[str, Any]", value))
        elif candidate and "breaks off" in fault:
            raise InputError(fault)
        elif end - start > furthest:
            furthest, problem = end - start, fault
    if candidate is not None:
        return candidate
    # Try repairs only if no object is valid as written.
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
    """Decode the JSON value at `start`.

    Returns:
        The value, its end, and the message for an object that is no plan. For broken JSON, None
        with the place and the error.
    """
    try:
        value, end = _DECODER.raw_decode(text, start)
    except json.JSONDecodeError as error:
        # An error at the end of the text means truncation.
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
    """Repair JSON text.

    Comments, trailing commas and special blanks are removed. Python's null, true, false and single
    quotes are translated. Escapes of Markdown are removed. Control characters in strings are escaped.
    """
    if text.count("/*") > MAX_COMMENTS:
        return text

    def replace_match(match: re.Match[str]) -> str:
        # Strings are kept; only other tokens are removed or translated.
        token = match[0]
        if token[0] in "{,":
            return f'{token[0]}"{token[1:-1].strip()}":'
        if token[0] == "'":
            token = to_double_quotes(token)
        if token[0] != '"':
            return _LITERALS.get(token, " ")
        # Markdown escapes an underscore, which JSON does not.
        return _MARKDOWN.sub(r"\1", token).translate(_ESCAPED)

    text = _APART.sub(replace_match, text)
    return _TRAILING.sub(lambda match: match[0] if match[0][0] == '"' else "", text)


def to_double_quotes(token: str) -> str:
    """Convert a single-quoted string to double quotes."""
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
        # Fractions of the picture's width and height.
        left, top, right, bottom = self.bbox
        if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
            raise ValueError("bbox must be [left, top, right, bottom] with fractions from 0 to 1")
        return self


def scene_objects(value: object) -> tuple[SceneObject, ...]:
    """Return the detected objects in an answer. Raises InputError: too many objects, or an invalid one."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError("scene: must be a list of objects with name, shape and bbox")
    items = cast("Sequence[object]", value)
    if len(items) > MAX_OBJECTS:
        raise InputError(f"scene: lists {len(items)} objects, more than {MAX_OBJECTS}")
    objects: list[SceneObject] = []
    for i, item in enumerate(items):
        try:
            # Keys are redacted before any text is stored.
            read = _SceneObject.model_validate(redact_document(item))
        except ValidationError as error:
            # Report the first error alone, with its path.
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "object"
            raise InputError(f"scene[{i}]: {place}: {first['msg'][:200]}") from None
        objects.append(SceneObject(read.name, read.shape, read.bbox, read.height, read.outline))
    return tuple(objects)
