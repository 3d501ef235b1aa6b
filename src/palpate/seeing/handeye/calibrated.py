"""The camera of a robot.yaml, where `palpate calibrate` found it."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Pose
from palpate.scene.scene import Scene
from palpate.seeing.lens import Lens, Mount

SAME = 5.0
"""Standard deviations of the focal length by which a camera is another one."""


def calibrated(scene: Scene, lens: Lens, mount: Mount | None) -> tuple[Lens, Mount | None]:
    """A camera's lens and place in the world as calibrated against the scene's arm; as they are where its
    robot.yaml has no calibrated camera, or another one."""
    config = scene.arm.config
    camera = None if config is None else config.camera
    if camera is None or camera.covariance is None or tuple(camera.size) != lens.size:
        return lens, mount
    focal = lens.size[1] / 2 / math.tan(math.radians(camera.fovy) / 2)
    zoom = focal / float(lens.matrix[1, 1])
    if abs(math.log(zoom)) > SAME * lens.focal_std:
        return lens, mount
    base = scene.arm.stands(scene.pose_world_base)
    turn = np.eye(7)
    turn[:3, :3] = turn[3:6, 3:6] = base.rotation
    placed = Mount(base @ Pose.of(camera.pos, camera.quat), turn @ camera.covariance @ turn.T)
    return lens.zoomed(zoom), placed
