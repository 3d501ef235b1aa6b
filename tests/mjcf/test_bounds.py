"""Scenes that grow beyond what is built are refused before MuJoCo sees them."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.mjcf import bounds
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene

TABLE = '<body name="table"><geom type="box" size=".4 .4 .2"/></body>'


def scene(body: str = "", head: str = "") -> str:
    return f"<mujoco>{head}<worldbody>{TABLE}{body}</worldbody></mujoco>"


def replicated(count: str, inner: str = '<geom size="0.01"/>') -> str:
    return f'<replicate count="{count}" offset="0.1 0 0">{inner}</replicate>'


def flexible(count: str) -> str:
    return f'<flexcomp name="cloth" type="grid" count="{count}" spacing="1 1 1"/>'


PATIENCE = 30.0
"""s of processor time: what is expanded takes minutes, or all memory there is."""


def computed() -> float:
    """s of processor time that this process and those that it waited for have used."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


BOMBS = [
    (scene(replicated("1000000")), "replicated elements|more than 10000 elements"),
    (scene(replicated("1e6")), "more than 10000 elements"),
    (scene(replicated("nan")), "more than 10000 elements"),
    (scene(replicated("30", replicated("30", replicated("30")))), "more than 10000 elements"),
    (scene(replicated("3002")), "more than 3000 replicated elements"),
    (scene('<geom size="0.01"/>' * 10_000), r"<geom> \(line 1\) the scene has more than 10000"),
    (scene(flexible("200 200 200")), '<flexcomp name="cloth"> .* more than 4000 points'),
    (scene(replicated("9", flexible("10 10 10"))), "more than 4000 points"),
    (scene(replicated("9", '<flexcomp name="a" type="grid"/>')), "more than 4000 points"),
    (scene(head='<size memory="100G"/>'), 'memory="100G" is too large; at most 512M'),
    (scene(head='<size nuser_body="100000000"/>'), "nuser_body=.*at most 1000"),
    (scene(head='<size nkey="1e7"/>'), "nkey=.*at most 1000"),
    (scene(head='<option iterations="2000000000"/>'), "iterations=.*at most 10000"),
    (scene(head='<sensor><user dim="200000000"/></sensor>'), "dim=.*at most 1000"),
    (
        scene(head='<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>'),
        "more than 4000000 cells",
    ),
    (
        scene(head='<asset><mesh builtin="supersphere" params="3000 1 1"/></asset>'),
        "params=.*at most 128",
    ),
    (
        scene(head='<asset><mesh builtin="supersphere" params="128 1 1"/></asset>' * 99),
        "more than 30000000 bytes of meshes",
    ),
    (
        scene('<flexcomp name="a" type="grid" count="2 2 2" cellcount="99 99 99"/>'),
        "more than 4000 points",
    ),
    (
        scene(head='<extension><plugin plugin="their.code"/></extension>'),
        "the plugin 'their.code', which is foreign code; only MuJoCo's own",
    ),
]


@pytest.mark.parametrize(("text", "message"), BOMBS)
def test_an_element_that_expands_to_a_million_is_refused(text: str, message: str) -> None:
    started = computed()
    with pytest.raises(InputError, match=message):
        parse_scene(text)
    assert computed() - started < PATIENCE


def test_a_scene_within_the_bounds_is_built() -> None:
    assert "table" in parse_scene(scene(replicated("7"))).bodies
    assert "table" in parse_scene(scene(replicated("200"))).bodies


def mesh_scene(*files: str) -> str:
    meshes = "".join(f'<mesh name="m{i}" file="{file}"/>' for i, file in enumerate(files))
    geoms = "".join(f'<geom type="mesh" mesh="m{i}"/>' for i in range(len(files)))
    return scene(geoms, f"<asset>{meshes}</asset>")


def stl(corners: np.ndarray) -> bytes:
    """A binary STL of triangles (n, 3, 3)."""
    faces = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("", "<u2")])
    faces["at"] = corners
    return bytes(80) + np.uint32(len(faces)).tobytes() + faces.tobytes()


def two_circles(number: int) -> np.ndarray:
    """Triangles (n, 3, 3) between points of two skew circles, whose hull has all of them."""
    random = np.random.default_rng(0)
    angle, which = random.uniform(0, 2 * np.pi, (number, 3)), random.integers(0, 2, (number, 3))
    cos, sin, none = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    first, second = np.stack([cos, sin, none], 2), np.stack([3 + none, cos, sin], 2)
    return np.where(which[..., None] == 0, first, second)


def shards(number: int) -> np.ndarray:
    """Triangles (n, 3, 3) with corners of their own on a ball."""
    corners = np.random.default_rng(0).standard_normal((number, 3, 3))
    return corners / np.linalg.norm(corners, axis=2, keepdims=True)


@pytest.mark.parametrize("corners", [two_circles(40_000), shards(40_000)])
def test_a_mesh_whose_hull_would_take_minutes_is_built_with_a_bounded_one(
    corners: np.ndarray, tmp_path: Path
) -> None:
    (tmp_path / "m.stl").write_bytes(stl(corners))
    started = computed()
    built = parse_scene(mesh_scene("m.stl"), tmp_path)
    assert computed() - started < PATIENCE
    assert built.resolved.shapes.model.mesh_graph[0] == bounds.HULL_POINTS


def test_a_small_mesh_keeps_its_whole_hull(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(stl(shards(1_000)))
    built = parse_scene(mesh_scene("m.stl"), tmp_path)
    assert built.resolved.shapes.model.mesh_graph[0] == 3_000


def test_meshes_that_are_large_together_are_refused(tmp_path: Path) -> None:
    for name in ("a.stl", "b.stl"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(16_000_000)
    with pytest.raises(InputError, match=r'<mesh name="m1"> .* more than 30000000 bytes of meshes'):
        parse_scene(mesh_scene("a.stl", "b.stl"), tmp_path)


@pytest.mark.parametrize("name", ["cloth.obj", "cloth.stl"])
def test_points_of_a_flexible_object_in_a_file_are_counted(name: str, tmp_path: Path) -> None:
    content = stl(shards(2_000)) if name.endswith("stl") else b"v 0 0 0\n" * 5_000
    (tmp_path / name).write_bytes(content)
    cloth = f'<flexcomp name="a" type="mesh" file="{name}"/>'
    with pytest.raises(InputError, match="more than 4000 points"):
        parse_scene(scene(cloth), tmp_path)


def test_each_copy_of_an_attached_model_counts(tmp_path: Path) -> None:
    part = "<geom size='0.01'/>" * 900
    (tmp_path / "a.xml").write_text(scene(f"<body name='b'>{part}</body>"), encoding="utf-8")
    copies = "".join(f'<attach model="a" body="b" prefix="p{i}"/>' for i in range(60))
    head = '<asset><model name="a" file="a.xml"/></asset>'
    with pytest.raises(InputError, match="more than 50000 elements with all their copies"):
        parse_scene(scene(copies, head), tmp_path)


def test_attached_models_without_end_are_refused(tmp_path: Path) -> None:
    def model(name: str) -> str:
        return f'<asset><model name="{name}" file="{name}.xml"/></asset>'

    (tmp_path / "self.xml").write_text(scene(head=model("self")), encoding="utf-8")
    with pytest.raises(InputError, match=r"attaches self\.xml, which contains it"):
        load_scene(tmp_path / "self.xml")
    for i in range(20):
        twice = f'<asset><model name="a" file="{i + 1}.xml"/><model name="b" file="{i + 1}.xml"/></asset>'
        (tmp_path / f"{i}.xml").write_text(scene(head=twice), encoding="utf-8")
    (tmp_path / "20.xml").write_text(scene(), encoding="utf-8")
    with pytest.raises(InputError, match="attaches more than 100 models"):
        load_scene(tmp_path / "0.xml")


def test_an_attached_model_has_the_same_bounds(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(scene(replicated("3002")), encoding="utf-8")
    head = '<asset><model name="a" file="a.xml"/></asset>'
    with pytest.raises(InputError, match="more than 3000 replicated elements"):
        parse_scene(scene(head=head), tmp_path)


def test_includes_do_not_nest_without_end(tmp_path: Path) -> None:
    deep = "<body>" * 150 + '<include file="b.xml"/>' + "</body>" * 150
    (tmp_path / "a.xml").write_text(scene(deep), encoding="utf-8")
    (tmp_path / "b.xml").write_text(
        "<mujoco>" + "<body>" * 150 + "</body>" * 150 + "</mujoco>", encoding="utf-8"
    )
    with pytest.raises(InputError, match="nested deeper than 200"):
        load_scene(tmp_path / "a.xml")


def png(width: int, height: int, packed: bytes) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return bounds.PNG + chunk(b"IHDR", header) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def textures(built: Scene) -> int:
    """Number of textures with which a scene is drawn; its shapes have none."""
    assert built.resolved.shapes.model.ntex == 0
    return len(built.spec().textures)


def test_too_large_textures_are_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = """<asset><texture name="t" type="2d" file="t.png"/>
    <material name="m"><layer role="rgb" texture="t"/></material></asset>"""
    document = scene('<geom size=".1" material="m"/>', head)
    (tmp_path / "t.png").write_bytes(png(60_000, 60_000, b""))
    assert textures(parse_scene(document, tmp_path)) == 0
    rows = zlib.compress(bytes(8 * 25))
    (tmp_path / "t.png").write_bytes(png(8, 8, rows))
    assert textures(parse_scene(document, tmp_path)) == 1
    monkeypatch.setattr(bounds, "MAX_UNPACKED", 1_000_000)
    (tmp_path / "t.png").write_bytes(png(8, 8, zlib.compress(bytes(3_000_000))))
    assert textures(parse_scene(document, tmp_path)) == 0
    flat = '<asset><texture name="t" builtin="flat" width="{0}" height="{0}"/></asset>'
    assert textures(parse_scene(scene(head=flat.format(9999)))) == 0
    assert textures(parse_scene(scene(head=flat.format(99)))) == 1


def test_a_height_field_that_unpacks_to_too_many_bytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = '<asset><hfield name="h" file="h.png" size="1 1 1 1"/></asset>'
    (tmp_path / "h.png").write_bytes(png(60_000, 60_000, b""))
    with pytest.raises(InputError, match="60000 × 60000 pixels; at most 64 million"):
        parse_scene(scene(head=head), tmp_path)
    monkeypatch.setattr(bounds, "MAX_UNPACKED", 1_000_000)
    (tmp_path / "h.png").write_bytes(png(8, 8, zlib.compress(bytes(3_000_000))))
    with pytest.raises(InputError, match="unpacks to more than 1 MB"):
        parse_scene(scene(head=head), tmp_path)


ROBOT = """<mujoco model="arm"><asset><mesh name="a" file="a.stl"/><mesh name="b" file="b.stl"/>
<texture name="t" type="2d" file="t.png"/><material name="m" texture="t"/></asset><worldbody>
<body name="link0"><geom type="mesh" mesh="a" material="m"/><body name="link1"><joint name="turn"/>
<geom type="mesh" mesh="b"/></body></body></worldbody>
<actuator><motor joint="turn"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("head", "inside"),
    [
        ('<include file="arm.xml"/>', ""),
        ('<asset><model name="arm" file="arm.xml"/></asset>', '<attach model="arm" prefix="r"/>'),
        ('<asset><model file="arm.xml"/></asset>', '<attach model="arm" body="link0"/>'),
    ],
    ids=["included", "attached", "without a name"],
)
def test_files_of_a_robot_are_neither_counted_nor_loaded(
    tmp_path: Path, head: str, inside: str
) -> None:
    (tmp_path / "arm.xml").write_text(ROBOT, encoding="utf-8")
    for name in ("a.stl", "b.stl"):  # 32 MB, which MuJoCo could not read either
        with (tmp_path / name).open("wb") as file:
            file.truncate(16_000_000)
    (tmp_path / "t.png").write_bytes(png(60_000, 60_000, b""))
    built = parse_scene(scene(inside, head), tmp_path)
    assert built.resolved.description.roles.robots
    assert built.resolved.shapes.model.nmesh == 0
    assert built.spec().compile().ntex == 0
