"""Tags of a scene: sites named `tag_12`, each in the middle of tag 12 of the family tag36h11.

    <body name="mug" pos="0.5 0 0.8"> …
      <site name="tag_12" pos="0 0 0.1" size="0.02"/>

A site's x points right and its y up on the paper, its z out of it; `size` is half a side of the black
square, m, as everywhere in MJCF.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.scene.scene import Scene
from palpate.seeing.vision import CORNERS, TAGS

SITE = re.compile(r"tag_(\d{1,3})")
"""Name of a tag's site."""
SMALLEST, LARGEST = 0.002, 0.5
"""m: half sides of tags that are taken for ones; MJCF's default is 5 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A tag on a body.

    Attributes:
        number: of the family.
        half: half a side of its black square, m.
        body: name of the scene's body that it is on; "" for what stands still and is no surface.
        pose_world: where the scene has it.
    """

    number: int
    half: float
    body: str
    pose_world: Pose


def tags_of(scene: Scene) -> dict[int, Tag]:
    """Tags that a scene states, by number.

    Raises:
        InputError: a number beyond the family's, a size that is none, or a tag on a drawer or door.
    """
    shapes = scene.resolved.shapes
    model, data = shapes.model, shapes.data
    found: dict[int, Tag] = {}
    for i in range(model.nsite):
        name = model.site(i).name
        match = SITE.fullmatch(name)
        if match is None:
            continue
        number, half = int(match[1]), float(model.site_size[i, 0])
        if number >= TAGS:
            raise InputError(f"site '{name}': the family tag36h11 has tags 0 to {TAGS - 1}")
        if not SMALLEST <= half <= LARGEST:
            raise InputError(
                f"site '{name}': size=\"{half:g}\" is half a side of the tag's black square, m"
            )
        body = _body(scene, model, int(model.site_bodyid[i]))
        if body in scene.fixtures:
            raise InputError(
                f"site '{name}' is on '{body}', which moves: put the tag on something else"
            )
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, data.site_xmat[i])
        found[number] = Tag(number, half, body, Pose.of(data.site_xpos[i], quaternion))
    return found


def corners(half: float, pose: Pose) -> Array:
    """(4, 3) corners of a tag whose site has this pose, m."""
    return pose.position + (half * CORNERS) @ pose.rotation.T


def _body(scene: Scene, model: mujoco.MjModel, index: int) -> str:
    """The scene's body that a compiled one is, or is a part of."""
    while index > 0 and model.body(index).name not in scene.bodies:
        index = int(model.body_parentid[index])
    return model.body(index).name if index > 0 else ""
