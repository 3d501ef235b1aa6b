"""A run as it happens, on the terminal: the tree with statuses, robot time, force; plain lines
elsewhere.

`py_trees.display` draws statuses alone: no durations or messages, no clipping to the screen, and names as
they come, escape sequences included.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import TracebackType
from typing import TypeGuard

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from palpate.display import visible
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import STOP_NODE, Snapshot
from palpate.live.console import SafeConsole
from palpate.trace.recording import LeafRun

REFRESH_PERIOD = 0.125
"""s of wall time: more often, nobody can read it."""

ICONS = {
    Status.SUCCESS: ("✓", "green"),
    Status.FAILURE: ("✗", "bold red"),
    Status.RUNNING: ("▶", "bold yellow"),
    Status.INVALID: ("·", "dim"),
}
STOPPED = ("–", "magenta")
WORDS = {"SUCCESS": "ok", "FAILURE": "FAILED", "INVALID": "stopped"}


class LiveTree:
    """Draws a run on a console, by default on stderr. A context manager and an `Observer`.

    On a terminal the tree is redrawn in place; elsewhere every leaf that ends gives one line.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or SafeConsole(stderr=True, highlight=False)
        self._in_place = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live: Live | None = None
        self._latest: Snapshot | None = None
        self._drawn = -np.inf
        self._printed = 0

    def __enter__(self) -> LiveTree:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.finish()

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        self.finish()
        self._console.print(Text(f"{_clean(stage)} …", "dim"))

    def on_tick(self, snapshot: Snapshot) -> None:
        """Take note of a tick; draws at most every 125 ms."""
        self._latest = snapshot
        if not self._in_place:
            self._print_ended(snapshot)
        elif time.monotonic() - self._drawn >= REFRESH_PERIOD:
            self._draw()

    def finish(self) -> None:
        """Draw the last state and leave it on the screen."""
        if self._live is not None:
            self._draw()
            self._live.stop()
        self._live, self._latest, self._printed = None, None, 0

    def _draw(self) -> None:
        assert self._latest is not None
        if self._live is None:
            self._live = Live(console=self._console, auto_refresh=False, redirect_stdout=False)
            self._live.start()
        room = max(3, self._console.height - 6)
        self._live.update(render(self._latest, room), refresh=True)
        self._drawn = time.monotonic()

    def _print_ended(self, snapshot: Snapshot) -> None:
        for leaf in snapshot.leaves[self._printed :]:
            line = f"{leaf.end:8.2f} s  {WORDS[leaf.status]:7} {leaf.label}"
            if leaf.message:
                line += f": {leaf.message}"
            self._console.print(Text(_clean(line)), soft_wrap=True)
        self._printed = len(snapshot.leaves)


def render(snapshot: Snapshot, room: int) -> Group:
    """The snapshot in at most `room` lines of tree: those around the active leaf, when there are
    more."""
    ended = {leaf.node: leaf for leaf in snapshot.leaves}
    lines: list[Text] = []
    active = 0
    for row, (node, depth) in enumerate(_walk(snapshot.root)):
        lines.append(_line(node, depth, snapshot, ended))
        if node.status is not Status.INVALID:
            active = row
    first = min(max(0, active - room // 2), max(0, len(lines) - room))
    return Group(_header(snapshot), *lines[first : first + room], *_stop(snapshot))


def _header(snapshot: Snapshot) -> Text:
    force = float(np.linalg.norm(snapshot.robot.wrench[:3]))
    figures = f"{snapshot.elapsed:7.1f} s robot time   |F| {force:5.1f} N"
    running = [node.name for node, _ in _walk(snapshot.root) if _is_running(node)]
    header = Text(figures, "bold", no_wrap=True, overflow="ellipsis")
    return header.append(f"   {_clean(', '.join(running))}", "yellow")


def _is_running(node: Behaviour) -> TypeGuard[PrimitiveLeaf]:
    return isinstance(node, PrimitiveLeaf) and node.status is Status.RUNNING


def _stop(snapshot: Snapshot) -> Iterator[Text]:
    """Why the run is being stopped, and what was done for it."""
    if snapshot.stopping is not None:
        yield Text(f"stopping: {_clean(snapshot.stopping)}", "bold red")
    for leaf in snapshot.leaves:
        if leaf.node == STOP_NODE:
            icon, style = ICONS[Status[leaf.status]]
            yield Text.assemble(
                (f"{icon} {leaf.label}", style), (f"  {_clean(leaf.message)}", "dim")
            )


def _line(node: Behaviour, depth: int, snapshot: Snapshot, ended: dict[str, LeafRun]) -> Text:
    """A node with its status, and how long a leaf took or has taken so far."""
    run = None
    if isinstance(node, PrimitiveLeaf):
        run = ended.get(node.node)
    icon, style = ICONS[node.status]
    if run is not None and node.status is Status.INVALID:
        icon, style = STOPPED
    line = Text("  " * depth, no_wrap=True, overflow="ellipsis")
    line.append(f"{icon} {_clean(node.name)}", style)
    if run is not None:
        line.append(f"  {run.end - run.start:.1f} s  {_clean(run.message)}", "dim")
    elif _is_running(node):
        line.append(f"  {snapshot.robot.t - node.started:.1f} s", "dim")
    return line


def _walk(node: Behaviour, depth: int = 0) -> Iterator[tuple[Behaviour, int]]:
    yield node, depth
    for child in node.children:
        yield from _walk(child, depth + 1)


def _clean(text: str) -> str:
    """Names may come from a model: one line, with nothing that a terminal would take for a
    command."""
    return visible(text.replace("\n", " "))
