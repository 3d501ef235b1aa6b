"""Scenes in which a surface is as high as it was measured."""

from __future__ import annotations

import pytest

from palpate.scene.load import parse_scene, raise_surface, rearrange
from palpate.scene.scene import Scene

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 ?"><geom type="box" size=".3 .4 .02"/></body>
  <body name="tray" pos="0.5 -0.2 0.01"><geom type="box" size=".15 .12 .01"/></body>
  <body name="floor" pos="0.5 0.7 -0.02"><geom type="box" size=".3 .2 .02"/></body>
  <body name="book" pos="0.5 0.15 0.006"><freejoint/><geom type="box" size=".06 .05 .006"/></body>
  <body name="cup" pos="0.5 0.15 0.052"><freejoint/><geom type="cylinder" size=".03 .04"/></body>
  <body name="can" pos="0.5 -0.2 0.07"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
  <body name="ball" pos="0.4 0.7 0.03"><freejoint/><geom type="box" size=".03 .02 .03"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(SCENE)


def rises(before: Scene, after: Scene) -> dict[str, float]:
    return {
        name: round(body.bottom_z() - before.body(name).bottom_z(), 6)
        for name, body in after.bodies.items()
    }


@pytest.mark.parametrize("rise", [0.05, 0.003, -0.02, -0.05])
def test_stacks_and_trays_move_with_the_surface_and_nothing_else(scene: Scene, rise: float) -> None:
    after = raise_surface(scene, "table", rise)
    moved = {"table", "tray", "book", "cup", "can"}
    assert rises(scene, after) == {
        name: pytest.approx(rise if name in moved else 0.0, abs=1e-6) for name in scene.bodies
    }
    for name in ("book", "cup", "can", "ball"):
        up = (
            after.symbols.resolve(f"{name}_top").position
            - scene.symbols.resolve(f"{name}_top").position
        )
        assert up.tolist() == pytest.approx([0, 0, rise if name in moved else 0.0], abs=1e-6)


def test_an_object_that_floats_over_its_surface_by_belief_stands_on_it_once_measured() -> None:
    floats = parse_scene(SCENE.replace("0.5 0.15 0.006", "0.3 0.3 0.016"))
    after = raise_surface(floats, "table", 0.03)
    assert after.body("book").bottom_z() == pytest.approx(0.03, abs=1e-6)


def test_a_rearranged_scene_keeps_its_measured_heights(scene: Scene) -> None:
    after = raise_surface(scene, "table", 0.03)
    moved = after.body("can").pose_world.translate((0.0, 0.03, 0.0))
    again = rearrange(after, {"can": moved})
    assert again.body("can").pose_world.distance_to(moved) < 1e-6
    assert again.body("cup").bottom_z() == pytest.approx(after.body("cup").bottom_z(), abs=1e-6)
    assert again.body("table").top_z() == pytest.approx(0.03, abs=1e-6)
