"""Words a request may use."""

from __future__ import annotations

import pytest

from palpate.scene.describe import colour_words, name_words
from palpate.scene.load import parse_scene


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("green_bottle", {"green", "bottle", "green_bottle", "green bottle"}),
        ("greenBottle2", {"green", "bottle", "greenbottle2", "green bottle"}),
        ("USBHub", {"usb", "hub", "usbhub", "usb hub"}),
        ("red-box-3", {"red", "box", "red-box-3", "red box"}),
        ("hammer", {"hammer"}),
    ],
)
def test_names_are_split_into_words(name: str, words: set[str]) -> None:
    assert name_words(name) == words


@pytest.mark.parametrize(
    ("rgb", "word"),
    [
        ((1, 0, 0), "red"),
        ((0, 0, 1), "blue"),
        ((0, 1, 0), "green"),
        ((1, 1, 0), "yellow"),
        ((1, 1, 1), "white"),
        ((0, 0, 0), "black"),
        ((0.5, 0.5, 0.5), "gray"),
        ((0.6, 0.8, 1), "light blue"),
        ((0.6, 0.8, 1), "blue"),
        ((1, 0.5, 0), "orange"),
        ((0.4, 0.25, 0.1), "brown"),
    ],
)
def test_colours_have_words(rgb: tuple[float, float, float], word: str) -> None:
    assert word in colour_words(rgb)


def test_a_scene_has_words_for_names_bodies_and_colours() -> None:
    scene = parse_scene("""<mujoco><asset><material name="paint" rgba="1 0 0 1"/></asset>
      <default><default class="blue"><geom rgba="0 0 1 1"/></default></default><worldbody>
      <geom name="table" type="box" size="0.5 0.5 0.2"/>
      <body name="part1" pos="0.5 0 0.25"><freejoint/><geom type="box" size="0.02 0.02 0.05" material="paint"/></body>
      <body name="part2" pos="0.4 0 0.25"><freejoint/><geom type="cylinder" size="0.02 0.05" class="blue"/></body>
      </worldbody></mujoco>""")
    assert {"part", "red", "box"} <= scene.objects["part1"].words
    assert {"part", "blue", "cylinder"} <= scene.objects["part2"].words
    assert "box" not in scene.surfaces["table"].words
