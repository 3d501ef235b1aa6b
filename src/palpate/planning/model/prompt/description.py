"""The scene's MJCF as it is shown to a model: without what only a renderer reads."""

from __future__ import annotations

import re

from palpate.mjcf.spans import Change, changed, remove_attribute, scan

RENDERED = frozenset({"texture", "light", "camera", "visual", "statistic", "skin"})
"""Elements that say nothing of bodies, shapes, colours or quantities."""
SHADING = (
    *("texture", "texrepeat", "texuniform", "specular", "shininess"),
    *("reflectance", "emission", "metallic", "roughness"),
)
"""Attributes of a material, without its colour."""
_COMMENT = re.compile(r"\s*<!--.*?-->", re.DOTALL)


def shown(text: str, comments: bool) -> str:
    """The text without `RENDERED` and `SHADING`, materials that state no more, and sections that become
    empty; every other byte is the user's."""
    if not comments:
        text = _COMMENT.sub("", text)
    return _without_empty(_without_rendering(text))


def _without_rendering(text: str) -> str:
    data, found, end = text.encode("utf-8"), list[Change](), 0
    for tag in scan(text):
        if tag.start < end:  # inside of what is left out
            continue
        shading = [name for name in SHADING if name in tag.attributes]
        material = tag.name == "material"
        if tag.name in RENDERED or (
            material and not {*tag.attributes} - {"name", "class", *shading}
        ):
            found.append(Change(len(data[: tag.start].rstrip()), tag.last, ""))
            end = tag.last
        elif material:
            found += [remove_attribute(data, tag, name) for name in shading]
    return changed(text, found)


def _without_empty(text: str) -> str:
    data = text.encode("utf-8")
    return changed(
        text,
        [
            Change(len(data[: tag.start].rstrip()), tag.last, "")
            for tag in scan(text)
            if tag.name == "asset" and not data[tag.end : tag.close].strip()
        ],
    )
