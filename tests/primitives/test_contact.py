"""The guarded motion through soft covers of unknown thickness, in a hidden world."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 {z}"><geom type="box" size=".3 .3 .03" friction="0.6"/></body>
  {cover}
</worldbody></mujoco>"""
COVER = """<body name="cover" pos="0.5 0 {pos}" gravcomp="1">
  <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="20" range="-.03 0"/>
  <geom type="box" size=".2 .2 .0005" mass="0.05"/></body>"""
EXCLUDE = '<contact><exclude body1="table" body2="cover"/></contact></mujoco>'
THICK = 0.015
"""m."""


def probed(tmp_path, bears: float, noise: str, seed: int) -> pp.Run:
    """Run of a probe for the height of a table, at z = 0, under a cover that bears `bears` N when it is flat."""
    world = tmp_path / "world.xml"
    cover = COVER.format(pos=THICK, stiffness=bears / THICK)
    world.write_text(SCENE.format(z=-0.03, cover=cover).replace("</mujoco>", EXCLUDE))
    poses = tmp_path / "poses.yaml"
    poses.write_text("places:\n  table_approach: {pos: [0.5, 0.0, 0.095], yaw: 0.0}\n")
    scene = pp.load(SCENE.format(z="?", cover=""), poses=poses)
    return scene.plan().run(world=world, noise=noise, seed=seed, fast=True)


@pytest.mark.parametrize("bears", [6.2, 12.0])
def test_a_cover_is_pressed_through_until_the_table_stops_the_tips(tmp_path, bears) -> None:
    run = probed(tmp_path, bears, "measured", 1)
    height = run["table.height"]
    assert height.verdict == "identified"
    assert height.ci95[0] < 0.0 < height.ci95[1]
    assert "something soft" in height.method
    # Pressed with 8 N more than the cover bears, and no knock beyond.
    assert np.abs(run.trace.samples.wrench[:, 2]).max() < bears + 16.0


def test_a_cover_that_carries_a_firm_press_is_no_table(tmp_path) -> None:
    run = probed(tmp_path, 60.0, "lab", 0)
    assert run["table.height"].verdict == "contradicted"
    assert np.abs(run.trace.samples.wrench[:, 2]).max() < 35.0
    assert run.status == "failed"
