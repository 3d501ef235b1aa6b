"""Independent runs, spread over processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from palpate.interrupt import ignore_signals

Task = TypeVar("Task")
Result = TypeVar("Result")


def spread(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> list[Result]:
    """What `work` makes of every task, in order, whatever the number of processes.

    A single worker is this process itself. Otherwise work, tasks and results must be picklable.
    """
    if workers == 1:
        return [work(task) for task in tasks]
    # A signal to all of them is this process's affair: the others finish what they are at.
    with ProcessPoolExecutor(workers, initializer=ignore_signals) as pool:
        return list(pool.map(work, tasks))
