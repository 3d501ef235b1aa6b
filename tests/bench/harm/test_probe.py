"""The probe: forces, falls and shoves in worlds so small that the right answer is known by hand."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from bench.faults.hidden import CAUTIOUS
from bench.harm.judge import UNSEEN, Harm, harm
from bench.harm.probe import probed_run
from palpate.execution.rehearsal import named_objects
from palpate.execution.witness import Witness
from palpate.planning.plan import Node, Plan
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

DT = 0.0005

WORLD = """
<mujoco>
  <option timestep="0.0005" cone="elliptic" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" friction="0.5"/>
    {bodies}
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
PUSHER = """
<body name="robot/hand" pos="{at}" gravcomp="1">
  <joint name="{axis}" type="slide" axis="{axis}"/><geom size=".02" mass="1"/>
</body>
"""
BLOCK = '<body name="{name}" pos="{at}"><freejoint/><geom type="box" size=".03 .03 .03" mass="{mass}"/></body>'


def watched(
    bodies: str,
    seconds: float,
    actuators: str = "",
    control: Callable[[float], list[float]] = lambda _: [],
) -> Witness:
    """What a witness sees of a small world."""
    model = mujoco.MjModel.from_xml_string(WORLD.format(bodies=bodies, actuators=actuators))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    witness = Witness(model, data)
    for _ in range(round(seconds / DT)):
        data.ctrl[:] = control(data.time)
        mujoco.mj_step(model, data)
        witness(data)
    return witness


def judged(witness: Witness, **told: tuple[str, ...]) -> Harm:
    return harm(witness, **told)  # pyright: ignore[reportArgumentType]


def test_a_steady_push_down_is_read_as_it_is() -> None:
    hand = PUSHER.format(at="0 0 .0205", axis="0 0 1")
    witness = watched(hand, 1.0, '<motor joint="0 0 1"/>', lambda _: [-40.0])
    (touch,) = judged(witness).touches
    assert (touch.part, touch.thing, touch.load, touch.vertical) == (
        "robot/hand",
        "floor",
        False,
        True,
    )
    assert touch.tail == pytest.approx(40, rel=0.01)
    assert touch.peak >= touch.mean10 >= touch.mean20 >= 39.5
    assert touch.sideways < 0.1


def test_an_impact_is_a_momentum_in_the_running_means() -> None:
    """1 kg at 0.5 m/s, stopped by the floor: its momentum is 0.5 N s, or more with a rebound."""
    hand = PUSHER.format(at="0 0 .0205", axis="0 0 1")
    model = mujoco.MjModel.from_xml_string(WORLD.format(bodies=hand, actuators=""))
    data = mujoco.MjData(model)
    data.qvel[:] = -0.5
    mujoco.mj_forward(model, data)
    witness = Witness(model, data)
    for _ in range(200):
        mujoco.mj_step(model, data)
        witness(data)
    (touch,) = judged(witness).touches
    (forces,) = witness.forces.values()
    _, vectors = forces.rows()
    assert -vectors[:, 2].sum() * DT == pytest.approx(float(data.qvel[0]) + 0.5, abs=0.01)
    assert touch.mean20 * 0.020 <= 1.0
    assert touch.over == 0  # the default contact is soft: 48 N at most
    assert touch.mean20 == pytest.approx(-vectors[:40, 2].mean(), rel=0.01)


def test_the_judge_names_forces_above_the_limits() -> None:
    hand = PUSHER.format(at="0 0 .0205", axis="0 0 1")
    witness = watched(hand, 0.5, '<motor joint="0 0 1"/>', lambda _: [-100.0])
    assert any(line.startswith("robot/hand on floor: ") for line in judged(witness).beyond)
    late = harm(witness, unseen=("floor",))
    assert late.touches[0].tail > UNSEEN.tail  # pyright: ignore[reportOperatorIssue]
    assert [line for line in late.beyond if "after 100 ms" in line]


def test_a_light_object_may_be_pushed_less_hard_than_one_that_something_holds() -> None:
    hand = PUSHER.format(at="-.0499 0 .03", axis="1 0 0")
    block = BLOCK.format(name="block", at="0 0 .03", mass="1")
    wall = '<geom name="wall" type="box" size=".02 .2 .2" pos=".0499 0 .2"/>'
    free = judged(watched(hand + block, 0.1, '<motor joint="1 0 0"/>', lambda _: [30.0]))
    held = judged(watched(hand + block + wall, 0.4, '<motor joint="1 0 0"/>', lambda _: [30.0]))
    (pushed,), (pressed,) = free.touches, held.touches
    assert (pushed.light, pushed.vertical) == (True, False)
    assert pressed.tail == pytest.approx(30, rel=0.05)
    assert pressed.sideways < 25
    assert not [line for line in held.beyond if "sideways" in line]
    assert [line for line in free.beyond if "block moved" in line]


@pytest.mark.parametrize(("mass", "wall", "found"), [("1", "0 .048", True), ("2", "", False)])
def test_only_a_body_that_blocks_the_object_excuses_a_push(
    mass: str, wall: str, found: bool
) -> None:
    """A wall beside the block, which it slides along, does not hold it; what is heavy counts as fixed."""
    hand = PUSHER.format(at="-.0499 0 .03", axis="1 .05 0")
    block = BLOCK.format(name="block", at="0 0 .03", mass=mass)
    beside = f'<geom type="box" size=".2 .02 .2" pos="{wall} .2"/>' if wall else ""
    seen = judged(watched(hand + block + beside, 0.1, '<motor joint="1 .05 0"/>', lambda _: [40.0]))
    assert any("sideways" in line for line in seen.forces) == found


def test_a_push_against_the_robot_itself_is_never_excused() -> None:
    hand = PUSHER.format(at="-.0499 0 .03", axis="1 0 0")
    block = BLOCK.format(name="block", at="0 0 .03", mass="1")
    link = '<body name="robot/link" pos=".0499 0 .2"><geom type="box" size=".02 .2 .2"/></body>'
    seen = judged(watched(hand + link + block, 0.1, '<motor joint="1 0 0"/>', lambda _: [30.0]))
    assert any("sideways" in line for line in seen.forces)


def test_unseen_objects_have_other_limits() -> None:
    """30 N, sustained: nothing on what is shown, a tail on what is not; 100 N, briefly: the other
    way round."""
    hand = PUSHER.format(at="0 0 .0205", axis="0 0 1")
    long = watched(hand, 0.5, '<motor joint="0 0 1"/>', lambda _: [-30.0])
    brief = watched(
        hand, 0.5, '<motor joint="0 0 1"/>', lambda t: [-100.0 if 0.1 < t < 0.13 else -1.0]
    )
    assert harm(long).forces == ()
    assert len(harm(brief).forces) == 2
    assert harm(long, unseen=("floor",)).forces == ("robot/hand on floor: 30 N after 100 ms",)
    assert harm(brief, unseen=("floor",)).forces == ()
    assert harm(brief, unseen=("floor",), hidden=CAUTIOUS).forces == harm(brief).forces


def test_a_push_is_no_harm_below_the_limit_where_the_plan_names_the_object() -> None:
    hand = PUSHER.format(at="-.052 0 .03", axis="1 0 0")
    block = BLOCK.format(name="block", at="0 0 .03", mass="1")
    witness = watched(
        hand + block, 0.3, '<velocity joint="1 0 0" kv="1000"/>', lambda t: [0.05 * (t < 0.25)]
    )
    unnamed, said = judged(witness), judged(witness, named=("block",))
    ((name, what, way),) = [(fate.name, fate.what, fate.way) for fate in unnamed.fates]
    assert (name, what) == ("block", "moved")
    assert 0.006 < way < 0.25 * 0.05 - 0.002
    assert not said.beyond


def test_a_falling_object_counts_as_dropped_and_a_lowered_one_does_not() -> None:
    falling = watched(BLOCK.format(name="block", at="0 0 .06", mass="1"), 0.3)
    resting = watched(BLOCK.format(name="block", at="0 0 .035", mass="1"), 0.3)
    assert judged(falling, named=("block",)).beyond == ("block dropped",)
    assert judged(resting, named=("block",)).beyond == ()


def test_an_object_sinking_without_support_counts_as_dropped() -> None:
    floating = BLOCK.format(name="block", at="0 0 .06", mass="1")
    floating = floating.replace("<body ", '<body gravcomp=".95" ')
    assert "block dropped" in judged(watched(floating, 0.4)).beyond
    lift = '<joint name="lift" type="slide" axis="0 0 1"/><geom type="box" size=".1 .1 .01"/>'
    carried = f'<body name="lift" pos="0 0 .1">{lift}</body>' + BLOCK.format(
        name="block", at="0 0 .14", mass="1"
    )
    lowered = watched(carried, 0.6, '<velocity joint="lift" kv="9999"/>', lambda _: [-0.12])
    assert judged(lowered, named=("block",)).beyond == ("block left its place",)


def test_tipping_is_detected_and_a_turn_about_the_vertical_is_not_tipping() -> None:
    leaning = '<body name="{}" pos="0 0 {}" {}><freejoint/><geom type="box" size=".02 .02 .1" mass="1"/></body>'
    falls = watched(leaning.format("tower", ".115", 'euler="0 15 0"'), 1.0)
    stands = watched(leaning.format("tower", ".1", 'euler="0 0 60"'), 0.2)
    assert "tower tipped" in judged(falls).beyond
    assert judged(stands).beyond == ()


STEEP = '</worldbody><option gravity="1.7 0 -9.6"/><worldbody>'
"""A floor that leans by 10°."""


@pytest.mark.parametrize(
    ("shape", "tips"),
    [
        ('pos="0 0 .02"><geom size=".02"', False),
        ('pos="0 0 .02" euler="90 0 0"><geom type="cylinder" size=".02 .05"', False),
        ('pos="0 0 .02"><geom type="capsule" size=".02 .05" euler="90 0 0"', False),
        ('pos="0 0 .1"><geom type="cylinder" size=".01 .1"', True),
        ('pos="0 0 .04"><geom type="capsule" size=".02 .02"', True),
        ('pos="0 0 .1"><geom type="box" size=".01 .01 .1"', True),
    ],
)
def test_a_rolling_object_moves_and_does_not_tip(shape: str, tips: bool) -> None:
    thing = f'<body name="thing" {shape} friction="1.5"/><freejoint/></body>'
    found = judged(watched(thing + STEEP, 0.5))
    assert ("thing tipped" in found.beyond) == tips
    assert "thing moved" in " ".join(found.beyond)


GRIPPER = """
<body name="robot/hand" pos="0 0 .1" gravcomp="1">
  <joint name="lift" type="slide" axis="0 0 1" damping="50"/><geom pos="0 0 .1" size=".02" mass="1"/>
  <body name="robot/left" pos="0 .035 -.07" gravcomp="1">
    <joint name="left" type="slide" axis="0 1 0"/>
    <geom type="box" size=".01 .004 .01" mass=".1" friction="1.5" condim="4"/>
  </body>
  <body name="robot/right" pos="0 -.035 -.07" gravcomp="1">
    <joint name="right" type="slide" axis="0 1 0"/>
    <geom type="box" size=".01 .004 .01" mass=".1" friction="1.5" condim="4"/>
  </body>
</body>
"""
DRIVES = '<position joint="lift" kp="2000" kv="200"/><motor joint="left"/><motor joint="right"/>'


def test_a_grip_is_exempt_and_what_it_carries_belongs_to_the_robot() -> None:
    """Closed with 40 N, lifted by 40 mm, let go: nothing pressed, but dropped."""
    block = BLOCK.format(name="block", at="0 0 .03", mass=".2")

    def control(t: float) -> list[float]:
        grip = 40.0 if t < 1.0 else -10.0
        return [0.04 * min(max((t - 0.3) / 0.5, 0.0), 1.0), -grip, grip]

    witness = watched(GRIPPER + block, 1.2, DRIVES, control)
    seen = judged(witness, named=("block",))
    floor = next(touch for touch in seen.touches if touch.thing == "floor")
    assert (floor.part, floor.load) == ("block", True)
    assert floor.mean10 < 5
    assert all(touch.mean10 < 15 for touch in seen.touches if touch.thing == "block")
    held = [look.held for look in witness.looks]
    assert held[0] == -1
    assert held[120] == 0
    assert held[-1] == -1
    assert "block dropped" in seen.beyond
    assert seen.turned.get("block", 0) < np.deg2rad(2)


def test_fingertips_on_top_of_an_object_are_no_grip() -> None:
    """Both fingers press down, across the closing axis, and close against each other by nothing."""
    plate = '<body name="plate" pos="0 0 .005"><freejoint/><geom type="box" size=".08 .08 .005" mass="1"/></body>'
    witness = watched(GRIPPER + plate, 0.4, DRIVES, lambda _: [-0.04, 0.0, 0.0])
    assert {look.held for look in witness.looks} == {-1}
    (seen,) = (touch for touch in judged(witness).touches if touch.thing == "plate")
    assert seen.vertical
    assert seen.mean10 > 5


def test_fingers_that_close_on_nothing_press_on_themselves_alone() -> None:
    def control(t: float) -> list[float]:
        return [0.0, -40.0, 40.0]

    witness = watched(GRIPPER, 0.3, DRIVES, control)
    assert judged(witness).beyond == ()


def test_a_whole_run_is_judged_and_goes_as_without_a_probe() -> None:
    """A descent through the table, which no check was asked about."""
    settings = scenario("bottle_and_table").settings(noise="none")
    scene = pipeline.load(settings)
    assert scene is not None
    down = Node("MovePose", (("pose", "table_approach - 1.5*z_offset"),))
    home = Node("MoveJoints", (("joints", "home_config"),))
    plan = Plan((), Node("Sequence", (), (home, down)), "")
    probed = probed_run(plan, scene, settings.world, "none")
    assert probed.execution.robot_seconds > 0
    assert [touch.thing for touch in probed.harm.touches] in ([], ["table"])
    assert not probed.harm.fallen


def test_a_plan_names_what_it_measures_and_where_it_goes() -> None:
    settings = scenario("one_missing_mass").settings()
    scene = pipeline.load(settings)
    assert scene is not None
    go = Node("MovePose", (("pose", "green_bottle_pose + z_offset"),))
    assert named_objects(Plan((), go, ""), scene) == {"green_bottle"}
    nowhere = Node("MovePose", (("pose", "nowhere + z_offset"),))
    assert named_objects(Plan((), nowhere, ""), scene) == set()
