"""The table is higher or lower than guessed: the arm measures its height, then what stands on it."""

from __future__ import annotations

import pytest

import palpate as pp

pytestmark = pytest.mark.long

TOP, MASS = 0.12, 0.34

ONE = """<mujoco><worldbody><site name="robot_base"/>
  <body name="desk" pos=".45 0 {desk}"><geom type="box" size=".5 .6 .02" friction=".8"/></body>
  <body name="tin" pos=".5 .12 {tin}"><freejoint/>
    <geom type="cylinder" size=".03 .06" {mass} friction=".8"/></body></worldbody></mujoco>"""

SEVERAL = """<mujoco><worldbody><site name="robot_base"/>
  <body name="floor" pos=".45 0 .03"><geom type="box" size=".5 .6 .02" friction=".8"/></body>
  <body name="desk" pos=".5 .22 {desk}"><geom type="box" size=".15 .16 .02" friction=".8"/></body>
  <body name="tin" pos=".55 .25 {tin}"><freejoint/>
    <geom type="cylinder" size=".03 .06" {mass} friction=".8"/></body>
  <body name="cube" pos=".42 .16 {cube}"><freejoint/>
    <geom type="box" size=".025 .025 .025" mass=".2" friction=".8"/></body>
  <body name="cup" pos=".42 .16 {cup}"><freejoint/>
    <geom type="cylinder" size=".022 .03" {mass} friction=".8"/></body></worldbody></mujoco>"""

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


def scene(text: str, off: float | None = None) -> str:
    """The scene as given, or the hidden world, whose desk is `off` m higher than guessed."""
    top = TOP + (off or 0.0)
    return text.format(
        desk="?" if off is None else top - 0.02,
        tin=top + 0.06,
        cube=top + 0.025,
        cup=top + 0.08,
        mass="" if off is None else f'mass="{MASS}"',
    )


def measured(text: str, request: str, off: float) -> pp.Run:
    plan = pp.load(scene(text)).plan(request)
    return plan.run(world=scene(text, off), noise="lab", seed=3, rehearse=False, fast=True)


def require_right(run: pp.Run, heights: dict[str, float], masses: dict[str, float]) -> None:
    assert run.status == "complete", run.estimates
    for name, top in heights.items():
        found = run[f"{name}.height"]
        assert found.values[0] == pytest.approx(top, abs=4 * found.stds[0])
    for name, mass in masses.items():
        found = run[f"{name}.mass"]
        assert found.values[0] == pytest.approx(mass, abs=4 * found.stds[0])


@pytest.mark.parametrize("off", [-0.05, -0.005, 0.005, 0.05])
def test_an_object_is_weighed_on_a_desk_at_another_height(off: float) -> None:
    run = measured(ONE, "we don't know the mass of the tin and the height of the desk", off)
    require_right(run, {"desk": TOP + off}, {"tin": MASS})


@pytest.mark.long
@pytest.mark.parametrize("off", [-0.05, -0.01, 0.01, 0.05])
def test_a_stack_is_weighed_on_a_desk_at_another_height(off: float) -> None:
    """Both fingertips land on the desk, which is little wider than the open hand."""
    run = measured(SEVERAL, "the masses of the tin and the cup, and the height of the desk", off)
    require_right(run, {"desk": TOP + off}, {"tin": MASS, "cup": MASS})


@pytest.mark.long
@pytest.mark.parametrize("off", [0.001, 0.003, 0.005, 0.010, 0.020, 0.030, 0.040, 0.050])
def test_two_surfaces_are_off_in_opposite_directions(off: float) -> None:
    tops = {"counter": 0.74, "shelf": 0.815}
    there = {"can": tops["counter"] + 0.05, "jar": tops["shelf"] + 0.04}
    plan = pp.load(KITCHEN.format(counter="?", shelf="?", mass_can="", mass_jar="", **there)).plan(
        "the masses of the can and the jar and the heights of the counter and the shelf"
    )
    world = KITCHEN.format(
        counter=0.72 + off,
        shelf=0.80 - off,
        can=there["can"] + off,
        jar=there["jar"] - off,
        mass_can='mass="0.31"',
        mass_jar='mass="0.25"',
    )
    run = plan.run(world=world, seed=0, rehearse=False, fast=True)
    heights = {"counter": tops["counter"] + off, "shelf": tops["shelf"] - off}
    require_right(run, heights, {"can": 0.31, "jar": 0.25})


@pytest.mark.parametrize(("off", "how"), [(0.08, "80 mm higher"), (-0.08, "80 mm lower")])
def test_a_desk_far_from_its_guess_stops_the_run_with_a_remedy(off: float, how: str) -> None:
    run = measured(ONE, "the mass of the tin and the height of the desk", off)
    assert run.status != "complete"
    stopped = run.execution.stopped_by
    assert f"the support of 'tin' was measured {how} than in the scene" in stopped
    assert "for 'tin' and run again" in stopped
    assert run["desk.height"].values[0] == pytest.approx(TOP + off, abs=0.002)
