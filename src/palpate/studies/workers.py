"""Independent tasks, distributed over processes, and their progress.

A `Crew` executes them: `Processes` on this machine, `studies.cluster` on a Ray cluster.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from palpate.interrupt import ignore_signals

Task = TypeVar("Task")
Result = TypeVar("Result")

AHEAD = 2
"""Tasks that a worker receives ahead, so that it never waits for the next."""


class Lost(Exception):
    """The process that executed a task died."""


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
    """Processes of this machine; with a `count` of 1, this process itself."""

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
            # A broken pool does not say which task broke it: repeat each in a process of its own.
            for place in under_way:
                with ProcessPoolExecutor(1, initializer=ignore_signals) as pool:
                    try:
                        result = pool.submit(work, tasks[place]).result()
                    except BrokenProcessPool:
                        result = Lost("the process that executed it ended")
                yield place, result

    def _pooled(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], waiting: deque[int]
    ) -> Generator[tuple[int, Result], None, list[int]]:
        """Work through the queue until it is empty or a process dies; return the tasks in progress."""
        # Only this process handles signals; the others finish their tasks.
        pool = ProcessPoolExecutor(self.count, initializer=ignore_signals)
        running: dict[Future[Result], int] = {}
        try:
            while waiting or running:
                # A short queue keeps few tasks at risk if a process dies.
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
        Lost: the process that executed a task died.
    """
    found: dict[int, Result] = {}
    for place, result in Processes(workers).each(work, tasks):
        if isinstance(result, Lost):
            raise result
        found[place] = result
    return [found[place] for place in range(len(tasks))]


@dataclass(slots=True)
class Progress:
    """Tasks done of `total`, `before` of them in an earlier session; rate and time left as text."""

    total: int
    before: int = 0
    clock: Callable[[], float] = time.monotonic
    done: int = field(init=False)
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.done, self.began = self.before, self.clock()

    def step(self) -> str:
        """Count one more finished task; return the progress as a line of text."""
        self.done += 1
        return str(self)

    def __str__(self) -> str:
        so_far, elapsed = self.done - self.before, self.clock() - self.began
        if not so_far or elapsed <= 0.0:
            return f"{self.done}/{self.total}"
        each = elapsed / so_far
        line = f"{self.done}/{self.total} · {60.0 / each:.3g} a minute"
        if self.done == self.total:
            return line
        seconds = each * (self.total - self.done)
        minutes = round(seconds / 60.0)
        # Two minutes and two hours each switch to the coarser unit.
        left = f"{minutes // 60} h {minutes % 60:02d} min"
        if seconds < 120.0:
            left = f"{seconds:.0f} s"
        elif seconds < 7200.0:
            left = f"{seconds / 60.0:.0f} min"
        return f"{line} · {left} left"
