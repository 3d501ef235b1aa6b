"""Several estimates made into one: what they have in common is not averaged away."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, Shared
from palpate.estimation.fusion import Source, fuse

MASS, COM = Parameter("mug.mass"), Parameter("mug.com")
OWN, GAIN = 0.001, 0.0008
TRUTH = 0.25


def estimate(
    value: float, own: float = OWN, gain: float = GAIN, freedom: float = math.inf
) -> Estimate:
    std = math.hypot(own, gain)
    half = std * (1.96 if math.isinf(freedom) else float(stdtrit(freedom, 0.975)))
    return Estimate(
        MASS,
        "kg",
        np.array([value]),
        np.array([std]),
        np.array([[value - half, value + half]]),
        "Weighed.",
        shared=(Shared("gain of joint 4", "arm", (gain,)),),
        freedom=freedom,
    )


def sources(*estimates: Estimate, arm: str = "the arm") -> list[Source]:
    return [Source(f"run {i + 1}", arm, one) for i, one in enumerate(estimates)]


def arms(*estimates: Estimate) -> list[Source]:
    """Each by an arm of its own."""
    return [replace(s, arm=f"arm {i}") for i, s in enumerate(sources(*estimates))]


def test_a_fusion_of_a_single_run_equals_the_run() -> None:
    alone = estimate(0.25)
    assert fuse(sources(alone)) is alone


def test_shared_errors_of_runs_are_not_averaged_away() -> None:
    for count in (2, 5, 100):
        found = fuse(sources(*[estimate(TRUTH)] * count))
        assert found.stds[0] == pytest.approx(math.hypot(OWN / math.sqrt(count), GAIN), rel=1e-6)
        assert found.shared_std[0] == pytest.approx(GAIN, rel=1e-6)
        assert found.identified


def test_arms_of_their_own_share_no_gain() -> None:
    found = fuse(arms(*[estimate(TRUTH)] * 4))
    assert found.stds[0] == pytest.approx(math.hypot(OWN, GAIN) / 2, rel=1e-6)
    assert found.stds[0] < GAIN


def test_causes_cancel_where_they_act_the_other_way_round() -> None:
    found = fuse(sources(estimate(TRUTH), estimate(TRUTH, gain=-GAIN)))
    assert found.stds[0] == pytest.approx(OWN / math.sqrt(2), rel=1e-6)


def test_a_run_is_not_compared_with_itself() -> None:
    """Unequal effects of one cause would let the difference of two runs tell the cause."""
    narrow, wide = estimate(0.250, gain=0.001, own=1e-5), estimate(0.260, gain=0.005, own=1e-5)
    found = fuse(sources(narrow, wide))
    assert found.values[0] == pytest.approx(0.250)
    assert found.stds[0] == pytest.approx(0.001, rel=1e-3)


def test_an_estimate_that_does_not_say_what_it_shares_shares_all() -> None:
    silent = replace(estimate(TRUTH), shared=())
    found = fuse(arms(silent, replace(silent, values=np.array([TRUTH + OWN]))))
    assert found.stds[0] == pytest.approx(silent.stds[0], rel=1e-6)
    assert found.identified, "by as much they may differ"


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    """Of 3 runs with one gain error, 600 times; noise known with 6 degrees of freedom each."""
    random, freedom, covered, errors = np.random.default_rng(4), 6.0, 0, []
    for _ in range(600):
        gain = random.normal(0.0, GAIN)
        runs: list[Estimate] = []
        for _ in range(3):
            stated = OWN * math.sqrt(random.chisquare(freedom) / freedom)
            value = TRUTH + gain + random.normal(0.0, OWN)
            runs.append(estimate(value, own=stated, freedom=freedom))
        found = fuse(sources(*runs))
        low, high = found.intervals[0]
        covered += int(low <= TRUTH <= high)
        errors.append(float(found.z_score(TRUTH)))
    # Binomial 95 % of 600 at 0.95: 560 to 580; weights that follow the noise cost a little.
    assert 552 <= covered <= 588
    assert 0.85 < float(np.std(errors)) < 1.25


def test_degrees_of_freedom_are_those_of_the_noise_that_is_left() -> None:
    one = estimate(TRUTH, freedom=6.0, gain=0.0)
    found = fuse(sources(one, one))
    assert found.freedom == pytest.approx(12.0, rel=1e-6)
    shared = fuse(sources(estimate(TRUTH, freedom=6.0), estimate(TRUTH, freedom=6.0)))
    assert shared.freedom > 12.0
    half = float(found.intervals[0, 1] - found.values[0])
    assert half == pytest.approx(float(found.stds[0]) * float(stdtrit(12.0, 0.975)), rel=1e-6)


def test_runs_that_disagree_contradict_each_other() -> None:
    found = fuse(sources(estimate(0.250), estimate(0.2505), estimate(0.262)))
    assert found.verdict == "contradicted"
    assert "run 3 0.2620 ± 0.0013 kg" in found.contradiction
    assert found.contradiction.endswith("Farthest from the others is run 3.")
    # By what they share they do not differ.
    near = fuse(sources(estimate(0.250, gain=0.01), estimate(0.256, gain=0.01)))
    assert near.verdict == "contradicted"
    assert fuse(arms(estimate(0.250, gain=0.01), estimate(0.256, gain=0.01))).identified


def test_vectors_are_fused_by_component() -> None:
    def com(x: float, y: float) -> Estimate:
        shared = (Shared("pose along x", "scene", (0.001, 0.0, 0.0)),)
        made = Estimate.normal(COM, "m", (x, y, 0.0), (0.0014142, 0.001, 0.009), "")
        return replace(made, shared=shared)

    found = fuse(arms(com(0.06, 0.0), com(0.06, 0.0)))
    assert found.stds == pytest.approx(
        [math.sqrt(1.5e-6), 0.001 / math.sqrt(2), 0.0063640], rel=1e-3
    )
    assert found.shared[0].of == "scene"
    assert found.shared[0].effect == pytest.approx((0.001, 0.0, 0.0))
