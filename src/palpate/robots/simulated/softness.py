"""A scene's own softness, where the fingers meet it.

The pads have priority over what they touch: MuJoCo then takes friction, solref and solimp of the
contact from them, and a mat would be as hard as the pads. So what says itself how hard it is gets
explicit pairs with the fingers, in which it keeps that; the friction stays the pads'.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from palpate.robots.description import RobotDescription
from palpate.robots.model import PREFIX
from palpate.robots.simulated.touchable import is_robots

HARDNESS = ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))
"""MuJoCo's defaults of solref and solimp: a geom that has them says nothing (XMLreference, geom)."""


def keep_softness(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Add a pair for each shape of the scene that says how hard it is and each of the fingers' that
    would override it. The arm is in `world` already."""
    pads = list(_pads(world, arm))
    for i, geom in enumerate(_soft(world)):
        geom.name = geom.name or f"{PREFIX}soft{i}"
        for pad in pads:
            if pad.priority > geom.priority and _meet(pad, geom):
                _pair(world, pad, geom)


def _pads(world: mujoco.MjSpec, arm: RobotDescription) -> Iterator[mujoco.MjsGeom]:
    """All shapes of the fingers."""
    for name in arm.hand.fingers:
        yield from world.joint(PREFIX + name).parent.geoms


def _soft(world: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """The shapes of the scene that say how hard they are."""
    return [geom for geom in world.geoms if not is_robots(geom) and _says(geom)]


def _says(geom: mujoco.MjsGeom) -> bool:
    solref, solimp = HARDNESS
    return not (np.allclose(geom.solref, solref) and np.allclose(geom.solimp, solimp))


def _meet(one: mujoco.MjsGeom, other: mujoco.MjsGeom) -> bool:
    """Test if the collision bits let the two collide: an explicit pair would ignore them."""
    return bool(one.contype & other.conaffinity or other.contype & one.conaffinity)


def _pair(world: mujoco.MjSpec, pad: mujoco.MjsGeom, geom: mujoco.MjsGeom) -> None:
    """Add the contact pair that MuJoCo would make itself, except for the softness."""
    slide, turn, roll = np.asarray(pad.friction, dtype=float)
    pair = world.add_pair(
        world.find_default(PREFIX + "main"), geomname1=pad.name, geomname2=geom.name
    )
    pair.condim, pair.margin = pad.condim, pad.margin + geom.margin
    pair.friction = (slide, slide, turn, roll, roll)
    pair.solref, pair.solimp = geom.solref, geom.solimp
