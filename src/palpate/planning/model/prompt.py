"""Composition of the prompt: system modules, scene and named poses."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from math import atan2, degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from palpate.common.errors import InputError, unknown_name
from palpate.common.pose import Array, Pose
from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.estimation.quantities.quantity import Quantity
from palpate.mjcf.edits import TextChange, apply_changes, remove_attribute, scan
from palpate.planning.check.check import CATALOGUE, mm
from palpate.primitives.registry import acquisition
from palpate.scene.handle_grasps import points_down
from palpate.scene.symbols import Symbols

if TYPE_CHECKING:
    from palpate.primitives.base import Primitive
    from palpate.primitives.registry import Vocabulary
    from palpate.robots.description import RobotDescription
    from palpate.scene.scene import Scene


RENDERED = frozenset({"texture", "light", "camera", "visual", "statistic", "skin"})
"""Elements without information on bodies, shapes, colours or quantities."""
SHADING = (
    *("texture", "texrepeat", "texuniform", "specular", "shininess"),
    *("reflectance", "emission", "metallic", "roughness"),
)
"""Attributes of a material other than its colour."""
_COMMENT = re.compile(r"\s*<!--.*?-->", re.DOTALL)


def strip_rendering(text: str, comments: bool) -> str:
    """Remove rendering details from an MJCF text.

    These are `RENDERED` elements, `SHADING` attributes, and materials and sections that become
    empty. All other bytes stay the same.
    """
    if not comments:
        text = _COMMENT.sub("", text)
    return _without_empty(_without_rendering(text))


def _without_rendering(text: str) -> str:
    data, changes, end = text.encode("utf-8"), list[TextChange](), 0
    for tag in scan(text):
        if tag.start < end:  # inside a removed element
            continue
        # Remove an element completely, or only the shading of a material.
        shading = [name for name in SHADING if name in tag.attributes]
        material = tag.name == "material"
        if tag.name in RENDERED or (
            material and not {*tag.attributes} - {"name", "class", *shading}
        ):
            changes.append(TextChange(len(data[: tag.start].rstrip()), tag.last, ""))
            end = tag.last
        elif material:
            changes += [remove_attribute(data, tag, name) for name in shading]
    return apply_changes(text, changes)


def _without_empty(text: str) -> str:
    data = text.encode("utf-8")
    return apply_changes(
        text,
        [
            TextChange(len(data[: tag.start].rstrip()), tag.last, "")
            for tag in scan(text)
            if tag.name == "asset" and not data[tag.end : tag.close].strip()
        ],
    )


# Section of named poses: places, name patterns of object poses, and offsets with their world
# directions.


KINDS: Mapping[str, str] = {
    "temporary": "the grasp of X with it put down on a free spot",
    "top": "above the top of X",
    "across": "a grasp of X a quarter turn on; its x_offset and y_offset turn with it",
    "balance": "where X balances, as its grasps before have shown",
}
"""Further poses of objects, by the ending of the name."""

HEAD = (
    "# Named poses\nGripper in the world: x y z in m, direction of its x axis in degrees from world x, counterclockwise"
    " seen from above. Pointing down, its y axis, along which the fingers close, is 90° clockwise from there."
)


def named_poses(symbols: Symbols) -> str:
    """Lines of all named poses, joint configurations, offsets, and objects that cannot be grasped."""
    # Poses, patterns, configurations, offsets, and reasons for objects without a grasp.
    lines = [f"{name}: {position_and_yaw(pose)}" for name, pose in symbols.poses.items()]
    lines += _patterns(symbols)
    lines += [f"{name}: joint configuration" for name in symbols.configurations]
    lines.append("Offsets, as vectors x y z in the world, m:")
    lines += _offsets(symbols)
    lines += [f"{name} cannot be grasped: {reason}" for name, reason in symbols.ungraspable.items()]
    return "\n".join(lines)


def position_and_yaw(pose: Pose) -> str:
    """Position (m) and yaw of the x axis (degrees), or the finger direction of a level hand."""
    x, y, z = (f"{value + 0.0:.3f}" for value in pose.position.round(3))
    if not points_down(pose):
        return f"{x} {y} {z}, fingers level, along {_vector(pose.rotation[:, 2])}"
    # Yaw: angle of the gripper's x axis in the horizontal plane.
    direction = degrees(atan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return f"{x} {y} {z}, {round(direction)}"


def _patterns(symbols: Symbols) -> Iterator[str]:
    """Yield a line for each kind of pose, with its objects."""
    objects = list(symbols.own_offsets)
    for kind, meaning in KINDS.items():
        # Objects whose pose of this kind is usable and not listed explicitly.
        having = [
            name
            for name in objects
            if f"{name}_{kind}" in symbols.usable and f"{name}_{kind}" not in symbols.poses
        ]
        if having:
            whose = "any object" if having == objects else ", ".join(having)
            yield f"X_{kind}: {meaning}; X: {whose}"


def _offsets(symbols: Symbols) -> Iterator[str]:
    """Yield a line for each set of offsets, with its objects and places."""
    # Group objects and places with equal offsets to shorten the prompt.
    groups: dict[str, list[str]] = {}
    for name in symbols.own_offsets:
        groups.setdefault(_vectors(symbols, f"{name}_pose"), []).append(name)
    # Poses of subjects without individual offsets are listed by name.
    places = [
        name for name in symbols.poses if symbols.subjects.get(name) not in symbols.own_offsets
    ]
    for name in places:
        groups.setdefault(_vectors(symbols, name), []).append(name)
    for vectors, names in groups.items():
        yield f"{', '.join(names)}: {vectors}"


def _vectors(symbols: Symbols, pose: str) -> str:
    """Offsets at a pose, along the world axes."""
    # Offsets of the object first, then general ones; each as a world vector at this pose.
    own = symbols.own_offsets.get(symbols.subjects.get(pose, ""), {})
    return ", ".join(
        f"{name} {_vector(symbols.shift(pose, symbols.poses[pose], symbols.offset(name, pose)))}"
        for name in dict.fromkeys([*own, *symbols.offsets])
    )


def _vector(vector: Array) -> str:
    """Components in m, to the millimetre."""
    return " ".join(f"{value + 0.0:.3f}".rstrip("0").rstrip(".") for value in vector.round(3))


# Composition: the system prompt from module files, vocabulary and rules; the user's message from
# the task.


Style = Literal["full", "lean"]
"""Style of the system prompt: with methods of measurement (full), or without (lean)."""
STYLES: tuple[Style, ...] = get_args(Style)
SYSTEM_MODULES = (
    "role",
    "actions",
    "composites",
    "reasoning_rules",
    "bt_rules",
    "metadata",
    "output",
)
"""Modules of the system prompt in order, each a Markdown file."""
MODULES = (*SYSTEM_MODULES, "image", "text", "all")
"""Names for `--without`: a module of the system prompt, an input, or the whole system prompt."""
LARGEST_DESCRIPTION = 200_000
"""Characters. Maximum length of the scene; a longer one is rejected, not truncated."""
ORDER = "Return Φ, the explanation and the behavior tree."
"""End of the planner's message."""
REMEASURE = (
    "# Measuring again\nThe user wants all that R asks for measured anew, also what D states: it is part of Φ, and "
    "`nothing_missing` is right only where R asks for nothing that can be measured."
)


@dataclass(frozen=True, slots=True)
class Prompt:
    """Prompt of one task.

    Attributes:
        system: the system prompt.
        task: R, D, robot and poses, which a critic also receives.
        images: the image files.
        order: end of the user's message, for the planner alone.
    """

    system: str
    task: str
    images: tuple[Path, ...] = ()
    order: str = ORDER

    @property
    def user(self) -> str:
        """User's message to the planner."""
        return f"{self.task}\n\n{self.order}"


def compose(
    vocabulary: Vocabulary,
    request: str,
    scene: Scene | None,
    images: Sequence[Path] = (),
    symbols: Symbols | None = None,
    without: Collection[str] = (),
    style: Style = "full",
    comments: bool = True,
    arm: RobotDescription | None = None,
    remeasure: bool = False,
) -> Prompt:
    """Compose the prompt for one task; untrusted text is fenced.

    Args:
        vocabulary: primitives and composites of plans.
        request, scene, images: R, D and I.
        symbols, arm: named poses and robot, if there is no scene.
        without: modules and inputs to leave out.
        style: style of the system prompt.
        comments: sends the comments in the scene's file, which may reveal the answer.
        remeasure: requested values are measured even where the scene states them.

    Raises:
        InputError: an unknown module in `without`, neither a request nor a scene, or a too long
            scene.
    """
    removed = check_modules(without)
    if not (request.strip() or scene):
        raise InputError(
            "there is neither a request nor a scene; give a sentence, an MJCF file, or both"
        )
    # Sections in order: request and scene, robot, named poses, pictures.
    parts: list[str] = []
    if "text" not in removed:
        asked = fence(request) if request.strip() else "None: acquire what D leaves out."
        parts += [f"# Request R\n{asked}", scene_section(scene, comments)]
        if remeasure and request.strip():
            parts.append(REMEASURE)
    # A scene brings its own poses and robot.
    if scene is not None:
        symbols, arm = scene.symbols, scene.arm
    if arm is not None and "metadata" not in removed:
        parts.append(robot_section(arm, scene.pose_world_base if scene is not None else None))
    if symbols and "metadata" not in removed:
        parts.append(f"{HEAD}\n{fence(named_poses(symbols))}")
    # Pictures come last and are attached, not embedded.
    pictures = () if "image" in removed else tuple(images)
    if pictures:
        views = "the workspace now"
        if len(pictures) > 1:
            views = f"{len(pictures)} views of {views}"
        parts.append(f"# Image I\nAttached: {views}.")
    return Prompt(system_prompt(vocabulary, removed, style), "\n\n".join(parts), pictures)


def check_modules(names: Iterable[str]) -> frozenset[str]:
    """Return the module names as a set. Raises InputError: an unknown name; the message lists the valid ones."""
    for name in names:
        if name not in MODULES:
            raise unknown_name("prompt module", name, MODULES)
    return frozenset(names)


def check_style(name: str) -> Style:
    """Return the style of this name. Raises InputError: an unknown name; the message lists the valid ones."""
    if name not in STYLES:
        raise unknown_name("prompt", name, STYLES)
    return name


def system_prompt(
    vocabulary: Vocabulary, without: Collection[str] = (), style: Style = "full"
) -> str:
    """Return the system prompt without the modules in `without`; empty without all of them."""
    if "all" in without:
        return ""
    return "\n".join(
        fill_module(f"{name}.md", vocabulary, style)
        for name in SYSTEM_MODULES
        if name not in without
    )


def fence(text: str, language: str = "") -> str:
    """Enclose `text` in a Markdown fence longer than any fence in it."""
    ticks = "```"  # Markdown closes a fence only with as many backticks as opened it
    while ticks in text:
        ticks += "`"
    return f"{ticks}{language}\n{text.rstrip()}\n{ticks}"


def fill_module(file: str, vocabulary: Vocabulary, style: Style) -> str:
    """Return a module of the system prompt with its marks, such as `{{quantities}}`, filled in."""
    text = _module(file, style)
    if "{{" not in text:
        return text
    for name, description in descriptions(vocabulary, style).items():
        text = text.replace(f"{{{{{name}}}}}", description)
    return text


def _module(file: str, style: Style) -> str:
    """Text of a module's file, with marks; a style may have its own file."""
    # A file in the folder of the style replaces the common one.
    folder = resources.files("palpate.planning.model").joinpath("prompts")
    own = folder.joinpath(style, file)
    return (own if own.is_file() else folder.joinpath(file)).read_text(encoding="utf-8")


def descriptions(vocabulary: Vocabulary, style: Style) -> dict[str, str]:
    """Return generated descriptions of primitives, composites, quantities and rules, by mark."""
    general: list[str] = []
    conversion: list[str] = []
    for primitive in vocabulary.primitives.values():
        group = conversion if primitive.group == "conversion" else general
        group.append(primitive_entry(primitive, style))
    # Each mark is replaced by a list of lines.
    heads = {quantity: quantity_head(quantity) for quantity in catalogue().values()}
    marks = {
        "general": general,
        "conversion": conversion,
        "composites": [f"- {c.name}: {c.summary}" for c in vocabulary.composites.values()],
        "quantities": [f"{head}: {acquisition(q)}" for q, head in heads.items()],
        "names of quantities": [
            head + (", derived" if q.derived else "") for q, head in heads.items()
        ],
        "goal": [_module("goal.md", style).rstrip()],
    }
    # The lean style leaves out rules that prescribe a method.
    for mark, about in (("rules of parameters", "parameters"), ("rules of the tree", "tree")):
        marks[mark] = [
            f"- {rule.id}: {rule.asks}"
            for rule in CATALOGUE.values()
            if rule.about == about and not (rule.recipe and style == "lean")
        ]
    texts = {mark: "\n".join(lines) for mark, lines in marks.items()}
    return {**texts, "purposes": "; ".join(map(str, PURPOSES))}


def primitive_entry(primitive: type[Primitive], style: Style) -> str:
    """Line of a primitive: signature, docstring, buffer and arguments."""
    fields = primitive.model_fields
    # The lean style has the capability alone, without the method.
    summary = primitive.summary() if style == "full" else primitive.capability()
    entry = f"- {primitive.__name__}({', '.join(fields)}): {summary}"
    if primitive.reads and primitive.reads not in summary:
        entry += f" Reads `{primitive.reads}`."
    schemas = primitive.model_json_schema().get("properties", {})
    arguments = "; ".join(
        f"{name}: {field.description}{argument_range(schemas[name])}"
        for name, field in fields.items()
    )
    if arguments:
        entry += f" {arguments[0].upper()}{arguments[1:]}."
    return entry


def argument_range(schema: Mapping[str, Any]) -> str:
    """Range and default of a number, as ` (5 to 45, default 35)`; empty for other arguments."""
    numbers = [form for form in schema.get("anyOf", [schema]) if "maximum" in form]
    if not numbers:
        return ""
    default = schema.get("default")
    stated = f", default {default:g}" if default is not None else ""
    return f" ({numbers[0]['minimum']:g} to {numbers[0]['maximum']:g}{stated})"


_SUBJECTS = {
    "gripper": "the held object or of `gripper`",
    "object": "an object",
    "surface": "a surface",
    "fixture": "a drawer or door",
}


def quantity_head(quantity: Quantity) -> str:
    """Name, unit and subject of a quantity."""
    # Dimensionless quantities have no unit.
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    kind = "" if quantity.identifiable else ", not measurable"
    subject = _SUBJECTS.get(quantity.subject, f"a {quantity.subject}")
    return f"- {quantity.id}{unit}, of {subject}{kind}"


def scene_section(scene: Scene | None, comments: bool) -> str:
    """Section with the user's MJCF, or with instructions to list the objects instead."""
    if scene is None:
        return (
            "# Simulation description D\nNone: list what the image shows in `scene`. What you list as X there has "
            "the poses X_pose and X_temporary, a plane X has X_approach, and each has its own x_offset, y_offset and "
            "z_offset, the last one upwards."
        )
    # A truncated scene could hide the missing parameter, so a long one is rejected.
    text = strip_rendering(scene.text, comments)
    if len(text) > LARGEST_DESCRIPTION:
        raise InputError(
            f"the scene has {len(text)} characters; at most {LARGEST_DESCRIPTION} are sent to a "
            "model: use the symbolic planner, or move assets to other files"
        )
    return (
        "# Simulation description D (MJCF, without textures, lights and cameras; absent or `?` is "
        f"unknown)\n{fence(text, 'xml')}"
    )


def robot_section(arm: RobotDescription, pose_world_base: Pose | None) -> str:
    """Section with the robot dimensions and limits that the check uses."""
    hand, limits = arm.hand, arm.limits
    half_x, half_y = hand.half_extents
    half_width = hand.opening / 2 + hand.finger  # from the middle to the outside of an open finger
    low, high = limits.workspace_min.tolist(), limits.workspace_max.tolist()
    within = (f"{axis} {a:.3g} to {b:.3g} m" for axis, a, b in zip("xyz", low, high, strict=True))
    # Hand geometry for clearances, then payload and workspace.
    lines = [
        "# Robot",
        "Hand, pointing down: the gripper's pose is that of the point between its fingertips; "
        f"{mm(hand.opening)} between the open fingers, which close along the gripper's y; the palm is "
        f"{mm(hand.palm)} above the fingertips, which end {mm(arm.tip)} beyond that point. "
        f"At a grasp the open fingers take up {mm(half_width)} to either "
        f"side along y and {mm(hand.pad)} along x, above the palm the hand {mm(half_y)} and {mm(half_x)}: "
        "whatever else reaches in there blocks.",
        f"Payload {limits.payload:g} kg. The gripper's point stays, from the base, within "
        f"{', '.join(within)}, where the arm reaches.",
    ]
    if pose_world_base is not None:
        lines.append(
            f"Base in the world, with the direction of its x axis: {position_and_yaw(pose_world_base)}."
        )
    return "\n".join(lines)
