"""The names a plan may use for poses, joint configurations and offsets, and the grammar of pose
expressions.

Names come from the scene and `poses.yaml`; what is absent there is derived from the geometry:

- `<object>_pose`: TCP pose of a top-down grasp; `<object>_temporary`: TCP pose at which the held
  object, grasped there, stands on a free spot of its surface.
- `<surface>_approach`: TCP pose above a free spot of the surface.
- `home_config`: joint configuration, the arm's own unless poses.yaml names another.
- `x_offset`, `y_offset`: along the tool's x and y at the base pose, horizontal, scaled to the
  object so that twice the offset is still on it where it can be; `z_offset`: along world z, high
  enough that the object clears its neighbours.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array, Pose

MAX_EXPRESSION = 200
"""Characters of a pose expression."""

DEFAULT_OFFSETS: Mapping[str, tuple[float, float, float]] = {
    "x_offset": (0.05, 0.0, 0.0),
    "y_offset": (0.0, 0.05, 0.0),
    "z_offset": (0.0, 0.0, 0.12),
}
"""m: for places that belong to no object."""

_FACTOR = r"\(?([-−]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\)?"
_TERM = re.compile(rf"\s*([+\-−])\s*(?:{_FACTOR}\s*\*?\s*)?([^\W\d][\w.]*)")


@dataclass(frozen=True, slots=True)
class PoseExpression:
    """`NAME (± [α *] OFFSET)*`, like terms merged and in alphabetical order, so that equal means
    the same text."""

    name: str
    terms: tuple[tuple[float, str], ...] = ()

    def __str__(self) -> str:
        return self.name + "".join(
            _term_text(coefficient, offset) for coefficient, offset in self.terms
        )


def _term_text(coefficient: float, offset: str) -> str:
    sign, size = ("-" if coefficient < 0 else "+"), abs(coefficient)
    return f" {sign} {offset}" if size == 1 else f" {sign} {size:g}*{offset}"


@dataclass(eq=False)
class Symbols:
    """What expressions may name.

    Attributes:
        poses: TCP poses in the world by name.
        subjects: pose name to the object or surface it belongs to.
        configurations: joint configurations by name, (7,) rad.
        offsets: offset name to vector (3,) m: tool x, tool y, world z; for any pose.
        own_offsets: object to its own offsets, which come first.
        ungraspable: object to the reason why the hand cannot take it.
        later: names of poses that are worked out when first asked for, with how.
    """

    poses: Mapping[str, Pose]
    subjects: Mapping[str, str]
    configurations: Mapping[str, Array]
    offsets: Mapping[str, Array]
    own_offsets: Mapping[str, Mapping[str, Array]]
    ungraspable: Mapping[str, str] = field(default_factory=dict[str, str])
    later: Mapping[str, Callable[[], Pose | None]] = field(
        default_factory=dict[str, "Callable[[], Pose | None]"]
    )
    _found: dict[str, Pose | None] = field(
        default_factory=dict[str, "Pose | None"], init=False, repr=False
    )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every name of a pose, longest first."""
        return tuple(sorted({*self.poses, *self.later}, key=lambda n: (-len(n), n)))

    @cached_property
    def offset_names(self) -> tuple[str, ...]:
        """Every name of an offset."""
        own = (name for offsets in self.own_offsets.values() for name in offsets)
        return tuple(sorted({*self.offsets, *own}))

    def parse(self, expression: str) -> PoseExpression:
        """Read a pose expression; aliases (`hammer`, `z_off`, `+z`) become full names.

        Raises:
            InputError: not of the grammar, or unknown names; the message lists the valid ones.
        """
        if len(expression) > MAX_EXPRESSION:
            raise InputError(
                f"pose expression of {len(expression)} characters; at most {MAX_EXPRESSION}"
            )
        text = expression.strip()
        name, rest = self._leading_name(text)
        terms: dict[str, float] = {}
        position = 0
        while position < len(rest):
            match = _TERM.match(rest, position)
            if match is None:
                raise InputError(
                    f"cannot read '{rest[position:].strip()}' in pose expression '{text}'; "
                    "write NAME + 0.5*x_offset - z_offset"
                )
            offset = self._offset_name(match[3])
            terms[offset] = terms.get(offset, 0.0) + _coefficient(match, text)
            position = match.end()
        return PoseExpression(
            name, tuple((c, o) for o, c in sorted(terms.items()) if abs(c) > 1e-12)
        )

    def resolve(self, expression: str | PoseExpression) -> Pose:
        """The TCP pose in the world that an expression stands for.

        Raises:
            InputError: as `parse`; or a temporary place that the scene has no room for.
        """
        parsed = self.parse(expression) if isinstance(expression, str) else expression
        base = self.pose(parsed.name)
        shift = sum((c * self.offset(o, parsed.name) for c, o in parsed.terms), np.zeros(3))
        return base.translated(_in_world(base, shift)) if parsed.terms else base

    def pose(self, name: str) -> Pose:
        """The pose of a name without offsets.

        Raises:
            InputError: unknown, or there is no room for it.
        """
        if name in self.poses:
            return self.poses[name]
        if name not in self.later:
            raise unknown_name("pose", name, self.names)
        if name not in self._found:
            self._found[name] = self.later[name]()
        found = self._found[name]
        if found is None:
            raise InputError(
                f"there is no free place within reach for '{name}'; give one in poses.yaml"
            )
        return found

    def offset(self, name: str, pose: str) -> Array:
        """The vector (3,) m that an offset is at a named pose: along tool x, along tool y, along
        world z."""
        own = self.own_offsets.get(self.subjects.get(pose, ""), {})
        if name in own:
            return own[name]
        if name not in self.offsets:
            raise unknown_name("offset", name, [*self.offsets, *own], f"It is used with '{pose}'.")
        return self.offsets[name]

    def joints(self, name: str) -> Array:
        """(7,) rad, a named joint configuration.

        Raises:
            InputError: unknown; the message lists the valid ones.
        """
        if name not in self.configurations:
            raise unknown_name("joint configuration", name, self.configurations)
        return self.configurations[name].copy()

    def subject(self, expression: str | PoseExpression) -> str | None:
        """The object or surface an expression's name belongs to."""
        parsed = self.parse(expression) if isinstance(expression, str) else expression
        return self.subjects.get(parsed.name)

    def _leading_name(self, text: str) -> tuple[str, str]:
        for name in (*self.names, *sorted(self._aliases, key=len, reverse=True)):
            rest = text[len(name) :]
            if text.startswith(name) and (not rest.strip() or rest.lstrip()[0] in "+-−"):
                return self._aliases.get(name, name), rest
        shown = re.split(r"[+\-−*]", text)[0].strip() or text
        raise unknown_name("pose", shown, self.names)

    @cached_property
    def _aliases(self) -> dict[str, str]:
        """`hammer` for `hammer_pose`, where nothing else is called so."""
        return {
            subject: f"{subject}_pose"
            for subject in self.subjects.values()
            if f"{subject}_pose" in self.poses and subject not in self.poses
        }

    def _offset_name(self, written: str) -> str:
        candidates = (
            written,
            f"{written}_offset",
            f"{written.removesuffix('_off')}_offset",
            f"{written.removesuffix('off')}_offset",
        )
        found = next((c for c in candidates if c in self.offset_names), None)
        if found is None:
            raise unknown_name("offset", written, self.offset_names)
        return found


def _coefficient(match: re.Match[str], text: str) -> float:
    size = float(match[2].replace("−", "-")) if match[2] else 1.0
    if not math.isfinite(size) or abs(size) > 1000:
        raise InputError(f"'{match[2][:40]}' in pose expression '{text}' is not a sensible factor")
    return size if match[1] == "+" else -size


def _in_world(base: Pose, shift: Array) -> Array:
    """A shift along tool x, tool y (both laid level) and world z, in world axes."""
    x, y, z = shift
    return (
        _level(base.rotation[:, 0]) * x + _level(base.rotation[:, 1]) * y + np.array([0.0, 0.0, z])
    )


def _level(axis: Array) -> Array:
    flat = np.array([axis[0], axis[1], 0.0])
    length = float(np.linalg.norm(flat))
    return flat / length if length > 1e-6 else np.zeros(3)


def vectors(entries: Mapping[str, float | Iterable[float]]) -> dict[str, Array]:
    """Offsets as poses.yaml writes them: a vector, or a length along the axis that the name begins
    with."""
    made: dict[str, Array] = {}
    for name, value in entries.items():
        if isinstance(value, int | float):
            axis = "xyz".find(name[0])
            if axis < 0 or not name.endswith("_offset"):
                raise InputError(
                    f"offset '{name}' is one number; only x_offset, y_offset, z_offset may be, "
                    "others are [x, y, z]"
                )
            made[name] = float(value) * np.eye(3)[axis]
        else:
            made[name] = np.array(list(value), dtype=float)
    return made
