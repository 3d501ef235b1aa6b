"""What a job refuses before anything is done."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from palpate.errors import InputError
from palpate.robots.simulated import noise as sensors
from palpate.settings import MAX_REQUEST, Job, Noise

D = Path("scene.xml")


@pytest.mark.parametrize(
    "job",
    [
        Job(request="the mass of the bottle"),
        Job(scene=D),
        Job(request="mass", scene=D),
        Job(planner="replay:plan.json"),
        Job(request="x" * MAX_REQUEST, scene=D),
        Job(scene=D, world=D),
        Job(scene=D, robot="franka://10.0.0.1"),
        *(Job(scene=D, noise=noise) for noise in get_args(Noise)),
    ],
)
def test_what_makes_sense_passes_unchanged(job: Job) -> None:
    assert job.checked() == job


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": None}, "nothing to do: give a request"),
        ({"request": " \n"}, "the request is empty"),
        ({"request": "x" * (MAX_REQUEST + 1)}, f"has {MAX_REQUEST + 1} characters"),
        ({"noise": "loud"}, "unknown noise 'loud'; valid: datasheet, lab, none"),
        ({"on_failure": "panic"}, "unknown policy for failures 'panic'; valid: replan, skip, stop"),
        ({"world": D, "robot": "franka://host"}, "--world and --robot exclude each other"),
        ({"seed": -1}, "--seed must not be negative"),
    ],
)
def test_what_does_not_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(Job(scene=D), **changes).checked()


def test_an_existing_folder_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="exists already: choose another --out"):
        Job(scene=D, out=tmp_path).checked()
    assert Job(scene=D, out=tmp_path / "new").checked().out == tmp_path / "new"


def test_the_sensor_worlds_are_the_robots() -> None:
    assert get_args(Noise) == get_args(sensors.Noise)
