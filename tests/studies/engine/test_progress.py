"""How far a study has come, in words."""

from __future__ import annotations

from itertools import chain, repeat

from palpate.studies.engine.progress import Progress


def test_rate_and_time_left_are_of_what_was_done_since_it_began() -> None:
    clock = chain([100.0], repeat(130.0))
    progress = Progress(total=1010, before=1000, clock=lambda: next(clock))
    assert progress.step() == "1001/1010 · 2 a minute · 4 min left"


def test_before_anything_is_done_there_is_no_rate() -> None:
    assert str(Progress(5)) == "0/5"


def test_in_the_end_nothing_is_left() -> None:
    clock = chain([0.0], repeat(20.0))
    assert Progress(1, clock=lambda: next(clock)).step() == "1/1 · 3 a minute"


def test_long_ones_are_told_in_hours() -> None:
    clock = chain([0.0], repeat(60.0))
    assert Progress(201, clock=lambda: next(clock)).step().endswith("· 3 h 20 min left")
