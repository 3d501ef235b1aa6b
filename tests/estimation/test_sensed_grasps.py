"""A load by the joint torques and by a six-axis sensor together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.common.pose import Array, rotations
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import acceleration
from palpate.estimation.sensed_load import fit_sensed_grasps
from palpate.trace.recording import WrenchSensor
from palpate.trace.samples import Trace

SCENARIOS = Path(pp.__file__).parent / "studies" / "scenarios"

MASS, HAND, NAME = 0.3, 0.76, "bottle"
SENSOR = WrenchSensor("test", (0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0), gain=0.005)


def with_sensor(trace: Trace, noise: float, seed: int = 0, gain: float = 1.0) -> Trace:
    """The trace with the wrench that holds the hand, 50 mm below the sensor, and the load at the TCP."""
    samples, random = trace.samples, np.random.default_rng(seed)
    axes = rotations(samples.pose_world_tcp[:, 3:])
    pulled = acceleration(samples, 0.05) + trace.gravity * np.eye(3)[2]
    local = np.einsum("nji,nj->ni", axes, pulled)
    loaded = load_rows(trace, NAME).loaded[:, None]

    def of(mass: float | Array, lever: list[float]) -> Array:
        force = mass * local
        return np.hstack([force, np.cross(lever, force)])

    wrench = gain * (of(HAND, [0.0, 0.0, 0.05]) + of(MASS * loaded, [0.0, 0.0, 0.1]))
    wrench += random.normal(size=wrench.shape) * noise * np.repeat([1.0, 0.05], 3)
    wrench += random.normal(size=6) * [3.0, 3.0, 3.0, 0.1, 0.1, 0.1]
    sensed = replace(samples, wrench_sensor=wrench)
    return replace(trace, samples=sensed, hand=replace(trace.hand, wrench_sensor=SENSOR))


@pytest.fixture
def trace(weighing: Callable[..., Trace], noises: dict[str, object]) -> Trace:
    return weighing(MASS, noises["datasheet"])


def test_a_sensor_without_noise_gives_the_weight(trace: Trace) -> None:
    found = fit_sensed_grasps(with_sensor(trace, 0.0), NAME)
    assert found is not None
    assert found.value[0] == pytest.approx(
        MASS * trace.gravity, abs=3.0 * found.covariance[0, 0] ** 0.5
    )


def test_weight_and_lever_about_the_tcp(trace: Trace) -> None:
    found = fit_sensed_grasps(with_sensor(trace, 0.05), NAME)
    assert found is not None
    std = np.sqrt(np.diag(found.covariance))
    weight = MASS * trace.gravity
    assert np.abs((found.value - [weight, 0.0, 0.0, 0.0]) / std).max() < 3.0
    # The gain of half a per cent is a part of the weight's deviation, and common to all runs of the arm.
    assert std[0] < 0.03
    assert found.gain[0] == pytest.approx(0.005 * weight, rel=0.1)


def test_intervals_hold_over_zeros_gains_and_noise(trace: Trace) -> None:
    z: list[float] = []
    for seed in range(12):
        gain = 1.0 + 0.005 * np.random.default_rng(seed + 100).normal()
        found = fit_sensed_grasps(with_sensor(trace, 0.1, seed, gain), NAME)
        assert found is not None
        z.append((found.value[0] - MASS * trace.gravity) / float(np.sqrt(found.covariance[0, 0])))
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert np.abs(z).max() < 3.0


def test_a_trace_without_a_sensor_or_an_empty_hand_has_no_such_load(trace: Trace) -> None:
    assert fit_sensed_grasps(trace, NAME) is None
    sensed = with_sensor(trace, 0.05)
    first = load_rows(sensed, NAME).grasps[0]
    assert fit_sensed_grasps(sensed.during(first + 1.0, first + 5.0), NAME) is None


@pytest.mark.long
def test_a_sensor_at_the_wrist_narrows_a_mass() -> None:
    """The same request for two arms: only the interval changes."""
    bottle = SCENARIOS / "bottle_and_table"
    found = [
        pp.run(
            bottle / "scene.xml",
            measure=["bottle.mass"],
            world=bottle / "world.xml",
            arm=arm,
            noise="measured",
            seed=0,
        )
        for arm in ("fr3", "fr3-ft")
    ]
    plain, sensed = (run["bottle.mass"] for run in found)
    assert sensed.identified
    assert sensed.stds[0] < min(0.0025, 0.6 * plain.stds[0])
    assert abs(float(sensed) - 0.254) < 3.0 * sensed.stds[0]
    assert found[0].plan.tree == found[1].plan.tree
    assert "gain of the wrench sensor" in {one.cause for one in sensed.shared}
