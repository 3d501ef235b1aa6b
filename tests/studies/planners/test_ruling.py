"""What a run came to, told of runs made by hand: nothing is simulated here."""

from dataclasses import replace
from pathlib import Path

import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.planning.plan import Node, Plan
from palpate.runs.run import Ending, Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.studies.attempt import Conditions, attempt
from palpate.studies.judgement import rule
from palpate.studies.scenarios.catalogue import Scenario
from palpate.studies.trials import PlannerTrial
from palpate.trace.recording import Context, Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, Samples, Trace
from palpate.twin.twin import Twin

MASS = Parameter("cup.mass")
SCENE = parse_scene(
    """<mujoco><worldbody>
      <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".5 .5 .02"/></body>
      <body name="cup" pos="0.5 0 0.04"><freejoint/><geom type="box" size=".03 .03 .04"/></body>
      <body name="jug" pos="0.5 0.2 0.04"><freejoint/><geom type="box" size=".03 .03 .04" mass="1"/></body>
    </worldbody></mujoco>"""
)
TASK = Scenario("cup", "A cup", "", "How heavy is the cup?", (MASS,), "symbolic", "complete")
TREE = Node("Sequence", {}, ())


def leaf(holding: str) -> LeafRun:
    context = Context("still", holding=holding)
    return LeafRun("tree", "MovePose", "MovePose(cup_pose)", 0.0, 1.0, "SUCCESS", "", context)


def run(value: float = 0.3, held: tuple[str, ...] = ("cup",), **changes) -> Run:
    """The cup is weighed, 0.300 ± 0.001 kg by the truth; `held` are all things that were held."""
    weighed = Recording(FORCES, 0.0, 1.0, Context("still", holding="cup", grasp="cup_pose"), "node")
    trace = Trace(
        Samples.empty(),
        tuple(leaf(name) for name in held),
        (weighed,),
        (Conversion("Force2Mass", "cup", "mass", weighed, 1.0),),
        NominalHand(0.009, 0.15, 0.01, 0.0001),
    )
    estimate = Estimate.normal(MASS, "kg", value, 0.001, "by hand")
    result = Run(
        Settings(),
        SCENE,
        Plan((MASS,), TREE, "lift it"),
        execution=Ending("complete", None, 12, 20.0, 1.0),
        recorded=trace,
        estimates=(estimate,),
        truth={MASS: (0.3,)},
        finished=Twin("", "", (), None),
    )
    return replace(result, **changes)


def refusal(**changes) -> Run:
    return Run(Settings(), SCENE, replace(Plan((), None, "it cannot be measured"), **changes))


def test_a_value_right_in_trace_and_twin_is_acquired() -> None:
    ruling = rule(run(), TASK, looks=True)
    assert (ruling.outcome, ruling.success, ruling.reason) == ("acquired", True, "")


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (run(0.3052), "off by 5.2 of its standard deviations"),
        (run(finished=Twin("", "", (), None, unwritten=(MASS,))), "not in the twin"),
        (run(held=("cup", "jug")), "touched needlessly: jug"),
        (run(estimates=()), "cup.mass is not identified"),
    ],
)
def test_a_value_wrong_in_trace_or_twin_is_not_acquired(made: Run, reason: str) -> None:
    ruling = rule(made, TASK, looks=True)
    assert (ruling.outcome, ruling.success) == ("failed", False)
    assert reason in ruling.reason


def test_a_blocking_object_may_be_moved() -> None:
    assert rule(run(held=("cup", "jug")), replace(TASK, may_touch=("jug",)), looks=True).success


def test_a_refusal_is_right_only_where_nothing_can_be_measured() -> None:
    nothing = replace(TASK, expects=(), status="rejected")
    assert rule(refusal(), nothing, looks=True).outcome == "refused rightly"
    assert rule(refusal(), TASK, looks=True).outcome == "refused"
    assert not rule(refusal(), TASK, looks=True).success
    assert rule(run(), nothing, looks=True).reason.startswith("the arm moved")


def test_only_a_planner_without_vision_may_refuse_a_request_that_needs_a_picture() -> None:
    seen = replace(TASK, only_seen=True)
    assert rule(refusal(), seen, looks=False).outcome == "refused rightly"
    assert rule(refusal(), seen, looks=True).outcome == "refused"


def test_a_run_that_has_to_be_stopped_is_right_when_it_was() -> None:
    mishap = replace(TASK, status="aborted")
    stopped = Ending("stopped", "too heavy", 6, 9.0, 1.0)
    assert rule(run(execution=stopped, estimates=()), mishap, True).outcome == "stopped rightly"
    assert "ended complete" in rule(run(), mishap, True).reason
    assert "off by" in rule(run(0.4, execution=stopped), mishap, True).reason
    other = Plan((Parameter("jug.mass"),), TREE, "")
    assert "another" in rule(run(plan=other, execution=stopped), mishap, True).reason


def test_a_planner_without_vision_may_be_stopped_by_an_unseen_obstacle() -> None:
    hidden = replace(TASK, expects=(), status="rejected", only_seen=True)
    stopped = Ending("stopped", "unexpected contact", 6, 9.0, 1.0)
    assert rule(run(execution=stopped, estimates=()), hidden, looks=False).success
    assert not rule(run(execution=stopped, estimates=()), hidden, looks=True).success


def test_a_planner_without_vision_needs_a_scene(tmp_path: Path) -> None:
    record = attempt(PlannerTrial("from_picture", "symbolic", "full", 0), frozenset(), Conditions())
    assert (record.outcome, record.success) == ("refused rightly", True)
