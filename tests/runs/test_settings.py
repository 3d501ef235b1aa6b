"""What settings refuse before anything is done."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.planner import MAX_REQUEST
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.settings import Settings, request_json, settings_from

D = Path("scene.xml")


@pytest.mark.parametrize(
    "settings",
    [
        Settings(request="the mass of the bottle"),
        Settings(scene=D),
        Settings(request="mass", scene=D),
        Settings(planner="replay:plan.json"),
        Settings(request="x" * MAX_REQUEST, scene=D),
        Settings(scene=D, world=D),
        Settings(scene=D, robot="franka://10.0.0.1"),
        *(Settings(scene=D, noise=noise) for noise in noise_models().names),
    ],
)
def test_valid_settings_pass_unchanged(settings: Settings) -> None:
    assert settings.check_values() == settings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": None}, "nothing to do: give a request"),
        ({"request": " \n"}, "the request is empty"),
        ({"request": "x" * (MAX_REQUEST + 1)}, f"has {MAX_REQUEST + 1} characters"),
        (
            {"noise": "loud"},
            "unknown noise 'loud'; valid: datasheet, hardware, lab, measured, none",
        ),
        ({"on_failure": "panic"}, "unknown policy for failures 'panic'; valid: replan, skip, stop"),
        ({"world": D, "robot": "franka://host"}, "world= and robot= exclude each other"),
        ({"seed": -1}, "seed= must not be negative"),
    ],
)
def test_invalid_settings_are_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(Settings(scene=D), **changes).check_values()


def test_an_existing_folder_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="exists already: choose another out="):
        Settings(scene=D, out=tmp_path).check_values()
    assert Settings(scene=D, out=tmp_path / "new").check_values().out == tmp_path / "new"


def test_a_twin_that_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "twin.xml").touch()
    with pytest.raises(InputError, match="exists already: choose another twin="):
        Settings(scene=D, twin=tmp_path / "twin.xml").check_values()


def test_a_request_is_read_as_it_was_written(tmp_path: Path) -> None:
    asked = Settings(scene=tmp_path / "d.xml", robot_body=("a", "b"), twin=tmp_path / "twin.xml")
    assert settings_from(request_json(asked)) == asked


def test_the_sensor_worlds_are_the_robots() -> None:
    assert noise_models().names == ("none", "lab", "datasheet", "hardware", "measured")


@pytest.mark.parametrize(
    "within", ["mass=2g", "mass = 2 g", ["mass=2g"], {"mass": "2g"}, {"mass": 0.002}]
)
def test_widths_may_be_texts_or_a_mapping(within: Any) -> None:
    assert dict(Settings(within=within).within) == {"mass": 0.002}


def test_half_widths_are_read_per_parameter_and_from_one_text() -> None:
    text = Settings(within="mug.mass=2g, com=1mm")  # type: ignore[arg-type]
    mapping = Settings(within={Parameter("mug.mass"): "2g", "com": "1mm"})  # type: ignore[arg-type]
    assert text.within == mapping.within


@pytest.mark.parametrize("within", ["mass", 0.002, ["mass"], "=2g", "mass=", ("mass=2g", "com")])
def test_widths_of_another_form_are_shown_the_form(within: Any) -> None:
    with pytest.raises(InputError, match=r"within=.*: give QUANTITY=VALUE, such as mass=1g"):
        Settings(within=within)
