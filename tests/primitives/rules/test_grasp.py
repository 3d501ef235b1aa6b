"""What the hand may close on: near the middle of the fingers, near its balance, not too heavy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.primitives.rules.grasp import ungraspable
from palpate.primitives.rules.grip import grip
from palpate.primitives.rules.motion import violations
from palpate.primitives.rules.solids import solids
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene

ROD = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02"/></body>
  <body name="rod" pos="0.5 0 0.012"><freejoint/>
    <geom type="box" size=".1 .012 .012" mass="{mass}"/></body>
</worldbody></mujoco>"""


def at_rod(x: float, y: float, mass: float = 1.5) -> SymbolicState:
    """Open fingers at the rod's grasp pose, moved by x and y in m."""
    scene = parse_scene(ROD.format(mass=mass))
    pose = scene.symbols.resolve("rod_pose").translate((x, y, 0.0))
    return replace(SymbolicState(scene), gripper="open", pose_world_tcp=pose)


@pytest.mark.parametrize(
    ("x", "y", "mass", "rules"),
    [
        (0.0, 0.0, 1.5, []),
        (0.0, 0.008, 1.5, []),
        (0.0, 0.015, 1.5, ["gripper-state"]),
        (0.02, 0.0, 1.5, []),
        (0.07, 0.0, 1.5, ["twist"]),
        (0.07, 0.0, 0.3, []),
        (0.0, 0.0, 3.5, ["payload"]),
    ],
)
def test_fingers_close_at_the_middle_of_an_object_within_their_payload(
    x: float, y: float, mass: float, rules: list[str]
) -> None:
    state = at_rod(x, y, mass)
    assert [found.rule for found in ungraspable(state, state.scene.body("rod"))] == rules


@pytest.mark.parametrize(
    ("friction", "priority", "rules"),
    [(0.3, 2, ["twist"]), (0.5, 2, []), (0.3, 0, []), (0.3, 1, [])],
)
def test_half_of_the_friction_of_the_pads_must_hold_the_weight(
    friction: float, priority: int, rules: list[str]
) -> None:
    """1.5 kg weigh 14.7 N, and the hand presses with 80 N; pads of priority 1 have a friction of 1."""
    text = ROD.format(mass=f'1.5" priority="{priority}" friction="{friction}')
    scene = parse_scene(text)
    pose = scene.symbols.resolve("rod_pose")
    state = replace(SymbolicState(scene), gripper="open", pose_world_tcp=pose)
    found = ungraspable(state, scene.body("rod"))
    assert [one.rule for one in found] == rules
    assert all("slide out of the pads" in one.message for one in found)


@pytest.mark.parametrize("end", [-1, 1])
def test_a_heavy_object_held_at_its_end_is_to_be_grasped_nearer_to_its_middle(end: int) -> None:
    scene = at_rod(0.0, 0.0).scene
    step = np.linalg.norm(scene.symbols.offset("x_offset", "rod_pose"))
    at = f"rod_pose + {end * 0.07 / step:.2f}*x_offset".replace("+ -", "- ")
    pose = scene.symbols.resolve(at)
    state = replace(SymbolicState(scene), gripper="open", pose_world_tcp=pose, at=at)
    (found,) = ungraspable(state, scene.body("rod"))
    nearer = found.message.partition("; MovePose to '")[2].partition("'")[0]
    middle = scene.symbols.resolve("rod_pose")
    assert pose.distance_to(middle) > 0.06
    assert scene.symbols.resolve(nearer).distance_to(middle) < 0.01


@pytest.mark.parametrize(("bite", "holds"), [(0.003, False), (0.006, True)])
def test_pads_hold_no_less_than_4_mm_of_an_end(bite: float, holds: bool) -> None:
    shapes = solids(at_rod(0.0, 0.0).scene)
    pad = shapes.pads["left finger"].geoms[0]
    state = at_rod(0.1 + float(shapes.model.geom_size[pad, 0]) - bite, 0.0)
    held = grip(solids(state.scene), "rod", state.tcp.inverse() @ state.pose_of("rod"))
    assert (held is not None) == holds


@pytest.mark.parametrize(("roll", "rules"), [(0.1, []), (0.5, ["tilted"])])
def test_a_held_object_stays_upright(roll: float, rules: list[str]) -> None:
    open_state = at_rod(0.0, 0.0)
    tcp = open_state.tcp
    held = tcp.inverse() @ open_state.pose_of("rod")
    high = tcp.translate((0.0, 0.0, 0.3))
    before = replace(open_state, gripper="closed", holding="rod", pose_tcp_object=held, lifted=True)
    states: list[SymbolicState] = []
    for turn in (0.0, roll):
        pose = high @ Pose.of((0.0, 0.0, 0.0), (np.cos(turn / 2), np.sin(turn / 2), 0.0, 0.0))
        states.append(replace(before, pose_world_tcp=pose, moved={"rod": pose @ held}))
    assert [found.rule for found in violations(*states)] == rules
