"""Load on the fingers, and permission to open them."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.primitives.load import NOTHING, FingerLoad
from palpate.robots.owner import load_description
from palpate.robots.pace import doubt


def wrench(z: float) -> np.ndarray:
    return np.array([0.0, 0.0, z, 0.0, 0.0, 0.0])


def test_weight_is_the_difference_from_the_empty_fingers() -> None:
    load = FingerLoad(wrench(0.5), 0.06, wrench(3.5))
    assert load.weight == pytest.approx(3.0)
    assert load.borne(wrench(-1.5)) == pytest.approx(-2.0)
    assert NOTHING.weight == 0.0


def test_weight_is_no_larger_than_the_mass_that_was_measured() -> None:
    load = FingerLoad(wrench(-2.9), 0.06, wrench(1.5)).after_weighing(0.15, 0.002, 9.81)
    assert load.weight == pytest.approx(1.53, abs=0.01)
    assert load.explain_carried_load(wrench(-1.0)) is None, "2.5 N are more than it weighs"
    assert FingerLoad(wrench(0.0), 0.06, wrench(1.4)).after_weighing(
        0.2, 0.1, 9.81
    ).weight == pytest.approx(1.4)


@pytest.mark.parametrize(
    ("felt", "opens"), [(10.5, False), (4.5, False), (3.0, True), (0.0, True), (-8.0, True)]
)
def test_fingers_stay_closed_while_they_bear_the_load(felt: float, opens: bool) -> None:
    load = FingerLoad(wrench(0.5), 0.06, wrench(10.5))
    assert (load.explain_carried_load(wrench(felt)) is None) == opens


def test_fingers_that_come_nearer_each_other_slip() -> None:
    load = FingerLoad(wrench(0.0), 0.06)
    assert load.slip(0.0595) is None
    assert load.slip(0.05) == "slip: the fingers closed from 60.0 to 50.0 mm"


def test_an_object_that_turns_between_the_pads_is_noticed() -> None:
    tool = Pose.top_down((0.5, 0.0, 0.3), 0.0)  # closing along world -y
    hanging = np.array([0.0, 0.0, 5.0, 0.0, 0.5, 0.0])
    load = FingerLoad(np.zeros(6), 0.03).set_hanging_load(hanging, tool)
    assert load.turned(hanging, tool) is None
    down = np.array([0.0, 0.0, 5.0, 0.0, 0.05, 0.0])
    assert "turns in the fingers" in str(load.turned(down, tool))
    # Joints that rub leave another moment behind a turn, with the hand empty as well.
    assert load.turned(down, tool, unrepeated=1.0) is None
    turned = Pose.top_down((0.5, 0.0, 0.3), np.pi / 2)  # carried on, turned about the vertical
    assert load.turned(np.array([0.0, 0.0, 5.0, -0.5, 0.0, 0.0]), turned) is None


def test_deviation_of_the_joint_sensors_is_no_turn() -> None:
    """A change of 0.3 N m between two places is within the stated accuracies, a drop of 2 is not."""
    arm, up = load_description(), np.array([0.0, 1.0, 0.0])
    q, tau = arm.home, np.array([0.0, -30.0, 0.0, 25.0, 1.0, 3.0, 0.0])
    here, there = doubt(arm, q, tau, up), doubt(arm, q + 0.3, 0.7 * tau, up)
    tool = Pose.top_down((0.5, 0.0, 0.3), 0.0)
    load = FingerLoad(np.zeros(6), 0.03).set_hanging_load(
        np.array([0, 0, 5.0, 0, 2.0, 0]), tool, here
    )
    assert load.turned(np.array([0, 0, 5.0, 0, 1.7, 0]), tool, there) is None
    assert load.turned(np.array([0, 0, 5.0, 0, 0.0, 0]), tool, there)


def test_errors_that_last_cancel_in_one_configuration() -> None:
    arm, up = load_description(), np.array([0.0, 1.0, 0.0])
    one = doubt(arm, arm.home, np.array([0.0, -30.0, 0.0, 25.0, 1.0, 3.0, 0.0]), up)
    assert one.of_change(one) == pytest.approx(np.sqrt(2.0) * one.fleeting)


@pytest.mark.parametrize(("felt", "opens"), [(0.9, False), (0.0, False), (-1.2, True)])
def test_object_of_unmeasurable_weight_must_be_pressed_on_its_support(
    felt: float, opens: bool
) -> None:
    load = FingerLoad(wrench(0.0), 0.06, wrench(0.8))
    assert (load.explain_carried_load(wrench(felt)) is None) == opens


def test_friction_of_a_support_is_bounded_while_the_load_is_dragged():
    load = FingerLoad(wrench(0.0), 0.06, wrench(3.0))
    assert load.rough == 1.0
    dragged = load.after_drag(np.array([4.0, 3.0, -7.0, 0, 0, 0]))
    assert dragged.rough == pytest.approx(1.3 * 5.0 / 10.0)
    assert load.after_drag(np.array([4.0, 0.0, 0.0, 0, 0, 0])) is load, "hardly pressed: not known"
    assert FingerLoad(wrench(0.0), 0.06).after_drag(np.array([1.0, 0, -9.0, 0, 0, 0])).rough == 1.0
