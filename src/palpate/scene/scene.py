"""D: an incomplete MJCF, read into objects, surfaces, named places and what is missing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from palpate.errors import unknown_name
from palpate.pose import Array, Pose
from palpate.quantities import QUANTITIES, Gap
from palpate.scene.mjcf import Document, parse_document, read_text

if TYPE_CHECKING:
    import mujoco

    from palpate.scene.poses import Poses
    from palpate.scene.source import Source
    from palpate.scene.symbols import Symbols


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object (free joint) or a surface (static, carries things) of the scene.

    Attributes:
        name: as in the MJCF.
        role: `object` or `surface`.
        words: lower-case words a request may use for it: parts of its name, its colour, its shape.
        pose_world: believed pose of the body frame (of a geom that stands in the worldbody: its frame);
            unknown numbers hold a prior.
        centre, size: (3,) box around its geoms in its own frame: centre and full extents, m. Of a surface: the
            box around the geom whose top carries.
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

    reach: float = field(init=False)
    """No point of its box is farther than this from its frame's origin, m."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "reach", float(np.linalg.norm(self.centre) + np.linalg.norm(self.size) / 2))

    def top_z(self, pose_world: Pose | None = None) -> float:
        """World z of the top of its box, at its believed pose or at `pose_world`, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle + half

    def bottom_z(self, pose_world: Pose | None = None) -> float:
        """World z of the bottom of its box, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle - half

    def covers(self, x: float, y: float, pose_world: Pose | None = None) -> bool:
        """Whether the point is above its box's footprint."""
        pose = pose_world or self.pose_world
        at_x, at_y, _ = pose.position.tolist()
        if not self.is_near(x - at_x, y - at_y):
            return False
        down = pose.rotation[2]
        start = pose.local((x, y, pose.position[2])) - self.centre
        along = np.where(np.abs(down) > 1e-9, down, 1e-9)
        near, far = (-start - self.size / 2) / along, (-start + self.size / 2) / along
        return bool(np.minimum(near, far).max() <= np.maximum(near, far).min() + 1e-9)

    def is_near(self, x: float, y: float, margin: float = 0.0) -> bool:
        """Whether a point `x`, `y` m beside its frame's origin may be within `margin` m of its box: a quick bound."""
        return math.hypot(x, y) <= self.reach + margin

    def _vertical(self, pose: Pose) -> tuple[float, float]:
        up = pose.rotation[2]
        return float(pose.position[2] + up @ self.centre), float(np.abs(up) @ self.size / 2)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """An incomplete simulation description with the poses that came with it.

    Attributes:
        text: the user's MJCF, byte for byte as read (decoded utf-8).
        path: the file it came from, None when built from text.
        bodies: objects and surfaces by name, in document order.
        symbols: names a plan may use: poses, places, joint configurations, offsets.
        pose_world_base: where the arm stands (site `robot_base`, else where the scene's own robot stands,
            else the origin).
        gravity: m/s^2, magnitude.
        priors: what is believed of every missing quantity before it is measured.
        source: the parsed file, for `spec` and the twin.
        refit: of a scene seen in a picture: the scene anew, when contact has told a surface's height (m).
    """

    text: str
    path: Path | None
    bodies: Mapping[str, Body]
    symbols: Symbols
    pose_world_base: Pose
    gravity: float
    priors: Mapping[Gap, tuple[float, ...]]
    source: Source
    refit: Callable[[str, float], Scene] | None = None

    objects: Mapping[str, Body] = field(init=False)
    """Bodies with a free joint."""
    surfaces: Mapping[str, Body] = field(init=False)
    """Static bodies that carry things."""

    def __post_init__(self) -> None:
        for name, role in (("objects", "object"), ("surfaces", "surface")):
            object.__setattr__(self, name, {n: body for n, body in self.bodies.items() if body.role == role})

    @property
    def files(self) -> tuple[Path, ...]:
        """Every other file the MJCF needs (includes, meshes, textures), absolute."""
        return self.source.document.files

    def body(self, name: str) -> Body:
        """The object or surface named `name`.

        Raises:
            InputError: there is none; the message lists those there are.
        """
        if name not in self.bodies:
            raise unknown_name("object or surface", name, self.bodies)
        return self.bodies[name]

    def learned(self, gap: Gap, value: tuple[float, ...]) -> Scene:
        """What is believed of the cell once `gap` has been measured: a scene seen in a picture gets new shapes."""
        return self.refit(gap.object, value[0]) if self.refit and gap.quantity == "height" else self

    def missing(self) -> tuple[Gap, ...]:
        """Everything the MJCF does not state, in document order ("everything missing")."""
        return tuple(Gap(body.name, quantity) for body in self.bodies.values()
                     for quantity in QUANTITIES if quantity in body.missing)

    def spec(self, values: Mapping[Gap, tuple[float, ...]] | None = None) -> mujoco.MjSpec:
        """The scene as an editable model without any robot, unknowns filled from `values`, else from priors."""
        return self.source.spec(self.priors, values or {})


def load_scene(path: Path, poses: Path | None = None) -> Scene:
    """Read an MJCF file, and optionally `poses.yaml`.

    Raises:
        InputError: malformed XML, entities, missing or escaping files, names that do not match.
    """
    from palpate.scene.poses import read_poses

    path = Path(path)
    text = read_text(path)
    document = parse_document(text, path.resolve().parent, str(path))
    return _scene(document, path, read_poses(Path(poses)) if poses is not None else None)


def parse_scene(text: str, folder: Path | None = None, poses: str | Poses | None = None) -> Scene:
    """As `load_scene`, from text; `folder` is where relative file names start, `poses` YAML or read already.

    Raises:
        InputError: as `load_scene`.
    """
    from palpate.scene.poses import parse_poses

    return _scene(parse_document(text, folder), None, parse_poses(poses) if isinstance(poses, str) else poses)


def scene_from_text(text: str, like: Scene) -> Scene:
    """Another version of a scene's MJCF (its twin), with the same folder and the same poses.

    Raises:
        InputError: as `load_scene`.
    """
    return _scene(parse_document(text, like.source.document.folder), like.path, like.source.poses)


def rearranged(scene: Scene, poses: Mapping[str, Pose]) -> Scene:
    """The scene with some objects standing elsewhere: `poses` are of their body frames in the world."""
    from palpate.scene.poses import PoseEntry

    now = {name: PoseEntry.model_validate({"pos": pose.position.tolist(), "quat": pose.quaternion.tolist()})
           for name, pose in poses.items()}
    known = scene.source.poses
    document = parse_document(scene.text, scene.source.document.folder)
    return _scene(document, scene.path, known.model_copy(update={"objects": {**known.objects, **now}}))


def _scene(document: Document, path: Path | None, poses: Poses | None) -> Scene:
    from palpate.scene.derive import derive_symbols
    from palpate.scene.poses import Poses
    from palpate.scene.source import believe

    belief = believe(document, poses or Poses())
    bodies = {body.name: body for body in belief.bodies()}
    base = belief.shapes.base()
    return Scene(
        text=document.text, path=path, bodies=MappingProxyType(bodies),
        symbols=derive_symbols(belief, bodies, base), pose_world_base=base,
        gravity=float(np.linalg.norm(belief.shapes.model.opt.gravity)),
        priors=MappingProxyType(belief.priors), source=belief.source,
    )
