"""Harm that is planted in a run is found, whoever does it; a run without any is harmless."""

from __future__ import annotations

from collections.abc import Collection
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from bench.campaign.ledger import Row, judged_run
from bench.faults.faulty import Act, FaultyRobot
from bench.faults.nasty import small_scene
from bench.harm.judge import Harm, harm
from bench.harm.probe import probed_run
from palpate.execution.rehearsal import AFTERWARDS
from palpate.execution.simulated_cell import simulated_cell
from palpate.planning.plan import Node, Plan
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs import executing
from palpate.runs.executing import perform

ABOVE = "bottle_pose + z_offset"
STEPS = (Node("MoveJoints", (("joints", "home_config"),)), Node("OpenGripper"))


def watched(act: Act, *more: Node, named: Collection[str] = (), where: str = "can") -> Harm:
    """What is seen of a short run, after which `act` happens to the world: a table with a can and a
    bottle (0.25 kg), or another of the small scenes."""
    scene = small_scene(where)
    robot = FaultyRobot(simulated_cell(scene, None, noise="none", seed=0).robot(), np.inf)
    robot.act = act
    perform(Plan((), Node("Sequence", (), (*STEPS, *more)), ""), scene, robot)
    robot.moment = robot.state.t
    robot.outlast(AFTERWARDS)
    return harm(robot.witness, named)


def nothing(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
    """Nothing is planted."""


def pushed(body: str, wrench: tuple[float, ...], seconds: float) -> Act:
    """Somebody pushes or turns a body, N and N m."""

    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        data.xfrc_applied[model.body(body).id] = wrench if since < seconds else np.zeros(6)

    return act


def lifted(height: float) -> Act:
    """The bottle is let go of in the air."""
    done: list[float] = []

    def act(model: mujoco.MjModel, data: mujoco.MjData, since: float) -> None:
        if not done:
            done.append(since)
            data.joint(int(model.body("bottle").jntadr[0])).qpos[2] += height

    return act


def test_a_run_in_which_nothing_is_planted_is_harmless() -> None:
    above = Node("MovePose", (("pose", ABOVE),))
    assert watched(nothing, above, named=("bottle",)).beyond == ()


def test_a_drop_is_found() -> None:
    seen = watched(lifted(0.05), named=("bottle",))
    assert "bottle dropped" in seen.beyond
    assert seen.fallen == ("bottle",)


def test_a_tip_is_found() -> None:
    seen = watched(pushed("bottle", (0, 0, 0, 0.3, 0, 0), 0.5), named=("bottle",))
    assert "bottle tipped" in seen.beyond
    assert seen.fallen == ("bottle",)


@pytest.mark.parametrize(
    ("seconds", "named", "whats"),
    [(0.08, (), ["moved"]), (0.08, ("plank",), []), (0.16, ("plank",), ["pushed"])],
)
def test_a_neighbour_that_is_moved_is_found(
    seconds: float, named: tuple[str, ...], whats: list[str]
) -> None:
    """A plank of 0.6 kg slides by 10, and by 40 mm."""
    aside = pushed("plank", (-5.5, 0, 0, 0, 0, 0), seconds)
    seen = watched(aside, named=named, where="plank")
    assert [(fate.name, fate.what) for fate in seen.fates] == [("plank", what) for what in whats]


def test_a_push_of_200_n_is_found() -> None:
    above = Node("MovePose", (("pose", ABOVE),))
    down = pushed("robot/hand", (0, 0, -200.0, 0, 0, 0), 0.5)
    seen = watched(down, above, named=("bottle",))
    assert any("N over 10 ms" in line for line in seen.forces)
    assert any("N over 20 ms" in line for line in seen.forces)
    assert seen.touches[0].mean10 > 100


def test_the_fall_of_an_object_released_last_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a row of a campaign says so."""

    def let_go(plan: Plan, scene: object, robot: MujocoRobot, *_: object) -> SimpleNamespace:
        model, data = robot.world.model, robot.world._data  # pyright: ignore[reportPrivateUsage]
        lifted(0.05)(model, data, 0.0)
        return SimpleNamespace(status="complete", stopped_by=None, robot_seconds=0.0)

    monkeypatch.setattr(executing, "perform", let_go)
    seen = probed_run(Plan((), None, ""), small_scene("can"), noise="none")
    assert [str(fate) for fate in seen.harm.fates][:1] == ["bottle dropped"]
    assert "moved" in [fate.what for fate in seen.harm.fates]
    row = judged_run(Row.named("nasty", "let go", "lets go"), seen)
    assert (row.outcome, row.beyond) == ("complete", seen.harm.beyond)
