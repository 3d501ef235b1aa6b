"""Rehearsal in physics: harm is found with the leaf that does it, and harmless plans pass."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest
from loopback import Loopback, Says

from palpate.common.parameter import Parameter
from palpate.execution import rehearsal
from palpate.execution.rehearsal import Rehearsal, TimePrediction, rehearse, scale_grip
from palpate.execution.runner import run
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Node, Plan, dump_plan
from palpate.planning.symbolic.planner import assemble
from palpate.robots.owner import measured_arm
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

TABLE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.5"/>
    <site name="robot_base" pos="0 0 0"/>
    <body name="table" pos=".5 0 -.02"><geom type="box" size=".28 .28 .02"/></body>
    {things}
  </worldbody>
</mujoco>"""
CAN = (
    '<body name="can" pos=".5 .1 .06"><freejoint/>'
    '<geom type="cylinder" size=".03 .06" mass="{mass}"/></body>'
)
PLANK = (
    '<body name="plank" pos=".5 .3 .015"><freejoint/>'
    '<geom type="box" size=".03 .12 .015" mass=".4"/></body>'
    '<body name="weight" pos=".5 .2 .055"><freejoint/>'
    '<geom type="box" size=".025 .025 .025" mass="{mass}"/></body>'
)
"""A plank over the edge of the table, which only the weight on it keeps from tipping."""
HEAVY = PLANK.replace(".5 .2 .055", ".5 .2 .08").replace(".025 .025 .025", ".025 .025 .05")
"""With a weight that, as believed from its volume, holds it."""
BOARD = (
    CAN + '<body name="board" pos=".5 -.1 .1" euler="-30 0 0"><freejoint/>'
    '<geom type="box" size=".03 .005 .09" mass=".2"/></body>'
)
"""A board in the air."""


def scene(things: str, mass: str = ".3") -> Scene:
    return parse_scene(TABLE.format(things=things.format(mass=mass)))


def weighing(of: Scene, name: str) -> Plan:
    parameter = Parameter(name, "mass")
    return Plan((parameter,), assemble(of, [parameter]).tree, "")


def sequence(steps: Sequence[tuple[str, str, str] | str]) -> Plan:
    """A plan of leaves: a type, or a type, argument and value."""
    nodes: list[Node] = []
    for step in steps:
        kind, *argument = (step,) if isinstance(step, str) else step
        nodes.append(Node(kind, (tuple(argument),) if argument else ()))  # pyright: ignore[reportArgumentType]
    return Plan((), Node("Sequence", (), tuple(nodes)), "")


def test_a_harmless_plan_passes_in_every_world() -> None:
    cell = scene(CAN, "?")
    predicted = rehearse(weighing(cell, "can"), cell)
    assert predicted.failure is None
    assert predicted.draws == 3
    assert str(predicted).startswith("in 3 worlds, 12 actions")


def test_a_body_that_tips_without_its_load_is_named_with_the_lift() -> None:
    cell = scene(PLANK)
    plan = weighing(cell, "weight")
    predicted = rehearse(plan, cell)
    assert predicted.failure is not None
    assert predicted.failure.startswith("plank ")
    assert plan.tree is not None
    leaf = dict(plan.tree.walk())[predicted.path]
    assert (leaf.type, dict(leaf.args)) == ("MovePose", {"pose": "weight_pose + z_offset"})


def test_a_scene_that_does_not_settle_is_reported() -> None:
    cell = scene(BOARD)
    predicted = rehearse(weighing(cell, "can"), cell)
    assert predicted.path == "tree"
    assert "the scene does not settle" in str(predicted.failure)


def test_values_with_which_the_scene_does_not_settle_are_no_world() -> None:
    """In the second one drawn the weight is too light to hold the plank."""
    plan = sequence([("MoveJoints", "joints", "home_config")])
    predicted = rehearse(plan, scene(HEAVY, "?"))
    assert (predicted.failure, predicted.draws) == (None, 3)


def test_a_stop_in_a_drawn_world_is_no_failure_nor_is_what_the_hand_holds_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Drawn heavier than the payload, the can is put down again."""
    heavy = {Parameter("can", "mass"): (3.4,), Parameter("can", "friction"): (0.7,)}
    monkeypatch.setattr(rehearsal, "draw_truth", lambda *_: heavy)
    above = ("MovePose", "pose", "can_pose + z_offset")
    steps = [
        ("MoveJoints", "joints", "home_config"),
        "OpenGripper",
        above,
        ("MovePose", "pose", "can_pose"),
        "CloseGripper",
        above,
    ]
    predicted = rehearse(sequence(steps), scene(CAN, "?"), draws=1)
    assert (predicted.failure, predicted.draws, predicted.actions) == (None, 2, 6)
    (least, most) = predicted.foresight.weights["can"]
    assert most > 3.4 * 9.8 > 10 * least


def test_too_long_a_plan_is_one_finding_after_the_longest_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rehearsal, "LONGEST", 4.0)
    cell = scene(CAN)
    up_and_down = [
        ("MovePose", "pose", f"can_pose + {n}*z_offset") for _ in range(150) for n in (1, 2)
    ]
    predicted = rehearse(sequence([("MoveJoints", "joints", "home_config"), *up_and_down]), cell)
    assert predicted.failure == "it takes more than 4 s; make several plans of it"
    assert predicted.path == "tree"
    assert predicted.robot_seconds < 7.0


def test_a_plan_whose_first_motions_foretell_too_long_a_run_is_refused_early(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rehearsal, "LONGEST", 30.0)
    goes = [("MovePose", "pose", f"can_pose + {n}*z_offset") for n in (1, 2)]
    predicted = rehearse(
        sequence([("MoveJoints", "joints", "home_config"), *60 * goes]), scene(CAN)
    )
    assert predicted.failure == "it takes more than 30 s; make several plans of it"
    assert predicted.actions < 8


def test_a_plan_is_as_long_as_its_motions_of_each_kind() -> None:
    turns = ["MeasureForces", "CloseGripper", "OpenGripper"]
    pace = TimePrediction(sequence(150 * turns), 2.0)
    for turn in range(5):
        assert not pace.is_too_slow, "five of a kind are needed"
        pace.note_end(f"tree.children[{3 * turn + 1}]", 2.0 + 6.1 * (turn + 1))
    assert pace.is_too_slow
    quick = TimePrediction(sequence(140 * turns), 2.0)
    quick.note_end("stop", 2.0)
    for turn in range(20):
        quick.note_end(f"tree.children[{3 * turn + 1}]", 2.0 + 6.1 * (turn + 1))
    assert not quick.is_too_slow, "854 s, fewer than half as many again as may be"


def test_an_object_that_ends_elsewhere_than_believed_is_a_finding() -> None:
    """The fingers close beside its middle and push it on a smooth table by 8 mm."""
    there = "can_pose + 0.8*y_offset"
    smooth = CAN.replace("<geom", '<geom friction=".02 0 0" priority="1"')
    cell = scene(smooth.replace(".03 .06", ".021 .06"))
    steps = [
        ("MoveJoints", "joints", "home_config"),
        "OpenGripper",
        ("MovePose", "pose", f"{there} + z_offset"),
        ("MovePose", "pose", there),
        "CloseGripper",
        "OpenGripper",
        ("MovePose", "pose", f"{there} + z_offset"),
    ]
    predicted = rehearse(sequence(steps), cell)
    assert "'can' ends (+0, -8, +0) mm" in str(predicted.failure)
    assert "displaced in CloseGripper()" in str(predicted.failure)
    assert predicted.path == "tree.children[4]"


def test_a_run_stops_where_something_that_no_scene_shows_is_in_the_object() -> None:
    cell = scene(CAN)
    stuck = '<geom type="box" pos="0 0 -.04" size=".01 .01 .01" mass="1.4"/></body>'
    world = scene(CAN.replace("</body>", stuck))
    plan = weighing(cell, "can")
    robot = MujocoRobot(world.spec({}), world.pose_world_base, measured_arm(world.arm))
    foresight = rehearse(plan, cell, draws=0).foresight
    done = run(plan, cell, robot, noiseless=True, settled=foresight.settled)
    assert "MovePose(can_pose + z_offset): not as rehearsed: 'can' pulls" in str(done.stopped_by)
    assert done.held is not None
    assert done.held.became == "put down"


def test_a_load_lowered_next_to_its_support_is_not_falling() -> None:
    """It hangs 60 mm below its place on a block, and goes back there."""
    block = '<body name="block" pos=".5 .1 .06"><geom type="box" size=".02 .02 .06"/></body>'
    cell = scene(block + CAN.replace(".5 .1 .06", ".5 .1 .18"))
    beside = [
        ("MovePose", "pose", f"can_pose + 5*y_offset {rise}z_offset")
        for rise in ("+ ", "- 0.6*", "+ ")
    ]
    above = ("MovePose", "pose", "can_pose + z_offset")
    steps = [
        ("MoveJoints", "joints", "home_config"),
        "OpenGripper",
        above,
        ("MovePose", "pose", "can_pose"),
        "CloseGripper",
        above,
        *beside,
        above,
        ("MovePose", "pose", "can_pose"),
        "OpenGripper",
        above,
    ]
    assert rehearse(sequence(steps), cell).failure is None


def test_the_same_pose_twice_while_holding_is_no_error() -> None:
    cell = scene(CAN)
    above = ("MovePose", "pose", "can_pose + z_offset")
    steps = [
        ("MoveJoints", "joints", "home_config"),
        "OpenGripper",
        above,
        ("MovePose", "pose", "can_pose"),
        "CloseGripper",
        above,
        above,
        ("MovePose", "pose", "can_pose"),
        "OpenGripper",
        above,
    ]
    assert rehearse(sequence(steps), cell).failure is None


@pytest.mark.parametrize(("friction", "fails"), [("0.4", False), ("0.3", True)])
def test_the_pads_are_half_as_rough_in_one_world(friction: str, fails: bool) -> None:
    """1.2 kg weigh 11.8 N; a friction of 0.15 holds 12 N at rest, and not while it is lifted."""
    cell = scene(CAN.replace("{mass}", f'{{mass}}" priority="2" friction="{friction}'), "1.2")
    predicted = rehearse(weighing(scene(CAN, "?"), "can"), cell)
    assert predicted.draws == 2
    assert (predicted.failure is not None) == fails
    assert not fails or "can dropped" in str(predicted.failure)
    assert not fails or "50 % as rough as believed" in str(predicted.failure)


def test_a_plan_is_rehearsed_once_in_a_scene() -> None:
    cell = scene(CAN)
    plan = weighing(cell, "can")
    assert rehearse(plan, cell) is rehearse(plan, cell)


@pytest.mark.parametrize(
    ("planner", "rehearsed"),
    [
        ("symbolic", False),
        ("replay:plan.json", True),
        pytest.param("openai:gpt", True, marks=pytest.mark.long),
    ],
)
def test_plans_of_models_and_files_are_rehearsed_by_default(planner: str, rehearsed: bool) -> None:
    cell = scene(PLANK)
    made = Run(Settings(planner=planner), cell, weighing(cell, "weight"))
    done = pipeline.rehearse(made)
    assert isinstance(done.rehearsal, Rehearsal) == rehearsed
    assert [finding.rule for finding in done.findings] == ["rehearsal"] * rehearsed
    if rehearsed:
        assert done.findings[0].path.startswith("tree.children[")
        assert pipeline.measure(done).execution is None


def test_a_model_corrects_what_the_rehearsal_of_its_plan_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-test-0123456789")
    cell = scene(HEAVY, "?")
    refusal = {"outcome": "cannot", "parameters": [], "explanation": "it holds up the plank"}
    with Loopback(Says(dump_plan(weighing(cell, "weight"))), Says(json.dumps(refusal))) as server:
        asked = Settings(
            planner="openai",
            request="the mass of the weight",
            model_settings=ModelSettings(base_url=server.url("openai"), prompt="lean"),
        )
        made = pipeline.plan(asked, cell)
        answered = server.requests[1]
    assert made.plan.outcome == "cannot"
    assert made.conversation is not None
    (found,) = made.conversation.rounds[0].findings
    assert "rehearsal: in simulation the plan fails: plank" in found
    assert found in answered.user


def test_smoother_pads_are_smoother_on_a_soft_object_too() -> None:
    """The friction of a pad on a shape of stated softness is that of an explicit pair."""
    soft = parse_scene(
        '<mujoco><worldbody><body name="sponge" pos=".5 0 .05"><freejoint/>'
        '<geom type="box" size=".02 .02 .05" mass=".1" friction=".5" solref="0.05 1"/></body>'
        '<body name="rough" pos=".5 .2 .05"><freejoint/>'
        '<geom name="rough" type="box" size=".02 .02 .05" mass=".1" priority="9" friction="2"/></body>'
        "</worldbody></mujoco>"
    )
    model = MujocoRobot(soft.spec(), soft.pose_world_base, soft.arm).world.model
    pairs, own = model.pair_friction.copy(), model.geom_friction.copy()
    assert len(pairs)
    scale_grip(model, 0.5)
    assert model.pair_friction == pytest.approx(0.5 * pairs)
    assert model.geom("rough").friction == pytest.approx(0.5 * np.array([2.0, 0.005, 0.0001]))
    pads = [g for g in range(model.ngeom) if "pad" in model.geom(g).name]
    assert model.geom_friction[pads] == pytest.approx(0.5 * own[pads])
