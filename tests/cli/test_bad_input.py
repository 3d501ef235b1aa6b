"""Bad input: one clear message, the documented exit status, and no folder left behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from .conftest import TABLE, Answer, cube

Palpate = Callable[..., Answer]
SceneMaker = Callable[..., Path]


def refused(answer: Answer, status: int, *words: str) -> None:
    assert answer.status == status, answer.err
    lines = [line for line in answer.err.splitlines() if line.startswith("palpate: ")]
    assert len(lines) == 1, answer.err
    for word in words:
        assert word in lines[0]
    assert "Traceback" not in answer.err


def nothing_written(folder: Path) -> bool:
    return (
        not (folder / "out").exists()
        and not list(folder.glob(".out*"))
        and not (folder / "runs").exists()
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><worldbody>", ["scene.xml"]),
        ("not xml at all", ["scene.xml"]),
        (
            '<!DOCTYPE m [<!ENTITY a SYSTEM "file:///etc/passwd">]><mujoco>&a;</mujoco>',
            ["scene.xml"],
        ),
        (
            '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><mujoco model="&b;"/>',
            ["scene.xml"],
        ),
        (
            TABLE.format(
                bodies='<body name="cup" pos="0.5 0 0.1"><freejoint/><geom type="mesh" mesh="cup"/></body>'
            ).replace("<worldbody>", '<asset><mesh name="cup" file="cup.obj"/></asset><worldbody>'),
            ["cup.obj"],
        ),
        (
            TABLE.format(
                bodies='<body name="cup" pos="0.5 0 0.1"><freejoint/><geom type="mesh" mesh="cup"/></body>'
            ).replace(
                "<worldbody>",
                '<asset><mesh name="cup" file="../../secret.obj"/></asset><worldbody>',
            ),
            ["../../secret.obj"],
        ),
        ("<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>", ["scene.xml"]),
    ],
    ids=[
        "malformed",
        "no xml",
        "external entity",
        "entity bomb",
        "missing mesh",
        "escaping mesh",
        "deep",
    ],
)
def test_an_invalid_scene_gets_one_clear_error(
    palpate: Palpate, tmp_path: Path, text: str, words: list[str]
) -> None:
    (tmp_path / "scene.xml").write_text(text, encoding="utf-8")
    refused(palpate("run", "--scene", "scene.xml", "--out", "out"), 2, *words)
    assert nothing_written(tmp_path)


def test_an_absent_scene_file_gets_one_clear_error(palpate: Palpate) -> None:
    refused(palpate("gap", "nowhere.xml"), 2, "nowhere.xml")


def test_a_call_without_request_and_scene_is_refused(palpate: Palpate, tmp_path: Path) -> None:
    refused(palpate("run", "--out", "out"), 2, "--scene", "-r")
    assert nothing_written(tmp_path)


@pytest.mark.parametrize(
    "request_", ["", "   ", "mass " * 20_000], ids=["empty", "blank", "100 kB"]
)
def test_an_invalid_request_gets_one_clear_error(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path, request_: str
) -> None:
    refused(palpate("run", "-r", request_, "--scene", scene(cube()), "--out", "out"), 2, "request")
    assert nothing_written(tmp_path)


@pytest.mark.parametrize(
    ("width", "words"),
    [
        ("mass", ["--within", "QUANTITY=VALUE"]),
        ("weight=1g", ["weight", "mass", "friction"]),
        ("mass=1mm", ["mm", "kg", "mg"]),
        ("mass=-1g", ["positive"]),
        ("teapot.mass=1g", ["teapot", "mug"]),
    ],
)
def test_an_invalid_half_width_is_refused_with_the_valid_forms(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path, width: str, words: list[str]
) -> None:
    answer = palpate("run", "--scene", scene(cube("mug")), "--within", width, "--out", "out")
    refused(answer, 2, *words)
    assert nothing_written(tmp_path)


def test_an_unknown_object_lists_the_objects_of_the_scene(
    palpate: Palpate, scene: SceneMaker
) -> None:
    answer = palpate(
        "run", "-r", "the mass of the teapot", "--scene", scene(cube("mug"), cube("brick", y=0.2))
    )
    refused(answer, 2, "teapot", "mug", "brick")


def test_unmeasurable_quantity_is_explained(palpate: Palpate, scene: SceneMaker) -> None:
    answer = palpate(
        "run",
        "-r",
        "the temperature of the mug",
        "--scene",
        scene(cube("mug")),
        "--out",
        "out",
        "--json",
    )
    result = json.loads(answer.out)
    assert answer.status == 3
    assert result["status"] == "rejected"
    assert "temperature" in result["plan"]["explanation"]
    assert result["execution"] is None


def test_ambiguous_object_names_both(palpate: Palpate, scene: SceneMaker) -> None:
    file = scene(cube("red_bottle"), cube("blue_bottle", y=0.2))
    answer = palpate("plan", "-r", "the mass of the bottle", "--scene", file, "--json")
    assert answer.status == 3
    explanation = json.loads(answer.out)["explanation"]
    assert "red_bottle" in explanation
    assert "blue_bottle" in explanation


@pytest.mark.parametrize(
    "text",
    [
        "this is not JSON",
        '{"parameters": [], "explanation": "", "tree": {"type": "Fly"}}',
        "[" * 10_000 + "]" * 10_000,
        '{"tree": ' + '{"type": "Sequence", "children": [' * 10_000 + "]}" * 10_000 + "}",
        '{"parameters": [], "explanation": "x", "tree": {"type": "MoveJoints", "joints": [NaN, 0, 0, 0, 0, 0, 0]}}',
    ],
    ids=["no JSON", "unknown primitive", "deep list", "deep tree", "NaN"],
)
def test_an_invalid_plan_file_gets_one_clear_error(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path, text: str
) -> None:
    (tmp_path / "plan.json").write_text(text, encoding="utf-8")
    answer = palpate("execute", "plan.json", "--scene", scene(cube()), "--out", "out")
    assert answer.status in (2, 3)
    assert "Traceback" not in answer.err
    assert not (tmp_path / "out" / "trace.mcap").exists()


def test_an_object_out_of_reach_is_refused(palpate: Palpate, scene: SceneMaker) -> None:
    answer = palpate("plan", "--scene", scene(cube("far", x=0.93)), "--json")
    assert answer.status == 3
    assert "far" in answer.out
    assert "reach" in answer.out


def test_an_object_too_wide_for_the_hand_is_refused(palpate: Palpate, scene: SceneMaker) -> None:
    answer = palpate("plan", "--scene", scene(cube("wide", half=0.06)), "--json")
    assert answer.status == 3
    assert "wide" in answer.out


def test_an_object_heavier_than_the_payload_is_refused(palpate: Palpate, scene: SceneMaker) -> None:
    heavy = cube("anvil", mass='mass="7"').replace('friction="0.6 0.005 0.0001"', "")
    answer = palpate("plan", "--scene", scene(heavy), "--json")
    assert answer.status == 3
    assert "anvil" in answer.out


def test_a_world_that_does_not_match_the_scene_is_refused(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path
) -> None:
    world = scene(cube("other", mass='mass="0.2"'), name="world.xml")
    refused(
        palpate("run", "--scene", scene(cube("cube")), "--world", world, "--out", "out"),
        2,
        "cube",
        "other",
    )
    assert nothing_written(tmp_path)


def test_an_unreadable_image_gets_one_clear_error(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path
) -> None:
    (tmp_path / "picture.png").write_bytes(b"\x89PNG but not really")
    refused(
        palpate("run", "--scene", scene(cube()), "--image", "picture.png", "--out", "out"),
        2,
        "picture.png",
    )
    assert nothing_written(tmp_path)


def test_image_is_read(palpate: Palpate, scene: SceneMaker, tmp_path: Path) -> None:
    Image.new("RGB", (64, 48), "white").save(tmp_path / "picture.png")
    assert palpate("plan", "--scene", scene(cube()), "--image", "picture.png", "--json").status == 0


def test_existing_folder_is_left_alone(palpate: Palpate, scene: SceneMaker, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious.txt").write_text("mine", encoding="utf-8")
    refused(palpate("run", "--scene", scene(cube()), "--out", "out"), 2, "out")
    assert (tmp_path / "out" / "precious.txt").read_text(encoding="utf-8") == "mine"
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["precious.txt"]


def test_unknown_planner_and_scenario_list_the_choices(palpate: Palpate, scene: SceneMaker) -> None:
    refused(
        palpate("plan", "--scene", scene(cube()), "--planner", "wizard"),
        2,
        "wizard",
        "symbolic",
        "exhaustive",
    )
    refused(palpate("demo", "atlantis"), 2, "atlantis", "bottle_and_table")


@pytest.mark.parametrize("command", ["gap", "plan", "run"])
def test_an_unknown_arm_lists_the_valid_names(
    palpate: Palpate, scene: SceneMaker, command: str
) -> None:
    file = ["--scene", scene(cube())] if command != "gap" else [scene(cube())]
    refused(palpate(command, *file, "--arm", "hexapod"), 2, "hexapod", "fr3", "iiwa14")


def test_errors_are_json_when_asked(palpate: Palpate) -> None:
    answer = palpate("gap", "nowhere.xml", "--json")
    assert answer.status == 2
    assert json.loads(answer.out)["error"]["exit_status"] == 2


def test_wrong_option_is_a_usage_error(palpate: Palpate) -> None:
    answer = palpate("gap", "--sideways")
    assert answer.status == 2
    assert "--sideways" in answer.err


def test_a_known_value_is_not_measured_and_the_exit_status_is_0(
    palpate: Palpate, scene: SceneMaker
) -> None:
    file = scene(cube("mug", mass='mass="0.3"'))
    answer = palpate("run", "-r", "the mass of the mug", "--scene", file, "--out", "out", "--json")
    result = json.loads(answer.out)
    assert answer.status == 0
    assert result["status"] == "complete"
    assert result["parameters"] == []
    assert result["execution"] is None
    assert "0.3 kg" in result["plan"]["notes"][0]


def test_remeasure_measures_what_is_known(palpate: Palpate, scene: SceneMaker) -> None:
    file = scene(cube("mug", mass='mass="0.3"'))
    answer = palpate("plan", "-r", "the mass of the mug", "--scene", file, "--remeasure", "--json")
    assert answer.status == 0
    assert json.loads(answer.out)["parameters"] == [{"object": "mug", "quantity": "mass"}]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("torque: {whit: 1}", ["loud.yaml", "torque.whit", "white"]),
        ("torque: {white: [1, 2]}", ["loud.yaml", "7 numbers"]),
        ("extends: laboratory", ["laboratory", "hardware", "lab"]),
        (None, ["loud.yaml"]),
    ],
)
def test_an_invalid_noise_model_gets_one_clear_error(
    palpate: Palpate, scene: SceneMaker, tmp_path: Path, text: str | None, words: list[str]
) -> None:
    if text is not None:
        (tmp_path / "loud.yaml").write_text(text)
    noise = str(tmp_path / "loud.yaml")
    answer = palpate("run", "--scene", scene(cube()), "--noise", noise, "--out", "out")
    refused(answer, 2, *words)
    assert nothing_written(tmp_path)


def test_an_unknown_noise_level_lists_the_valid_ones(palpate: Palpate, scene: SceneMaker) -> None:
    answer = palpate("run", "--scene", scene(cube()), "--noise", "loud")
    refused(answer, 2, "unknown noise 'loud'", "datasheet, hardware, lab, measured, none")
