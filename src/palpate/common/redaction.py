"""Redaction of keys of the environment in all stored or shown text.

A server receives its key with every request. A hostile server can echo it: as a model's name, in an error,
in a plan, in pieces, or encoded. Text is redacted where it enters (`planning.model.session`), and again
where files are written.
"""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any, TypeVar, cast
from urllib.parse import quote

T = TypeVar("T")

BLOT = "[key]"

SHORTEST = 6  # Minimum length of a key; shorter values are placeholders such as `none`

STRETCH = 12  # Length of a part of a key that is redacted; shorter keys are redacted as a whole

_KEY_NAME = re.compile(r".*_API_KEY$")
# Patterns that begin with letters are found at the speed of a text search.
_KEY_LIKE = (
    re.compile(r"(?i:bearer\s+)[\w.~+/-]{12,}=*"),
    re.compile(r"sk-(?<=\bsk-)[\w-]{12,}"),
    re.compile(r"AIza(?<=\bAIza)[\w-]{20,}"),
)
_CREDENTIALS = re.compile(r"://[^\s/@\"'<>]+@")  # User and password in a URL
# A key in the query of a URL.
_QUERY = re.compile(
    r"([?&;](?:[\w-]*(?:key|token|secret|passw(?:or)?d|signature)|auth|sig|pwd)=)[^&;#\s\"'<>]+",
    re.I,
)

# Separators inside a spread key: white space and invisible characters.
_BETWEEN = r"[\s\u00ad\u200b-\u200f\u2060\ufeff]*"


def redact(text: str) -> str:
    """Redact keys of the environment, and texts that look like keys, in any form.

    Forms are parts of a key, spread by white space, escaped, percent-encoded, in base64 or hexadecimal.
    """
    return _remove_keys(_keys(), text)


def redact_document(content: T) -> T:
    """Redact every string of a JSON document, including names of fields."""
    return cast("T", _redact_content(content, _keys()))


def _remove_keys(keys: Iterable[str], text: str) -> str:
    """Redact `keys`, credentials, and texts that look like keys."""
    # Texts that look like keys, then the known keys in all spellings.
    for pattern in _KEY_LIKE:
        text = pattern.sub(BLOT, text)
    text = _CREDENTIALS.sub(f"://{BLOT}@", text)
    text = _QUERY.sub(rf"\1{BLOT}", text)
    for key in keys:
        text = _without_stretches(_spread(key).sub(BLOT, text), _forms(key))
    return text


def _redact_content(content: Any, keys: tuple[str, ...]) -> Any:
    if isinstance(content, str):
        return _remove_keys(keys, content)
    if isinstance(content, Mapping):
        items = cast("Mapping[Any, Any]", content).items()
        return {_redact_content(key, keys): _redact_content(value, keys) for key, value in items}
    if isinstance(content, list | tuple):
        return [_redact_content(item, keys) for item in cast("list[Any]", content)]
    return content


def _keys() -> tuple[str, ...]:
    """Return the keys in the environment, the longest first, because one may begin with another."""
    # Values of all variables that are named like keys.
    names = [name for name in os.environ if _KEY_NAME.match(name)]
    values = {os.environ[name].strip() for name in names}
    long_enough = [value for value in values if len(value) >= SHORTEST]
    return tuple(sorted(long_enough, key=lambda value: (-len(value), value)))


@lru_cache(maxsize=64)
def _spread(key: str) -> re.Pattern[str]:
    """Return the pattern of the key with each character plain or escaped (JSON, URL, XML) and separators between."""
    return re.compile(_BETWEEN.join(_spellings(character) for character in key))


def _spellings(character: str) -> str:
    # Escapes of JSON, URLs (also repeated) and XML.
    code = ord(character)
    escapes = rf"\\+u{code:04x}|\\+x{code:02x}|%(?:25)*{code:02x}|&#0*{code};|&#x0*{code:x};"
    return f"(?:{re.escape(character)}|(?i:{escapes}))"


@lru_cache(maxsize=64)
def _forms(key: str) -> tuple[str, ...]:
    """Return the encodings of the whole key."""
    data = key.encode("utf-8")
    forms = {
        key,
        key[::-1],
        key.lower(),
        key.upper(),
        quote(key, safe=""),
        data.hex(),
        data.hex().upper(),
    }
    for offset in range(3):
        # Base64 encodes 3 bytes in 4 letters. At each offset, take the letters that depend on the key
        # alone.
        encoded = base64.b64encode(bytes(offset) + data)
        first, last = (0, 2, 3)[offset], (len(data) + offset) * 4 // 3
        form = encoded.decode("ascii")[first:last]
        forms |= {form, form.replace("+", "-").replace("/", "_")}
    return tuple(forms)


def _without_stretches(text: str, forms: Iterable[str]) -> str:
    """Redact parts of `text` that are long enough parts of a form of the key."""
    # Collect the spans of all forms, and replace the merged spans.
    covered: list[tuple[int, int]] = []
    for form in forms:
        covered += _stretches(text, form)
    parts: list[str] = []
    position = 0
    for start, end in _merge_spans(covered):
        parts += [text[position:start], BLOT]
        position = end
    return "".join([*parts, text[position:]])


def _stretches(text: str, form: str) -> Iterator[tuple[int, int]]:
    """Yield the spans of `text` that equal `STRETCH` successive characters of the form."""
    # Search for every part of this width.
    width = min(STRETCH, len(form))
    for i in range(len(form) - width + 1):
        start = text.find(form[i : i + width])
        while start >= 0:
            yield start, start + width
            start = text.find(form[i : i + width], start + 1)


def _merge_spans(spans: list[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Join spans that overlap or touch."""
    # Spans in order of their start; each extends the last one or begins a new one.
    first = last = -1
    for start, end in sorted(spans):
        if start > last:
            if last >= 0:
                yield first, last
            first = start
        last = max(last, end)
    if last >= 0:
        yield first, last
