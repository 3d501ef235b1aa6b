"""Tasks on an existing Ray cluster (https://docs.ray.io).

Every node runs the code of this machine: the package travels with the tasks. Its dependencies must be
installed on the nodes, for the same version of Python.
"""

from __future__ import annotations

import os
import re
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import palpate
from palpate.errors import InputError, Unavailable
from palpate.studies.workers import AHEAD, Crew, Lost, Processes, Result, Task

LOCAL = "local"
"""Address without a cluster: processes of this machine."""
PATIENCE = 5.0
"""s in which the head of a cluster must answer."""
ADDRESS = re.compile(r"(?:ray://)?(?P<host>[\w.-]+):(?P<port>\d{1,5})")


@contextmanager
def crew(address: str, workers: int | None = None) -> Generator[Crew]:
    """Workers of the Ray cluster at `address`: `local`, `auto` (the cluster that runs on this
    machine), `HOST:PORT` or `ray://HOST:PORT`. At most `workers` of them, by default one per
    processor.

    Raises:
        InputError: it is no address.
        Unavailable: Ray is not installed, or the cluster does not answer.
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
    """The cluster that this process has joined.

    Attributes:
        ray: the library.
        room: tasks that are submitted at a time.
    """

    ray: Any
    room: int

    def each(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """See `Crew.each`."""

        # Ray wraps functions only, not any callable.
        def remote_work(task: Task) -> Result:
            return work(task)

        remote = self.ray.remote(num_cpus=1, max_retries=1)(remote_work)
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
            return Lost(f"the process or the node that executed it ended ({type(error).__name__})")


def require_answer(address: str) -> None:
    """Require a head of a cluster at the address, within `PATIENCE`; Ray itself waits for minutes.

    Raises:
        InputError: it is no address.
        Unavailable: no answer.
    """
    if address == "auto":
        return
    found = ADDRESS.fullmatch(address)
    if found is None:
        raise InputError(
            f"'{address}' is no address of a cluster; valid: {LOCAL}, auto, HOST:PORT, "
            "ray://HOST:PORT"
        )
    try:
        place = found["host"], int(found["port"])
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
