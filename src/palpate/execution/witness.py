"""Record of contact forces and object poses from MuJoCo's state, after every physics step.

It is independent of plans, checks and verdicts. `palpate.execution.harm` judges it.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.description import PREFIX
from palpate.robots.simulated.timing import Undoing

if TYPE_CHECKING:
    from palpate.robots.simulated.world import World


ALONG = 0.7  # Least cosine between a contact normal and the closing axis for a contact of a grip
LET_GO = 0.02  # s without grip contacts until an object counts as released
LOOK = 10  # Physics steps between two records of the poses: 5 ms. A fall of 13 mm takes 51 ms.
LEANING = 0.7  # Largest |n_z| of the normal of a contact that supports an object sideways
# Least cosine between a push and the opposing normal for a contact that resists the push.
FACING = 0.5
SHOVED = 25.0  # N, least horizontal force for which the supports of the object are tested
BALL = int(mujoco.mjtGeom.mjGEOM_SPHERE)
# Types of geoms of revolution about their z axis.
REVOLVED = (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE))

Ints = NDArray[np.int32]
Mask = NDArray[np.bool_]
Frames = list[list[float]]  # Contacts' axes in the world: normal, two tangents


class Pair(NamedTuple):
    """Contact pair: a body of the robot or the gripped object, and another body."""

    part: str
    thing: str
    load: bool  # The part is the gripped object


@dataclass(slots=True)
class ContactForces:
    """A pair's contact force, one row for every physics step in which they touched."""

    steps: array[int] = field(default_factory=lambda: array("q"))  # number of the step
    # Three components for every step, N, world axes, on the touched body.
    vectors: array[float] = field(default_factory=lambda: array("d"))
    # Steps in which another body supported the touched body sideways.
    blocked: set[int] = field(default_factory=set[int])

    def first(self, count: int) -> ContactForces:
        """Contact forces of the first `count` steps."""
        steps = self.steps[:count]
        return ContactForces(steps, self.vectors[: 3 * count], self.blocked.intersection(steps))

    def rows(self) -> tuple[Ints, Array]:
        """(n,) steps and (n, 3) forces."""
        return np.array(self.steps, dtype=np.int32), np.array(self.vectors).reshape(-1, 3)


class PoseRecord(NamedTuple):
    """Poses at one moment."""

    step: int  # the physics step
    poses: Array  # (objects, 7)
    hand: Array  # (4,) quaternion of the hand
    held: int  # index of the gripped object, -1 for none
    touched: Mask  # (objects,) touching anything


class Touching(NamedTuple):
    """Contacts of a step, classified by the held object; independent of the forces."""

    pairs: list[list[int]]  # the two geoms of each contact
    mine: list[int]  # contacts of the robot and of the gripped object
    # Contacts of a finger with an object: numbers of contact, finger and object.
    fingers: list[tuple[int, int, int]]
    # Contacts with other bodies: number of the contact, pair, sign of its force.
    presses: list[tuple[int, Pair, float]]
    touched: Mask  # (objects,) touching anything


class Witness(Undoing):
    """Observer of a simulation: of every physics step."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Record the first poses; the positions in `data` must be computed."""
        self._model = model
        self.period = float(model.opt.timestep)  # s, the shortest physics step
        self.steps = 0
        self.forces: dict[Pair, ContactForces] = {}  # contact forces by pair
        self._name_geoms()
        # Objects are the bodies with a free joint.
        free = [b for b in range(1, model.nbody) if _is_free(model, b)]
        self.objects = tuple(model.body(b).name for b in free)  # names of the free bodies
        self.masses = tuple(float(model.body_subtreemass[b]) for b in free)  # their masses, kg
        # (3,) axis of revolution of each object in its own frame, about which it may roll. Zero for
        # a ball, None for other shapes.
        self.axes = tuple(_axis(model, b) for b in free)
        number = {body: i for i, body in enumerate(free)}
        roots: list[int] = model.body_rootid[model.geom_bodyid].tolist()
        self._object = np.array([number.get(root, -1) for root in roots], dtype=np.int32)
        # Drawers and doors can be gripped, but are no objects: they are numbered after the objects.
        moving: list[int] = model.body_weldid[model.geom_bodyid].tolist()
        self._graspable = [
            number.get(root, len(free) + body if body and model.body_dofnum[body] else -1)
            for root, body in zip(roots, moving, strict=True)
        ]
        # Masks over the geoms: of the robot, and of the robot with its load.
        self._robot = np.array([_is_robot(model, b) for b in model.geom_bodyid])
        self._mine = self._robot.copy()
        self._object_of, self._robot_geoms = self._object.tolist(), _set(self._robot)
        # Addresses of the seven coordinates of each object in qpos.
        first = [int(model.jnt_qposadr[model.body_jntadr[b]]) for b in free]
        self._qpos = np.array([range(i, i + 7) for i in first], dtype=np.int32).reshape(-1, 7)
        self._find_fingers()
        self._gripped: dict[int, int] = {}
        self._held = -1
        self._let_go = LET_GO / self.period
        self._force = np.zeros(6)
        self._still = mujoco.MjData(model)  # for the kinematics of recorded configurations
        self._known: tuple[bytes, int] | None = None
        # Poses every 5 ms, the first ones before any motion.
        self.looks: list[PoseRecord] = []
        self._look(data, np.zeros(len(free), dtype=bool))

    @classmethod
    def of(cls, world: World) -> Witness:
        """Attach a witness to a robot's world."""
        witness = cls(world.model, world.data())
        world.watch = witness
        return witness

    def __call__(self, data: mujoco.MjData) -> None:
        """Record one physics step."""
        touching = self._who_touches(data.contact.geom)
        if touching.mine:
            self._note_forces(data, touching)
        if self._is_look_due():
            self._look(data, touching.touched)

    def pass_untouched(self, qpos: Array) -> None:
        """Record steps in which nothing touches anything, by the configurations `qpos` (n, nq) after each of them."""
        nothing = np.zeros(len(self.objects), dtype=bool)
        for row in qpos:
            if self._is_look_due():
                self._still.qpos[:] = row
                mujoco.mj_kinematics(self._model, self._still)
                self._look(self._still, nothing)

    def _is_look_due(self) -> bool:
        """Count a step, and test if the poses are recorded after it."""
        # Without grip contacts for some time, the object counts as released.
        if self.steps - self._gripped.get(self._held, self.steps) > self._let_go:
            self._hold(-1)
        # A longer step counts for several.
        self.steps += round(self._model.opt.timestep / self.period)
        return self.steps % LOOK == 0

    def mark(self) -> Callable[[], None]:
        """Return a function that undoes all steps from now on."""
        # Keep only the lengths of the records, since these grow at their ends.
        steps, looks, held = self.steps, len(self.looks), self._held
        gripped, rows = dict(self._gripped), {p: len(f.steps) for p, f in self.forces.items()}

        def undo() -> None:
            self.steps, self._gripped = steps, gripped
            self._hold(held)
            del self.looks[looks:]
            self.forces = {pair: self.forces[pair].first(count) for pair, count in rows.items()}

        return undo

    def _who_touches(self, geoms: Ints) -> Touching:
        # Most steps have the same contacts as the step before.
        pairs = geoms.tobytes(), self._held
        if pairs != self._known:
            self._known, self._last = pairs, self._looked_up(geoms)
        return self._last

    def _looked_up(self, geoms: Ints) -> Touching:
        # Contacts in which a geom of the robot or of its load takes part.
        mine = np.flatnonzero(self._mine.take(geoms).any(axis=1)).tolist()
        pairs: list[list[int]] = geoms.tolist()
        fingers: list[tuple[int, int, int]] = []
        for i in mine:
            side, other = self._sides(pairs[i])
            finger, thing = self._finger.get(side), self._graspable[other]
            if finger is not None and thing >= 0 and other not in self._robot_geoms:
                fingers.append((i, finger, thing))
        # The last entry collects geoms without an object (number -1).
        touched = np.zeros(len(self.objects) + 1, dtype=bool)
        touched[self._object.take(geoms)] = True
        return Touching(pairs, mine, fingers, self._presses(pairs, mine), touched[:-1])

    def _presses(self, pairs: list[list[int]], mine: list[int]) -> list[tuple[int, Pair, float]]:
        found: list[tuple[int, Pair, float]] = []
        for i in mine:
            side, other = self._sides(pairs[i])
            load = side not in self._robot_geoms
            if not self._is_own(side, other, load):
                # MuJoCo states the force of the first geom on the second.
                sign = 1.0 if side == pairs[i][0] else -1.0
                found.append((i, Pair(self._part[side], self._part[other], load), sign))
        return found

    def _note_forces(self, data: mujoco.MjData, touching: Touching) -> None:
        """Record the forces of the robot and of the gripped object on all other bodies."""
        frames: Frames = data.contact.frame.tolist()
        held = self._held
        grips = self._grips(data, touching.fingers, frames)
        presses = touching.presses
        if self._held != held:
            presses = self._presses(touching.pairs, touching.mine)
        # Sum the contact forces of each pair, without those of the commanded grip.
        sums: dict[Pair, list[float]] = {}
        for i, pair, sign in presses:
            if i not in grips:
                self._add(data, i, sign, frames[i], sums.setdefault(pair, [0.0, 0.0, 0.0]))
        for pair, (x, y, z) in sums.items():
            forces = self.forces.setdefault(pair, ContactForces())
            forces.steps.append(self.steps)
            forces.vectors.extend((x, y, z))
            # A hard push is worse where another body supports the object from the other side.
            shoved = x * x + y * y > SHOVED**2
            if shoved and self._has_block(pair.thing, (x, y), touching.pairs, frames):
                forces.blocked.add(self.steps)

    def _grips(
        self, data: mujoco.MjData, fingers: Iterable[tuple[int, int, int]], frames: Frames
    ) -> set[int]:
        """Numbers of the contacts of the commanded grip.

        Both fingers touch one object, with normals along the closing axis.
        """
        if not fingers:
            return set()
        found: dict[int, dict[int, list[int]]] = {}
        # Contacts of each finger by object, if the normal is along the closing axis.
        x, y, z = data.xaxis[self._closing].tolist()
        for i, finger, thing in fingers:
            normal = frames[i]
            if abs(normal[0] * x + normal[1] * y + normal[2] * z) > ALONG:
                found.setdefault(thing, {}).setdefault(finger, []).append(i)
        grips: set[int] = set()
        for thing, sides in found.items():
            if len(sides) < 2:
                continue
            if thing < len(self.objects):
                self._gripped[thing] = self.steps
                self._hold(thing)
            grips.update(i for contacts in sides.values() for i in contacts)
        return grips

    def _add(
        self, data: mujoco.MjData, i: int, sign: float, frame: list[float], total: list[float]
    ) -> None:
        mujoco.mj_contactForce(self._model, data, i, self._force)
        normal, first, second = self._force[:3].tolist()  # components in the contact's frame
        for axis in range(3):
            along = normal * frame[axis] + first * frame[3 + axis] + second * frame[6 + axis]
            total[axis] += sign * along

    def _is_own(self, mine: int, other: int, load: bool) -> bool:
        """True for contacts of the held object with itself or the fingers, and between the fingers."""
        if load:
            return self._object_of[other] == self._held
        if mine in self._finger and other in self._finger:
            return True
        return self._held >= 0 and self._object_of[other] == self._held and mine in self._finger

    def _sides(self, pair: list[int]) -> tuple[int, int]:
        """Order a contact's geoms: that of the robot, or else of the load, comes first."""
        one, two = pair
        if one in self._robot_geoms:
            return one, two
        if two in self._robot_geoms or self._object_of[one] != self._held:
            return two, one
        return one, two

    def _has_block(
        self, thing: str, push: tuple[float, float], pairs: list[list[int]], frames: Frames
    ) -> bool:
        """True if a body other than the robot supports `thing` against a horizontal push."""
        for (one, two), frame in zip(pairs, frames, strict=True):
            involved = thing in (self._part[one], self._part[two])
            others = not (self._mine[one] or self._mine[two])
            # The normal points from the first geom to the second.
            sign = 1.0 if self._part[two] == thing else -1.0
            along = sign * (frame[0] * push[0] + frame[1] * push[1])
            against = along < -FACING * math.hypot(*push)
            if involved and others and against and abs(frame[2]) < LEANING:
                return True
        return False

    def _hold(self, thing: int) -> None:
        """Set the held object by its number; -1 for none."""
        if thing == self._held:
            return
        self._held = thing
        self._mine = self._robot.copy()
        if thing >= 0:
            self._mine |= self._object == thing

    def _look(self, data: mujoco.MjData, touched: Mask) -> None:
        """Record the poses."""
        poses, hand = data.qpos[self._qpos], data.xquat[self._hand].copy()
        self.looks.append(PoseRecord(self.steps, poses, hand, self._held, touched))

    def _name_geoms(self) -> None:
        """Name each geom by its body; geoms of the world body keep their own names."""
        model = self._model
        self._part: list[str] = []
        for geom, body in enumerate(model.geom_bodyid.tolist()):
            name = model.body(body).name if body else model.geom(geom).name
            self._part.append(name or f"geom {geom}")

    def _find_fingers(self) -> None:
        """Find the fingers and the hand.

        Fingers are the robot's sliding joints, and the hand is their parent body.
        """
        model = self._model
        self._finger: dict[int, int] = {}
        self._hand = self._closing = 0
        for joint in range(model.njnt):
            body = int(model.jnt_bodyid[joint])
            if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE or not _is_robot(model, body):
                continue
            self._hand, self._closing = int(model.body_parentid[body]), joint
            for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
                self._finger[geom] = joint


def _is_robot(model: mujoco.MjModel, body: int) -> bool:
    return model.body(int(body)).name.startswith(PREFIX)


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    first = int(model.body_jntadr[body])
    return first >= 0 and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE


def _axis(model: mujoco.MjModel, body: int) -> Array | None:
    """Axis of revolution (3,) of a body with a single colliding geom, in the body's frame."""
    # Colliding geoms of the body's whole tree.
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    geoms = np.flatnonzero(solid & (model.body_rootid[model.geom_bodyid] == body)).tolist()
    # Only a single sphere, cylinder or capsule rolls.
    kinds = {int(model.geom_type[geom]) for geom in geoms}
    if len(geoms) != 1 or model.geom_bodyid[geoms[0]] != body or not kinds <= {BALL, *REVOLVED}:
        return None
    axis, quaternion = np.zeros(3), model.geom_quat[geoms[0]]
    if BALL not in kinds:
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), quaternion)
    return axis


def _set(mask: Mask) -> set[int]:
    return set(np.flatnonzero(mask).tolist())
