"""Errands with a tool: planned from the words and the evidence of a quantity, without a model."""

from __future__ import annotations

from typing import ClassVar

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.estimation.quantities.quantity import Evidence, Quantity
from palpate.planning.check.check import check
from palpate.planning.symbolic import efforts as errands
from palpate.planning.symbolic.efforts import errand
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario

TASK = scenario("thermometer")


@pytest.fixture(scope="module")
def scene() -> Scene:
    settings = TASK.settings()
    return load_scene(settings.scene, settings.poses)


def test_the_scenarios_request_is_planned_without_a_model(scene: Scene) -> None:
    plan = SymbolicPlanner().plan(TASK.request, scene)
    assert plan.parameters == ()
    assert plan.tree is not None
    poses = [value for _, node in plan.tree.walk() for _, value in node.args]
    assert poses.index("left_cup_probe") < poses.index("right_cup_probe")
    assert "No primitive reads the temperature" in plan.explanation
    assert check(plan, scene) == ()


@pytest.mark.parametrize(
    ("request_", "objects"),
    [
        ("Measure the temperature of the left cup using the thermometer.", ("left_cup",)),
        (
            "With the thermometer, take the temperature of the water in the right cup.",
            ("right_cup",),
        ),
        (
            "How warm is the water in both cups? Measure it with the thermometer.",
            ("left_cup", "right_cup"),
        ),
        ("Do not measure the temperature of both cups with the thermometer.", None),
        ("Measure the temperature of the left cup and weigh it with the thermometer.", None),
        ("Weigh both cups and take the temperature of the left cup with the thermometer.", None),
        (
            "Take the temperature of the left cup and the friction of the right cup with the thermometer.",
            None,
        ),
        ("Measure the temperature of the left cup.", None),
        ("Measure the temperature of the teapot with the thermometer.", None),
        ("Weigh the left cup with the thermometer.", None),
    ],
)
def test_the_request_names_quantity_tool_and_objects_and_nothing_else(
    request_: str, objects: tuple[str, ...] | None, scene: Scene
) -> None:
    task = errand(request_, scene)
    assert (task.objects if task else None) == objects


def test_an_errand_that_is_none_is_rejected_as_before(scene: Scene) -> None:
    with pytest.raises(PlanRejected, match="temperature cannot be measured"):
        SymbolicPlanner().plan(
            "Do not take the temperature of both cups with the thermometer.", scene
        )


def test_a_place_that_is_not_known_is_named(scene: Scene) -> None:
    settings = TASK.settings()
    with pytest.raises(InputError, match="unknown pose 'left_cup_probe'"):
        SymbolicPlanner().plan(TASK.request, load_scene(settings.scene))


class Humidity(Quantity):
    """Another quantity with a tool of its own."""

    id = "humidity"
    unit = "%"
    subject = "object"
    words: ClassVar = {"en": ("humidity", "moisture")}
    evidence = (Evidence("", "a person reads the probe", tool="hygrometer", place="sample"),)
    identifiable = False


def test_any_quantity_may_name_a_tool(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errands, "MANUAL", (Humidity(),))
    text = scene.text.replace('"thermometer" pos', '"my_hygrometer" pos')
    other = parse_scene(
        text, poses="places: {left_cup_sample: {pos: [0.52, 0.20, 0.30], yaw: 0.0}}"
    )
    plan = SymbolicPlanner().plan("Check the moisture in the left cup with the hygrometer.", other)
    assert plan.tree is not None
    assert "left_cup_sample" in str(plan.tree)
    assert check(plan, other) == ()
