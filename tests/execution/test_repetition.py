"""Repetition of too wide intervals, until they are narrow enough or at their floor."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import pytest
from performing import CELL, CUP, cell

import palpate as pp
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.within import Within
from palpate.execution import recovery as repetition
from palpate.execution.recovery import repeat
from palpate.execution.runner import Execution, run
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs.run import Run
from palpate.scene.scene import Scene

SCENE = CELL.format(cup=" ".join(map(str, CUP)), table=-0.03, mass="")
WORLD = CELL.format(cup=" ".join(map(str, CUP)), table=-0.03, mass='mass="0.3"')


def count(run: Run, quantity: str) -> int:
    """Number of its measurements."""
    return sum(c.quantity == quantity for c in run.trace.conversions)


@pytest.fixture(scope="module")
def narrowed(tmp_path_factory) -> Run:
    """Its signals are noisier than the arm's description says, and its fingertips are known."""
    folder = tmp_path_factory.mktemp("within")
    loud = folder / "loud.yaml"
    loud.write_text(
        "palpate_noise: 1\nname: loud\nextends: lab\ntorque: {white: 0.3}\n"
        "datasheet: {tip_offset_std: 2.0e-5}\nmodel: {tip_offset: 2.0e-5}\n"
    )
    return pp.run(
        SCENE,
        "how heavy is the cup, and how high is the table?",
        world=WORLD,
        noise=str(loud),
        within={"mass": "3.5g", "height": "0.13mm"},
        out=folder / "run",
        remeasure=True,
        fast=True,
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "half", "truth"), [("cup.mass", 0.0035, 0.3), ("table.height", 0.00013, 0.0)]
)
def test_a_value_is_measured_until_it_is_as_narrow_as_asked(narrowed, name, half, truth) -> None:
    assert count(narrowed, Parameter(name).quantity) > 1
    low, high = narrowed[name].intervals[0]
    assert (high - low) / 2 <= half
    assert low < truth < high
    assert "was asked: " in narrowed[name].method


@pytest.mark.long
def test_repeated_run_is_complete(narrowed) -> None:
    assert narrowed.status == "complete"
    assert narrowed.execution.setbacks == ()


@pytest.mark.long
def test_round_of_repetition_goes_from_home_and_back(narrowed) -> None:
    """However often it touches in it."""
    rounds = {leaf.node.partition("tree")[0] for leaf in narrowed.trace.leaves}
    assert count(narrowed, "height") > len(rounds)
    homes = [leaf for leaf in narrowed.trace.leaves if leaf.primitive == "MoveJoints"]
    assert len(homes) <= 2 * len(rounds)


@pytest.mark.long
def test_result_states_the_asked_width_and_the_outcome(narrowed) -> None:
    rows = json.loads((narrowed.folder / "result.json").read_text())["parameters"]
    told = {row["quantity"]: row["within"] for row in rows}
    assert told["mass"]["asked"] == 0.0035
    assert told["height"]["outcome"] == told["mass"]["outcome"] == "reached"
    again = pp.open(narrowed.folder)
    assert again.status == "complete"
    assert again.settings.within == narrowed.settings.within


NARROWER = "0.9g"
"""Less than one weighing of the cup reaches, 1.3 g, and more than the floor that the joints' gains set."""


@dataclass(frozen=True)
class Weighed:
    """A cup that was weighed once, with no width asked."""

    plan: Plan
    scene: Scene
    execution: Execution

    def again(self, runner: Any, done: Execution, within: str) -> tuple[Execution, Estimate]:
        """Execution after repetition by a `runner`, and the mass from it."""
        asked = Within.read({"mass": within})
        robot: Any = None
        whole = repeat(done, self.plan, self.scene, robot, asked, runner, lambda _: None)
        return whole, asked.told(self.mass(whole))

    def mass(self, done: Execution) -> Estimate:
        return estimate_all([Parameter("cup.mass")], done.trace, self.scene.bodies)[0]


@pytest.fixture(scope="module")
def weighed() -> Weighed:
    scene, world = cell(), cell(mass='mass="0.3"')
    plan = SymbolicPlanner().plan("how heavy is the cup?", scene)
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, noise="lab")
    return Weighed(plan, scene, run(plan, scene, robot))


def test_a_plan_without_a_width_repeats_nothing(weighed) -> None:
    nothing: Any = None
    done = repeat(weighed.execution, weighed.plan, weighed.scene, nothing, Within(), nothing, print)
    assert done is weighed.execution


def test_at_the_floor_of_the_sensors_gains_nothing_is_repeated_in_vain(weighed) -> None:
    """Of an arm whose links nobody knows: their weight tells nothing of the gains."""
    trace = weighed.execution.trace
    chain = replace(trace.hand.chain, links=())
    hand = replace(trace.hand, torque_gain=0.05, gain_covariance=None, chain=chain)
    unsure = replace(trace, hand=hand)
    done = replace(weighed.execution, trace=unsure)
    whole, mass = weighed.again(None, done, "1g")
    assert whole is done
    assert "at the floor of" in mass.method
    assert "calibrate the arm" in mass.method


def test_a_round_that_fails_leaves_what_the_first_one_measured(weighed) -> None:
    """The robot's signals cannot be believed from its beginning on."""

    def failing(plan: Plan, scene: Scene, robot: object) -> Execution:
        trace = weighed.execution.trace
        end = float(trace.samples.t[-1])
        stop = replace(trace.leaves[0], node="stop", start=end, end=end + 0.1, status="FAILURE")
        nothing = replace(
            trace,
            samples=trace.samples.where(slice(0, 0)),
            leaves=(stop,),
            recordings=(),
            conversions=(),
        )
        why = "the torques are frozen"
        return replace(
            weighed.execution, trace=nothing, status="stopped", stopped_by=why, fault=why
        )

    whole, mass = weighed.again(failing, weighed.execution, NARROWER)
    assert whole.status == "stopped"
    assert whole.stopped_by == "the torques are frozen"
    assert mass.identified
    assert mass.value == weighed.mass(weighed.execution).value


@pytest.mark.parametrize(
    ("seconds", "rounds"),
    [
        pytest.param(20.0, 5, marks=pytest.mark.long),
        pytest.param(60.0, 2, marks=pytest.mark.long),
        (120.0, 1),
    ],
)
def test_the_number_of_rounds_is_bounded(weighed, monkeypatch, seconds, rounds) -> None:
    """Of rounds, and of robot time."""
    monkeypatch.setattr(repetition, "FUTILE", 2.0)
    gone, mass = idle(weighed, seconds)
    assert gone == rounds
    assert "more work would narrow it" in mass.method


def test_two_rounds_that_narrow_nothing_are_the_last(weighed) -> None:
    """One alone may widen an interval, since the noise level is learned again."""
    gone, _ = idle(weighed, 1.0)
    assert gone == 2


def idle(weighed: Weighed, seconds: float) -> tuple[int, Estimate]:
    """Number of rounds, of `seconds` and without a recording each, and the mass after them."""
    gone: list[Plan] = []

    def round_(plan: Plan, scene: Scene, robot: object) -> Execution:
        gone.append(plan)
        trace = weighed.execution.trace
        nothing = trace.samples.where(slice(0, 0))
        empty = replace(trace, samples=nothing, leaves=(), recordings=(), conversions=())
        return replace(weighed.execution, trace=empty, robot_seconds=seconds)

    _, mass = weighed.again(round_, weighed.execution, NARROWER)
    return len(gone), mass
