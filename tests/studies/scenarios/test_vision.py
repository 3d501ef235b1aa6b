"""Scenarios whose scene does not say what the picture says: with the picture they are answered rightly,
without it they cannot be.

The server is a script that stands in for a model: it knows what is to be seen in each scenario's
picture, says so when it is sent one, and asks back when it is not. It shows that the picture alone
carries what is missing, not that a model can read it."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from pathlib import Path

import pytest
from long_cases import mark_long
from loopback import Loopback, Reply, Request, Says
from PIL import Image

from palpate.common.errors import InputError
from palpate.execution import simulated_cell as simulated
from palpate.perception.renderer import gl_available
from palpate.planning.model import session as session_module
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import Scenario, scenario, scenarios

pytest.importorskip("pydantic_ai")

usable, reason = gl_available()
needs_gl = pytest.mark.skipif(not usable, reason=reason)
SEEN = [name for name in scenarios() if name.startswith("vision/")]
ASKS_BACK = {
    "parameters": [],
    "outcome": "ambiguous",
    "explanation": "There is no picture, and nothing in the scene tells one from the other.",
    "tree": None,
}


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-0123456789")
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


def asked(task: Scenario, picture: Path, without: frozenset[str] = frozenset()) -> Run:
    """The plan of the script, over HTTP, for what it was sent."""

    def script(request: Request) -> Reply:
        if not request.images:
            return Says(json.dumps(ASKS_BACK))
        return Says(task.plans["model"].read_text(encoding="utf-8"))

    with Loopback(answer=script) as server:
        model = ModelSettings(
            base_url=server.url("openai"), budget=Budget(seconds=20), without=without
        )
        settings = task.settings(planner="openai:gpt-x", images=(picture,), model_settings=model)
        return pipeline.plan(settings, pipeline.load(settings))


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "workspace.png"
    Image.new("RGB", (64, 48), (90, 120, 60)).save(path)
    return path


@pytest.mark.parametrize("name", mark_long(SEEN, lambda name: name != "vision/unlisted_neighbour"))
def test_with_the_picture_the_plan_passes_the_check_and_measures_what_is_meant(
    name: str, picture: Path
) -> None:
    task = scenario(name)
    run = asked(task, picture)
    assert run.findings == ()
    assert run.plan.parameters == task.expects
    assert (run.plan.tree is None) == (task.status == "rejected")


@pytest.mark.parametrize("name", [name for name in SEEN if scenario(name).expects])
def test_a_request_without_the_picture_measures_nothing(name: str, picture: Path) -> None:
    run = asked(scenario(name), picture, frozenset({"image"}))
    assert run.status == "rejected"
    assert run.plan.tree is None


@pytest.mark.parametrize("name", SEEN)
def test_the_scene_alone_does_not_resolve_the_request(name: str) -> None:
    """No colour, no material, no look; and no word of the answer but the request's own."""
    task = scenario(name)
    assert task.only_seen
    text = (task.folder / "scene.xml").read_text(encoding="utf-8")
    assert not re.search(r"rgba|material|texture|look:|<camera", text)
    message = set(re.findall(r"[a-z]{4,}", text.lower()))
    world = (task.folder / "world.xml").read_text(encoding="utf-8")
    words = {word.lower() for word in re.findall(r'data="\w+ (\w+)"', world)}
    assert not message & words


def test_the_neighbour_is_in_the_world_and_not_in_the_scene() -> None:
    folder = scenario("vision/unlisted_neighbour").folder
    assert 'name="tin"' in (folder / "world.xml").read_text(encoding="utf-8")
    assert "tin" not in (folder / "scene.xml").read_text(encoding="utf-8").replace("stin", "")


@pytest.mark.parametrize("name", [name for name in SEEN if scenario(name).expects])
def test_the_symbolic_planner_does_not_guess(name: str) -> None:
    settings = scenario(name).settings(planner="symbolic")
    plan = None
    with suppress(InputError):  # it knows of no salt
        plan = pipeline.plan(settings, pipeline.load(settings)).plan
    assert plan is None or plan.tree is None


@needs_gl
@pytest.mark.parametrize("broken", ["closer_png", "render_workspace"])
def test_a_picture_that_cannot_be_made_is_a_note_and_the_plan_goes_on(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> bytes:
        raise ValueError("size 0 must be positive in geom\nElement name ''")

    task, sent = scenario("vision/lower_one"), list[int]()

    def script(request: Request) -> Reply:
        sent.append(len(request.images))
        return Says(task.plans["model"].read_text(encoding="utf-8"))

    def planned() -> Run:
        with Loopback(answer=script) as server:
            model = ModelSettings(base_url=server.url("openai"), budget=Budget(seconds=20))
            settings = task.settings(planner="openai:gpt-x", model_settings=model, rehearse=False)
            return pipeline.plan(settings, pipeline.load(settings))

    assert not any("picture" in note for note in planned().plan.notes)
    monkeypatch.setattr(simulated, broken, fails)
    run = planned()
    assert sent == [2, 1]
    assert (run.findings, run.plan.parameters) == ((), task.expects)
    (note,) = (note for note in run.plan.notes if "picture" in note)
    assert "size 0 must be positive in geom Element" in note
