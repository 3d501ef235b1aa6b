"""Scenes as models: geometry, poses, values, priors."""

from __future__ import annotations

import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.mjcf.body import Body
from palpate.scene.load import load_scene, parse_scene, scene_from_text
from palpate.scene.scene import Scene

TABLE = '<body name="table" pos="0.5 0 ?"><geom type="box" size="0.3 0.4 0.02"/></body>'
BOTTLE = '<body name="bottle" pos="0.5 0.1 0.5"><freejoint/><geom type="cylinder" size="0.03 0.1"/></body>'


def scene(world: str, poses: str | None = None) -> Scene:
    return parse_scene(f"<mujoco><worldbody>{world}</worldbody></mujoco>", poses=poses)


def settled(model: mujoco.MjModel, name: str, seconds: float = 1.0) -> float:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=int(seconds / model.opt.timestep))
    return float(data.body(name).xpos[2])


def test_the_prior_scene_compiles_and_rests() -> None:
    model = scene(TABLE + BOTTLE)
    assert model.priors[Parameter("table", "height")] == pytest.approx((0.4,))
    assert settled(model.spec().compile(), "bottle") == pytest.approx(0.5, abs=5e-4)


def test_values_go_into_the_model() -> None:
    result = scene(TABLE + BOTTLE)
    values = {
        Parameter("table", "height"): (0.39,),
        Parameter("bottle", "mass"): (0.254,),
        Parameter("bottle", "friction"): (0.34,),
        Parameter("bottle", "com"): (0.0, 0.0, -0.03),
    }
    model = result.spec(values).compile()
    bottle = model.body("bottle")
    assert bottle.mass[0] == pytest.approx(0.254)
    assert bottle.ipos == pytest.approx([0, 0, -0.03])
    assert model.geom_friction[bottle.geomadr[0]] == pytest.approx([0.34, 0.005, 0.0001])
    assert settled(model, "bottle") == pytest.approx(0.49, abs=5e-4)


def test_a_measured_friction_prevails_over_the_supports() -> None:
    tilt = '<option gravity="2.5 0 -9.5"/>'
    text = f"<mujoco>{tilt}<worldbody>{TABLE}{BOTTLE.replace('0.03 0.1', '0.06 0.02')}</worldbody></mujoco>"
    parsed_scene = parse_scene(text.replace("0.1 0.5", "0.1 0.42"))
    assert parsed_scene.gravity == pytest.approx(np.hypot(2.5, 9.5))

    def slides(friction: float) -> bool:
        model = parsed_scene.spec(
            {Parameter("bottle", "friction"): (friction,), Parameter("bottle", "mass"): (0.3,)}
        ).compile()
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=250)
        return float(data.body("bottle").xpos[0]) > 0.51

    assert slides(0.15)
    assert not slides(0.45)


def test_mass_is_shared_by_volume_and_leaves_stated_geoms_alone() -> None:
    result = scene(
        '<body name="mug" pos="0.5 0 0.1"><freejoint/><geom name="a" type="box" size=".02 .02 .02"/>'
        '<geom name="b" type="box" size=".02 .02 .04" pos="0 0 .06"/></body>'
    )
    model = result.spec({Parameter("mug", "mass"): (0.3,)}).compile()
    assert model.body("mug").mass[0] == pytest.approx(0.3)
    assert model.body("mug").ipos[2] == pytest.approx(0.04)
    partly = scene(
        '<body name="mug" pos="0.5 0 0.1"><freejoint/><geom type="box" size=".02 .02 .02" mass="0.1"/>'
        '<geom type="box" size=".02 .02 .02" pos="0 0 .04" mass="?"/></body>'
    )
    model = partly.spec({Parameter("mug", "mass"): (0.4,)}).compile()
    assert model.body("mug").mass[0] == pytest.approx(0.4)
    assert model.body("mug").ipos[2] == pytest.approx(0.03)


def test_an_open_height_of_an_object_follows_its_surface() -> None:
    result = scene(TABLE + BOTTLE.replace("0.5 0.1 0.5", "0.5 0.1 ?"))
    assert result.objects["bottle"].missing == {"mass", "friction"}
    assert result.objects["bottle"].bottom_z() == pytest.approx(0.4)
    model = result.spec({Parameter("table", "height"): (0.6,)}).compile()
    assert model.body("bottle").pos[2] == pytest.approx(0.7)


def test_poses_overrule_the_file_and_give_heights() -> None:
    result = scene(TABLE + BOTTLE, poses="objects: {bottle: {pos: [0.4, -0.1, 0.85], yaw: 0.5}}")
    assert result.objects["bottle"].pose_world.position == pytest.approx([0.4, -0.1, 0.85])
    assert result.priors[Parameter("table", "height")] == pytest.approx((0.75,))
    model = result.spec().compile()
    assert model.body("bottle").pos == pytest.approx([0.4, -0.1, 0.85])
    assert model.body("bottle").quat == pytest.approx([np.cos(0.25), 0, 0, np.sin(0.25)])


def test_poses_give_an_unknown_position_its_prior() -> None:
    unplaced = BOTTLE.replace("0.5 0.1 0.5", "? ? ?")
    result = scene(TABLE + unplaced, poses="objects: {bottle: {pos: [0.4, -0.1, 0.85]}}")
    assert result.priors[Parameter("bottle", "position")] == (0.4, -0.1)
    assert result.objects["bottle"].pose_world.position == pytest.approx([0.4, -0.1, 0.85])
    assert result.priors[Parameter("table", "height")] == pytest.approx((0.75,))
    model = result.spec({Parameter("bottle", "position"): (0.41, -0.11)}).compile()
    assert model.body("bottle").pos[:2] == pytest.approx([0.41, -0.11])


def test_an_empty_surface_is_believed_below_its_approach() -> None:
    model = scene(TABLE, poses="places: {table_approach: {pos: [0.5, 0, 0.9]}}")
    assert model.priors[Parameter("table", "height")] == pytest.approx((0.8,))
    assert scene(TABLE).priors[Parameter("table", "height")] == (0.4,)


def test_unknown_names_list_the_valid_ones() -> None:
    with pytest.raises(InputError, match="valid: bottle, table"):
        scene(TABLE + BOTTLE, poses="objects: {cup: {pos: [0, 0, 0]}}")
    with pytest.raises(InputError, match="unknown object or surface 'cup'"):
        scene(TABLE + BOTTLE).body("cup")


def test_a_scene_that_mujoco_refuses_is_an_input_error() -> None:
    with pytest.raises(InputError, match="MuJoCo does not accept"):
        scene('<geom type="box" size="1 1 1" colour="red"/>')
    with pytest.raises(InputError, match="MuJoCo does not accept"):
        scene('<body name="b"><freejoint/><geom type="box" size="0 1 1"/></body>')


@pytest.mark.parametrize("number", ["nan", "inf", "1e999"])
def test_numbers_must_be_finite(number: str) -> None:
    with pytest.raises(InputError, match=r"finite|MuJoCo does not accept"):
        scene(BOTTLE.replace("0.5 0.1 0.5", f"0.5 {number} 0.5"))


def test_meshes_are_found_in_the_scenes_folder(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "wedge.obj").write_text(
        "v 0 0 0\nv .06 0 0\nv 0 .06 0\nv .06 .06 0\nv 0 0 .05\nv .06 0 .05\n"
        "f 1 3 2\nf 2 3 4\nf 1 2 6\nf 1 6 5\nf 5 6 4\nf 5 4 3\nf 1 5 3\nf 2 4 6\n"
    )
    path = tmp_path / "scene.xml"
    path.write_text(
        '<mujoco><compiler meshdir="assets"/>'
        '<asset><mesh name="wedge" file="wedge.obj"/></asset><worldbody>'
        '<body name="wedge" pos="0.5 0 0"><freejoint/><geom type="mesh" mesh="wedge"/></body>'
        "</worldbody></mujoco>"
    )
    parsed_scene = load_scene(path)
    wedge = parsed_scene.objects["wedge"]
    assert wedge.size == pytest.approx([0.06, 0.06, 0.05], abs=1e-6)
    assert wedge.centre == pytest.approx([0.03, 0.03, 0.025], abs=1e-6)
    assert parsed_scene.files == ((tmp_path / "assets" / "wedge.obj").resolve(),)
    parent = mujoco.MjSpec()
    parent.attach(parsed_scene.spec(), frame=parent.worldbody.add_frame(), prefix="w_")
    assert parent.compile().nmesh == 1


def test_a_twin_is_read_with_the_same_poses() -> None:
    model = scene(TABLE + BOTTLE, poses="objects: {bottle: {pos: [0.4, 0, 0.5]}}")
    twin = scene_from_text(model.text.replace("0.5 0 ?", "0.5 0 0.38"), model)
    assert twin.surfaces["table"].known["height"] == pytest.approx((0.4,))
    assert twin.objects["bottle"].pose_world.position[0] == pytest.approx(0.4)


def test_the_arms_base_is_the_site_or_the_origin() -> None:
    assert scene(BOTTLE).pose_world_base.position == pytest.approx([0, 0, 0])
    site = '<site name="robot_base" pos="-0.4 0.1 0.2" euler="0 0 90"/>'
    assert scene(site + BOTTLE).pose_world_base.rotation[:, 0] == pytest.approx([0, 1, 0])


coordinate = st.floats(-1, 1)


@given(
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[coordinate] * 3),
    st.tuples(*[st.floats(0.01, 0.5)] * 3),
    st.tuples(*[st.floats(-0.49, 0.49)] * 3),
)
@settings(max_examples=100, deadline=None)
def test_a_turned_box_covers_its_own_points_and_spans_its_corners(
    quaternion: tuple[float, ...],
    centre: tuple[float, ...],
    size: tuple[float, ...],
    share: tuple[float, ...],
) -> None:
    pose = Pose.of((0.3, -0.2, 0.7), quaternion)
    body = Body("b", "object", frozenset(), pose, np.array(centre), np.array(size), {}, frozenset())
    inside = pose.apply(np.array(centre) + np.array(share) * np.array(size))
    assert body.covers(inside[0], inside[1])
    assert body.bottom_z() - 1e-9 <= inside[2] <= body.top_z() + 1e-9
    corners = [
        pose.apply(np.array(centre) + np.array(signs) * np.array(size) / 2)
        for signs in np.ndindex(3, 3, 3)
        for signs in [np.array(signs) - 1]
    ]
    assert max(c[2] for c in corners) == pytest.approx(body.top_z())
    assert not body.covers(max(c[0] for c in corners) + 0.01, inside[1])


def crowd(count: int) -> str:
    return TABLE + "".join(
        f'<body name="o{i}" pos="{0.35 + 0.13 * (i % 3)} {-0.4 + 0.2 * (i // 3)} 0.45" euler="0 0 {7 * i}"><freejoint/>'
        f'<geom type="{("box", "cylinder", "capsule")[i % 3]}" size="0.02 0.05 0.05"/></body>'
        for i in range(count)
    )


def seconds(text: str) -> float:
    """To load `text`, the quickest of three times."""
    times: list[float] = []
    for _ in range(3):
        start = time.process_time()
        scene(text)
        times.append(time.process_time() - start)
    return min(times)


def test_loading_time_grows_no_faster_than_the_scene() -> None:
    assert seconds(crowd(15)) < 6 * seconds(crowd(5)), "3 times as many objects"


def test_fifteen_objects_are_all_read() -> None:
    model = scene(crowd(15))
    assert len(model.missing) == 31
    assert model.symbols.ungraspable == {}
