"""Hand-eye calibration: fits to drawn pictures, the choice of poses, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.perception.hand_eye_fit import (
    BENT,
    ZEROS,
    CalibrationViews,
    HandEye,
    frame_of,
    hand_eye,
    surest,
)
from palpate.perception.lens import FACING, Lens, Mount, pinhole
from palpate.perception.solve import move_pose, pose_difference

pytest.importorskip("cv2")
LENS = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720), np.array([-0.08, 0.02, 0, 0, 0]), 0.01)
MOUNT = Mount(Pose.of((1.4, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5)), 0.005**2 * np.eye(6))
"""A camera that looks back along x."""
TAG = Pose.of((0.03, 0, 0), (0.5, 0.5, 0.5, 0.5))


@cache
def views(on_hand: bool) -> CalibrationViews:
    """120 poses of a hand before a camera, and of a camera before a tag, of an arm with made-up joints."""
    random = np.random.default_rng(0)
    hands: list[Pose] = []
    for _ in range(120):
        turn = Pose.turn(random.uniform(-0.6, 0.6, 3))
        hands.append(Pose(random.uniform((0.3, -0.3, 0.3), (0.8, 0.3, 0.7)), turn.quaternion))
    axes, anchors = random.standard_normal((7, 3)), random.uniform(-0.3, 0.3, (7, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    jacobians = np.array(
        [np.vstack([np.cross(axes, hand.position - anchors).T, axes.T]) for hand in hands]
    )
    # The tag stands where the camera was, and looks at the hand.
    mount = Mount(Pose.of((0.05, 0, 0), (0.5, 0.5, -0.5, -0.5)), MOUNT.covariance)
    frame = frame_of(hands, jacobians)
    return CalibrationViews(
        hands, jacobians, frame, 0.03, 1e-3, LENS, mount if on_hand else MOUNT, on_hand, 1e-4
    )


def standing_tag(on_hand: bool) -> Pose:
    return Pose.of((1.4, 0, 0.5), (0.5, -0.5, -0.5, 0.5)) if on_hand else TAG


def visible(on_hand: bool) -> list[int]:
    known = views(on_hand)
    local = known.local(known.camera, standing_tag(on_hand))
    pixels = LENS.project(np.maximum(local, [-9, -9, 0.1]).reshape(-1, 3)).reshape(-1, 8)
    inside = ((pixels > 20) & (pixels < 700)).all(axis=1) & (local[..., 2] > 0.1).all(axis=1)
    return np.flatnonzero(inside).tolist()


def drawn(
    random: np.random.Generator,
    known: CalibrationViews,
    tag: Pose,
    noise: float = 0.2,
    odd: int | None = None,
) -> tuple[HandEye, Array]:
    """A calibration by corners drawn as the fit takes them to be, and by how far it is off."""
    step = np.concatenate(
        [
            0.005 * random.standard_normal(6),
            0.01 * random.standard_normal(6),
            [0.01 * random.standard_normal(), 1e-3 * random.standard_normal()],
            ZEROS * random.standard_normal(7),
        ]
    )
    place = math.hypot(1e-4, BENT)
    size = place * np.array([1, 1, 1, 2, 2, 2])
    corners = [
        known.some([i]).at(tag, step, size * random.standard_normal(6))[0]
        + noise * random.standard_normal((4, 2))
        for i in range(len(known.hands))
    ]
    if odd is not None:
        corners[odd] = corners[odd] + np.array([[6.0, 0], [0, 0], [0, 0], [0, 0]])
    found = hand_eye(known, corners)
    wanted = move_pose(known.camera, (known.wanted() @ step)[:6]) @ FACING
    return found, pose_difference(found.mount.pose_world_camera, wanted)


@pytest.mark.parametrize("on_hand", [False, True])
def test_errors_are_as_large_as_the_covariance_says(on_hand: bool) -> None:
    random, squares = np.random.default_rng(3), list[float]()
    shown = visible(on_hand)
    assert len(shown) > 20
    some = views(on_hand).some(shown)
    known = some.some(surest(some, standing_tag(on_hand), 10))
    for _ in range(4):
        found, off = drawn(random, known, standing_tag(on_hand))
        squares.append(off @ np.linalg.solve(found.mount.covariance[:6, :6], off) / 6)
        assert not found.refused
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.4


def test_the_chosen_poses_tell_more_than_the_first_ones() -> None:
    some = views(False).some(visible(False))
    chosen = some.some(surest(some, TAG, 10))
    found, _ = drawn(np.random.default_rng(0), chosen, TAG)
    first, _ = drawn(np.random.default_rng(0), some.some(range(10)), TAG)
    size, other = (np.trace(one.mount.covariance[:3, :3]) for one in (found, first))
    assert size < 0.7 * other


def test_a_corner_that_is_led_astray_is_refused() -> None:
    known = views(False).some(visible(False)[:14])
    found, off = drawn(np.random.default_rng(1), known, TAG, odd=4)
    assert found.refused == (4,)
    z = off / np.sqrt(np.diag(found.mount.covariance)[:6])
    assert np.abs(z).max() < 4
    assert abs(found.noise - 0.2) < 0.1


def test_pictures_that_do_not_fit_together_are_refused() -> None:
    known = views(False).some(visible(False)[:8])
    random = np.random.default_rng(2)
    corners = [known.some([i]).at(TAG, np.zeros(21))[0] for i in range(8)]
    shaken = [where + random.uniform(-60, 60, 2) for where in corners]
    with pytest.raises(InputError, match="too few: is it flat"):
        hand_eye(known, shaken)
    with pytest.raises(InputError, match="of 5 pictures"):
        hand_eye(known.some(range(5)), corners[:5])


def test_a_first_joint_s_wrong_zero_does_not_matter() -> None:
    """No picture shows it, and the arm works in the frame that it turns."""
    known = views(False)
    turned = np.concatenate(
        [
            np.cross([0, 0, 1.0], [hand.position for hand in known.hands]),
            np.tile([0, 0, 1.0], (120, 1)),
        ],
        axis=1,
    )
    jacobians = np.zeros((120, 6, 7))
    jacobians[:, :, 0] = turned
    some = replace(known, jacobians=jacobians, frame=frame_of(known.hands, jacobians))
    step = np.zeros(21)
    step[14] = ZEROS
    # Where everything is turned by the zero, the camera is seen as it was.
    x, y, _ = known.camera.position
    step[:6] = [-y * ZEROS, x * ZEROS, 0, 0, 0, ZEROS]
    assert (some.wanted() @ step)[:6] == pytest.approx(np.zeros(6), abs=1e-9)
    index = visible(False)[0]
    before, after = (some.some([index]).at(TAG, one) for one in (np.zeros(21), step))
    assert after == pytest.approx(before, abs=0.01)
