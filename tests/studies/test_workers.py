"""Tasks in processes: results do not depend on their number, and a process that dies costs one task."""

from __future__ import annotations

import os
from itertools import chain, repeat

import pytest

from palpate.studies.workers import Processes, Progress, WorkerLost, spread

FATAL = 3


def squared(number: int) -> int:
    return number**2


def deadly(number: int) -> int:
    """The square; the process of `FATAL` ends without a word."""
    if number == FATAL:
        os._exit(1)
    return number**2


def failing(number: int) -> int:
    raise ValueError(f"no {number}")


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order(workers: int) -> None:
    assert spread(squared, range(7), workers) == [0, 1, 4, 9, 16, 25, 36]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_work_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="no 5"):
        spread(failing, [5], workers)


def test_a_task_that_ends_its_process_is_lost_alone() -> None:
    values = dict(Processes(2).each(deadly, range(9)))
    lost = values.pop(FATAL)
    assert isinstance(lost, WorkerLost)
    assert values == {i: i**2 for i in range(9) if i != FATAL}


def test_spread_raises_a_lost_task() -> None:
    with pytest.raises(WorkerLost, match="ended"):
        spread(deadly, range(FATAL + 1), 2)


def test_progress_states_rate_and_time_left_of_tasks_since_the_start() -> None:
    clock = chain([100.0], repeat(130.0))
    progress = Progress(total=1010, before=1000, clock=lambda: next(clock))
    assert progress.step() == "1001/1010 · 2 a minute · 4 min left"


def test_progress_without_finished_tasks_has_no_rate() -> None:
    assert str(Progress(5)) == "0/5"


def test_progress_of_a_finished_study_has_no_time_left() -> None:
    clock = chain([0.0], repeat(20.0))
    assert Progress(1, clock=lambda: next(clock)).step() == "1/1 · 3 a minute"


def test_progress_states_long_times_in_hours() -> None:
    clock = chain([0.0], repeat(60.0))
    assert Progress(201, clock=lambda: next(clock)).step().endswith("· 3 h 20 min left")
