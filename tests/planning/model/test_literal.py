"""All that a plan needs stands in the prompt: a reader that has nothing else plans every bundled scenario, over
HTTP, with the full and the lean prompt and under a critic, and passes the check at once."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal import Reader, Unread
from loopback import Loopback, Reply, Request, Says
from PIL import Image

from palpate.planning.model import session as session_module
from palpate.planning.model.prompt import STYLES, compose
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.primitives.registry import vocabulary
from palpate.runs import pipeline
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario, scenarios

pytest.importorskip("pydantic_ai")

TURNED = """<mujoco><worldbody>
  <site name="robot_base" euler="0 0 30"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".6 .6 .02"/></body>
  <body name="bar" pos="0.45 0.1 0.02" euler="0 0 40"><freejoint/><geom type="box" size=".08 .015 .02"/></body>
  <body name="cup" pos="0.4 -0.2 0.05"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
  <body name="slab" pos="0.55 -0.05 0.02"><freejoint/><geom type="box" size=".1 .02 .02"/></body>
</worldbody></mujoco>"""


def scenes() -> dict[str, Scene]:
    values = {"turned": parse_scene(TURNED)}
    for name in ("fifteen_objects", "hammer", "occlusion", "clutter", "thermometer"):
        settings = scenario(name).settings()
        assert settings.scene is not None
        values[name] = load_scene(settings.scene, settings.poses)
    return values


@pytest.mark.parametrize("name", scenes())
def test_positions_follow_from_the_text_of_the_prompt_to_the_millimetre(name: str) -> None:
    scene = scenes()[name]
    prompt = compose(vocabulary(), "x", scene)
    reader, symbols = Reader.of(prompt.system, prompt.user), scene.symbols
    assert reader.poses == symbols.usable - set(symbols.configurations)
    for pose, (position, yaw) in reader.places.items():
        expected = symbols.poses[pose]
        np.testing.assert_allclose(position, expected.position, atol=6e-4)
        turn = np.degrees(np.arctan2(expected.rotation[1, 0], expected.rotation[0, 0]))
        assert abs((yaw - turn + 180) % 360 - 180) < 0.6
        subject = symbols.subjects.get(pose, pose)
        for offset, vector in reader.offsets[subject if subject in scene.objects else pose].items():
            there = symbols.resolve(f"{pose} + {offset}").position
            np.testing.assert_allclose(position + vector, there, atol=1.2e-3)


def test_a_pose_that_cannot_be_is_not_listed() -> None:
    scene = parse_scene(TURNED)
    prompt = compose(vocabulary(), "x", scene)
    reader = Reader.of(prompt.system, prompt.user)
    assert "slab_across" in scene.symbols.names
    assert "cup_across" in reader.poses
    with pytest.raises(Unread):
        reader.pose("slab_across")


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("i") / "workspace.png"
    Image.new("RGB", (64, 48), (90, 120, 60)).save(path)
    return path


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", scenarios())
def test_a_literal_reader_plans_every_scenario_at_once(
    name: str, style: str, picture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-0123456789")
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))
    task, answers = scenario(name), list[str]()
    tool = "thermometer" if name == "thermometer" else ""
    seen: list[dict[str, Any]] = []
    if name == "from_picture":
        recorded = re.search(r"\{.*\}", task.plans["answer"].read_text(encoding="utf-8"), re.DOTALL)
        assert recorded is not None
        seen = json.loads(recorded[0])["scene"]
    blocking = "" if tool else next(iter(task.may_touch), "")

    def script(request: Request) -> Reply:
        if request.system.startswith("# Role\n\nYou read what another planner wrote"):
            return Says('{"objection": null}')
        if not answers:  # it stays with what it said
            reader = Reader.of(request.system, request.user)
            if seen:
                reader = Reader.without_scene(request.system, request.user, seen)
            text = f"The {tool} is read by a person." if tool else "As the prompt says."
            parameters = [str(parameter) for parameter in task.expects]
            answer = reader.answer(parameters, text, blocking, tool)
            answers.append(json.dumps({**answer, "scene": seen} if seen else answer))
        return Says(answers[0])

    with Loopback(answer=script) as server:
        model = ModelSettings(
            base_url=server.url("openai"),
            budget=Budget(seconds=60),
            prompt=style,
            critic="openai:gpt-c",
        )
        settings = task.settings(
            planner="openai:gpt-x", images=(picture,), model_settings=model, rehearse=False
        )
        run = pipeline.plan(settings, pipeline.load(settings))
    rejected = not task.expects and not tool
    assert run.conversation is not None
    assert run.conversation.rounds[0].findings == () or rejected
    assert run.findings == ()
    assert set(run.plan.parameters) == set(task.expects)
    assert (run.plan.tree is None) == rejected
    assert run.conversation.critique is not None or rejected
