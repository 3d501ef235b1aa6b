"""Sight and touch together: one Kalman update a touch, what it cannot tell, and what contradicts."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.belief import ERROR, SURE, Belief
from palpate.common.pose import Pose

SEEN = Pose.of((0.5, 0.1, 0.43))
SPREAD = np.diag(np.square([0.004, 0.003, 0.001, 0.01, 0.01, 0.05]))
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])


def test_a_touch_moves_a_pose_by_the_ratio_of_variances() -> None:
    after = Belief.of(SEEN, SPREAD).update("probe", X, SEEN.position, 0.005)
    gain = 0.004**2 / (0.004**2 + ERROR**2)
    assert after.pose.position - SEEN.position == pytest.approx([gain * 0.005, 0.0, 0.0])
    assert after.std(X) == pytest.approx(0.004 * np.sqrt(1.0 - gain))
    assert after.std(np.array([0.0, 1.0, 0.0])) == pytest.approx(0.003)
    assert not after.contradiction


def test_errors_after_touches_are_as_large_as_the_covariance_says() -> None:
    random = np.random.default_rng(0)
    whole = SPREAD + 5e-6 * np.outer((1.0, -1.0, 0.2, 0, 0, 3.0), (1.0, -1.0, 0.2, 0, 0, 3.0))
    squares = []
    for _ in range(200):
        error = np.linalg.cholesky(whole) @ random.standard_normal(6)
        belief = Belief.of(SEEN, whole)
        for along, aside in (
            (X, (-0.03, 0.02, 0.0)),
            (Z, (0.01, 0.0, 0.03)),
            (X, (-0.03, -0.02, 0)),
        ):
            lever = np.array(aside)
            true = along @ (error[:3] + np.cross(error[3:], lever))
            believed = belief.pose.position - SEEN.position
            turned = belief.pose.rotation
            small = np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
            gap = true - along @ (believed + np.cross(small, lever))
            met = float(gap + ERROR * random.standard_normal())
            belief = belief.update("probe", along, belief.pose.position + lever, met)
        left = np.concatenate([believed_error(belief, error)])
        squares.append(left @ np.linalg.solve(belief.covariance, left) / 6)
    assert 0.85 < np.sqrt(np.mean(squares)) < 1.15


def believed_error(belief: Belief, error: np.ndarray) -> np.ndarray:
    """True error less the believed one, (6,)."""
    turned = belief.pose.rotation
    small = [turned[2, 1], turned[0, 2], turned[1, 0]]
    return error - np.concatenate([belief.pose.position - SEEN.position, small])


def test_a_pushed_object_corrects_its_present_pose_only() -> None:
    related = SPREAD.copy()
    related[0, 1] = related[1, 0] = 0.9 * 0.004 * 0.003  # as seen along a ray
    after = Belief.of(SEEN, related).update("fingers", X, SEEN.position, 0.001, pushed=0.02)
    assert after.std(X) < 1.05 * ERROR
    assert after.std(np.array([0.0, 1.0, 0.0])) > 0.95 * 0.003
    assert after.placed is SEEN


def test_an_offset_of_three_deviations_contradicts_and_widens_sight() -> None:
    whole = float(np.hypot(0.004, ERROR))
    assert not Belief.of(SEEN, SPREAD).update("probe", X, SEEN.position, 2.9 * whole).contradiction
    after = Belief.of(SEEN, SPREAD).update("probe", X, SEEN.position, 5.0 * whole)
    assert after.contradiction.startswith(
        "it was met +20.6 ± 1.0 mm along +x from where it was seen, 5.0"
    )
    # Seen so badly that the touch is three deviations off, which leaves it where it was touched.
    left = 5.0 * whole - (after.pose.position - SEEN.position)[0]
    assert left < SURE * ERROR
    assert after.std(np.array([0.0, 1.0, 0.0])) > 0.004


def test_the_covariance_turns_with_a_carried_object() -> None:
    turned = Belief.of(SEEN, SPREAD).at(
        Pose.top_down((0.4, 0, 0.5), 0.0) @ Pose.turn((0, 0, np.pi / 2))
    )
    assert turned.std(X) == pytest.approx(0.003)
    assert turned.std(np.array([0.0, 1.0, 0.0])) == pytest.approx(0.004)
