"""Top-down grasps from geometry."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.scene.load import parse_scene

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03"/></body>
  <body name="box" pos="{} {} 0.03"><freejoint/><geom type="box" size=".025 {} .03"/></body>
</worldbody></mujoco>"""


def closing(x: float, y: float, half_width: float):
    """(2,) direction in which the fingers close on a box, seen from above."""
    scene = parse_scene(SCENE.format(x, y, half_width))
    return scene.symbols.poses["box_pose"].rotation[:2, 1]


@pytest.mark.parametrize("place", [(0.36, 0.0), (0.5, 0.0), (0.36, -0.18)])
def test_a_square_box_is_grasped_across_the_direction_to_it(place) -> None:
    """The wrist turns little: else the elbow of a folded arm gives way to the side."""
    away = np.array(place) / np.linalg.norm(place)
    assert abs(closing(*place, 0.025) @ away) < np.sin(np.radians(60.0))


def test_a_narrow_box_is_grasped_across_its_narrow_side_for_any_wrist_angle() -> None:
    assert abs(closing(0.36, 0.0, 0.037)[0]) == pytest.approx(1.0)


def test_a_tool_is_grasped_at_its_handle_and_not_at_its_thin_shaft() -> None:
    """The shaft holds the middle of the length, and the handle most of the area."""
    scene = parse_scene("""<mujoco><worldbody><site name="robot_base"/>
      <body name="table" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03"/></body>
      <body name="driver" pos="0.5 0 0.0125"><freejoint/>
        <geom type="capsule" size=".012 .04" pos="-.07 0 0" euler="0 90 0"/>
        <geom type="cylinder" size=".004 .06" pos=".03 0 0" euler="0 90 0"/></body>
    </worldbody></mujoco>""")
    assert scene.symbols.poses["driver_pose"].position[0] == pytest.approx(0.43, abs=0.02)
