"""What the fingers bear, and whether they may open."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.geometry.pose import Pose
from palpate.vocabulary.load import NOTHING, Load


def wrench(z: float) -> np.ndarray:
    return np.array([0.0, 0.0, z, 0.0, 0.0, 0.0])


def test_a_weight_is_what_hangs_more_than_before() -> None:
    load = Load(wrench(0.5), 0.06, wrench(3.5))
    assert load.weight == pytest.approx(3.0)
    assert load.borne(wrench(-1.5)) == pytest.approx(-2.0)
    assert NOTHING.weight == 0.0


@pytest.mark.parametrize(
    ("felt", "opens"), [(10.5, False), (4.5, False), (3.0, True), (0.0, True), (-8.0, True)]
)
def test_fingers_stay_closed_while_they_bear_the_load(felt: float, opens: bool) -> None:
    load = Load(wrench(0.5), 0.06, wrench(10.5))
    assert (load.too_much(wrench(felt)) is None) == opens


def test_fingers_that_come_nearer_each_other_slip() -> None:
    load = Load(wrench(0.0), 0.06)
    assert load.slip(0.0595) is None
    assert load.slip(0.05) == "slip: the fingers closed from 60.0 to 50.0 mm"


def test_an_object_that_turns_between_the_pads_is_noticed() -> None:
    tool = Pose.top_down((0.5, 0.0, 0.3), 0.0)  # closing along world -y
    hanging = np.array([0.0, 0.0, 5.0, 0.0, 0.5, 0.0])
    load = Load(np.zeros(6), 0.03).hung(hanging, tool)
    assert load.turned(hanging, tool) is None
    down = np.array([0.0, 0.0, 5.0, 0.0, 0.05, 0.0])
    assert "turns in the fingers" in str(load.turned(down, tool))
    turned = Pose.top_down((0.5, 0.0, 0.3), np.pi / 2)  # carried on, turned about the vertical
    assert load.turned(np.array([0.0, 0.0, 5.0, -0.5, 0.0, 0.0]), turned) is None
