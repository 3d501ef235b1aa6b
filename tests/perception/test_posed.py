"""The workplace as it is drawn: what is held moves with the hand, what is let go of stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from workbench import BOTTLE, MUG, bench

from palpate.common.pose import Pose
from palpate.perception.posed import PosedCell, played_again
from palpate.trace.samples import Trace

OVER = Pose.top_down((0.5, 0.0, 0.10), 0.0)
RAISED = Pose.top_down((0.5, 0.1, 0.30), 0.0)


def place(cell: PosedCell, name: str) -> np.ndarray:
    return cell.data.body(name).xpos.copy()


def test_a_held_object_moves_with_the_hand_and_stays_where_it_is_released() -> None:
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


def test_put_back_restores_the_poses_of_the_scene() -> None:
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


def test_a_trace_is_played_again_for_a_film(trace: Trace) -> None:
    leaves = tuple(
        replace(
            leaf, context=replace(leaf.context, holding="bottle" if 8 < leaf.end < 15 else None)
        )
        for leaf in trace.leaves
        if leaf.context is not None
    )
    scene = bench(BOTTLE, MUG)
    footage = played_again(scene, replace(trace, leaves=leaves))
    assert footage.believed
    assert len(footage.frames) == np.ceil(30 * (trace.t[-1] - trace.t[0]))
    joint = footage.model.body("bottle").jntadr[0]
    place = int(footage.model.jnt_qposadr[joint])
    way = np.array([qpos[place : place + 3] for _, qpos in footage.frames])
    times = np.array([t for t, _ in footage.frames])
    assert np.ptp(way[times < 8], axis=0).max() < 1e-9
    assert np.ptp(way[(times > 9) & (times < 15)], axis=0).max() > 0.01
    assert np.ptp(way[times > 16], axis=0).max() < 1e-9
