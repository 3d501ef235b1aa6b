"""A client of the real libfranka, over the network, and the served hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from .served import Served

franky = pytest.importorskip("franky", reason="franky-control has no wheel for this machine")


@pytest.fixture
def hand(bench: Served) -> Iterator[Any]:
    yield franky.Gripper(bench.address)
    bench.ask("hand_refuses", refuses=False)


def test_a_hand_goes_to_a_width_and_knows_its_opening(hand: Any) -> None:
    assert hand.move(0.05, 0.1)
    assert hand.state.width == pytest.approx(0.05, abs=1e-3)
    assert hand.max_width == pytest.approx(0.08)
    assert not hand.state.is_grasped


def test_a_grasp_of_nothing_fails_but_inside_its_window(hand: Any) -> None:
    assert not hand.grasp(0.05, 0.1, 20.0, 0.005, 0.005)
    assert not hand.state.is_grasped
    assert hand.open(0.1)
    assert hand.grasp(0.0, 0.1, 20.0, 0.005, 0.08)
    assert hand.open(0.1)


def test_a_hand_that_refuses_says_so(hand: Any, bench: Served) -> None:
    bench.ask("hand_refuses", refuses=True)
    with pytest.raises(franky.CommandException):
        hand.move(0.03, 0.1)
