"""Requests for a height and for what stands there, where the surface is higher or lower than guessed."""

from __future__ import annotations

from pathlib import Path

import pytest

import palpate as pp

KITCHEN = """<mujoco model="kitchen"><worldbody>
  <site name="robot_base" pos="0 0 0.70"/>
  <body name="counter" pos="0.58 -0.2 {counter}">
    <geom type="box" size=".28 .22 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="shelf" pos="0.55 0.32 {shelf}">
    <geom type="box" size=".22 .20 .015" friction="0.6 0.005 0.0001"/></body>
  <body name="can" pos="0.50 -0.12 {can}"><freejoint/>
    <geom type="cylinder" size=".033 .05" {mass_can} friction="0.7 0.005 0.0001"/></body>
  <body name="jar" pos="0.50 0.30 {jar}"><freejoint/>
    <geom type="cylinder" size=".030 .04" {mass_jar} friction="0.7 0.005 0.0001"/></body>
</worldbody></mujoco>"""
TOPS = {"counter": 0.74, "shelf": 0.815}
MASSES = {"can": 0.31, "jar": 0.25}
REQUEST = "the masses of the can and the jar and the heights of the counter and the shelf"


def measure(folder: Path, counter: float, shelf: float) -> pp.Run:
    """The kitchen, whose counter and shelf are so many m higher than its scene guesses."""
    there = {"can": TOPS["counter"] + 0.05, "jar": TOPS["shelf"] + 0.04}
    scene = KITCHEN.format(counter="?", shelf="?", mass_can="", mass_jar="", **there)
    off = {"can": there["can"] + counter, "jar": there["jar"] + shelf}
    masses = {f"mass_{name}": f'mass="{mass}"' for name, mass in MASSES.items()}
    planks = {"counter": 0.72 + counter, "shelf": 0.80 + shelf}
    (folder / "scene.xml").write_text(scene)
    (folder / "world.xml").write_text(KITCHEN.format(**planks, **off, **masses))
    return pp.run(
        folder / "scene.xml", REQUEST, world=folder / "world.xml", seed=0, fast=True, rehearse=False
    )


def require_right(run: pp.Run, counter: float, shelf: float) -> None:
    assert run.status == "complete"
    for name, mass in MASSES.items():
        found = run[f"{name}.mass"]
        assert abs(found.value[0] - mass) < 4 * found.std[0]
    for name, rise in (("counter", counter), ("shelf", shelf)):
        found = run[f"{name}.height"]
        assert abs(found.value[0] - TOPS[name] - rise) < 4 * found.std[0]


def test_surfaces_50_mm_off_in_opposite_directions_are_measured_and_what_stands_there(
    tmp_path,
) -> None:
    require_right(measure(tmp_path, 0.05, -0.05), 0.05, -0.05)


@pytest.mark.long
@pytest.mark.parametrize("off", [0.001, 0.003, 0.005, 0.010, 0.020, 0.030, 0.040, 0.050])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_height_is_measured_before_what_stands_there_is_grasped(tmp_path, off, side) -> None:
    require_right(measure(tmp_path, side * off, -side * off / 2), side * off, -side * off / 2)


def test_beyond_50_mm_the_height_is_measured_and_the_stop_says_what_to_write(tmp_path) -> None:
    run = measure(tmp_path, 0.07, 0.0)
    assert run.status == "aborted"
    assert run["counter.height"].value[0] == pytest.approx(0.81, abs=0.001)
    assert "measured 70 mm higher than the scene has it" in run.execution.stopped_by
    assert "write z 0.860 for 'can' and run again" in run.execution.stopped_by
