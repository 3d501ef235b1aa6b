"""Close-ups for a vision model: every scene has one, names hide nothing, and white things can be told
from each other."""

from __future__ import annotations

import io
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from palpate.execution.simulated_cell import simulated_cell
from palpate.perception.annotate import STEP, Ground, closer_png
from palpate.perception.renderer import gl_available
from palpate.scene.load import parse_scene

usable, reason = gl_available()
needs_gl = pytest.mark.skipif(not usable, reason=reason)

TABLE = '<body name="table" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03" rgba=".9 .9 .88 1"/></body>'
FIXED = {
    "one stand": '<body name="stand" pos="0.5 0.03 ?"><geom type="box" size=".03 .03 .02"/></body>',
    "a stand of 5 mm": '<body name="stand" pos="0.5 0 ?"><geom type="box" size=".005 .005 .005"/></body>',
    "a stand on lines of the grid": '<body name="stand" pos="0.5 0.1 ?"><geom type="box" size=".1 .1 .1"/></body>',
    "two plinths on a table": TABLE
    + '<body name="a" pos="0.5 0.16 ?"><geom type="box" size=".08 .08 .02"/></body>'
    + '<body name="b" pos="0.5 -0.16 ?"><geom type="box" size=".08 .08 .02"/></body>',
    "one table": TABLE,
    "a geom of the world": '<geom name="plate" type="cylinder" pos="0.5 0 0.01" size=".06 .01"/>',
    "a floor alone": '<geom name="floor" type="plane" size="1 1 .1"/>',
}
NAMES = ("tray", "shelf", "drawer", "cup", "red_block")
KITCHEN = (
    '<light pos="0.4 -0.6 1.9" dir="0 0.2 -1" diffuse=".9 .9 .9"/>'
    '<light pos="0.4 0.6 1.9" dir="0 -0.2 -1" diffuse=".6 .6 .6"/>'
    + TABLE
    + """<body name="tray" pos="0.48 0.25 0.006"><geom type="box" size=".14 .10 .006" rgba=".3 .3 .35 1"/></body>
  <body name="shelf" pos="0.62 -0.42 0.17">
    <geom type="box" size=".12 .12 .01" rgba=".1 .7 .1 1"/>
    <geom type="box" pos="-.11 0 -.09" size=".01 .12 .08" rgba=".1 .7 .1 1"/></body>
  <body name="drawer" pos="0.75 0.30 0.06"><joint type="slide" axis="1 0 0" range="0 .1"/>
    <geom type="box" size=".005 .10 .05" pos=".08 0 0" rgba=".2 .2 .8 1"/></body>
  <body name="cup" pos="0.48 0.25 0.062"><freejoint/><geom type="cylinder" size=".035 .05" rgba="1 1 1 1"/></body>
  <body name="red_block" pos="0.60 -0.05 0.025"><freejoint/>
    <geom type="box" size=".03 .02 .025" rgba=".8 .05 .05 1"/></body>"""
)


def world(content: str) -> str:
    return f'<mujoco><worldbody><site name="robot_base"/>{content}</worldbody></mujoco>'


def pixels(picture: bytes | None) -> np.ndarray[tuple[int, ...], np.dtype[np.int16]]:
    assert picture is not None
    return np.asarray(Image.open(io.BytesIO(picture))).astype(np.int16)


def coloured(image: np.ndarray, channel: int) -> np.ndarray:
    """Where a colour is much stronger than the two others."""
    others = np.delete(image, channel, axis=2).max(axis=2)
    return (image[..., channel] > 50) & (others < 0.45 * image[..., channel])


@needs_gl
@pytest.mark.parametrize("scene", FIXED)
def test_scenes_of_a_few_small_fixed_bodies_have_pictures(scene: str) -> None:
    cell = simulated_cell(parse_scene(world(FIXED[scene])), seed=1)
    assert pixels(cell.picture()).std() > 5
    assert pixels(cell.closer()).std() > 5


@needs_gl
def test_furniture_near_the_objects_is_wholly_in_view_with_a_name_that_hides_nothing() -> None:
    cell = simulated_cell(parse_scene(world(KITCHEN)), seed=1)
    named = pixels(cell.closer())
    below = np.array([0.5, 0.0, -9.0])  # of which the picture shows no name
    bare = pixels(closer_png(cell.world.spec(), dict.fromkeys(NAMES, below)))
    for image in (pixels(cell.picture()), named):
        for channel in (0, 1, 2):
            seen = coloured(image, channel)
            assert seen.sum() > 300
            edges = (seen[0], seen[-1], seen[:, 0], seen[:, -1])
            assert not any(edge.any() for edge in edges)
    for channel in (0, 1, 2):  # but for the line to the name
        assert coloured(named, channel).sum() > 0.8 * coloured(bare, channel).sum()


@needs_gl
def test_a_white_cup_on_a_white_table_under_bright_lamps_is_not_overexposed() -> None:
    image = pixels(simulated_cell(parse_scene(world(KITCHEN)), seed=1).picture())
    light = image.min(axis=2)
    assert (light == 255).mean() < 0.001
    assert len(np.unique(light[light > 150])) > 20


@pytest.mark.parametrize("low", [-0.63, 0.47, 0.5, 0.59])
@pytest.mark.parametrize("width", [0.0, 0.01, 0.1, 0.19, 1.2])
@pytest.mark.parametrize("beside", [0.0, 0.3])
def test_a_grid_has_a_square_and_stays_on_the_table_where_that_is_wide(
    low: float, width: float, beside: float
) -> None:
    table = np.array([[low, 0.0, 0.0], [low + width, 0.6, 0.1]])
    ground = Ground.under(table + np.array([beside, 0.0, 0.1]), table)
    for axis in range(2):
        lines = ground.lines(axis)
        assert len(lines) >= 1 + (width > 0.0)
        assert all(b - a == pytest.approx(STEP) for a, b in pairwise(lines))
    assert ground.z == pytest.approx(0.1)
    if width > 0.2 and beside < 0.3:
        assert low - 1e-6 <= ground.low[0] < ground.high[0] <= low + width + 1e-6
