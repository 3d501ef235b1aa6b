"""The table is higher or lower than guessed: the arm measures its height, then what stands on it."""

from __future__ import annotations

import pytest

import palpate as pp

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


OFF = [0.001, 0.005, 0.01, 0.02, 0.03, 0.04, 0.05]


@pytest.mark.parametrize(
    "off",
    [
        pytest.param(sign * off, marks=() if off in (0.005, 0.05) else pytest.mark.long)
        for off in OFF
        for sign in (-1, 1)
    ],
)
@pytest.mark.parametrize(
    ("text", "request_", "names"),
    [
        (ONE, "we don't know the mass of the tin and the height of the desk", ("tin",)),
        pytest.param(
            SEVERAL,
            "the masses of the tin and the cup, and the height of the desk",
            ("tin", "cup"),
            marks=pytest.mark.long,
        ),
    ],
)
def test_objects_are_weighed_on_a_desk_at_another_height(
    text: str, request_: str, names: tuple[str, ...], off: float
) -> None:
    run = measured(text, request_, off)
    assert run.status == "complete", run.execution.stopped_by
    (height,) = run["desk.height"].value
    assert height == pytest.approx(TOP + off, abs=4 * run["desk.height"].std[0])
    for name in names:
        found = run[f"{name}.mass"]
        assert found.value[0] == pytest.approx(MASS, abs=4 * found.std[0])


@pytest.mark.parametrize(("off", "how"), [(0.08, "80 mm higher"), (-0.08, "80 mm lower")])
def test_a_desk_far_from_its_guess_stops_the_run_with_a_remedy(off: float, how: str) -> None:
    run = measured(ONE, "the mass of the tin and the height of the desk", off)
    assert run.status != "complete"
    stopped = run.execution.stopped_by
    assert f"what 'tin' stands on was measured {how} than the scene has it" in stopped
    assert "for 'tin' and run again" in stopped
    assert run["desk.height"].value[0] == pytest.approx(TOP + off, abs=0.002)
