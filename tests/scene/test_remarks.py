"""What palpate says of how it read a scene."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.planning.planner import named_parameters
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import parse_scene
from palpate.scene.remarks import remarks

TABLE = '<body name="table" pos="0.5 0 0.2"><geom type="box" size="0.3 0.4 0.02"/></body>'
BALL = '<body name="ball" pos="0.5 0 0.25"><freejoint/><geom size=".03" mass="0.1" friction="1"/></body>'
ARM = """<body name="arm" pos="0 0.2 0"><geom size=".05"/><body name="link">
<joint name="turn"/><geom size=".05"/><camera name="wrist"/></body></body>"""


def read(inside: str, after: str = "") -> tuple[str, ...]:
    return remarks(parse_scene(f"<mujoco><worldbody>{inside}</worldbody>{after}</mujoco>"))


def test_a_complete_scene_has_no_remarks() -> None:
    unknown = BALL.replace('mass="0.1"', "")
    assert read(f'<site name="robot_base"/>{TABLE}{unknown}') == ()


def test_the_assumed_base_of_the_arm_is_remarked() -> None:
    (line,) = read(TABLE + BALL.replace('mass="0.1"', ""))
    assert '<site name="robot_base" pos="x y z"/>' in line


def test_elements_removed_with_the_robot_are_remarked() -> None:
    after = """<actuator><motor joint="turn"/></actuator><sensor><jointpos joint="turn"/></sensor>
    <keyframe><key qpos="1 0 0 0 0 0 0 0"/></keyframe>"""
    watcher = '<camera name="on" mode="targetbody" target="link"/>'
    lines = read(TABLE + BALL + ARM + watcher, after)
    assert lines[0].startswith("Robot removed: 'arm'; the Franka Research 3")
    assert "1 camera, 1 jointpos, 1 key, 1 keyframe, 1 motor" in lines[0]
    assert lines[-1].startswith("No value is missing")


def test_bodies_that_are_neither_object_nor_surface_are_remarked() -> None:
    door = '<body name="door"><joint axis="0 1 0"/><joint/><geom size=".1"/></body>'
    lines = read('<site name="robot_base"/>' + door)
    assert "'door'" in lines[0]
    assert "An object needs a body with a <freejoint/>" in lines[0]
    assert lines[1:] == (
        "There is no object. An object needs a body with a <freejoint/>, and no other joint.",
        "There is no surface: no static body has a name and a level top.",
    )


def test_a_body_that_is_no_robot_can_be_named_as_one() -> None:
    door = '<body name="door"><joint axis="0 1 0"/><joint/><geom size=".1"/></body>'
    site = '<site name="robot_base"/>'
    assert "--robot-body NAME" in read(site + door)[0]
    named = parse_scene(
        f"<mujoco><worldbody>{site}{door}</worldbody></mujoco>", robot_body=["door"]
    )
    assert remarks(named)[0].startswith("Robot removed: 'door'")


def test_objects_out_of_reach_are_remarked_with_advice() -> None:
    far = BALL.replace('mass="0.1"', "").replace("0.5 0 0.25", "0.5 3 0.25")
    assert any(
        "Out of reach of the arm at (0.00, 0.00, 0.00) m: 'ball'" in line
        and '<site name="robot_base" pos="x y z"/>' in line
        for line in read(TABLE + far)
    )
    line, falls = read('<site name="robot_base" pos="0 0 0.1"/>' + TABLE + far)
    assert falls.startswith("'ball' stands on nothing within 20 mm")
    assert "move the site 'robot_base'" in line


def test_static_bodies_that_are_no_surface_are_remarked() -> None:
    wall = '<geom name="wall" type="box" size=".01 .5 .5" pos="1 0 0"/>'
    ramp = '<geom name="ramp" type="box" size=".3 .3 .1" pos="1 0 0" euler="0 30 0"/>'
    lines = read('<site name="robot_base"/>' + wall + ramp + TABLE + BALL)
    assert "'wall' (it is narrower than 0.1 m and carries no object)" in lines[0]
    assert "'ramp' (its top is not level)" in lines[0]
    assert "An object needs a body with a <freejoint/>" in lines[0]


GHOST = """<body name="ghost" pos="0.5 0.2 0.25"><{joint}/>
<geom type="box" size=".03 .03 .03" contype="{mask}" conaffinity="{mask}"/></body>"""
UNKNOWN = '<site name="robot_base"/>' + TABLE + BALL.replace('mass="0.1"', "")


@pytest.mark.parametrize("joint", ["freejoint", 'joint type="slide"'])
@pytest.mark.parametrize("mask", ["0", "2"])
def test_a_body_that_no_hand_touches_leaves_the_rest(joint: str, mask: str) -> None:
    inside = UNKNOWN + GHOST.format(joint=joint, mask=mask)
    scene = parse_scene(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
    assert list(scene.bodies) == ["table", "ball"]
    (line,) = remarks(scene)
    assert "'ghost' is not measured: no geom of it collides with the hand: give one contype" in line
    plan = SymbolicPlanner().plan(None, scene)
    assert plan.tree is not None
    assert plan.notes == (line,)


def test_a_scene_with_an_untouchable_object_only_is_not_complete() -> None:
    ghost = GHOST.format(joint="freejoint", mask="0")
    scene = parse_scene(f"<mujoco><worldbody>{TABLE}{ghost}</worldbody></mujoco>")
    assert not any("Nothing is missing" in line for line in remarks(scene))
    with pytest.raises(PlanRejected, match="'ghost' is not measured"):
        SymbolicPlanner().plan(None, scene)


def test_a_free_body_without_a_shape_leaves_the_rest() -> None:
    frame = """<body name="frame"><freejoint/><site/>
    <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body>"""
    assert read(UNKNOWN + frame) == ("'frame' is not measured: it has no geom.",)


def test_a_geom_without_collisions_is_no_surface() -> None:
    mark = """<geom name="mark" type="box" size=".2 .2 .001" pos=".5 0 .221" contype="0"
    conaffinity="0"/>"""
    (line,) = read(UNKNOWN + mark)
    assert "'mark' (it has no collisions)" in line


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (GHOST.format(joint="freejoint", mask="0"), "no geom of it collides with the hand"),
        ('<body name="ghost"><geom size=".03"/></body>', "'ghost' is static; .*<freejoint/>"),
        ('<body name="ghost"><joint type="ball"/><geom size=".03"/></body>', "<freejoint/>"),
    ],
)
def test_a_request_says_why_a_body_is_no_object(body: str, reason: str) -> None:
    scene = parse_scene(f"<mujoco><worldbody>{UNKNOWN}{body}</worldbody></mujoco>")
    with pytest.raises(InputError, match=f"valid: .*ball.*{reason}"):
        named_parameters(["ghost.mass"], scene)
    with pytest.raises(InputError, match=f"the scene has no 'ghost'; .*{reason}"):
        SymbolicPlanner().plan("how heavy is the ghost?", scene)


def test_the_mass_of_a_surface_needs_a_free_joint() -> None:
    scene = parse_scene(f"<mujoco><worldbody>{UNKNOWN}</worldbody></mujoco>")
    with pytest.raises(InputError, match=r"'table' is a surface, .*<freejoint/>"):
        named_parameters(["table.mass"], scene)
    plan = SymbolicPlanner().plan("how heavy is the table?", scene)
    assert "an object needs a body with a <freejoint/>" in plan.explanation


BOX = """<body name="box" pos="0.5 0 {z}" {body}><freejoint/>
<geom type="box" size=".02 .02 .02" mass="0.3" {geom}/></body>"""
DESK = """<body name="desk" pos="0.5 0 0"><geom type="box" size=".3 .3 .2" {geom}/></body>"""
DRAWER = """<body name="drawer" pos="0.5 0.6 0.4" {body}><joint name="slide" type="slide" range="0 .2"/>
<geom type="box" size=".1 .1 .05" mass="1"/></body>"""


def read_unusual(
    before: str = "",
    after: str = "",
    box: str = "",
    geom: str = "",
    desk: str = "",
    z: float = 0.22,
) -> list[str]:
    """Remarks on a scene of a box on a desk with unusual statements, without that on complete scenes."""
    bodies = BOX.format(z=z, body=box, geom=geom) + DESK.format(geom=desk)
    text = (
        f'<mujoco>{before}<worldbody><site name="robot_base"/>{bodies}</worldbody>{after}</mujoco>'
    )
    return [item for item in remarks(parse_scene(text)) if "No value is missing" not in item]


UNUSUAL: dict[str, tuple[dict[str, Any], str]] = {
    "exclude": (
        {"after": '<contact><exclude body1="desk" body2="box"/></contact>'},
        "'box' passes through what it stands on: <exclude>",
    ),
    "masks": (
        {"geom": 'contype="2"', "desk": 'contype="4" conaffinity="8"'},
        "'box' passes through what it stands on: their contype and conaffinity share no bit",
    ),
    "contact": (
        {"before": '<option><flag contact="disable"/></option>'},
        "No run in this scene as a world, and none in its twin: the world's <option><flag> disables contact",
    ),
    "override": (
        {"before": '<option o_margin=".01"><flag override="enable"/></option>'},
        '<flag override="enable"/>: o_margin, o_solref, o_solimp and o_friction act',
    ),
    "boundmass": (
        {"before": '<compiler boundmass="0.5"/>'},
        "<compiler boundmass=\"0.5\"> raises smaller values, as of 'box'",
    ),
    "boundinertia": (
        {"before": '<compiler boundinertia="0.01"/>'},
        "<compiler boundinertia=\"0.01\"> raises smaller values, as of 'box'",
    ),
    "gravcomp": ({"box": 'gravcomp="1"'}, "of 'box' in the hand would be wrong: gravcomp"),
    "moon": ({"before": '<option gravity="0 0 -1.62"/>'}, "<option gravity> is 1.62 m/s²"),
    "negative friction": ({"geom": 'friction="-0.5"'}, "The friction of 'box' is -0.5"),
    "large friction": ({"desk": 'friction="50"'}, "The friction of 'desk' is 50"),
    "weld": (
        {"after": '<equality><weld body1="box" body2="desk"/></equality>'},
        "of 'box' in the hand would be wrong: it is tied to 'desk' (<equality>)",
    ),
    "floating": ({"z": 0.3}, "'box' stands on nothing within 20 mm"),
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_an_unusual_statement_is_remarked_in_one_line(case: str) -> None:
    statement, line = UNUSUAL[case]
    (result,) = read_unusual(**statement)
    assert result.startswith(line) or line in result


def test_a_pair_collides_in_spite_of_exclusion_and_bits() -> None:
    pair = '<contact><pair geom1="a" geom2="b"/></contact>'
    masks = 'contype="1" conaffinity="2" name='
    assert (
        read_unusual(geom=masks + '"a"', desk='contype="4" conaffinity="8" name="b"', after=pair)
        == []
    )
    assert read_unusual() == []


@pytest.mark.parametrize(
    ("body", "after", "reason"),
    [
        ("", '<equality><joint joint1="slide"/></equality>', "<equality> of its joint"),
        ("", '<equality><weld body1="drawer"/></equality>', "<equality> that ties it"),
        ('gravcomp="1"', "", "gravcomp"),
    ],
)
def test_other_constraints_of_a_fixture_are_remarked(body: str, after: str, reason: str) -> None:
    lines = read('<site name="robot_base"/>' + DRAWER.format(body=body), after)
    assert any(f"acts on 'drawer': {reason}" in line for line in lines)
    assert not any("acts on" in line for line in read(DRAWER.format(body="")))


def test_a_driven_drawer_is_no_robot_if_the_user_says_so() -> None:
    motor = '<actuator><position joint="slide"/></actuator>'
    text = f"<mujoco><worldbody>{DRAWER.format(body='')}</worldbody>{motor}</mujoco>"
    assert any("keep it by --robot-body none" in line for line in remarks(parse_scene(text)))
    kept = remarks(parse_scene(text, robot_body=["none"]))
    assert any("More than its own joint acts on 'drawer': <actuator>" in line for line in kept)
