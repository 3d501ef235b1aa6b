"""The hidden world: it matches the scene, and its truth is only told when asked for."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.common.errors import ExecutionAborted, InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.robot import Robot
from palpate.scene.load import parse_scene
from palpate.trace.samples import Samples

CELL = """<mujoco>{option}<worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 {table}"><geom type="box" size=".5 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="{name}" pos="0.5 0.1 0.05">{joint}<geom type="box" size="{size}" {mass} {friction}/></body>
</worldbody></mujoco>"""
DEFAULTS = {
    "option": "",
    "table": "?",
    "name": "cup",
    "joint": "<freejoint/>",
    "size": ".03 .02 .05",
    "mass": "",
    "friction": 'friction="0.5"',
}


def text(**changes: str) -> str:
    return CELL.format(**(DEFAULTS | changes))


def world_file(folder: Path, **changes: str) -> Path:
    path = folder / "world.xml"
    path.write_text(text(**({"table": "-0.02", "mass": 'mass="0.3"'} | changes)), encoding="utf-8")
    return path


def test_unknowns_without_a_world_are_drawn_by_the_seed() -> None:
    scene = parse_scene(text())
    one, again, other = (simulated_cell(scene, seed=seed) for seed in (1, 1, 2))
    assert one.world is scene
    assert set(one.drawn) == {Parameter("cup", "mass"), Parameter("table", "height")}
    assert one.drawn == again.drawn
    assert one.drawn != other.drawn
    drawn = one.drawn[Parameter("cup", "mass")]
    assert one.truth(Parameter("cup", "mass")) == pytest.approx(drawn, rel=1e-6)
    # The cup's own 0.5 does not act: MuJoCo takes the larger one, the table's.
    assert one.truth(Parameter("cup", "friction")) == (0.6,)
    assert "drawn from priors" in one.description


def test_the_drawn_truth_is_what_the_world_is_made_of() -> None:
    cell = simulated_cell(parse_scene(text()), noise="none", seed=3)
    model = cell.robot().world.model
    assert model.body("cup").mass[0] == pytest.approx(
        cell.truth(Parameter("cup", "mass"))[0], rel=1e-6
    )
    top = model.geom_pos[model.body("table").geomadr[0], 2] + model.body("table").pos[2] + 0.02
    assert top == pytest.approx(cell.truth(Parameter("table", "height"))[0], abs=1e-6)


def test_a_worlds_file_holds_the_truth(tmp_path: Path) -> None:
    cell = simulated_cell(parse_scene(text()), world_file(tmp_path))
    assert cell.drawn == {}
    assert cell.truth(Parameter("cup", "mass")) == (0.3,)
    assert cell.truth(Parameter("table", "height")) == pytest.approx((0.0,))
    # Of a box of 60 x 40 x 100 mm: m (b² + c²) / 12.
    inertia = cell.truth(Parameter("cup", "inertia"))
    assert inertia == pytest.approx((2.9e-4, 3.4e-4, 1.3e-4, 0, 0, 0), abs=1e-9)
    assert cell.truth(Parameter("kettle", "mass")) is None
    assert cell.description == "simulated world world.xml"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "mug"}, "the world has no cup; it has table, mug"),
        (
            {"joint": "", "size": ".3 .3 .05"},
            "'cup' is an object in the scene and a surface in the world",
        ),
        (
            {"size": ".03 .02 .08"},
            r"'cup' measures \[0.06, 0.04, 0.1\] m in the scene and \[0.06, 0.04, 0.16\] m in",
        ),
    ],
)
def test_a_world_that_is_not_the_scenes_is_refused(
    tmp_path: Path, changes: dict[str, str], message: str
) -> None:
    world = world_file(tmp_path, **changes)
    with pytest.raises(InputError, match=f"scene and world do not match: {message}"):
        simulated_cell(parse_scene(text()), world)


def test_objects_of_a_picture_have_names_and_shapes_of_their_own(tmp_path: Path) -> None:
    world = world_file(tmp_path, size=".03 .04 .08")
    seen = parse_scene(text().replace('"cup"', '"beaker"'))
    cell = simulated_cell(seen, world, seen=True)
    named = simulated_cell(parse_scene(text()), world, seen=True)
    assert cell.truth(Parameter("beaker", "mass")) == named.truth(Parameter("cup", "mass"))
    assert cell.truth(Parameter("beaker", "mass")) is not None
    with pytest.raises(InputError, match="do not match"):
        simulated_cell(parse_scene(text()), world)


def test_a_detected_object_without_a_partner_has_no_truth(tmp_path: Path) -> None:
    seen = parse_scene(text().replace("0.5 0.1 0.05", "0.2 -0.3 0.05"))
    cell = simulated_cell(seen, world_file(tmp_path), seen=True)
    assert cell.truth(Parameter("cup", "mass")) is None


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ('gravity="0 0 0"', r"gravity is \(0, 0, 0\) m/s²; it must point down"),
        ('gravity="0 0 9.81"', "it must point down"),
        ('gravity="4 0 -9"', "it must point down"),
        ('><flag gravity="disable"/></option', "disables gravity"),
        ('><flag contact="disable" equality="disable"/></option', "disables contact, equality"),
    ],
)
def test_a_world_in_which_nothing_can_be_weighed_is_refused(option: str, message: str) -> None:
    option = f"<option {option}/>" if ">" not in option else f"<option{option}>"
    cell = simulated_cell(parse_scene(text(option=option)))
    with pytest.raises(InputError, match=message):
        cell.robot()


def test_objects_are_lighter_on_the_moon() -> None:
    scene = parse_scene(text(option='<option gravity="0 0 -1.62"/>'))
    robot = simulated_cell(scene, noise="none").robot()
    assert robot.gravity == pytest.approx(1.62)
    robot.advance(0.2)
    assert np.abs(robot.state.wrench).max() < 1e-6


BASE = '<site name="robot_base" pos="{x} 0 0" euler="0 0 {yaw}"/>'
HIDDEN = """
model:
  joint_offset: 2e-3
  link_length: 5e-4
  base_position: 1e-3
  base_tilt: 1e-3
  gravity: 0.02
  hand_mass: 0.05
  joint_compliance: 1e-4
  tip_offset: 1e-3
  finger_width: 1e-3
pose: {repeatability: 1e-3, encoder_ripple: {size: 1e-4}}
"""


def elsewhere(folder: Path, name: str, *, gravity: float, x: float, hidden: str) -> SimulatedCell:
    """A cell whose world differs from the scene in what nobody is told."""
    (folder / f"{name}.yaml").write_text(hidden)
    base = BASE.format(x=x, yaw=0.01 * x)
    world = text(table="-0.02", mass='mass="0.3"', option=f'<option gravity="0 0 {gravity}"/>')
    (folder / f"{name}.xml").write_text(world.replace('<site name="robot_base"/>', base))
    scene = parse_scene(text())
    return simulated_cell(scene, folder / f"{name}.xml", noise=str(folder / f"{name}.yaml"))


def moved(robot: Robot) -> Samples:
    robot.move_joints(robot.state.q + 0.1)
    robot.advance(0.6)
    return robot.drain()


def felt_by(nominal: NominalArm, samples: Samples) -> Array:
    """The wrenches (n, 6) that the nominal arm makes of the joint torques."""
    jacobians = nominal.kinematics(samples.q).jacobian
    return wrenches(jacobians, samples.tau_ext[:, :, None])[:, :, 0]


def test_hidden_values_reach_neither_robot_nor_scene(tmp_path: Path) -> None:
    scene = parse_scene(text())
    worlds = [
        elsewhere(tmp_path, "plain", gravity=-9.81, x=0.0, hidden="extends: none"),
        elsewhere(tmp_path, "other", gravity=-9.79, x=0.004, hidden=HIDDEN),
    ]
    robots = [cell.robot() for cell in worlds]
    truths = [robot.world.true_tcp().position for robot in robots]
    assert np.linalg.norm(truths[0] - truths[1]) > 1e-3, "they do differ"
    down = np.array([0.0, 0.0, -scene.gravity])
    nominal = NominalArm(scene.arm, scene.pose_world_base, down)
    for robot in robots:
        assert robot.hand == scene.arm.nominal
        assert robot.gravity == scene.gravity
        assert robot.limits is scene.arm.limits
        samples = moved(robot)
        place = nominal.poses(samples.q)[:, :3]
        assert samples.pose_world_tcp[:, :3] == pytest.approx(place, abs=5e-3)
        assert samples.wrench == pytest.approx(felt_by(nominal, samples), abs=0.05)
        resting = robot.state
        assert resting.target_world_tcp.distance_to(resting.pose_world_tcp) < 5e-3


def test_an_estimator_hears_of_the_datasheet_alone(tmp_path: Path) -> None:
    told = "datasheet: {torque_gain_max: 0.03, tip_offset: 0.0095, tip_offset_std: 1e-3}\n"
    hidden = "model: {tip_offset: {fixed: 2e-4}}\ntorque: {gain_max: 0.2, white: 5}"
    cell = elsewhere(tmp_path, "told", gravity=-9.81, x=0.0, hidden=told + hidden)
    hand = cell.robot().hand
    assert (hand.torque_gain, hand.tip_offset, hand.tip_offset_std) == (0.03, 0.0095, 1e-3)
    assert hand.force_repeatability == cell.world.arm.nominal.force_repeatability, "not said"


WORLD = """<mujoco>{before}<worldbody><site name="robot_base"/>
  <body name="table" pos="0.5 0 0.2"><geom name="table" type="box" size=".3 .4 .02" {table}/></body>
  <body name="cup" pos="0.5 0.1 {z}"><freejoint/>{inertial}<geom name="cup" type="box" size=".02 .03 .05" {cup}/></body>
  <body name="drawer" pos="0.3 -.6 .3"><joint name="slide" type="slide" axis="1 0 0" {joint}/>
    <geom name="handle" type="box" size=".02 .02 .02"/></body>
</worldbody>{after}</mujoco>"""
EMPTY = dict.fromkeys(("before", "table", "inertial", "cup", "joint", "after"), "") | {"z": "0.27"}
INERTIAL = '<inertial pos="0 0 .01" mass=".3" diaginertia="1e-3 1e-4 1e-4"/>'
PAIR = '<contact><pair geom1="table" geom2="cup" {}/></contact>'


def as_compiled(model: mujoco.MjModel) -> dict[str, Array]:
    """All that a world's file decides of its bodies, geoms, joints and pairs."""
    found: dict[str, Array] = {}
    for name in ("table", "cup", "drawer"):
        body = model.body(name)
        found |= {f"{name} {key}": getattr(body, key) for key in ("mass", "inertia", "ipos", "pos")}
    for name in ("table", "cup", "handle"):
        geom = model.geom(name)
        keys = ("friction", "condim", "priority", "solref", "solimp", "margin")
        found |= {f"{name} {key}": getattr(geom, key) for key in keys}
    joint = model.joint("slide")
    keys = ("damping", "frictionloss", "stiffness", "range", "armature")
    found |= {key: getattr(joint, key) for key in keys}
    scene = {model.geom(name).id for name in ("table", "cup")}
    ends = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    of_scene = [set(pair) == scene for pair in ends]
    return found | {"pairs": model.pair_friction[of_scene].ravel()}


@pytest.mark.parametrize(
    ("changes", "truth"),
    [
        # Nothing stated: MuJoCo's density of 1000 kg/m³ and friction of 1.
        ({}, {"cup.mass": 0.24, "cup.friction": 1.0, "drawer.damping": 0.0}),
        ({"table": 'friction="0.3"'}, {"cup.friction": 1.0}),
        ({"cup": 'friction="0.2"', "table": 'friction="0.3"'}, {"cup.friction": 0.3}),
        ({"cup": 'condim="1"', "table": 'condim="1"'}, {"cup.friction": 0.0}),
        ({"cup": 'condim="1"'}, {"cup.friction": 1.0}),
        (
            {"before": '<default><geom friction="0.35" density="300"/></default>'},
            {"cup.mass": 0.072, "cup.friction": 0.35},
        ),
        (
            {
                "before": '<default><default class="slippery"><geom friction=".15" priority="1"/></default></default>',
                "cup": 'class="slippery"',
            },
            {"cup.friction": 0.15},
        ),
        ({"after": PAIR.format("")}, {"cup.friction": 1.0}),
        (
            {"after": PAIR.format(""), "cup": 'friction="0.2"', "table": 'friction="0.3"'},
            {"cup.friction": 1.0},
        ),
        ({"after": PAIR.format('friction="0.45 0.45"')}, {"cup.friction": 0.45}),
        ({"after": PAIR.format('condim="1"')}, {"cup.friction": 0.0}),
        ({"before": '<compiler settotalmass="3"/>'}, {"cup.mass": 0.0369155}),
        ({"before": '<compiler boundmass="2" boundinertia="0.01"/>'}, {"cup.mass": 2.0}),
        (
            {"before": '<compiler inertiafromgeom="true"/>', "inertial": INERTIAL},
            {"cup.mass": 0.24},
        ),
        ({"before": '<compiler balanceinertia="true"/>', "inertial": INERTIAL}, {"cup.mass": 0.3}),
        (
            {"joint": 'damping="3" frictionloss="2"'},
            {"drawer.damping": 3.0, "drawer.frictionloss": 2.0},
        ),
        ({"joint": 'springdamper="0.2 1"'}, {"drawer.damping": 0.64, "drawer.spring": 1.6}),
        ({"table": 'solref="-2000 -50" solimp=".1 .1 .001"'}, {"table.height": 0.22}),
        (
            {"before": '<option><flag override="enable"/></option>', "cup": 'friction=".2"'},
            {"cup.friction": 1.0},
        ),
        ({"z": "0.275"}, {"cup.friction": 1.0}),
        ({"after": '<keyframe><key qpos="0 0 1 1 0 0 0 0"/></keyframe>'}, {"cup.mass": 0.24}),
    ],
)
def test_a_world_is_its_file_as_mujoco_compiles_it(
    tmp_path: Path, changes: dict[str, str], truth: dict[str, float]
) -> None:
    """No prior fills it, and the truth is what acts."""
    path, scene = tmp_path / "world.xml", parse_scene(WORLD.format(**EMPTY))
    path.write_text(WORLD.format(**EMPTY | changes))
    cell = simulated_cell(scene, path, noise="none")
    wanted, made = mujoco.MjModel.from_xml_path(str(path)), cell.robot().world.model
    for key, value in as_compiled(wanted).items():
        assert as_compiled(made)[key] == pytest.approx(value, rel=1e-6), key
    # The arm in it keeps its own masses.
    alone = simulated_cell(scene, noise="none").robot().world.model
    assert made.body("robot/fr3_link5").mass == pytest.approx(alone.body("robot/fr3_link5").mass)
    assert truth == {
        key: pytest.approx(cell.truth(Parameter(*key.split(".")))[0], rel=1e-5) for key in truth
    }


def test_a_scene_that_is_given_as_the_world_is_compiled_likewise() -> None:
    """Only a scene without a world has its unknowns drawn."""
    scene = parse_scene(WORLD.format(**EMPTY))
    cell = simulated_cell(scene, scene, noise="none")
    assert cell.truth(Parameter("cup", "mass")) == pytest.approx((0.24,))
    assert cell.robot().world.model.body("cup").mass == pytest.approx(0.24)
    assert simulated_cell(scene, noise="none").truth(Parameter("cup", "mass")) != pytest.approx(
        (0.24,)
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"cup": 'mass="?"'},
        {"joint": 'damping="?"'},
        {"before": '<default><geom friction="?"/></default>'},
    ],
)
def test_a_world_with_an_unknown_is_refused(tmp_path: Path, changes: dict[str, str]) -> None:
    path, scene = tmp_path / "world.xml", parse_scene(WORLD.format(**EMPTY))
    path.write_text(WORLD.format(**EMPTY | changes))
    with pytest.raises(InputError, match=r"the world states no value of <.*drawn from priors"):
        simulated_cell(scene, path)


def test_an_object_on_the_seam_of_two_frictions_has_no_true_coefficient() -> None:
    seam = '<geom type="box" size=".3 .2 .02" pos="0 {} 0" friction="{}"/>'
    text = WORLD.format(**EMPTY | {"cup": 'friction="0.1"'}).replace('pos="0.5 0.1 ', 'pos="0.5 0 ')
    whole = '<geom name="table" type="box" size=".3 .4 .02" />'
    assert whole in text
    halves = [
        text.replace(whole, seam.format(0.2, 0.6) + seam.format(-0.2, mu)) for mu in (0.3, 0.6)
    ]
    truths = [
        SimulatedCell(parse_scene(half)).truth(Parameter("cup", "friction")) for half in halves
    ]
    assert truths == [None, pytest.approx((0.6,))]


def test_an_arm_that_stands_elsewhere_is_another_workplace(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the arm stands at"):
        elsewhere(tmp_path, "far", gravity=-9.81, x=0.2, hidden="extends: none")


@pytest.mark.parametrize(
    ("counter", "glass", "pair", "acting"),
    [
        ("1", 'friction="0.35"', "", 1.0),
        ("0.2", 'friction="0.35"', "", 0.35),
        ("1", 'friction="0.35" priority="1"', "", 0.35),
        ("1", 'friction="0.35"', '<pair geom1="glass" geom2="counter" friction="0.5 0.5"/>', 0.5),
    ],
)
def test_a_friction_is_compared_with_that_of_the_pair(
    counter: str, glass: str, pair: str, acting: float
) -> None:
    world = parse_scene(f"""<mujoco><worldbody>
      <geom name="counter" type="box" size=".3 .4 .1" pos=".5 0 .1" friction="{counter}"/>
      <body name="glass" pos=".5 0 .25"><freejoint/>
        <geom name="glass" type="cylinder" size=".03 .05" mass=".2" {glass}/></body>
      </worldbody><contact>{pair}</contact></mujoco>""")
    cell = SimulatedCell(world)
    assert cell.truth(Parameter("glass", "friction")) == pytest.approx((acting,))


def test_a_world_whose_shape_overlaps_the_arm_is_refused(tmp_path: Path) -> None:
    bar = '<geom name="bar" type="capsule" size=".02" fromto="{x} -.2 .5 {x} .2 .6"/></worldbody>'
    for x, depth in ((0.3, "20 mm"), (0.6, "")):
        scene, world = (parse_scene(text(table="-0.02", mass='mass="0.3"')), tmp_path / f"{x}.xml")
        world.write_text(
            text(table="-0.02", mass='mass="0.3"').replace("</worldbody>", bar.format(x=x))
        )
        cell = simulated_cell(scene, world)
        if not depth:
            cell.robot()
            continue
        with pytest.raises(InputError, match=f"{world.name}: .* overlaps the arm by {depth}"):
            cell.robot()


@pytest.mark.parametrize(("axis", "speed", "fails"), [(0, 150.0, True), (2, -150.0, False)])
def test_an_object_that_diverges_ends_the_run_and_one_that_falls_does_not(
    axis: int, speed: float, fails: bool
) -> None:
    robot = simulated_cell(parse_scene(text(table="-0.02", mass='mass="0.3"'))).robot()
    data = robot.world._data
    data.qpos[robot.world.model.joint(0).qposadr[0]] += 3.0
    data.qvel[axis] = speed
    if fails:
        with pytest.raises(ExecutionAborted, match="'cup' is faster than 100 m/s"):
            robot.advance(0.1)
    else:
        robot.advance(0.1)
