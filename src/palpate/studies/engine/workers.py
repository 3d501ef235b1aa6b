"""Independent tasks, spread over processes.

A `Crew` does them, wherever: `Processes` on this machine, `engine.cluster` on a Ray cluster.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol, TypeVar

from palpate.interrupt import ignore_signals

Task = TypeVar("Task")
Result = TypeVar("Result")

AHEAD = 2
"""Tasks that a worker receives ahead, so that it never waits for the next."""


class Lost(Exception):
    """A task took its process with it."""


class Crew(Protocol):
    """Workers that execute the tasks of a study."""

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """Yield (index of the task, result of `work`) in order of completion.

        Work, tasks and results must be picklable unless a single process does them all. What `work`
        raises is raised.
        """
        ...


@dataclass(frozen=True, slots=True)
class Processes:
    """Processes of this machine; a single one is this process itself."""

    count: int

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """See `Crew.each`."""
        if self.count == 1:
            for place, task in enumerate(tasks):
                yield place, work(task)
            return
        waiting = deque(range(len(tasks)))
        while waiting:
            under_way = yield from self._pooled(work, tasks, waiting)
            # Which of them broke the pool shows when each has a process of its own.
            for place in under_way:
                yield place, _alone(work, tasks[place])

    def _pooled(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], waiting: deque[int]
    ) -> Generator[tuple[int, Result], None, list[int]]:
        """Work through the queue until it is empty or a process dies; return the tasks in progress."""
        # A signal to all of them is this process's affair: the others finish what they are at.
        pool = ProcessPoolExecutor(self.count, initializer=ignore_signals)
        running: dict[Future[Result], int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < AHEAD * self.count:
                    future = pool.submit(work, tasks[waiting[0]])
                    running[future] = waiting.popleft()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    result = future.result()
                    yield running.pop(future), result
        except BrokenProcessPool:
            return list(running.values())
        finally:
            pool.shutdown(cancel_futures=True)
        return []


def spread(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> list[Result]:
    """Map `work` over the tasks with `workers` processes; results in the order of the tasks.

    Raises:
        Lost: a task took its process with it.
    """
    found: dict[int, Result] = {}
    for place, result in Processes(workers).each(work, tasks):
        if isinstance(result, Lost):
            raise result
        found[place] = result
    return [found[place] for place in range(len(tasks))]


def _alone(work: Callable[[Task], Result], task: Task) -> Result | Lost:
    """Result of a task in a process of its own; `Lost` if the process dies."""
    with ProcessPoolExecutor(1, initializer=ignore_signals) as pool:
        try:
            return pool.submit(work, task).result()
        except BrokenProcessPool:
            return Lost("the process that was at it ended")
