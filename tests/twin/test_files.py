"""Twins of scenes of several files, written where they are wanted."""

from __future__ import annotations

import shutil
import struct
import zlib
from pathlib import Path

import mujoco
import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.scene.load import load_scene
from palpate.twin.twin import Twin, build_twin

MAIN = """<mujoco>  <!-- the whole -->
  <compiler meshdir="meshes"/>
  <include file="assets.xml"/>
  <worldbody>
    <body name='table' pos="0.5 0 0.2"><geom type="box" size=".3 .3 .02" friction="1"/></body>
    <include file="parts/things.xml"/>
  </worldbody>
</mujoco>
"""
THINGS = """<mujocoinclude>
  <!-- unweighed --> <body name="mug"   pos="0.5 0 0.27"><freejoint/>
    <geom type="mesh" mesh="cube" friction=".4" mass='?' /> </body>
  <include file="parts/more.xml"/>
</mujocoinclude>
"""
MORE = """<mujocoinclude><body name="ball" pos="0.5 0.2 0.25"><freejoint/>
  <geom size=".03" friction=".4"/></body></mujocoinclude>"""
ASSETS = '<mujocoinclude><asset><mesh name="cube" file="cube.obj" scale=".05 .05 .05"/></asset></mujocoinclude>'
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A folder with a scene of four files and a mesh."""
    texts = {
        "scene.xml": MAIN,
        "assets.xml": ASSETS,
        "parts/things.xml": THINGS,
        "parts/more.xml": MORE,
        "meshes/cube.obj": CUBE,
    }
    for name, text in texts.items():
        file = tmp_path / "cell" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path / "cell"


def twin_of(scene: Path, **masses: float) -> Twin:
    read = load_scene(scene)
    estimates: list[Estimate] = []
    for name, mass in masses.items():
        interval = ((mass - 0.002, mass + 0.002),)
        parameter, unit = Parameter(name, "mass"), catalogue()["mass"].unit
        estimates.append(
            Estimate(parameter, unit, (mass,), (0.001,), interval, "weighed", (), "identified")
        )
    return build_twin(read, estimates)


def mass_in(path: Path, name: str) -> float:
    """As MuJoCo itself reads it from the file."""
    return float(mujoco.MjModel.from_xml_path(str(path)).body(name).mass[0])


def test_a_value_of_an_included_file_is_written_there(cell: Path, tmp_path: Path) -> None:
    twin = twin_of(cell / "scene.xml", mug=0.25)
    written = twin.save(tmp_path / "out" / "twin.xml")
    names = {path.relative_to(tmp_path / "out").as_posix() for path in written}
    assert names == {
        "twin.xml",
        "assets.xml",
        "parts/things.xml",
        "parts/more.xml",
        "meshes/cube.obj",
    }
    bodies = (tmp_path / "out/parts/things.xml").read_text()
    assert bodies == THINGS.replace("mass='?'", "mass='0.2500'")
    assert (tmp_path / "out/parts/more.xml").read_text() == MORE
    main = (tmp_path / "out/twin.xml").read_text()
    assert main.replace(main[main.index("  <custom>") : main.index("</mujoco>")], "") == MAIN
    assert mass_in(tmp_path / "out/twin.xml", "mug") == pytest.approx(0.25)


def test_only_changed_files_are_written_next_to_the_scene(cell: Path) -> None:
    twin = twin_of(cell / "scene.xml", mug=0.25, ball=0.1)
    before = {path: path.read_bytes() for path in cell.rglob("*.*")}
    written = twin.save(cell / "twin.xml")
    names = {path.relative_to(cell).as_posix() for path in written}
    assert names == {"twin.xml", "parts/twin_things.xml", "parts/twin_more.xml"}
    assert all(path.read_bytes() == content for path, content in before.items())
    assert '<include file="parts/twin_things.xml"/>' in (cell / "twin.xml").read_text()
    assert '"parts/twin_more.xml"' in (cell / "parts/twin_things.xml").read_text()
    assert mass_in(cell / "twin.xml", "mug") == pytest.approx(0.25)
    assert mass_in(cell / "twin.xml", "ball") == pytest.approx(0.1)


def test_files_from_elsewhere_are_found_where_they_are(cell: Path, tmp_path: Path) -> None:
    inner = cell / "scenes" / "one"
    inner.mkdir(parents=True)
    (cell / ".git").mkdir()
    text = MAIN.replace("meshes", "../../meshes").replace('file="', 'file="../../')
    (inner / "scene.xml").write_text(text)
    (cell / "parts/things.xml").write_text(THINGS.replace("parts/more", "../../parts/more"))
    twin = twin_of(inner / "scene.xml", mug=0.25)
    out = tmp_path / "elsewhere" / "twin.xml"
    written = twin.save(out)
    assert [path.name for path in written] == ["twin.xml", "twin_things.xml"]
    assert mass_in(out, "mug") == pytest.approx(0.25)
    assert f'meshdir="{cell / "meshes"}"' in out.read_text()


def test_existing_files_are_not_overwritten(cell: Path) -> None:
    twin = twin_of(cell / "scene.xml", mug=0.25)
    with pytest.raises(InputError, match="exists already"):
        twin.save(cell / "scene.xml")
    (cell / "parts" / "twin_things.xml").write_text("mine")
    with pytest.raises(InputError, match=r"twin_things\.xml' exists"):
        twin.save(cell / "twin.xml")
    assert not (cell / "twin.xml").exists()


def test_the_twin_in_one_text_has_its_includes_in_it(cell: Path) -> None:
    twin = twin_of(cell / "scene.xml", mug=0.25)
    assert "<include" not in twin.xml
    assert "things.xml" in twin.diff
    assert '-    <geom type="mesh" mesh="cube" friction=".4" mass=\'?\' /> </body>' in twin.diff
    assert twin.scene is not None
    assert twin.scene.bodies["mug"].known["mass"] == pytest.approx((0.25,))


ATTACHING = """<mujoco><asset><model name="a" file="things/tray.xml"/></asset>
<worldbody><attach model="a" prefix="a_"/></worldbody></mujoco>"""
TRAY = """<mujoco><compiler meshdir="m"/><asset><model name="b" file="mug.xml"/>
<mesh name="cube" file="cube.obj" scale=".3 .3 .2"/></asset><worldbody>
<body name="tray" pos=".5 0 0"><geom type="mesh" mesh="cube"/></body>
<attach model="b" body="mug" prefix="b_"/></worldbody></mujoco>"""
MUG = """<mujoco><include file="rest.xml"/></mujoco>"""
REST = """<mujoco><worldbody><body name="mug" pos=".5 0 .25"><freejoint/>
<geom size=".05" mass="?" friction=".4"/></body></worldbody></mujoco>"""


@pytest.fixture
def attaching(tmp_path: Path) -> Path:
    """A folder whose scene attaches a model that attaches another, which includes a third."""
    folder = tmp_path / "attaching"
    (folder / "things" / "m").mkdir(parents=True)
    (folder / "scene.xml").write_text(ATTACHING)
    for name, text in {"tray": TRAY, "mug": MUG, "rest": REST}.items():
        (folder / "things" / f"{name}.xml").write_text(text)
    (folder / "things" / "m" / "cube.obj").write_text(CUBE)
    return folder


def test_a_value_of_an_attached_model_is_written_there(
    attaching: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = twin_of(attaching / "scene.xml", a_b_mug=0.25)
    assert twin.unwritten == ()
    elsewhere, here = tmp_path / "out" / "twin.xml", attaching / "twin.xml"
    written = {path.relative_to(tmp_path).as_posix() for path in twin.save(elsewhere)}
    assert written >= {"out/things/mug.xml", "out/things/rest.xml", "out/things/m/cube.obj"}
    assert (tmp_path / "out/things/tray.xml").read_bytes() == TRAY.encode()
    assert (tmp_path / "out/things/rest.xml").read_text() == REST.replace("?", "0.2500")
    twin.save(here)
    assert (attaching / "things" / "rest.xml").read_text() == REST
    monkeypatch.chdir("/")
    for path in (elsewhere, here):
        assert mass_in(path, "a_b_mug") == pytest.approx(0.25)


def written_to(folder: Path, twin: Twin) -> Path:
    """Write a twin as a run does, into its folder."""
    folder.mkdir()
    for name, text in twin.packed(folder).items():
        (folder / name).write_text(text)
    return folder / "twin.xml"


def test_a_run_folder_has_the_files_of_attached_models(attaching: Path, tmp_path: Path) -> None:
    twin = twin_of(attaching / "scene.xml", a_b_mug=0.25)
    path = written_to(tmp_path / "run", twin)
    shutil.rmtree(attaching)
    assert {file.name for file in path.parent.glob("*.xml")} == {
        *("twin.xml", "twin_tray.xml", "twin_mug.xml")
    }
    assert mass_in(path, "a_b_mug") == pytest.approx(0.25)


OTHERS = """<mujoco><compiler assetdir="../shared" strippath="true"/>
<asset><texture name="wood" type="2d" file="any/t.png"/><material name="wood" texture="wood"/>
<hfield name="hills" file="t.png" size="1 1 .02 .1"/>
<mesh name="a" file="cube.obj" scale=".3 .3 .2"/></asset>
<worldbody><geom type="hfield" hfield="hills" pos="0 0 -.5"/>
<body name="table" pos=".5 0 0"><geom type="mesh" mesh="a" material="wood"/></body>
<body name="mug" pos=".5 0 .25"><freejoint/><geom size=".05" mass="?" friction=".4"/></body>
</worldbody></mujoco>"""


def png(side: int) -> bytes:
    """A grey picture."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    rows = zlib.compress((b"\0" + bytes(range(side))) * side)
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    packed = chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + packed


@pytest.mark.parametrize("scene", ["meshes", "others"])
def test_a_run_folder_has_all_files_of_its_twin(cell: Path, tmp_path: Path, scene: str) -> None:
    path = cell / "scene.xml"
    if scene == "others":
        (tmp_path / "shared").mkdir()
        (tmp_path / "shared" / "t.png").write_bytes(png(8))
        (tmp_path / "shared" / "cube.obj").write_text(CUBE)
        path.write_text(OTHERS)
    twin = twin_of(path, mug=0.25)
    run = written_to(tmp_path / "run", twin)
    assert "assets" not in twin.xml
    # A second time, as when a run is finished later.
    assert twin.packed(run.parent)["twin.xml"] == run.read_text()
    moved = run.parent.rename(tmp_path / "moved") / "twin.xml"
    shutil.rmtree(cell)
    shutil.rmtree(tmp_path / "shared", ignore_errors=True)
    assert mass_in(moved, "mug") == pytest.approx(0.25)


def test_a_twin_without_files_is_the_same_in_a_run_folder(tmp_path: Path) -> None:
    (tmp_path / "rest.xml").write_text(REST)
    twin = twin_of(tmp_path / "rest.xml", mug=0.25)
    assert twin.packed(tmp_path) == {"twin.xml": twin.xml}
