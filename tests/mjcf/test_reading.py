"""MJCF files are untrusted input."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.mjcf.document import MAX_BYTES, MAX_DEPTH, with_tokens
from palpate.mjcf.reading import is_too_wide, parse_document, read_document
from palpate.scene.load import load_scene, scene_from_text
from palpate.scene.remarks import remarks
from palpate.twin.inject import inject

SCENE = "<mujoco><worldbody/></mujoco>"
CUBE = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write(folder: Path, text: str, name: str = "scene.xml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
    return path


def test_malformed_xml_is_located(tmp_path: Path) -> None:
    path = write(tmp_path, "<mujoco>\n  <worldbody>\n</mujoco>")
    with pytest.raises(InputError, match=r"scene\.xml, line 3, column \d+: malformed XML"):
        read_document(path)


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE mujoco [<!ENTITY e SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE mujoco SYSTEM "http://127.0.0.1:1/x.dtd">',
        '<!DOCTYPE lolz [<!ENTITY a "lol"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    ],
)
def test_doctypes_and_entities_are_refused(prolog: str) -> None:
    with pytest.raises(InputError, match="DOCTYPE"):
        parse_document(f'{prolog}<mujoco model="&e;"><worldbody/></mujoco>')


def test_an_undeclared_entity_is_malformed() -> None:
    with pytest.raises(InputError, match="malformed"):
        parse_document("<mujoco>&nobody;</mujoco>")


def test_deep_nesting_and_size_are_bounded() -> None:
    deep = "<mujoco>" + "<body>" * 10_000 + "</body>" * 10_000 + "</mujoco>"
    with pytest.raises(InputError, match=f"deeper than {MAX_DEPTH}"):
        parse_document(deep)
    with pytest.raises(InputError, match="larger than"):
        parse_document(f"<mujoco><!--{' ' * MAX_BYTES}--></mujoco>")


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"\xff\xfe<mujoco/>", "utf-8"),
        (b"<robot/>", "not MJCF"),
        (b"", "malformed"),
    ],
)
def test_other_formats_are_refused_with_their_conversion(
    tmp_path: Path, content: bytes, complaint: str
) -> None:
    path = tmp_path / "scene.xml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint):
        read_document(path)


def test_an_absent_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_document(tmp_path / "nothing.xml")


def test_a_missing_mesh_is_named_with_its_element(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        '<mujoco><compiler meshdir="assets"/>'
        '<asset><mesh name="cup" file="cup.obj"/></asset></mujoco>',
    )
    with pytest.raises(
        InputError, match=r'<mesh name="cup"> \(line 1\) names the file .*cup\.obj.* does not exist'
    ):
        read_document(path)


@pytest.mark.parametrize(
    "line",
    [
        '<asset><mesh file="../outside.obj"/></asset>',
        '<asset><texture type="cube" fileright="../outside.obj"/></asset>',
        '<compiler meshdir=".."/><asset><mesh file="outside.obj"/></asset>',
        '<include file="../outside.obj"/>',
        '<asset><mesh file="/etc/hostname"/></asset>',
        '<asset><model file="../outside.obj"/></asset>',
    ],
)
def test_files_outside_the_folder_are_refused(tmp_path: Path, line: str) -> None:
    write(tmp_path, CUBE, "outside.obj")
    path = write(tmp_path, f"<mujoco>{line}</mujoco>", "inner/scene.xml")
    with pytest.raises(InputError, match="outside of"):
        read_document(path, path.parent)


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    outside = write(tmp_path, CUBE, "outside.obj")
    path = write(
        tmp_path, '<mujoco><asset><mesh file="link.obj"/></asset></mujoco>', "inner/scene.xml"
    )
    os.symlink(outside, path.parent / "link.obj")
    with pytest.raises(InputError, match="outside of"):
        read_document(path, path.parent)


def test_includes_are_expanded_in_place_and_remembered(tmp_path: Path) -> None:
    part = write(tmp_path, '<mujoco><body name="b"/><body name="c"/></mujoco>', "parts/objects.xml")
    path = write(
        tmp_path,
        '<mujoco><worldbody><body name="a"/><include file="parts/objects.xml"/>'
        '<body name="d"/></worldbody></mujoco>',
    )
    document = read_document(path)
    assert [body.get("name") for body in document.worldbody] == ["a", "b", "c", "d"]
    places = [document.index[body] for body in document.worldbody]
    assert [place.file for place in places] == [None, part, part, None]
    assert [place.number for place in places] == [2, 1, 2, 4]
    assert document.files == (part.resolve(),)


def test_an_include_cycle_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, '<mujoco><include file="a.xml"/></mujoco>')
    write(tmp_path, '<mujoco><include file="a.xml"/></mujoco>', "a.xml")
    with pytest.raises(InputError, match="second time"):
        read_document(path)


def test_text_alone_cannot_name_files() -> None:
    with pytest.raises(InputError, match="no folder"):
        parse_document('<mujoco><asset><mesh file="cup.obj"/></asset></mujoco>')


def test_replacing_numbers_keeps_all_other_characters() -> None:
    assert with_tokens(" 0.50\t0   ? ", {2: "0.765"}) == " 0.50\t0   0.765 "


def test_a_scene_without_worldbody_is_refused() -> None:
    with pytest.raises(InputError, match="no <worldbody>"):
        _ = parse_document("<mujoco/>").worldbody


def test_an_ordinary_scene_is_read(tmp_path: Path) -> None:
    assert read_document(write(tmp_path, SCENE)).text == SCENE


OBJECT = '<body name="a" pos="0.5 0 1"><freejoint/><geom type="mesh" mesh="m"/></body>'


def beside(tmp_path: Path, name: str = "share") -> Path:
    """A scene in one folder with a mesh in the next."""
    write(tmp_path / name, CUBE, "assets/m.obj")
    scene = tmp_path / name / "scenes" / "scene.xml"
    scene.parent.mkdir()
    scene.write_text(
        '<mujoco><compiler meshdir="../assets"/><asset><mesh name="m" file="m.obj"/></asset>'
        f"<worldbody>{OBJECT}</worldbody></mujoco>"
    )
    return scene


@pytest.mark.parametrize("root", [None, ".", ".."])
def test_files_outside_the_scenes_folder_are_read(tmp_path: Path, root: str | None) -> None:
    scene = beside(tmp_path)
    share = tmp_path / "share"
    parsed_scene = load_scene(scene, root=None if root is None else share / root)
    assert parsed_scene.files == (share / "assets" / "m.obj",)
    given = share if root is None else (share / root).resolve()
    assert f"1 files are read from below '{given}'" in " ".join(remarks(parsed_scene))
    twin = scene_from_text(parsed_scene.text, parsed_scene)
    assert twin.spec().compile().nmesh == 1


def test_a_scene_without_files_has_no_remark_on_files(tmp_path: Path) -> None:
    write(tmp_path, CUBE, "m.obj")
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<mujoco><asset><mesh name="m" file="m.obj"/></asset>'
        f"<worldbody>{OBJECT}</worldbody></mujoco>"
    )
    assert "are read from below" not in " ".join(remarks(load_scene(scene)))


@pytest.mark.parametrize("where", ["home", "above homes"])
def test_a_whole_home_is_read_only_when_it_is_named(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "share" if where == "home" else tmp_path / "share" / "homes" / "me"
    monkeypatch.setenv("HOME", str(home))
    scene = beside(tmp_path)
    with pytest.raises(InputError, match=f"only read with root={tmp_path / 'share'}; or move"):
        load_scene(scene)
    assert load_scene(scene, root=tmp_path / "share").files


@pytest.mark.parametrize(
    "folder", ["/", "/etc", "/usr/share", "/var/lib", "/home/me", "/home", "/tmp", "/root", "/opt"]
)
def test_folders_that_hold_more_than_scenes_are_too_wide(folder: str) -> None:
    assert is_too_wide(Path(folder))
    assert not is_too_wide(Path(folder) / "scenes" / "kitchen")
    assert not is_too_wide(Path("/data/scenes"))


def test_the_message_is_the_same_for_existing_and_missing_system_files(tmp_path: Path) -> None:
    text: set[str] = set()
    for name in ("/etc/passwd", "/etc/passwt"):
        (tmp_path / "scene.xml").write_text(f'<mujoco><include file="{name}"/></mujoco>')
        with pytest.raises(InputError) as error:
            load_scene(tmp_path / "scene.xml")
        text.add(str(error.value).replace("passwt", "passwd"))
    assert len(text) == 1


def test_parts_are_found_where_mujoco_finds_them(tmp_path: Path) -> None:
    """From the scene's folder, else from that of the part; meshes likewise."""
    write(tmp_path, CUBE, "parts/m.obj")
    (tmp_path / "scene.xml").write_text('<mujoco><include file="parts/a.xml"/></mujoco>')
    (tmp_path / "parts" / "a.xml").write_text(
        '<mujocoinclude><include file="b.xml"/></mujocoinclude>'
    )
    (tmp_path / "parts" / "b.xml").write_text(
        '<mujocoinclude><asset><mesh name="m" file="m.obj"/></asset>'
        f"<worldbody>{OBJECT}</worldbody></mujocoinclude>"
    )
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml")).nmesh == 1
    scene = load_scene(tmp_path / "scene.xml")
    assert scene.spec().compile().nmesh == 1
    merged = inject(scene.text, {Parameter("a.mass"): (0.2,)}, folder=tmp_path)
    assert 'mass="0.2"' in merged


def test_attached_models_are_found_from_any_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cup.xml").write_text(
        '<mujoco model="cup"><worldbody><body name="c"><geom size=".03"/></body></worldbody></mujoco>'
    )
    (tmp_path / "scene.xml").write_text(
        '<mujoco><asset><model name="cup" file="cup.xml"/></asset><worldbody>'
        '<body name="a" pos="0.5 0 1"><freejoint/><geom size=".02"/><attach model="cup" body="c" prefix="x_"/>'
        "</body></worldbody></mujoco>"
    )
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_scene(tmp_path / "scene.xml").spec().compile().body("x_c").name == "x_c"


@pytest.mark.parametrize(
    ("root", "message"),
    [
        ("mujocoinclude", "a part that scenes include"),
        ("robot", "not MJCF but URDF"),
        ("sdf", "not MJCF but SDF"),
        ("svg", "its root is <svg>"),
    ],
)
def test_files_of_other_kinds_are_refused_with_their_kind(root: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_document(f"<{root}/>")
