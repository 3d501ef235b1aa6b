"""Stops in the middle of actions, judged by MuJoCo's state at every physics step."""

from __future__ import annotations

import pytest

from bench.campaign.ledger import Drawn
from bench.faults import stops
from bench.faults.stops import places, plans, stop


def test_plans_are_of_drawers_of_doors_and_of_scenes_written_by_hand() -> None:
    names = {name for name, *_ in plans()}
    assert {"drawer:symbolic", "drawer/door:symbolic", "weigh a jar on a shelf"} <= names


def test_every_primitive_that_moves_is_stopped() -> None:
    for astray in (False, True):
        found = places(astray)
        assert {"MovePose", "MoveUntilContact", "CloseGripper", "OpenGripper"} <= set(found)
        assert ({"MoveHandle", "Tilt", "Swing"} <= set(found)) == (not astray)
        assert not any(name.startswith("Measure") for name in found)


@pytest.mark.long
@pytest.mark.parametrize("pushes", [0.0, 1.0])
def test_a_stop_is_judged_with_its_last_leaf(
    monkeypatch: pytest.MonkeyPatch, pushes: float
) -> None:
    """A caller asks for the stop, or a push on the hand causes it."""
    mug = next(one for one in plans() if one[0] == "weigh a mug")
    monkeypatch.setattr(stops, "plans", lambda: (mug,))
    monkeypatch.setattr(stops, "PUSHES", pushes)
    monkeypatch.setattr(stops, "LONGEST", 0.3)
    monkeypatch.setattr(stops, "places", lambda _: {"MovePose": [(0, 2)]})
    case = Drawn("stops", 0, 3)
    row = stop(case, case.blank())
    assert row.outcome == "stopped"
    assert row.beyond == ()
    assert ("unexpected contact" in row.said[0]) == bool(pushes)
    assert row.what.startswith("weigh a mug, ")
    assert " s into MovePose 2" in row.what
    assert ": " in row.figures["last"]
