"""Puts the prompt together: S from the module files and the vocabulary's declarations, the rest
from the task.

S holds nothing of the task and is therefore the same bytes for every one, so that providers can
cache it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from math import atan2, degrees
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError, unknown_name
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Quantity
from palpate.vocabulary.registry import acquisition

if TYPE_CHECKING:
    from palpate.geometry.pose import Array, Pose
    from palpate.scene.scene import Scene
    from palpate.scene.symbols import Symbols
    from palpate.vocabulary.base import Primitive
    from palpate.vocabulary.registry import Vocabulary

SYSTEM_MODULES = {
    "role": "role.md",
    "actions": "actions.md",
    "composites": "composites.md",
    "reasoning_rules": "reasoning.md",
    "bt_rules": "bt_rules.md",
    "metadata": "metadata.md",
    "output": "output.md",
}
"""Modules of S in the order in which they are sent, with their files."""

MODULES = (*SYSTEM_MODULES, "image", "text", "all")
"""What `--without` takes: a module of S, an input, or all of S."""

LARGEST_DESCRIPTION = 200_000
"""Characters of D that are sent; a longer one is refused, not cut."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """What is sent: S, the user's message, and the image files that go with it."""

    system: str
    user: str
    images: tuple[Path, ...] = ()


def compose(
    vocabulary: Vocabulary,
    request: str,
    scene: Scene | None,
    images: Sequence[Path] = (),
    symbols: Symbols | None = None,
    without: Collection[str] = (),
) -> Prompt:
    """The whole prompt for one task.

    Raises:
        InputError: an unknown module in `without`, neither a request nor a scene, or one that is
            too long.
    """
    removed = checked_modules(without)
    return Prompt(
        system_prompt(vocabulary, removed),
        user_prompt(request, scene, symbols, removed, len(images)),
        () if "image" in removed else tuple(images),
    )


def checked_modules(names: Iterable[str]) -> frozenset[str]:
    """The names as a set.

    Raises:
        InputError: one is not a module; the message lists those there are.
    """
    for name in names:
        if name not in MODULES:
            raise unknown_name("prompt module", name, MODULES)
    return frozenset(names)


def system_prompt(vocabulary: Vocabulary, without: Collection[str] = ()) -> str:
    """S, less the modules in `without`; the empty string without all of them."""
    if "all" in without:
        return ""
    kept = [file for name, file in SYSTEM_MODULES.items() if name not in without]
    return "\n".join(_filled(file, vocabulary) for file in kept)


def user_prompt(
    request: str,
    scene: Scene | None,
    symbols: Symbols | None = None,
    without: Collection[str] = (),
    images: int = 0,
) -> str:
    """R, D and the poses, each fenced as data. Without a scene, `symbols` name the poses."""
    text = "text" not in without
    symbols = scene.symbols if scene else symbols
    parts = [
        _request(request) if text else "",
        _description(scene) if text else "",
        _poses(symbols) if symbols and "metadata" not in without else "",
        _pictures(images) if "image" not in without else "",
        "Return Φ, the explanation and the behavior tree.",
    ]
    if not (request.strip() or scene):
        raise InputError(
            "there is neither a request nor a scene; give a sentence, an MJCF file, or both"
        )
    return "\n\n".join(part for part in parts if part)


def fenced(text: str, language: str = "") -> str:
    """`text` in a Markdown fence that nothing in it can close."""
    ticks = "```"
    while ticks in text:
        ticks += "`"
    return f"{ticks}{language}\n{text.rstrip()}\n{ticks}"


def _filled(file: str, vocabulary: Vocabulary) -> str:
    text = (
        resources.files("palpate.planning.model.prompt").joinpath(file).read_text(encoding="utf-8")
    )
    if "{{" not in text:
        return text
    primitives = vocabulary.primitives.values()
    entries = {
        "general": [_primitive_entry(p) for p in primitives if p.group != "conversion"],
        "conversion": [_primitive_entry(p) for p in primitives if p.group == "conversion"],
        "composites": [f"- {c.name}: {c.summary}" for c in vocabulary.composites.values()],
        "quantities": [_quantity_entry(q) for q in catalogue().values()],
    }
    for name, lines in entries.items():
        text = text.replace(f"{{{{{name}}}}}", "\n".join(lines))
    return text


def _primitive_entry(primitive: type[Primitive]) -> str:
    arguments = "; ".join(
        f"{name}: {field.description}" for name, field in primitive.model_fields.items()
    )
    buffers = f" Reads `{primitive.reads}`." if primitive.reads else ""
    return (
        f"- {primitive.__name__}({', '.join(primitive.model_fields)}): {primitive.summary()}{buffers}"
        + (f" {arguments[0].upper()}{arguments[1:]}." if arguments else "")
    )


def _quantity_entry(quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    kind = "" if quantity.identifiable else ", not measurable"
    subject = {"gripper": "the held object or of `gripper`", "object": "an object"}.get(
        quantity.subject, f"a {quantity.subject}"
    )
    return f"- {quantity.id}{unit}, of {subject}{kind}: {acquisition(quantity)}"


def _request(request: str) -> str:
    return (
        f"# Request R\n{fenced(request)}"
        if request.strip()
        else "# Request R\nNone: acquire what D leaves out."
    )


def _description(scene: Scene | None) -> str:
    if scene is None:
        return (
            "# Simulation description D\nNone: list what the image shows in `scene`. What you list as X there has "
            "the poses X_pose and X_temporary, a plane X has X_approach, and every object its own offsets."
        )
    if len(scene.text) > LARGEST_DESCRIPTION:
        raise InputError(
            f"the scene has {len(scene.text)} characters; at most {LARGEST_DESCRIPTION} are sent to a "
            "model: use the symbolic planner, or move assets to other files"
        )
    return (
        f"# Simulation description D (MJCF; absent or `?` is unknown)\n{fenced(scene.text, 'xml')}"
    )


def _pictures(count: int) -> str:
    if count == 0:
        return ""
    return "# Image I\nAttached: " + (
        "the workspace now." if count == 1 else f"{count} views of the workspace now."
    )


def _poses(symbols: Symbols) -> str:
    lines = [
        *(_pose(name, pose) for name, pose in symbols.poses.items()),
        *(
            f"{name}: a free spot for {symbols.subjects.get(name, 'it')}"
            for name in symbols.later
            if name not in symbols.poses
        ),
        *(f"{name}: joint configuration" for name in symbols.configurations),
        *(f"offsets of {name}: {_offsets(own)}" for name, own in symbols.own_offsets.items()),
        f"offsets of other poses: {_offsets(symbols.offsets)}",
        *(f"{name} cannot be grasped: {reason}" for name, reason in symbols.ungraspable.items()),
    ]
    return (
        "# Named poses (gripper in the world: x y z in m, direction of its x axis in degrees; offsets in m)\n"
        + fenced("\n".join(lines))
    )


def _pose(name: str, pose: Pose) -> str:
    x, y, z = pose.position
    return f"{name}: {x:.3f} {y:.3f} {z:.3f}, {degrees(atan2(pose.rotation[1, 0], pose.rotation[0, 0])):.0f}"


def _offsets(offsets: Mapping[str, Array]) -> str:
    """Each with its length, or as a vector where it lies along no single axis."""
    return ", ".join(
        f"{name} {max(v, key=abs):.3f}"
        if sum(abs(v) > 1e-9) <= 1
        else f"{name} ({', '.join(f'{c:.3f}' for c in v)})"
        for name, v in offsets.items()
    )
