"""Gains from the arm's own weight, on synthetic torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.estimation.wrench_observation import gain_root
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.owner import load_description
from palpate.runs.calibration.gains import gains_from_own_weight, own_weight_tree
from palpate.trace.recording import Context, Recording
from palpate.trace.samples import FORCES, Samples, Trace

ARM = load_description()
DOWN = np.array([0.0, 0.0, -9.81])
ROWS = 20
FRICTION = 0.5 * ARM.sensors.friction


def trace(gains: Array, heavier: float = 0.0, seed: int = 0, count: int = 30) -> Trace:
    """Trace of an arm at rest in many configurations, with sensor gains `gains` (7,), links 1 + `heavier`
    times as heavy as nominal, and friction."""
    random, nominal = np.random.default_rng(seed), NominalArm(ARM, Pose.of([0, 0, 0]), DOWN)
    asked = [
        dict(node.args)["joints"]
        for node in own_weight_tree(ARM).children
        if isinstance(dict(node.args).get("joints"), list)
    ]
    q = np.array([ARM.home, *asked[:count]])
    here = nominal.kinematics(q)
    weight = here.gravity_torque - here.gravity_torque[0]
    torque = weight * ((1.0 + gains) * (1.0 + heavier) - 1.0)
    torque[1:] += FRICTION * random.uniform(-1.0, 1.0, (len(q) - 1, 7))
    wrench = wrenches(here.jacobian, torque[:, :, None])[:, :, 0]
    rows = np.repeat(np.arange(len(q)), ROWS)
    t, nothing = 0.005 * np.arange(len(rows)), np.zeros((len(rows), 7))
    samples = Samples(
        t,
        q[rows],
        nothing,
        torque[rows],
        wrench[rows],
        here.pose_world_tcp[rows],
        np.zeros((len(rows), 6)),
        here.pose_world_tcp[rows],
        np.zeros(len(rows)),
    )
    still = Context("still")
    recordings = [
        Recording(FORCES, float(t[i * ROWS]), float(t[(i + 1) * ROWS - 1]), still)
        for i in range(1, len(q))
    ]
    return Trace(samples, (), tuple(recordings), (), ARM.nominal)


def test_gains_are_estimated_within_their_standard_deviations() -> None:
    random, errors = np.random.default_rng(1), list[Array]()
    for seed in range(8):
        gains = ARM.nominal.torque_gain * random.uniform(-1.0, 1.0, 7)
        belief = gains_from_own_weight(trace(gains, seed=seed), ARM)
        stds = np.sqrt(belief.covariance.diagonal())
        errors.append((belief.mean - gains)[1:6] / stds[1:6])
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.abs(errors).max() < 4.0


def test_a_shoulder_is_known_better_than_before_and_an_upright_axis_is_not() -> None:
    gains = gains_from_own_weight(trace(np.zeros(7)), ARM)
    before = np.sqrt((gain_root(ARM.nominal, 7) ** 2).sum(axis=1))
    stds = np.sqrt(gains.covariance.diagonal())
    assert stds[1] < 0.5 * before[1]
    assert stds[0] == pytest.approx(before[0], rel=1e-3)


def test_heavier_links_do_not_pass_for_gains_beyond_the_link_accuracy() -> None:
    """Links 0.5 % too heavy look like gains of 0.5 %, and the standard deviation covers that."""
    gains = gains_from_own_weight(trace(np.zeros(7), heavier=0.005), ARM)
    assert np.abs(gains.mean / np.sqrt(gains.covariance.diagonal())).max() < 3.0


def test_gains_outside_their_stated_accuracy_are_contradicted() -> None:
    """Sensors stated to be accurate to 0.1 % that are 5 % off."""
    recording = trace(np.array([0, 0.05, 0, 0.05, 0, 0, 0]))
    known = tuple(map(tuple, (1e-6 * np.eye(7)).tolist()))
    sure = replace(recording, hand=replace(recording.hand, gain_covariance=known))
    with pytest.raises(InputError, match=r"own weight contradicts.*calibrated wrongly"):
        gains_from_own_weight(sure, ARM)


def test_too_few_rests_are_refused() -> None:
    with pytest.raises(InputError, match="rested in 5 configurations"):
        gains_from_own_weight(trace(np.zeros(7), count=5), ARM)
