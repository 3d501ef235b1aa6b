"""The algebra of rigid poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.pose import SPACING, Pose, PoseLine

finite = st.floats(-10, 10, allow_subnormal=False)
points = st.tuples(finite, finite, finite)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    quaternion = draw(st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4))
    assume(np.linalg.norm(quaternion) > 1e-3)
    return Pose.of(draw(points), quaternion)


def same(a: Pose, b: Pose) -> bool:
    """`angle_to` loses half the digits near zero, so orientations are compared by their
    matrices."""
    return bool(
        np.allclose(a.position, b.position, atol=1e-9)
        and np.allclose(a.rotation, b.rotation, atol=1e-9)
    )


IDENTITY = Pose.of((0, 0, 0))


@given(poses())
def test_a_rotation_is_one(pose: Pose) -> None:
    assert np.linalg.norm(pose.quaternion) == pytest.approx(1.0)
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


@given(poses())
def test_the_inverse_undoes_a_pose(pose: Pose) -> None:
    assert same(pose @ pose.inverse(), IDENTITY)
    assert same(pose.inverse() @ pose, IDENTITY)
    assert same(pose.inverse().inverse(), pose)


@given(poses(), poses(), poses())
def test_composition_is_associative(a: Pose, b: Pose, c: Pose) -> None:
    assert same((a @ b) @ c, a @ (b @ c))


@given(poses(), poses())
def test_the_inverse_of_a_composition_turns_it_round(a: Pose, b: Pose) -> None:
    assert same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses())
def test_the_identity_changes_nothing(pose: Pose) -> None:
    assert same(IDENTITY @ pose, pose)
    assert same(pose @ IDENTITY, pose)


@given(poses(), poses(), points)
def test_applying_is_composing(a: Pose, b: Pose, point: tuple[float, float, float]) -> None:
    assert np.allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-9)
    assert np.allclose(a.inverse().apply(a.apply(point)), point, atol=1e-9)


@given(poses(), points)
def test_translation_is_along_the_reference_axes(
    pose: Pose, offset: tuple[float, float, float]
) -> None:
    moved = pose.translate(offset)
    assert np.allclose(moved.position - pose.position, offset, atol=1e-9)
    assert moved.angle_to(pose) == pytest.approx(0.0, abs=1e-6)
    assert moved.distance_to(pose) == pytest.approx(np.linalg.norm(offset), abs=1e-9)
    assert same(moved, Pose.of(offset) @ pose)


@given(poses(), poses(), poses())
def test_distance_and_angle_are_metrics(a: Pose, b: Pose, c: Pose) -> None:
    assert a.distance_to(b) == pytest.approx(b.distance_to(a))
    assert a.angle_to(b) == pytest.approx(b.angle_to(a))
    assert 0.0 <= a.angle_to(b) <= np.pi
    assert a.angle_to(c) <= a.angle_to(b) + b.angle_to(c) + 1e-6
    assert (c @ a).distance_to(c @ b) == pytest.approx(a.distance_to(b), abs=1e-9)


@given(poses())
def test_both_signs_of_a_quaternion_are_one_orientation(pose: Pose) -> None:
    other = Pose(pose.position, -pose.quaternion)
    assert same(pose, other)
    assert pose.angle_to(other) == pytest.approx(0.0, abs=1e-6)


@given(points, st.floats(-np.pi, np.pi))
def test_top_down_points_down_and_closes_along_its_yaw(
    position: tuple[float, float, float], yaw: float
) -> None:
    x, y, z = Pose.top_down(position, yaw).rotation.T
    assert z == pytest.approx([0, 0, -1], abs=1e-12)
    assert x == pytest.approx([np.cos(yaw), np.sin(yaw), 0], abs=1e-12)
    assert y == pytest.approx([np.sin(yaw), -np.cos(yaw), 0], abs=1e-12)


@given(poses())
def test_the_vector_of_a_pose_is_position_then_quaternion(pose: Pose) -> None:
    assert same(Pose(pose.vector[:3], pose.vector[3:]), pose)


def test_a_right_angle_turns_x_to_y() -> None:
    quarter = Pose.of((1, 0, 0), (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))
    assert quarter.apply((1, 0, 0)) == pytest.approx([1, 1, 0])
    assert quarter.angle_to(IDENTITY) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    "quaternion", [(0, 0, 0, 0), (np.nan, 0, 0, 1), (np.inf, 0, 0, 0), (1e-12, 0, 0, 0)]
)
def test_a_quaternion_of_zeros_or_nan_is_refused(quaternion: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="not a rotation quaternion"):
        Pose.of((0, 0, 0), quaternion)


def test_local_undoes_apply() -> None:
    pose = Pose.of((0.3, -0.2, 0.5), (0.5, 0.1, -0.7, 0.2))
    assert pose.local(pose.apply((0.1, 0.2, -0.3))) == pytest.approx((0.1, 0.2, -0.3))


LINE = PoseLine.spanning(
    Pose.of([0.5, 0.0, 0.1]), np.array([0.0, 0.05, 0.0]), np.array([0.6, 0.02, 0.0])
)


def test_a_line_believes_the_place_nearest_to_a_point():
    assert LINE.believed == pytest.approx(0.02)
    assert LINE.at(LINE.believed).position == pytest.approx([0.5, 0.02, 0.1])


def test_no_place_is_outside_the_region():
    assert LINE.nearest(np.array([0.5, 0.3, 0.0])) == pytest.approx(0.05)
    with pytest.raises(InputError, match="60 mm along is outside -50 to 50 mm"):
        LINE.at(0.06)


def test_places_hold_both_ends_and_are_close():
    places = LINE.places()
    assert places[0] == pytest.approx(-0.05)
    assert places[-1] == pytest.approx(0.05)
    assert np.diff(places).max() <= SPACING + 1e-12
