"""Contradictions in a scene's file are said by `gap`, and with the plan."""

from __future__ import annotations

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.mjcf.contacts import find_friction_override
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import parse_scene
from palpate.scene.remarks import contradictions, overlaps, remarks
from palpate.scene.scene import Scene

TABLE = '<body name="table" pos=".5 0 {}"><geom type="box" size=".3 .3 .1"/></body>'
TIN = """<body name="tin" pos=".5 .1 {}"><freejoint/><geom type="cylinder" size=".035 .03"/>
</body>"""
BOX = """<body name="box" pos=".5 .1 {}"><freejoint/><geom type="box" size=".02 .02 .02"/>
</body>"""
HOME = '<keyframe><key name="home" qpos="{}"/></keyframe>'


def read(inside: str, head: str = "", tail: str = "") -> Scene:
    site = '<site name="robot_base"/>'
    return parse_scene(f"<mujoco>{head}<worldbody>{site}{inside}</worldbody>{tail}</mujoco>")


def stack(table: str, tin: str, box: str) -> Scene:
    return read(TABLE.format(table) + BOX.format(box) + TIN.format(tin))


@pytest.mark.parametrize(
    ("box", "depth", "other"), [(".25", 0.03, "tin"), (".28", 0.0, ""), (".19", 0.03, "table")]
)
def test_overlapping_bodies_are_remarked(box: str, depth: float, other: str) -> None:
    tin = TIN.format(".23") if other != "table" else ""
    scene = read(TABLE.format(".1") + BOX.format(box) + tin)
    result = overlaps(scene.resolved)
    if not depth:
        assert not result
        return
    assert {other, "box"} in [set(pair) for pair in result]
    (line,) = contradictions(scene.resolved)
    assert f"overlap by {1e3 * depth:.0f} mm" in line
    assert line in remarks(scene)
    with pytest.raises(PlanRejected, match=r"'box' .*overlap by 30 mm") as rejection:
        SymbolicPlanner().plan(None, scene)
    assert "hangs" not in str(rejection.value)


def test_a_stack_stands_on_a_surface_of_unknown_height() -> None:
    scene = stack("?", ".23", "?")
    assert scene.bodies["box"].bottom_z() == pytest.approx(0.26)
    (line,) = contradictions(scene.resolved)
    assert line == "The z of 'box' is `?`: it is assumed to be on 'tin', whose z is written."
    plan = SymbolicPlanner().plan(None, scene)
    assert {"table.height", "tin.mass", "box.mass"} <= set(map(str, plan.parameters))
    assert line in plan.notes


def test_in_a_bowl_an_object_stands_on_the_bottom() -> None:
    walls = "".join(
        f'<geom type="box" size="{size}" pos="{pos}"/>'
        for size, pos in ((".06 .06 .005", "0 0 .005"), (".005 .06 .03", ".06 0 .03"))
    )
    bowl = f'<body name="bowl" pos=".5 .1 .2"><freejoint/>{walls}</body>'
    scene = read(TABLE.format(".1") + bowl + BOX.format("?"))
    assert scene.bodies["box"].bottom_z() == pytest.approx(0.21)


def test_the_lower_of_two_open_heights_at_one_place_is_measured() -> None:
    with pytest.raises(PlanRejected, match="write the z of the lower body"):
        SymbolicPlanner().plan("how heavy is the box?", stack(".1", "?", "?"))


ARM = """<body name="arm" pos="0 1 0"><geom size=".05"/><body name="link">
<joint name="turn"/><geom size=".05"/></body></body>"""


@pytest.mark.parametrize("arm", ["", ARM])
@pytest.mark.parametrize(("x", "moved"), [(".5", False), (".6", True)])
def test_objects_placed_by_a_keyframe_are_remarked(arm: str, x: str, moved: bool) -> None:
    joint = "1 " if arm else ""
    motor = '<actuator><motor joint="turn"/></actuator>' if arm else ""
    qpos = f"{joint}{x} .1 .23 1 0 0 0"
    scene = read(arm + TABLE.format(".1") + TIN.format(".23"), tail=motor + HOME.format(qpos))
    assert bool(scene.resolved.description.roles.robots) == bool(arm)
    items = [line for line in remarks(scene) if "keyframe 'home' moves or turns 'tin'" in line]
    assert len(items) == moved
    assert SymbolicPlanner().plan(None, scene).notes[:1] == tuple(items)


@pytest.mark.filterwarnings("ignore:.*settotalmass")
@pytest.mark.parametrize(("total", "is_said"), [("2", True), ("-1", False)])
def test_a_compiler_that_scales_masses_is_remarked(total: str, is_said: bool) -> None:
    head = f'<compiler settotalmass="{total}"/>'
    scene = read(TABLE.format(".1") + TIN.format(".23"), head)
    items = [line for line in remarks(scene) if f'settotalmass="{total}"' in line]
    assert len(items) == is_said
    assert SymbolicPlanner().plan(None, scene).notes[:1] == tuple(items)


def test_copies_of_an_object_are_nothing_that_it_stands_on() -> None:
    """One line states the friction of all copies, which decides nothing about other objects."""
    tin = """<body name="tin" pos=".5 .2 .23"><freejoint/>
    <geom type="cylinder" size=".035 .03" friction=".9" priority="1"/></body>"""
    box = """<body name="box" pos=".5 -.2 .22"><freejoint/>
    <geom type="box" size=".02 .02 .02" friction=".5"/></body>"""
    table = (
        '<body name="table" pos=".5 0 .1"><geom type="box" size=".3 .3 .1" friction=".2"/></body>'
    )
    scene = read(f'{table}{box}<replicate count="2" offset="0 -.1 0">{tin}</replicate>')
    assert find_friction_override(scene.resolved.description.bodies["box"]) == ""


def test_a_keyframe_that_is_no_numbers_is_refused() -> None:
    scene = read(TABLE.format(".1") + TIN.format(".23"), tail=HOME.format("1 far 0"))
    with pytest.raises(InputError, match=r'<key name="home"> \(line 2\): qpos: .*\'far\''):
        remarks(scene)


@pytest.mark.parametrize(
    ("quat", "is_said"), [("1 0 0 0", False), ("-2 0 0 0", False), (".7 .7 0 0", True)]
)
def test_a_keyframe_that_turns_an_object(quat: str, is_said: bool) -> None:
    qpos = f".5 .1 .23 {quat}"
    scene = read(TABLE.format(".1") + TIN.format(".23"), tail=HOME.format(qpos))
    items = [line for line in remarks(scene) if "keyframe 'home' moves or turns 'tin'" in line]
    assert bool(items) == is_said


def test_a_keyframe_that_mujoco_would_refuse_is_refused() -> None:
    scene = read(TABLE.format(".1") + TIN.format(".23"), tail=HOME.format("1 2"))
    with pytest.raises(InputError, match=r"qpos has 2 numbers, the scene's joints 7; give 7"):
        remarks(scene)


@pytest.mark.parametrize(("stiffness", "is_said"), [("0", False), ("50", True)])
def test_a_spring_on_an_objects_own_joint_is_remarked(stiffness: str, is_said: bool) -> None:
    joint = f'<joint type="free" stiffness="{stiffness}"/>'
    scene = read(TABLE.format(".1") + TIN.format(".23").replace("<freejoint/>", joint))
    items = [line for line in remarks(scene) if "'tin' in the hand would be wrong" in line]
    assert bool(items) == is_said


def test_memory_that_the_file_reserves_does_not_matter() -> None:
    scene = read(TABLE.format(".1") + TIN.format(".23"), '<size memory="1K"/>')
    assert not overlaps(scene.resolved)
    assert remarks(scene) == ()


def test_a_number_that_mujoco_would_ignore_is_refused() -> None:
    tin = TIN.format(".23").replace("<geom", '<geom mass="NaN"')
    with pytest.raises(
        InputError, match=r'<geom> .*mass="NaN" is not a number; remove .* or write `\?`'
    ):
        read(TABLE.format(".1") + tin)
