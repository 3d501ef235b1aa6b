"""Objects that hang a little above what they are to stand on."""

from __future__ import annotations

import pytest

from palpate.common.parameter import Parameter, PlanRejected
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import parse_scene
from palpate.scene.poses import parse_poses
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene
from palpate.twin.inject import inject

MUG = '<body name="mug" pos="0.5 0 {z}" {turned}><freejoint/><geom type="box" size=".03 .03 .05"/></body>'


def scene(*bodies: str, height: str = "0.2", poses: str | None = None) -> Scene:
    table = f'<geom name="table" type="box" pos="0.5 0 {height}" size=".3 .4 .02"/>'
    text = f"<mujoco><worldbody>{table}{''.join(bodies)}</worldbody></mujoco>"
    return parse_scene(text, poses=None if poses is None else parse_poses(poses))


def mug(gap: float, turned: str = "") -> str:
    return MUG.format(z=round(0.27 + gap, 6), turned=turned)


@pytest.mark.parametrize("gap", [0.002, 0.01, 0.019])
def test_an_object_slightly_above_its_support_is_let_down(gap: float) -> None:
    model = scene(mug(gap))
    assert model.bodies["mug"].bottom_z() == pytest.approx(0.22, abs=2e-4)
    assert model.symbols.pose("mug_pose").position[2] < 0.33
    height = model.spec().compile().body("mug").pos[2]
    assert height == pytest.approx(0.27, abs=2e-4)


def test_an_object_that_poses_put_slightly_too_high_is_let_down_and_remarked() -> None:
    model = scene(mug(1.0), poses="objects: {mug: {pos: [0.5, 0, 0.28]}}")
    assert model.bodies["mug"].bottom_z() == pytest.approx(0.22, abs=2e-4)
    assert any("onto the support just below: 'mug'" in line for line in remarks(model))


def test_an_object_slightly_above_another_is_let_down_onto_it() -> None:
    model = scene(mug(0.0), MUG.format(z=0.378, turned="").replace('"mug"', '"upper"'))
    assert model.bodies["upper"].bottom_z() == pytest.approx(0.32, abs=5e-4)


def test_an_object_far_above_everything_is_remarked() -> None:
    with pytest.raises(PlanRejected, match="'mug' is in the air; correct its pos"):
        SymbolicPlanner().plan("how heavy is the mug?", scene(mug(0.06)))


def test_the_file_keeps_its_own_number() -> None:
    text = scene(mug(0.015)).text
    assert 'pos="0.5 0 0.285"' in inject(text, {Parameter("mug", "mass"): (0.2,)})


@pytest.mark.parametrize(
    ("body", "height", "z"),
    [
        (mug(0.0005), "0.2", 0.2705),
        (mug(0.05), "0.2", 0.32),
        (mug(0.01, 'euler="30 0 0"'), "0.2", 0.28),
        (mug(0.01), "?", 0.28),
    ],
)
def test_objects_that_stand_or_would_fall_far_or_over_keep_their_pose(
    body: str, height: str, z: float
) -> None:
    model = scene(body, height=height)
    assert model.bodies["mug"].pose_world.position[2] == pytest.approx(z)


def test_an_object_in_a_bowl_falls_onto_its_bottom() -> None:
    walls = "".join(
        f'<geom type="box" pos="{x} {y} .03" size="{a} {b} .03"/>'
        for x, y, a, b in ((0.1, 0, 0.01, 0.1), (-0.1, 0, 0.01, 0.1), (0, 0.1, 0.1, 0.01))
    )
    floor = '<geom type="box" size=".1 .1 .005" pos="0 0 .005"/>'
    bowl = f'<body name="bowl" pos="0.5 0 0.22"><freejoint/>{floor}{walls}</body>'
    inside = MUG.format(z=0.22 + 0.01 + 0.05 + 0.006, turned="")
    model = scene(bowl, inside)
    assert model.bodies["mug"].bottom_z() == pytest.approx(0.23, abs=5e-4)
