"""Beliefs between two leaves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.primitives.rules.grip import BITE
from palpate.primitives.state import RESTORED_POSITION, SymbolicState, merge_states
from palpate.trace.recording import Context
from palpate.trace.samples import FORCES


def test_the_context_is_the_present_state(start: SymbolicState) -> None:
    state = replace(start, activity="contact", at="table_approach", contact="table")
    assert state.context() == Context("contact", at="table_approach", support="table")


def test_a_slide_is_on_what_is_below_the_hand(start: SymbolicState) -> None:
    at = start.scene.symbols.resolve("cup_pose")
    sliding = replace(
        start, activity="sliding", pose_world_tcp=at, holding="cup", grasp="cup_pose", at="cup_pose"
    )
    assert sliding.context().support == "table"
    assert replace(sliding, activity="moving").context().support is None


PAD = 0.0085
"""m: half the width of the arm's pads."""


@pytest.mark.parametrize(
    ("outside", "found"),
    [(0.0, "cup"), (PAD - BITE - 1e-3, "cup"), (PAD - BITE + 1e-3, None), (PAD + 1e-3, None)],
)
def test_fingers_close_on_the_object_of_which_the_pads_have_more_than_an_edge(
    start: SymbolicState, outside: float, found: str | None
) -> None:
    body = start.object_at(Pose.top_down((0.5 + 0.03 + outside, 0.1, 0.05), 0.0))
    assert (body.name if body else None) == found


def test_an_object_is_looked_for_where_it_was_put(start: SymbolicState) -> None:
    there = Pose.of((0.3, 0.3, 0.05))
    state = replace(start, moved={"cup": there})
    assert state.pose_of("cup") is there
    assert state.object_at(Pose.top_down((0.5, 0.1, 0.05), 0.0)) is None
    body = state.object_at(Pose.top_down((0.3, 0.3, 0.05), 0.0))
    assert body is not None
    assert body.name == "cup"


def test_an_object_that_is_put_back_is_moved_no_longer(start: SymbolicState) -> None:
    away = replace(start, moved=start.place_object("cup", Pose.of((0.3, 0.3, 0.05))))
    assert list(away.moved) == ["cup"]
    back = replace(away, moved=away.place_object("cup", start.pose_of("cup")))
    assert back == start
    # Also where its motion ends beside others, each of which adds its changes.
    assert merge_states(replace(away, contact="table"), away, back).moved == {}


def test_descent_meets_the_highest_body_below_that_is_not_held(
    start: SymbolicState,
) -> None:
    above = Pose.top_down((0.5, 0.1, 0.3), 0.0)

    def below(state: SymbolicState, pose: Pose = above) -> str | None:
        body = state.surface_below(pose)
        return body.name if body else None

    assert below(start) == "cup"
    assert below(replace(start, holding="cup")) == "table"
    assert below(start, Pose.top_down((2.0, 0.1, 0.3), 0.0)) is None
    assert below(start, Pose.top_down((0.3, 0.1, -0.2), 0.0)) is None


@pytest.mark.parametrize(
    ("by", "restored"), [(RESTORED_POSITION * 0.9, True), (RESTORED_POSITION * 1.1, False)]
)
def test_an_object_near_its_place_counts_as_restored(
    start: SymbolicState, by: float, restored: bool
) -> None:
    moved = start.pose_of("cup").translate((by, 0.0, 0.0))
    assert (replace(start, moved={"cup": moved}).displaced_objects() == {}) == restored


def test_a_buffer_keeps_the_latest_context_and_the_log_all_of_them(start: SymbolicState) -> None:
    first = replace(start, at="a").add_recording(FORCES)
    second = replace(first, at="b").add_recording(FORCES)
    assert second.buffers == {FORCES: Context("still", at="b")}
    assert [context.at for _, context in second.logged] == ["a", "b"]
    assert (start.buffers, start.logged, start.converted) == ({}, (), frozenset[Parameter]())
