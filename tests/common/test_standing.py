"""What comes to rest on a level plane: how it tips where it could not stay."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from palpate.common.outline import tip_to_rest
from palpate.common.pose import Array


def corners(centre: tuple[float, float, float], half: tuple[float, float, float]) -> Array:
    return np.array(centre) + np.array(list(product((-1.0, 1.0), repeat=3))) * half


HAMMER = np.concatenate(
    [
        corners((0.0, 0.0, 0.018), (0.13, 0.012, 0.012)),
        corners((0.145, 0, 0.018), (0.015, 0.045, 0.018)),
    ]
)
"""A handle whose bottom is 6 mm above its head's."""


def test_a_box_stays() -> None:
    moved = tip_to_rest(corners((0.4, 0.1, 0.05), (0.02, 0.03, 0.05)), np.array([0.4, 0.1, 0.05]))
    assert np.array_equal(moved.position, np.zeros(3))
    assert moved.quaternion[0] == 1.0


@pytest.mark.parametrize("com", [-0.1, 0.0, 0.062])
def test_a_hammer_lies_on_its_head_and_the_end_of_its_handle(com: float) -> None:
    moved = tip_to_rest(HAMMER, np.array([com, 0.0, 0.018]))
    z = (HAMMER @ moved.rotation.T + moved.position)[:, 2]
    assert z.min() > -1e-9
    assert np.count_nonzero(z < 1e-6) == 4  # two corners of each
    assert 2.0 * np.arccos(moved.quaternion[0]) == pytest.approx(np.arctan2(0.006, 0.26), rel=1e-6)


def test_a_hammer_that_is_balanced_on_its_head_stays() -> None:
    assert tip_to_rest(HAMMER, np.array([0.15, 0.0, 0.018])).quaternion[0] == 1.0


def test_a_body_that_would_fall_keeps_its_pose() -> None:
    leaning = corners((0.0, 0.0, 0.1), (0.02, 0.02, 0.1)) @ np.array(
        [[0.9, 0.0, -0.436], [0.0, 1.0, 0.0], [0.436, 0.0, 0.9]]
    )
    assert tip_to_rest(leaning, leaning.mean(axis=0)).quaternion[0] == 1.0
