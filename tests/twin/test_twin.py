"""The finished twin: text, diff, notes, marks."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import BELIEVED, Estimate, FitTest, FurtherValue, not_identified
from palpate.mjcf.contacts import acting_friction
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import Context, NominalHand, Recording
from palpate.trace.samples import Samples, Trace
from palpate.twin.twin import Twin, build_twin

NOTHING = Trace(Samples.empty(), (), (), (), NominalHand(0.009, 0.15, 0.01, 1e-4))
SCENE = """<mujoco>
  <worldbody>
    <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".3 .3 .02" friction="0.6"/></body>
    <!-- mine -->
    <body name="cup" pos="{pos}"><freejoint/><geom type="box" size=".03 .02 .05" friction="0.5"/></body>
  </worldbody>
</mujoco>
"""
POSES = "objects:\n  cup: {pos: [0.45, 0.10, 0.05]}\n"


def scene(pos: str = "0.5 0 0.05", poses: str | None = None) -> Scene:
    return parse_scene(SCENE.format(pos=pos), poses=poses)


def estimate(parameter: Parameter, *value: float) -> Estimate:
    return Estimate(
        parameter,
        "kg" if parameter.quantity == "mass" else "m",
        value,
        (1e-3,) * len(value),
        tuple((v - 2e-3, v + 2e-3) for v in value),
        "measured",
        (),
    )


def build(scene: Scene, *estimates: Estimate) -> Twin:
    return build_twin(scene, estimates, NOTHING, lambda world: [])


MASS = estimate(Parameter("cup", "mass"), 0.2541)


def test_the_missing_value_alone_is_written() -> None:
    twin = build(scene(), MASS)
    kept = [line for line in SCENE.format(pos="0.5 0 0.05").splitlines() if "cup" not in line]
    assert [line for line in twin.xml.splitlines() if line in kept] == kept
    assert parse_scene(twin.xml).body("cup").known["mass"] == (0.2541,)
    assert twin.diff.startswith("--- scene.xml\n+++ twin.xml\n")
    assert '+    <body name="cup"' in twin.diff
    assert twin.notes == ()
    assert twin.validation is not None
    assert twin.validation.settled


def test_an_estimate_that_is_not_identified_is_not_written() -> None:
    twin = build(scene(), not_identified(Parameter("cup", "mass"), "kg", "It slipped."))
    assert twin.xml == SCENE.format(pos="0.5 0 0.05")
    assert twin.diff == ""


def test_a_contradicted_estimate_is_not_written_and_noted() -> None:
    pulled = FitTest("along the lift", 30.0, 4.2, "Something pulls on it.")
    twin = build(scene(), replace(MASS, tests=(pulled,)))
    assert twin.xml == SCENE.format(pos="0.5 0 0.05")
    assert twin.notes == ("cup.mass is not in the twin: Something pulls on it.",)


def test_a_mass_that_was_estimated_with_a_com_is_written_and_noted() -> None:
    balanced = replace(
        estimate(Parameter("cup", "com"), 0.001, 0.0, 0.0),
        parts={"mass": FurtherValue(0.341, 0.001, "kg")},
    )
    twin = build(scene(), balanced)
    assert parse_scene(twin.xml).body("cup").known["mass"] == pytest.approx((0.341,))
    assert twin.notes == (
        "cup.mass was not requested; the twin holds 0.3410 ± 0.0010 kg, from cup.com",
    )
    asked = not_identified(Parameter("cup", "mass"), "kg", "It slipped.")
    assert "0.341" not in build(scene(), balanced, asked).diff.split("<custom>")[0]


def test_a_prior_dominated_estimate_is_marked() -> None:
    twin = build(scene(), replace(MASS, verdict="prior-dominated"))
    assert parse_scene(twin.xml).body("cup").known["mass"] == (0.2541,)
    assert '<text name="palpate_cup_mass_verdict" data="prior-dominated"/>' in twin.xml
    (note,) = twin.notes
    assert note == f"cup.mass is prior-dominated: {BELIEVED}"


def test_a_twin_never_holds_what_is_impossible() -> None:
    light = Estimate.normal(Parameter("cup", "mass"), "kg", -0.002, 0.004, "measured")
    twin = build(scene(), light.bounded((0.0, math.inf)))
    (mass,) = parse_scene(twin.xml).body("cup").known["mass"]
    assert 0.001 < mass < 0.004
    (numbers,) = re.findall(r'palpate_cup_mass" data="([^"]*)"', twin.xml)
    value, std, low, high = map(float, numbers.split())
    assert (value, low) == pytest.approx((mass, 0.0), abs=1e-4)
    assert 0.0 < std < 0.004 < high
    (note,) = twin.notes
    assert note.startswith("cup.mass is prior-dominated: at most 0.0066 kg (95 %): ")
    assert "the mean of the possible values" in note
    assert twin.validation is not None


def test_the_poses_that_came_with_the_scene_hold_for_the_twin() -> None:
    twin = build(scene(poses=POSES), MASS)
    assert twin.scene is not None
    assert twin.scene.body("cup").pose_world.position == pytest.approx([0.45, 0.10, 0.05])
    assert parse_scene(twin.xml).body("cup").pose_world.position == pytest.approx([0.5, 0, 0.05])


def test_a_measured_position_overrules_the_poses_that_came_with_the_scene() -> None:
    twin = build(
        scene(pos="? ? 0.05", poses=POSES),
        MASS,
        estimate(Parameter("cup", "position"), 0.461, 0.093),
    )
    assert twin.scene is not None
    for read in (twin.scene, parse_scene(twin.xml)):
        assert read.body("cup").pose_world.position == pytest.approx([0.461, 0.093, 0.05])


def test_a_quantity_of_the_gripper_is_noted_and_not_written() -> None:
    twin = build(scene(), MASS, estimate(Parameter("gripper", "velocity"), 0.1, 0.0, 0.2))
    (note,) = twin.notes
    assert note.startswith("gripper.velocity is not in the twin")
    assert "velocity" not in twin.xml
    assert twin.scene is not None


@pytest.mark.parametrize(("value", "is_said"), [(0.502, True), (0.3, False)])
def test_the_pair_of_a_friction_acts_and_is_reported_where_the_support_may_decide(
    value: float, is_said: bool
) -> None:
    """On a table of 0.5: 0.3 acts although MuJoCo takes the larger; 0.502 may be the table's."""
    text = SCENE.format(pos="0.5 0 0.05").replace('friction="0.6"', 'friction="0.5"')
    slid = Recording("gripper_forces", 0.0, 1.0, Context("sliding", holding="cup", support="table"))
    changed = replace(estimate(Parameter("cup", "friction"), value), evidence=(slid,))
    twin = build(parse_scene(text), changed)
    assert any("pair with table" in note for note in twin.notes) == is_said
    assert acting_friction(parse_scene(twin.xml).resolved.description.bodies["cup"]) == value
