"""What is wider than asked is measured again, until it is narrow enough or at its floor."""

from __future__ import annotations

import json

import pytest
from performing import CELL, CUP

import palpate as pp

SCENE = CELL.format(cup=" ".join(map(str, CUP)), table=-0.03, mass="")
WORLD = CELL.format(cup=" ".join(map(str, CUP)), table=-0.03, mass='mass="0.3"')
REQUEST = "how heavy is the cup?"


def weighed(within, noise="lab", **more):
    return pp.run(SCENE, REQUEST, world=WORLD, noise=noise, within={"mass": within}, **more)


def rounds(run) -> int:
    return sum(c.quantity == "mass" for c in run.trace.conversions)


@pytest.fixture(scope="module")
def narrowed(tmp_path_factory):
    """Its signals are noisier than the arm's description says."""
    folder = tmp_path_factory.mktemp("within")
    loud = folder / "loud.yaml"
    loud.write_text("palpate_noise: 1\nname: loud\nextends: lab\ntorque: {white: 0.3}\n")
    return weighed("4g", noise=str(loud), out=folder / "run")


def test_a_mass_is_weighed_until_it_is_as_narrow_as_asked(narrowed) -> None:
    assert rounds(narrowed) > 1
    assert narrowed.status == "complete"
    low, high = narrowed["cup.mass"].ci95[0]
    assert (high - low) / 2 <= 0.004
    assert low < 0.3 < high
    assert "Within 4 g was asked: " in narrowed["cup.mass"].method
    assert narrowed.execution.setbacks == ()


def test_the_result_says_what_was_asked_and_what_came_of_it(narrowed) -> None:
    (row,) = json.loads((narrowed.folder / "result.json").read_text())["parameters"]
    assert row["within"]["asked"] == 0.004
    assert row["within"]["outcome"] == "reached"
    again = pp.open(narrowed.folder)
    assert again.status == "complete"
    assert again.settings.within == narrowed.settings.within


def test_at_the_floor_of_the_sensors_gains_nothing_is_repeated_in_vain(tmp_path) -> None:
    unsure = tmp_path / "unsure.yaml"
    unsure.write_text(
        "palpate_noise: 1\nname: unsure\nextends: lab\ndatasheet: {torque_gain_max: 0.05}\n"
    )
    run = weighed("1g", noise=str(unsure))
    assert rounds(run) == 1
    assert run.status == "complete"
    assert "at the floor of" in run["cup.mass"].method
    assert "calibrate the arm" in run["cup.mass"].method


def test_without_a_width_nothing_is_repeated() -> None:
    run = pp.run(SCENE, REQUEST, world=WORLD)
    assert rounds(run) == 1
    assert "Within" not in run["cup.mass"].method
