"""The names a plan may use for poses, joint configurations and offsets, and the grammar of pose
expressions.

Names come from the scene and `poses.yaml`; what is absent there is derived from the geometry:

- `<object>_pose`: TCP pose of a top-down grasp; `<object>_temporary`: TCP pose at which the held
  object, grasped there, stands on a free spot of its surface; `<object>_across`: a grasp a quarter
  turn on, where that fits; `<object>_top`: TCP pose above its top.
- `<object>_balance`: the grasp, moved along the tool's x, by up to two x_offsets, to where the object
  balances: as is believed, or as a run has measured by the time that it first goes there.
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
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Array, Line, Pose
from palpate.scene.poses import Poses

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
        return self.name + "".join(_term_text(*term) for term in self.terms)

    def shifted(self, offset: str, factor: float) -> PoseExpression:
        """The same, and `factor` times an offset more, rounded to hundredths."""
        terms = {name: coefficient for coefficient, name in self.terms}
        terms[offset] = round(terms.get(offset, 0.0) + factor, 2)
        left = [(coefficient, name) for name, coefficient in sorted(terms.items()) if coefficient]
        return PoseExpression(self.name, tuple(left))


def _term_text(coefficient: float, offset: str) -> str:
    sign, size = ("-" if coefficient < 0 else "+"), abs(coefficient)
    if size == 1:
        return f" {sign} {offset}"
    return f" {sign} {size:g}*{offset}"


@dataclass(eq=False)
class Symbols:
    """Symbols that expressions may name.

    Attributes:
        poses: TCP poses in the world by name.
        subjects: pose name to the object or surface it belongs to.
        configurations: joint configurations by name, (7,) rad.
        offsets: offset name to vector (3,) m: tool x, tool y, world z; for any pose.
        own_offsets: object to its own offsets, which come first.
        ungraspable: object to the reason why the hand cannot take it.
        later: names of poses that are worked out when first asked for, with how.
        lines: names of poses of which a run finds out where along a line they are.
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
    lines: Mapping[str, Line] = field(default_factory=dict[str, Line])
    _found: dict[str, Pose | None] = field(
        default_factory=dict[str, "Pose | None"], init=False, repr=False
    )
    _read: dict[str, PoseExpression] = field(
        default_factory=dict[str, PoseExpression], init=False, repr=False
    )
    """Expressions that were read: a search asks for the same ones again and again."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every name of a pose, longest first."""
        every = {*self.poses, *self.later, *self.lines}
        return tuple(sorted(every, key=lambda n: (-len(n), n)))

    @cached_property
    def offset_names(self) -> tuple[str, ...]:
        """Every name of an offset."""
        names = set(self.offsets)
        for own in self.own_offsets.values():
            names.update(own)
        return tuple(sorted(names))

    def parse(self, expression: str) -> PoseExpression:
        """A pose expression; aliases (`hammer`, `z_off`, `+z`) become full names.

        Raises:
            InputError: not of the grammar, or unknown names; the message lists the valid ones.
        """
        if expression not in self._read:
            self._read[expression] = self._reading(expression)
        return self._read[expression]

    def _reading(self, expression: str) -> PoseExpression:
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
        # What cancels is left out: `a + z_offset - z_offset` is `a`.
        left = [
            (coefficient, o) for o, coefficient in sorted(terms.items()) if abs(coefficient) > 1e-12
        ]
        return PoseExpression(name, tuple(left))

    def found_out(self, expression: str) -> str | None:
        """The pose in an expression of which a run finds out where it is; None where there is none, or
        the expression is none."""
        try:
            name = self.parse(expression).name
        except InputError:
            return None
        return name if name in self.lines else None

    def resolve(
        self, expression: str | PoseExpression, bound: Mapping[str, float] | None = None
    ) -> Pose:
        """The TCP pose in the world that an expression stands for; `bound` says where along their
        lines, m, poses are that are not where they are believed.

        Raises:
            InputError: as `parse`; a temporary place that the scene has no room for; or a place
                outside its line.
        """
        parsed = self._parsed(expression)
        base = self.pose(parsed.name, bound)
        if not parsed.terms:
            return base
        shift = np.zeros(3)
        for coefficient, offset in parsed.terms:
            shift = shift + coefficient * self.offset(offset, parsed.name)
        return base.translated(in_world(base, shift))

    def pose(self, name: str, bound: Mapping[str, float] | None = None) -> Pose:
        """The pose of a name without offsets; `bound` as for `resolve`.

        Raises:
            InputError: unknown, there is no room for it, or it is bound to a place outside its line.
        """
        if name in self.poses:
            return self.poses[name]
        if name in self.lines:
            return self._on_line(name, bound or {})
        if name not in self.later:
            raise unknown_name("pose", name, self.names)
        found = self._later(name)
        if found is None:
            raise InputError(
                f"there is no free place within reach for '{name}'; give one in poses.yaml"
            )
        return found

    def _later(self, name: str) -> Pose | None:
        if name not in self._found:
            self._found[name] = self.later[name]()
        return self._found[name]

    def _on_line(self, name: str, bound: Mapping[str, float]) -> Pose:
        line = self.lines[name]
        try:
            return line.at(bound.get(name, line.believed))
        except InputError as error:
            raise InputError(f"'{name}': {error}") from None

    def offset(self, name: str, pose: str) -> Array:
        """The vector (3,) m that an offset is at a named pose: along tool x, along tool y, along
        world z."""
        own = self.own_offsets.get(self.subjects.get(pose, ""), {})
        if name in own:
            return own[name]
        if name not in self.offsets:
            raise unknown_name("offset", name, [*self.offsets, *own], f"It is used with '{pose}'.")
        return self.offsets[name]

    def raised(self, rises: Mapping[str, float], places: Mapping[str, float]) -> Symbols:
        """The same names with the poses of some objects and surfaces higher, `rises` in m by object or
        surface; `places` holds the m for poses that do not move with their subject."""

        def up(name: str) -> Array:
            of_subject = rises.get(self.subjects.get(name, ""), 0.0)
            return np.array([0.0, 0.0, places.get(name, of_subject)])

        def found_later(name: str) -> Pose | None:
            pose = self._later(name)
            return None if pose is None else pose.translated(up(name))

        return replace(
            self,
            poses={name: pose.translated(up(name)) for name, pose in self.poses.items()},
            later={name: partial(found_later, name) for name in self.later},
            lines={
                name: replace(line, pose=line.pose.translated(up(name)))
                for name, line in self.lines.items()
            },
        )

    def joints(self, name: str) -> Array:
        """(7,) rad, a named joint configuration.

        Raises:
            InputError: unknown; the message lists the valid ones.
        """
        if name not in self.configurations:
            (meant, *others) = self.configurations
            guess = None if others else meant
            raise unknown_name("joint configuration", name, self.configurations, meant=guess)
        return self.configurations[name].copy()

    def subject(self, expression: str | PoseExpression) -> str | None:
        """The object or surface an expression's name belongs to."""
        return self.subjects.get(self._parsed(expression).name)

    def _parsed(self, expression: str | PoseExpression) -> PoseExpression:
        if isinstance(expression, PoseExpression):
            return expression
        return self.parse(expression)

    def _leading_name(self, text: str) -> tuple[str, str]:
        """The pose's name and the terms behind it. Names may hold a minus themselves, so the
        longest that fits is taken."""
        for name in (*self.names, *sorted(self._aliases, key=len, reverse=True)):
            if not text.startswith(name):
                continue
            rest = text[len(name) :]
            if not rest.strip() or rest.lstrip()[0] in "+-−":
                return self._aliases.get(name, name), rest
        shown = re.split(r"[+\-−*]", text)[0].strip() or text
        raise unknown_name("pose", shown, self.names)

    @cached_property
    def _aliases(self) -> dict[str, str]:
        """`hammer` for `hammer_pose`, where nothing else is called so."""
        aliases: dict[str, str] = {}
        for subject in self.subjects.values():
            pose = f"{subject}_pose"
            if pose in self.poses and subject not in self.poses:
                aliases[subject] = pose
        return aliases

    def _offset_name(self, written: str) -> str:
        candidates = (
            written,
            f"{written}_offset",
            f"{written.removesuffix('_off')}_offset",
            f"{written.removesuffix('off')}_offset",
        )
        for candidate in candidates:
            if candidate in self.offset_names:
                return candidate
        raise unknown_name("offset", written, self.offset_names)


def _coefficient(match: re.Match[str], text: str) -> float:
    size = float(match[2].replace("−", "-")) if match[2] else 1.0
    if not math.isfinite(size) or abs(size) > 1000:
        raise InputError(f"'{match[2][:40]}' in pose expression '{text}' is not a sensible factor")
    return size if match[1] == "+" else -size


def in_world(base: Pose, shift: Array) -> Array:
    """A shift along tool x, tool y (both laid level) and world z, in world axes."""
    x, y, z = shift
    across, along = _level(base.rotation[:, 0]), _level(base.rotation[:, 1])
    return across * x + along * y + np.array([0.0, 0.0, z])


def _level(axis: Array) -> Array:
    """The unit vector from above along `axis`; zero where it points straight up or down."""
    flat = np.array([axis[0], axis[1], 0.0])
    length = float(np.linalg.norm(flat))
    return flat / length if length > 1e-6 else np.zeros(3)


def vectors(entries: Mapping[str, float | Iterable[float]]) -> dict[str, Array]:
    """Offsets as poses.yaml writes them: a vector, or a length along the axis that the name begins
    with."""
    return {name: _vector(name, value) for name, value in entries.items()}


def _vector(name: str, value: float | Iterable[float]) -> Array:
    if not isinstance(value, int | float):
        return np.array(list(value), dtype=float)
    axis = "xyz".find(name[0])
    if axis < 0 or not name.endswith("_offset"):
        raise InputError(
            f"offset '{name}' is one number; only x_offset, y_offset, z_offset may be, "
            "others are [x, y, z]"
        )
    return float(value) * np.eye(3)[axis]


def given_offsets(poses: Poses) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Offsets of poses.yaml: those for every pose, and by object those of one object."""
    common: dict[str, Array] = {}
    own: dict[str, dict[str, Array]] = {}
    for name, value in poses.offsets.items():
        if isinstance(value, dict):
            own[name] = vectors(value)
        else:
            common[name] = _vector(name, value)
    return common, own


def configurations(poses: Poses, home: Array) -> dict[str, Array]:
    """Joint configurations (rad) of poses.yaml, and the arm's home unless it names another."""
    given = {name: np.array(joints) for name, joints in poses.joints.items()}
    return {"home_config": home} | given
