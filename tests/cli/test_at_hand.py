"""What makes the command line pleasant: slips are understood, errors are objects where those are wanted,
shells complete names, and no environment breaks it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import Answer, cube

Palpate = Callable[..., Answer]


def test_a_scene_needs_no_flag(palpate: Palpate, scene: Callable[..., Path]) -> None:
    file = scene(cube())
    with_flag = palpate("plan", "--scene", file, "--json")
    without = palpate("plan", file, "--json")
    assert without == with_flag
    assert without.status == 0
    both = palpate("plan", file, "--scene", file)
    assert (both.status, "give one" in both.err) == (2, True)


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        (("demoo",), "demo"),
        (("demo", "hamer"), "hammer"),
        (("demo", "--noise", "lap"), "lab"),
        (("gap", "scene.xml", "--pose", "poses.yaml"), "--poses"),
        (("plan", "scene.xml", "--arm", "fr4"), "fr3"),
    ],
)
def test_a_misspelt_name_gets_a_suggestion(
    palpate: Palpate, wrong: tuple[str, ...], meant: str
) -> None:
    answer = palpate(*wrong)
    assert answer.status == 2
    assert answer.out == ""
    text = answer.err.lower()
    assert "did you mean" in text or "possible options" in text
    assert meant in text


@pytest.mark.parametrize("wrong", [("--nose", "lab"), ("--seed", "x"), ("--noise", "lap")])
def test_every_error_is_an_object_where_one_is_wanted(
    palpate: Palpate, wrong: tuple[str, ...]
) -> None:
    answer = palpate("demo", *wrong, "--json")
    document = json.loads(answer.out)
    assert document["status"] == "failed"
    assert document["error"]["exit_status"] == answer.status == 2
    assert document["error"]["message"]
    assert palpate("demo", *wrong).out == ""


def test_a_shell_completes_commands_and_scenarios(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_PALPATE_COMPLETE", "complete_bash")
    for words, result in (("palpate de", "demo"), ("palpate demo one_", "one_missing_mass")):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
        assert result in palpate().out.split()


@pytest.mark.parametrize("value", ["nonsense", "osmesa"])
def test_no_opengl_is_no_traceback(tmp_path: Path, value: str) -> None:
    """Of nonsense MuJoCo cannot be imported; of osmesa only where its library is installed."""
    (tmp_path / "scene.xml").write_text(f"<mujoco><worldbody>{cube()}</worldbody></mujoco>")
    done = subprocess.run(
        [sys.executable, "-m", "palpate", "gap", "scene.xml", "--json"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": value},
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["bodies"]
    lines = done.stderr.splitlines()
    assert len(lines) <= 1
    if value == "nonsense":
        assert lines == [
            "palpate: no pictures: MuJoCo cannot use MUJOCO_GL=nonsense; unset it, or try egl or osmesa"
        ]
