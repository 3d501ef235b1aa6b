"""Independent tasks on processes or a Ray cluster, and their result files."""

from __future__ import annotations

import math
import os
import re
import socket
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast

from pydantic import TypeAdapter, ValidationError

import palpate
from palpate.common.display import json_text
from palpate.common.errors import InputError, Unavailable
from palpate.common.files import read_bytes, writing
from palpate.common.processes import ignore_signals

LARGEST = 1_000_000_000  # Bytes: size of the largest results file that is read

Row = TypeVar("Row")
_OBJECT = TypeAdapter(dict[str, Any])


@dataclass(frozen=True, slots=True)
class Lines:
    """Growing file of JSON objects, one a line."""

    file: Path

    def read(self) -> list[dict[str, Any]]:
        """Read all complete lines; empty without a file. A last line without its end was cut off, and is left out."""
        if not self.file.exists():
            return []
        content = read_bytes(self.file, LARGEST, "results of a study")
        whole = content[: content.rfind(b"\n") + 1]
        try:
            return [_OBJECT.validate_json(line) for line in whole.splitlines()]
        except ValidationError:
            raise self.other() from None

    def read_as(self, kind: type[Row]) -> list[Row]:
        """Read all complete lines as objects of a dataclass. Raises InputError: the file holds something else."""
        adapter = TypeAdapter(kind)
        try:
            return [adapter.validate_python(line) for line in self.read()]
        except ValidationError:
            raise self.other() from None

    def add(self, *rows: Mapping[str, Any]) -> None:
        """Append rows and wait until they are on the disk. Without rows, only create the file.
        Raises InputError: the file cannot be written."""
        lines = [json_text(strict_json(row)) + "\n" for row in rows]
        with writing(self.file):
            self.file.parent.mkdir(parents=True, exist_ok=True)
            with self.file.open("ab+") as file:
                # Remove an incomplete last line, which a killed process has left.
                size = file.seek(0, os.SEEK_END)
                file.seek(max(size - 1, 0))
                if size and file.read(1) != b"\n":  # a kill has left a line without its end
                    file.seek(0)
                    file.truncate(file.read().rfind(b"\n") + 1)
                # Write all rows at once, and flush them to the disk.
                file.write("".join(lines).encode())
                file.flush()
                os.fsync(file.fileno())

    def other(self) -> InputError:
        """Error for a file whose lines belong to another study."""
        return InputError(
            f"'{self.file.name}' is not a results file of a study; choose another place with --out"
        )


def strict_json(content: Any) -> Any:
    """Replace infinities and NaN, which JSON lacks, by words (`inf`, `nan`). pydantic reads these."""
    if isinstance(content, Mapping):
        named = cast("Mapping[str, Any]", content)
        return {name: strict_json(value) for name, value in named.items()}
    if isinstance(content, list | tuple):
        return [strict_json(value) for value in cast("Sequence[Any]", content)]
    if isinstance(content, float) and not math.isfinite(content):
        return str(content)
    return content


# Independent tasks, distributed over processes, and their progress.

Task = TypeVar("Task")
Result = TypeVar("Result")

AHEAD = 2  # Tasks that a worker receives in advance, so that it never waits for the next one


class WorkerLost(Exception):
    """The process that executed a task died."""


class Crew(Protocol):
    """Workers that execute the tasks of a study."""

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | WorkerLost]]:
        """Yield (index of the task, result of `work`) in order of completion.

        Work, tasks and results must be picklable, except for a single process. Exceptions of `work`
        are raised.
        """
        ...


@dataclass(frozen=True, slots=True)
class Processes:
    """Processes of this machine; with a `count` of 1, this process itself."""

    count: int

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | WorkerLost]]:
        """See `Crew.each`."""
        # A single process works in place.
        if self.count == 1:
            for place, task in enumerate(tasks):
                yield place, work(task)
            return
        waiting = deque(range(len(tasks)))
        while waiting:
            under_way = yield from self._run_queue(work, tasks, waiting)
            # A broken pool does not report the task that broke it: repeat each one in a separate
            # process.
            for place in under_way:
                with ProcessPoolExecutor(1, initializer=ignore_signals) as pool:
                    try:
                        result = pool.submit(work, tasks[place]).result()
                    except BrokenProcessPool:
                        result = WorkerLost("the process that executed it ended")
                yield place, result

    def _run_queue(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], waiting: deque[int]
    ) -> Generator[tuple[int, Result], None, list[int]]:
        """Work through the queue until it is empty or a process dies; return the tasks in progress."""
        # Only this process handles signals; the workers finish their tasks.
        pool = ProcessPoolExecutor(self.count, initializer=ignore_signals)
        running: dict[Future[Result], int] = {}
        try:
            while waiting or running:
                # Keep the queue short: few tasks are at risk if a process dies.
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
    """Map `work` over the tasks with `workers` processes; return results in the order of the tasks.
    Raises WorkerLost: the process that executed a task died."""
    results: dict[int, Result] = {}
    for place, result in Processes(workers).each(work, tasks):
        if isinstance(result, WorkerLost):
            raise result
        results[place] = result
    return [results[place] for place in range(len(tasks))]


@dataclass(slots=True)
class Progress:
    """Progress of a study: tasks done of `total`, with rate and remaining time as text.

    `before` of them were done in an earlier session.
    """

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
        # Rate of this session only.
        so_far, elapsed = self.done - self.before, self.clock() - self.began
        if not so_far or elapsed <= 0.0:
            return f"{self.done}/{self.total}"
        each = elapsed / so_far
        line = f"{self.done}/{self.total} · {60.0 / each:.3g} a minute"
        if self.done == self.total:
            return line
        seconds = each * (self.total - self.done)
        minutes = round(seconds / 60.0)
        # Choose the unit: seconds below two minutes, minutes below two hours.
        left = f"{minutes // 60} h {minutes % 60:02d} min"
        if seconds < 120.0:
            left = f"{seconds:.0f} s"
        elif seconds < 7200.0:
            left = f"{seconds / 60.0:.0f} min"
        return f"{line} · {left} left"


# Tasks on an existing Ray cluster (https://docs.ray.io).

LOCAL = "local"  # Address without a cluster: processes of this machine
PATIENCE = 5.0  # s: time in which the head of a cluster must answer
ADDRESS = re.compile(r"(?:ray://)?(?P<host>[\w.-]+):(?P<port>\d{1,5})")


@contextmanager
def crew(address: str, workers: int | None = None) -> Generator[Crew]:
    """Yield the workers at `address`.

    The address is `local`, `auto` (the cluster that runs on this machine), `HOST:PORT` or
    `ray://HOST:PORT`. At most `workers` are used, by default one per processor.
    """
    if address == LOCAL:
        yield Processes(workers or os.cpu_count() or 1)
        return
    require_answer(address)
    ray = join_cluster(address)
    try:
        processors = int(ray.cluster_resources().get("CPU", 1))
        yield RayCrew(ray, AHEAD * min(processors, workers or processors))
    finally:
        ray.shutdown()


@dataclass(frozen=True, slots=True, eq=False)
class RayCrew:
    """The cluster that this process has joined."""

    ray: Any  # the library
    room: int  # largest count of submitted tasks

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | WorkerLost]]:
        """See `Crew.each`."""

        # Wrap the callable: Ray accepts only functions.
        def remote_work(task: Task) -> Result:
            return work(task)

        remote = self.ray.remote(num_cpus=1, max_retries=1)(remote_work)
        # Keep `room` tasks submitted, and yield results as they arrive.
        waiting, running = deque(range(len(tasks))), dict[Any, int]()
        while waiting or running:
            while waiting and len(running) < self.room:
                place = waiting.popleft()
                running[remote.remote(tasks[place])] = place
            done, _ = self.ray.wait(list(running))
            for reference in done:
                yield running.pop(reference), self._result(reference)

    def _result(self, reference: Any) -> Any:
        try:
            return self.ray.get(reference)
        except self.ray.exceptions.RayTaskError as error:
            raise error.as_instanceof_cause() from None
        except self.ray.exceptions.RayError as error:
            return WorkerLost(
                f"the process or the node that executed it ended ({type(error).__name__})"
            )


def require_answer(address: str) -> None:
    """Require that a head of a cluster answers at the address, within `PATIENCE`. Ray itself waits for minutes.

    Raises:
        InputError: it is not an address.
        Unavailable: no answer.
    """
    if address == "auto":
        return
    # Try the port before Ray does.
    match = ADDRESS.fullmatch(address)
    if match is None:
        raise InputError(
            f"'{address}' is no address of a cluster; valid: {LOCAL}, auto, HOST:PORT, "
            "ray://HOST:PORT"
        )
    try:
        place = match["host"], int(match["port"])
        socket.create_connection(place, timeout=PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise Unavailable(f"no Ray cluster at '{address}': {error}") from None


def join_cluster(address: str) -> Any:
    """Import Ray and join the cluster at `address`, with usage reports off."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise Unavailable("a cluster needs Ray: pip install 'palpate[ray]'") from None
    library: Any = ray
    try:
        # Send this version of palpate to the workers.
        library.init(
            address=address,
            runtime_env={"py_modules": [palpate]},
            log_to_driver=False,
            logging_level="ERROR",
        )
    except Exception as error:
        reason = str(error).strip().splitlines()[:1]
        raise Unavailable(f"no Ray cluster at '{address}': {' '.join(reason)}") from None
    return library
