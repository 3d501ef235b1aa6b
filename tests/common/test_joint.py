"""Slide and hinge joints in the world."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Joint, Pose

SLIDE = Joint("slide", np.array([-1.0, 0.0, 0.0]), np.zeros(3), 0.0, 0.2, 0.05, 0.0)
HINGE = Joint("hinge", np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), -1.0, 0.0, 0.0, 0.0)
HANDLE = Pose.of([1.0, -0.4, 0.3])


@pytest.mark.parametrize("joint", [SLIDE, HINGE])
def test_the_travel_of_a_joint_is_recovered_from_the_motion_of_a_body(joint: Joint) -> None:
    moved = joint.motion(0.1) @ HANDLE
    assert joint.travels(HANDLE, moved.position[None])[0] == pytest.approx(0.1)
    step = joint.motion(1e-6) @ HANDLE
    way = (step.position - HANDLE.position) / 1e-6
    np.testing.assert_allclose(
        way, joint.lever(HANDLE.position) * joint.direction(HANDLE.position), atol=1e-6
    )


def test_a_hinge_turns_what_it_guides() -> None:
    moved = HINGE.motion(np.pi / 2) @ HANDLE
    np.testing.assert_allclose(moved.position, [1.4, 0.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(moved.rotation[:, 0], [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("joint", [SLIDE, HINGE])
def test_the_work_of_a_wrench_is_its_force_along_the_joint(joint: Joint) -> None:
    wrench = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    step = joint.motion(1e-6) @ HANDLE
    turn = joint.axis if joint.kind == "hinge" else np.zeros(3)
    work = wrench[:3] @ (step.position - HANDLE.position) / 1e-6 + wrench[3:] @ turn
    assert joint.along(HANDLE.position[None])[0] @ wrench == pytest.approx(work, abs=1e-5)


def test_a_joint_has_its_unit_and_its_remaining_travel() -> None:
    assert (SLIDE.unit(), SLIDE.unit("N·s"), HINGE.unit("N·s")) == ("m", "N·s/m", "N·m·s/rad")
    assert (SLIDE.room(1.0), SLIDE.room(-1.0)) == pytest.approx((0.15, 0.05))
