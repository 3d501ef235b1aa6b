"""`palpate teach` and `palpate doctor --robot`, through the command line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.app import app
from palpate.scene.load import load_scene
from tests.fci.served import own_address, served

DESK = """<mujoco><worldbody>
  <site name="robot_base" pos="0 0 .1"/>
  <geom name="desk" type="box" size=".3 .4 .1" pos=".5 0 .1"/>
  <body name="mug" pos=".5 0 .25"><freejoint/><geom type="box" size=".03 .02 .05" mass=".3"/></body>
  <body name="box" pos=".5 .2 .23"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    path = tmp_path / "desk.xml"
    path.write_text(DESK, encoding="utf-8")
    return path


def asked(*arguments: object, typed: str = "") -> tuple[int, str]:
    """Exit status, and everything printed."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments], input=typed)
    return done.exit_code, " ".join((done.stdout + done.stderr).split())


def test_a_ruler_s_numbers_become_poses(desk: Path, tmp_path: Path) -> None:
    file = tmp_path / "poses.yaml"
    status, text = asked("teach", desk, "--out", file, typed="mug 45cm -120mm 30°\nbox 0.4\n\n")
    assert status == 0, text
    assert "mug at (0.450, -0.120, 0.250) m, turned by +30°" in text
    assert "still missing: box" in text
    assert "Names: box, mug >" in text or "Names: mug, box >" in text
    assert "'box 0.4' is not NAME AHEAD LEFT [TURN]" in text
    mug = load_scene(desk, file).body("mug").pose_world
    assert mug.position == pytest.approx([0.45, -0.12, 0.25], abs=1e-4)
    assert math.atan2(mug.rotation[1, 0], mug.rotation[0, 0]) == pytest.approx(math.radians(30))


def test_earlier_poses_are_kept_and_no_file_is_overwritten(desk: Path, tmp_path: Path) -> None:
    first, both = tmp_path / "first.yaml", tmp_path / "both.yaml"
    first.write_text("objects: {box: {pos: [0.4, 0.1, 0.23]}}\noffsets: {z_offset: 0.2}\n", "utf-8")
    status, text = asked("teach", desk, "--poses", first, "--out", both, typed="mug .5 0\n\n")
    assert (status, "every object is taught" in text) == (0, True), text
    scene = load_scene(desk, both)
    assert scene.body("box").pose_world.position == pytest.approx([0.4, 0.1, 0.23])
    assert asked("teach", desk, "--out", both, typed="mug .5 0\n\n")[0] == 2


def test_a_length_beyond_every_arms_reach_is_refused_at_once(desk: Path, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    status, text = asked("teach", desk, "--out", file, typed="mug 500 -120\nmug 500mm -120mm\n\n")
    assert status == 0, text
    assert "500 m is out of every arm's reach: did you mean 500mm or 500cm?" in text
    assert load_scene(desk, file).body("mug").pose_world.position[0] == pytest.approx(0.5)


def test_names_that_the_scene_does_not_have_are_refused(desk: Path, tmp_path: Path) -> None:
    status, text = asked("teach", desk, "--out", tmp_path / "p.yaml", typed="cup 0.5 0\n\n")
    assert status == 2
    assert "unknown object 'cup'; valid: box, mug" in text
    assert "nothing is written" in text


def test_a_doctor_without_arguments_checks_this_machine(desk: Path) -> None:
    status, text = asked("doctor", "--robot", f"franky://{own_address()}")
    assert status == 5
    assert "Connection refused" in text
    assert "activate FCI in Desk" in text


@pytest.mark.long
def test_an_arm_is_examined_and_its_hand_teaches_poses(desk: Path, tmp_path: Path) -> None:
    """A served arm at home, whose hand is above neither thing."""
    pytest.importorskip("franky", reason="franky-control has no wheel for this machine")
    with served(desk) as bench:
        url = f"franky://{bench.address}"
        status, text = asked("doctor", "--robot", url, "--yes")
        for line in (
            "version 10, as franky-control's (10)",
            "mode ready",
            "errors none",
            "joint margins joint",
            "end effector 0.7",
            "TCP 0.0",
            "gravity residual joint",
            "hand opens 80 mm",
            "answered cycles 100.0 %",
        ):
            assert line in text, text
        bench.ask("end_effector", mass=2.0)
        config = tmp_path / "robot.yaml"
        config.write_text("end_effector: {mass: 0.76, centre: [0, 0, 0.05]}\n", "utf-8")
        status, text = asked("doctor", "--robot", url, "--robot-config", config, "--yes")
        assert status == 5
        assert "set the same in Desk" in text
        assert "an arm that is not well does not hold itself" in text
        config.write_text("end_effector: {mass: 2.0, centre: [0.1, 0, 0.05]}\n", "utf-8")
        _, text = asked("doctor", "--robot", url, "--robot-config", config, "--yes")
        assert "robot.yaml says 2.000 kg at [71, -71, 50] mm: set the same in Desk" in text
        bench.ask("end_effector", mass=0.76)
        file = tmp_path / "poses.yaml"
        status, text = asked("teach", desk, "--robot", url, "--out", file, typed="mug\nbin\n\n")
    assert status == 0, text
    assert "mug at (0." in text
    assert "bin: the hand at (0.3" in text
    scene = load_scene(desk, file)
    assert scene.symbols.resolve("bin").position[0] == pytest.approx(0.307, abs=0.005)
    mug = scene.body("mug").pose_world.position
    assert mug == pytest.approx([0.307, 0.0, 0.25], abs=0.005)
