"""The page of the keys of palpate's YAML files, which `docs/hooks.py` adds to the site.

The meaning of a key is the comment of its field in the source.
"""

from __future__ import annotations

import ast
import inspect
import io
import tokenize
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel

from palpate.robots.robot_config import RobotConfig
from palpate.robots.sheet import Sheet
from palpate.robots.simulated.noise.model import NoiseModel

HEAD = """# Keys of the YAML files

Look up here each key of a robot.yaml, of an arm's description.yaml and of a noise model. This page is generated from
the code. Unknown keys are an error. Units are SI. [poses.yaml](poses.md) has a page of its own.
"""
ROBOT = """
## robot.yaml

`--robot-config` ([Calibrate your arm](calibration.md)). Every key is optional. A measured figure also takes `date` and
`by`, its method.
"""
ARM = """
## description.yaml

`--arm PATH/` ([Describe another arm](arms.md)). With `like: NAME`, absent keys from `reach` on are those of that arm.
"""
NOISE = """
## Noise model

`--noise FILE.yaml` ([Noise models](noise.md#a-file-of-your-own)). Every key is optional. `robot;`, `run;`, `rest;` or
`sample;` says when a size is drawn.
"""
COMMON = {"date", "by"}


def page() -> str:
    """Write the page's Markdown."""
    parts = [HEAD]
    for head, root in ((ROBOT, RobotConfig), (ARM, Sheet), (NOISE, NoiseModel)):
        parts += [head, "| key | meaning |", "|---|---|", *_rows(root)]
    return "\n".join(parts) + "\n"


def _rows(section: type[BaseModel], prefix: str = "") -> Iterator[str]:
    comments = _comments(section)
    for name, field in section.model_fields.items():
        inner = _section_of(field.annotation)
        meaning = comments.get(name) or (_doc(inner) if inner else "")
        key = f"`{prefix}{name}`"
        if name not in COMMON:
            shown = f"**{key}**" if inner and not prefix else key
            yield f"| {shown} | {meaning.replace('|', chr(92) + '|')} |"
        if inner:
            yield from _rows(inner, f"{prefix}{name}.")


def _doc(section: type[BaseModel]) -> str:
    return " ".join((inspect.getdoc(section) or "").split())


def _section_of(annotation: Any) -> type[BaseModel] | None:
    """The section in an annotation such as `Section | None` or `tuple[Section, ...]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_section_of, get_args(annotation))), None)


def _comments(section: type[BaseModel]) -> dict[str, str]:
    """Comments of a section's fields, those of its bases included: behind a field, or above it."""
    found: dict[str, str] = {}
    for cls in reversed(section.__mro__):
        if issubclass(cls, BaseModel) and cls.__module__.startswith("palpate."):
            found |= _own_comments(inspect.getsource(cls))
    return found


def _own_comments(source: str) -> dict[str, str]:
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {t.start[0]: t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT}
    lines = source.splitlines()
    found: dict[str, str] = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            above: list[str] = []
            line = node.lineno - 1
            while line in comments and lines[line - 1].lstrip().startswith("#"):
                above.insert(0, comments[line])
                line -= 1
            behind = [
                comments[n] for n in range(node.lineno, (node.end_lineno or 0) + 1) if n in comments
            ]
            found[node.target.id] = " ".join([*above, *behind])
    return found


if __name__ == "__main__":
    print(page(), end="")
