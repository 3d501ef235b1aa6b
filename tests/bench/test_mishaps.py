"""Mishaps: how they end, and whether anything falls."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bench.mishaps import dropped, faults, mishaps, table
from palpate.common.errors import InputError
from palpate.perception.film import Footage

BALL = '<mujoco><worldbody><body name="ball"><freejoint/><geom size=".03"/></body></worldbody></mujoco>'


def footage(*poses: tuple[float, tuple[float, float, float, float]]) -> Footage:
    """One frame a 30th of a second: height in m and attitude."""
    frames = tuple((i / 30, np.array([0.5, 0.0, z, *q])) for i, (z, q) in enumerate(poses))
    return Footage(mujoco.MjModel.from_xml_string(BALL), frames)


UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def test_falling_or_tipping_counts_as_dropped_and_lowering_does_not() -> None:
    assert dropped(footage((0.2, UPRIGHT), (0.17, UPRIGHT)), ["ball"]) == ("ball",)
    assert dropped(footage((0.2, UPRIGHT), (0.195, UPRIGHT)), ["ball"]) == ()
    assert dropped(footage((0.2, UPRIGHT), (0.2, (0.7, 0.7, 0.0, 0.0))), ["ball"]) == ("ball",)
    assert dropped(footage((0.2, UPRIGHT), (0.2, (0.7, 0.0, 0.0, 0.7))), ["ball"]) == ()
    assert dropped(footage((0.2, UPRIGHT)), ["ball"]) == ()


@pytest.mark.parametrize("name", mishaps())
def test_every_mishap_ends_as_it_should_and_nothing_is_dropped(name: str) -> None:
    (row,) = table(faults([name], "lab", [0]))
    assert (row.runs, row.as_expected, row.dropped, row.holding) == (1, 1, 0, 0)
    assert row.reason


def test_an_unknown_mishap_lists_those_there_are() -> None:
    with pytest.raises(InputError, match="mishaps/slip"):
        faults(["mishaps/flood"], "lab", [0])
