"""A served robot in a process of its own, for tests that talk to it over the network."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import Any

from palpate.studies.scenarios.catalogue import scenario

from .bench import Setup

ROOT = Path(__file__).parents[2]
STARTS = 60.0
"""s in which a server is there."""


SERVERS = count(2)


def own_address() -> str:
    """A loopback address of this process of tests alone, the same whenever it is asked for."""
    return _address(1)


def _address(number: int) -> str:
    """libfranka's ports are fixed, so no two servers of any test worker or test run share one."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    return f"127.{10 + int(worker)}.{os.getpid() % 250}.{number}"


class Served:
    """A running server, and its side door.

    `served.ask("truth", name="bottle.mass")` asks any question of `door.Door`.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup, self.address = setup, setup.address
        mine, theirs = socket.socketpair()
        paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "tests.fci", str(theirs.fileno())]
        self.process = subprocess.Popen(
            [*command, json.dumps(asdict(setup))],
            cwd=ROOT,
            env=environment,
            pass_fds=[theirs.fileno()],
        )
        theirs.close()
        mine.settimeout(STARTS)
        self._line, self._reader = mine, mine.makefile("rb")
        if self._reader.readline() != b"true\n":
            raise RuntimeError(f"the server at {setup.address} did not start")

    def ask(self, question: str, **arguments: Any) -> Any:
        """At the side door."""
        self._line.sendall(json.dumps({"ask": question, "with": arguments}).encode() + b"\n")
        answer = self._reader.readline()
        return json.loads(answer) if answer else None

    def close(self) -> None:
        """Stop it, if it is still there."""
        self._line.close()
        self._reader.close()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


@contextmanager
def served(scene: Path | str, world: Path | str | None = None, **changes: Any) -> Iterator[Served]:
    """Serve a scene on an address of its own; `changes` are fields of `Setup`."""
    setup = Setup(
        str(scene), None if world is None else str(world), address=_address(next(SERVERS))
    )
    running = Served(replace(setup, **changes))
    try:
        yield running
    finally:
        running.close()


def files(name: str) -> dict[str, str]:
    """The files of a bundled scenario, as fields of `Setup`: `served(**files("hammer"))`."""
    settings = scenario(name).settings()
    found = {"scene": settings.scene, "world": settings.world, "poses": settings.poses}
    return {field: str(path) for field, path in found.items() if path is not None}
