"""An object, a surface or a fixture: as described by its file, and with the scene's beliefs."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from palpate.common.belief import SURE
from palpate.common.pose import Array, Joint, Pose
from palpate.mjcf.document import Element, has_unknown
from palpate.mjcf.elements import Defaults, Elements, Role, has_open_height
from palpate.mjcf.shapes import Shapes

# Names of geoms of a fixture, or of bodies around them, that identify its handle.
HANDLE = re.compile(r"handle|knob|grip|latch|lever", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class BodyDescription:
    """An object, a surface or a fixture as described by its file, from which quantities are read."""

    elements: Elements  # its elements in the file
    shapes: Shapes  # the compiled scene, with stand-ins for all unknown values
    others: Mapping[str, BodyDescription]  # every body of the scene by name, itself included
    given: Pose | None = None  # pose of its frame from poses.yaml, which overrules the file.
    # World z, m, of a surface's top that a given approach pose implies.
    given_top: float | None = None

    @property
    def name(self) -> str:
        """Name in the MJCF."""
        return self.elements.name

    @property
    def role(self) -> Role:
        """Object, surface or fixture."""
        return self.elements.role

    @property
    def defaults(self) -> Defaults:
        return self.elements.defaults

    @property
    def given_z(self) -> float | None:
        """World z of its frame, m, if poses.yaml states it where the file leaves it open."""
        if self.given is None or not has_unknown(self.elements.element, "pos", 2):
            return None
        return float(self.given.position[2])

    @property
    def pose_world(self) -> Pose:
        """Pose of its frame: of the body, or of a geom that is a child of the worldbody."""
        if self.elements.element.tag == "body":
            return self.shapes.body_pose(self.name)
        return self.shapes.geom_pose(self.elements.element)

    @cached_property
    def cloud(self) -> Array:
        """Points (k, 3), m, of an object's geoms in the world, or of a surface's carrier."""
        if self.role == "surface":
            return self.shapes.points(self.carrier)
        return self.shapes.cloud(self.elements.colliding)

    @cached_property
    def carrier(self) -> Element:
        """Geom of a surface with the largest footprint; the higher one of equals."""

        def footprint(geom: Element) -> tuple[float, float]:
            cloud = self.shapes.points(geom)
            x, y, _ = cloud.max(axis=0) - cloud.min(axis=0)
            # Rounded, so that equal footprints compare equal despite floating-point errors.
            return round(float(x * y), 6), float(cloud[:, 2].max())

        return max(self.elements.geoms, key=footprint)

    @property
    def top_is_open(self) -> bool:
        """True if the height of a surface's top is `?`."""
        marked = [has_open_height(geom, self.defaults) for geom in self.elements.geoms]
        return any(marked) or has_unknown(self.elements.element, "pos", 2)

    @property
    def top_z(self) -> float:
        """World z of its highest point, m."""
        return float(self.cloud[:, 2].max())

    @property
    def bottom_z(self) -> float:
        """World z of its lowest point, m."""
        return float(self.cloud[:, 2].min())

    @property
    def joint(self) -> Joint | None:
        """Joint of a fixture, in the initial configuration of the scene; None for other bodies."""
        if self.elements.joint is None:
            return None
        # Axis, anchor and limits as compiled, in the initial configuration.
        model, data = self.shapes.model, self.shapes.data
        i = int(model.body(self.name).jntadr[0])
        at = int(model.jnt_qposadr[i])
        low, high = model.jnt_range[i].tolist() if model.jnt_limited[i] else (-math.inf, math.inf)
        return Joint(
            kind="slide" if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_SLIDE else "hinge",
            axis=data.xaxis[i].copy(),
            anchor=data.xanchor[i].copy(),
            low=low,
            high=high,
            position=float(data.qpos[at]),
            spring=float(model.qpos_spring[at]),
            open=(self._has_open_limit(0), self._has_open_limit(1)),
        )

    def _has_open_limit(self, side: int) -> bool:
        joint = self.elements.joint
        return joint is not None and has_unknown(joint, "range", side)

    @property
    def handle(self) -> tuple[Element, ...]:
        """Geoms by which a fixture is grasped: those named as a handle, else all that collide."""
        return self.named_handle or self.elements.colliding

    @property
    def named_handle(self) -> tuple[Element, ...]:
        """Colliding geoms of a fixture that are named as a handle, or are in a body of such a name."""
        geoms: list[Element] = []
        for geom in self.elements.colliding:
            # Bodies between the geom and the fixture.
            inner = list(geom.iterancestors("body"))
            inner = inner[: inner.index(self.elements.element)]
            if any(HANDLE.search(part.get("name") or "") for part in (geom, *inner)):
                geoms.append(geom)
        return tuple(geoms)

    def box(self) -> tuple[Array, Array]:
        """Compute centre and full extents (3,), m, of the box around it in its own frame."""
        # Express the points in the frame, and take their extremes.
        local = (self.cloud - self.pose_world.position) @ self.pose_world.rotation
        low, high = local.min(axis=0), local.max(axis=0)
        return (low + high) / 2, high - low

    def footing(self) -> Array:
        """Compute the middle (3,), m, of the bottom of its world-aligned box."""
        low, high = self.cloud.min(axis=0), self.cloud.max(axis=0)
        return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])

    def reaches_over(self, point: Array) -> bool:
        """Test if the x and y of a point are within its world-aligned box."""
        low, high = self.cloud.min(axis=0), self.cloud.max(axis=0)
        return bool(np.all(point[:2] >= low[:2]) and np.all(point[:2] <= high[:2]))

    def objects(self) -> list[BodyDescription]:
        return [body for body in self.others.values() if body.role == "object"]

    def surfaces(self) -> list[BodyDescription]:
        return [body for body in self.others.values() if body.role == "surface"]

    def surfaces_below(self) -> list[BodyDescription]:
        """Return the surfaces whose box in x-y contains the middle of the object, at any height."""
        middle = (self.cloud.max(axis=0) + self.cloud.min(axis=0)) / 2
        return [surface for surface in self.surfaces() if surface.reaches_over(middle)]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Body:
    """An object (free joint), a surface (static, carries objects) or a fixture (slide or hinge joint) of the
    scene.

    Attributes:
        name: as in the MJCF.
        role: `object`, `surface` or `fixture`.
        words: lower-case words a request may use for it: parts of its name, its colour, its shape.
        pose_world: believed pose of the body frame (for a geom in the worldbody: its frame); unknown
            numbers hold a prior.
        centre, size: (3,) m, centre and full extents of the box around its geoms, or around a surface's
            carrier, in its own frame.
        known: quantity id to value, for quantities that the MJCF states.
        missing: quantity ids that the MJCF leaves out or marks with `?`.
        assumed: quantity ids that MuJoCo would infer (com, inertia from uniform density).
        carries: names of the objects that rest on a surface.
        accuracy: standard deviation of its believed position, m; None where not stated.
        covariance: (6, 6) of its believed pose: position, m, and rotation, rad, along the world's axes;
            None where not stated.
        tipped: motion in the world by which it comes to rest on its support, if its pose in the scene
            is not stable.
        seen: True if its shape was fitted to a picture, and is as uncertain as its position.
        joint: joint of a fixture.
    """

    name: str
    role: Role
    words: frozenset[str]
    pose_world: Pose
    centre: Array
    size: Array
    known: Mapping[str, tuple[float, ...]]
    missing: frozenset[str]
    assumed: frozenset[str] = frozenset()
    carries: tuple[str, ...] = ()
    accuracy: float | None = None
    covariance: Array | None = None
    tipped: Pose = field(default_factory=lambda: Pose.of([0.0, 0.0, 0.0]))
    seen: bool = False
    joint: Joint | None = None

    reach: float = field(init=False)
    """Upper bound of the distance, m, of its box's points from its frame's origin."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "reach", float(np.linalg.norm(self.centre) + np.linalg.norm(self.size) / 2)
        )

    @property
    def pose_at_rest(self) -> Pose:
        """`pose_world` after `tipped`."""
        return self.tipped @ self.pose_world

    def std(self, along: Array) -> float | None:
        """Compute the standard deviation, m, of its believed position along a direction (3,), world; else None."""
        if self.covariance is None:
            return self.accuracy
        return float(np.sqrt(along @ self.covariance[:3, :3] @ along))

    @property
    def doubt(self) -> float:
        """Largest horizontal error, m, of its believed position: `SURE` standard deviations, 0 without covariance."""
        if self.covariance is None:
            return 0.0
        return SURE * float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    def __repr__(self) -> str:
        missing = f", missing {', '.join(sorted(self.missing))}" if self.missing else ""
        return f"<Body '{self.name}': {self.role}{missing}>"

    def top_z(self, pose_world: Pose | None = None) -> float:
        """World z of the top of its box at `pose_world`, by default the believed pose, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle + half

    def bottom_z(self, pose_world: Pose | None = None) -> float:
        """World z of the bottom of its box, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle - half

    def covers(self, x: float, y: float, pose_world: Pose | None = None) -> bool:
        """Test if the vertical line through a point meets its box."""
        pose = pose_world or self.pose_world
        at_x, at_y, _ = pose.position.tolist()
        if math.hypot(x - at_x, y - at_y) > self.reach:  # most bodies are far away
            return False
        # Slab method: the vertical line is within all three pairs of the box's faces.
        down = pose.rotation[2]
        start = pose.local((x, y, pose.position[2])) - self.centre
        along = np.where(np.abs(down) > 1e-9, down, 1e-9)
        near, far = (-start - self.size / 2) / along, (-start + self.size / 2) / along
        return bool(np.minimum(near, far).max() <= np.maximum(near, far).min() + 1e-9)

    def _vertical(self, pose: Pose) -> tuple[float, float]:
        """Compute world z of the middle of its box, and half its extent along z, m."""
        # Row z of the rotation: |R_z| · size is the vertical extent of a turned box.
        up = pose.rotation[2]
        return float(pose.position[2] + up @ self.centre), float(np.abs(up) @ self.size / 2)
