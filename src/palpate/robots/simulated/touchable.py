"""Shapes that the robot can touch: all of the scene that can collide at all.

MuJoCo lets two shapes collide where a bit of one's `contype` is in the other's `conaffinity`. Which
bits a scene uses is its own affair; a hand would pass through what has none of the robot's.
"""

from __future__ import annotations

import mujoco

from palpate.errors import InputError
from palpate.robots.model import PREFIX

BITS = 31
"""Of a non-negative 32 bit integer."""


def let_touch(world: mujoco.MjSpec) -> None:
    """See that the robot, which is in `world` already, meets each shape of the scene that can touch
    something, without a change to what meets what in the scene.

    Raises:
        InputError: every bit is in use, so that none is left for it.
    """
    robot = [geom for geom in world.geoms if is_robots(geom) and geom.contype]
    others = [geom for geom in world.geoms if not is_robots(geom)]
    solid = [shape for shape in (*others, *world.flexes) if shape.contype or shape.conaffinity]
    shared = 1
    for geom in robot:
        shared &= geom.contype
    if all(shared & shape.conaffinity for shape in solid):
        return
    own = _free_bit(world)
    for geom in robot:
        geom.contype |= own
    for shape in solid:
        shape.conaffinity |= own


def is_robots(geom: mujoco.MjsGeom) -> bool:
    """Test if a shape of the world belongs to the robot in it."""
    return geom.parent.name.startswith(PREFIX)


def _free_bit(world: mujoco.MjSpec) -> int:
    """A bit that no shape uses."""
    used = 0
    for shape in (*world.geoms, *world.flexes):
        used |= shape.contype | shape.conaffinity
    for i in range(BITS):
        if not used >> i & 1:
            return 1 << i
    raise InputError(
        "the scene's shapes use every bit of contype and conaffinity, so that none is left by which "
        "the robot could touch them; use fewer"
    )
