"""Drawer, doors, window and tap of metaworld and robosuite, where these are installed.

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
    <body pos="{x} 0 {height}" euler="0 0 -1.5708"><include file="../objects/{who}.xml"/></body>
  </worldbody>
</mujoco>"""
BARS = {
    "doorlockB": '<geom class="dl_col" euler="0 1.57 0"',
    "window_horiz": '<geom class="window_col" pos="-0.014 -0.095 0"',
    "drawer": '<geom class="drawer_col" euler="0 1.57 0"',
    "faucet": '<geom class="faucet_col" euler="1.57 0 0" pos="0 -0.12 0.001"',
}
"""How the bar of each handle begins: metaworld's geoms have no names."""


def installed(package: str, below: str) -> Path:
    """Folder of an installed package, which is not imported."""
    result = find_spec(package)
    if result is None or not result.submodule_search_locations:
        pytest.skip(f"{package} is not installed")
    return Path(result.submodule_search_locations[0]) / below


def metaworld(
    tmp: Path, child: str, unknown: tuple[str, str], kind: str, height: float, x: float = 0.72
) -> Path:
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
        scene = SCENE.format(kind=kind, who=who, x=x, height=height)
        (tmp / f"scenes/{who}.xml").write_text(scene)
    return tmp / "scenes"


def test_a_door_of_metaworld_is_measured(tmp_path):
    """Its damping is 2, by its class."""
    unknown = ('name="doorjoint"', 'name="doorjoint" damping="?"')
    there = metaworld(tmp_path, "doorlockB", unknown, "doorlock", 0.15)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["door_link.damping"])
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    result = run["door_link.damping"]
    assert result.verdict == "identified"
    assert result.ci95[0] < 2.0 < result.ci95[1]


def test_a_window_of_metaworld_is_measured(tmp_path):
    """Its damping is 2, and it has no dry friction. Lower than 0.2 m it would stand in the floor."""
    unknown = ('name="window_slide"', 'name="window_slide" damping="?"')
    there = metaworld(tmp_path, "window_horiz", unknown, "window", 0.21)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(
        measure=["windowb_a.damping", "windowb_a.frictionloss"]
    )
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    for id, true in (("damping", 2.0), ("frictionloss", 0.0)):
        result = run[f"windowb_a.{id}"]
        assert result.verdict == "identified"
        assert result.ci95[0] <= true < result.ci95[1]


def test_a_drawer_of_metaworld_is_measured_from_its_front(tmp_path):
    """Its bar is 100 mm long, and 52 mm below the edge of the front that it stands 51 mm off: from above, the palm
    would be in the front."""
    unknown = ('damping="2"', 'damping="?"')
    there = metaworld(tmp_path, "drawer", unknown, "drawer", 0.35, x=0.85)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["drawer_link.damping"])
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    result = run["drawer_link.damping"]
    assert result.verdict == "identified"
    assert result.ci95[0] < 2.0 < result.ci95[1]


def test_a_drawer_without_a_handle_by_name_says_so(tmp_path):
    unknown = ('damping="2"', 'damping="?"')
    there = metaworld(tmp_path, "drawer", unknown, "drawer", 0.35, x=0.85)
    file = tmp_path / "objects/scene.xml"
    file.write_text(re.sub(r'name="handle\d"', "", file.read_text()))
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["drawer_link.damping"])
    assert "no colliding geom has the name of a handle" in plan.explanation


def test_a_tap_of_metaworld_is_measured(tmp_path):
    unknown = ('name="knob_Joint_1"', 'name="knob_Joint_1" damping="?"')
    there = metaworld(tmp_path, "faucet", unknown, "faucet", 0.3, x=0.75)
    plan = pp.load(there / "scene.xml", root=tmp_path).plan(measure=["faucet_link2.damping"])
    run = plan.run(world=there / "world.xml", noise="lab", seed=1, fast=True)
    result = run["faucet_link2.damping"]
    assert result.verdict == "identified"
    assert result.ci95[0] < 2.0 < result.ci95[1]


def test_a_door_of_robosuite_is_measured_from_its_front(tmp_path):
    """Its lever is 65 mm before a panel that is higher. Its damping and its friction are 1."""
    text = (installed("robosuite", "models/assets/objects") / "door.xml").read_text()
    text = re.sub(r'<asset>.*?</asset>| material="\w+"', "", text, flags=re.DOTALL)
    base = '<compiler angle="radian"/><worldbody><site name="robot_base"/><body pos="0.8 0 0.4">'
    text, count = re.subn(r"<worldbody>\s*<body>", base, text)
    assert count == 1
    for who, damping in (("world", "1"), ("scene", "?")):
        (tmp_path / f"{who}.xml").write_text(text.replace('damping="1"', f'damping="{damping}"'))
    plan = pp.load(tmp_path / "scene.xml").plan(measure=["door.damping"])
    run = plan.run(world=tmp_path / "world.xml", noise="lab", seed=1, fast=True)
    result = run["door.damping"]
    assert result.verdict == "identified"
    assert result.ci95[0] < 1.0 < result.ci95[1]
