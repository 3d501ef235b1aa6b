"""MJCF as MuJoCo itself describes it: what may stand where, and what an attribute may be."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco

Path_ = tuple[str, ...]

_INDENT = 3
_LINE = re.compile(r"^( *)(\S+) \((.)\) *(.*)$")
_LABEL = re.compile(r"^\.\. _([\w-]+):")
_ATTRIBUTE = re.compile(r"^:at:`(\w+)`: :at-val:`(.*)`")


@dataclass(frozen=True)
class Kind:
    """An element of the schema.

    Attributes:
        path: tags from the root to it.
        often: how often it may stand in its parent: `!` once, `?` at most once, `*` any number, `R`
            in itself, too.
    """

    path: Path_
    often: str
    attributes: tuple[str, ...]

    @property
    def tag(self) -> str:
        return self.path[-1]


@cache
def kinds() -> tuple[Kind, ...]:
    """Every element, as `mj_printSchema` lists them."""
    found: list[tuple[Path_, str, list[str]]] = []
    path: list[str] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        match = _LINE.match(line)
        if match is None:
            found[-1][2].extend(line.split())
            continue
        depth = len(match[1]) // _INDENT
        path = [*path[:depth], match[2]]
        found.append((tuple(path), match[3], match[4].split()))
    return tuple(Kind(path, often, tuple(attributes)) for path, often, attributes in found)


@cache
def types() -> dict[tuple[str, str], str]:
    """What MuJoCo's reference says an attribute is: by element and name, `real(3), "0 0 0"`."""
    reference = Path(mujoco.__file__).parent / "doc" / "XMLreference.rst"
    found: dict[tuple[str, str], str] = {}
    element = ""
    for line in reference.read_text("utf-8").splitlines():
        if label := _LABEL.match(line):
            parts = label[1].split("-")
            element = parts[-2] if len(parts) > 1 else parts[-1]
        elif attribute := _ATTRIBUTE.match(line):
            found[element, attribute[1]] = attribute[2]
    return found
