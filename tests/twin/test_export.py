"""A twin in other formats: what is written is read with MuJoCo or USD, and says what the twin says."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError, PalpateError, Unavailable
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FurtherValue
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Samples, Trace
from palpate.twin import export_urdf as urdf
from palpate.twin import export_usd
from palpate.twin.export import Export, export_twin, require_format, require_same_fields
from palpate.twin.export_check import check_export
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
    result, scratch = folder / "made", folder / "scratch"
    result.mkdir()
    scratch.mkdir()
    package = export_twin(twin, MEASURED, require_format(to), result, scratch)
    shutil.rmtree(scratch)
    return package


@pytest.fixture(scope="module")
def kitchen() -> Twin:
    return build(parse_scene(KITCHEN))


def test_urdf_has_masses_shapes_and_joints(kitchen: Twin, tmp_path: Path) -> None:
    package = export(kitchen, "urdf", tmp_path)
    assert package.file.name == "scene.urdf"
    assert (package.kept, package.lost) == ((MASS,), (FRICTION, STIFFNESS))
    placement = json.loads((package.file.parent / "placement.json").read_text())
    spec = read_spec(mujoco, str(package.file), placement)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12
    model = spec.compile()
    twin = kitchen.mjmodel
    for name in ("mug", "door", "latch", "table"):
        expected, its = twin.body(name), model.body(name)
        assert its.mass == pytest.approx(expected.mass, rel=1e-6)
        assert sorted(its.inertia) == pytest.approx(sorted(expected.inertia), rel=1e-5)
        gap = mujoco.MjData(twin), mujoco.MjData(model)
        for item, data in zip((twin, model), gap, strict=True):
            mujoco.mj_forward(item, data)
        assert gap[1].body(name).xipos == pytest.approx(gap[0].body(name).xipos, abs=1e-7)
    assert model.body("mug").mass == pytest.approx(0.2541, rel=1e-4)
    tree = ElementTree.parse(package.file)
    kinds = {joint.get("name"): joint.get("type") for joint in tree.iter("joint")}
    assert kinds["hinge"] == "revolute"
    assert "floating" not in kinds.values()
    assert set(placement) == {"mug"}
    assert "prismatic" in kinds.values()
    limit = next(j for j in tree.iter("joint") if j.get("name") == "hinge").find("limit")
    assert limit is not None
    assert float(limit.get("upper", "")) == pytest.approx(np.pi / 2)
    text = "\n".join(package.notes)
    assert "URDF has no friction" in text
    assert "the plane 'floor' is the top of a box" in text
    assert "ellipsoid" in text


def test_a_hinge_off_the_bodys_origin_turns_about_the_same_line(
    kitchen: Twin, tmp_path: Path
) -> None:
    package = export(kitchen, "urdf", tmp_path)
    places: list[np.ndarray] = []
    for model in (kitchen.mjmodel, mujoco.MjModel.from_xml_path(str(package.file))):
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

    package = export(kitchen, "usd", tmp_path)
    assert package.file.name == "scene.usdc"
    assert (package.kept, package.lost) == ((MASS, FRICTION), (STIFFNESS,))
    assert package.acts_in(MASS) == ()
    stage = Usd.Stage.Open(str(package.file))
    mug = next(prim for prim in stage.Traverse() if prim.GetName() == "mug")
    assert UsdPhysics.MassAPI(mug).GetMassAttr().Get() == pytest.approx(0.2541, rel=1e-4)
    frictions = []
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.MaterialAPI):
            frictions.append(UsdPhysics.MaterialAPI(prim).GetDynamicFrictionAttr().Get())
    assert pytest.approx(0.41, rel=1e-3) in frictions
    text = "\n".join(package.notes)
    assert "1 cameras are left out" in text
    assert "ellipsoid" in text


def test_usd_states_what_its_readers_follow(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    from pxr import Usd, UsdPhysics, UsdShade

    text = KITCHEN.replace(
        'range="0 90"', 'range="0 90" damping="2" frictionloss=".8" stiffness="3"'
    )
    text = text.replace('<body name="door"', '<body name="hook" pos="0 0 1"/><body name="door"')
    static = {"static": FurtherValue(0.55, 0.01)}
    friction = replace(MEASURED[1], parts=static)
    twin = build_twin(parse_scene(text), (MEASURED[0], friction), NOTHING, lambda world: [])
    folder = tmp_path / "made"
    folder.mkdir()
    (tmp_path / "scratch").mkdir()
    package = export_twin(twin, (MEASURED[0], friction), "usd", folder, tmp_path / "scratch")
    stage = Usd.Stage.Open(str(package.file))
    prims = {prim.GetDisplayName() or prim.GetName(): prim for prim in stage.Traverse()}
    # MuJoCo follows the binding for all purposes, where it must find the friction.
    (shape,) = [p for p in stage.Traverse() if p.GetTypeName() == "Cylinder"]
    bound = UsdShade.MaterialBindingAPI(shape).GetDirectBinding().GetMaterial()
    material = UsdPhysics.MaterialAPI(bound)
    assert material.GetDynamicFrictionAttr().Get() == pytest.approx(0.41, rel=1e-3)
    assert material.GetStaticFrictionAttr().Get() == pytest.approx(0.55)
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.MaterialAPI):
            assert UsdPhysics.MaterialAPI(prim).GetStaticFrictionAttr().Get() > 0.0
    # Newton and PhysX state damping and stiffness per degree.
    hinge, degree = prims["hinge"], np.pi / 180.0
    for name, value in (
        ("newton:friction", 0.8),
        ("newton:damping", 2.0 * degree),
        ("physxJointAxis:angular:dynamicFrictionEffort", 0.8),
        ("physxJointAxis:angular:viscousFrictionCoefficient", 2.0 * degree),
        ("drive:angular:physics:stiffness", 3.0 * degree),
        ("mjc:frictionloss", 0.8),
    ):
        assert hinge.GetAttribute(name).Get() == pytest.approx(value), name
    (scene,) = [p for p in stage.Traverse() if p.IsA(UsdPhysics.Scene)]
    assert scene.GetAttribute("mjc:flag:multiccd").Get() is True
    assert scene.GetAttribute("mjc:flag:sleep").Get() is False
    assert "joint_target_ke" in "\n".join(package.notes)


def test_urdf_states_joint_forces_and_frictions(tmp_path: Path) -> None:
    text = KITCHEN.replace(
        'range="0 90"', 'range="0 90" damping="2" frictionloss=".8" armature=".1"'
    )
    text = text.replace('<body name="door"', '<body name="hook" pos="0 0 1"/><body name="door"')
    text = text.replace("<freejoint/>", '<joint type="free" damping=".001"/>')
    package = export(build(parse_scene(text)), "urdf", tmp_path)
    assert "the damping of the free body 'mug' is left out" in package.notes
    tree = ElementTree.parse(package.file)
    (hinge,) = [joint for joint in tree.iter("joint") if joint.get("name") == "hinge"]
    dynamics = hinge.find("dynamics")
    assert dynamics is not None
    assert (dynamics.get("damping"), dynamics.get("friction")) == ("2", "0.8")
    # Readers compute the mass of a link without one: 8000 kg of the ground.
    for file in package.file.parent.glob("*.urdf"):
        for link in ElementTree.parse(file).iter("link"):
            assert link.find("inertial/mass") is not None, link.get("name")
    # 2 a b / (a + b) and a b of the mug and its table of 0.7 are the measured 0.41.
    drake = "{http://drake.mit.edu}"
    mug = ElementTree.parse(package.file.with_name("mug.urdf"))
    (expected, *_) = [float(mu.get("value", "")) for mu in mug.iter(f"{drake}mu_dynamic")]
    assert 2 * expected * 0.7 / (expected + 0.7) == pytest.approx(0.41, rel=1e-3)
    (bullet,) = mug.iter("lateral_friction")
    assert float(bullet.get("value", "")) * 0.7 == pytest.approx(0.41, rel=1e-3)
    assert "the armature of the joint 'hinge' is left out" in package.notes


def test_portable_mjcf_has_every_mass_and_no_frames(tmp_path: Path) -> None:
    text = KITCHEN.replace('<body name="mug"', '<frame pos="0 .1 0"><body name="mug"')
    text = text.replace('<body name="door"', '</frame><body name="door"')
    package = export(build(parse_scene(text)), "mjcf", tmp_path)
    portable = ElementTree.parse(package.file.with_name("portable.xml"))
    assert list(portable.iter("frame")) == []
    (mug,) = [body for body in portable.iter("body") if body.get("name") == "mug"]
    inertial = mug.find("inertial")
    assert inertial is not None
    assert float(inertial.get("mass", "")) == pytest.approx(0.2541, rel=1e-4)
    assert "com follows from shapes of uniform density: mug" in package.notes
    assert [n for n in package.notes if n.startswith("mug.mass is unknown")] == []


UNNAMED = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos=".5 0 .1"><geom type="box" size=".3 .3 .1"/></body>
  <body pos=".5 0 .25"><freejoint/>
    <geom name="mug" type="cylinder" size=".03 .05" mass="?" friction="? .005 .0001" group="3"/></body>
  <body name="tin" pos=".5 .2 .25"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("to", ["mjcf", "urdf", "usd"])
def test_an_object_without_a_name_and_hidden_geoms_is_exported(tmp_path: Path, to: str) -> None:
    if to == "usd":
        pytest.importorskip("mujoco_usd_converter", reason="the extra has no wheel here")
    package = export(build(parse_scene(UNNAMED)), to, tmp_path)
    assert MASS in package.kept
    assert (package.acts_in(MASS) == ("mujoco",)) == (to != "usd")
    text = "\n".join(package.notes)
    assert "tin.mass is unknown: the export has MuJoCo's default, 0.2827 kg" in text
    assert "tin.friction is unknown: the export has MuJoCo's default, 1" in text
    if to == "mjcf":
        assert mujoco.MjModel.from_xml_path(str(package.file)).body("mug").mass == pytest.approx(
            0.2541
        )


@pytest.mark.parametrize("to", ["mjcf", "urdf"])
def test_only_compared_values_count_as_read_back(kitchen: Twin, tmp_path: Path, to: str) -> None:
    package = export(kitchen, to, tmp_path)
    assert package.acts_in(MASS) == ("mujoco",)
    # URDF has no friction. MJCF is compared field by field.
    assert package.acts_in(FRICTION) == (("mujoco",) if to == "mjcf" else ())


@pytest.mark.parametrize(
    ("field", "value"),
    [("geom_friction", 0.7), ("geom_solref", 0.05), ("body_pos", 0.01), ("jnt_range", 1.2)],
)
def test_a_field_that_changed_in_writing_is_an_error(
    kitchen: Twin, field: str, value: float
) -> None:
    twin, result = (mujoco.MjModel.from_xml_string(kitchen.xml) for _ in range(2))
    require_same_fields(twin, result)
    getattr(result, field)[-1, -1] += value
    with pytest.raises(PalpateError, match=field):
        require_same_fields(twin, result)


def test_a_check_names_what_acts_and_what_does_not(kitchen: Twin, tmp_path: Path) -> None:
    folder, scratch = tmp_path / "made", tmp_path / "scratch"
    for empty in (folder, scratch, tmp_path / "again", tmp_path / "scratch2"):
        empty.mkdir()
    package = export_twin(kitchen, MEASURED, "urdf", folder, scratch, check=True)
    by_name = {f.quantity: f for f in package.findings if f.reader.startswith("mujoco 4")}
    assert {q for q, f in by_name.items() if f.verdict == "acts"} >= {
        "mass",
        "com",
        "inertia",
        "swing",
    }
    # URDF has no friction, and MuJoCo takes its own of 1.
    assert by_name["slide"].verdict == "differs"
    assert by_name["slide"].detail.startswith("mug: ")
    assert next(iter(package.acts_in(MASS))).startswith("mujoco ")
    assert package.acts_in(FRICTION) == ()
    # A ball on the table shows that its stiffness is lost in URDF, and acts in MJCF.
    assert by_name["press"].detail.startswith("palpate_probe_table: ")
    again = tmp_path / "again"
    as_mjcf = export_twin(kitchen, MEASURED, "mjcf", again, tmp_path / "scratch2", check=True)
    assert next(iter(as_mjcf.acts_in(STIFFNESS))).startswith("mujoco ")
    with pytest.raises(InputError, match="ranges are no model"):
        export_twin(kitchen, MEASURED, "randomisation", folder, scratch, check=True)


def test_a_reader_that_fails_loses_the_file(kitchen: Twin, tmp_path: Path) -> None:
    broken = tmp_path / "scene.urdf"
    broken.write_text("<robot")
    (tmp_path / "scene.xml").write_text(kitchen.xml)
    result = check_export(kitchen.mjmodel, tmp_path / "scene.xml", broken, "urdf")
    assert {(f.quantity, f.verdict) for f in result} == {("file", "lost")}
    assert all(f.detail for f in result)


def test_a_missing_usd_package_gets_an_install_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco_usd_converter", None)
    with pytest.raises(Unavailable, match=r"pip install 'palpate\[export\]'"):
        require_format("usd")
    with pytest.raises(InputError, match="valid: mjcf, urdf, usd"):
        require_format("sdf")


def test_a_shadowed_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    both = [SimpleNamespace(metadata={"Name": name}) for name in ("usd-core", "usd-exchange")]
    monkeypatch.setattr(export_usd, "distributions", lambda: both)
    monkeypatch.setitem(__import__("sys").modules, "mujoco_usd_converter", None)
    with pytest.raises(Unavailable, match="usd-core shadows it: pip uninstall usd-core"):
        require_format("usd")


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
    package = export(scattered, "mjcf", tmp_path)
    assert (package.kept, package.lost) == ((MASS, FRICTION, STIFFNESS), ())
    moved = tmp_path / "elsewhere" / "twin"
    shutil.move(package.file.parent, moved)
    shutil.rmtree(tmp_path / "scattered")
    monkeypatch.chdir("/")
    model = mujoco.MjModel.from_xml_path(str(moved / package.file.name))
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
    package = export(scattered, to, tmp_path)
    assert MASS in package.kept
    shutil.rmtree(tmp_path / "scattered")
    if to == "urdf":
        placement = json.loads((package.file.parent / "placement.json").read_text())
        model = read_spec(mujoco, str(package.file), placement).compile()
        assert model.nmesh == 3
