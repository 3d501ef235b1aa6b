"""Tasks in processes: the same results whatever their number, and one that dies costs no other."""

from __future__ import annotations

import os

import pytest

from palpate.studies.engine.workers import Lost, Processes, spread

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
def test_what_the_work_raises_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="no 5"):
        spread(failing, [5], workers)


def test_a_task_that_ends_its_process_is_lost_alone() -> None:
    found = dict(Processes(2).each(deadly, range(9)))
    lost = found.pop(FATAL)
    assert isinstance(lost, Lost)
    assert found == {i: i**2 for i in range(9) if i != FATAL}


def test_where_every_result_is_needed_a_lost_one_is_an_error() -> None:
    with pytest.raises(Lost, match="ended"):
        spread(deadly, range(FATAL + 1), 2)
