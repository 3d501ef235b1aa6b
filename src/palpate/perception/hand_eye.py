"""Calibrated camera poses, the simulated bench for a calibration, and plots of residuals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.common.errors import InputError
from palpate.common.files import write_new
from palpate.common.pose import Pose
from palpate.perception.hand_eye_fit import HandEye, uncertainty
from palpate.perception.lens import Lens, Mount
from palpate.perception.rendered import SimulatedCamera
from palpate.perception.renderer import png
from palpate.robots.description import PREFIX, RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.scene.scene import Scene

SAME = 5.0  # Standard deviations. Maximum difference in focal length of the same camera.

Hand = Callable[[], Pose]  # Returns the current pose of the TCP in the world


def calibrated_camera(
    scene: Scene, lens: Lens, mount: Mount | None, hand: Hand | None = None
) -> tuple[Lens, Mount | None]:
    """Return the lens and world pose of a camera, as calibrated with the scene's arm.

    Without a calibration, both stay as given. A camera on the hand moves with the hand: at `hand`,
    else at the joints of the mount, else at home. Its covariance includes the pose error of the
    hand. Raises InputError: the mount has another number of joints than the arm.
    """
    lens, mount = _calibrated_place(scene, lens, mount)
    if mount is None or not mount.on_hand:
        return lens, mount
    base = scene.arm.stands(scene.pose_world_base)
    # Pose of the hand: measured, else by forward kinematics.
    nominal = NominalArm(scene.arm, base, np.zeros(3))
    q = scene.arm.home if mount.joints is None else mount.joints
    if len(q) != len(scene.arm.joints):
        raise InputError(
            f"the camera's file has {len(q)} 'joints', and the arm '{scene.arm.name}' has "
            f"{len(scene.arm.joints)}: give one angle a joint"
        )
    if hand is None:
        row = nominal.poses(q[None])[0]
        pose = Pose(row[:3], row[3:])
    else:
        pose = hand()
        q = nominal.reach(pose, q)  # approximate: the elbow hardly matters
    # Transform the mount to the world.
    seen = mount.within(pose)
    # Add the pose error of the arm at the camera, rotated from the base to the world.
    lever = base.rotation.T @ (seen.pose_world_camera.position - pose.position)
    turn = np.kron(np.eye(2), base.rotation)
    covariance = seen.covariance.copy()
    covariance[:6, :6] += turn @ uncertainty(scene.arm, q, lever) @ turn.T
    return lens, replace(seen, covariance=covariance)


def _calibrated_place(scene: Scene, lens: Lens, mount: Mount | None) -> tuple[Lens, Mount | None]:
    """Return the calibrated lens and pose of a camera.

    Both stay as given if robot.yaml has no calibrated camera, or a camera of another size or focal
    length.
    """
    config = scene.arm.config
    camera = None if config is None else config.camera
    if camera is None or camera.covariance is None or tuple(camera.size) != lens.size:
        return lens, mount
    # Compare the focal lengths: f = h / (2 tan(fovy / 2)).
    focal = lens.size[1] / 2 / math.tan(math.radians(camera.fovy) / 2)
    zoom = focal / float(lens.matrix[1, 1])
    if abs(math.log(zoom)) > SAME * lens.focal_std:
        return lens, mount
    joints = None if mount is None else mount.joints
    found = Mount(Pose.of(camera.pos, camera.quat), camera.covariance, camera.on_hand, joints)
    base = scene.arm.stands(scene.pose_world_base)
    return lens.zoom_lens(zoom), found if camera.on_hand else found.within(base)


# Simulated calibration bench: a tag on the hand, or a camera on the hand and a tag on the bench.
# Each has a small placement error, as by a person.


HAND = "hand"  # Name of the camera on the hand of the embedded arm, `world:hand`
# Pose of this camera in the TCP's frame. It is mounted at the broad side of the hand that faces
# away from the base at home. It looks along the tool.
HELD = Pose.of((0.07, 0.0, -0.07), (0.0, 1.0, 0.0, 0.0))
FOVY = 45.0  # degrees. Vertical field of view of this camera.
# Nominal pose of a tag on that side of the hand, upright at home, in the TCP's frame. The prior has
# an error of some cm.
STICKER = Pose.of((0.055, 0.0, -0.045), (0.5, -0.5, 0.5, -0.5))
# Nominal pose of a tag on the base plane of the arm, in the base frame. The prior has an error of
# some cm.
LYING = Pose.of((0.5, 0.0, 0.0))
# m and rad. Placement error of a tag: uniform half width in position, standard deviation in
# rotation.
OFF, ASKEW = 0.005, 0.05


def believed_camera(seed: int) -> tuple[Lens, Mount]:
    """Return the lens and mount of the embedded arm's hand camera, as specified by its owner."""
    alone = mujoco.MjSpec()
    camera: Any = alone.worldbody.add_camera(name=HAND, fovy=FOVY)
    camera.pos, camera.quat = HELD.position, HELD.quaternion
    alone.worldbody.add_geom(size=[0.01, 0.01, 0.01], pos=[0.0, 0.0, 0.3])
    owned = SimulatedCamera(alone, HAND, seed=seed)
    return owned.lens, replace(owned.mount, on_hand=True)


def with_camera(world: mujoco.MjSpec, arm: RobotDescription) -> mujoco.MjSpec:
    """Return the world with a camera on the hand of the arm."""
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
    """Return the world with a tag on the hand or on the bench, with a random placement error.

    The black square of the tag has the `side`, m. `on` is its nominal pose in the world; None for a tag on the
    hand.
    """
    spec, random = world.copy(), np.random.default_rng([seed, *b"sticker"])
    # Placement error; a tag on the bench lies flat.
    off, turn = random.uniform(-OFF, OFF, 3), random.normal(0, ASKEW, 3)
    if on is not None:  # flat on the bench
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
    """Transform a pose from the TCP's frame to that of the hand's body, with parallel axes."""
    sites: list[Any] = list(spec.sites)
    tcp = next(site for site in sites if site.name == PREFIX + arm.tcp)
    return Pose(np.array(tcp.pos) + place.position, place.quaternion)


# Plot of calibration residuals: every measured corner with a magnified line to its fitted position.


LONGER = 100  # Magnification of residuals
INK, PALE, RED = (30, 30, 30), (190, 190, 190), (200, 60, 40)
MARGIN = 12  # px. Margin around text.


def draw_residuals(found: HandEye, path: Path) -> None:
    """Write a PNG with the residuals of a calibration."""
    picture = Image.new("RGB", found.lens.size, (255, 255, 255))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(16)
    for corners, residuals in zip(found.corners, found.residuals, strict=True):
        # Measured square in grey, residuals in red.
        draw.polygon([(x, y) for x, y in corners.tolist()], outline=PALE)
        for (x, y), (u, v) in zip(corners.tolist(), residuals.tolist(), strict=True):
            draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=INK)
            draw.line((x, y, x + LONGER * u, y + LONGER * v), fill=RED, width=2)
    size = math.sqrt(float(np.mean(found.residuals**2)))
    words = (
        f"{len(found.corners)} pictures of the tag, {len(found.refused)} left out; residuals {LONGER} times as long, "
        f"{size:.2f} pixels rms"
    )
    draw.text((MARGIN, MARGIN), words, fill=INK, font=font)
    write_new(path, png(np.asarray(picture)))
