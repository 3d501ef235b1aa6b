"""One description of an arm, from one folder; what is wrong with it is said by file and key."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from installed import install
from own_arm import SHEET, write_arm

from palpate.common.errors import InputError
from palpate.robots.description import neighbours
from palpate.robots.owner import arms, load_description
from palpate.scene.load import parse_scene


def test_the_figures_are_those_of_folder_and_mjcf() -> None:
    arm = load_description()
    assert (arm.name, arm.base, len(arm.links)) == ("fr3", "fr3_link0", 8)
    assert arm.tip == 0.009, "where the pads end"
    assert arm.limits.q_max[3] == -0.1169
    assert arm.limits.tau_max.tolist() == [87.0] * 4 + [12.0] * 3
    assert "fr3: Franka Research 3 with Franka Hand, 3 kg" in repr(arm)
    assert load_description("fr3") is arm


def test_an_unknown_arm_lists_the_valid_names() -> None:
    with pytest.raises(
        InputError,
        match=r"unknown arm 'abb'; valid: fr3, fr3-ft, iiwa14, panda, ur5e\. Or give a folder",
    ):
        load_description("abb")


def test_the_arm_decides_home() -> None:
    for name in ("fr3", "iiwa14"):
        scene = parse_scene("<mujoco><worldbody/></mujoco>", arm=load_description(name))
        assert scene.symbols.joints("home_config").tolist() == scene.arm.home.tolist()


def test_an_arm_of_ones_own_is_a_folder(tmp_path: Path) -> None:
    arm = load_description(f"{write_arm(tmp_path / 'mine')}/")
    assert (arm.name, arm.label, arm.base) == ("mine", "an arm of one's own", "foot")
    assert arm.tip == pytest.approx(0.01)
    assert arm.hand.palm == 0.029
    assert arm.hand.force == load_description().hand.force, "what it does not say is the FR3's"
    assert arm.limits.tau_max[0] == 150
    model = arm.spec().compile()
    assert (model.nq, model.nu, model.nkey, model.nlight) == (9, 0, 0, 0)
    assert model.body_pos[model.body("foot").id].tolist() == [0, 0, 0]
    assert model.dof_frictionloss[:7].max() == 0, "the gears' friction lies before the sensors"
    alone = mujoco.MjModel.from_xml_path(str(arm.mjcf))
    for name in (*arm.links, "gripper"):
        assert model.body(name).mass == pytest.approx(alone.body(name).mass)
    assert frozenset({"gripper", arm.links[-1]}) in neighbours(arm.spec(), arm)
    assert frozenset({"gripper", arm.links[1]}) not in neighbours(arm.spec(), arm)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("payload: 2.0", "payload: heavy"), "'payload': .*number"),
        (("payload: 2.0\n", ""), "'payload' is missing"),
        (
            ("  opening: 0.1", "  opening: 0.1\n  colour: red"),
            "unknown key 'hand.colour'; valid: body, boxes",
        ),
        (("velocity: [2, 2,", "velocity: [2,"), "'velocity': give a list of 7 numbers, .* not 6"),
        (
            ("like: fr3", "like: fr4"),
            "unknown arm 'fr4'; did you mean 'fr3'\\? valid: fr3, fr3-ft, iiwa14, panda, ur5e",
        ),
        (("j6, j7]", "j6, wrist]"), "unknown joint 'wrist'; valid: j1, j2"),
        (("body: gripper", "body: claw"), "unknown body 'claw'"),
        (("tcp: [0, 0, 0.1]", "tcp: tcp"), "unknown site 'tcp'"),
        (("torque: [150, 150, 100, 100, 50, 30, 30]\n", ""), "'torque' is missing"),
        (("1.3916, 0]", "0.3, 0]"), "z axis must point down"),
        (("mjcf: my_arm.xml", "mjcf: none.xml"), "cannot read .*none.xml: No such file"),
        (("label:", "label: ["), "not YAML"),
    ],
)
def test_an_invalid_description_is_refused_with_file_and_key(
    tmp_path: Path, changes: tuple[str, str], message: str
) -> None:
    folder = write_arm(tmp_path / "mine", SHEET.replace(*changes))
    with pytest.raises(InputError, match=message) as error:
        load_description(str(folder))
    assert str(folder) in str(error.value)


def test_a_six_axis_arm_without_a_sensor_is_refused(tmp_path: Path) -> None:
    sheet = SHEET.replace("j6, j7]", "j6]")
    with pytest.raises(InputError, match=r"names 6; give an arm with 7 joints, or one with 6 and"):
        load_description(str(write_arm(tmp_path / "six", sheet, links=6)))


def test_other_moving_joints_are_named(tmp_path: Path) -> None:
    ball = '<body name="ball"><freejoint name="rolls"/><geom size="0.1"/></body>'
    with pytest.raises(InputError, match="nothing else may move, but rolls does"):
        load_description(str(write_arm(tmp_path / "busy", more=ball)))


def test_fingers_that_do_not_close_along_y_are_refused(tmp_path: Path) -> None:
    folder = write_arm(tmp_path / "odd")
    text = (folder / "my_arm.xml").read_text()
    (folder / "my_arm.xml").write_text(
        text.replace('type="slide" axis="0 1 0"', 'type="slide" axis="1 0 0"')
    )
    with pytest.raises(InputError, match="against each other along the y axis of 'gripper'"):
        load_description(str(folder))


def test_a_package_brings_an_arm_by_its_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_arm(tmp_path / "their_arm")
    (folder / "__init__.py").write_text("")
    install(tmp_path, "their_arm", {"palpate.robots": "any = their_arm"}, {})
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "their_arm", raising=False)
    arms.cache_clear()
    try:
        assert list(arms()) == ["fr3", "fr3-ft", "iiwa14", "panda", "their_arm", "ur5e"]
        assert load_description("their_arm").limits.payload == 2.0
    finally:
        arms.cache_clear()


def test_numbers_of_an_arm_cannot_be_changed_by_who_reads_them() -> None:
    with pytest.raises(ValueError, match="read-only"):
        load_description().home[0] = 1.0
    assert np.isfinite(load_description().home).all()


def test_joints_without_limits_turn_a_revolution_either_way(tmp_path: Path) -> None:
    folder = write_arm(tmp_path / "mine")
    text = (folder / "my_arm.xml").read_text("utf-8")
    joint = re.search(r'<joint name="j1"[^>]*>', text)
    assert joint is not None
    free = re.sub(r' range="[^"]*"', "", joint[0])
    (folder / "my_arm.xml").write_text(text.replace(joint[0], free), "utf-8")
    limits = load_description(f"{folder}/").limits
    assert (limits.q_min[0], limits.q_max[0]) == (-2 * np.pi, 2 * np.pi)
    assert limits.q_max[1] < 2 * np.pi


@pytest.mark.parametrize(
    ("stated", "other", "message"),
    [
        (
            "palm: 0.029",
            "palm: 0.0374",
            r"'hand.palm' is 0.0374 m, and in .*my_arm.xml a shape of 'l7' is 0.0300 m",
        ),
        ("  palm: 0.029\n", "", r"'hand.palm' is 0.0374 m, and in .*my_arm.xml a shape of 'l7'"),
        (
            "tcp: [0, 0, 0.1]",
            "tcp: [0, 0.01, 0.1]",
            r"'hand.tcp' is not between the fingers of .*y -0.0100 m",
        ),
        ("tcp: [0, 0, 0.1]", "tcp: [0, 0, 0.15]", r"'hand.tcp' .* their end -0.0400 m beyond it"),
    ],
)
def test_figures_of_the_hand_that_differ_from_its_shapes_are_refused(
    tmp_path: Path, stated: str, other: str, message: str
) -> None:
    folder = write_arm(tmp_path / "mine", SHEET.replace(stated, other))
    with pytest.raises(InputError, match=r"description.yaml: " + message):
        load_description(f"{folder}/")
