from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.common.pose import Pose
from palpate.robots.description import Limits
from palpate.robots.owner import load_description
from palpate.robots.robot import RobotState
from palpate.robots.safety import Expectation, violation

HOME = load_description().home

LIMITS = Limits(
    q_min=np.full(7, -2.9),
    q_max=np.full(7, 2.9),
    dq_max=np.full(7, 2.0),
    tau_max=np.full(7, 80.0),
    force_max=40.0,
    torque_max=15.0,
    free_force=25.0,
    overload=14.0,
    speed_max=0.5,
    tracking_max=0.04,
    payload=3.0,
    workspace_min=np.array([-0.2, -0.8, -0.3]),
    workspace_max=np.array([0.9, 0.8, 1.0]),
    stale_after=0.1,
    reflexes=load_description().limits.reflexes,
)

POSE = Pose.top_down((0.5, 0.0, 0.3), 0.0)
FREE = Expectation()
HOLDING = Expectation(holding=True, grasped=True)
CONTACT = Expectation(contact=True)
LEAVING = Expectation(pressed=(0.0, 3.0, -24.0))
WEIGHT = LIMITS.payload * 9.81


def state(**changes):
    base = RobotState(
        10.0,
        9.98,
        np.array(HOME),
        np.zeros(7),
        np.zeros(7),
        np.zeros(7),
        POSE,
        POSE,
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        0.03,
        True,
        False,
        False,
    )
    return replace(base, **changes)


def vector(size, **entries):
    out = np.zeros(size)
    for key, value in entries.items():
        out[int(key[1:])] = value
    return out


def wrench(*force, torque=(0.0, 0.0, 0.0)):
    return np.array([*force, *torque])


def test_an_arm_at_rest_is_safe_for_any_expectation():
    for expected in (FREE, HOLDING, CONTACT):
        assert violation(state(), LIMITS, expected) is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            {"q": np.array(HOME) + vector(7, _3=5.3)},
            r"joint 4 is at 2\.944 rad, within 0\.01 rad of its range",
        ),
        ({"q": np.array([2.895, *HOME[1:]])}, r"joint 1 is at 2\.895 rad"),
        ({"dq": vector(7, _5=-2.5)}, r"joint 6 moves at -2\.50 rad/s, more than 2\.00 rad/s"),
        ({"tau": vector(7, _1=-80.5)}, r"joint 2 bears 80\.5 N m, more than 80 N m"),
        ({"twist": vector(6, _1=0.6)}, r"the TCP moves at 0\.60 m/s, more than 0\.50 m/s"),
        (
            {"target_world_tcp": POSE.translate((0, 0, -0.05))},
            "the TCP is 50 mm from where it is commanded",
        ),
        ({"t": 10.5}, "sensor data is 520 ms old, more than 100 ms"),
        ({"wrench": wrench(np.nan, 0, 0)}, "sensor data is not finite: wrench"),
        ({"contact": wrench(np.inf, 0, 0)}, "sensor data is not finite: contact"),
        ({"q": np.full(7, np.inf), "dq": np.full(7, -np.inf)}, "sensor data is not finite: q, dq"),
        ({"width": float("nan")}, "sensor data is not finite: pose or width"),
    ],
)
def test_a_violation_names_its_figures(changes, reason):
    for expected in (FREE, HOLDING, CONTACT):
        with np.errstate(invalid="ignore"):
            found = violation(state(**changes), LIMITS, expected)
        assert found is not None
        assert re.search(reason, found), found


def test_the_workspace_box_belongs_to_the_base():
    high = POSE.translate((0.0, 0.0, 0.9))
    outside = state(pose_world_tcp=high, target_world_tcp=high)
    found = violation(outside, LIMITS, FREE)
    assert found is not None
    assert "(0.50, 0.00, 1.20) m from the base, outside the workspace" in found
    raised = Pose.of((0.0, 0.0, 0.5))
    assert violation(outside, LIMITS, FREE, raised) is None
    turned = Pose.of((0.5, 0.0, 0.5), (np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)))
    narrow = replace(LIMITS, workspace_min=np.array([0.1, -0.8, -0.3]))
    assert violation(outside, narrow, FREE, raised) is None
    assert "0.70) m from the base" in str(violation(outside, narrow, FREE, turned))


@pytest.mark.parametrize(
    ("expected", "force", "reason"),
    [
        (FREE, (20.0, 0, 0), None),
        (
            FREE,
            (26.0, 0, 0),
            r"unexpected contact: 26.0 N (26.00, 0.00, 0.00) where at most 25 N is explained",
        ),
        (FREE, (0, 0, 28.0), "unexpected contact"),
        (LEAVING, (0, 4, -26.0), None),
        (LEAVING, (0, 0, 26.0), "unexpected contact"),
        (LEAVING, (26.0, 0, 0), "unexpected contact"),
        (LEAVING, (0, 0, -41.0), "exceeds the limit of 40 N"),
        (HOLDING, (0, 0, WEIGHT), None),
        (HOLDING, (0, 0, WEIGHT + 13), None),
        (HOLDING, (0, 0, WEIGHT + 15), "more than the payload of 3 kg"),
        (HOLDING, (26.0, 0, 10.0), "unexpected contact"),
        (HOLDING, (0, 0, -26.0), "unexpected contact"),
        (CONTACT, (0, 0, -39.0), None),
        (CONTACT, (0, 0, -41.0), "exceeds the limit of 40 N"),
        (Expectation(contact=True, holding=True), (30.0, 0, WEIGHT), None),
        (Expectation(contact=True, holding=True), (41.0, 0, WEIGHT), "exceeds the limit"),
    ],
)
def test_expected_forces_are_safe_and_others_are_not(expected, force, reason):
    found = violation(state(contact=wrench(*force)), LIMITS, expected)
    assert found is None if reason is None else reason in str(found)


def test_torque_beyond_the_limit_is_never_safe():
    found = violation(state(contact=wrench(0, 0, 0, torque=(0, 16.0, 0))), LIMITS, CONTACT)
    assert found == "external torque 16.0 N m exceeds the limit of 15 N m"


def test_a_slip_is_only_looked_for_while_something_must_be_held():
    lost = state(gripping=False, width=0.0)
    assert (
        violation(lost, LIMITS, HOLDING)
        == "slip: the fingers closed to 0.0 mm and hold nothing any more"
    )
    assert violation(lost, LIMITS, FREE) is None


def test_stale_data_is_reported_before_its_values():
    assert "old" in str(violation(state(t=11.0, contact=wrench(99, 0, 0)), LIMITS, FREE))


forces = st.floats(-100, 100)


@given(forces, forces, forces, st.booleans(), st.booleans())
def test_expecting_more_never_forbids_more_force(x, y, z, holding, contact):
    felt = state(contact=wrench(x, y, z))
    if violation(felt, LIMITS, Expectation(holding=holding)) is None:
        assert violation(felt, LIMITS, Expectation(holding=holding, contact=contact)) is None
    if np.linalg.norm([x, y, z]) > LIMITS.force_max + WEIGHT:
        assert violation(felt, LIMITS, Expectation(holding=holding, contact=contact)) is not None
    if np.linalg.norm([x, y, z]) < LIMITS.free_force:
        assert violation(felt, LIMITS, Expectation(holding=holding, contact=contact)) is None
