"""`palpate calibrate`, and runs of an arm that was calibrated."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.robots.robot_config import read_config

from .conftest import TABLE, Answer, cube

GAINS = [0.0, 0.03, 0.0, 0.02, 0.0, 0.01, 0.0]
NOISE = f"""datasheet: {{torque_gain_max: 0.05, tip_offset_std: 1.0e-3}}
torque: {{white: 0.05, gain_max: {{fixed: {GAINS}}}}}
model: {{tip_offset: {{fixed: 6.0e-4}}}}
"""
GAUGE = """<body name="{name}" pos="{x} {y} 0.02">
  <geom type="box" size=".08 .08 .02" friction="0.6 0.005 0.0001"/></body>"""
SHELF = """<body name="shelf" pos="0.45 0.25 0.45"><geom type="box" size=".15 .1 .01"/></body>"""
SPOTS = ((0.4, -0.2), (0.4, 0.2), (0.6, 0.0))

Call = Callable[..., Answer]


def files(bodies: str, hidden: str = "") -> None:
    Path("noise.yaml").write_text(NOISE, encoding="utf-8")
    Path("scene.xml").write_text(TABLE.format(bodies=bodies), encoding="utf-8")
    Path("world.xml").write_text(TABLE.format(bodies=hidden or bodies), encoding="utf-8")


ARM = ("--scene", "scene.xml", "--world", "world.xml", "--noise", "noise.yaml", "--seed", "3")


@pytest.mark.long
def test_a_known_weight_makes_masses_right(palpate: Call) -> None:
    files(cube(mass='mass="0.5"'))
    Path("robot.yaml").write_text("speed: 0.9\ngravity: {value: 9.81}\n", encoding="utf-8")
    done = palpate("calibrate", "--weight", "0.5kg±0.1g", *ARM, "--json")
    assert done.status == 0, done.err
    document = json.loads(done.out)
    config = read_config(Path("robot.yaml"))
    assert config.torque_gain is not None
    assert config.simulated is not None
    assert (config.arm, config.simulated.seed, config.simulated.visits) == ("fr3", 3, 1)
    assert config.speed == 0.9, "other figures stay"
    assert config.torque_gain.date is not None
    assert config.torque_gain.by == "a weight of 0.5kg±0.1g"
    stds = np.sqrt(config.torque_gain.spread.diagonal())
    errors = (config.torque_gain.value - GAINS) / stds
    assert np.abs(errors).max() < 3.0
    assert stds[1] < 0.3 * 0.05 / np.sqrt(3), "the shoulder bears the weight"
    told_before = pytest.approx(0.05 / np.sqrt(3), rel=0.01)
    assert stds[0] == told_before, "its axis is upright: no better than was told, and no worse"
    assert [figure["name"] for figure in document["figures"]] == [
        f"torque_gain {i}" for i in range(1, 8)
    ]

    # Another load, on the same arm.
    files(cube(mass=""), cube(mass='mass="1.0"'))
    answer = palpate("run", *ARM, "--robot-config", "robot.yaml", "--json")
    (result,) = json.loads(answer.out)["parameters"]
    assert abs(result["value"] - 1.0) < 0.005, "gains of 2 to 3 % make 20 g of it"
    assert result["std"] < 0.005, "a half width of 5 % would leave 24 g"
    assert abs(result["value"] - 1.0) < 3 * result["std"]


@pytest.mark.long
def test_known_heights_determine_the_length_of_the_fingertips(palpate: Call) -> None:
    bodies = "".join(GAUGE.format(name=f"g{i}", x=x, y=y) for i, (x, y) in enumerate(SPOTS))
    files(bodies)
    done = palpate("calibrate", "--gauge", "40mm±0.02mm", *ARM)
    assert done.status == 0, done.err
    assert "tip_offset" in done.out
    config = read_config(Path("robot.yaml"))
    tip, repeated = config.tip_offset, config.pose_repeatability
    assert tip is not None
    assert repeated is not None
    assert tip.value == pytest.approx(0.009 + 6e-4, abs=1.5e-4)
    assert tip.std < 1e-4, "of 1 mm that was told: its frame does not lean, and is hardly bent"
    assert repeated.value < 5e-5, "this arm comes back to where it was, told are 0.1 mm"


def test_a_single_gauge_is_refused_before_any_motion(palpate: Call) -> None:
    files(GAUGE.format(name="g", x=0.5, y=0.0))
    done = palpate("calibrate", "--gauge", "40mm", *ARM)
    assert done.status == 2
    assert "gauges at one place, and 3 are needed" in done.err
    assert "MoveUntilContact" not in done.out + done.err


def test_an_obstacle_of_a_calibration_is_named_before_any_motion(palpate: Call) -> None:
    files(SHELF)
    done = palpate("calibrate", "--own-weight", *ARM)
    assert done.status == 2
    assert "into 'shelf'" in done.err
    assert "take away what is in the way" in done.err
    assert not Path("robot.yaml").exists()


def test_a_weight_of_another_mass_is_refused(palpate: Call) -> None:
    files(cube(mass='mass="0.5"'), cube(mass='mass="0.6"'))
    done = palpate("calibrate", "--weight", "500g", *ARM)
    assert done.status == 2
    assert "contradicts" in done.err
    assert "said to be 500g" in done.err
    assert not Path("robot.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("nothing to calibrate with", "--weight", "--own-weight")),
        (("--weight", "heavy"), ("the weight 'heavy' is no size", "0.5kg±0.1g")),
        (("--weight", "0.5mm"), ("no size",)),
        (("--weight", "0.5kg±1kg"), ("no size",)),
        (("--weight", "-1kg"), ("no size",)),
        (("--gauge", "50kg"), ("the gauge's height", "50mm±0.01mm")),
        (("--weight", "0.4kg", *ARM), ("states a mass of 0.5 kg for 'cube'", "0.4kg")),
        (("--weight", "cup=0.5kg", *ARM), ("unknown object 'cup'", "cube")),
        (("--gauge", "70mm", *ARM), ("no surface of the scene is 70mm high", "table")),
        (("--own-weight", "--robot", "franky://host"), ("a real arm needs", "--scene")),
        (("--own-weight", "--seed", "4", "--robot-config", "other.yaml"), ("another one",)),
        (("--own-weight", "--seed", "4", "--out", "other.yaml"), ("'other.yaml'", "seed 3")),
        (("--own-weight", "--arm", "iiwa14", "--out", "arm.yaml"), ("'arm.yaml'", "'fr3'")),
        (("--own-weight", "--out", "bad.yaml"), ("bad.yaml", "unknown key 'gain'")),
    ],
)
def test_bad_input_is_one_clear_error(
    palpate: Call, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    files(cube(mass='mass="0.5"'))
    Path("other.yaml").write_text("simulated: {noise: lab, seed: 3}", encoding="utf-8")
    Path("arm.yaml").write_text("arm: fr3", encoding="utf-8")
    Path("bad.yaml").write_text("gain: 1", encoding="utf-8")
    done = palpate("calibrate", *arguments)
    assert done.status == 2
    assert len(done.err.strip().splitlines()) == 1
    for word in words:
        assert word in done.err
    assert not Path("robot.yaml").exists()
