"""Load data for the robot's own controller: units, frames and order of each format."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import components
from palpate.estimation.estimate import Estimate
from palpate.robots.owner import load_description
from palpate.runs.export import FORMATS

from ..estimation.logs.test_wrench import COM, INERTIA, MASS, estimate, record

TURN = Rotation.from_euler("xyz", [0.3, -0.5, 0.8])
TENSOR = TURN.as_matrix() @ np.diag([1e-3, 2e-3, 2.5e-3]) @ TURN.as_matrix().T


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> pp.Run:
    """A load on a sensor, with exact values and a turned inertia."""
    result = estimate(tmp_path_factory.mktemp("run"), record())
    values = {"mass": [MASS], "com": COM, "inertia": components(TENSOR)}
    exact = [
        Estimate.normal(
            Parameter("load", quantity), result[f"load.{quantity}"].unit, value, np.full(len(value), std), ""
        )
        for (quantity, value), std in zip(values.items(), (0.004, 1e-3, 1e-5), strict=True)
    ]  # fmt: skip
    return replace(result, estimates=tuple(exact))


def numbers(text: str) -> list[float]:
    return [float(part) for part in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_every_format_states_units_frame_and_deviation(run: pp.Run) -> None:
    for name in FORMATS:
        text = run.load_data(name)
        assert "0.400 ± 0.004 kg" in text
        if name != "franka-desk":
            assert "axes of the sensor, from its origin, mm: 10.0 ± 1.0, -6.0 ± 1.0" in text
            assert "inertia about the centre of mass" in text


def test_load_data_are_written_for_franka_desk(run: pp.Run) -> None:
    """The fields and lengths that Franka's documentation lists."""
    content = json.loads(run.load_data("franka-desk"))
    assert set(content) == {
        *("id", "name", "color", "mass", "centerOfMass", "transformation", "inertia")
    }
    assert content["mass"] == MASS
    assert content["centerOfMass"] == list(COM)
    assert np.reshape(content["transformation"], (4, 4)).tolist() == np.eye(4).tolist()
    np.testing.assert_allclose(np.reshape(content["inertia"], (3, 3)).T, TENSOR, atol=1e-11)
    assert re.fullmatch(r"[a-z0-9-]+", content["id"])
    assert not content["id"].startswith("ee-")


def test_load_data_are_written_for_libfranka(run: pp.Run) -> None:
    line = run.load_data("franka").splitlines()[-1]
    assert line.startswith("robot.setLoad(0.4, {{0.01, -0.006, 0.03}}, {{")
    np.testing.assert_allclose(np.reshape(numbers(line)[4:], (3, 3)), TENSOR, atol=1e-11)


def test_load_data_are_written_for_universal_robots(run: pp.Run) -> None:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz: not the order of a matrix's rows."""
    line = run.load_data("ur").splitlines()[-1]
    assert line.startswith("set_target_payload(0.4, [0.01, -0.006, 0.03], [")
    np.testing.assert_allclose(numbers(line)[4:], components(TENSOR), atol=1e-11)


def test_load_data_are_written_for_kuka(run: pp.Run) -> None:
    """The principal axes by A, B and C, and their moments, give the tensor back."""
    line = run.load_data("kuka").splitlines()[-1]
    match = re.fullmatch(
        r"LOAD_DATA\[1\]=\{M (.*),CM \{X (.*),Y (.*),Z (.*),A (.*),B (.*),C (.*)\},J \{X (.*),Y (.*),Z (.*)\}\}",
        line,
    )
    assert match is not None
    mass, x, y, z, a, b, c, *moments = (float(part) for part in match.groups())
    assert (mass, x, y, z) == (0.4, 10.0, -6.0, 30.0)
    axes = Rotation.from_euler("ZYX", [a, b, c], degrees=True).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, TENSOR, atol=1e-9)


def test_load_data_are_written_for_ros(run: pp.Run) -> None:
    content = yaml.safe_load(run.load_data("ros"))
    assert content["tool"] == {"CoG": list(COM), "gravity_field": [0.0, 0.0, -9.81], "mass": 0.4}
    assert content["sensor_frame"] == "ft_sensor"
    assert content["world_frame"] == "world"


def test_an_arms_load_is_in_the_axes_of_the_flange() -> None:
    """Franka's hand is turned by -45° about the flange's z axis, and its TCP is 103.4 mm from it."""
    pose = load_description("fr3").pose_flange_tcp
    np.testing.assert_allclose(pose.position, [0.0, 0.0, 0.1034], atol=1e-9)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        pose.apply([0.01, 0, 0]), [0.01 * half, -0.01 * half, 0.1034], atol=1e-7
    )


def test_an_unknown_inertia_is_a_point_mass_and_says_so(run: pp.Run) -> None:
    text = replace(run, estimates=run.estimates[:2]).load_data("ur")
    assert "[0, 0, 0, 0, 0, 0])" in text
    assert "inertia not identified: written as 0 (a point mass)" in text


@pytest.mark.parametrize(
    ("to", "options", "said"),
    [
        ("abb", {}, "unknown format of load data 'abb'"),
        ("ur", {"object": "lod"}, "did you mean 'load'"),
    ],
)
def test_an_unknown_format_or_load_is_refused(
    run: pp.Run, to: str, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        run.load_data(to, **options)


def test_a_load_that_is_not_identified_is_not_written(run: pp.Run, tmp_path: Path) -> None:
    wrong = record() | {"wrench": -record()["wrench"]}
    with pytest.raises(InputError, match=r"load\.mass is contradicted"):
        estimate(tmp_path, wrong).load_data("ur")
    with pytest.raises(InputError, match=r"load\.com was not measured"):
        replace(run, estimates=run.estimates[:1]).load_data("ur")
    with pytest.raises(InputError, match="load data need one load"):
        replace(run, estimates=()).load_data("ur")


def test_inertia_of_a_recording_is_written(tmp_path: Path) -> None:
    """Without exact values: the estimates themselves."""
    text = estimate(tmp_path, record()).load_data("ur").splitlines()[-1]
    mass, *rest = numbers(text)
    assert abs(mass - MASS) < 0.015
    np.testing.assert_allclose(rest[:3], COM, atol=4e-3)
    np.testing.assert_allclose(rest[3:6], INERTIA[:3], atol=4e-4)


@pytest.mark.parametrize("to", ["franka", "ur", "kuka", "ros"])
def test_a_name_with_line_breaks_stays_in_its_comment(run: pp.Run, to: str) -> None:
    """A scene's text may contain `name="cup&#10;halt()"`: a controller must not read its second line."""
    name = "cup\nhalt()\u2028halt()"
    renamed = [
        replace(item, parameter=Parameter(name, item.parameter.quantity)) for item in run.estimates
    ]
    plain = run.load_data(to).splitlines()
    lines = replace(run, estimates=tuple(renamed)).load_data(to).splitlines()
    assert len(lines) == len(plain)
    assert not [line for line in lines if line.startswith("halt")]
    assert "cup halt() halt(): mass" in lines[0]
