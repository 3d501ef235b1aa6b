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
BARS = {
    "doorlockB": '<geom class="dl_col" euler="0 1.57 0"',
    "window_horiz": '<geom class="window_col" pos="-0.014 -0.095 0"',
    "drawer": '<geom class="drawer_col" euler="0 1.57 0"',
}
"""How the bar of each handle begins: metaworld's geoms have no names."""


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
    bar = BARS[child]
    assert bar in text
    for number in (1, 2):
        text = text.replace(bar, f'<geom name="handle{number}"{bar[5:]}', 1)
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


def test_a_window_of_metaworld_is_measured(tmp_path):
    """Its damping is 2, and it has no dry friction. Lower than 0.2 m it would stand in the floor."""
    unknown = ('name="window_slide"', 'name="window_slide" damping="?"')
    there = metaworld(tmp_path, "window_horiz", unknown, "window", 0.21)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(
        measure=["windowb_a.damping", "windowb_a.frictionloss"]
    )
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    for id, true in (("damping", 2.0), ("frictionloss", 0.0)):
        found = run[f"windowb_a.{id}"]
        assert found.verdict == "identified"
        assert found.ci95[0] <= true < found.ci95[1]


def test_the_front_of_metaworlds_drawer_stands_above_its_handle(tmp_path):
    """Its bar is 100 mm long, and 52 mm below the edge of the front that it stands 51 mm off."""
    there = metaworld(tmp_path, "drawer", ('damping="2"', 'damping="?"'), "drawer", 0.1)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["drawer_link.damping"])
    assert plan.tree is None
    assert "its neighbours leave no room for the hand" in plan.explanation
    assert "called a handle" not in plan.explanation
    file = tmp_path / "objects/scene.xml"
    file.write_text(re.sub(r'name="handle\d"', "", file.read_text()))
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["drawer_link.damping"])
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
