"""Puts the prompt together: the system prompt from the module files and the vocabulary's
declarations, the rest from the task.

The system prompt holds nothing of the task and is therefore the same bytes for every one, so that
providers can cache it. In what the model reads, as in the paper, S is the system prompt, R the
request, D the incomplete simulation description, I the picture and Φ the unknown parameters.
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
"""Modules of the system prompt in the order in which they are sent, with their files."""

MODULES = (*SYSTEM_MODULES, "image", "text", "all")
"""What `--without` takes: a module of the system prompt, an input, or all of the system prompt."""

LARGEST_DESCRIPTION = 200_000
"""Characters of the scene that are sent; a longer one is refused, not cut."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """What is sent: the system prompt, the user's message, and the image files that go with it."""

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
    system = system_prompt(vocabulary, removed)
    user = user_prompt(request, scene, symbols, removed, len(images))
    shown = () if "image" in removed else tuple(images)
    return Prompt(system, user, shown)


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
    """The system prompt, less the modules in `without`; empty without all of them."""
    if "all" in without:
        return ""
    filled: list[str] = []
    for name, file in SYSTEM_MODULES.items():
        if name not in without:
            filled.append(_filled(file, vocabulary))
    return "\n".join(filled)


def user_prompt(
    request: str,
    scene: Scene | None,
    symbols: Symbols | None = None,
    without: Collection[str] = (),
    images: int = 0,
) -> str:
    """The request, the scene and the poses, each fenced as data. Without a scene, `symbols` name
    the poses."""
    if not (request.strip() or scene):
        raise InputError(
            "there is neither a request nor a scene; give a sentence, an MJCF file, or both"
        )
    parts: list[str] = []
    if "text" not in without:
        parts += [_request(request), _description(scene)]
    if scene is not None:
        symbols = scene.symbols
    if symbols and "metadata" not in without:
        parts.append(_poses(symbols))
    if images and "image" not in without:
        parts.append(_pictures(images))
    parts.append("Return Φ, the explanation and the behavior tree.")
    return "\n\n".join(parts)


def fenced(text: str, language: str = "") -> str:
    """`text` in a Markdown fence that nothing in it can close."""
    ticks = "```"
    while ticks in text:
        ticks += "`"
    return f"{ticks}{language}\n{text.rstrip()}\n{ticks}"


def _filled(file: str, vocabulary: Vocabulary) -> str:
    """A module of the system prompt, with what is declared elsewhere in place of its marks, such as
    `{{quantities}}`."""
    folder = resources.files("palpate.planning.model.prompt")
    text = folder.joinpath(file).read_text(encoding="utf-8")
    if "{{" not in text:
        return text
    for name, lines in _declared(vocabulary).items():
        text = text.replace(f"{{{{{name}}}}}", "\n".join(lines))
    return text


def _declared(vocabulary: Vocabulary) -> dict[str, list[str]]:
    """What the primitives, composites and quantities say of themselves, by mark."""
    general: list[str] = []
    conversion: list[str] = []
    for primitive in vocabulary.primitives.values():
        group = conversion if primitive.group == "conversion" else general
        group.append(_primitive_entry(primitive))
    return {
        "general": general,
        "conversion": conversion,
        "composites": [f"- {c.name}: {c.summary}" for c in vocabulary.composites.values()],
        "quantities": [_quantity_entry(quantity) for quantity in catalogue().values()],
    }


def _primitive_entry(primitive: type[Primitive]) -> str:
    fields = primitive.model_fields
    entry = f"- {primitive.__name__}({', '.join(fields)}): {primitive.summary()}"
    if primitive.reads:
        entry += f" Reads `{primitive.reads}`."
    arguments = "; ".join(f"{name}: {field.description}" for name, field in fields.items())
    if arguments:
        entry += f" {arguments[0].upper()}{arguments[1:]}."
    return entry


_SUBJECTS = {
    "gripper": "the held object or of `gripper`",
    "object": "an object",
    "surface": "a surface",
}


def _quantity_entry(quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    kind = "" if quantity.identifiable else ", not measurable"
    subject = _SUBJECTS.get(quantity.subject, f"a {quantity.subject}")
    return f"- {quantity.id}{unit}, of {subject}{kind}: {acquisition(quantity)}"


def _request(request: str) -> str:
    if request.strip():
        return f"# Request R\n{fenced(request)}"
    return "# Request R\nNone: acquire what D leaves out."


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
    if count == 1:
        return "# Image I\nAttached: the workspace now."
    return f"# Image I\nAttached: {count} views of the workspace now."


def _poses(symbols: Symbols) -> str:
    """Every name that a pose expression may use, with where it is or what it stands for."""
    lines = [_pose(name, pose) for name, pose in symbols.poses.items()]
    for name in symbols.later:
        if name not in symbols.poses:
            lines.append(f"{name}: a free spot for {symbols.subjects.get(name, 'it')}")
    for name in symbols.configurations:
        lines.append(f"{name}: joint configuration")
    for name, own in symbols.own_offsets.items():
        lines.append(f"offsets of {name}: {_offsets(own)}")
    lines.append(f"offsets of other poses: {_offsets(symbols.offsets)}")
    for name, reason in symbols.ungraspable.items():
        lines.append(f"{name} cannot be grasped: {reason}")
    return (
        "# Named poses (gripper in the world: x y z in m, direction of its x axis in degrees; offsets in m)\n"
        + fenced("\n".join(lines))
    )


def _pose(name: str, pose: Pose) -> str:
    x, y, z = pose.position
    direction = degrees(atan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return f"{name}: {x:.3f} {y:.3f} {z:.3f}, {direction:.0f}"


def _offsets(offsets: Mapping[str, Array]) -> str:
    return ", ".join(f"{name} {_offset(vector)}" for name, vector in offsets.items())


def _offset(vector: Array) -> str:
    """The length, with its sign, of an offset along one axis; the vector of any other."""
    axes = [component for component in vector if abs(component) > 1e-9]
    if len(axes) <= 1:
        return f"{max(vector, key=abs):.3f}"
    x, y, z = vector
    return f"({x:.3f}, {y:.3f}, {z:.3f})"
