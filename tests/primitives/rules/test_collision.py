"""Collisions of a motion away from a touch: the way back is free whatever was believed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from workbench import BOTTLE, bench

import palpate as pp
from palpate.common.pose import Pose
from palpate.planning.plan import Node
from palpate.primitives.motion import MovePose
from palpate.primitives.rules.clearance import straight_path
from palpate.primitives.rules.collision import collisions, finger_collisions
from palpate.primitives.rules.collision_geometry import LINK, arm_sweep
from palpate.primitives.rules.profile import spans
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.support import footing
from palpate.primitives.rules.unknown_heights import higher, vary_heights
from palpate.primitives.state import SymbolicState
from palpate.scene.load import GUESS
from palpate.scene.scene import Scene

SCENE = bench(BOTTLE, height="?")
SHELVED = bench(
    BOTTLE, '<body name="shelf" pos="0.5 0.3 0.01"><geom type="box" size=".1 .1 .01"/></body>'
)
APPROACH = SCENE.symbols.resolve("bench_approach")
DEEPER = HIGHER = 0.078
"""m: so much lower, or higher, than believed is the bench felt. It is 60 mm thick by the file."""


def touching(lower: float) -> SymbolicState:
    """After a probe from `bench_approach` that met the bench so much lower than believed."""
    believed = SCENE.body("bench").top_z(SCENE.body("bench").pose_world)
    x, y, _ = APPROACH.position
    felt = Pose.of((x, y, believed + SCENE.arm.tip - lower), APPROACH.quaternion)
    return SymbolicState(
        SCENE,
        at="bench_approach",
        pose_world_tcp=felt,
        gripper="open",
        contact="bench",
        activity="contact",
    )


def after_touching(higher: float) -> SymbolicState:
    """Back above the bench, which was touched so much higher than believed."""
    top = SCENE.body("bench").top_z() + higher
    state = SymbolicState(SCENE, at="bench_approach", pose_world_tcp=APPROACH, gripper="open")
    return state.raised("bench", top)


def back_to(pose: str, state: SymbolicState) -> tuple[object, ...]:
    return collisions(state, MovePose(pose=pose).effects(state))


def test_the_path_back_from_a_probe_of_any_depth_is_free() -> None:
    for lower in (0.0, 0.02, DEEPER, 0.12):
        assert back_to("bench_approach", touching(lower)) == ()


def test_only_the_path_back_is_free_after_a_wrong_belief() -> None:
    deep = touching(DEEPER)
    assert back_to("bench_approach + x_offset", deep) != ()
    assert back_to("bench_approach + z_offset", deep) != ()
    assert back_to("bench_approach", replace(deep, contact=None)) != ()


def test_body_measured_higher_is_kept_clear_of_from_then_on() -> None:
    there = APPROACH.translate((0.0, 0.0, -0.08))
    state = replace(after_touching(HIGHER), at=None)
    hits = collisions(state, replace(state, pose_world_tcp=there))
    assert any("'bench' (measured 78 mm higher than in the scene)" in h.message for h in hits)
    assert collisions(replace(state, scene=SCENE), replace(state, scene=SCENE)) == ()


@pytest.mark.parametrize("higher", [0.001, 0.05, -0.05])
def test_objects_on_a_measured_surface_move_with_it(higher: float) -> None:
    state = after_touching(higher)
    assert state.pose_of("bottle").distance_to(SCENE.body("bottle").pose_world) == pytest.approx(
        abs(higher), abs=1e-6
    )
    over = replace(
        state,
        at="bottle_pose + z_offset",
        pose_world_tcp=state.resolve("bottle_pose + z_offset"),
    )
    assert back_to("bottle_pose", over) == ()
    stands = footing(state, "bottle", state.pose_of("bottle"))
    assert stands.gap == pytest.approx(0.0, abs=1e-6)


def test_object_more_than_50_mm_from_its_guessed_height_is_not_touched() -> None:
    above = MovePose(pose="bottle_pose + z_offset")
    assert above.violations(after_touching(0.05)) == []
    (found,) = above.violations(after_touching(HIGHER))
    assert "measured 78 mm higher than in the scene" in found.message
    assert "write z 0.158 for 'bottle' and run again" in found.message


def test_near_what_was_measured_higher_the_arm_goes_slowly() -> None:
    low = SCENE.body("bench").top_z() + 0.1 - float(APPROACH.position[2])
    end = APPROACH.translate((0.0, 0.0, low))
    start = end.translate((0.0, 0.0, 0.1))
    for state, guarded in ((after_touching(0.0), [False]), (after_touching(HIGHER), [False, True])):
        assert [span.guarded for span in spans(state, start, end)] == guarded


def test_a_bare_desk_that_is_78_mm_higher_is_measured_and_places_above_it_follow(tmp_path) -> None:
    scene = """<mujoco><worldbody><site name="robot_base"/>
      <body name="desk" pos="0.5 0 {}"><geom type="box" size=".3 .3 .02" friction=".6"/></body>
    </worldbody></mujoco>"""
    poses, world = tmp_path / "poses.yaml", tmp_path / "world.xml"
    poses.write_text(
        "places: {desk_approach: {pos: [0.5, 0.1, 0.2], yaw: 0}, low: {pos: [0.5, 0.1, 0.13], yaw: 0}}"
    )
    world.write_text(scene.format(0.1 + HIGHER - 0.02))
    around = pp.load(scene.format("?"), poses=poses)
    plan = around.plan("how high is the desk?")
    *probed, home = plan.tree.children
    lower = replace(plan.tree, children=(*probed, Node("MovePose", (("pose", "low"),)), home))
    made = replace(plan.run_so_far, plan=replace(plan.run_so_far.plan, tree=lower))
    run = replace(plan, begun=made).run(
        world=world, noise="none", seed=0, rehearse=False, fast=True
    )
    assert run.status == "complete"
    assert abs(run["desk.height"].values[0] - (0.1 + HIGHER)) < 0.001


def test_a_desk_that_is_78_mm_lower_than_believed_is_measured_and_left(tmp_path) -> None:
    scene = """<mujoco><worldbody><site name="robot_base"/>
      <body name="desk" pos="0.5 0 {}"><geom type="box" size=".3 .3 .02" friction=".6"/></body>
    </worldbody></mujoco>"""
    poses, world = tmp_path / "poses.yaml", tmp_path / "world.xml"
    poses.write_text("places: {desk_approach: {pos: [0.5, 0.1, 0.2], yaw: 0}}")
    world.write_text(scene.format(0.1 - DEEPER - 0.02))
    plan = pp.load(scene.format("?"), poses=poses).plan("how high is the desk?")
    run = plan.run(world=world, noise="none", seed=0, rehearse=False, fast=True)
    assert (run.status, run.execution.stopped_by) == ("complete", None)
    assert abs(run["desk.height"].values[0] - (0.1 - DEEPER)) < 0.001


BOX = '<body name="{}" pos="{} {} .05">{}<geom type="box" size="{} .02 .05"/></body>'
FREE = "<freejoint/>"
LOW = 0.13
"""m: height of the held box's frame, as high as a standing one's top: they meet over 20 mm, below the hand."""


def passing(
    start: tuple[float, float], end: tuple[float, float], other: str, half: float = 0.02
) -> tuple[object, ...]:
    """Collisions of a box of half a length in x, held at its top, on a straight way past `other`."""
    scene = bench(BOX.format("held", 0.5, -0.3, FREE, half), other)

    def there(x: float, y: float) -> SymbolicState:
        pose = Pose.of((x, y, LOW), (1, 0, 0, 0))
        hand = Pose.top_down((x, y, LOW + 0.04), 0.0)
        return SymbolicState(
            scene,
            pose_world_tcp=hand,
            gripper="closed",
            holding="held",
            pose_tcp_object=hand.inverse() @ pose,
            lifted=True,
            moved={"held": pose},
        )

    return collisions(there(*start), there(*end))


@pytest.mark.parametrize(
    ("joint", "gap", "hit"),
    [(FREE, 1.2e-3, True), (FREE, 1.8e-3, False), ("", 2.7e-3, True), ("", 3.3e-3, False)],
)
def test_a_load_keeps_1_5_mm_from_objects_and_3_mm_from_what_is_fixed(
    joint: str, gap: float, hit: bool
) -> None:
    aside = 0.04 + gap
    found = passing((0.4, aside), (0.6, aside), BOX.format("other", 0.5, 0.0, joint, 0.02))
    assert bool(found) == hit


def test_a_load_passes_no_wall_of_what_it_stands_on() -> None:
    tray = (
        '<body name="tray" pos="0.5 0 .04"><geom type="box" size=".2 .1 .04"/>'
        '<geom type="box" pos="0 0 .05" size=".002 .1 .03"/></body>'
    )
    assert passing((0.4, 0.0), (0.45, 0.0), tray) == ()
    assert passing((0.4, 0.0), (0.6, 0.0), tray)


def empty(x: float, y: float, z: float, scene: Scene, gripper: str = "open") -> SymbolicState:
    """The empty hand, the fingers closing along y."""
    return SymbolicState(scene, pose_world_tcp=Pose.top_down((x, y, z), 0.0), gripper=gripper)


@pytest.mark.parametrize(("gap", "hit"), [(1.2e-3, True), (1.8e-3, False)])
def test_an_object_passes_between_the_fingers_with_1_5_mm_on_each_side(
    gap: float, hit: bool
) -> None:
    half = 0.04 - gap
    scene = bench(
        f'<body name="box" pos=".5 0 .05"><freejoint/><geom type="box" size=".02 {half} .05"/></body>'
    )
    assert bool(collisions(empty(0.5, 0, 0.2, scene), empty(0.5, 0, 0.09, scene))) == hit


def test_fingers_of_an_unknown_opening_are_open_and_closed() -> None:
    scene = bench(
        BOX.format("box", 0.5, 0.0, FREE, 0.02), BOX.format("left", 0.5, 0.07, FREE, 0.02)
    )
    ends = (0.2, 0.09)
    for gripper, met in (("open", "left"), ("closed", "box"), ("unknown", "boxleft")):
        above, there = (empty(0.5, 0, z, scene, gripper) for z in ends)
        said = " ".join(one.message for one in collisions(above, there))
        assert [name for name in ("box", "left") if f"'{name}'" in said] == [
            name for name in ("box", "left") if name in met
        ], gripper


def test_each_part_hits_a_body_once() -> None:
    scene = bench(BOX.format("box", 0.5, 0.0, FREE, 0.02))
    said = [
        one.message.partition(" at (")[0]
        for one in collisions(empty(0.4, 0.04, 0.03, scene), empty(0.5, 0.04, 0.03, scene))
    ]
    assert said
    assert len(said) == len(set(said))


def test_fingers_open_only_with_free_room_at_their_sides() -> None:
    beside = bench(BOX.format("box", 0.5, 0.05, FREE, 0.02))
    (found, *_) = finger_collisions(empty(0.5, 0, 0.05, beside, "closed"), 0.08, None)
    assert "would move into 'box'" in found.message
    assert not finger_collisions(empty(0.5, 0, 0.05, beside, "closed"), 0.08, "box")
    aside = bench(BOX.format("box", 0.5, 0.10, FREE, 0.02))
    assert not finger_collisions(empty(0.5, 0, 0.05, aside, "closed"), 0.08, None)


def test_a_surface_of_unknown_height_is_kept_clear_of_by_as_much_as_it_may_be_higher() -> None:
    top, tip = SCENE.body("bench").top_z(), SCENE.arm.tip
    for scene, gap, hit in (
        (SCENE, GUESS - 0.002, True),
        (SCENE, GUESS + 0.002, False),
        (SHELVED, 0.01, False),
    ):
        above, there = (empty(0.4, -0.3, top + tip + z, scene) for z in (0.2, gap))
        assert bool(collisions(above, there)) == hit


def test_a_touched_height_may_change_later() -> None:
    before = replace(touching(0.0), at="bench_approach")
    after = replace(before, pose_world_tcp=APPROACH, at=None, contact=None)
    changed = {
        words: round(start.scene.body("bench").top_z() - SCENE.body("bench").top_z(), 6)
        for start, _, words in vary_heights(before, after)
    }
    assert changed == {"'bench' is 50 mm higher": GUESS, "'bench' is 50 mm lower": -GUESS}


def test_objects_may_be_higher_on_the_way_to_where_their_surface_is_probed() -> None:
    home = SymbolicState(SCENE, gripper="open")
    for pose, rises in (("bench_approach", {"bottle": GUESS}), ("bottle_pose + z_offset", {})):
        assert higher(home, MovePose(pose=pose).effects(home)) == rises


def test_a_body_too_near_at_the_start_may_not_come_nearer() -> None:
    other = BOX.format("other", 0.5, 0.0, FREE, 0.02)
    near = 0.04 + 5e-4
    assert not passing((0.5, near), (0.52, near), other)
    assert not passing((0.5, near), (0.5, 0.1), other)
    assert passing((0.5, near), (0.5, near - 0.003), other)


def test_links_keep_5_mm_from_everything() -> None:
    """A wall beside the elbow, above the hand, towards which the elbow goes."""
    wall = '<body name="wall" pos="0.3 {} 1.0"><geom type="box" size=".5 .05 .35"/></body>'
    start, end = (Pose.top_down((0.5, y, 0.4), 0.0) for y in (-0.2, 0.0))
    shapes = solids(bench())
    q = shapes.configuration(start), shapes.configuration(end)
    back = straight_path(shapes, end, start, (q[1], q[0]), 0.08)

    def state(y: float) -> SymbolicState:
        return SymbolicState(bench(wall.format(y)), pose_world_tcp=start, gripper="open")

    touching, free = 0.0, 0.4
    while free - touching > 1e-4:
        middle = (touching + free) / 2
        hits = arm_sweep(state(middle), back, 0.01).overlaps()
        into = any(hit.part.kind == LINK and hit.other.owner == "wall" for hit in hits)
        touching, free = (middle, free) if into else (touching, middle)
    for gap, found in ((0.004, True), (0.006, False)):
        before = state(free + gap)
        assert bool(collisions(before, replace(before, pose_world_tcp=end))) == found


def test_a_body_thinner_than_the_steps_of_a_path_is_hit() -> None:
    for x in (0.50, 0.505, 0.51, 0.515):
        assert passing((0.4, 0.0), (0.6, 0.0), BOX.format("pin", x, 0.0, FREE, 0.002), half=0.002)
