"""Noise models by name and from files: the whole schema, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from installed import install
from noises import ARM
from pydantic import BaseModel

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.noise_levels import LEVELS
from palpate.robots.owner import apply_datasheet, load_description
from palpate.robots.simulated.noise import models
from palpate.robots.simulated.noise.model import DrawnValue, NoiseModel
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs.settings import Settings, request_json

SCHEMA = """
palpate_noise: 1
name: everything
extends: none
datasheet:
  force_resolution: 0.05
  force_repeatability: 0.15
  force_accuracy: 0.8
  pose_repeatability: 1.0e-4
  torque_gain_max: 0.01
  tip_offset: 0.009
  tip_offset_std: 2.0e-4
  tip_compliance: 1.0e-5
  tip_compliance_std: 5.0e-6
  rest_torque: 0.1
torque:
  white: [0.10, 0.10, 0.10, 0.10, 0.05, 0.05, 0.05]
  flicker: {level: [0.01, 0.01, 0.01, 0.01, 0.005, 0.005, 0.005], band: [0.003, 50]}
  drift: {size: 0.01, time_constant: .inf, warm_up: 0.1, warm_up_time: 1800}
  offset: 0.1
  gain_max: 0.01
  nonlinearity_max: 1e-3
  hysteresis: 1e-3
  crosstalk: 1e-3
  ripple: {size: 0.01, second: 5e-3, cycles: 200, resonance: {frequency: 11, damping: 0.2}}
  quantisation: 0.01
  range: [87, 87, 87, 87, 12, 12, 12]
  delay: 1e-3
  filter: 100
friction:
  coulomb: [0.08, 0.08, 0.06, 0.06, 0.03, 0.03, 0.03]
  static: 1.1
  stribeck_speed: 0.01
  viscous: 0.1
  presliding: 2.0e-3
  load: 1e-3
  spread: 0.1
  position: 0.1
  compensated: 0.5
sticking: {force: 0.15, torque: 0.01, settling: 0.08, release: .inf, relaxation: .inf, memory: 0.5}
model:
  link_mass: 0.005
  link_com: 3.0e-4
  hand_mass: 0.01
  hand_com: 1e-3
  payload_cable: 0.1
  base_tilt: 5e-4
  base_position: 1e-3
  base_yaw: 1e-3
  gravity: 0.01
  joint_offset: {fixed: [0, 1e-3, 0, 0, 0, 0, 0]}
  link_length: 1e-4
  joint_compliance: 1e-5
  tip_offset: 2.0e-4
  tip_lateral: 1e-4
  pad_compliance: 1e-5
  finger_width: 1e-4
pose:
  repeatability: 1.0e-4
  resettling: 2.0e-2
  encoder: 1e-6
  encoder_ripple: {size: 1e-6, second: 1e-6, cycles: 64}
  quantisation: 6e-6
  thermal: 1e-5
acquisition:
  outliers: {rate: 0.01, size: 1.0}
  dropped: {rate: 0.1, length: 0.005}
  repeated: 0.01
  jitter: 1e-4
  clock: 1e-5
environment:
  vibration: {acceleration: 0.01, frequency: 25.0}
sensor: {white: 1, drift: 1, offset: 10, gain: 1, crosstalk: 1, mounting: 1}
"""
"""Every key of version 1."""


def load(folder: Path, text: str, name: str = "mine.yaml") -> NoiseModel:
    path = folder / name
    path.write_text(text)
    return noise_models().load(str(path))


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as error:
        load(folder, text)
    return str(error.value)


def keys(form: type[BaseModel], before: str = "") -> set[str]:
    """Every key of a form that leads to a value."""
    found: set[str] = set()
    for name, field in form.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            found |= keys(inner, f"{before}{name}.")
        else:
            found.add(before + name)
    return found


def said(content: dict[str, Any], before: str = "") -> set[str]:
    found: set[str] = set()
    for name, value in content.items():
        if isinstance(value, dict) and "fixed" not in value:
            found |= said(value, f"{before}{name}.")
        else:
            found.add(before + name)
    return found


def test_the_schema_is_read_wholly(tmp_path: Path) -> None:
    assert said(yaml.safe_load(SCHEMA)) == keys(NoiseModel)
    found = load(tmp_path, SCHEMA)
    assert found.name == "everything"
    assert found.torque.drift.time_constant == np.inf
    assert found.torque.nonlinearity_max.size == pytest.approx(np.full(7, 1e-3)), "read as a text"
    fixed = found.model.joint_offset.fixed
    assert fixed is not None
    assert fixed.tolist() == [0, 1e-3, 0, 0, 0, 0, 0]


def test_a_robot_lives_in_a_world_with_everything(tmp_path: Path) -> None:
    (tmp_path / "all.yaml").write_text(SCHEMA)
    robot = MujocoRobot(empty(), Pose.of([0, 0, 0]), ARM, noise=str(tmp_path / "all.yaml"))
    robot.advance(0.5)
    samples = robot.drain()
    assert len(samples) > 90
    assert all(np.isfinite(values).all() for values in (samples.wrench, samples.q, samples.t))


def test_absent_parts_of_a_noise_model_are_perfect(tmp_path: Path) -> None:
    for found in (load(tmp_path, "palpate_noise: 1"), noise_models().load("none")):
        assert not nonzero(found)
    assert load(tmp_path, "torque:\n", "bare.yaml").name == "bare"


def nonzero(form: BaseModel) -> list[str]:
    """Keys of imperfections that are not nothing."""
    found: list[str] = []
    for name in keys(type(form)):
        value: Any = form
        for part in name.split("."):
            value = getattr(value, part)
        size = value.any if isinstance(value, DrawnValue) else np.any(value)
        neutral = ("law", "cycles", "band", "static", "range", "name", "palpate_noise", *POSITIVE)
        if size and not name.endswith(neutral) and not name.startswith("datasheet"):
            found.append(name)
    return sorted(found)


def test_own_models_say_what_the_description_says() -> None:
    lab, datasheet = noise_models().load("lab"), noise_models().load("datasheet")
    sensors, told = ARM.sensors, ARM.nominal
    assert lab.torque.white == pytest.approx(sensors.torque_noise)
    assert lab.friction.coulomb == pytest.approx(sensors.friction)
    assert lab.torque.drift.size == pytest.approx(np.full(7, sensors.drift))
    assert lab.model.tip_offset.size == pytest.approx(told.tip_offset_std)
    assert nonzero(lab) == [
        "friction.coulomb",
        "model.tip_offset",
        *(f"sensor.{key}" for key in ("crosstalk", "drift", "gain", "mounting", "offset", "white")),
        "torque.drift.size",
        "torque.gain_max",
        "torque.white",
    ]
    assert datasheet.torque.gain_max.size == pytest.approx(np.full(7, told.torque_gain))
    assert datasheet.sticking.force.size == pytest.approx(np.full(3, told.force_repeatability))
    assert datasheet.pose.repeatability.size == pytest.approx(np.full(3, told.pose_repeatability))
    assert datasheet.model.link_mass.size == pytest.approx(np.full(7, sensors.link_mass))


@pytest.mark.parametrize("arm", ["fr3", "iiwa14"])
@pytest.mark.parametrize("name", ["lab", "datasheet", "hardware", "measured"])
def test_the_owner_gets_the_drawn_gains(name: str, arm: str) -> None:
    described = load_description(arm)
    found = noise_models().load(name, described)
    told = apply_datasheet(described, found.datasheet).nominal.torque_gain
    assert found.torque.gain_max.size == pytest.approx(np.full(7, told))
    assert (told < described.nominal.torque_gain) == (name == "lab")


def test_other_arms_have_their_own_figures() -> None:
    iiwa = load_description("iiwa14")
    lab, hardware = (noise_models().load(name, iiwa) for name in ("lab", "hardware"))
    assert lab.torque.white == pytest.approx(iiwa.sensors.torque_noise)
    assert lab.friction.coulomb == pytest.approx(iiwa.sensors.friction)
    assert hardware.torque.range == pytest.approx(iiwa.limits.tau_max)


@pytest.mark.parametrize("name", LEVELS)
def test_every_figure_has_a_source_or_says_that_there_is_none(name: str) -> None:
    text = (Path(models.__file__).parent / f"{name}.yaml").read_text()
    figures = [
        line for line in text.splitlines() if any(c.isdigit() for c in line.partition("#")[0])
    ]
    for line in figures:
        if "palpate_noise" in line or "[0, 0" in line:
            continue
        before = text[: text.index(line)].splitlines()
        explained = "#" in line or any(row.lstrip().startswith("#") for row in before[-3:])
        assert explained, line


def test_the_stated_figures_change_no_world() -> None:
    hardware = noise_models().load("hardware")
    told = apply_datasheet(ARM, hardware.datasheet)
    assert told.nominal.tip_offset_std > 2 * ARM.nominal.tip_offset_std
    again = noise_models().load("hardware", told).model.tip_offset
    assert again.size == pytest.approx(hardware.model.tip_offset.size)


def test_keys_replace_those_of_the_model_that_is_extended(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("extends: lab\ntorque: {drift: {size: 0.5}}")
    found = load(tmp_path, "extends: base.yaml\nfriction: {static: 1.5}", "top.yaml")
    assert found.torque.drift.size == pytest.approx(np.full(7, 0.5))
    assert found.torque.drift.time_constant == 300
    assert found.torque.white == pytest.approx(ARM.sensors.torque_noise)
    assert found.friction.static == 1.5
    assert found.friction.coulomb == pytest.approx(ARM.sensors.friction)
    assert found.name == "top"
    fixed = load(tmp_path, "extends: lab\nmodel: {tip_offset: {fixed: -1e-3}}").model.tip_offset
    assert fixed.number(np.random.default_rng(0)) == pytest.approx(-1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("torque: {whit: 1}", ("unknown key 'torque.whit'", "white", "drift")),
        ("tork: {white: 1}", ("unknown key 'tork'", "torque", "extends")),
        ("torque: {white: [1, 2]}", ("torque.white", "7 numbers")),
        ("torque: {white: [[1, 2, 3, 4, 5, 6, 7]]}", ("torque.white", "7 numbers")),
        ("torque: {white: -1}", ("torque.white", "negative")),
        ("torque: {white: yes}", ("torque.white", "number")),
        ("torque: {white: {fixed: 1}}", ("torque.white", "number")),
        ("torque: {white: .nan}", ("torque.white", "number")),
        ("torque: {white: .inf}", ("torque.white", "finite")),
        ("torque: {flicker: {band: [50, 1]}}", ("torque.flicker.band", "below")),
        ("friction: {static: 0.9}", ("friction.static", "1")),
        ("friction: {law: lugre}", ("friction", "law", "coulomb")),
        ("friction: {presliding: 0}", ("friction.presliding", "positive")),
        ("friction: {compensated: 1.1}", ("friction.compensated", "1")),
        ("model: {tip_offset: -1}", ("model.tip_offset", "negative")),
        ("model: {tip_offset: {fix: 1}}", ("model.tip_offset", "fixed")),
        ("model: {joint_offset: {fixed: [1]}}", ("model.joint_offset", "7 numbers")),
        ("model: {joint_compliance: {fixed: -1}}", ("model.joint_compliance", "negative")),
        ("model: {base_tilt: {fixed: [0, 0, 0]}}", ("model.base_tilt", "2 numbers")),
        ("datasheet: {tip_offset_std: -1}", ("datasheet.tip_offset_std", "0")),
        ("acquisition: {repeated: 1}", ("acquisition.repeated", "1")),
        ("palpate_noise: 2", ("palpate_noise", "1")),
        ("extends: laboratory", ("laboratory", "none", "hardware")),
        ("extends: mine.yaml", ("extends itself",)),
        ("extends: [lab]", ("extends", "lab")),
        ("[1, 2]", ("keys of a noise model",)),
        ("torque: 3", ("torque",)),
        ("a: [", ("not YAML",)),
    ],
)
def test_an_invalid_noise_model_gets_an_error_of_one_line(
    tmp_path: Path, text: str, words: tuple[str, ...]
) -> None:
    message = refusal(tmp_path, text)
    assert "mine.yaml" in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_an_unknown_name_lists_the_models(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="unknown noise 'loud'; valid: datasheet, hardware, lab, measured, none"
    ):
        Settings(scene=Path("scene.xml"), noise="loud").check_values()
    with pytest.raises(InputError, match="cannot read"):
        Settings(scene=Path("scene.xml"), noise=str(tmp_path / "loud.yaml")).check_values()


def test_a_request_keeps_where_the_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loud.yaml").write_text("name: loud one")
    asked = Settings(scene=Path("scene.xml"), noise="loud.yaml").check_values()
    assert request_json(asked)["noise"] == str(tmp_path / "loud.yaml")
    assert noise_models().title("loud.yaml") == "loud one"
    assert noise_models().title("gone.yaml") == "gone"


def numbers() -> st.SearchStrategy[float]:
    return st.floats(0.0, 10.0, allow_nan=False)


NO_NUMBERS = {"palpate_noise", "name", "extends", "torque.flicker.band"}
PLACES = sorted(keys(NoiseModel) - NO_NUMBERS)
AT_LEAST_ONE = {"friction.static"}
POSITIVE = (
    "time_constant",
    "warm_up_time",
    "stribeck_speed",
    "presliding",
    "settling",
    "release",
    "relaxation",
    "resettling",
    "length",
    "frequency",
    "damping",
)


def content(place: str, value: Any) -> str:
    for name in reversed(place.split(".")):
        value = {name: value}
    return yaml.safe_dump(value)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.sampled_from(PLACES), value=numbers())
def test_every_key_takes_a_number_in_its_range(tmp_path: Path, place: str, value: float) -> None:
    if place in AT_LEAST_ONE:
        value += 1.0
    if place.endswith(POSITIVE):
        value += 0.1
    if place in ("friction.compensated", "sticking.memory", "acquisition.repeated"):
        value /= 10.1
    found: Any = load(tmp_path, content(place, value), f"{abs(hash((place, value)))}.yaml")
    for name in place.split("."):
        found = getattr(found, name)
    number = found.size if isinstance(found, DrawnValue) else found
    assert np.broadcast_to(value, np.shape(number)) == pytest.approx(number)


WRONG = st.one_of(
    st.floats(max_value=-1e-6, allow_infinity=False, allow_nan=False),
    st.booleans(),
    st.text("abcxyz", min_size=1),
    st.lists(numbers(), min_size=8, max_size=9),
    st.dictionaries(st.sampled_from(["size", "value", "fix"]), numbers(), min_size=1),
)


@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.sampled_from(PLACES), value=WRONG)
def test_no_key_takes_anything_else(tmp_path: Path, place: str, value: Any) -> None:
    path = tmp_path / f"{abs(hash((place, str(value))))}.yaml"
    path.write_text(content(place, value))
    with pytest.raises(InputError) as error:
        noise_models().load(str(path))
    assert place in str(error.value)
    assert "\n" not in str(error.value)


NOISY = """
from palpate.robots.simulated.noise.model import NoiseModel

bench = NoiseModel.model_validate({"name": "worn", "torque": {"white": 1.0}})
none = NoiseModel.model_validate({"name": "none", "torque": {"white": 1.0}})
"""
"""All there is to a noise model of one's own: one file, and an entry point."""


def test_a_noise_model_of_ones_own_is_one_file_and_an_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "noisy", {"palpate.noise": "worn = noisy_bench"}, {"noisy_bench": NOISY})
    monkeypatch.syspath_prepend(tmp_path)
    noise_models.cache_clear()
    try:
        assert noise_models().names == (*LEVELS, "worn")
        assert not noise_models().load("none").torque.white.any(), "ours stays ours"
        noisy = MujocoRobot(empty(), Pose.of([0, 0, 0]), ARM, noise="worn")
        noisy.advance(0.5)
        assert noisy.drain().tau_ext.std(0).max() > 0.1
        assert Settings(scene=Path("scene.xml"), noise="worn").check_values().noise == "worn"
    finally:
        noise_models.cache_clear()


def empty() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
