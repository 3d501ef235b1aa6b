"""The scene and the arm as one compiled model: which shape belongs to what, where it is, and how
far two of them are apart.

Nothing is simulated here. Shapes are put where they are believed to be, and MuJoCo's own geometry
says the distance between two of them: real shapes, not the boxes around them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TypeVar, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.geometry.outline import Convex
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.compile import compile_model
from palpate.mjcf.hulls import hull_edges, hull_points
from palpate.mjcf.whole import whole
from palpate.robots.description import RobotDescription
from palpate.robots.kinematics import inverse_kinematics
from palpate.robots.model import PREFIX
from palpate.robots.nominal import NominalArm
from palpate.robots.sheet import Box
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.sweep.frames import Cluster, Frames, Shape

LEFT, RIGHT = "left finger", "right finger"
SIDES = {LEFT: 1.0, RIGHT: -1.0}
"""The fingers, and which way along the tool's y each opens."""
NEAR_PAD = 0.002
"""m: a box this far inside the open fingers' pads still is a finger."""
ORIGIN = Pose.of((0.0, 0.0, 0.0))
FAR = 10.0
"""m: no two things are asked about that are farther apart."""
REACHED = 0.002
"""m: a search for a configuration that ends farther from the pose has not found one."""
CACHED_SCENES = 32
REMEMBERED = 20_000
"""Findings that are kept of one scene."""

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Solids:
    """All shapes of a scene and of its arm.

    Attributes:
        scene: whose they are.
        model: scene and arm, compiled with everything unknown as it is believed to be.
        objects: object to its shapes, in its frame.
        fixed: shapes of what never moves (the arm's base among them), in the world; `owners` says
            whose, by id.
        hand, fingers: shapes in the tool frame, the fingers closed, by side.
        links: ids of the arm's moving shapes up to the hand, with the number of their joint.
    """

    scene: Scene
    model: mujoco.MjModel
    objects: Mapping[str, tuple[Shape, ...]]
    fixed: tuple[Shape, ...]
    owners: Mapping[int, str]
    hand: tuple[Shape, ...]
    fingers: Mapping[str, tuple[Shape, ...]]
    links: Mapping[int, int]
    _data: mujoco.MjData
    _bent: dict[bytes, Array | None] = field(default_factory=dict[bytes, "Array | None"])
    _known: dict[object, object] = field(default_factory=dict[object, object])
    """Cached results by key."""

    @cached_property
    def arm(self) -> NominalArm:
        """The nominal arm where it stands."""
        gravity = np.array([0.0, 0.0, -self.scene.gravity])
        return NominalArm(self.scene.arm, self.scene.pose_world_base, gravity)

    @cached_property
    def radii(self) -> Array:
        """m: no point of a shape is farther than this from its frame; 0 of a plane."""
        return np.array(self.model.geom_rbound)

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """Middles and half extents (k, 3) of the boxes around shapes, in their frames."""
        middle, half = self.model.geom_aabb[:, :3].copy(), self.model.geom_aabb[:, 3:].copy()
        plane = self.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        # All below a plane is solid.
        middle[plane], half[plane] = (0.0, 0.0, -FAR), (10 * FAR, 10 * FAR, FAR)
        return middle, half

    @property
    def base(self) -> str:
        """Owner of the shapes of the arm's base."""
        return self.scene.arm.base

    @cached_property
    def clusters(self) -> Mapping[str, Cluster]:
        """Each object's shapes."""
        return {name: Cluster.of(shapes) for name, shapes in self.objects.items()}

    @cached_property
    def standing(self) -> Frames:
        """Poses of the fixed shapes at a single moment."""
        return Cluster.of(self.fixed).at(np.zeros((1, 3)), np.eye(3)[None])

    def raised(self, scene: Scene) -> Solids:
        """The same in the scene with some surfaces higher."""
        fixed: list[Shape] = []
        for shape in self.fixed:
            up = np.array([0.0, 0.0, scene.rises.get(self.owners[shape.geom], 0.0)])
            fixed.append(replace(shape, position=shape.position + up))
        return replace(self, scene=scene, fixed=tuple(fixed), _known={})

    def pads(self, side: str) -> tuple[Shape, ...]:
        """Pads of a finger: the shapes whose friction overrules others', else all."""
        finger = self.fingers[side]
        rubber = [shape for shape in finger if self.model.geom_priority[shape.geom] > 0]
        return tuple(rubber) or finger

    def centre_of_mass(self, name: str) -> Array:
        """(3,) m, an object's, believed, in its frame."""
        return whole(self.model, name).com

    def mass(self, name: str) -> float:
        """kg, an object's, believed."""
        return float(self.model.body(name).subtreemass[0])

    def configuration(self, pose_world_tcp: Pose) -> Array | None:
        """(7,) rad: how the controller bends the arm at a pose; None where the arm does not get
        there."""
        key = pose_world_tcp.digits
        if key not in self._bent:
            self._bent[key] = self._bend(pose_world_tcp)
        return self._bent[key]

    def _bend(self, pose_world_tcp: Pose) -> Array | None:
        q = self.arm.reach(pose_world_tcp, self.scene.arm.home)
        missed = self.arm.poses(q[None])[0, :3] - pose_world_tcp.position
        if np.linalg.norm(missed) < REACHED:
            return q
        return inverse_kinematics(self.scene.arm, pose_world_tcp, self.scene.pose_world_base)

    def remembered(self, key: object, found: Callable[[], T]) -> T:
        """Cached result of a key, computed if absent."""
        if len(self._known) > REMEMBERED:
            self._known.clear()
        if key not in self._known:
            self._known[key] = found()
        return cast("T", self._known[key])

    def links_at(self, q: Array) -> Frames:
        """The arm's moving shapes, in the order of `links`, at configurations `q` (n, 7)."""
        geoms = list(self.links)
        positions = np.empty((len(q), len(geoms), 3))
        rotations = np.empty((len(q), len(geoms), 3, 3))
        for i, angles in enumerate(q):
            self._data.qpos[self._joints] = angles
            mujoco.mj_kinematics(self.model, self._data)
            positions[i] = self._data.geom_xpos[geoms]
            rotations[i] = self._data.geom_xmat[geoms].reshape(-1, 3, 3)
        return Frames(positions, rotations)

    def distance(self, first: int, second: int, at: Frames, i: int, j: int) -> float:
        """m between two shapes, which are number `i` and `j` of the first moment of `at`; negative
        where they overlap."""
        data = self._probe
        data.geom_xpos[first], data.geom_xpos[second] = at.positions[0, i], at.positions[0, j]
        data.geom_xmat[first] = at.rotations[0, i].ravel()
        data.geom_xmat[second] = at.rotations[0, j].ravel()
        return mujoco.mj_geomDistance(self.model, data, first, second, FAR, self._segment)

    def between(self) -> Array:
        """(3,) the middle of the shortest way between the two shapes of the last `distance`."""
        return (self._segment[:3] + self._segment[3:]) / 2

    def convex(self, shape: Shape, pose: Pose) -> Convex:
        """A shape in the world, where what it belongs to is at a pose."""
        points = hull_points(self.model, shape.geom) @ shape.rotation.T + shape.position
        kind = int(self.model.geom_type[shape.geom])
        return Convex(points @ pose.rotation.T + pose.position, hull_edges(kind, len(points)))

    @cached_property
    def _joints(self) -> NDArray[np.intp]:
        names = [PREFIX + name for name in self.scene.arm.joints]
        return np.array([int(self.model.joint(name).qposadr[0]) for name in names])

    @cached_property
    def _probe(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    @cached_property
    def _segment(self) -> Array:
        return np.zeros(6)


@lru_cache(CACHED_SCENES)
def solids(scene: Scene) -> Solids:
    """The shapes of a scene and its arm, compiled once, whatever heights are measured later.

    Raises:
        InputError: the scene does not compile with the arm in it.
    """
    if scene.as_given is not None:
        return solids(scene.as_given).raised(scene)
    model = compile_model(scene.spec_with(_solid_arm(scene.arm)))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    reader = _Reader(scene, model, data)
    return Solids(
        scene,
        model,
        reader.objects(),
        reader.fixed(),
        reader.owners(),
        reader.hand(),
        reader.fingers(),
        reader.links(),
        data,
    )


def _solid_arm(arm: RobotDescription) -> mujoco.MjSpec:
    """The arm with all of it that is solid: its base, which nothing meets in a simulation, and the
    fingers' boxes of the description, where the model may have the pads alone."""
    spec = arm.spec()
    base = spec.body(arm.base)
    if not any(geom.contype for geom in base.geoms):
        for geom in base.geoms:
            geom.contype = 1
    hand = spec.body(arm.hand.body)
    for i, (_, box) in enumerate(_stems(arm)):
        stem = hand.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=box.half, mass=0.0)
        stem.name, stem.contype = f"{STEM}{i}", 1
    return spec


STEM = "stem:"
"""Of the names of shapes added for fingers."""


def _stems(arm: RobotDescription) -> Iterator[tuple[str, Box]]:
    """The open fingers' boxes with their sides."""
    for box in arm.hand.boxes:
        y, half = float(box.centre[1]), float(box.half[1])
        if abs(y) - half > arm.hand.opening / 2 - NEAR_PAD:
            yield (LEFT if y > 0 else RIGHT), box


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """Sorts the shapes of a compiled scene with an arm in it, which stands at its zero."""

    scene: Scene
    model: mujoco.MjModel
    data: mujoco.MjData

    def objects(self) -> dict[str, tuple[Shape, ...]]:
        """Each object's shapes, in its frame."""
        found: dict[str, tuple[Shape, ...]] = {}
        for name in self.scene.objects:
            body = self.data.body(name)
            frame = Pose(body.xpos.copy(), body.xquat.copy())
            found[name] = tuple(self._in(frame, self._below(self.model.body(name).id)))
        return found

    def fixed(self) -> tuple[Shape, ...]:
        """Shapes that neither an object nor the arm moves, in the world."""
        moved = {self.model.body(PREFIX + self.scene.arm.links[1]).id}
        moved |= {self.model.body(name).id for name in self.scene.objects}
        geoms: list[int] = []
        for geom in range(self.model.ngeom):
            if self._is_solid(geom) and not moved & set(self._ancestry(geom)):
                geoms.append(geom)
        return tuple(self._in(ORIGIN, geoms))

    def owners(self) -> dict[int, str]:
        """Name of a shape's owner for people."""
        return {geom: self._owner(geom) for geom in range(self.model.ngeom)}

    def hand(self) -> tuple[Shape, ...]:
        """The hand's own shapes, in the tool frame."""
        body = self.model.body(PREFIX + self.scene.arm.hand.body).id
        fingers = {geom for name in self.scene.arm.hand.fingers for geom in self._of_finger(name)}
        geoms = [geom for geom in self._below(body) if geom not in fingers]
        return tuple(self._in(self._tool(), [geom for geom in geoms if not self._is_stem(geom)]))

    def fingers(self) -> dict[str, tuple[Shape, ...]]:
        """The closed fingers' shapes, in the tool frame, by side."""
        tool, found = self._tool(), dict[str, list[Shape]]()
        for name in self.scene.arm.hand.fingers:
            axis = self.data.xaxis[self.model.joint(PREFIX + name).id]
            side = LEFT if axis @ tool.rotation[:, 1] > 0 else RIGHT
            found[side] = list(self._in(tool, self._of_finger(name)))
        for i, (side, box) in enumerate(_stems(self.scene.arm)):
            name = f"{PREFIX}{STEM}{i}"
            inwards = np.array([0.0, self.scene.arm.hand.opening / 2, 0.0])
            closed = box.centre - SIDES[side] * inwards
            found[side].append(Shape(self.model.geom(name).id, closed, np.eye(3)))
        return {side: tuple(shapes) for side, shapes in found.items()}

    def links(self) -> dict[int, int]:
        """The shapes between the base and the hand, with how many joints move them."""
        found: dict[int, int] = {}
        for joint, name in enumerate(self.scene.arm.links[1:], start=1):
            body = self.model.body(PREFIX + name).id
            for geom in np.flatnonzero(self.model.geom_bodyid == body).tolist():
                if self._is_solid(geom):
                    found[geom] = joint
        return found

    def _tool(self) -> Pose:
        arm = self.scene.arm
        site, hand = self.data.site(PREFIX + arm.tcp), self.data.body(PREFIX + arm.hand.body)
        return Pose(site.xpos.copy(), hand.xquat.copy())

    def _in(self, frame: Pose, geoms: Iterable[int]) -> Iterator[Shape]:
        for geom in geoms:
            position = frame.local(self.data.geom_xpos[geom])
            yield Shape(geom, position, frame.rotation.T @ self.data.geom_xmat[geom].reshape(3, 3))

    def _below(self, body: int) -> list[int]:
        """Solid shapes of a body and of all that hangs on it."""
        return [
            geom
            for geom in range(self.model.ngeom)
            if self._is_solid(geom) and body in self._ancestry(geom)
        ]

    def _of_finger(self, joint: str) -> list[int]:
        return self._below(int(self.model.jnt_bodyid[self.model.joint(PREFIX + joint).id]))

    def _ancestry(self, geom: int) -> Iterator[int]:
        """The body of a shape, what carries that, and so on; not the world."""
        body = int(self.model.geom_bodyid[geom])
        while body:
            yield body
            body = int(self.model.body_parentid[body])

    def _is_solid(self, geom: int) -> bool:
        return bool(self.model.geom_contype[geom] or self.model.geom_conaffinity[geom])

    def _is_stem(self, geom: int) -> bool:
        return self.model.geom(geom).name.startswith(PREFIX + STEM)

    def _owner(self, geom: int) -> str:
        names = [self.model.body(body).name for body in self._ancestry(geom)]
        names.insert(0, self.model.geom(geom).name)
        for name in names:
            if name in self.scene.bodies:
                return name
        called = [name for name in names if name]
        return called[0].removeprefix(PREFIX) if called else "something fixed"
