"""What is known, missing and assumed, by MJCF's own rules."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.mjcf.reading import parse_document
from palpate.mjcf.roles import find_roles
from palpate.scene.load import parse_scene
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene
from palpate.twin.inject import inject, unfilled_unknowns


def scene(world: str, before: str = "", after: str = "") -> Scene:
    return parse_scene(f"<mujoco>{before}<worldbody>{world}</worldbody>{after}</mujoco>")


def cup(geom: str, inside: str = "", pos: str = "0.5 0 0.05") -> str:
    return f'<body name="cup" pos="{pos}"><freejoint/>{inside}<geom type="box" size="0.02 0.03 0.05" {geom}/></body>'


INERTIAL = '<inertial pos="0 0 0.01" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>'


@pytest.mark.parametrize(
    ("geom", "missing"),
    [
        ("", {"mass", "friction"}),
        ('mass="0.2"', {"friction"}),
        ('density="700"', {"friction"}),
        ('mass="?"', {"mass", "friction"}),
        ('density="?" friction="0.4"', {"mass"}),
        ('mass="0.2" friction="0.4 0.005 0.0001"', set()),
        ('mass="0.2" friction="? 0.005 0.0001"', {"friction"}),
        ('mass="0.2" friction="?"', {"friction"}),
        ('mass="0" friction="0.4"', set()),
    ],
)
def test_an_object_misses_mass_and_friction(geom: str, missing: set[str]) -> None:
    if 'mass="0"' in geom:
        geom += '/><geom type="sphere" size="0.01" mass="0.1"'
    body = scene(cup(geom)).objects["cup"]
    assert body.missing == missing
    assert set(body.known) == {"mass", "friction", "position"} - missing
    assert body.assumed == {"com", "inertia"}


@pytest.mark.parametrize(
    ("inertial", "missing"),
    [
        (INERTIAL, set()),
        (INERTIAL.replace("0.2", "?"), {"mass"}),
        (INERTIAL.replace("0 0 0.01", "? ? ?"), {"com"}),
        (INERTIAL.replace("0 0 0.01", "0 0 ?"), {"com"}),
        (INERTIAL.replace("0 0 0.01", " ? "), {"com"}),
        (INERTIAL.replace("1e-4 1e-4 1e-4", "? ? ?"), {"inertia"}),
        ('<inertial pos="0 0 0" mass="?" fullinertia="? ? ? ? ? ?"/>', {"mass", "inertia"}),
        (INERTIAL.replace(' mass="0.2"', ""), {"mass"}),
        (INERTIAL.replace(' pos="0 0 0.01"', ""), {"com"}),
        ('<inertial pos="0 0 0" mass="0.2"/>', {"inertia"}),
    ],
)
def test_inertials_state_mass_com_and_inertia(inertial: str, missing: set[str]) -> None:
    body = scene(cup('friction="0.4"', inertial)).objects["cup"]
    assert body.missing == missing
    assert body.assumed == set()
    assert set(body.known) == {"mass", "com", "inertia", "friction", "position"} - missing


def test_stated_values_are_known_with_their_numbers() -> None:
    known = scene(cup('friction="0.4"', INERTIAL)).objects["cup"].known
    assert known["mass"] == pytest.approx((0.2,))
    assert known["com"] == pytest.approx((0, 0, 0.01))
    assert known["inertia"] == pytest.approx((1e-4, 1e-4, 1e-4, 0, 0, 0), abs=1e-12)
    assert known["friction"] == pytest.approx((0.4,))
    assert known["position"] == pytest.approx((0.5, 0))


def test_defaults_classes_state_values_too() -> None:
    defaults = (
        '<default><default class="wood"><geom density="600" friction="0.5"/></default></default>'
    )
    body = scene(cup('class="wood"'), defaults).objects["cup"]
    assert body.missing == set()
    assert body.known["mass"] == pytest.approx((600 * 0.04 * 0.06 * 0.1,))
    unknown = '<default><default class="wood"><geom density="?" friction="? 0.01 0.001"/></default></default>'
    assert scene(cup('class="wood"'), unknown).objects["cup"].missing == {"mass", "friction"}


def test_visual_geoms_do_not_count_for_friction() -> None:
    body = scene(
        cup(
            'mass="1"/><geom type="sphere" size="0.01" mass="0" contype="0" '
            'conaffinity="0" friction="0.9"'
        )
    )
    assert body.objects["cup"].missing == {"friction"}


@pytest.mark.parametrize(
    ("pos", "missing"),
    [
        ("? ? 0.05", {"position"}),
        ("0.5 ? 0.05", {"position"}),
        ("?", {"position"}),
        ("0.5 0 ?", set()),
    ],
)
def test_the_position_of_an_object_may_be_missing(pos: str, missing: set[str]) -> None:
    body = scene(cup('mass="1" friction="1"', pos=pos)).objects["cup"]
    assert body.missing == missing


@pytest.mark.parametrize(
    "surface",
    [
        '<body name="table" pos="0.5 0 ?"><geom type="box" size="0.3 0.3 0.02"/></body>',
        '<body name="table" pos="0.5 0 0"><geom type="box" size="0.3 0.3 0.02" pos="0 0 ?"/></body>',
        '<body name="table" pos="0.5 0 0"><geom type="box" size="0.3 0.3 ?"/></body>',
        '<body name="table" pos="0.5 0 ?"><geom type="box" size="0.3 0.3 ?"/></body>',
        '<geom name="table" type="box" pos="0.5 0 ?" size="0.3 0.3 0.02"/>',
        '<geom name="table" type="box" pos="0.5 0 ?" size="0.3 0.3 ?"/>',
        '<geom name="table" type="cylinder" pos="0.5 0 0" size="0.3 ?"/>',
        '<geom name="table" type="plane" pos="0.5 0 ?" size="1 1 0.1"/>',
    ],
)
def test_height_of_a_surface_is_missing_by_any_of_its_numbers(surface: str) -> None:
    model = scene(surface + cup('mass="1" friction="1"', pos="0.5 0 0.35"))
    assert [str(parameter) for parameter in model.missing] == ["table.height"]
    assert model.surfaces["table"].top_z() == pytest.approx(0.30)
    assert model.priors[model.missing[0]] == pytest.approx((0.30,))


def test_a_stated_height_is_known() -> None:
    model = scene(
        '<geom name="floor" type="plane" size="0 0 1"/>'
        '<body name="table" pos="0.5 0 0.4"><geom type="box" size="0.3 0.3 0.02"/></body>'
    )
    assert model.missing == ()
    assert {n: s.known["height"] for n, s in model.surfaces.items()} == {
        "floor": pytest.approx((0,)),
        "table": pytest.approx((0.42,)),
    }


def test_walls_balls_and_nameless_bodies_are_no_surfaces() -> None:
    model = scene(
        '<geom name="wall" type="box" size="0.01 0.5 0.5"/><geom name="ball" type="sphere" size="0.2"/>'
        '<geom type="box" size="0.3 0.3 0.1"/>'
        '<body name="goal" mocap="true"><geom type="box" size=".2 .2 .1"/></body>'
        '<geom name="ramp" type="box" size="0.3 0.3 0.1" euler="0 30 0"/>'
    )
    assert dict(model.surfaces) == {}


def test_a_narrow_stand_is_a_surface_when_something_stands_on_it() -> None:
    stand = '<geom name="stand" type="cylinder" size="0.03 0.1" pos="0.5 0 0.1"/>'
    assert "stand" not in scene(stand).surfaces
    assert "stand" in scene(stand + cup("", pos="0.5 0 0.25")).surfaces


ARM = """<body name="link0" pos="0.1 0.2 0.3" euler="0 0 90"><geom type="box" size="0.1 0.1 0.1"/>
  <body name="link1"><joint name="j1"/><geom size="0.05"/><site name="tip"/></body></body>"""
DRIVEN = """<actuator><motor name="m1" joint="j1"/></actuator><sensor><jointpos name="s1" joint="j1"/>
  <actuatorfrc actuator="m1"/></sensor><keyframe><key qpos="0"/></keyframe>
  <contact><exclude body1="link0" body2="link1"/></contact>"""


def test_a_robot_in_the_scene_is_neither_object_nor_surface_and_marks_the_base() -> None:
    result = scene(ARM + cup(""), after=DRIVEN)
    assert list(result.bodies) == ["cup"]
    assert result.pose_world_base.position == pytest.approx([0.1, 0.2, 0.3])
    assert result.pose_world_base.rotation[:, 0] == pytest.approx([0, 1, 0])
    model = result.spec().compile()
    assert {model.body(i).name for i in range(model.nbody)} == {"world", "cup"}
    assert (model.nu, model.nsensor, model.nkey, model.nexclude) == (0, 0, 0, 0)


def test_a_robot_on_a_table_leaves_the_table() -> None:
    table = f'<body name="table" pos="0 0 0.4"><geom type="box" size="0.5 0.5 0.02"/>{ARM}</body>'
    model = scene(table + cup("", pos="0.3 0 0.47"), after=DRIVEN)
    assert list(model.bodies) == ["table", "cup"]


def test_the_mount_below_the_arm_is_no_surface() -> None:
    mount = '<geom name="mount" type="box" size="0.1 0.1 0.2" pos="0 0 0.2"/><site name="robot_base" pos="0 0 0.4"/>'
    model = scene(mount + cup(""))
    assert list(model.bodies) == ["cup"]
    assert model.pose_world_base.position == pytest.approx([0, 0, 0.4])


def test_driven_by_a_tendon_is_a_robot_too() -> None:
    after = (
        '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'
        '<actuator><motor tendon="t"/></actuator>'
    )
    assert list(scene(ARM + cup(""), after=after).bodies) == ["cup"]


OVEN = "".join(f'<body name="part_{i}"><joint/><geom size=".02"/></body>' for i in range(8))


@pytest.mark.parametrize(
    "inside",
    [
        f'<body name="oven"><geom size=".1"/>{OVEN}</body>',
        '<body name="oven"><joint/><geom size=".1"/><body name="door_handle"/></body>',
    ],
)
def test_furniture_with_many_joints_is_no_robot(inside: str) -> None:
    model = scene(inside + cup(""))
    assert model.resolved.description.roles.robots == []
    assert list(model.objects) == ["cup"]


def test_an_arm_that_nothing_drives_is_known_by_its_hand() -> None:
    hand = ARM.replace('<site name="tip"/>', '<body name="left_hand"><geom size=".02"/></body>')
    assert [r.get("name") for r in scene(hand + cup("")).resolved.description.roles.robots] == [
        "link0"
    ]
    soap = '<body name="hand_soap" pos="0.5 0 1"><joint type="free"/><geom size=".03"/></body>'
    assert list(scene(soap).objects) == ["hand_soap"]


def test_objects_around_a_robot_are_not_part_of_it() -> None:
    room = f'<body name="room">{ARM}<body name="drawer"><joint/><geom size=".1"/></body></body>'
    robots = scene(room + cup(""), after=DRIVEN).resolved.description.roles.robots
    assert [robot.get("name") for robot in robots] == ["link0"]


def test_the_user_decides_where_a_robot_begins() -> None:
    text = f"<mujoco><worldbody>{ARM}{OVEN}{cup('')}</worldbody>{DRIVEN}</mujoco>"

    def robots(*named: str) -> list[str | None]:
        roles = parse_scene(text, robot_body=named).resolved.description.roles
        return [robot.get("name") for robot in roles.robots]

    assert robots() == ["link0"]
    assert robots("part_3", "part_1") == ["part_1", "part_3"]
    assert robots("none") == []
    assert parse_scene(text, robot_body=["none"]).spec().compile().nu == 1
    with pytest.raises(InputError, match=r"'link9'.*valid: .*link0.*part_7"):
        robots("link9")


def test_a_cupboard_with_a_door_is_left_standing() -> None:
    model = scene(ARM + cup(""))
    assert list(model.objects) == ["cup"]
    assert model.spec().compile().body("link1").name == "link1"


@pytest.mark.parametrize(
    ("world", "complaint"),
    [
        ('<body name="a"><freejoint/></body>', "mass and inertia"),
        (cup("") + '<geom name="cup" type="box" size="1 1 1"/>', "called 'cup'"),
        (cup('rgba="? 0 0 1"'), "cannot be measured"),
        (cup("", pos="? 0"), "MuJoCo does not accept|too few"),
        ('<body name="a" euler="0 0 ?"><freejoint/><geom size="1"/></body>', "cannot be measured"),
        ('<geom name="t" type="box" pos="? 0 0" size="1 1 1"/>', "for a surface's height"),
        ('<geom name="t" type="box" size="? 1 1"/>', "for a surface's height|cannot be measured"),
        ('<camera name="c" pos="0 0 ?"/>', "cannot be measured"),
        (
            '<body name="t"><geom type="box" size="1 1 ?"/><geom type="box" size="1 1 ?"/></body>',
            "several geoms",
        ),
        (
            '<geom name="t" type="box" pos="0 0 ?" size=".3 .3 .1" euler="0 0 0"/><geom type="box" size="1 1 ?"/>',
            "cannot be measured",
        ),
    ],
)
def test_ambiguous_scenes_are_refused(world: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        scene(world)


def test_a_tilted_surface_cannot_leave_its_height_open() -> None:
    with pytest.raises(InputError, match="straight up"):
        scene(
            '<body name="t" euler="90 0 0"><geom type="box" size="0.3 0.3 0.3" pos="0 0 ?"/></body>'
        )


def test_missing_is_in_document_order() -> None:
    text = (
        cup("") + '<body name="a" pos="0.4 0.3 0.05"><freejoint/><geom size="0.05"/></body>'
        '<geom name="table" type="box" pos="0.5 0 ?" size="0.3 0.3 0.02"/>'
    )
    missing = [str(g) for g in scene(text).missing]
    assert missing == ["cup.mass", "cup.friction", "a.mass", "a.friction", "table.height"]


def test_bodies_inside_plain_frames_are_found() -> None:
    document = parse_document(f"<mujoco><worldbody><frame>{cup('')}</frame></worldbody></mujoco>")
    assert list(find_roles(document).objects) == ["cup"]


def test_a_plane_without_a_name_is_the_floor() -> None:
    text = f'<mujoco><worldbody><geom type="plane" size="2 2 .1"/>{cup("")}</worldbody></mujoco>'
    floor = parse_scene(text).surfaces["floor"]
    assert floor.known["height"] == (0.0,)


def test_a_free_body_without_a_name_is_named_after_its_shape() -> None:
    ball = '<body pos="0.5 {y} 0.27"><freejoint/><geom size=".03"/></body>'
    mug = '<body pos="0.5 0.3 0.27"><freejoint/><geom name="mug" type="box" size=".03 .03 .05"/></body>'
    model = scene(ball.format(y=0) + ball.format(y=0.2) + mug)
    assert list(model.objects) == ["sphere", "sphere_2", "mug"]
    assert model.spec().compile().body("sphere_2").name == "sphere_2"
    assert 'name="sphere_2"' not in model.text


@pytest.mark.parametrize(
    ("opening", "name"),
    [
        ('<replicate count="3" offset="0 0.2 0">', "mug0"),
        ('<replicate count="12" sep="_" offset="0 0.2 0">', "mug_00"),
        ('<frame pos="0 0.1 0"><replicate count="3" offset="0 0.2 0">', "mug0"),
        (
            '<replicate count="2" sep="-" offset="0 .2 0"><replicate count="3" offset=".2 0 0">',
            "mug0-0",
        ),
    ],
)
def test_the_first_copy_represents_all_copies(opening: str, name: str) -> None:
    tags = [tag.split()[0].strip("<>") for tag in opening.split("><")]
    closing = "".join(f"</{tag}>" for tag in reversed(tags))
    text = (
        f"<mujoco><worldbody>{opening}{cup('').replace('cup', 'mug')}{closing}</worldbody></mujoco>"
    )
    parsed_scene = parse_scene(text)
    assert [str(parameter) for parameter in parsed_scene.missing] == [
        f"{name}.mass",
        f"{name}.friction",
    ]
    twin = inject(text, {Parameter(name, "mass"): (0.2,), Parameter(name, "friction"): (0.3,)})
    model = mujoco.MjModel.from_xml_string(twin)
    assert model.body_mass[1:] == pytest.approx([0.2] * (model.nbody - 1))
    assert model.geom_friction[:, 0] == pytest.approx([0.3] * model.ngeom)


def test_the_position_of_a_copy_cannot_be_measured() -> None:
    text = '<replicate count="2" offset="0 .2 0">' + cup("", pos="? 0 0.05") + "</replicate>"
    with pytest.raises(InputError, match="inside a <replicate>"):
        scene(text)


def test_an_inertial_without_its_mass_is_completed() -> None:
    unweighed = INERTIAL.replace(' mass="0.2"', "")
    text = f"<mujoco><worldbody>{cup('', unweighed)}</worldbody></mujoco>"
    assert unfilled_unknowns(text) == [Parameter("cup", "mass")]
    twin = inject(text, {Parameter("cup", "mass"): (0.25,)})
    assert mujoco.MjModel.from_xml_string(twin).body("cup").mass[0] == pytest.approx(0.25)


PANDA = """<mujoco model="panda"><worldbody><body name="link0" pos="0.1 0 0"><geom size=".05"/>
<body name="link1"><joint name="j"/><geom size=".05"/></body></body></worldbody>
<actuator><motor name="m" joint="j"/></actuator></mujoco>"""
SHELF = """<mujoco><worldbody><body name="shelf"><geom type="box" size=".3 .3 .1"/></body>
<body name="tin"><freejoint/><geom size=".05" {}/></body></worldbody></mujoco>"""


def attaching(folder: Path, sub: str) -> Scene:
    (folder / "panda.xml").write_text(PANDA)
    (folder / "shelf.xml").write_text(sub)
    return parse_scene(
        """<mujoco><asset><model file="panda.xml"/><model name="s" file="shelf.xml"/></asset>
        <worldbody><frame pos="0 0.5 0"><attach model="panda" body="link0" prefix="left_"/></frame>
        <attach model="s" prefix="s_"/></worldbody>
        <contact><exclude body1="left_link0" body2="left_link1"/></contact></mujoco>""",
        folder,
    )


def test_an_attached_robot_makes_way_and_what_else_is_attached_stays(tmp_path: Path) -> None:
    result = attaching(tmp_path, SHELF.format(""))
    assert result.pose_world_base.position == pytest.approx([0.1, 0.5, 0])
    model = result.spec().compile()
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "s_shelf", "s_tin"]
    assert (model.nu, model.nexclude) == (0, 0)
    lines = remarks(result)
    assert lines[0].startswith("Robot removed: 'panda'")
    assert [body.role for body in result.bodies.values()] == ["surface", "object"]


def test_a_robot_of_a_whole_attached_world_stands_where_that_has_it(tmp_path: Path) -> None:
    (tmp_path / "panda.xml").write_text(
        PANDA.replace("<worldbody>", '<compiler angle="radian"/><worldbody><frame pos="0 0 1">')
        .replace("</worldbody>", "</frame></worldbody>")
        .replace('pos="0.1 0 0"', 'pos="0.1 0 0" euler="0 0 1.570796"')
    )
    parsed_scene = parse_scene(
        """<mujoco><asset><model file="panda.xml"/></asset>
        <worldbody><attach model="panda" prefix="p_"/></worldbody></mujoco>""",
        tmp_path,
    )
    assert parsed_scene.pose_world_base.position == pytest.approx([0.1, 0, 1])
    assert parsed_scene.pose_world_base.rotation[:, 0] == pytest.approx([0, 1, 0], abs=1e-6)


def test_the_first_attachment_represents_all_attachments(tmp_path: Path) -> None:
    (tmp_path / "shelf.xml").write_text(SHELF.format(""))
    parsed_scene = parse_scene(
        """<mujoco><asset><model name="s" file="shelf.xml"/></asset><worldbody>
        <attach model="s" body="tin" prefix="a_"/><frame pos="0 1 0">
        <attach model="s" body="tin" prefix="b_"/></frame></worldbody></mujoco>""",
        tmp_path,
    )
    assert list(parsed_scene.bodies) == ["a_tin"]
    assert any("not at 'b_tin'" in line for line in remarks(parsed_scene))


def test_an_unknown_in_an_attached_model_is_one_of_the_scene(tmp_path: Path) -> None:
    model = attaching(tmp_path, SHELF.format('mass="?" friction="0.4"'))
    assert model.missing == (Parameter("s_tin", "mass"),)
    with pytest.raises(InputError, match=r"<geom>.*cannot be measured"):
        attaching(tmp_path, SHELF.format('margin="?"'))
