"""D: an incomplete MJCF, read into objects, surfaces, named places and what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate.pose import Array, Pose
from palpate.quantities import Gap

if TYPE_CHECKING:
    import mujoco

    from palpate.scene.symbols import Symbols


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object (free joint) or a surface (static, carries things) of the scene.

    Attributes:
        name: as in the MJCF.
        role: `object` or `surface`.
        words: lower-case words a request may use for it: parts of its name, its colour.
        pose_world: believed pose of the body frame; unknown numbers hold a prior.
        centre, size: (3,) box around its geoms in its own frame: centre and full extents, m.
        known: quantity id to value, for what the MJCF states.
        missing: quantity ids that the MJCF leaves out or writes `?`.
        assumed: quantity ids MuJoCo would infer (com, inertia from uniform density).
    """

    name: str
    role: Literal["object", "surface"]
    words: frozenset[str]
    pose_world: Pose
    centre: Array
    size: Array
    known: Mapping[str, tuple[float, ...]]
    missing: frozenset[str]
    assumed: frozenset[str] = frozenset()

    def top_z(self, pose_world: Pose | None = None) -> float:
        """World z of the top of its box, at its believed pose or at `pose_world`, m."""
        raise NotImplementedError

    def bottom_z(self, pose_world: Pose | None = None) -> float:
        """World z of the bottom of its box, m."""
        raise NotImplementedError

    def covers(self, x: float, y: float, pose_world: Pose | None = None) -> bool:
        """Whether the point is above its box's footprint."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """An incomplete simulation description with the poses that came with it.

    Attributes:
        text: the user's MJCF, byte for byte as read (decoded utf-8).
        path: the file it came from, None when built from text.
        bodies: objects and surfaces by name, in document order.
        symbols: names a plan may use: poses, places, joint configurations, offsets.
        pose_world_base: where the arm stands (site `robot_base`, else the origin).
        gravity: m/s^2, magnitude.
    """

    text: str
    path: Path | None
    bodies: Mapping[str, Body]
    symbols: Symbols
    pose_world_base: Pose
    gravity: float

    @property
    def objects(self) -> Mapping[str, Body]:
        """Bodies with a free joint."""
        raise NotImplementedError

    @property
    def surfaces(self) -> Mapping[str, Body]:
        """Static bodies that carry things."""
        raise NotImplementedError

    def body(self, name: str) -> Body:
        """The object or surface named `name`.

        Raises:
            InputError: there is none; the message lists those there are.
        """
        raise NotImplementedError

    def missing(self) -> tuple[Gap, ...]:
        """Everything the MJCF does not state, in document order ("everything missing")."""
        raise NotImplementedError

    def spec(self, values: Mapping[Gap, tuple[float, ...]] | None = None) -> mujoco.MjSpec:
        """The scene as an editable model without any robot, unknowns filled from `values`, else from priors."""
        raise NotImplementedError


def load_scene(path: Path, poses: Path | None = None) -> Scene:
    """Read an MJCF file, and optionally `poses.yaml`.

    Raises:
        InputError: malformed XML, entities, missing or escaping files, names that do not match.
    """
    raise NotImplementedError
