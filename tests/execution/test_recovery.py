"""After a failure: stop, skip, replan; and rehearsal before it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from palpate.common.errors import Unavailable
from palpate.common.parameter import Parameter
from palpate.execution import recovery, rehearsal
from palpate.execution.recovery import ATTEMPTS, OnFailure, failed_at, recover, replan, resumable
from palpate.execution.rehearsal import Rehearsal, rehearse
from palpate.execution.runner import Execution, run
from palpate.execution.simulated_cell import SimulatedCell
from palpate.planning.plan import Node, Plan
from palpate.planning.symbolic.planner import assemble
from palpate.primitives.base import Blackboard, LeafFailure, Primitive, Steps
from palpate.primitives.registry import Vocabulary, vocabulary
from palpate.robots.owner import load_description
from palpate.runs import pipeline
from palpate.runs.executing import perform
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene, rearrange
from palpate.scene.scene import Scene
from palpate.trace.recording import Context, LeafRun
from palpate.trace.samples import Samples, Trace

CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.35 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="wet" pos="0.5 0.2 0.05"><freejoint/><geom type="box" size=".02 .02 .05" {wet}/></body>
  <body name="dry" pos="0.5 -0.2 0.05"><freejoint/><geom type="box" size=".02 .02 .05" {dry}/></body>
</worldbody></mujoco>"""
SCENE = CELL.format(wet='friction="0.5 0.005 0.0001"', dry='friction="0.5 0.005 0.0001"')
WORLD = CELL.format(wet='mass="0.8" friction="0.03 0.005 0.0001" priority="2"', dry='mass="0.25"')
BOTH = (Parameter("wet", "mass"), Parameter("dry", "mass"))


class Flaky(Primitive):
    """Fails. A stand-in for bad luck, which no real component provides on demand."""

    group: ClassVar = "sensing"

    def run(self, blackboard: Blackboard) -> Steps:
        yield
        raise LeafFailure("bad luck")


class NeverMeasures(Primitive):
    """Fails in the place of `MeasureForces`."""

    group: ClassVar = "sensing"
    writes: ClassVar = "forces"

    def run(self, blackboard: Blackboard) -> Steps:
        yield
        raise LeafFailure("no signal")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(SCENE)


def execute(
    scene: Scene, plan: Plan, policy: OnFailure, words: Vocabulary | None = None
) -> Execution:
    robot = SimulatedCell(parse_scene(WORLD), noise="lab").robot()

    def attempt(plan: Plan, scene: Scene, robot: object) -> Execution:
        return run(plan, scene, robot, words=words)  # type: ignore[arg-type]

    return recover(attempt(plan, scene, robot), plan, scene, robot, policy, attempt)


def planned(scene: Scene, *parameters: Parameter) -> Plan:
    made = assemble(scene, parameters)
    return Plan(made.measured, made.tree, "", "symbolic")


def measured(done: Execution) -> set[str]:
    return {c.object for c in done.trace.conversions}


def test_stop_ends_at_the_first_failure(scene: Scene) -> None:
    done = execute(scene, planned(scene, *BOTH), "stop")
    assert done.status == "stopped"
    assert done.setbacks == ()
    assert measured(done) == set()


def test_skip_leaves_the_slippery_one_alone_and_weighs_the_other(scene: Scene) -> None:
    done = execute(scene, planned(scene, *BOTH), "skip")
    assert done.status == "complete"
    assert measured(done) == {"dry"}
    assert len(done.setbacks) == 1
    assert "slip" in done.setbacks[0]


@pytest.mark.long
def test_replanning_leaves_a_lost_object_alone_and_weighs_the_others(scene: Scene) -> None:
    done = execute(scene, planned(scene, *BOTH), "replan")
    assert done.status == "complete"
    assert measured(done) == {"dry"}
    (setback,) = done.setbacks
    assert "slip" in setback
    assert "'wet' was not put down" in setback
    closed = [leaf for leaf in done.trace.leaves if leaf.label.startswith("CloseGripper")]
    assert len(closed) == 2


def test_a_further_plan_that_fails_its_check_is_none(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert replan(BOTH, scene, "symbolic") is not None
    astray = Node("Sequence", (), (Node("MovePose", (("pose", "table_pose"),)),))
    made = replace(assemble(scene, BOTH), tree=astray)
    monkeypatch.setattr(recovery, "assemble", lambda *_: made)
    assert replan(BOTH, scene, "symbolic") is None


@pytest.mark.parametrize(("failure", "attempts"), [(None, {"", "replan[1]"}), ("drops", {""})])
def test_a_further_plan_is_rehearsed_where_the_first_one_was(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, failure: str | None, attempts: set[str]
) -> None:
    rehearsed: list[Plan] = []

    def predicted(plan: Plan, scene: Scene) -> Rehearsal:
        rehearsed.append(plan)
        return Rehearsal(1, 1.0, 0.0, failure)

    monkeypatch.setattr(rehearsal, "rehearse", predicted)
    robot = SimulatedCell(parse_scene(WORLD), noise="lab").robot()
    done = perform(planned(scene, *BOTH), scene, robot, on_failure="skip", is_rehearsed=True)
    (plan,) = rehearsed
    assert plan.parameters == BOTH[1:]
    begun = {leaf.node.partition("tree")[0].strip(".") for leaf in done.trace.leaves}
    assert begun - {"stop"} == attempts
    assert measured(done) == ({"dry"} if failure is None else set())


@pytest.mark.long
def test_replanning_is_bounded(scene: Scene) -> None:
    """Three times at most for an object that was not lost."""
    words = Vocabulary(
        {**vocabulary().primitives, "MeasureForces": NeverMeasures}, vocabulary().composites
    )
    done = execute(scene, planned(scene, *BOTH), "replan", words)
    assert done.status == "stopped"
    held = [leaf.context.holding for leaf in done.trace.leaves if leaf.message == "no signal"]
    assert held == ["dry"] * ATTEMPTS["replan"]


class StoppedArm:
    """A real arm's word that it was stopped; a `Recoverable` as far as recovery asks."""

    def __init__(self, cleared: bool = True) -> None:
        self.state = SimpleNamespace(fault="the user stop was pressed")
        self.cleared, self.asked = cleared, 0

    def recover(self) -> None:
        self.asked += 1
        if not self.cleared:
            raise Unavailable("release the user stop")


@pytest.fixture(scope="module")
def ended(scene: Scene) -> Execution:
    plan = Plan((), Node("Sequence", (), (Node("OpenGripper"),)), "", "test")
    return execute(scene, plan, "stop")


@pytest.mark.parametrize("policy", ["replan", "skip"])
@pytest.mark.parametrize(("says", "cleared"), [(False, True), (True, False)])
def test_a_real_arm_that_was_stopped_never_goes_on_by_itself(
    scene: Scene, ended: Execution, policy: OnFailure, says: bool, cleared: bool
) -> None:
    why, robot = "MovePose: the user stop was pressed", StoppedArm(cleared)
    first = replace(ended, status="stopped", stopped_by=why, fault="the user stop was pressed")
    told: list[str] = []

    def answer(reason: str) -> bool:
        told.append(reason)
        return says

    def attempt(plan: Plan, around: Scene, arm: object) -> Execution:
        raise AssertionError("it went on")

    plan = planned(scene, Parameter("dry", "mass"))
    done = recover(first, plan, scene, robot, policy, attempt, True, answer)  # type: ignore[arg-type]
    assert done is first
    assert told == [why]
    assert robot.asked == int(says)


def test_person_may_let_a_stopped_arm_continue_and_the_result_says_so(
    scene: Scene, ended: Execution
) -> None:
    robot, plan = StoppedArm(), planned(scene, Parameter("dry", "mass"))
    first = replace(ended, status="stopped", stopped_by="stopped", fault="the user stop")
    attempts: list[Plan] = []

    def attempt(plan: Plan, around: Scene, arm: object) -> Execution:
        attempts.append(plan)
        return ended

    done = recover(first, plan, scene, robot, "replan", attempt, True, lambda _: True)  # type: ignore[arg-type]
    assert done.status == "complete"
    assert attempts[0].parameters == plan.parameters
    assert robot.asked == 1
    assert done.setbacks[0].startswith("stopped (a person let the robot go on at ")


@pytest.mark.parametrize(
    ("policy", "second"), [("replan", ["dry", "wet"]), ("skip", ["dry"]), ("stop", None)]
)
def test_a_failed_pose_is_tried_last_or_not_again(
    scene: Scene, ended: Execution, policy: OnFailure, second: list[str] | None
) -> None:
    context = Context("still", at="wet_pose", holding="wet")
    failed = LeafRun("tree.children[5]", "MeasureForces", "", 0.0, 1.0, "FAILURE", "", context)
    trace = replace(ended.trace, leaves=(failed,))
    first = replace(ended, status="stopped", stopped_by="no signal", trace=trace)
    plans: list[Plan] = []

    def attempt(plan: Plan, around: Scene, arm: object) -> Execution:
        plans.append(plan)
        return ended

    recover(first, planned(scene, *BOTH), scene, StoppedArm(), policy, attempt)  # type: ignore[arg-type]
    assert [[wanted.object for wanted in plan.parameters] for plan in plans] == (
        [] if second is None else [second]
    )


def test_a_run_that_a_person_stopped_or_that_holds_something_ends(ended: Execution) -> None:
    robot: Any = SimpleNamespace()
    stopped = replace(ended, status="stopped", stopped_by="no signal")
    holding = replace(stopped, final_state=replace(ended.final_state, holding="dry"))
    assert resumable(stopped, robot)
    for over in (ended, replace(stopped, asked=True), holding, replace(stopped, fault="frozen")):
        assert not resumable(over, robot)


def test_implausible_signals_cannot_be_confirmed_by_a_person(
    scene: Scene, ended: Execution
) -> None:
    robot, plan = StoppedArm(), planned(scene, Parameter("dry", "mass"))
    robot.state.fault = None
    first = replace(ended, status="stopped", stopped_by="frozen", fault="signals are frozen")

    def answer(_: str) -> bool:
        raise AssertionError("asked")

    done = recover(first, plan, scene, robot, "replan", execute, True, answer)  # type: ignore[arg-type]
    assert done is first


@pytest.mark.long
def test_replanning_gets_over_bad_luck(scene: Scene) -> None:
    plan = planned(scene, Parameter("dry", "mass"))
    assert plan.tree is not None
    cut = next(i for i, child in enumerate(plan.tree.children) if child.type == "CloseGripper") + 2
    unlucky = Node(
        "Sequence", (), (*plan.tree.children[:cut], Node("Flaky"), *plan.tree.children[cut:])
    )
    words = Vocabulary({**vocabulary().primitives, "Flaky": Flaky}, vocabulary().composites)
    done = execute(scene, Plan(plan.parameters, unlucky, "", "test"), "replan", words)
    assert done.status == "complete"
    assert measured(done) == {"dry"}
    assert done.setbacks == ("Flaky(): bad luck",)
    times = done.trace.samples.t
    assert np.all(np.diff(times) > 0)
    assert any(leaf.node.startswith("replan[1].tree") for leaf in done.trace.leaves)


@pytest.mark.parametrize("attempt", ["", "replan[1]."])
def test_object_of_a_failed_leaf_is_found_under_any_node_prefix(scene: Scene, attempt: str) -> None:
    way = Node("MovePose", (("pose", "wet_pose + z_offset"),), name="go and (gently) see")
    plan = Plan(BOTH, Node("Sequence", (), (Node("OpenGripper"), way)), "")
    failed = LeafRun(
        f"{attempt}tree.children[1]",
        "MovePose",
        way.name,
        0.0,
        1.0,
        "FAILURE",
        "blocked",
        Context("still"),
    )
    trace = Trace(Samples.empty(), (failed,), (), (), load_description().nominal)
    assert failed_at(trace, plan, scene) == "wet"
    later = replace(
        failed, node=f"{attempt}tree.children[0]", context=Context("still", at="dry_pose")
    )
    assert failed_at(replace(trace, leaves=(failed, later)), plan, scene) == "dry"
    held = replace(failed, context=Context("moving", at="dry_pose", holding="dry"))
    assert failed_at(replace(trace, leaves=(held,)), plan, scene) == "dry"
    assert failed_at(replace(trace, leaves=()), plan, scene) is None


def test_rearranged_scene_moves_the_object_and_its_grasp(scene: Scene) -> None:
    before = scene.body("dry").pose_world
    moved = rearrange(scene, {"dry": before.translate([0.05, 0.0, 0.0])})
    assert moved.body("dry").pose_world.position[0] == pytest.approx(0.55)
    assert moved.symbols.resolve("dry_pose").position[0] == pytest.approx(0.55, abs=1e-6)
    assert moved.body("wet").pose_world.position == pytest.approx(
        scene.body("wet").pose_world.position
    )
    assert moved.text == scene.text


@pytest.mark.long
def test_rehearsal_predicts_without_the_world(scene: Scene) -> None:
    predicted = rehearse(planned(scene, *BOTH), scene)
    assert predicted.failure is None
    assert predicted.actions == 21
    assert 10 < predicted.robot_seconds < 50
    assert 0 < predicted.peak_force < 60


def test_failing_rehearsal_keeps_the_arm_still(
    scene: Scene, tmp_path: pytest.TempPathFactory
) -> None:
    heavy = parse_scene(
        CELL.format(
            wet='mass="0.1" friction="0.5 0.005 0.0001"',
            dry='mass="2.9" friction="0.02 0.005 0.0001" priority="2"',
        )
    )
    tree = assemble(scene, [Parameter("dry", "mass")]).tree
    plan = Plan((Parameter("dry", "mass"),), tree, "")
    run = pipeline.rehearse(Run(Settings(rehearse=True), heavy, plan))
    assert [f.rule for f in run.findings] == ["rehearsal"]
    assert pipeline.measure(run).execution is None
