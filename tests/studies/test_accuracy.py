"""Accuracy over seeds: the figures are what they are called, and a run that fails is no trial."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from palpate.parameter import Parameter
from palpate.settings import Settings
from palpate.studies.accuracy import SeedRun, accuracy, run_seed
from palpate.studies.scores.summary import summarise

MASS = Parameter("cup", "mass")
CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/><geom type="box" size=".03 .02 .05" {cup}/></body>
</worldbody></mujoco>"""


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    files = {"scene": 'friction="0.5"', "world": 'mass="0.3" friction="0.5"'}
    for name, cup in files.items():
        (tmp_path / f"{name}.xml").write_text(CELL.format(cup=cup), encoding="utf-8")
    return Settings(scene=tmp_path / "scene.xml", world=tmp_path / "world.xml")


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
