"""Scenes over MuJoCo's whole schema: read without a crash, filled without a loss. A few of them; the
campaign takes thousands (docs/scenes.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from random import Random

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.schema import judging
from bench.schema.growing import Grower, kinds, types
from bench.schema.judging import judge
from bench.schema.leaving import opened, written


@pytest.mark.filterwarnings("ignore")
@settings(max_examples=15, derandomize=True, deadline=None, database=None)
@given(st.integers(0, 1_000_000))
def test_open_values_are_missing_and_written_values_are_read_back(seed: int) -> None:
    assert judge(Random(seed)).wrong == []


def test_the_schema_is_mujocos() -> None:
    assert {"(world)body", "geom", "inertial"} <= {kind.tag for kind in kinds()}
    assert next(k for k in kinds() if k.path == ("mujoco", "option")).often == "*"
    assert types()["geom", "type"].startswith("[plane, hfield, sphere")


@pytest.mark.filterwarnings("ignore")
def test_generated_scenes_use_many_elements_and_compile() -> None:
    grower = Grower(Random(4))
    grower.grow(60)
    assert len({tag for tag, _ in grower.used}) > 8
    text = written(grower.root, Random(4))
    assert mujoco.MjModel.from_xml_string(text).nbody > 1
    left, names = opened(grower.root, Random(0))
    assert names
    assert "?" in written(left, Random(0))


def _without_comment(text: str) -> str:
    return text.replace("<!-- x -->", "")


def _lighter(text: str) -> str:
    return text.replace('mass="', 'mass="0.1')


def _painted(text: str) -> str:
    return text.replace("<geom ", '<geom rgba="1 0 0 1" ', 1)


SCENE = """<mujoco><!-- x --><worldbody><geom name="table" type="box" size=".3 .3 .1"/>
  <body name="cup" pos="0 0 .13"><freejoint/><geom size=".03" mass="?" friction="1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("spoil", [_without_comment, _lighter, _painted])
def test_the_judge_sees_what_is_wrong(
    spoil: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judging, "written", lambda root, random: SCENE)
    monkeypatch.setattr(judging, "opened", lambda root, random: (root, {"cup.mass"}))
    monkeypatch.setattr(judging, "Grower", _Nothing)
    assert judge(Random(0)).wrong == []
    complete = judging.complete

    def spoiled(*arguments: object) -> object:
        made = complete(*arguments)
        texts = replace(made.texts, main=spoil(made.texts.main))
        return replace(made, texts=texts)

    monkeypatch.setattr(judging, "complete", spoiled)
    assert judge(Random(0)).wrong != []


class _Nothing:
    def __init__(self, random: Random) -> None:
        self.root, self.used = None, set[tuple[str, str]]()

    def grow(self, steps: int) -> None:
        pass
