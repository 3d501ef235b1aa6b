"""What the arm has to answer for when something strikes it."""

from __future__ import annotations

from pkgutil import resolve_name

import mujoco
import numpy as np
import pytest

from bench.campaign.ledger import judged
from bench.faults import runtime
from bench.faults.faulty import FaultyRobot
from bench.faults.kinds import FAULTS, OBJECT, Fault
from bench.harm.judge import Harm
from palpate.common.errors import ExecutionAborted
from palpate.execution.harm import HarmedObject
from palpate.execution.simulated_cell import simulated_cell
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs import pipeline, workplace
from palpate.runs.settings import Settings
from palpate.scene.load import load_scene
from palpate.studies.scenarios.catalogue import scenario

FORCE = "hand on table: 90 N over 10 ms"
SEEN = Harm(
    (),
    {},
    (FORCE,),
    (
        HarmedObject(OBJECT, "dropped"),
        HarmedObject(OBJECT, "pushed", 0.04),
        HarmedObject("crate", "moved", 0.01),
    ),
)


def meddled(_: FaultyRobot) -> None:
    """Nothing is wrong."""


@pytest.mark.parametrize(
    ("holds", "honest", "charged"),
    [
        (True, True, [FORCE, f"{OBJECT} dropped", f"{OBJECT} pushed by 40 mm", "crate moved by 10 mm"]),
        (False, True, [FORCE, "crate moved by 10 mm"]),
        (True, False, [f"{OBJECT} dropped"]),
        (False, False, []),
    ],
)  # fmt: skip
def test_a_fault_excuses_what_it_explains_and_nothing_else(
    holds: bool, honest: bool, charged: list[str]
) -> None:
    fault = Fault("any", meddled, holds=holds, honest=honest)
    assert runtime.chargeable(SEEN, fault) == charged


@pytest.fixture(scope="module")
def robot() -> MujocoRobot:
    settings = scenario(runtime.SCENARIO).settings()
    assert settings.scene is not None
    return simulated_cell(load_scene(settings.scene), settings.world, noise="none").robot()


def struck(robot: MujocoRobot, name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The world a moment after a fault of it has begun."""
    (fault,) = [fault for fault in FAULTS if fault.name == name]
    model, data = robot.world.model, robot.world.data()
    faulty = FaultyRobot(robot, 0.0)
    fault.meddle(faulty)
    assert faulty.act is not None
    for step in range(3):
        faulty.act(model, data, step * 0.0005)
    return model, data


def test_every_failing_part_exists() -> None:
    places = [place for fault in FAULTS for place in fault.patches]
    assert len(places) >= 5
    assert all(callable(resolve_name(place)) for place in places)


def test_faults_of_the_world_change_it(robot: MujocoRobot) -> None:
    before = robot.world.model.jnt_actfrcrange.copy()
    model, _ = struck(robot, "arm gives out")
    np.testing.assert_allclose(model.jnt_actfrcrange, before / 4)
    model, _ = struck(robot, "pads without friction")
    pads = [model.geom(f"robot/{side}_pad") for side in ("left", "right")]
    assert [pad.friction[0] for pad in pads] == [0.02, 0.02]
    # Theirs is the contact's friction, whatever they hold.
    assert all(pad.priority > model.geom_priority[model.body_geomadr[1]] for pad in pads)
    model, _ = struck(robot, "grip gives out")
    assert model.actuator("robot/fingers").forcerange.tolist() == [-1.6, 1.6]
    _, data = struck(robot, "hand pushed down with 80 N")
    assert data.body("robot/hand").xfrc_applied[2] == -80


def test_the_judge_finds_objects_that_fall_after_a_run_and_lost_traces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def run(settings: Settings, _: object) -> None:
        robot = workplace.cell_for(settings, None).robot()
        model, data = robot.world.model, robot.world._data  # type: ignore[attr-defined]
        data.joint(int(model.body(OBJECT).jntadr[0])).qpos[2] += 0.05
        raise ExecutionAborted("the arm lets go")

    monkeypatch.setattr(runtime, "duration", lambda: 10.0)
    monkeypatch.setattr(pipeline, "run", run)
    row = judged(runtime.Case("fingers fail", 0.5), runtime.strike)
    assert (row.outcome, row.said) == ("ExecutionAborted", ("the arm lets go",))
    assert row.beyond == (f"{OBJECT} dropped", "trace lost")
