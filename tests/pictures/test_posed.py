"""The workplace as it is drawn: what is held moves with the hand, what is let go of stays."""

from __future__ import annotations

import numpy as np
from workbench import BOTTLE, MUG, bench

from palpate.geometry.pose import Pose
from palpate.pictures.posed import PosedCell

OVER = Pose.top_down((0.5, 0.0, 0.10), 0.0)
RAISED = Pose.top_down((0.5, 0.1, 0.30), 0.0)


def place(cell: PosedCell, name: str) -> np.ndarray:
    return cell.data.body(name).xpos.copy()


def test_what_is_held_moves_with_the_hand_and_stays_where_it_is_let_go() -> None:
    scene = bench(BOTTLE, MUG)
    cell, q = PosedCell(scene), np.array(scene.arm.home)
    cell.show(q, 0.08, OVER, None)
    before = place(cell, "bottle")
    cell.show(q, 0.06, OVER, "bottle")
    cell.show(q, 0.06, RAISED, "bottle")
    assert np.allclose(place(cell, "bottle") - before, [0.0, 0.1, 0.2], atol=1e-9)
    cell.show(q, 0.08, RAISED, None)
    cell.show(q, 0.08, OVER, None)
    assert np.allclose(place(cell, "bottle") - before, [0.0, 0.1, 0.2], atol=1e-9)
    assert np.allclose(place(cell, "mug"), scene.bodies["mug"].pose_world.position)


def test_put_back_is_where_the_scene_has_it() -> None:
    scene = bench(BOTTLE)
    cell, q = PosedCell(scene), np.array(scene.arm.home)
    cell.show(q, 0.06, OVER, "bottle")
    cell.show(q, 0.06, RAISED, "bottle")
    cell.put_back()
    cell.show(q, 0.08, RAISED, None)
    assert np.allclose(place(cell, "bottle"), scene.bodies["bottle"].pose_world.position)


def test_the_arm_is_at_its_joint_angles_and_the_fingers_are_apart() -> None:
    scene = bench(BOTTLE)
    cell, q = PosedCell(scene), np.array(scene.arm.home)
    cell.show(q, 0.05, RAISED, None)
    left, right = (place(cell, f"robot/{side}_finger") for side in ("left", "right"))
    assert np.isclose(np.linalg.norm(left - right), 0.05)
