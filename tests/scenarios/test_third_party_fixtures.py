"""Drawers, doors and windows of metaworld and robosuite, where these are installed: measured, or refused by name.

Their files are read where they are installed, with one value removed, and stay theirs.
"""

from __future__ import annotations

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import palpate as pp

SCENE = """<mujoco>
  <include file="../objects/assets/{kind}_dependencies.xml"/><compiler angle="radian"/>
  <worldbody>
    <light pos="0 0 2"/><geom type="plane" size="2 2 .1"/><site name="robot_base"/>
    <body pos="0.72 0 {height}" euler="0 0 -1.5708"><include file="../objects/{who}.xml"/></body>
  </worldbody>
</mujoco>"""
BAR = '<geom class="dl_col" euler="0 1.57 0"'


def installed(package: str, below: str) -> Path:
    """Folder of an installed package, which is not imported."""
    found = find_spec(package)
    if found is None or not found.submodule_search_locations:
        pytest.skip(f"{package} is not installed")
    return Path(found.submodule_search_locations[0]) / below


def metaworld(tmp: Path, child: str, unknown: tuple[str, str], kind: str, height: float) -> Path:
    """Folder of scene and world of one of metaworld's fixtures; `unknown`: text and what stands for it in the scene."""
    assets = installed("metaworld", "assets")
    for part in ("objects", "textures"):
        shutil.copytree(assets / part, tmp / part)
    text = (tmp / f"objects/assets/{child}.xml").read_text()
    assert unknown[0] in text
    # Its geoms have no names: the bar across is its handle.
    for number in (1, 2):
        text = text.replace(BAR, f'<geom name="handle{number}"{BAR[5:]}', 1)
    (tmp / "scenes").mkdir()
    for who, content in (("world", text), ("scene", text.replace(*unknown))):
        (tmp / f"objects/{who}.xml").write_text(content)
        scene = SCENE.format(kind=kind, who=who, height=height)
        (tmp / f"scenes/{who}.xml").write_text(scene)
    return tmp / "scenes"


def test_a_door_of_metaworld_is_measured(tmp_path):
    """Its damping is 2, by its class."""
    unknown = ('name="doorjoint"', 'name="doorjoint" damping="?"')
    there = metaworld(tmp_path, "doorlockB", unknown, "doorlock", 0.15)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["door_link.damping"])
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    found = run["door_link.damping"]
    assert found.verdict == "identified"
    assert found.ci95[0] < 2.0 < found.ci95[1]


@pytest.mark.parametrize(
    ("child", "unknown", "name"),
    [
        ("drawer", ('damping="2"', 'damping="?"'), "drawer_link"),
        ("window_horiz", ('name="window_slide"', 'name="window_slide" damping="?"'), "windowb_a"),
    ],
)
def test_what_the_hand_cannot_take_from_above_is_refused_by_name(tmp_path, child, unknown, name):
    there = metaworld(tmp_path, child, unknown, child.split("_")[0], 0.1)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=[f"{name}.damping"])
    assert plan.tree is None
    assert f"'{name}' cannot be grasped" in plan.explanation
    assert "none of its colliding geoms is called a handle" in plan.explanation


def test_the_lever_of_robosuites_door_is_too_near_to_its_panel(tmp_path):
    text = (installed("robosuite", "models/assets/objects") / "door.xml").read_text()
    text = re.sub(r'<asset>.*?</asset>| material="\w+"', "", text, flags=re.DOTALL)
    base = '<compiler angle="radian"/><worldbody><site name="robot_base"/><body pos="0.72 0 0.32" euler="0 0 3.1416">'
    text, count = re.subn(r"<worldbody>\s*<body>", base, text)
    assert count == 1
    scene = tmp_path / "door.xml"
    scene.write_text(text.replace('damping="1"', 'damping="?"'))
    plan = pp.load(scene).plan(measure=["door.damping"])
    assert plan.tree is None
    assert "'door' cannot be grasped: its neighbours leave no room for the hand" in plan.explanation
    assert "called a handle" not in plan.explanation
