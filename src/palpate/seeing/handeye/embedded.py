"""Fixtures of the embedded arm and its bench for calibrating a camera: a tag on the hand, or a camera on it and a tag
on the bench; each a little off and askew, as a person puts it there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from palpate.geometry.pose import Pose
from palpate.robots.description import RobotDescription
from palpate.robots.model import PREFIX
from palpate.seeing.lens import Lens, Mount
from palpate.seeing.rendered import SimulatedCamera

HAND = "hand"
"""Name of the camera on the embedded arm's hand, `world:hand`."""
HELD = Pose.of((0.07, 0.0, -0.07), (0.0, 1.0, 0.0, 0.0))
"""It beside the broad side of the hand that looks away from the base at home, looking along the tool, in the TCP's
frame."""
FOVY = 45.0
"""Its vertical field of view, degrees."""
STICKER = Pose.of((0.055, 0.0, -0.045), (0.5, -0.5, 0.5, -0.5))
"""A tag on that side of the hand, upright at home, in the TCP's frame; it is believed to be there to some cm."""
LYING = Pose.of((0.5, 0.0, 0.0))
"""A tag on the plane on which the arm stands, in the base's frame; likewise."""
OFF, ASKEW = 0.005, 0.05
"""m, uniform half width, and rad, 1 sigma, of a tag that somebody stuck there."""


def believed(seed: int) -> tuple[Lens, Mount]:
    """The lens and the place on the hand of the embedded arm's camera, as its owner has them."""
    alone = mujoco.MjSpec()
    camera: Any = alone.worldbody.add_camera(name=HAND, fovy=FOVY)
    camera.pos, camera.quat = HELD.position, HELD.quaternion
    alone.worldbody.add_geom(size=[0.01, 0.01, 0.01], pos=[0.0, 0.0, 0.3])
    owned = SimulatedCamera(alone, HAND, seed=seed)
    return owned.lens, replace(owned.mount, on_hand=True)


def with_camera(world: mujoco.MjSpec, arm: RobotDescription) -> mujoco.MjSpec:
    """The world with a camera on the arm's hand."""
    spec = world.copy()
    where = _in_hand(spec, arm, HELD)
    camera: Any = spec.body(PREFIX + arm.hand.body).add_camera(name=HAND, fovy=FOVY)
    camera.pos, camera.quat = where.position, where.quaternion
    return spec


def with_tag(
    world: mujoco.MjSpec,
    arm: RobotDescription,
    number: int,
    side: float,
    seed: int,
    on: Pose | None,
) -> mujoco.MjSpec:
    """The world with a tag, `side` m, on the hand, or about where `on` is in the world."""
    spec, random = world.copy(), np.random.default_rng([seed, *b"sticker"])
    off, turn = random.uniform(-OFF, OFF, 3), random.normal(0, ASKEW, 3)
    if on is not None:  # it lies flat
        off, turn = off * [1, 1, 0], turn * [0, 0, 1]
    askew = Pose(off, Pose.turn(turn).quaternion)
    if on is None:
        body, where = spec.body(PREFIX + arm.hand.body), _in_hand(spec, arm, STICKER @ askew)
    else:
        body, where = spec.worldbody, on @ askew
    tag: Any = body.add_site(name=f"tag_{number}")
    tag.pos, tag.quat, tag.size[0] = where.position, where.quaternion, side / 2
    return spec


def _in_hand(spec: mujoco.MjSpec, arm: RobotDescription, place: Pose) -> Pose:
    """A pose in the TCP's frame in that of the hand's body, whose axes are the same."""
    sites: list[Any] = list(spec.sites)
    tcp = next(site for site in sites if site.name == PREFIX + arm.tcp)
    return Pose(np.array(tcp.pos) + place.position, place.quaternion)
