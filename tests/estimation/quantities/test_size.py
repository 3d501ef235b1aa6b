"""Size: how wide the fingers find an object, how high its top is, and its shapes in the twin."""

from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.grip import Extent
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.size import Size, estimate_size, size_of
from palpate.execution.runner import run
from palpate.execution.simulated_cell import simulated_cell
from palpate.planning.request.grounding import ground
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import load_scene, parse_scene
from palpate.twin.inject import inject

SIZE = Parameter("crate", "size")
D = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02"/></body>
  <body name="crate" pos="0.5 0.1 0.06"><freejoint/><geom type="box" size=".03 .025 .06"/></body>
  <body name="can" pos="0.5 -0.15 0.05"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
</worldbody></mujoco>"""
WORLD = D.replace(
    'pos="0.5 0.1 0.06"><freejoint/><geom type="box" size=".03 .025 .06"',
    'pos="0.5 0.1 0.054"><freejoint/><geom type="box" size=".0305 .0245 .054" mass="0.3"',
)
TABLE, TOP = 0.0, 0.111


@pytest.fixture(scope="module")
def scene():
    return parse_scene(D)


def recorded(bench, noise, *, support=True, across=True, stiffness=4e4):
    """A touch of the table, one of the crate's top, which gives way by its `stiffness`, N/m, and two
    grasps."""
    b = bench(noise, 1)
    if support:
        b.go("table_approach", (0.4, 0.0, 0.1))
        b.descend(lambda z: max(0.0, TABLE - z) * 4e4, "table")
    b.width = 0.0
    b.go("crate_top", (0.5, 0.1, TOP + 0.08))
    b.descend(lambda z: max(0.0, TOP - z) * stiffness, "crate")
    b.width = 0.08
    b.go("crate_pose", (0.5, 0.1, 0.07))
    b.close("crate", 0.0)
    b.measure(0.3, "contact", "table", "gripper_pose")
    b.open()
    if across:
        b.go("crate_across", (0.5, 0.1, 0.07))
        b.close("crate", 0.0)
        b.width = 0.062
        b.measure(0.3, "contact", "table", "gripper_pose")
    return b


def turned(trace, scene, quarter_from):
    """The hand along the crate's y, and a quarter turn on from a time on."""
    pose = scene.symbols.resolve("crate_pose")
    across = scene.symbols.resolve("crate_across")
    for i, t in enumerate(trace.samples.t.tolist()):
        orientation = across if t >= quarter_from else pose
        trace.samples.pose_world_tcp[i, 3:] = orientation.quaternion
        trace.samples.target_world_tcp[i, 3:] = orientation.quaternion
    return trace


def start_of_last_grasp(b):
    return [leaf for leaf in b.leaves if leaf.primitive == "MovePose"][-1].start


@pytest.mark.parametrize("noise", ["none", "lab", "datasheet"])
def test_the_fingers_measure_two_widths_and_a_touch_of_the_top_the_height(
    bench, noises, scene, noise
):
    b = recorded(bench, noises[noise])
    trace = turned(b.trace(), scene, start_of_last_grasp(b))
    found = estimate_size(trace, SIZE, scene.bodies["crate"])
    assert found.values == pytest.approx([0.062, 0.05, TOP - TABLE], abs=5e-4)
    assert (found.stds < 1.5e-3).all()
    assert found.verdict == "identified"
    assert "there is no evidence" not in found.method


def test_the_length_of_the_tips_cancels_where_the_support_was_touched_too(bench, noises, scene):
    both = recorded(bench, noises["lab"], across=False)
    alone = recorded(bench, noises["lab"], support=False, across=False)
    crate = scene.bodies["crate"]
    stds = [estimate_size(b.trace(), SIZE, crate).stds[2] for b in (both, alone)]
    assert stds[0] < 2.1e-4 < stds[1]


@pytest.mark.parametrize(("stiffness", "verdict"), [(1e4, "identified"), (1e3, "contradicted")])
def test_a_slightly_compliant_object_ends_at_first_contact(
    bench, noises, scene, stiffness, verdict
):
    """A light thing on an ordinary table of MuJoCo's does; soft things are another matter."""
    b = recorded(bench, noises["datasheet"], stiffness=stiffness)
    trace = turned(b.trace(), scene, start_of_last_grasp(b))
    found = estimate_size(trace, SIZE, scene.bodies["crate"])
    assert found.verdict == verdict
    assert abs(found.values[2] - (TOP - TABLE)) < 3 * found.stds[2] < 3e-3 * (4e4 / stiffness)


@pytest.mark.parametrize(("tip_std", "verdict"), [(1.6e-3, "identified"), (2e-4, "contradicted")])
def test_a_top_that_gives_way_by_less_than_its_height_is_known_to_is_one_height(
    bench, noises, scene, tip_std, verdict
):
    """Pressed 1.9 mm in, as a cup of 30 g is by MuJoCo's contacts, by tips known to 1.6 mm or to 0.2 mm."""
    b = recorded(bench, noises["datasheet"], support=False, stiffness=2.6e3)
    trace = b.trace()
    trace = replace(trace, hand=replace(trace.hand, tip_offset_std=tip_std))
    found = estimate_size(trace, SIZE, scene.bodies["crate"])
    assert found.verdict == verdict
    assert abs(found.values[2] - (TOP - TABLE)) < 2.0 * found.stds[2]


def test_no_number_of_grasps_reduces_what_the_fingers_are_off_by(bench, noises, scene):
    trace, crate = recorded(bench, noises["none"]).trace(), scene.bodies["crate"]
    grasps = [Extent(0, width, 2e-4) for width in (0.0600, 0.0602, 0.0604)]
    found = size_of(trace, SIZE, crate, grasps, (), ())
    assert found.values[0] == pytest.approx(0.0602)
    assert found.stds[0] == pytest.approx(2e-4)


def test_an_extent_without_evidence_stays_as_in_the_scene(bench, noises, scene):
    b = recorded(bench, noises["lab"], across=False)
    found = estimate_size(turned(b.trace(), scene, np.inf), SIZE, scene.bodies["crate"])
    assert found.values[0] == scene.bodies["crate"].size[0] == pytest.approx(0.06)
    assert found.stds[0] == pytest.approx(0.015)
    assert "Along x there is no evidence" in found.method


def test_size_without_recordings_is_not_identified(bench, noises, scene):
    b = bench(noises["none"])
    b.go("home", (0.5, 0.0, 0.3))
    assert estimate_size(b.trace(), SIZE, scene.bodies["crate"]).verdict == "not identified"


def grown(text, name, value):
    """The scene with a body's size written in."""
    scene = parse_scene(text)
    spec = scene.spec({Parameter(name, "size"): value})
    model = spec.compile()
    geom = model.body(name).geomadr[0]
    return model.geom_size[geom], model.geom_pos[geom]


def test_a_box_grows_from_what_it_stands_on():
    size, pos = grown(D, "crate", (0.061, 0.049, 0.108))
    assert size == pytest.approx([0.0305, 0.0245, 0.054])
    assert pos == pytest.approx([0.0, 0.0, -0.006])


def test_a_cylinder_has_one_radius():
    size, _ = grown(D, "can", (0.0604, 0.0602, 0.104))
    assert size[:2] == pytest.approx([0.03015, 0.052])


def test_a_rotated_shape_has_no_size():
    askew = D.replace('size=".03 .025 .06"', 'size=".03 .025 .06" euler="0 0 30"')
    with pytest.raises(InputError, match="no numbers that state its extents"):
        grown(askew, "crate", (0.061, 0.049, 0.108))


@pytest.mark.parametrize(
    "request_", ["how tall is the crate?", "the height of the crate", "how wide is the crate"]
)
def test_the_height_of_an_object_is_part_of_its_size(scene, request_):
    assert ground(request_, scene).asked == (SIZE,)


def test_the_height_of_a_table_is_no_size(scene):
    assert ground("how high is the table?", scene).asked == (Parameter("table", "height"),)


def test_a_support_of_unknown_height_is_touched_too():
    scene = parse_scene(D.replace('pos="0.5 0 -0.02"', 'pos="0.5 0 ?"'))
    needed = list(Size().needs(scene.bodies["crate"], scene.bodies))
    assert needed == [Parameter("table", "height")]


@pytest.mark.long
def test_a_crate_is_measured_from_a_sentence(scene):
    """A smaller one than the scene has, at the noise of a well kept arm."""
    plan = SymbolicPlanner().plan("how tall is the crate?", scene)
    cell = simulated_cell(scene, parse_scene(WORLD), noise="lab", seed=1, tolerance=0.05)
    done = run(plan, scene, cell.robot())
    assert done.status == "complete"
    (found,) = estimate_all(plan.parameters, done.trace, scene.bodies)
    assert found.values == pytest.approx(cell.truth(SIZE), abs=1e-3)
    assert np.abs(found.z_score(cell.truth(SIZE))).max() < 3.0
    kinds = [leaf.primitive for leaf in done.trace.leaves]
    touched = kinds.index("MoveUntilContact")
    assert kinds.index("FoldFingers") < touched < kinds.index("CloseGripper")
    assert kinds.count("CloseGripper") == 2


CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
MESH = """<mujoco><asset><mesh name="cube" file="cube.obj" scale=".03 .025 .06"/></asset><worldbody>
  <body name="crate" pos="0.5 0.1 0.06"><freejoint/>
    <geom type="mesh" mesh="cube" mass="0.3" {turned}/></body>{more}</worldbody></mujoco>"""


@pytest.mark.parametrize("turned", ["", 'euler="0 0 90"', 'pos="0 0 0.01"'])
def test_a_mesh_is_scaled_where_it_is_named(tmp_path, turned):
    (tmp_path / "cube.obj").write_text(CUBE)
    text = MESH.format(turned=turned, more="")
    grown = inject(text, {SIZE: (0.066, 0.055, 0.108)}, folder=tmp_path)
    scale = 'scale="0.0275 0.033 0.054"' if "euler" in turned else 'scale="0.033 0.0275 0.054"'
    assert scale in grown
    before, after = (parse_scene(t, tmp_path).bodies["crate"] for t in (text, grown))
    assert after.size == pytest.approx([0.066, 0.055, 0.108], abs=1e-6)
    assert after.bottom_z() == pytest.approx(before.bottom_z(), abs=1e-6)


def test_a_mesh_shared_with_others_is_not_scaled(tmp_path):
    (tmp_path / "cube.obj").write_text(CUBE)
    more = '<geom name="post" type="mesh" mesh="cube" pos="1 1 0"/>'
    with pytest.raises(InputError, match="mesh 'cube' of 'crate' is that of <geom name=\"post\">"):
        inject(MESH.format(turned="", more=more), {SIZE: (0.066, 0.055, 0.108)}, folder=tmp_path)


@pytest.mark.parametrize(
    ("was", "written"),
    [
        ('size="? .025 .06"', 'size="0.031 .025 .06"'),
        ('size="? ? ?"', 'size="0.031 0.024 0.06"'),
        ('size=".03 .025 ?"', 'size=".03 .025 0.06"'),
    ],
)
def test_an_extent_written_as_unknown_is_missing_and_filled(was, written):
    text = D.replace('size=".03 .025 .06"', was)
    found = parse_scene(text)
    assert SIZE in found.missing
    # It stands on the table with its middle 60 mm above.
    assert found.bodies["crate"].size[2] == pytest.approx(0.12)
    assert found.bodies["crate"].bottom_z() == pytest.approx(0.0, abs=1e-9)
    assert written in inject(text, {SIZE: (0.062, 0.048, 0.12)})
    truth = simulated_cell(found, seed=3).truth(SIZE)
    assert abs(np.array(truth) / found.bodies["crate"].size - 1.0).max() < 0.1 + 1e-9


def test_the_radius_of_a_round_object_is_two_extents():
    text = D.replace('type="cylinder" size=".03 .05"', 'type="cylinder" size="? .05"')
    assert 'size="0.0305 .05"' in inject(text, {Parameter("can", "size"): (0.061, 0.061, 0.1)})


def test_an_unknown_extent_among_several_shapes_is_refused():
    part = '<geom type="box" size=".01 .01 ?" pos="0 0 .07"/>'
    with pytest.raises(InputError, match="cannot be measured"):
        parse_scene(D.replace('size=".03 .025 .06"/>', f'size=".03 .025 .06"/>{part}'))


MARKED = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos="0.5 0 0.1"><geom type="box" size=".3 .3 .05"/></body>
  <body name="box" pos="0.5 0 0.2"><freejoint/><geom type="box" size="{} .03 .05"{}/></body>
</worldbody></mujoco>"""


def test_a_width_measured_by_a_grasp_corrects_an_uncertain_size(tmp_path):
    """Only the mass is asked for; a size that nobody marked as unsure stays as it is stated."""
    scene, world = tmp_path / "scene.xml", tmp_path / "world.xml"
    scene.write_text(MARKED.format(".03", ""))
    stated = ' mass=".3" friction="0.5" priority="1"'
    text = MARKED.format(".03", stated).replace(".03 .03 .05", ".029 .029 .05")
    world.write_text(text)
    poses = "objects: {box: {pos: [0.5, 0, 0.2], std: 0.003}}"
    (tmp_path / "poses.yaml").write_text(poses)
    plan = pp.load(scene, poses=tmp_path / "poses.yaml").plan(measure="box.mass")
    run = plan.run(world=world, seed=4, fast=True)
    assert run["box.mass"].verdict == "identified"
    sizes = parse_scene(run.twin.xml).body("box").size
    felt = np.abs(sizes - 0.058).argmin()
    assert sizes[felt] == pytest.approx(0.058, abs=3e-4)
    assert felt < 2
    assert sizes[1 - felt] == pytest.approx(0.06)
    assert any("measured in the run" in note for note in run.twin.notes)
    assert load_scene(scene).body("box").seen is False
