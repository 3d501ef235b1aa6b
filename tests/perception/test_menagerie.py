"""An arm wears the meshes of a menagerie that is on this computer: in pictures alone, and only those that
are its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import mujoco
import pytest

from palpate.perception import dress as menagerie
from palpate.perception.stage import build_stage

CUBE = """v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
PANDA = """<mujoco model="panda"><compiler meshdir="assets"/>
  <default><default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default></default>
  <asset><material name="white" rgba="1 1 1 1"/><mesh file="link.obj"/></asset>
  <worldbody><body name="link0">
    <geom class="visual" mesh="link" material="white"/><geom type="mesh" mesh="link" group="3"/>
    <body name="link1" pos="0 0 0.333"><joint axis="0 0 1"/><geom class="visual" mesh="link" pos="0 0 0.01"/></body>
  </body></worldbody></mujoco>"""
CELL = """<mujoco><worldbody><light pos="0 0 2"/><site name="mark"/>
  <body name="robot/fr3_link0" pos="0.1 0 0"><geom name="foot" size=".05"/>
    <body name="robot/fr3_link1" pos="0 0 {height}">
      <joint axis="0 0 1"/><geom name="arm" type="capsule" size=".05 .1" mass="2"/></body></body>
</worldbody></mujoco>"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The package, with a model in its folder."""
    assets = tmp_path / "franka_emika_panda" / "assets"
    assets.mkdir(parents=True)
    (assets / "link.obj").write_text(CUBE)
    (assets.parent / "panda.xml").write_text(PANDA)

    class Cache:
        root = tmp_path

        def is_cached(self, robot: object) -> bool:
            return False

    package = ModuleType("mujoco_menagerie")
    package.Cache, package.get = Cache, str  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", package)
    menagerie._source.cache_clear()
    yield tmp_path
    menagerie._source.cache_clear()


def cell(height: float = 0.333) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(CELL.format(height=height))


def meshes(model: mujoco.MjModel) -> list[str]:
    """The bodies that are drawn as meshes."""
    drawn = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    return [model.body(int(body)).name for body in model.geom_bodyid[drawn]]


@pytest.mark.usefixtures("installed")
def test_an_arm_is_drawn_with_its_meshes_and_moves_as_before() -> None:
    spec = cell()
    before = spec.compile()
    drawn = build_stage(spec)
    assert meshes(drawn) == ["robot/fr3_link0", "robot/fr3_link1"]
    assert [drawn.geom(name).group[0] for name in ("foot", "arm")] == [menagerie.HIDDEN] * 2
    assert drawn.body("robot/fr3_link1").mass == before.body("robot/fr3_link1").mass
    assert meshes(spec.compile()) == []
    assert not drawn.geom_contype[drawn.geom_type == mujoco.mjtGeom.mjGEOM_MESH].any()


@pytest.mark.usefixtures("installed")
def test_an_arm_of_other_frames_keeps_its_own_shapes() -> None:
    assert meshes(build_stage(cell(height=0.34))) == ["robot/fr3_link0"]


def test_an_arm_keeps_its_own_shapes_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    menagerie._source.cache_clear()
    assert meshes(build_stage(cell())) == []
    menagerie._source.cache_clear()


@pytest.mark.usefixtures("installed")
def test_a_model_that_cannot_be_read_costs_the_shape_alone(
    installed: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (installed / "franka_emika_panda" / "panda.xml").write_text("<mujoco>")
    assert meshes(build_stage(cell())) == []
    assert "drawn without meshes" in caplog.text


def test_a_mark_is_not_drawn() -> None:
    assert set(build_stage(cell()).site_group.tolist()) == {5}
