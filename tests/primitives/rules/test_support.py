"""Stability of a released object: support polygons, edges, stacks and leaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from workbench import KNOWN, bench

from palpate.common.pose import Pose
from palpate.primitives.rules.support import (
    clear_of_support,
    dragged_off,
    met_early,
    slides,
    stable,
)
from palpate.primitives.state import SymbolicState

EDGE_Y = 0.6
"""m: where the bench ends."""
LOW = '<body name="low" pos="0.5 0.2 0.03"><freejoint/><geom type="box" size=".05 .05 .03"/></body>'
UPPER = (
    '<body name="upper" pos="0.5 0.2 0.09"><freejoint/><geom type="box" size=".03 .03 .03"/></body>'
)
HAMMER = (
    '<body name="hammer" pos="0.5 0 0.018"><freejoint/><inertial pos="{com}" mass="0.5" diaginertia=".001 .001 .001"/>'
    '<geom type="box" size=".13 .012 .012"/><geom type="box" pos=".145 0 0" size=".015 .045 .018"/></body>'
)


def state(*bodies: str) -> SymbolicState:
    return SymbolicState(bench(*bodies))


def at(x: float, y: float, z: float, turn: float = 0.0) -> Pose:
    """Upright, turned about the vertical."""
    return Pose.of((x, y, z), (np.cos(turn / 2), 0, 0, np.sin(turn / 2)))


@pytest.mark.parametrize(
    ("y", "reason"),
    [
        (0.3, None),
        (0.56, None),
        (0.592, "edge"),
        (0.6, "edge"),
        (0.615, "edge"),
        (0.7, "no support"),
    ],
)
def test_a_can_stays_where_its_centre_is_well_over_the_table(y: float, reason: str | None) -> None:
    found = stable(state(KNOWN), "can", at(0.5, y, 0.06))
    assert (found is None) if reason is None else found is not None and reason in found


def test_object_in_the_air_or_pressed_down_does_not_stay() -> None:
    can = state(KNOWN)
    assert stable(can, "can", at(0.5, 0.3, 0.063)) is None
    assert "fall by 0.040 m" in (stable(can, "can", at(0.5, 0.3, 0.10)) or "")
    assert "pressed" in (stable(can, "can", at(0.5, 0.3, 0.05)) or "")
    assert "pressed 0.035 m" in (stable(can, "can", at(0.5, 0.3, 0.025)) or "")


@pytest.mark.parametrize(
    ("aside", "lower", "early"), [(0, 0.01, 0.01), (0, 0.021, 0), (0.1, 0.01, 0)]
)
def test_an_object_meets_its_support_early_only_where_it_was_found(aside, lower, early) -> None:
    can = state(KNOWN)
    place = can.pose_of("can").translate((0.0, aside, -lower))
    assert met_early(can, "can", place) == pytest.approx(early, abs=1e-6)


@pytest.mark.parametrize(("degrees", "said"), [(1.5, ""), (3.0, "by 3°"), (11.0, "by 11°")])
def test_leaning_object_does_not_stay(degrees: float, said: str) -> None:
    half = np.radians(degrees) / 2
    lean = Pose.of((0.5, 0.3, 0.06), (np.cos(half), np.sin(half), 0, 0))
    found = stable(state(KNOWN), "can", lean)
    assert (found is None) if not said else f"it would lean {said}" in (found or "")


def test_an_unknown_centre_of_mass_may_be_anywhere() -> None:
    unknown = state(HAMMER.format(com="? ? ?"))
    # The head over the edge: with a heavy head it falls.
    assert stable(unknown, "hammer", at(0.5, 0.3, 0.018, np.pi / 2)) is None
    assert "edge" in (stable(unknown, "hammer", at(0.5, 0.46, 0.018, np.pi / 2)) or "")
    # The outline ends 2 and 4 mm before the edge.
    assert "edge" in (stable(unknown, "hammer", at(0.5, 0.438, 0.018, np.pi / 2)) or "")
    assert stable(unknown, "hammer", at(0.5, 0.436, 0.018, np.pi / 2)) is None


def test_a_known_centre_of_mass_decides() -> None:
    over_the_edge = at(0.5, 0.48, 0.018, np.pi / 2)
    assert "edge" in (stable(state(HAMMER.format(com=".14 0 0")), "hammer", over_the_edge) or "")


def test_an_object_returned_to_its_first_pose_stays() -> None:
    on_the_edge = '<body name="box" pos="0.5 0.598 0.03"><freejoint/><geom type="box" size=".03 .03 .03"/></body>'
    found = state(on_the_edge)
    assert stable(found, "box", found.pose_of("box")) is None
    assert stable(found, "box", found.pose_of("box").translate((0.002, 0, 0))) is None
    assert stable(found, "box", found.pose_of("box").translate((0.005, 0, 0))) is not None


def test_object_stands_as_found_only_on_what_is_where_it_was_found() -> None:
    found = state(LOW, UPPER)
    upper, low = found.pose_of("upper"), found.pose_of("low")
    assert stable(found, "upper", upper) is None
    away = replace(found, moved={"low": low.translate((0.2, 0.0, 0.0))})
    held = replace(found, holding="low", pose_world_tcp=low, pose_tcp_object=Pose.of((0, 0, 0)))
    for gone in (away, held):
        assert "fall by 0.060 m" in (stable(gone, "upper", upper) or "")


def test_a_stack_is_stable_in_the_middle_and_not_off_it() -> None:
    stack = state(LOW, KNOWN)
    assert stable(stack, "can", at(0.5, 0.2, 0.12)) is None
    assert "tip over the edge of 'low'" in (stable(stack, "can", at(0.5, 0.25, 0.12)) or "")


STAND = (
    '<body name="stand" pos="0.5 0.2 0"><freejoint/><geom type="box" size=".03 .03 .04" pos="0 0 .04" mass="20"/>'
    '<geom type="box" size=".1 .1 .01" pos="0 0 .09" mass="20"/></body>'
)


@pytest.mark.parametrize(
    ("aside", "tips"), [(0.0, False), (0.024, False), (0.027, True), (0.06, True)]
)
def test_a_load_outside_the_foot_of_its_carrier_is_refused_at_any_stated_mass(aside, tips) -> None:
    found = stable(state(STAND, KNOWN), "can", at(0.5 + aside, 0.2, 0.16))
    assert (found is not None) == tips
    assert not tips or "'stand' may tip under it" in str(found)


def test_a_load_acts_on_the_foot_of_every_carrier_below() -> None:
    slab = '<body name="slab" pos="0.5 0.2 0.11"><freejoint/><geom type="box" size=".09 .09 .01"/></body>'
    stack = state(STAND, slab, KNOWN)
    assert stable(stack, "can", at(0.5, 0.2, 0.18)) is None
    assert "'stand' may tip" in str(stable(stack, "can", at(0.5, 0.25, 0.18)))


def test_a_load_of_unknown_centre_of_mass_may_act_anywhere_on_its_carrier() -> None:
    inertial = '<inertial pos="? ? ?" mass=".3" diaginertia=".001 .001 .001"/>'
    unknown = KNOWN.replace("<freejoint/>", f"<freejoint/>{inertial}")
    for text, tips in ((KNOWN, False), (unknown, True)):
        found = stable(state(STAND, text), "can", at(0.52, 0.2, 0.16))
        assert (found is not None) == tips


def test_a_drag_ends_on_the_support_and_a_lift_is_none() -> None:
    start = state(KNOWN)
    hand = Pose.top_down((0.62, 0.15, 0.1), 0.0)
    held = hand.inverse() @ start.pose_of("can")
    before = replace(start, pose_world_tcp=hand, holding="can", pose_tcp_object=held, at="there")

    def after(x: float, y: float, z: float) -> SymbolicState:
        tcp = hand.translate((x, y, z))
        return replace(before, pose_world_tcp=tcp, moved={"can": tcp @ held}, at="there")

    def to(x: float, y: float, z: float) -> str | None:
        return dragged_off(before, after(x, y, z))

    for z, slid in ((0.0, True), (-0.015, True), (-0.025, False)):
        assert slides(before, after(-0.1, 0, z)) == slid
    assert not slides(before, after(-0.004, 0, 0))
    assert to(-0.1, 0, 0) is to(-0.1, 0, 0.05) is None
    assert "edge" in (to(0, 0.44, 0) or "")
    assert to(-0.1, 0, -0.03) == "'there' is 30 mm lower than its support"


def test_an_object_is_clear_of_its_support_where_nothing_is_close_below_it() -> None:
    can = state(KNOWN, LOW)
    assert not clear_of_support(can, "can", at(0.5, -0.3, 0.062))
    # However deep it is pressed into the table.
    assert not clear_of_support(can, "can", at(0.5, -0.3, 0.03))
    assert clear_of_support(can, "can", at(0.5, -0.3, 0.067))
    # Its frame is beside the table, and it still stands on it.
    assert not clear_of_support(can, "can", at(0.5, 0.61, 0.06))
    assert not clear_of_support(can, "can", at(0.56, 0.2, 0.122))
