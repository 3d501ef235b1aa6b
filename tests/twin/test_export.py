"""A twin in other formats: what is written is read with MuJoCo or USD, and says what the twin says."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError, PalpateError, Unavailable
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Samples, Trace
from palpate.twin import export_urdf as urdf
from palpate.twin.export import Export, export_twin, require_format
from palpate.twin.export_readers import read_spec
from palpate.twin.twin import Twin, build_twin

NOTHING = Trace(Samples.empty(), (), (), (), NominalHand(0.009, 0.15, 0.01, 1e-4))
KITCHEN = """<mujoco model="kitchen">
  <default><geom friction="0.7 0.005 0.0001"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <site name="robot_base"/>
    <camera name="above" pos="0.5 0 2"/>
    <body name="table" pos="0.5 0 0.2"><geom type="box" size=".3 .3 .02"/></body>
    <body name="mug" pos="0.5 0 0.27" euler="0 0 30"><freejoint/>
      <geom type="cylinder" size=".03 .05" mass="?" friction="? .005 .0001"/>
      <geom type="capsule" size=".01 .02" pos=".04 0 0" euler="0 20 10" mass=".01"
        friction="? .005 .0001"/>
      <geom type="ellipsoid" size=".01 .02 .03" pos="0 .04 0" euler="20 0 10" mass=".02"
        friction="? .005 .0001"/></body>
    <body name="door" pos="1 0 0.6" euler="0 0 15">
      <joint name="hinge" axis="0 0 1" pos="0 .2 0" range="0 90"/>
      <geom type="box" size=".01 .2 .3"/>
      <body name="latch" pos="0 -.2 0"><joint type="slide" axis="0 1 0" range="0 .02"/>
        <geom type="sphere" size=".02"/></body></body>
  </worldbody>
</mujoco>
"""
MASS, FRICTION = Parameter("mug", "mass"), Parameter("mug", "friction")
STIFFNESS = Parameter("table", "stiffness")


def estimate(parameter: Parameter, unit: str, *value: float) -> Estimate:
    interval = tuple((v - 2e-3, v + 2e-3) for v in value)
    return Estimate(parameter, unit, value, (1e-3,) * len(value), interval, "measured", ())


MEASURED = (
    estimate(MASS, "kg", 0.2541),
    estimate(FRICTION, "", 0.41),
    estimate(STIFFNESS, "N/m", 2100.0),
)


def build(scene: Scene) -> Twin:
    twin = build_twin(scene, MEASURED, NOTHING, lambda world: [])
    assert twin.unwritten == ()
    return twin


def export(twin: Twin, to: str, folder: Path) -> Export:
    made, scratch = folder / "made", folder / "scratch"
    made.mkdir()
    scratch.mkdir()
    found = export_twin(twin, MEASURED, require_format(to), made, scratch)
    shutil.rmtree(scratch)
    return found


@pytest.fixture(scope="module")
def kitchen() -> Twin:
    return build(parse_scene(KITCHEN))


def test_urdf_has_masses_shapes_and_joints(kitchen: Twin, tmp_path: Path) -> None:
    made = export(kitchen, "urdf", tmp_path)
    assert made.file.name == "scene.urdf"
    assert (made.held, made.lost) == ((MASS,), (FRICTION, STIFFNESS))
    placement = json.loads((made.file.parent / "placement.json").read_text())
    spec = read_spec(mujoco, str(made.file), placement)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12
    model = spec.compile()
    twin = kitchen.mjmodel
    for name in ("mug", "door", "latch", "table"):
        mine, its = twin.body(name), model.body(name)
        assert its.mass == pytest.approx(mine.mass, rel=1e-6)
        assert sorted(its.inertia) == pytest.approx(sorted(mine.inertia), rel=1e-5)
        apart = mujoco.MjData(twin), mujoco.MjData(model)
        for one, data in zip((twin, model), apart, strict=True):
            mujoco.mj_forward(one, data)
        assert apart[1].body(name).xipos == pytest.approx(apart[0].body(name).xipos, abs=1e-7)
    assert model.body("mug").mass == pytest.approx(0.2541, rel=1e-4)
    tree = ElementTree.parse(made.file)
    kinds = {joint.get("name"): joint.get("type") for joint in tree.iter("joint")}
    assert kinds["hinge"] == "revolute"
    assert "floating" not in kinds.values()
    assert set(placement) == {"mug"}
    assert "prismatic" in kinds.values()
    limit = next(j for j in tree.iter("joint") if j.get("name") == "hinge").find("limit")
    assert limit is not None
    assert float(limit.get("upper", "")) == pytest.approx(np.pi / 2)
    said = "\n".join(made.notes)
    assert "URDF has no friction" in said
    assert "the plane 'floor' is the top of a box" in said
    assert "ellipsoid" in said


def test_a_hinge_off_the_bodys_origin_turns_about_the_same_line(
    kitchen: Twin, tmp_path: Path
) -> None:
    made = export(kitchen, "urdf", tmp_path)
    places: list[np.ndarray] = []
    for model in (kitchen.mjmodel, mujoco.MjModel.from_xml_path(str(made.file))):
        data = mujoco.MjData(model)
        data.joint("hinge").qpos[0] = 0.8
        mujoco.mj_kinematics(model, data)
        ball = int(mujoco.mjtGeom.mjGEOM_SPHERE)
        (latch,) = [i for i in range(model.ngeom) if _is_latch(model, i, ball)]
        places.append(data.geom_xpos[latch].copy())
    assert places[0] == pytest.approx(places[1], abs=1e-6)


def _is_latch(model: mujoco.MjModel, geom: int, ball: int) -> bool:
    return model.geom_type[geom] == ball and model.geom_size[geom, 0] == pytest.approx(0.02)


def test_usd_has_masses_frictions_and_shapes(kitchen: Twin, tmp_path: Path) -> None:
    pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    from pxr import Usd, UsdPhysics

    made = export(kitchen, "usd", tmp_path)
    assert made.file.name == "scene.usdc"
    assert (made.held, made.lost) == ((MASS, FRICTION), (STIFFNESS,))
    stage = Usd.Stage.Open(str(made.file))
    mug = next(prim for prim in stage.Traverse() if prim.GetName() == "mug")
    assert UsdPhysics.MassAPI(mug).GetMassAttr().Get() == pytest.approx(0.2541, rel=1e-4)
    frictions = []
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.MaterialAPI):
            frictions.append(UsdPhysics.MaterialAPI(prim).GetDynamicFrictionAttr().Get())
    assert pytest.approx(0.41, rel=1e-3) in frictions
    said = "\n".join(made.notes)
    assert "1 cameras are left out" in said
    assert "ellipsoid" in said


def test_without_the_extra_usd_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco_usd_converter", None)
    with pytest.raises(Unavailable, match=r"pip install 'palpate\[export\]'"):
        require_format("usd")
    with pytest.raises(InputError, match="valid: mjcf, urdf, usd"):
        require_format("sdf")


def test_a_wrong_number_in_what_was_written_is_an_error(
    kitchen: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = urdf._number
    monkeypatch.setattr(urdf, "_number", lambda value: number(1.001 * value))
    with pytest.raises(PalpateError, match="not the same when it is read back"):
        export(kitchen, "urdf", tmp_path)


TRIANGLES = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 {height}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.fixture
def scattered(tmp_path: Path) -> Twin:
    """A scene whose files lie in many places: included, attached, in folders of the compiler's, two
    of one name."""
    at = tmp_path / "scattered"
    for name, height in (
        ("meshes/part.obj", 0.1),
        ("other/part.obj", 0.2),
        ("sub/m/lid.obj", 0.05),
    ):
        path = at / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TRIANGLES.format(height=height))
    (at / "objects.xml").write_text(
        """<mujocoinclude><!-- included --><body name="mug" pos="0.5 0 0.2"><freejoint/>
        <geom type="mesh" mesh="part" mass="?" friction="? .005 .0001"/></body></mujocoinclude>"""
    )
    (at / "sub" / "lid.xml").write_text(
        """<mujoco><compiler meshdir="m"/><asset><mesh name="lid" file="lid.obj"/></asset>
        <worldbody><body name="lid"><geom type="mesh" mesh="lid" mass="0.1"/></body></worldbody>
        </mujoco>"""
    )
    (at / "scene.xml").write_text(
        """<mujoco><compiler meshdir="meshes"/>
        <asset><mesh file="part.obj"/><mesh name="tall" file="../other/part.obj"/>
          <model name="lids" file="sub/lid.xml"/></asset>
        <worldbody><body name="table" pos="0.5 0 0.1"><geom type="box" size=".3 .3 .02"/></body>
          <geom type="mesh" mesh="tall" pos="1 0 0"/>
          <include file="objects.xml"/>
          <frame pos="0.7 0 0.3"><attach model="lids" body="lid" prefix="a_"/></frame>
        </worldbody></mujoco>"""
    )
    return build(load_scene(at / "scene.xml", root=at))


def test_mjcf_takes_its_files_along(
    scattered: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = export(scattered, "mjcf", tmp_path)
    assert (made.held, made.lost) == ((MASS, FRICTION, STIFFNESS), ())
    moved = tmp_path / "elsewhere" / "twin"
    shutil.move(made.file.parent, moved)
    shutil.rmtree(tmp_path / "scattered")
    monkeypatch.chdir("/")
    model = mujoco.MjModel.from_xml_path(str(moved / made.file.name))
    assert model.body("mug").mass == pytest.approx(0.2541, rel=1e-4)
    assert model.geom_friction[model.body("mug").geomadr[0], 0] == pytest.approx(0.41, abs=1e-3)
    assert model.body("a_lid").mass == pytest.approx(0.1)
    assert model.mesh("tall").vertnum == 4
    text = (moved / "scene.xml").read_text()
    assert "<!-- included -->" in text
    assert "meshdir" not in text
    assert {path.name for path in (moved / "assets").rglob("*.obj")} == {"part.obj", "lid.obj"}


@pytest.mark.parametrize("to", ["urdf", "usd"])
def test_meshes_from_anywhere_are_exported(scattered: Twin, tmp_path: Path, to: str) -> None:
    if to == "usd":
        pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    made = export(scattered, to, tmp_path)
    assert MASS in made.held
    shutil.rmtree(tmp_path / "scattered")
    if to == "urdf":
        placement = json.loads((made.file.parent / "placement.json").read_text())
        model = read_spec(mujoco, str(made.file), placement).compile()
        assert model.nmesh == 3
