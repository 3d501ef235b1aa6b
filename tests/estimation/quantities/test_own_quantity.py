"""A quantity of one's own: one file and an entry point, and everything that deals with quantities
deals with it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from installed import install

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.planning.check.check import check
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.primitives.registry import vocabulary
from palpate.scene.load import parse_scene
from palpate.twin.inject import complete, unfilled_unknowns

PACKAGE = Path(__file__).with_name("rolling")
SCENE = """<mujoco model="desk"><worldbody>
  <site name="robot_base" pos="0 0 0.3"/>
  <geom name="table" type="box" pos="0.5 0 0.28" size="0.3 0.4 0.02"/>
  <body name="block" pos="0.5 0 0.33"><freejoint/>
    <geom type="box" size="0.03 0.03 0.03" mass="0.2" friction="0.4 0.005 ?"/></body>
</worldbody></mujoco>"""
ROLLING = Parameter("block", "rolling_friction")


def forget() -> None:
    """What was made of the installed packages is made anew."""
    catalogue.cache_clear()
    vocabulary.cache_clear()


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package with its entry point; it is gone after the test."""
    install(tmp_path, "palpate_rolling", {"palpate.quantities": "rolling = palpate_rolling"}, {})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(PACKAGE)
    monkeypatch.delitem(sys.modules, "palpate_rolling", raising=False)
    forget()
    yield
    forget()


@pytest.mark.usefixtures("installed")
def test_a_third_partys_quantity_is_missing_where_the_file_has_a_question_mark() -> None:
    scene = parse_scene(SCENE)
    assert scene.missing == (ROLLING,)
    assert scene.priors[ROLLING] == (1e-4,)
    assert unfilled_unknowns(SCENE) == [ROLLING]
    model = scene.spec({ROLLING: (7e-4,)}).compile()
    assert model.geom_friction[1].tolist() == pytest.approx([0.4, 0.005, 7e-4])
    stated = parse_scene(SCENE.replace("?", "0.0003"))
    assert stated.missing == ()
    assert stated.objects["block"].known["rolling_friction"] == pytest.approx((0.0003,))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("sentence", [None, "What is the rolling resistance of the block?"])
def test_a_third_partys_quantity_is_planned_from_its_evidence_alone(sentence: str | None) -> None:
    scene = parse_scene(SCENE)
    plan = SymbolicPlanner().plan(sentence, scene)
    assert plan.parameters == (ROLLING,)
    assert "MeasureForces while held still, and in a Parallel" in plan.explanation
    assert check(plan, scene) == ()


@pytest.mark.usefixtures("installed")
def test_a_third_partys_value_is_written_into_the_twin() -> None:
    scene = parse_scene(SCENE)
    made = complete(scene, [Estimate.normal(ROLLING, "m", 5e-4, 1e-5, "A stub.", ())])
    assert 'friction="0.4 0.005 0.000500" condim="6"' in made.texts.main
    assert 'name="palpate_block_rolling_friction"' in made.texts.main
    assert made.notes == ()
    assert parse_scene(made.texts.main).missing == ()


def test_a_third_partys_quantity_is_unknown_without_its_package() -> None:
    scene = parse_scene(SCENE)
    assert scene.missing == ()
    with pytest.raises(InputError, match="unknown quantity 'rolling_friction'"):
        catalogue().named("rolling_friction")
