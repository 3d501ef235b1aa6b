"""Scenes as users really write them: odd names, other gravity, a turned base, leftovers of another
robot."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from long_cases import mark_long

from palpate.common.parameter import Parameter
from palpate.perception.renderer import gl_available
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.scene.load import load_scene
from palpate.studies.accuracy import run_seed

BASE = '<site name="robot_base"/>'
TABLE = '<body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .6 .02" friction="0.6 0.005 0.0001"/></body>'
FRICTION = 'friction="0.6 0.005 0.0001"'
MASS = Parameter("cup", "mass")
NASTY = '[/red] it\'s <b>"Ω"</b> & 水'


def cup(
    at: str = "0.5 0.1 0.05", geoms: str = f'<geom type="cylinder" size=".03 .05" {FRICTION}/>'
) -> str:
    return f'<body name="cup" pos="{at}"><freejoint/>{geoms}</body>'


def write(
    folder: Path, bodies: Sequence[str], base: str = BASE, before: str = "", after: str = ""
) -> Path:
    path = folder / "scene.xml"
    path.write_text(
        f"<mujoco>{before}<worldbody>{base}{''.join(bodies)}</worldbody>{after}</mujoco>",
        encoding="utf-8",
    )
    return path


CRATE = (
    f'<body name="crate" pos="0.5 0.1 0.03"><freejoint/>'
    f'<geom type="box" size=".05 .035 .03" mass="0.3" {FRICTION}/></body>'
)
ARM = """<body name="link0"><geom type="cylinder" size=".06 .05"/>
  <body name="link1" pos="0 0 .2"><joint name="j1" type="hinge" axis="0 0 1"/><geom type="capsule" size=".04 .1"/>
    <body name="link2" pos="0 0 .2"><joint name="j2" type="hinge" axis="0 1 0"/><geom type="capsule" size=".03 .1"/>
      <body name="finger" pos="0 0 .12"><joint name="j3" type="slide" axis="0 1 0"/>
        <geom type="box" size=".01 .01 .02"/></body></body></body></body>"""
ARMS_REST = """<actuator><position name="a1" joint="j1" kp="100"/><motor name="a2" joint="j2"/></actuator>
  <sensor><jointpos joint="j1"/></sensor><contact><exclude body1="link1" body2="link2"/></contact>
  <keyframe><key name="home" qpos="0 0 0 0.5 0.1 0.05 1 0 0 0"/></keyframe>"""
HANDLE = f'<geom type="box" size=".012 .005 .02" pos="0.04 0 0" {FRICTION}/>'

MEASURED = {
    "on the moon": {"bodies": (TABLE, cup()), "before": '<option gravity="0 0 -1.62"/>'},
    "the base turned by a right angle": {
        "bodies": (TABLE.replace("0.5 0 -0.02", "0 0.5 -0.02"), cup("0.1 0.5 0.05")),
        "base": '<site name="robot_base" quat="0.7071068 0 0 0.7071068"/>',
    },
    "with a keyframe": {
        "bodies": (TABLE, cup()),
        "after": '<keyframe><key name="k" qpos="0.5 0.1 0.05 1 0 0 0"/></keyframe>',
    },
    "where another arm stood": {"bodies": (ARM, TABLE, cup()), "base": "", "after": ARMS_REST},
    "on another object": {"bodies": (TABLE, CRATE, cup("0.5 0.1 0.11"))},
    "of two geoms": {
        "bodies": (
            TABLE,
            cup(geoms=cup().partition("<freejoint/>")[2].removesuffix("</body>") + HANDLE),
        )
    },
}


LONG = ("on the moon", "with a keyframe", "on another object", "of two geoms")


@pytest.mark.parametrize("name", mark_long(MEASURED, lambda name: name in LONG))
def test_every_odd_scene_is_measured(name: str, tmp_path: Path) -> None:
    scene = write(tmp_path, **MEASURED[name])
    run = run_seed(Settings(scene=scene, noise="none"), 1)
    assert run.status == "complete"
    (estimate,) = run.estimates
    assert estimate.parameter == MASS
    assert estimate.value == pytest.approx(estimate.truth, rel=0.02)


@pytest.mark.parametrize("at", [pytest.param("0.5 0.1 0.25", marks=pytest.mark.long), "0.5 0.1 ?"])
def test_a_table_of_unknown_height_and_what_stands_on_it(at: str, tmp_path: Path) -> None:
    table = '<body name="table" pos="0.5 0 ?"><geom type="box" size=".4 .6 .02"/></body>'
    scene = write(tmp_path, (table, cup(at)))
    run = run_seed(Settings(scene=scene, noise="none"), 1)
    assert run.status == "complete"
    height, mass = run.estimates
    assert height.parameter == Parameter("table", "height")
    assert height.value == pytest.approx(height.truth, abs=2e-4)
    assert mass.value == pytest.approx(mass.truth, rel=0.02)


@pytest.mark.parametrize("bodies", [(), (TABLE,)], ids=["empty", "only a table"])
def test_a_complete_scene_causes_no_motion(bodies: tuple[str, ...], tmp_path: Path) -> None:
    settings = Settings(scene=write(tmp_path, bodies))
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    assert run.execution is None
    assert run.plan.parameters == ()
    assert run.plan.explanation == "Nothing is missing."


def test_any_name_goes_through_to_every_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    name = NASTY.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    scene = write(tmp_path, (TABLE, cup().replace('name="cup"', f'name="{name}"')))
    out = tmp_path / "out"
    run = pipeline.run(Settings(scene=scene, noise="none", out=out, fast=True))
    assert run.status == "complete"
    (found,) = json.loads((out / "result.json").read_text(encoding="utf-8"))["parameters"]
    assert found["object"] == NASTY
    assert load_scene(out / "twin.xml").body(NASTY).known["mass"][0] == pytest.approx(
        found["value"], rel=0.01
    )
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;" in page
    assert not re.search(r"<b>\W*Ω", page)


def test_quantities_of_the_gripper_are_not_in_the_twin(tmp_path: Path) -> None:
    scene = write(tmp_path, (TABLE, cup()))
    out = tmp_path / "out"
    run = pipeline.run(
        Settings(
            request="the velocity of the gripper", scene=scene, noise="none", out=out, fast=True
        )
    )
    assert run.status == "complete"
    assert run.twin.notes[0].startswith("gripper.velocity is not in the twin")
    pictures = {path.name for path in (out / "images").iterdir()}
    if gl_available()[0]:
        assert {"before.png", "after.png"} <= pictures
    else:
        assert pictures == set()
