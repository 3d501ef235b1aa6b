"""The page of the keys of palpate's YAML files, which `docs/hooks.py` adds to the site.

The meaning of a key is the comment or docstring of its field in the source.
"""

from __future__ import annotations

import ast
import inspect
import io
import tokenize
from collections.abc import Iterator
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from palpate.robots.robot_config import RobotConfig
from palpate.robots.sheet import Sheet
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.scene.poses import Poses

HEAD = """# Keys of the YAML files

Look up here each key of a poses.yaml, of a robot.yaml, of an arm's description.yaml and of a noise model. This page is
generated from the code. Unknown keys are an error. Units are SI.
"""
POSES = """
## poses.yaml

`--poses` ([poses.yaml](poses.md)). Every key is optional.
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
    files = ((POSES, Poses), (ROBOT, RobotConfig), (ARM, Sheet), (NOISE, NoiseModel))
    for head, root in files:
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
            named = "NAME." if get_origin(field.annotation) is dict else ""
            yield from _rows(inner, f"{prefix}{name}.{named}")


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
    (cls,) = ast.parse(source).body
    body = cls.body if isinstance(cls, ast.ClassDef) else []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        parts: list[str] = []
        line = node.lineno - 1
        while line in comments and lines[line - 1].lstrip().startswith("#"):
            parts.insert(0, comments[line])
            line -= 1
        span = range(node.lineno, (node.end_lineno or 0) + 1)
        parts += [comments[n] for n in span if n in comments]
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            parts.append(" ".join(str(after.value.value).split()))
        found[node.target.id] = " ".join(parts)
    return found


if __name__ == "__main__":
    print(page(), end="")
