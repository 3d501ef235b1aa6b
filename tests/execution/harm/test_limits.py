"""Limits of harm, on tracks and contacts made up."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.harm.judge import harm, judged_contacts
from palpate.execution.witness import ContactForces, Pair, PoseRecord

FOUND = (0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)
PERIOD = 1e-3  # s


def seen(
    *poses: Sequence[float],
    held: int = -1,
    forces: dict[Pair, ContactForces] | None = None,
    touched: bool = True,
    mass: float = 0.3,
) -> Any:
    """Witness of a can that stands still in each pose for 100 ms."""
    looks = [
        PoseRecord(
            10 * i, np.array([pose]), np.array((1.0, 0.0, 0.0, 0.0)), held, np.array([touched])
        )
        for i, pose in enumerate(pose for pose in (FOUND, *poses) for _ in range(10))
    ]
    return SimpleNamespace(
        objects=("can",),
        masses=(mass,),
        axes=(None,),
        looks=looks,
        forces=forces or {},
        steps=10 * len(looks),
        period=PERIOD,
    )


def leaning(degrees: float) -> tuple[float, ...]:
    half = np.radians(degrees) / 2
    return (0.0, 0.0, 0.1, float(np.cos(half)), float(np.sin(half)), 0.0, 0.0)


@pytest.mark.parametrize(("degrees", "found"), [(14.0, ()), (16.0, ("can tipped",))])
def test_an_object_leaning_by_more_than_15_degrees_has_tipped(
    degrees: float, found: tuple[str]
) -> None:
    assert harm(seen(leaning(degrees)), ["can"]).beyond == found


@pytest.mark.parametrize(("way", "found"), [(0.024, ()), (0.026, ("can pushed by 26 mm",))])
def test_objects_named_by_a_plan_may_be_pushed_by_25_mm(way: float, found: tuple[str]) -> None:
    assert harm(seen((way, *FOUND[1:])), ["can"]).beyond == found


@pytest.mark.parametrize(("held", "found"), [(-1, ("can left its place",)), (0, ())])
def test_an_object_held_lower_has_not_been_displaced(held: int, found: tuple[str]) -> None:
    lower = [(0.0, 0.0, 0.1 - 0.001 * i, *FOUND[3:]) for i in range(60)]
    assert harm(seen(*lower, held=held), ["can"]).beyond == found


@pytest.mark.parametrize(
    ("way", "touched", "found"),
    [(0.012, False, ()), (0.014, False, ("can dropped",)), (0.014, True, ())],
)
def test_an_object_sinking_13_mm_without_support_was_dropped(
    way: float, touched: bool, found: tuple[str]
) -> None:
    sinks = [(0.0, 0.0, 0.1 - z, *FOUND[3:]) for z in np.linspace(0.001, way, 14)]
    assert harm(seen(*sinks, touched=touched), ["can"]).beyond == found


def test_harm_to_what_the_scene_does_not_show_is_listed_and_not_judged() -> None:
    done = harm(seen(leaning(16.0)), ["can"], unseen=["can"])
    assert (done.beyond, [str(fate) for fate in done.unseen]) == ((), ["can tipped"])


@pytest.mark.parametrize(
    ("mass", "found"), [(1.4, ("robot/hand on can: 30 N sideways over 10 ms",)), (1.6, ())]
)
def test_things_of_up_to_1_5_kg_are_pushed_by_25_n_at_most(mass: float, found: tuple[str]) -> None:
    push = ContactForces(array("q", range(50, 80)), array("d", 30 * [30.0, 0.0, 0.0]))
    pushed = seen(forces={Pair("robot/hand", "can", load=False): push}, mass=mass)
    assert harm(pushed, ["can"]).beyond == found


@pytest.mark.parametrize(("pressed", "peak"), [(0.3 * 9.81, 0.0), (0.3 * 9.81 + 5.0, 5.0)])
def test_the_weight_of_a_load_on_its_support_is_no_force(pressed: float, peak: float) -> None:
    stands = ContactForces(array("q", range(100)), array("d", 100 * [0.0, 0.0, -pressed]))
    (touch,) = judged_contacts(seen(forces={Pair("can", "table", load=True): stands}))
    assert touch.peak == pytest.approx(peak, abs=0.01)


@pytest.mark.parametrize(("lasts", "tail"), [(0.08, 0.0), (0.15, 20.0)])
def test_a_tail_begins_100_ms_after_the_touch(lasts: float, tail: float) -> None:
    steps = range(50, 50 + round(lasts / PERIOD))
    press = ContactForces(array("q", steps), array("d", len(steps) * [0.0, 0.0, -20.0]))
    (touch,) = judged_contacts(
        seen(FOUND, FOUND, forces={Pair("robot/hand", "table", load=False): press})
    )
    assert touch.tail == pytest.approx(tail)
