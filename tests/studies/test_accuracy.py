"""Accuracy over seeds: figures, failed runs, displaced objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.execution.simulated_cell import SimulatedCell
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.scene.load import load_scene
from palpate.studies.accuracy import (
    Question,
    SeedRun,
    StudyCase,
    accuracy,
    displaced_cell,
    run_case,
    run_seed,
)
from palpate.studies.summary import summarise

MASS, COM = Parameter("cup", "mass"), Parameter("cup", "com")
CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/><geom type="box" size=".03 .02 .05" {cup}/></body>
</worldbody></mujoco>"""

COM_CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .6 .02"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/>{cup}<geom type="box" size=".03 .02 .05"/></body>
</worldbody></mujoco>"""
TRUTH = '<inertial pos="0.01 0 0.003" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>'
BELIEVED = '<inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>'


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    files = {"scene": 'friction="0.5"', "world": 'mass="0.3" friction="0.5"'}
    for name, cup in files.items():
        (tmp_path / f"{name}.xml").write_text(CELL.format(cup=cup), encoding="utf-8")
    return Settings(scene=tmp_path / "scene.xml", world=tmp_path / "world.xml")


@pytest.mark.long
def test_seeds_are_independent_runs_of_one_world(settings: Settings) -> None:
    runs = accuracy(settings, [1, 2])
    assert [(run.seed, run.status) for run in runs] == [(1, "complete"), (2, "complete")]
    (first,), (second,) = (run.estimates for run in runs)
    assert first.parameter == second.parameter == MASS
    assert first.truth == second.truth == 0.3
    assert first.value != second.value
    assert all(
        abs(t.value - 0.3) < 0.015 and t.std < 0.01 and t.single_shot is not None
        for t in (first, second)
    )
    assert run_seed(settings, 1) == runs[0]


def test_a_run_that_identifies_nothing_has_no_estimates(settings: Settings) -> None:
    assert settings.world is not None
    elsewhere = CELL.format(cup='mass="0.3"').replace(
        'name="cup" pos="0.5 0.1', 'name="cup" pos="0.3 0.4'
    )
    settings.world.write_text(elsewhere, encoding="utf-8")
    run = run_seed(settings, 0)
    assert run.status == "aborted"
    assert run.estimates == ()
    assert run.actions > 3
    (missed,) = run.unmeasured
    assert (missed.parameter, missed.truth, missed.verdict) == (MASS, 0.3, "not identified")
    (row,) = summarise([run])
    assert (row.runs, row.asked, row.verdicts) == (0, 1, {"not identified": 1})
    assert (row.mean, row.scores) == (None, None)


def test_a_rejected_plan_moves_nothing(settings: Settings) -> None:
    run = run_seed(replace(settings, request="the temperature of the cup"), 0)
    assert run == SeedRun(0, "rejected", 0, 0.0, ())


@pytest.fixture
def com_settings(tmp_path: Path) -> Settings:
    for name, cup in {"scene": BELIEVED, "world": TRUTH}.items():
        (tmp_path / f"{name}.xml").write_text(COM_CELL.format(cup=cup), encoding="utf-8")
    return Settings(scene=tmp_path / "scene.xml", world=tmp_path / "world.xml")


def cell(settings: Settings, seed: int, poses: str | None = None) -> SimulatedCell:
    assert settings.scene is not None
    file = None
    if poses is not None:
        file = settings.scene.with_name("poses.yaml")
        file.write_text(poses, encoding="utf-8")
    asked = Settings(scene=settings.scene, world=settings.world, poses=file, seed=seed)
    displaced = displaced_cell(asked, load_scene(settings.scene, file))
    assert isinstance(displaced, SimulatedCell)
    return displaced


def shift(made: SimulatedCell) -> np.ndarray:
    return made.world.body("cup").pose_world.position - np.array([0.5, 0.1, 0.05])


def test_displaced_cell_moves_an_object_in_the_plane_and_not_its_believed_pose(
    com_settings: Settings,
) -> None:
    simulation = cell(com_settings, seed=3)
    aside = shift(simulation)
    assert aside[2] == pytest.approx(0.0, abs=1e-12)
    assert 1e-5 < np.abs(aside[:2]).max() < 2e-3
    assert simulation.scene is not None
    assert simulation.scene.body("cup").pose_world.position == pytest.approx([0.5, 0.1, 0.05])


def test_displaced_cell_keeps_the_com_in_the_body_frame(com_settings: Settings) -> None:
    assert cell(com_settings, seed=3).truth(COM) == pytest.approx((0.01, 0.0, 0.003))


def test_displacement_is_seeded(com_settings: Settings) -> None:
    first, again, other = (shift(cell(com_settings, seed)) for seed in (3, 3, 4))
    assert first == pytest.approx(again)
    assert first != pytest.approx(other)


def test_displacement_scales_with_the_accuracy_of_poses(com_settings: Settings) -> None:
    usual, rough = shift(cell(com_settings, 3)), shift(cell(com_settings, 3, "accuracy: 0.002"))
    assert rough == pytest.approx(4.0 * usual)


def test_displaced_cell_keeps_the_drawn_truth(com_settings: Settings) -> None:
    simulation = cell(Settings(scene=com_settings.scene), seed=3)
    assert np.abs(shift(simulation)).max() > 1e-5
    assert simulation.truth(COM) == pytest.approx(simulation.drawn[COM], rel=1e-6)


def test_the_seeds_of_a_scenario_share_one_plan_and_give_the_values_of_separate_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    question, plans = Question("one_missing_mass", (("noise", "none"),)), list[int]()
    plan = pipeline.plan
    monkeypatch.setattr(pipeline, "plan", lambda *given: plans.append(1) or plan(*given))
    shared = [run_case(StudyCase(question, seed)) for seed in (4, 5)]
    assert len(plans) == 1
    assert shared[1] == run_seed(question.settings, 5, displaced=True)
    assert shared[0].estimates[0].value != shared[1].estimates[0].value
