"""Pose of a camera in the world: by its intrinsics file, or by the robot.yaml that `palpate calibrate` wrote; of one
on the hand by the pose of the hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.geometry.pose import Pose
from palpate.robots.nominal import NominalArm
from palpate.scene.scene import Scene
from palpate.seeing.handeye.arm import uncertainty
from palpate.seeing.lens import Lens, Mount

SAME = 5.0
"""Standard deviations of the focal length by which a camera is another one."""

Hand = Callable[[], Pose]
"""Pose of the TCP in the world, now."""


def calibrated(
    scene: Scene, lens: Lens, mount: Mount | None, hand: Hand | None = None
) -> tuple[Lens, Mount | None]:
    """A camera's lens, and its place in the world: as calibrated against the scene's arm, else as believed. One on the
    hand is where that is: as `hand` says, else at the mount's joints, else at home."""
    lens, mount = _found(scene, lens, mount)
    if mount is None or not mount.on_hand:
        return lens, mount
    base = scene.arm.stands(scene.pose_world_base)
    nominal = NominalArm(scene.arm, base, np.zeros(3))
    q = scene.arm.home if mount.joints is None else mount.joints
    if hand is None:
        row = nominal.poses(q[None])[0]
        pose = Pose(row[:3], row[3:])
    else:
        pose = hand()
        q = nominal.reach(pose, q)  # about: how the elbow stands hardly matters
    seen = mount.within(pose)
    lever = base.rotation.T @ (seen.pose_world_camera.position - pose.position)
    turn = np.kron(np.eye(2), base.rotation)
    covariance = seen.covariance.copy()
    covariance[:6, :6] += turn @ uncertainty(scene.arm, q, lever) @ turn.T
    return lens, replace(seen, covariance=covariance)


def _found(scene: Scene, lens: Lens, mount: Mount | None) -> tuple[Lens, Mount | None]:
    """Lens and place as calibrated; as they are where robot.yaml has no calibrated camera, or another one."""
    config = scene.arm.config
    camera = None if config is None else config.camera
    if camera is None or camera.covariance is None or tuple(camera.size) != lens.size:
        return lens, mount
    focal = lens.size[1] / 2 / math.tan(math.radians(camera.fovy) / 2)
    zoom = focal / float(lens.matrix[1, 1])
    if abs(math.log(zoom)) > SAME * lens.focal_std:
        return lens, mount
    joints = None if mount is None else mount.joints
    found = Mount(Pose.of(camera.pos, camera.quat), camera.covariance, camera.on_hand, joints)
    base = scene.arm.stands(scene.pose_world_base)
    return lens.zoomed(zoom), found if camera.on_hand else found.within(base)
