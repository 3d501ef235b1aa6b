"""Bounded reading of user files, atomic writing, and plain YAML with schemas."""

from __future__ import annotations

import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from palpate.common.errors import InputError

MB = 1_000_000

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)

# Additional flags of O_RDONLY; not every system has all of them.
_FLAGS = sum({getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY")})


def path_of(given: object, argument: str) -> Path:
    """Convert an argument that names a file; raise InputError for another type, and for no name."""
    if isinstance(given, str | Path) and str(given):
        return Path(given)
    raise InputError(f"{argument}={str(given)[:80]!r}: give the path of a file")


def require_regular(path: Path, limit: int, what: str) -> None:
    """Check a file that a library will read by its path: a regular file of at most `limit` bytes.

    `what` names its purpose ("an MJCF scene").
    Raises InputError: it cannot be read, is no regular file, or is larger.
    """
    try:
        _require(os.stat(path), path, limit, what)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


@contextmanager
def open_with_limit(path: Path, limit: int, what: str) -> Generator[BinaryIO]:
    """Open a file of at most `limit` bytes for reading. Raises InputError: as `require_regular`."""
    require_regular(path, limit, what)
    try:
        descriptor = os.open(path, os.O_RDONLY | _FLAGS)
    except OSError as error:
        raise _unreadable(path, error) from None
    with os.fdopen(descriptor, "rb") as file:
        _require(os.fstat(descriptor), path, limit, what)
        yield file


def read_bytes(path: Path, limit: int, what: str) -> bytes:
    """Read a file of at most `limit` bytes. Raises InputError: as `require_regular`; also when it
    grows beyond the limit while it is read."""
    with open_with_limit(path, limit, what) as file:
        try:
            content = file.read(limit + 1)
        except OSError as error:
            raise _unreadable(path, error) from None
    if len(content) > limit:
        raise _too_large(path, limit, what)
    return content


def read_text(path: Path, limit: int, what: str) -> str:
    """Read and decode a file, as `read_bytes`. Raises InputError: as `read_bytes`; also when it is not UTF-8."""
    try:
        return read_bytes(path, limit, what).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not utf-8 text (byte {error.start})") from None


def _require(status: os.stat_result, path: Path, limit: int, what: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        kinds = (name for is_kind, name in _KINDS if is_kind(status.st_mode))
        kind = next(kinds, "something else")
        raise InputError(f"{path} is {kind}, not a regular file; give {what}")
    if status.st_size > limit:
        raise _too_large(path, limit, what)


def _too_large(path: Path, limit: int, what: str) -> InputError:
    size = f"{limit // MB} MB" if limit >= MB else f"{limit // 1000} kB"
    return InputError(f"{path} is larger than {size}, too large for {what}; give another")


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    reason = getattr(error, "strerror", None) or error
    return InputError(f"cannot read {path}: {reason}")


# Writing of new files: existing files stay unchanged.


@contextmanager
def writing(path: Path, remedy: str = "") -> Generator[None]:
    """Convert errors of the disk inside the block. Raises InputError: `path` cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}{remedy}") from error


def write_new(path: Path, content: str | bytes) -> None:
    """Write a new file; text as UTF-8. Raises InputError: it exists, or cannot be written."""
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another file")
    with writing(path), path.open("xb") as file:
        file.write(content.encode() if isinstance(content, str) else content)


# YAML of users: plain values of bounded size, and schemas whose errors use the file's own keys.

try:  # libyaml's parser is ten times as fast as the one in Python
    from yaml import CSafeLoader as Loader
except ImportError:
    from yaml import SafeLoader as Loader

MAX_DEPTH = 10  # Deepest nesting of lists and mappings

_OPENING = (
    yaml.BlockMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.FlowSequenceStartToken,
)
_CLOSING = (yaml.BlockEndToken, yaml.FlowMappingEndToken, yaml.FlowSequenceEndToken)


def plain_yaml(text: str, where: str) -> Any:
    """Parse a YAML text; `where` names it in messages. Raises InputError: not YAML, an alias, or
    too deep nesting; with line and column where the parser knows them."""
    try:
        # Aliases expand without bound, and deep nesting takes the parser quadratic time.
        depth, problem = 0, ""
        for token in yaml.scan(text, Loader=Loader):
            depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
            if isinstance(token, yaml.AliasToken):
                problem = "aliases are not accepted"
            elif depth > MAX_DEPTH:
                problem = f"nested deeper than {MAX_DEPTH}"
            if problem:
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=token.start_mark)
        return yaml.load(text, Loader)
    except yaml.YAMLError as error:
        # Add the position if the parser knows it.
        mark = getattr(error, "problem_mark", None)
        if mark is not None:
            where += f", line {mark.line + 1}, column {mark.column + 1}"
        raise InputError(f"{where}: not YAML: {getattr(error, 'problem', None) or error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not YAML: {error}") from None


def yaml_text(content: Any) -> str:
    """Write plain values as YAML that `plain_yaml` reads, in the given order."""
    return yaml.dump(content, Dumper=_Plain, sort_keys=False, allow_unicode=True, width=1000)


class _Plain(yaml.SafeDumper):
    """Dumper without aliases, with lists of numbers on one line."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_sequence(
        self, tag: str, sequence: Any, flow_style: bool | None = None
    ) -> yaml.SequenceNode:
        numbers = all(isinstance(part, int | float) for part in sequence)
        return super().represent_sequence(tag, sequence, flow_style=numbers or flow_style)


class Section(BaseModel):
    """Base of a file's schema: keys outside the schema are errors."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, defer_build=True
    )


def plain_number(value: Any) -> Any:
    """Validate a key that takes a number. Raises ValueError: a truth value."""
    # YAML reads `1e-3` as a text, which pydantic converts, and `yes` as a truth value.
    if isinstance(value, bool):
        raise ValueError("give a number")
    return value


def describe_error(error: ValidationError, form: type[BaseModel]) -> str:
    """Describe the first error: its key and the valid choices."""
    # Name the key by its dotted path.
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "content"
    if first["type"] == "missing":
        return f"'{key}' is missing"
    if first["type"] != "extra_forbidden":
        return f"'{key}': {first['msg'].removeprefix('Value error, ')}"
    section = form  # the section that the path to the key leads to
    # Follow the path to the innermost section.
    for part in first["loc"][:-1]:
        inner = section.model_fields[str(part)].annotation if isinstance(part, str) else None
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            section = inner
    return f"unknown key '{key}'; valid: {', '.join(sorted(section.model_fields))}"
