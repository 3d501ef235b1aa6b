"""Commands on folders of finished runs, as a shell would use them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import palpate as pp
from palpate.parameter import Parameter

from .conftest import TABLE, Answer, cube

Palpate = Callable[..., Answer]
SCENE = TABLE.format(bodies=cube())
WORLD = TABLE.format(bodies=cube(mass='mass="0.3"'))


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run that weighed a cube of 0.3 kg."""
    folder = tmp_path_factory.mktemp("runs")
    scene = folder / "scene.xml"
    scene.write_text(SCENE)
    run = pp.run(scene, "how heavy is the cube?", world=WORLD, noise="none")
    assert run[Parameter("cube", "mass")].identified
    run.save(folder / "run")
    return folder / "run"


def test_estimates_are_made_anew(palpate: Palpate, stored: Path) -> None:
    answer = palpate("estimate", stored, "--json")
    assert answer.status == 0
    stored_result = json.loads((stored / "result.json").read_text())
    assert json.loads(answer.out)["parameters"] == stored_result["parameters"]
    validation = json.loads(answer.out)["validation"]["held_out"]
    assert validation == stored_result["validation"]["held_out"]
    assert validation["agrees"]
    assert "validation agrees the way down with the cube" in palpate("estimate", stored).out
    other = palpate("estimate", stored, "--estimator", "mass=single-shot", "--json")
    assert json.loads(other.out)["parameters"][0]["method"].startswith("Mean vertical force")


def test_an_estimator_that_nobody_knows_is_bad_input(palpate: Palpate, stored: Path) -> None:
    unknown = palpate("estimate", stored, "--estimator", "mass=guess")
    assert (unknown.status, unknown.out) == (2, "")
    assert "single-shot" in unknown.err
    assert palpate("estimate", stored, "--estimator", "guess").status == 2
    assert palpate("estimate", stored.parent).status == 2
