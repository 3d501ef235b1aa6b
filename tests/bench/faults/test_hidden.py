"""Worlds that are not quite the scene's: who is hidden there, and what it may be met with."""

from __future__ import annotations

import numpy as np
import pytest

from bench.faults.hidden import CAUTIOUS, CAUTIOUS_RIGID, LIGHT_THING, MOST, POST, wrong_world
from bench.faults.nasty import small_scene
from bench.harm.judge import UNSEEN
from palpate.execution.harm import SHOWN


@pytest.mark.parametrize(
    ("kind", "unseen", "figures"),
    [
        ("obstacles", (POST,), [UNSEEN]),
        ("cautious", (POST,), [CAUTIOUS, CAUTIOUS_RIGID]),
        ("light", (LIGHT_THING,), [UNSEEN]),
    ],
)
def test_hidden_obstacles_are_named_and_have_their_own_limits(
    kind: str, unseen: tuple[str, ...], figures: list[object]
) -> None:
    true = small_scene("can")
    worlds = [wrong_world(kind, true, np.random.default_rng(n)) for n in range(8)]
    assert {world.unseen for world in worlds} == {unseen}
    assert {id(world.figures) for world in worlds} == {id(each) for each in figures}
    for world in worlds:
        rigid = "1e+06 N/m" in world.what
        assert (world.figures is CAUTIOUS_RIGID) == (rigid and kind == "cautious")
        assert unseen[0] in world.world.text


def test_a_cautious_arm_meets_unseen_obstacles_as_if_they_were_known() -> None:
    assert (CAUTIOUS.mean10, CAUTIOUS.mean20) == (SHOWN.mean10, SHOWN.mean20)
    assert (CAUTIOUS_RIGID.mean10, CAUTIOUS_RIGID.mean20) == (80, SHOWN.mean20)
    assert CAUTIOUS.tail == CAUTIOUS_RIGID.tail == UNSEEN.tail


def test_things_stand_up_to_20_mm_from_where_the_scene_has_them() -> None:
    true = small_scene("can")
    ways: list[float] = []
    for number in range(10):
        made = wrong_world("poses", true, np.random.default_rng(number))
        assert made.unseen == ()
        for name, body in made.world.objects.items():
            ways.append(body.pose_world.distance_to(true.objects[name].pose_world))
    assert 0.015 < max(ways) < MOST + 1e-9
