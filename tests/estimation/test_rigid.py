"""The ten inertial parameters, in numbers that cannot say what no body has."""

import numpy as np
import pytest

from palpate.common.pose import Pose, tensor_of
from palpate.estimation.rigid_bodies import (
    about_centre,
    linear,
    move_inertia,
    of_box,
    pseudo_inertia,
)


def test_a_box_is_what_it_weighs():
    size, centre = np.array([0.3, 0.1, 0.05]), np.array([0.02, 0.0, -0.01])
    theta = of_box(0.6, centre, size)
    mass, *first = linear(pseudo_inertia(theta))[:4]
    assert mass == pytest.approx(0.6)
    assert first == pytest.approx(0.6 * centre)
    squares = size**2
    expected = 0.6 / 12 * (squares.sum() - squares)
    assert about_centre(theta) == pytest.approx([*expected, 0.0, 0.0, 0.0])


def test_any_numbers_give_a_physical_body():
    rng = np.random.default_rng(0)
    for _ in range(50):
        theta = rng.normal(0.0, 1.5, 10)
        mass = linear(pseudo_inertia(theta))[0]
        moments = np.linalg.eigvalsh(tensor_of(about_centre(theta)))
        assert mass > 0
        assert (moments > 0).all()
        # No principal moment exceeds the sum of the others.
        assert moments[2] < moments[0] + moments[1]


def test_a_body_in_another_frame_has_the_same_invariants():
    theta = of_box(0.4, np.array([0.1, 0.0, 0.02]), np.array([0.2, 0.06, 0.04]))
    turned = Pose.of((0.3, -0.1, 0.2), (np.cos(0.3), 0.0, np.sin(0.3), 0.0))
    there = linear(move_inertia(pseudo_inertia(theta), turned))
    centre = turned.apply(np.array([0.1, 0.0, 0.02]))
    central = turned.rotation @ tensor_of(about_centre(theta)) @ turned.rotation.T
    about_origin = central + 0.4 * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    assert there[1:4] == pytest.approx(0.4 * centre)
    assert tensor_of(there[4:]) == pytest.approx(about_origin)
