"""Objects about where the scene has them, and nothing else another."""

from pathlib import Path

import numpy as np
import pytest

from palpate.cells.simulated import SimulatedCell
from palpate.parameter import Parameter
from palpate.scene.load import load_scene
from palpate.settings import Settings
from palpate.studies.places import about_there

CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .6 .02"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/>{cup}<geom type="box" size=".03 .02 .05"/></body>
</worldbody></mujoco>"""
TRUTH = '<inertial pos="0.01 0 0.003" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>'
BELIEVED = '<inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>'
COM = Parameter("cup", "com")


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    for name, cup in {"scene": BELIEVED, "world": TRUTH}.items():
        (tmp_path / f"{name}.xml").write_text(CELL.format(cup=cup), encoding="utf-8")
    return Settings(scene=tmp_path / "scene.xml", world=tmp_path / "world.xml")


def cell(settings: Settings, seed: int, poses: str | None = None) -> SimulatedCell:
    assert settings.scene is not None
    file = None
    if poses is not None:
        file = settings.scene.with_name("poses.yaml")
        file.write_text(poses, encoding="utf-8")
    asked = Settings(scene=settings.scene, world=settings.world, poses=file, seed=seed)
    made = about_there(asked, load_scene(settings.scene, file))
    assert isinstance(made, SimulatedCell)
    return made


def shift(made: SimulatedCell) -> np.ndarray:
    return made.world.body("cup").pose_world.position - np.array([0.5, 0.1, 0.05])


def test_an_object_stands_off_in_the_plane_and_the_scene_does_not_know(settings: Settings) -> None:
    made = cell(settings, seed=3)
    aside = shift(made)
    assert aside[2] == pytest.approx(0.0, abs=1e-12)
    assert 1e-5 < np.abs(aside[:2]).max() < 2e-3
    assert made.scene is not None
    assert made.scene.body("cup").pose_world.position == pytest.approx([0.5, 0.1, 0.05])


def test_it_is_moved_as_a_whole(settings: Settings) -> None:
    assert cell(settings, seed=3).truth(COM) == pytest.approx((0.01, 0.0, 0.003))


def test_each_seed_draws_its_own_place_and_always_the_same(settings: Settings) -> None:
    first, again, other = (shift(cell(settings, seed)) for seed in (3, 3, 4))
    assert first == pytest.approx(again)
    assert first != pytest.approx(other)


def test_what_poses_say_of_their_accuracy_is_how_far(settings: Settings) -> None:
    usual, rough = shift(cell(settings, 3)), shift(cell(settings, 3, "accuracy: 0.002"))
    assert rough == pytest.approx(4.0 * usual)


def test_a_world_drawn_from_the_scene_keeps_what_was_drawn(settings: Settings) -> None:
    made = cell(Settings(scene=settings.scene), seed=3)
    assert np.abs(shift(made)).max() > 1e-5
    assert made.truth(COM) == made.drawn[COM]
