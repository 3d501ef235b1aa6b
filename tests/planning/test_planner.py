"""Words of the command line to planners, palpate's own and those of other packages."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from workbench import BOTTLE, bench

from palpate.common.errors import InputError
from palpate.planning.model.provider import PROVIDERS
from palpate.planning.planner import PlannerKind, PlannerSettings
from palpate.planning.registry import Planners, ReplayPlanner, planners
from palpate.planning.symbolic.planner import SymbolicPlanner

OWN = '''
"""A planner in one file: it weighs what it is asked about, and says so in its own words."""

from palpate.planning.planner import PlannerKind
from palpate.planning.plan import Plan
from palpate.planning.registry import ReplayPlanner
from palpate.planning.symbolic.planner import SymbolicPlanner


class Cautious:
    name = "cautious"

    def plan(self, request, scene, images=()):
        plan = SymbolicPlanner().plan(request, scene)
        return Plan(plan.parameters, plan.tree, f"Slowly: {plan.explanation}", self.name)


class _Hidden:
    name = "hidden"

    def plan(self, request, scene, images=()):
        raise AssertionError("not public")


class Symbolic(Cautious):
    name = "symbolic"


filed = PlannerKind("filed", lambda argument, settings: ReplayPlanner(argument), "FILE")
'''
METADATA = "Metadata-Version: 2.1\nName: palpate-cautious\nVersion: 1.0\n"


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Path]]:
    """Install a package of one file and one entry point; it is gone after the test."""

    def installed(source: str) -> Path:
        info = tmp_path / "palpate_cautious-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(METADATA)
        (info / "entry_points.txt").write_text("[palpate.planners]\nmine = palpate_cautious\n")
        (tmp_path / "palpate_cautious.py").write_text(source)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "palpate_cautious", raising=False)
        planners.cache_clear()
        return tmp_path

    yield installed
    planners.cache_clear()


@pytest.mark.parametrize(
    "spec", ["symbolic", "exhaustive", "replay:some/plan.json", "openai:gpt-4o", "openai"]
)
def test_a_planner_has_the_name_that_it_was_asked_by(spec: str):
    assert planners().make(spec).name == spec


@pytest.mark.parametrize(
    "spec", ["", "magic", "replay:", "replay", "nobody:model", "symbolic:", "symbolic:x"]
)
def test_unknown_planners_are_refused_with_the_known_ones(spec: str):
    with pytest.raises(InputError) as refusal:
        planners().make(spec)
    assert all(
        name in str(refusal.value) for name in ("symbolic", "exhaustive", "replay:FILE", *PROVIDERS)
    )


def test_a_planner_receives_the_settings():
    settings = PlannerSettings(remeasure=True)
    assert planners().make("symbolic", settings) == SymbolicPlanner(remeasure=True)
    replay = planners().make("replay:plan.json", settings)
    assert isinstance(replay, ReplayPlanner)
    assert replay.remeasure


def test_a_registry_is_a_value():
    alone = Planners({"only": PlannerKind("only", lambda argument, settings: SymbolicPlanner())})
    assert alone.make("only") == SymbolicPlanner()
    with pytest.raises(InputError, match="valid: only"):
        alone.make("symbolic")


def test_an_own_planner_is_found_by_its_name(install: Callable[[str], Path]):
    install(OWN)
    plan = planners().make("cautious").plan("weigh the bottle", bench(BOTTLE))
    assert plan.planner == "cautious"
    assert plan.explanation.startswith("Slowly: ")
    assert planners().make("filed:plan.json").name == "replay:plan.json"


def test_palpates_own_names_and_private_classes_are_not_registered(install: Callable[[str], Path]):
    install(OWN)
    assert isinstance(planners().make("symbolic"), SymbolicPlanner)
    with pytest.raises(InputError, match="cautious, compatible:MODEL, exhaustive, filed:FILE"):
        planners().make("hidden")


def test_planners_that_cannot_be_loaded_are_named(install: Callable[[str], Path]):
    install("import nothing_of_this_name")
    with pytest.raises(
        InputError, match=r"the planners 'mine' \(palpate_cautious\) cannot be loaded"
    ):
        planners()


def test_an_own_planner_is_used_on_the_command_line(install: Callable[[str], Path], tmp_path: Path):
    site = install(OWN)
    (tmp_path / "scene.xml").write_text(bench(BOTTLE).text)
    path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    asked = ["plan", "-r", "weigh the bottle", "--scene", "scene.xml", "--planner", "cautious"]
    done = subprocess.run(
        [sys.executable, "-m", "palpate.cli.main", *asked, "--json"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    plan = json.loads(done.stdout)
    assert (plan["planner"], plan["explanation"][:7]) == ("cautious", "Slowly:")
