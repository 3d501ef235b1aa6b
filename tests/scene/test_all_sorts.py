"""Scenes with whatever MuJoCo has: what an arm does not measure does not keep a scene from being
read."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.common.errors import InputError
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene

CUP = """<body name="table" pos="0.5 0 -0.02"><geom type="box" size=".3 .3 .02" friction="0.6"/></body>
  <body name="cup" pos="0.5 0 0.05"><freejoint/><geom name="cup" type="cylinder" size=".03 .05"/></body>"""


def scene(inside: str = "", before: str = "", after: str = "") -> Scene:
    return parse_scene(f"<mujoco>{before}<worldbody>{CUP}{inside}</worldbody>{after}</mujoco>")


def test_a_wrapping_geom_of_a_tendon_is_no_shape() -> None:
    model = scene(
        '<site name="a" pos="0 0 1"/><site name="b" pos="0 1 1"/><geom name="drum" size=".1" pos="0 .5 1"/>',
        after='<tendon><spatial><site site="a"/><geom geom="drum"/><site site="b"/></spatial></tendon>',
    )
    assert list(model.objects) == ["cup"]


@pytest.mark.parametrize("option", ["discardvisual", "fusestatic"])
def test_visual_geoms_and_fused_bodies_are_in_the_model(option: str) -> None:
    visual = """<body name="pad" pos=".7 0 .1"><freejoint/><geom type="box" size=".02 .02 .02" mass="?"/>
      <geom type="box" size=".02 .02 .03" contype="0" conaffinity="0" mass="0"/></body>"""
    with_option = scene(visual, before=f'<compiler {option}="true"/>')
    assert with_option.missing == scene(visual).missing
    assert list(with_option.surfaces) == ["table"]


def test_bodies_with_replicated_parts_are_no_objects_and_remarked() -> None:
    model = scene(
        """<body name="ring" pos="0 0.3 0.3"><freejoint/><replicate count="30" euler="0 0 12">
        <geom type="box" pos="0 -.12 0" size=".013 .005 .1"/></replicate></body>"""
    )
    assert list(model.objects) == ["cup"]
    (message,) = [line for line in remarks(model) if "replicate" in line]
    assert "'ring'" in message


def test_references_to_a_removed_robot_are_removed() -> None:
    model = scene(
        """<body name="arm"><joint name="j" axis="0 0 1"/><geom name="link" size=".05"/></body>""",
        before="""<extension><plugin plugin="mujoco.pid"><instance name="pid">
            <config key="kp" value="40"/></instance></plugin></extension>""",
        after="""<actuator><plugin joint="j" plugin="mujoco.pid" instance="pid" actdim="1"/></actuator>
          <custom><numeric name="n" data="1"/><text name="t" data="link"/>
          <tuple name="both"><element objtype="geom" objname="link"/></tuple></custom>""",
    )
    assert list(model.objects) == ["cup"]
    (message,) = [line for line in remarks(model) if "Robot removed" in line]
    assert "1 tuple" in message
    assert "text" not in message


def test_a_flexible_body_from_a_file_compiles(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "sheet.obj").write_text(
        "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv .1 .1 0\nf 1 2 3\nf 2 4 3\n"
    )
    (tmp_path / "scene.xml").write_text(
        f"""<mujoco><compiler meshdir="meshes"/><worldbody>{CUP}
        <flexcomp name="sheet" type="mesh" file="sheet.obj" dim="2" mass=".1" pos="0 1 1"/>
        </worldbody></mujoco>"""
    )
    assert list(load_scene(tmp_path / "scene.xml", root=tmp_path).objects) == ["cup"]


@pytest.mark.parametrize(("compiler", "joint"), [('alignfree="true"', ""), ("", 'align="true"')])
def test_a_body_is_where_the_file_puts_its_frame(compiler: str, joint: str) -> None:
    lever = f"""<body name="lever" pos="0.6 0.1 0.1"><freejoint {joint}/>
      <geom type="box" size=".1 .02 .02" pos=".1 .02 0" mass="0.2"/></body>"""
    model = scene(lever, before=f"<compiler {compiler}/>")
    assert model.body("lever").pose_world.position == pytest.approx([0.6, 0.1, 0.1])


def test_njmax_reserves_no_memory() -> None:
    model = scene(before='<size njmax="5000" nconmax="5000"/>')
    assert model.spec().compile().narena < 100e6


def test_a_height_field_is_as_high_as_its_highest_point() -> None:
    levels = " ".join(["0"] * 8 + ["1"] * 8)
    text = """<mujoco><asset><hfield name="h" nrow="4" ncol="4" size=".4 .4 .1 .1" elevation="{}"/></asset>
    <worldbody><body name="ground" pos=".5 0 .4"><geom type="hfield" hfield="h"/></body></worldbody></mujoco>"""
    assert parse_scene(text.format(levels)).body("ground").known["height"][0] == pytest.approx(0.5)
    flat = parse_scene(text.format(" ".join(["0"] * 16)))
    assert flat.body("ground").known["height"][0] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("body", "advice"),
    [
        ('<body name="b"><joint type="hinge"/><geom size=".02" mass="?"/></body>', "<freejoint/>"),
        ('<body name="b" mocap="true"><geom size=".02" mass="?"/></body>', "remove mocap"),
    ],
)
def test_an_unknown_in_a_body_that_is_no_object_is_refused_with_the_reason(
    body: str, advice: str
) -> None:
    with pytest.raises(InputError, match=f"'b'.*{advice}"):
        parse_scene(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
