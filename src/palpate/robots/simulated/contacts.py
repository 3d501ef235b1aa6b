"""Contacts of the simulated world: collision bits, softness of the scene, and static friction."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError, unknown_name
from palpate.robots.description import PREFIX, RobotDescription

BITS = 31  # of a non-negative 32 bit integer
# MuJoCo's defaults of solref and solimp. A geom with these values states no softness (XMLreference,
# geom).
HARDNESS = ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))
STATIC_FRICTION = "static_friction_"
# m/s: speed from which an object counts as sliding. It is well above MuJoCo's creep and well below
# any commanded slide.
SLIP = 0.002
OWN, FIXED = 1, 2  # geoms of the object, and of bodies that never move


def let_touch(world: mujoco.MjSpec) -> None:
    """Let the robot in `world` collide with each shape of the scene that can collide at all.

    MuJoCo lets two shapes collide where a bit of one's `contype` is in the other's `conaffinity`. A scene
    may use bits that the robot's shapes lack, so that these would pass through each other. Contacts within
    the scene stay unchanged. Raises InputError: every bit is in use.
    """
    robot = [geom for geom in world.geoms if is_robots(geom) and geom.contype]
    others = [geom for geom in world.geoms if not is_robots(geom)]
    solid = [shape for shape in (*others, *world.flexes) if shape.contype or shape.conaffinity]
    # A bit that all shapes of the robot have may already suffice.
    shared = 1
    for geom in robot:
        shared &= geom.contype
    if all(shared & shape.conaffinity for shape in solid):
        return
    # Otherwise a bit that no shape uses connects the robot with every solid shape.
    used = 0
    for shape in (*world.geoms, *world.flexes):
        used |= shape.contype | shape.conaffinity
    free = [1 << i for i in range(BITS) if not used >> i & 1]
    if not free:
        raise InputError(
            "the scene's shapes use every bit of contype and conaffinity, so that none is left by "
            "which the robot could touch them; use fewer"
        )
    for geom in robot:
        geom.contype |= free[0]
    for shape in solid:
        shape.conaffinity |= free[0]


def is_robots(geom: mujoco.MjsGeom) -> bool:
    """Test if a shape of the world belongs to the robot in it."""
    return geom.parent.name.startswith(PREFIX)


def keep_softness(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Keep the stated softness of the scene's shapes in contact with the fingers of `arm`.

    The pads have priority over the shapes that they touch. MuJoCo then takes friction, solref and solimp
    of the contact from the pads, and a mat would be as hard as the pads. So a shape that states its
    softness gets an explicit pair with each finger shape, with its own softness and the pads' friction.
    """
    pads = [pad for name in arm.hand.fingers for pad in world.joint(PREFIX + name).parent.geoms]
    solref, solimp = HARDNESS
    soft = [
        geom
        for geom in world.geoms
        if not is_robots(geom)
        and not (np.allclose(geom.solref, solref) and np.allclose(geom.solimp, solimp))
    ]
    for i, geom in enumerate(soft):
        geom.name = geom.name or f"{PREFIX}soft{i}"
        for pad in pads:
            # An explicit pair would ignore the collision bits.
            meet = pad.contype & geom.conaffinity or geom.contype & pad.conaffinity
            if meet and pad.priority > geom.priority:
                add_soft_pair(world, pad, geom)


def add_soft_pair(world: mujoco.MjSpec, pad: mujoco.MjsGeom, geom: mujoco.MjsGeom) -> None:
    """Add the contact pair that MuJoCo would make itself, with the softness of `geom`."""
    slide, turn, roll = np.asarray(pad.friction, dtype=float)
    pair = world.add_pair(
        world.find_default(PREFIX + "main"), geomname1=pad.name, geomname2=geom.name
    )
    pair.condim, pair.margin = pad.condim, pad.margin + geom.margin
    pair.friction = (slide, slide, turn, roll, roll)
    pair.solref, pair.solimp = geom.solref, geom.solimp


@dataclass(frozen=True, slots=True, eq=False)
class Stiction:
    """Static and dynamic friction of an object.

    MuJoCo has one coefficient of sliding friction, but static friction of real surfaces exceeds dynamic
    friction. A world declares the static coefficient of an object with `<custom><numeric
    name="static_friction_NAME" data="0.41"/></custom>`. The `friction` of the object's geoms is the
    dynamic coefficient.
    """

    geoms: tuple[int, ...]  # ids of the object's geoms
    dof: int  # first of its free joint's degrees of freedom
    static: float  # static coefficient of sliding friction
    dynamic: tuple[float, ...]  # dynamic coefficient of each geom
    sides: NDArray[np.int8]  # per geom of the world: `OWN`, `FIXED`, else 0

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Set the coefficient for the speed at which the object slides on static bodies.

        An object in the air keeps the coefficient of its last contact, and lands with it.
        """
        # Contacts between the object and a fixed body.
        sides = self.sides.take(data.contact.geom)
        on_fixed = sides[:, 0] + sides[:, 1] == OWN + FIXED
        if not on_fixed.any():
            return
        # Slip is the horizontal speed of the contact points, v + ω × r, not of the body's origin: an object
        # turns in the fingers' grip before its base slips.
        body = model.geom_bodyid[self.geoms[0]]
        linear, turning = data.qvel[self.dof : self.dof + 3], data.qvel[self.dof + 3 : self.dof + 6]
        wx, wy, wz = data.xmat[body].reshape(3, 3) @ turning
        x, y, z = (data.contact.pos[on_fixed] - data.xpos[body]).T
        slip = np.hypot(linear[0] + (wy * z - wz * y), linear[1] + (wz * x - wx * z)).max()
        for geom, dynamic in zip(self.geoms, self.dynamic, strict=True):
            model.geom_friction[geom, 0] = dynamic if slip > SLIP else self.static


def declared_stiction(model: mujoco.MjModel) -> tuple[Stiction, ...]:
    """Read the static friction declared in the model's `<custom>`.

    Raises InputError: a declaration names no object of the world, or less than its dynamic friction.
    """
    numerics = [model.numeric(i) for i in range(model.nnumeric)]
    return tuple(
        stiction_of(model, n.name.removeprefix(STATIC_FRICTION), float(n.data[0]))
        for n in numerics
        if n.name.startswith(STATIC_FRICTION)
    )


def stiction_of(model: mujoco.MjModel, name: str, static: float) -> Stiction:
    """Find the geoms and the friction coefficients of the object `name`."""
    free = {
        model.body(i).name: i
        for i in range(model.nbody)
        if model.body_jntnum[i] == 1
        and model.jnt_type[model.body_jntadr[i]] == mujoco.mjtJoint.mjJNT_FREE
    }
    key = STATIC_FRICTION + name
    if name not in free:
        raise unknown_name("object", name, free, f"It is named by the world's numeric '{key}'.")
    body, first = free[name], int(model.body_geomadr[free[name]])
    geoms = tuple(range(first, first + int(model.body_geomnum[body])))
    dynamic = tuple(float(model.geom_friction[g, 0]) for g in geoms)
    if any(static < d for d in dynamic):
        raise InputError(
            f"'{key}' is {static:g}, below the object's friction {max(dynamic):g}: static friction "
            "must not be less than dynamic friction"
        )
    sides = np.where(model.body_weldid[model.geom_bodyid] == 0, FIXED, 0).astype(np.int8)
    sides[list(geoms)] = OWN
    return Stiction(geoms, int(model.body_dofadr[body]), static, dynamic, sides)
