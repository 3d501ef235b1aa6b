"""The command that carries a run out again."""

from __future__ import annotations

import shlex
from pathlib import Path

from palpate.estimation.quantities.within import Within
from palpate.planning.model.settings import ModelSettings
from palpate.runs.reproduce import execute_command, reproduce_command, run_command
from palpate.runs.settings import Settings
from palpate.studies.scenarios.catalogue import scenario


def test_the_command_states_only_other_values_than_the_defaults() -> None:
    plain = Settings(scene=Path("desk.xml"))
    assert run_command(plain) == ["palpate", "run", "--scene", "desk.xml"]
    message = Settings(
        request="how heavy is the mug?",
        scene=Path("desk.xml"),
        images=(Path("a.png"), Path("b.png")),
        robot_body=("base", "tool"),
        planner="openai:gpt",
        cautious=True,
        rehearse=False,
        on_failure="skip",
        within=Within((("mass", 0.001),)),
        model_settings=ModelSettings(native=True),
    )
    assert shlex.join(run_command(message)) == (
        "palpate run --scene desk.xml -r 'how heavy is the mug?' --image a.png --image b.png "
        "--robot-body base --robot-body tool --planner openai:gpt --within mass=0.001 --cautious "
        "--no-rehearse --on-failure skip --native"
    )


def test_a_plan_is_executed_in_its_scene() -> None:
    settings = Settings(scene=Path("desk.xml"), poses=Path("poses.yaml"), seed=3)
    text = " ".join(execute_command(settings, Path("plan.json")))
    assert text == "palpate execute plan.json --scene desk.xml --poses poses.yaml --seed 3"


def test_a_finished_run_says_noise_and_seed_and_where_its_files_are_from_there(
    tmp_path: Path,
) -> None:
    settings = Settings(scene=tmp_path / "desk.xml", planner=f"replay:{tmp_path / 'plan.json'}")
    text = " ".join(reproduce_command(settings, tmp_path / "runs" / "desk"))
    assert text == (
        "palpate run --scene ../../desk.xml --planner replay:../../plan.json --noise measured --seed 0"
    )


def test_a_scenario_goes_by_its_name() -> None:
    settings = scenario("mishaps/slip").settings(seed=7)
    text = " ".join(reproduce_command(settings))
    assert text == "palpate demo mishaps/slip --planner symbolic --seed 7 --noise measured"
