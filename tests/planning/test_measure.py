"""Parameters by name, without any language."""

from __future__ import annotations

import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.planning.planner import named_parameters
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

DESK = """<mujoco model="desk"><worldbody><site name="robot_base"/>
  <body name="desk" pos="0.4 0 ?"><geom type="box" size=".6 .6 .03" friction="0.6"/></body>
  <body name="mug" pos="0.5 0.1 0.08"><freejoint/><geom type="box" size=".03 .02 .05"/></body>
  <body name="can" pos="0.5 -0.1 0.08"><freejoint/><geom type="box" size=".02 .02 .05" mass="0.2"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def desk() -> Scene:
    return parse_scene(DESK)


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["mug.mass"], ["mug.mass"]),
        (["mug.mass, desk.height"], ["mug.mass", "desk.height"]),
        (["mug.*"], ["mug.mass", "mug.friction"]),
        (["*.mass"], ["mug.mass"]),
        (["can.mass", "can.mass"], ["can.mass"]),
    ],
)
def test_names_and_patterns_are_parameters(desk: Scene, names: list[str], found: list[str]) -> None:
    assert [str(one) for one in named_parameters(names, desk)] == found


def test_missing_is_everything_missing(desk: Scene) -> None:
    assert named_parameters(["missing"], desk) == desk.missing


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mgu.mass", "unknown object or surface in measure= 'mgu'; did you mean 'mug'"),
        ("mug.mas", "unknown quantity in measure= 'mas'; did you mean 'mass'"),
        ("mug", "measure=mug names no quantity"),
        ("desk.mass", "'desk' is a surface, and the mass is a quantity of an object"),
        ("x*.mass", "unknown object or surface"),
        ("", "measure= is empty"),
        (" , ", "measure= is empty"),
    ],
)
def test_unknown_names_are_named(desk: Scene, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        named_parameters([name], desk)


def test_a_plan_measures_exactly_what_is_named() -> None:
    plan = pp.load(DESK).plan(measure="mug.mass")
    assert plan.parameters == (pp.Parameter("mug.mass"),)
    assert plan.findings == ()


def test_a_stated_parameter_is_not_measured_again_unless_asked() -> None:
    scene = pp.load(DESK)
    assert scene.plan(measure="can.mass").satisfied
    again = scene.plan(measure="can.mass", remeasure=True)
    assert again.parameters == (pp.Parameter("can.mass"),)


def test_a_request_that_asks_for_something_else_contradicts() -> None:
    with pytest.raises(InputError, match=r"asks for desk\.height, and measure=mug\.mass"):
        pp.load(DESK).plan("the height of the desk", measure="mug.mass")


def test_a_proposal_is_accepted_by_name() -> None:
    scene = pp.load(DESK)
    rejected = scene.plan("Find the mass of the mug for my zippy contraption.")
    assert rejected.tree is None
    assert rejected.proposal == (pp.Parameter("mug.mass"),)
    assert scene.plan(measure=rejected.proposal).parameters == rejected.proposal


def test_a_users_planner_receives_the_parameters() -> None:
    class Asked:
        name = "asked"
        request: str | None = None

        def plan(self, request: str | None, *_: object) -> pp.Plan:
            self.request = request
            return pp.Plan((), None, "no plan")

    planner = Asked()
    pp.load(DESK).plan(planner=planner, measure="mug.mass")
    assert planner.request == "Measure exactly these parameters, no more and no fewer: mug.mass."
