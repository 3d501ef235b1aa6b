"""Moves between rooms are counted once for each pair of functions, and imports are not moves."""

from __future__ import annotations

from bench.walk import Walk, heights
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate


def test_a_call_into_another_room_is_a_move() -> None:
    walk = Walk()
    parameter = Parameter("mug", "mass")
    walk.during(lambda: [Estimate.normal(parameter, "kg", 1.0, 0.1, "") for _ in range(3)])
    assert not walk.moves, "the estimates stay in their room"
    mass = Estimate.normal(parameter, "kg", 1.0, 0.1, "")
    walk.during(lambda: [repr(mass) for _ in range(3)])
    ((move, count),) = walk.moves.items()
    assert [code.co_qualname for code in move] == ["Estimate.__repr__", "Parameter.__str__"]
    assert count == 3
    assert str(walk).startswith("2 rooms, 1 moves, 0 climbs")


def test_rooms_stand_in_the_order_of_the_architecture() -> None:
    rows = heights()
    assert rows["cli"] < rows["runs"] < rows["planning"] < rows["estimation"] < rows["common"]
