"""Where an object has come to between the pads."""

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.estimation.grip import LIKELY, Droop, PutDownRecord, before, slid
from palpate.scene.load import parse_scene

SCENE = """<mujoco><worldbody>
  <body name="table" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03"/></body>
  <body name="bar" pos="0.5 0 0.012"><freejoint/><geom type="box" size=".12 .01 .012"/></body>
</worldbody></mujoco>"""
HIGHER = 0.002
FROM_ABOVE = Pose.of(np.array([0.0, 0.0, HIGHER]), (0.0, 1.0, 0.0, 0.0))


def put_down(time, moment=0.1, age=10.0):
    return PutDownRecord(time, FROM_ABOVE, Droop(moment, age), swept=2.0)


@pytest.fixture(scope="module")
def body():
    return parse_scene(SCENE).body("bar")


def test_a_drooping_end_that_meets_the_support_carries_it_along(body):
    """By the height of the hand over the support times the angle."""
    moved = put_down(1.0).displacement_std(body)
    drooped = 0.1 * float(np.hypot(LIKELY[0], 10.0 * LIKELY[1]))
    assert moved == pytest.approx(drooped * (0.012 + HIGHER))


def test_sliding_along_the_fingers_lasts_and_sinking_ends_at_the_support():
    in_hand = slid(FROM_ABOVE, 2.0).T
    assert in_hand == pytest.approx(np.array([[2.0, 0, 0], [0, 0, -2.0]]))
    lying = put_down(1.0).slid.T
    assert lying == pytest.approx(np.array([[2.0, 0, 0], [0, 0, 0]]))


def test_only_objects_put_down_before_count():
    first, second = put_down(1.0), put_down(5.0)
    assert before(1.0, [first, second]) == []
    assert before(5.0, [first, second]) == [first]
