"""Convex polygons in the plane: hulls, parts, and how deep a point is inside."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.geometry.polygon import clipped, depth, hull

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def test_a_hull_is_made_of_corners_alone() -> None:
    found = hull(np.concatenate([SQUARE[::-1], [[0.5, 0.5], [1, 0.5], [0, 0]]]))
    assert sorted(found.tolist()) == sorted(SQUARE.tolist())
    assert depth(found, np.array([0.5, 0.5])) > 0  # counterclockwise


def test_what_has_no_area_has_no_inside() -> None:
    line = np.array([[1.0, 1], [0, 0], [2, 2], [0.5, 0.5]])
    assert hull(line).tolist() == [[0, 0], [2, 2]]
    assert hull(line[:1]).tolist() == [[1, 1]]
    assert hull(line[:0]).shape == (0, 2)
    assert depth(hull(line), np.array([1.0, 1.0])) == -np.inf
    assert clipped(SQUARE, hull(line)).shape == (0, 2)


def test_a_polygon_is_clipped_by_another() -> None:
    shared = clipped(SQUARE, SQUARE + 0.5)
    assert sorted(shared.tolist()) == [[0.5, 0.5], [0.5, 1], [1, 0.5], [1, 1]]
    assert clipped(SQUARE, SQUARE * 3 - 1).tolist() == SQUARE.tolist()
    assert len(clipped(SQUARE, SQUARE + 2.0)) == 0


def test_depth_is_the_way_to_the_nearest_side() -> None:
    assert depth(SQUARE, np.array([0.25, 0.5])) == pytest.approx(0.25)
    assert depth(SQUARE, np.array([-0.5, 0.5])) == pytest.approx(-0.5)
