"""Collision model: the shapes of the scene and of the arm, their poses, and distances between them.

Nothing is simulated. Shapes are placed where they are believed to be, and `mj_geomDistance` measures
between the true shapes, not between their bounding boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple, TypeVar, cast

import mujoco
import numpy as np

from palpate.common.outline import Convex
from palpate.common.pose import Array, Frames, Pose
from palpate.mjcf.compile import compile_model
from palpate.mjcf.contacts import contact_friction
from palpate.mjcf.inertial import total_inertia
from palpate.mjcf.shapes import hull_edges, hull_points
from palpate.robots.description import PREFIX, RobotDescription
from palpate.robots.kinematics import (
    ANGLE_TOLERANCE,
    LIMIT_MARGIN,
    POSITION_TOLERANCE,
    inverse_kinematics,
    too_far,
    within_joint_limits,
)
from palpate.robots.nominal import NominalArm
from palpate.robots.sheet import Box
from palpate.robots.trajectory import rotation_vector, wrist_turn
from palpate.scene.scene import Scene

LEFT, RIGHT = "left finger", "right finger"
SIDES = {LEFT: 1.0, RIGHT: -1.0}  # The fingers, with the sign of the tool's y in which each opens
# m. A box of the description counts as part of a finger up to this distance inside the open pads.
NEAR_PAD = 0.002
STEM = "stem:"  # Prefix of the names of the boxes added for fingers
ORIGIN = Pose.of((0.0, 0.0, 0.0))
FAR = 10.0  # m: upper bound of every distance asked for
# m, largest position error of the TCP at which a configuration counts as reaching a pose.
REACHED = 0.002
CACHED_SCENES = 8
RECENT_RESULTS = 16  # Largest number of large results that are kept
CACHED_RESULTS = 20_000  # Largest number of cached results of one scene
T = TypeVar("T")


class Shape(NamedTuple):
    """A colliding shape: its geom id in the model, and its pose in the frame of its carrier."""

    geom: int
    position: Array
    rotation: Array


@dataclass(frozen=True, slots=True, eq=False)
class ShapeGroup:
    """Shapes of one carrier: k geom ids, positions (k, 3) and rotations (k, 3, 3)."""

    geoms: tuple[int, ...]
    positions: Array
    rotations: Array

    @classmethod
    def of(cls, shapes: Sequence[Shape]) -> ShapeGroup:
        """Stack shapes."""
        return cls(
            tuple(shape.geom for shape in shapes),
            np.array([shape.position for shape in shapes]).reshape(-1, 3),
            np.array([shape.rotation for shape in shapes]).reshape(-1, 3, 3),
        )

    def __iter__(self) -> Iterator[Shape]:
        return map(Shape, self.geoms, self.positions, self.rotations)

    def at(self, positions: Array, rotations: Array) -> Frames:
        """Place the carrier at `positions` (n, 3) and `rotations` (n, 3, 3)."""
        return Frames(
            positions[:, None] + self.positions @ rotations.transpose(0, 2, 1),
            rotations[:, None] @ self.rotations,
        )


@dataclass(frozen=True, eq=False)
class Solids:
    """All shapes of a scene and of its arm."""

    scene: Scene  # the scene
    model: mujoco.MjModel  # scene and arm, compiled with every unknown at its believed value
    objects: Mapping[str, ShapeGroup]  # each object's shapes, in its frame
    fixed: ShapeGroup  # shapes of static bodies, the arm's base among them, in the world
    owners: Mapping[int, str]  # name of each shape's body for people, by geom id
    # hand, fingers: shapes in the tool frame with the fingers closed; fingers by side
    hand: ShapeGroup
    fingers: Mapping[str, ShapeGroup]
    # Geom ids of the arm's moving links up to the hand, with the number of their joint.
    links: Mapping[int, int]
    _data: mujoco.MjData
    _segment: Array = field(default_factory=lambda: np.zeros(6))
    _configurations: dict[bytes, Array | None] = field(default_factory=dict[bytes, "Array | None"])
    _results: dict[object, object] = field(default_factory=dict[object, object])
    _recent: dict[object, object] = field(default_factory=dict[object, object])

    @cached_property
    def arm(self) -> NominalArm:
        """The nominal arm on its base in the world."""
        gravity = np.array([0.0, 0.0, -self.scene.gravity])
        return NominalArm(self.scene.arm, self.scene.pose_world_base, gravity)

    @cached_property
    def _joints(self) -> list[int]:
        """Places of the arm's joints in qpos."""
        return [int(self.model.joint(PREFIX + n).qposadr[0]) for n in self.scene.arm.joints]

    @cached_property
    def radii(self) -> Array:
        """(g,) m, bounding spheres of all geoms about their frames; 0 for a plane."""
        return np.array(self.model.geom_rbound)

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """Centres and half extents (g, 3), m, of the bounding boxes of all geoms, in their frames."""
        middle, half = self.model.geom_aabb[:, :3].copy(), self.model.geom_aabb[:, 3:].copy()
        plane = self.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        # A plane is a half-space: solid below.
        middle[plane], half[plane] = (0.0, 0.0, -FAR), (10 * FAR, 10 * FAR, FAR)
        return middle, half

    @cached_property
    def standing(self) -> Frames:
        """Poses of the fixed shapes, as one moment: positions (1, k, 3)."""
        return self.fixed.at(np.zeros((1, 3)), np.eye(3)[None])

    @cached_property
    def alike(self) -> Mapping[str, str]:
        """Map each object to the first one with the same shapes in its frame, whose cached results it shares."""
        model, found, first = self.model, dict[str, str](), dict[object, str]()
        for name, group in self.objects.items():
            geoms = list(group.geoms)
            # Compare types, meshes, sizes and poses of the shapes, rounded to 1e-9.
            figures = [model.geom_size[geoms], group.positions, group.rotations]
            kinds = (*model.geom_type[geoms].tolist(), *model.geom_dataid[geoms].tolist())
            key = (*kinds, *((np.round(figure, 9) + 0.0).tobytes() for figure in figures))
            found[name] = first.setdefault(key, name)
        return found

    @cached_property
    def pads(self) -> Mapping[str, ShapeGroup]:
        """Pads of each finger."""
        found: dict[str, ShapeGroup] = {}
        for side, finger in self.fingers.items():
            # Pads are the shapes whose friction overrides that of others; all of the finger otherwise.
            pads = [shape for shape in finger if self.model.geom_priority[shape.geom] > 0]
            found[side] = ShapeGroup.of(pads) if pads else finger
        return found

    def raised(self, scene: Scene) -> Solids:
        """Shapes of the same scene with some surfaces at other heights."""
        # Only fixed shapes move: poses of objects are stored in the objects' own frames.
        rises = [scene.rises.get(self.owners[geom], 0.0) for geom in self.fixed.geoms]
        fixed = replace(self.fixed, positions=self.fixed.positions + np.outer(rises, (0, 0, 1)))
        return replace(self, scene=scene, fixed=fixed, _results={}, _recent={})

    def centre_of_mass(self, name: str) -> Array:
        """(3,) m, believed centre of mass of an object, in its frame."""
        return self.get_or_compute(("com", name), lambda: total_inertia(self.model, name).com)

    def mass(self, name: str) -> float:
        """Believed mass of an object, kg."""
        return float(self.model.body(name).subtreemass[0])

    def friction(self, one: Iterable[int], other: Iterable[int]) -> float:
        """Least sliding friction among contacts of two groups of geoms; 0 without any."""
        pairs = product(one, other)
        return min((contact_friction(self.model, *pair) for pair in pairs), default=0.0)

    def get_or_compute(self, key: object, compute: Callable[[], T]) -> T:
        """Cached result of a key, computed if absent."""
        if len(self._results) > CACHED_RESULTS:
            self._results.clear()
        if key not in self._results:
            self._results[key] = compute()
        return cast("T", self._results[key])

    def recent(self, key: object, compute: Callable[[], T]) -> T:
        """Cached large result of a key; only the latest `RECENT_RESULTS` are kept."""
        if key not in self._recent:
            if len(self._recent) >= RECENT_RESULTS:
                self._recent.pop(next(iter(self._recent)))
            self._recent[key] = compute()
        return cast("T", self._recent[key])

    def configuration(self, pose_world_tcp: Pose) -> Array | None:
        """(7,) rad, joint angles to which the controller takes the arm at a pose; None out of reach."""
        key = pose_world_tcp.digits
        if key not in self._configurations:
            q = self.arm.reach(pose_world_tcp, self.scene.arm.home)
            # The controller's solver may end elsewhere. Search by inverse kinematics then.
            missed = self.arm.poses(q[None])[0, :3] - pose_world_tcp.position
            if not np.linalg.norm(missed) < REACHED:
                q = inverse_kinematics(self.scene.arm, pose_world_tcp, self.scene.pose_world_base)
            self._configurations[key] = q
        return self._configurations[key]

    def turn(self, start: Pose, end: Pose) -> Array:
        """Rotation vector (3,), rad, of the tool on the straight path from `start` to `end`.

        It is in the TCP's frame at `start`. For a large turn, the wrist joint decides the sense.
        """
        turn = rotation_vector(start.quaternion, end.quaternion)
        # A turn below 90° has a unique sense. Beyond that, the last joint's angles decide it.
        if turn @ turn < (np.pi / 2) ** 2:
            return turn
        q, bent = self.configuration(start), self.configuration(end)
        if q is None or bent is None:
            return turn
        return wrist_turn(start.quaternion, end.quaternion, float(bent[-1] - q[-1]))

    def reaches(self, pose_world_tcp: Pose) -> bool:
        """True if the arm can bring its TCP to a pose within its joint limits.

        The controller's own solution is tried first, then a search by inverse kinematics.
        """

        def compute() -> bool:
            arm, base = self.scene.arm, self.scene.pose_world_base
            # Cheap test first: the wrist may be farther away than the links reach.
            if too_far(arm, base.inverse() @ pose_world_tcp):
                return False
            q = self.configuration(pose_world_tcp)
            if q is None:
                return False
            (pose,) = self.arm.poses(q[None])
            there = Pose.of(pose[:3], pose[3:])
            # The controller's configuration counts if it meets the tolerances and the joint limits.
            near = there.distance_to(pose_world_tcp) < POSITION_TOLERANCE
            near &= there.angle_to(pose_world_tcp) < ANGLE_TOLERANCE
            if near and within_joint_limits(arm, q, LIMIT_MARGIN):
                return True
            return inverse_kinematics(arm, pose_world_tcp, base) is not None

        return self.get_or_compute(("reaches", pose_world_tcp.digits), compute)

    def links_at(self, q: Array) -> Frames:
        """Poses of the arm's moving shapes, in the order of `links`, at configurations (n, 7), rad."""
        geoms = list(self.links)
        positions = np.empty((len(q), len(geoms), 3))
        rotations = np.empty((len(q), len(geoms), 3, 3))
        for i, angles in enumerate(q):
            # Forward kinematics of MuJoCo, one configuration at a time.
            self._data.qpos[self._joints] = angles
            mujoco.mj_kinematics(self.model, self._data)
            positions[i] = self._data.geom_xpos[geoms]
            rotations[i] = self._data.geom_xmat[geoms].reshape(-1, 3, 3)
        return Frames(positions, rotations)

    def distance(
        self, first: int, here: Frames, i: int, second: int, there: Frames, j: int
    ) -> float:
        """Distance between two geoms, m; negative where they overlap.

        The geoms take the poses of shape `i` of `here` and shape `j` of `there`, at the first moment.
        """
        positions, rotations = self._placed
        # Write the poses into MuJoCo's state, from which the distance is computed.
        positions[first], positions[second] = here.positions[0, i], there.positions[0, j]
        rotations[first], rotations[second] = here.rotations[0, i], there.rotations[0, j]
        return mujoco.mj_geomDistance(self.model, self._data, first, second, FAR, self._segment)

    @cached_property
    def _placed(self) -> tuple[Array, Array]:
        """Poses of all geoms in `_data`: positions (g, 3), rotations (g, 3, 3)."""
        return self._data.geom_xpos, self._data.geom_xmat.reshape(-1, 3, 3)

    def between(self) -> Array:
        """(3,) m, midpoint of the shortest segment between the two geoms of the last `distance`."""
        return (self._segment[:3] + self._segment[3:]) / 2

    def convex(self, geom: int, position: Array, rotation: Array) -> Convex:
        """A shape at a position (3,) and rotation (3, 3) in the world."""
        points = hull_points(self.model, geom) @ rotation.T + position
        return Convex(points, hull_edges(int(self.model.geom_type[geom]), len(points)))


@lru_cache(CACHED_SCENES)
def solids(scene: Scene) -> Solids:
    """Shapes of a scene and its arm; compiled once for all measured heights."""
    if scene.as_given is not None:
        return solids(scene.as_given).raised(scene)
    # Compile the scene once and compute the poses of all geoms at zero configuration.
    model = compile_model(scene.spec_with(_solid_arm(scene.arm)))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    compiled = _Compiled(scene, model, data)
    return Solids(
        scene,
        model,
        objects=compiled.objects(),
        fixed=compiled.fixed(),
        owners={geom: compiled.owner(geom) for geom in range(model.ngeom)},
        hand=compiled.hand(),
        fingers=compiled.fingers(),
        links=compiled.links(),
        _data=data,
    )


def _solid_arm(arm: RobotDescription) -> mujoco.MjSpec:
    """Arm for collision queries."""
    # The base is solid here; in a simulation it collides with nothing. The description's boxes of
    # the fingers are added, since the MJCF may model only the pads.
    spec = arm.spec()
    base = spec.body(arm.base)
    if not any(geom.contype for geom in base.geoms):
        for geom in base.geoms:
            geom.contype = 1
    hand = spec.body(arm.hand.body)
    # Add a massless box for each finger box of the description.
    for i, (_, box) in enumerate(_stems(arm)):
        stem = hand.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=box.half, mass=0.0)
        stem.name, stem.contype = f"{STEM}{i}", 1
    return spec


def _stems(arm: RobotDescription) -> Iterator[tuple[str, Box]]:
    """Boxes of the open fingers, with their sides."""
    for box in arm.hand.boxes:
        y, half = float(box.centre[1]), float(box.half[1])
        if abs(y) - half > arm.hand.opening / 2 - NEAR_PAD:
            yield (LEFT if y > 0 else RIGHT), box


@dataclass(frozen=True, eq=False)
class _Compiled:
    """A compiled scene with an arm in it, at its zero configuration."""

    scene: Scene
    model: mujoco.MjModel
    data: mujoco.MjData

    def objects(self) -> dict[str, ShapeGroup]:
        found: dict[str, ShapeGroup] = {}
        for name in self.scene.objects:
            body = self.data.body(name)
            frame = Pose(body.xpos.copy(), body.xquat.copy())
            found[name] = self.shapes(frame, self.below(body.id))
        return found

    def fixed(self) -> ShapeGroup:
        # Shapes are fixed unless they belong to an object or to the arm beyond its base.
        moving = [PREFIX + self.scene.arm.links[1], *self.scene.objects]
        moved = {geom for name in moving for geom in self.below(self.model.body(name).id)}
        return self.shapes(ORIGIN, [geom for geom in self.solid if geom not in moved])

    def hand(self) -> ShapeGroup:
        # The fingers and their boxes are parts of the hand's subtree, but move separately.
        fingers = {geom for name in self.scene.arm.hand.fingers for geom in self.of_finger(name)}
        geoms = self.below(self.model.body(PREFIX + self.scene.arm.hand.body).id)
        stems = {geom for geom in geoms if self.model.geom(geom).name.startswith(PREFIX + STEM)}
        return self.shapes(self.tool(), [g for g in geoms if g not in fingers | stems])

    def fingers(self) -> dict[str, ShapeGroup]:
        tool, found = self.tool(), dict[str, ShapeGroup]()
        for name in self.scene.arm.hand.fingers:
            # The slide axis of a finger joint shows on which side the finger opens.
            axis = self.data.xaxis[self.model.joint(PREFIX + name).id]
            side = LEFT if axis @ tool.rotation[:, 1] > 0 else RIGHT
            found[side] = self.shapes(tool, self.of_finger(name))
        for i, (side, box) in enumerate(_stems(self.scene.arm)):
            geom = self.model.geom(f"{PREFIX}{STEM}{i}").id
            inwards = np.array([0.0, self.scene.arm.hand.opening / 2, 0.0])
            # The description has the open fingers; shapes are stored closed.
            closed = box.centre - SIDES[side] * inwards
            found[side] = ShapeGroup.of([*found[side], Shape(geom, closed, np.eye(3))])
        return found

    def links(self) -> dict[int, int]:
        found: dict[int, int] = {}
        for joint, name in enumerate(self.scene.arm.links[1:], start=1):
            body = self.model.body(PREFIX + name).id
            found |= {g: joint for g in self.solid if self.model.geom_bodyid[g] == body}
        return found

    def owner(self, geom: int) -> str:
        """Object or surface of a geom, else the nearest name of the geom or its bodies."""
        names, body = [self.model.geom(geom).name], int(self.model.geom_bodyid[geom])
        while body:
            names.append(self.model.body(body).name)
            body = int(self.model.body_parentid[body])
        # A name of the scene takes precedence over names of the arm's bodies.
        of_scene = [name for name in names if name in self.scene.bodies]
        called = [name.removeprefix(PREFIX) for name in names if name]
        return (*of_scene, *called, "something fixed")[0]

    def tool(self) -> Pose:
        arm = self.scene.arm
        site, hand = self.data.site(PREFIX + arm.tcp), self.data.body(PREFIX + arm.hand.body)
        return Pose(site.xpos.copy(), hand.xquat.copy())

    def shapes(self, frame: Pose, geoms: Iterable[int]) -> ShapeGroup:
        """Geoms with their poses in a frame."""
        found: list[Shape] = []
        for geom in geoms:
            rotation = frame.rotation.T @ self.data.geom_xmat[geom].reshape(3, 3)
            found.append(Shape(geom, frame.local(self.data.geom_xpos[geom]), rotation))
        return ShapeGroup.of(found)

    @cached_property
    def solid(self) -> list[int]:
        """Geoms that collide."""
        return np.flatnonzero(self.model.geom_contype | self.model.geom_conaffinity).tolist()

    def below(self, body: int) -> list[int]:
        """Colliding geoms of a body and of its descendants."""
        # MuJoCo numbers bodies depth first: the descendants of a body follow it.
        after = np.flatnonzero(self.model.body_parentid[body + 1 :] < body)
        end = body + 1 + int(after[0]) if len(after) else self.model.nbody
        return [geom for geom in self.solid if body <= self.model.geom_bodyid[geom] < end]

    def of_finger(self, joint: str) -> list[int]:
        return self.below(int(self.model.jnt_bodyid[self.model.joint(PREFIX + joint).id]))
