"""The terminal's view of a run: the tree with statuses, robot time and force; elsewhere plain lines.

`py_trees.display` draws statuses alone: no durations or messages, no clipping to the screen, and names
with their escape sequences.
"""

from __future__ import annotations

import logging
import time

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from palpate.display import visible
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import STOP_NODE, Snapshot
from palpate.live.console import LIVE_LOGGER, SafeConsole
from palpate.live.observers import Remaining, step_of, steps_of, walk
from palpate.trace.recording import LeafRun

log = logging.getLogger(LIVE_LOGGER)

REFRESH_PERIOD = 0.125
"""s of wall time: a person reads no faster."""
ICONS = {
    Status.SUCCESS: ("✓", "green"),
    Status.FAILURE: ("✗", "bold red"),
    Status.RUNNING: ("▶", "bold yellow"),
    Status.INVALID: ("·", "dim"),
}
STOPPED = ("–", "magenta")
WORDS = {"SUCCESS": "ok", "FAILURE": "FAILED", "INVALID": "stopped"}
BAR, BAR_FORCE = 5, 20.0
"""Characters to either side of a bar's middle, and the vertical force, N, that fills them: a kilogram
and a contact are both visible."""


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
        self._remaining = Remaining()

    def __enter__(self) -> LiveTree:
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        self.finish()
        log.info("%s", _clean(stage))
        self._console.print(Text(f"{_clean(stage)} …", "dim"))

    def on_tick(self, snapshot: Snapshot) -> None:
        """Take note of a tick; draws at most every 125 ms."""
        self._latest = snapshot
        self._print_ended(snapshot)
        if self._in_place and time.monotonic() - self._drawn >= REFRESH_PERIOD:
            self._draw()

    def finish(self) -> None:
        """Draw the last state and leave it on the screen."""
        if self._live is not None:
            self._draw()
            self._live.stop()
        self._live, self._latest, self._printed = None, None, 0
        self._remaining = Remaining()

    def _draw(self) -> None:
        assert self._latest is not None
        if self._live is None:
            self._live = Live(console=self._console, auto_refresh=False, redirect_stdout=False)
            self._live.start()
        room = max(3, self._console.height - 6)  # lines for the header, a stop and the prompt
        left = self._remaining.seconds(self._latest)
        self._live.update(render(self._latest, room, left), refresh=True)
        self._drawn = time.monotonic()

    def _print_ended(self, snapshot: Snapshot) -> None:
        """Log the leaves that have ended since the last tick, and print them where no tree is drawn."""
        ended = snapshot.leaves[self._printed :]
        steps = len(steps_of(snapshot)) if ended else 0
        for step, leaf in enumerate(ended, self._printed + 1):
            line = f"{leaf.end:8.2f} s  {WORDS[leaf.status]:7} {leaf.label}"
            if leaf.message:
                line += f": {leaf.message}"
            if step <= steps and leaf.node != STOP_NODE:
                line += f"  ({step}/{steps})"
            log.info("%s", _clean(line))
            if not self._in_place:
                self._console.print(Text(_clean(line)), soft_wrap=True)
        self._printed = len(snapshot.leaves)


def render(snapshot: Snapshot, room: int, left: float | None = None) -> Group:
    """The snapshot with a header, at most `room` lines of tree, and the stop, if there is one. Of a
    taller tree the lines around the active leaf are drawn. `left`: remaining time, s, if known."""
    step, steps = step_of(snapshot)
    figures = f"{snapshot.elapsed:7.1f} s robot time   step {step}/{steps}"
    if left is not None:
        figures += f"   about {left:.0f} s left"
    header = Text(figures, "bold", no_wrap=True, overflow="ellipsis")
    force = float(snapshot.robot.wrench[2])
    header.append(f"   Fz {bar(force)} {force:+6.1f} N", "cyan")
    running = [leaf.name for leaf in steps_of(snapshot) if leaf.status is Status.RUNNING]
    header.append(f"   {_clean(', '.join(running))}", "yellow")

    ended = {leaf.node: leaf for leaf in snapshot.leaves}
    lines: list[Text] = []
    active = 0
    for row, (node, depth) in enumerate(walk(snapshot.root)):
        lines.append(_line(node, depth, snapshot, ended))
        if node.status is not Status.INVALID:
            active = row
    first = min(max(0, active - room // 2), max(0, len(lines) - room))

    # The reason of a stop, and the measures taken.
    stop: list[Text] = []
    if snapshot.stopping is not None:
        stop.append(Text(f"stopping: {_clean(snapshot.stopping)}", "bold red"))
    for leaf in snapshot.leaves:
        if leaf.node == STOP_NODE:
            icon, style = ICONS[Status[leaf.status]]
            measure = (f"{icon} {leaf.label}", style)
            stop.append(Text.assemble(measure, (f"  {_clean(leaf.message)}", "dim")))
    return Group(header, *lines[first : first + room], *stop)


def _line(node: Behaviour, depth: int, snapshot: Snapshot, ended: dict[str, LeafRun]) -> Text:
    """A node with its status, and a leaf with its duration so far."""
    run = ended.get(node.node) if isinstance(node, PrimitiveLeaf) else None
    icon, style = ICONS[node.status]
    if run is not None and node.status is Status.INVALID:
        icon, style = STOPPED
    line = Text("  " * depth, no_wrap=True, overflow="ellipsis")
    line.append(f"{icon} {_clean(node.name)}", style)
    if run is not None:
        line.append(f"  {run.end - run.start:.1f} s  {_clean(run.message)}", "dim")
    elif isinstance(node, PrimitiveLeaf) and node.status is Status.RUNNING:
        line.append(f"  {snapshot.robot.t - node.started:.1f} s", "dim")
    return line


def bar(force: float) -> str:
    """A vertical force, N, as a bar to the right of its middle, or to the left where it is
    negative."""
    filled = 0
    if np.isfinite(force):
        filled = min(BAR, round(BAR * abs(force) / BAR_FORCE))
    right = "█" * filled if force > 0 else ""
    left = "█" * filled if force < 0 else ""
    return f"{left:>{BAR}}│{right:<{BAR}}"


def _clean(text: str) -> str:
    """Text on one line, without terminal commands: names may come from a model."""
    return visible(text.replace("\n", " "))
