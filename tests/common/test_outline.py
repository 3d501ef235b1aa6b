"""Slices, profiles and clearances against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.outline import (
    Convex,
    Obstacle,
    above,
    clearance,
    clip_polygon,
    depth,
    hull,
    profile,
    rectangle,
    rim,
    slab,
    unit,
    width,
)


def pyramid(half: float, height: float) -> Convex:
    points = np.array(
        [[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0], [0, 0, height]],
        float,
    )
    return Convex(points, np.column_stack(np.triu_indices(5, 1)))


@given(st.floats(0.02, 0.1), st.floats(0.05, 0.3), st.floats(0.05, 0.9))
@settings(max_examples=50, deadline=None)
def test_a_slice_of_a_pyramid_is_a_square(half: float, height: float, share: float) -> None:
    outline = slab(pyramid(half, height), share * height, height)
    assert width(outline, unit(0)) == pytest.approx(2 * half * (1 - share))


def test_a_slice_outside_the_shape_is_empty() -> None:
    assert len(slab(pyramid(0.1, 0.1), 0.2, 0.3)) == 0


def test_the_profile_of_a_disc_is_its_circle() -> None:
    angle = np.arange(360) * np.pi / 180
    disc = 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    stations = np.array([-0.06, -0.03, 0.0, 0.03])
    low, high = profile([rim(disc)], unit(0), unit(np.pi / 2), stations)
    assert np.isnan(low[0])
    assert high[1:] == pytest.approx([0.04, 0.05, 0.04], rel=2e-3)
    assert low[1:] == pytest.approx(-high[1:])


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0, 3.2))
@settings(max_examples=100, deadline=None)
def test_clearance_is_a_close_lower_bound_of_the_distance(x: float, y: float, turn: float) -> None:
    shape = rectangle(np.zeros(2), unit(turn), 0.05, 0.02)
    obstacle = rectangle(np.array([x, y]), unit(0.3), 0.08, 0.04)
    value = float(clearance(shape, np.zeros((1, 2)), [obstacle])[0])
    sides = np.linspace(0, 1, 40)
    edges_a = np.concatenate([a + sides[:, None] * (b - a) for a in shape for b in shape])
    edges_b = np.concatenate([a + sides[:, None] * (b - a) for a in obstacle for b in obstacle])
    distance = float(np.min(np.linalg.norm(edges_a[:, None] - edges_b, axis=-1)))
    assert value <= distance + 1e-9
    if distance > 0.01:
        assert value >= 0.98 * distance - 0.007


def test_nothing_in_the_way_is_infinitely_clear() -> None:
    assert clearance(np.zeros((1, 2)), np.zeros((3, 2)), []).tolist() == [np.inf] * 3


def test_obstacles_count_from_their_tops() -> None:
    low, high = (
        Obstacle.of(np.array([[0, 0, 0], [1, 0, 0], [0, 1, top]], float)) for top in (0.1, 0.3)
    )
    assert len(above([low, high], 0.2)) == 1
    assert len(above([low, high], 0.05)) == 2


SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def test_a_hull_is_made_of_corners_alone() -> None:
    polygon = hull(np.concatenate([SQUARE[::-1], [[0.5, 0.5], [1, 0.5], [0, 0]]]))
    assert sorted(polygon.tolist()) == sorted(SQUARE.tolist())
    assert depth(polygon, np.array([0.5, 0.5])) > 0  # counterclockwise


def test_a_polygon_without_area_has_no_inside() -> None:
    line = np.array([[1.0, 1], [0, 0], [2, 2], [0.5, 0.5]])
    assert hull(line).tolist() == [[0, 0], [2, 2]]
    assert hull(line[:1]).tolist() == [[1, 1]]
    assert hull(line[:0]).shape == (0, 2)
    assert depth(hull(line), np.array([1.0, 1.0])) == -np.inf
    assert clip_polygon(SQUARE, hull(line)).shape == (0, 2)


def test_a_polygon_is_clipped_by_another() -> None:
    shared = clip_polygon(SQUARE, SQUARE + 0.5)
    assert sorted(shared.tolist()) == [[0.5, 0.5], [0.5, 1], [1, 0.5], [1, 1]]
    assert clip_polygon(SQUARE, SQUARE * 3 - 1).tolist() == SQUARE.tolist()
    assert len(clip_polygon(SQUARE, SQUARE + 2.0)) == 0


def test_depth_is_the_way_to_the_nearest_side() -> None:
    assert depth(SQUARE, np.array([0.25, 0.5])) == pytest.approx(0.25)
    assert depth(SQUARE, np.array([-0.5, 0.5])) == pytest.approx(-0.5)
