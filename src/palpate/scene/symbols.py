"""Names of poses, joint configurations and offsets in plans, and the grammar of pose expressions.

Names are from the scene and `poses.yaml`; others are derived from the geometry:

- `<object>_pose`: TCP pose of a top-down grasp.
- `<object>_temporary`: TCP pose at which the grasped object rests on a free spot of its surface.
- `<object>_across`: the grasp turned by 90°, if that fits.
- `<object>_top`: TCP pose above the object's top.
- `<object>_balance`: the grasp moved along the tool's x by up to two x_offsets to the balance point.
  The point is the believed one, or the one measured before the first motion to it.
- `<surface>_approach`: TCP pose above a free spot of the surface.
- `home_config`: joint configuration; the arm's own unless poses.yaml states another.
- `<fixture>_front`: joint configuration of a level hand in front of a handle.
- `<fixture>_level`: configuration on the way there, with a level hand and the arm still at home.
- `x_offset`, `y_offset`: along the tool's x and y at the base pose, horizontal. Twice the offset is
  still on the object if possible.
- `z_offset`: along world z, such that the object clears its neighbours. At a handle, which is not
  lifted, it is straight back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property, partial

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.pose import Array, Pose, PoseLine
from palpate.scene.poses import Poses

# Words in names that models give to a pose above an object.
_ABOVE = frozenset(
    [
        "lift",
        "lifted",
        "above",
        "over",
        "hover",
        "approach",
        "pre",
        "pregrasp",
        "retreat",
        "raised",
        "up",
        "high",
    ]
)
MAX_EXPRESSION = 200  # Largest number of characters of a pose expression
# m, offsets at poses without an object.
DEFAULT_OFFSETS: Mapping[str, tuple[float, float, float]] = {
    "x_offset": (0.05, 0.0, 0.0),
    "y_offset": (0.0, 0.05, 0.0),
    "z_offset": (0.0, 0.0, 0.12),
}
_FACTOR = r"\(?([-−]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\)?"
_TERM = re.compile(rf"\s*([+\-−])\s*(?:{_FACTOR}\s*\*?\s*)?([^\W\d][\w.]*)")


@dataclass(frozen=True, slots=True)
class PoseExpression:
    """`NAME (± [α *] OFFSET)*` in normal form: terms merged, in alphabetical order."""

    name: str
    terms: tuple[tuple[float, str], ...] = ()

    def __str__(self) -> str:
        # A factor of 1 is not written, and a negative one becomes a minus sign.
        text = self.name
        for coefficient, offset in self.terms:
            sign, size = ("-" if coefficient < 0 else "+"), abs(coefficient)
            text += f" {sign} {offset}" if size == 1 else f" {sign} {size:g}*{offset}"
        return text

    def shift(self, offset: str, factor: float) -> PoseExpression:
        """Add `factor` times an offset, the coefficient rounded to hundredths."""
        # Terms with a coefficient of zero are dropped, so that equal poses have equal texts.
        terms = {name: coefficient for coefficient, name in self.terms}
        terms[offset] = round(terms.get(offset, 0.0) + factor, 2)
        left = [(coefficient, name) for name, coefficient in sorted(terms.items()) if coefficient]
        return PoseExpression(self.name, tuple(left))


@dataclass(eq=False)
class Symbols:
    """Symbols of a scene.

    Attributes:
        poses: TCP poses in the world by name.
        subjects: object or surface by name of the pose.
        configurations: joint configurations by name, (7,) rad.
        offsets: vectors (3,), m, by name of the offset: tool x, tool y, world z; for any pose.
        own_offsets: offsets of single objects, which take precedence, by object.
        ungraspable: reason why the hand cannot grasp an object, by object.
        later: functions that compute poses at first use, by name.
        lines: poses whose position on a line is measured in a run, by name.
        handles: names of poses at the handles of fixtures: offsets are along the tool's own axes there.
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
    lines: Mapping[str, PoseLine] = field(default_factory=dict[str, PoseLine])
    handles: frozenset[str] = frozenset()
    _found: dict[str, Pose | None] = field(
        default_factory=dict[str, "Pose | None"], init=False, repr=False
    )
    _read: dict[str, PoseExpression] = field(
        default_factory=dict[str, PoseExpression], init=False, repr=False
    )
    """Cache of parsed expressions: a search repeats them."""
    _resolved: dict[PoseExpression, Pose] = field(
        default_factory=dict[PoseExpression, Pose], init=False, repr=False
    )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every name of a pose, longest first."""
        return tuple(sorted(self._names, key=lambda n: (-len(n), n)))

    @cached_property
    def _names(self) -> dict[str, str]:
        return {name: name for name in (*self.poses, *self.later, *self.lines)}

    @cached_property
    def usable(self) -> frozenset[str]:
        """Names of all poses that exist: searched poses need free room and must fit the hand."""
        # Computes all poses on demand, so it is slow the first time.
        estimated = {name for name in self.later if self._later(name) is not None}
        return frozenset({*self.poses, *self.lines, *estimated})

    @cached_property
    def offset_names(self) -> tuple[str, ...]:
        """Every name of an offset."""
        names = set(self.offsets)
        for own in self.own_offsets.values():
            names.update(own)
        return tuple(sorted(names))

    def parse(self, expression: str) -> PoseExpression:
        """Parse a pose expression; aliases (`hammer`, `z_off`, `+z`) become full names.

        Raises InputError: not of the grammar, or unknown names; the message lists the valid ones.
        """
        if expression in self._read:
            return self._read[expression]
        if len(expression) > MAX_EXPRESSION:
            raise InputError(
                f"pose expression of {len(expression)} characters; at most {MAX_EXPRESSION}"
            )
        # A name, then terms: sign, optional factor, offset.
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
            factor = float(match[2].replace("−", "-")) if match[2] else 1.0
            if not math.isfinite(factor) or abs(factor) > 1000:
                raise InputError(
                    f"the factor '{match[2][:40]}' in pose expression '{text}' exceeds 1000"
                )
            offset = self._offset_name(match[3])
            terms[offset] = terms.get(offset, 0.0) + (factor if match[1] == "+" else -factor)
            position = match.end()
        # Terms that cancel are removed: `a + z_offset - z_offset` is `a`.
        left = [(factor, o) for o, factor in sorted(terms.items()) if abs(factor) > 1e-12]
        self._read[expression] = PoseExpression(name, tuple(left))
        return self._read[expression]

    def estimated_name(self, expression: str) -> str | None:
        """Name of the pose in an expression if its position is measured in a run, else None."""
        try:
            name = self.parse(expression).name if self.lines else None
        except InputError:
            return None
        return name if name in self.lines else None

    def resolve(
        self, expression: str | PoseExpression, bound: Mapping[str, float] | None = None
    ) -> Pose:
        """TCP pose of an expression in the world.

        `bound` are measured positions of poses on their lines, m.
        Raises InputError: as `parse`; no room for a temporary pose; or a position outside its line.
        """
        parsed = self._parse(expression)
        if parsed.name in self.lines:
            return self._apply_offsets(parsed, self.pose(parsed.name, bound))
        # One pose object for each expression, so that results cached by pose are found again.
        if parsed not in self._resolved:
            self._resolved[parsed] = self._apply_offsets(parsed, self.pose(parsed.name))
        return self._resolved[parsed]

    def _apply_offsets(self, parsed: PoseExpression, base: Pose) -> Pose:
        """A pose with the offsets of an expression."""
        if not parsed.terms:
            return base
        # Sum of the terms in tool axes, converted to world axes once.
        shift = np.zeros(3)
        for coefficient, offset in parsed.terms:
            shift = shift + coefficient * self.offset(offset, parsed.name)
        return base.translate(self.shift(parsed.name, base, shift))

    def pose(self, name: str, bound: Mapping[str, float] | None = None) -> Pose:
        """TCP pose in the world of a name; `bound` and errors as for `resolve`."""
        # Given or derived poses first, then lines, then poses computed on demand.
        if name in self.poses:
            return self.poses[name]
        if name in self.lines:
            line = self.lines[name]
            try:
                return line.at((bound or {}).get(name, line.believed))
            except InputError as error:
                raise InputError(f"'{name}': {error}") from None
        if name not in self.later:
            raise self._unknown(name)
        pose = self._later(name)  # a search for a free spot takes time, so it is done on demand
        if pose is None:
            reason = "there is no free place within reach"
            if name.endswith("_across"):
                reason = (
                    f"turned by 90°, the hand does not fit '{self.subjects.get(name)}': no pose"
                )
            raise InputError(f"{reason} for '{name}'; give one in poses.yaml")
        return pose

    def _later(self, name: str) -> Pose | None:
        if name not in self._found:
            self._found[name] = self.later[name]()
        return self._found[name]

    def offset(self, name: str, pose: str) -> Array:
        """Vector (3,) of an offset at a named pose: along tool x, tool y and world z, m."""
        # Offsets of the subject take precedence over common ones.
        own = self.own_offsets.get(self.subjects.get(pose, ""), {})
        if name in own:
            return own[name]
        if name not in self.offsets:
            raise unknown_name("offset", name, [*self.offsets, *own], f"It is used with '{pose}'.")
        return self.offsets[name]

    def shift(self, name: str, base: Pose, offset: Array) -> Array:
        """A sum of offsets (3,) at a named pose, which is `base`, in world axes."""
        return in_hand(base, offset) if name in self.handles else in_world(base, offset)

    def map_poses(self, to: Callable[[str, Pose], Pose]) -> Symbols:
        """The symbols with every pose replaced by `to(name, pose)`."""

        def found_later(name: str) -> Pose | None:
            # Compute the pose in the scene as given, then move it.
            pose = self._later(name)
            return None if pose is None else to(name, pose)

        # A line moves with its pose.
        lines: dict[str, PoseLine] = {}
        for name, line in self.lines.items():
            lines[name] = replace(line, pose=to(name, line.pose))
        return replace(
            self,
            poses={name: to(name, pose) for name, pose in self.poses.items()},
            later={name: partial(found_later, name) for name in self.later},
            lines=lines,
        )

    def joints(self, name: str) -> Array:
        """Joint configuration (7,), rad; the error for an unknown name lists the valid ones."""
        if name not in self.configurations:
            # With a single configuration, any unknown name is a misspelling of it.
            (only, *others) = self.configurations
            guess = None if others else only
            raise unknown_name("joint configuration", name, self.configurations, intended=guess)
        return self.configurations[name].copy()  # callers may change it

    def subject(self, expression: str | PoseExpression) -> str | None:
        """Object or surface of an expression's pose."""
        return self.subjects.get(self._parse(expression).name)

    def _parse(self, expression: str | PoseExpression) -> PoseExpression:
        if isinstance(expression, PoseExpression):
            return expression
        return self.parse(expression)

    def _leading_name(self, text: str) -> tuple[str, str]:
        """Split an expression into the longest pose name, which may contain a minus, and the terms."""
        signs = [sign.start() for sign in re.finditer(r"[+\-−]", text)]
        heads = [text[:end].rstrip() for end in (len(text), *reversed(signs))]
        for known in (self._names, self._aliases):
            for name in heads:
                if name in known:
                    return known[name], text[len(name) :]
        shown = re.split(r"[+\-−*]", text)[0].strip() or text
        raise self._unknown(shown)

    def _unknown(self, name: str) -> InputError:
        """Error for an unknown name of a pose, which guesses among those of the same subject first."""
        of = [known for known in set(self.subjects.values()) if name.startswith(f"{known}_")]
        longest = max(of, key=len, default=None)
        # Suggest a pose of the body with the longest matching name.
        own = [known for known, subject in self.subjects.items() if subject == longest]
        intended = next(iter(get_close_matches(name[:80], own, n=1, cutoff=0.0)), None)
        # A name of a pose above the object keeps its intent: "mug_lift_pose".
        above = not _ABOVE.isdisjoint(name.removeprefix(f"{longest}_").split("_"))
        if above and f"{longest}_pose" in own and "z_offset" in self.offsets:
            intended = f"{longest}_pose + z_offset"
        hint = "Other objects have poses, too." if own and len(own) < len(self.names) else ""
        return unknown_name("pose", name, own or self.names, hint, intended)

    @cached_property
    def _aliases(self) -> dict[str, str]:
        """Short names of grasp poses: `hammer` for `hammer_pose`, unless another pose has that name."""
        aliases: dict[str, str] = {}
        for subject in self.subjects.values():
            pose = f"{subject}_pose"
            if pose in self.poses and subject not in self.poses:
                aliases[subject] = pose
        return aliases

    def _offset_name(self, written: str) -> str:
        """Full name of an offset: `z_offset` of `z`, `z_off` or `zoff`."""
        # Try the name as written, then with the usual endings.
        stems = (written, written.removesuffix("_off"), written.removesuffix("off"))
        for candidate in (written, *(f"{stem}_offset" for stem in stems)):
            if candidate in self.offset_names:
                return candidate
        raise unknown_name("offset", written, self.offset_names)


def in_world(base: Pose, shift: Array) -> Array:
    """Convert a shift (3,) along tool x, tool y and world z into world axes.

    The tool axes are projected to the horizontal.
    """

    def level(axis: Array) -> Array:
        flat = np.array([axis[0], axis[1], 0.0])
        length = float(np.linalg.norm(flat))
        return flat / length if length > 1e-6 else np.zeros(3)  # zero for a vertical axis

    # Components along horizontal unit vectors and the vertical.
    x, y, z = shift
    across, along = level(base.rotation[:, 0]), level(base.rotation[:, 1])
    return across * x + along * y + np.array([0.0, 0.0, z])


def in_hand(base: Pose, shift: Array) -> Array:
    """Convert a shift (3,) along tool x, tool y and negative tool z into world axes.

    For a hand that points down, the result equals that of `in_world`.
    """
    return base.rotation @ (shift * [1.0, 1.0, -1.0])


def vectors(entries: Mapping[str, float | Iterable[float]]) -> dict[str, Array]:
    """Offsets (3,) m of entries of poses.yaml: a vector, or a length along the axis in the name."""
    return {name: _vector(name, value) for name, value in entries.items()}


def _vector(name: str, value: float | Iterable[float]) -> Array:
    if not isinstance(value, int | float):
        return np.array(list(value), dtype=float)
    # A single number is a length along the axis that the name begins with.
    axis = "xyz".find(name[0])
    if axis < 0 or not name.endswith("_offset"):
        raise InputError(
            f"offset '{name}' is one number; only x_offset, y_offset and z_offset may be, "
            "others are [x, y, z]"
        )
    return float(value) * np.eye(3)[axis]


def given_offsets(poses: Poses) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Offsets of poses.yaml, (3,), m: common ones by name, and own ones by object."""
    common: dict[str, Array] = {}
    own: dict[str, dict[str, Array]] = {}
    for name, value in poses.offsets.items():
        if isinstance(value, dict):
            own[name] = vectors(value)
        else:
            common[name] = _vector(name, value)
    return common, own


def configurations(poses: Poses, home: Array) -> dict[str, Array]:
    """Joint configurations of poses.yaml, rad of each joint, with `home` unless it states another.

    Raises InputError: a configuration has another number of joints than the arm.
    """
    for name, joints in poses.joints.items():
        if len(joints) != len(home):
            raise InputError(
                f"poses.yaml: the joint configuration '{name}' has {len(joints)} angles, and the arm "
                f"has {len(home)} joints: give one angle a joint"
            )
    given = {name: np.array(joints) for name, joints in poses.joints.items()}
    return {"home_config": home} | given
