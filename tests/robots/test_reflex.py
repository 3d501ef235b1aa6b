"""What the arm bears before it stops itself."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.robots.nominal import NominalArm, explain_torque
from palpate.robots.owner import arms
from palpate.robots.pace import unexplained_torque
from palpate.robots.sheet import Links, Reflex


def wrench(*force: float, torque: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return np.array([*force, *torque])


def test_a_reflex_names_the_measured_and_the_allowed_force() -> None:
    reflex = Reflex(20.0, 8.0)
    assert reflex.fired(wrench(0, 12, -12)) is None
    assert reflex.fired(wrench(0, 15, -15)) == (
        "unexpected contact: the arm stopped itself at 21.2 N, more than 20 N"
    )
    turning = reflex.fired(wrench(0, 0, 0, torque=(0, 8.5, 0)))
    assert turning == "unexpected contact: the arm stopped itself at 8.5 N m, more than 8 N m"


def test_sideways_force_has_its_own_threshold() -> None:
    sliding = Reflex(60.0, 15.0, sideways=25.0)
    assert sliding.fired(wrench(20, -14, 50)) is None
    assert sliding.fired(wrench(20, -16, 0)) == (
        "unexpected contact: the arm stopped itself at 25.6 N sideways, more than 25 N"
    )
    assert sliding.least == 15.0
    assert Reflex(60.0, 15.0).fired(wrench(40, 0, 0)) is None


def test_a_load_may_hang_on_the_hand_but_not_press_on_it() -> None:
    carrying = Reflex(20.0, 8.0, load=30.0)
    assert carrying.fired(wrench(0, 0, 45)) is None
    assert carrying.fired(wrench(0, 0, 51))
    assert carrying.fired(wrench(0, 0, -21))


def test_a_pressing_force_may_linger_but_a_new_force_triggers() -> None:
    leaving = Reflex(12.0, 6.0, pressed=(0.0, 3.0, -11.0))
    assert leaving.fired(wrench(0, 4, -12)) is None, "friction turns round on the way"
    for force in (wrench(0, 0, 12.5), wrench(12.5, 0, 0), wrench(-9, 12, -11), wrench(0, 3, -23.5)):
        assert leaving.fired(force), "a bar above the hand, beside it, or below"
    assert leaving.fired(wrench(0, 0, 11.5)) is None, "no earlier than in free air"


@pytest.mark.parametrize("name", sorted(arms()))
def test_every_arm_is_tightest_in_free_air_and_stops_itself_below_its_limits(name: str) -> None:
    limits = arms().load(name).limits
    reflexes = limits.reflexes
    ordered = (reflexes.free, reflexes.carrying, reflexes.probing, reflexes.contact)
    assert [r.force for r in ordered] == sorted(r.force for r in ordered)
    assert reflexes.contact.force <= limits.force_max
    assert reflexes.contact.torque <= limits.torque_max
    assert reflexes.free.load == 0.0
    assert reflexes.carrying.load == pytest.approx(limits.payload * 9.81)


def test_a_force_at_the_hand_leaves_nothing_unexplained_and_one_on_a_link_does() -> None:
    arm = arms().load("fr3")
    nominal = NominalArm(arm, Pose.of((0.0, 0.0, 0.0)), np.zeros(3))
    jacobian = nominal.jacobian(arm.home + np.array([0.3, 0.2, -0.4, 0.1, 0.3, -0.2, 0.1])).copy()
    left, force = explain_torque(jacobian, jacobian[:3].T @ np.array([10.0, -5.0, 20.0]))
    assert left < 1e-6
    assert force == pytest.approx(np.sqrt(525.0), rel=1e-6)
    on_elbow = nominal.elbow_jacobian().T @ np.array([10.0, -30.0, 20.0])
    left, force = explain_torque(jacobian, on_elbow)
    assert Links(unexplained_torque(arm), 0.1).stop_reason(left, force) is not None


def test_a_moment_within_the_lever_of_the_force_is_the_hands() -> None:
    links = Links(torque=2.0, lever=0.1)
    assert links.stop_reason(2.9, 10.0) is None
    assert links.stop_reason(3.1, 10.0) == (
        "unexpected contact: a link met something: its joints bear 3.1 N m that no "
        "force on the hand explains, more than 3.0 N m"
    )


def test_a_rougher_arm_may_leave_more_unexplained() -> None:
    arm = arms().load("fr3")
    assert 2.0 < unexplained_torque(arm) < unexplained_torque(arm.real()) < 3.0


def test_a_sudden_change_of_the_torques_stops_the_empty_hand_only() -> None:
    free, carrying = Links(2.0, 0.1, change=2.0), Links(2.0, 0.1)
    assert free.stop_reason(1.5, 10.0, 1.9) is None
    assert "changed suddenly by 2.1 N m" in str(free.stop_reason(1.5, 10.0, 2.1))
    assert carrying.stop_reason(1.5, 10.0, 9.0) is None
