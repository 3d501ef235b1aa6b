"""The grammar of pose expressions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.scene.load import parse_scene
from palpate.scene.symbols import DEFAULT_OFFSETS, MAX_EXPRESSION, Symbols


def make(names: tuple[str, ...] = ("hammer", "red-box", "box 2")) -> Symbols:
    poses = {f"{n}_pose": Pose.top_down((0.5, 0.1 * i, 0.4), 0.3 * i) for i, n in enumerate(names)}
    return Symbols(
        poses={**poses, "table_approach": Pose.top_down((0.4, 0, 0.6), 0)},
        subjects={f"{n}_pose": n for n in names} | {"table_approach": "table"},
        configurations={"home_config": load_description().home},
        offsets={n: np.array(v) for n, v in DEFAULT_OFFSETS.items()},
        own_offsets={
            "hammer": {"x_offset": np.array([0.04, 0, 0]), "tilt": np.array([0.01, 0.02, 0.03])}
        },
    )


TABLE = make()


@pytest.mark.parametrize(
    ("written", "canonical"),
    [
        ("hammer_pose", "hammer_pose"),
        ("hammer", "hammer_pose"),
        ("  hammer_pose+z_offset ", "hammer_pose + z_offset"),
        ("hammer+ 1*x_offset", "hammer_pose + x_offset"),
        ("hammer_pose + z_off", "hammer_pose + z_offset"),
        ("hammer_pose+z", "hammer_pose + z_offset"),
        ("hammer_pose + 0.50 * z", "hammer_pose + 0.5*z_offset"),
        ("hammer_pose - 2x_offset", "hammer_pose - 2*x_offset"),
        ("hammer_pose + -2*x_offset", "hammer_pose - 2*x_offset"),
        ("hammer_pose - (-1)*x_offset", "hammer_pose + x_offset"),
        ("hammer_pose − x_offset", "hammer_pose - x_offset"),
        ("hammer_pose + z_offset - x_offset", "hammer_pose - x_offset + z_offset"),
        ("hammer_pose + z_offset - z_offset", "hammer_pose"),
        ("hammer_pose + z + z", "hammer_pose + 2*z_offset"),
        ("hammer_pose + 1e-1*z", "hammer_pose + 0.1*z_offset"),
        ("red-box_pose - z_offset", "red-box_pose - z_offset"),
        ("box 2_pose+z", "box 2_pose + z_offset"),
        ("table_approach", "table_approach"),
        ("hammer_pose + tilt", "hammer_pose + tilt"),
    ],
)
def test_expressions_have_one_canonical_form(written: str, canonical: str) -> None:
    assert str(TABLE.parse(written)) == canonical
    assert TABLE.parse(canonical) == TABLE.parse(written)


@pytest.mark.parametrize(
    ("written", "complaint"),
    [
        ("", "unknown pose"),
        ("screwdriver_pose", "valid: .*hammer_pose"),
        ("hammer_pose + w_offset", "valid: .*x_offset"),
        ("hammer_pose +", "cannot read"),
        ("hammer_pose ++ z", "cannot read"),
        ("hammer_pose + nan*z", "unknown offset"),
        ("hammer_pose + inf", "unknown offset"),
        ("hammer_pose + 1e999*z", "exceeds 1000"),
        ("hammer_pose + 5000*z", "exceeds 1000"),
        ("hammer_pose * 2", "unknown pose"),
        ("hammer_pose + (z)", "cannot read"),
        ("hammer_pose + z; drop", "cannot read"),
        ("+ z_offset", "unknown pose"),
        ("hammer_pose" + " + z" * 60, "at most 200"),
        ("__import__('os')", "unknown pose"),
        ("table", "unknown pose"),
    ],
)
def test_bad_expressions_say_what_is_wrong(written: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        TABLE.parse(written)


@given(st.text(max_size=220))
@settings(max_examples=300, deadline=None)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        parsed = TABLE.parse(text)
    except InputError:
        return
    assert TABLE.parse(str(parsed)) == parsed


terms = st.lists(
    st.tuples(
        st.sampled_from("+-"), st.floats(0.001, 100), st.sampled_from(["x", "y_off", "z_offset"])
    ),
    max_size=5,
)


@given(terms)
@settings(max_examples=100, deadline=None)
def test_offsets_add_up_along_the_tools_axes_and_world_z(
    chosen: list[tuple[str, float, str]],
) -> None:
    text = "red-box_pose" + "".join(f" {sign} {size!r}*{name}" for sign, size, name in chosen)
    if len(text) > MAX_EXPRESSION:
        return
    totals = {"x": 0.0, "y": 0.0, "z": 0.0}
    for sign, size, name in chosen:
        totals[name[0]] += size if sign == "+" else -size
    base = TABLE.poses["red-box_pose"]
    expected = (
        base.position
        + base.rotation[:, 0] * totals["x"] * 0.05
        + base.rotation[:, 1] * totals["y"] * 0.05
    )
    expected = expected + np.array([0, 0, totals["z"] * 0.12])
    assert TABLE.resolve(text).position == pytest.approx(expected, abs=1e-6)
    assert TABLE.resolve(text).angle_to(base) == pytest.approx(0, abs=1e-6)


def test_an_objects_own_offsets_come_first() -> None:
    assert TABLE.resolve("hammer + x").position[0] == pytest.approx(0.54)
    assert TABLE.resolve("red-box_pose + x").distance_to(
        TABLE.resolve("red-box_pose")
    ) == pytest.approx(0.05)
    with pytest.raises(InputError, match="unknown offset 'tilt'"):
        TABLE.resolve("red-box_pose + tilt")


def test_symbols_have_subjects_and_configurations() -> None:
    assert TABLE.subject("hammer + z") == "hammer"
    assert TABLE.subject("table_approach") == "table"
    assert TABLE.joints("home_config").shape == (7,)
    with pytest.raises(InputError, match="valid: home_config"):
        TABLE.joints("rest")


def test_joint_configurations_are_handed_out_as_copies() -> None:
    TABLE.joints("home_config")[:] = 9
    assert TABLE.joints("home_config")[0] == 0


def test_poses_computed_on_demand_are_computed_once() -> None:
    calls: list[int] = []

    def find() -> Pose:
        calls.append(1)
        return Pose.top_down((0.3, 0.3, 0.3), 0)

    table = make()
    table = Symbols(
        table.poses,
        {**table.subjects, "hammer_temporary": "hammer"},
        table.configurations,
        table.offsets,
        table.own_offsets,
        later={"hammer_temporary": find, "nowhere": lambda: None},
    )
    assert table.resolve("hammer_temporary + z").position == pytest.approx([0.3, 0.3, 0.42])
    assert table.resolve("hammer_temporary").position == pytest.approx([0.3, 0.3, 0.3])
    assert len(calls) == 1
    with pytest.raises(InputError, match="no free place"):
        table.resolve("nowhere")


def test_home_is_the_robots() -> None:
    scene = parse_scene("<mujoco><worldbody/></mujoco>")
    assert scene.symbols.joints("home_config").tolist() == load_description().home.tolist()


@pytest.mark.parametrize(
    ("name", "meant"),
    [("table_top", "table_approach"), ("hammer_top", "hammer_pose"), ("tabel_approach", "table_a")],
)
def test_the_guess_at_an_unknown_pose_is_of_the_same_object(name: str, meant: str) -> None:
    others = {f"{name}_top": Pose.top_down((0.5, 0, 0.4), 0.0) for name in ("bottle", "stable")}
    subjects = {**TABLE.subjects, "bottle_top": "bottle", "stable_top": "stable"}
    symbols = replace(TABLE, poses={**TABLE.poses, **others}, subjects=subjects)
    with pytest.raises(InputError, match=f"unknown pose '{name}'; did you mean '{meant}"):
        symbols.resolve(f"{name} + z_offset")
