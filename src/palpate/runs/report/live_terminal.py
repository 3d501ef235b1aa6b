"""Observers of a run, and its live view on the terminal."""

from __future__ import annotations

import logging
import time
from collections import defaultdict
from collections.abc import Iterator
from statistics import fmean
from typing import Protocol, runtime_checkable

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from palpate.common.display import visible
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import STOP_NODE, Observer, Snapshot
from palpate.runs.report.console import LIVE_LOGGER, SafeConsole
from palpate.trace.recording import LeafRun

FEWEST = 3  # Least count of finished steps for an estimate of the remaining time


def walk(node: Behaviour, depth: int = 0) -> Iterator[tuple[Behaviour, int]]:
    """Yield this node and its descendants, depth first, each with its depth."""
    yield node, depth
    for child in node.children:
        yield from walk(child, depth + 1)


def steps_of(snapshot: Snapshot) -> list[PrimitiveLeaf]:
    """The plan's leaves."""
    return [node for node, _ in walk(snapshot.root) if isinstance(node, PrimitiveLeaf)]


def step_of(snapshot: Snapshot) -> tuple[int, int]:
    """Number of the running step, and the count of all steps."""
    steps = len(steps_of(snapshot))
    return min(len(snapshot.leaves) + 1, steps), steps


class Remaining:
    """Estimate of a run's remaining time.

    Each remaining step takes the mean time of its primitive so far. The ratio of wall time to robot
    time stays the same.
    """

    def __init__(self) -> None:
        self._began = time.monotonic()

    def seconds(self, snapshot: Snapshot) -> float | None:
        """Remaining wall time, s; None after few steps, or while the run is being stopped."""
        if len(snapshot.leaves) < FEWEST or snapshot.stopping is not None or not snapshot.elapsed:
            return None
        # Mean duration of each primitive, and of all steps for new primitives.
        took: dict[str, list[float]] = defaultdict(list)
        for leaf in snapshot.leaves:
            took[leaf.primitive].append(leaf.end - leaf.start)
        usual = fmean(leaf.end - leaf.start for leaf in snapshot.leaves)
        ended = {leaf.node for leaf in snapshot.leaves}
        # Sum the expected durations of the remaining steps, and convert robot time to wall time.
        robot_time = 0.0
        for step in steps_of(snapshot):
            if step.node not in ended:
                kind = took.get(type(step.primitive).__name__)
                robot_time += fmean(kind) if kind else usual
        return robot_time * (time.monotonic() - self._began) / snapshot.elapsed


@runtime_checkable
class View(Observer, Protocol):
    """An observer that also names stages."""

    def progress(self, stage: str) -> None: ...


class Observers:
    """Passes a run on to several observers, and the names of stages to those that are views."""

    def __init__(self, *observers: Observer) -> None:
        self._observers = observers

    def on_tick(self, snapshot: Snapshot) -> None:
        """See `Observer`."""
        for observer in self._observers:
            observer.on_tick(snapshot)

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        for observer in self._observers:
            if isinstance(observer, View):
                observer.progress(stage)


class RealTime:
    """Observer that slows robot time down to wall time, so that a person can follow.

    It is only for simulated arms: a real arm must not be delayed.
    """

    def __init__(self) -> None:
        self._root: object = None
        self._began = 0.0

    def on_tick(self, snapshot: Snapshot) -> None:
        """Sleep until the wall clock reaches the robot's clock."""
        # A new attempt begins with a new tree: restart the clock.
        if snapshot.root is not self._root:
            self._root, self._began = snapshot.root, time.monotonic() - snapshot.elapsed
        early = snapshot.elapsed - (time.monotonic() - self._began)
        if early > 0:
            time.sleep(early)


# Terminal view of a run: the tree with statuses, robot time and force; elsewhere plain lines.

log = logging.getLogger(LIVE_LOGGER)

REFRESH_PERIOD = 0.125  # s of wall time between two drawings: a person reads no faster
ICONS = {
    Status.SUCCESS: ("✓", "green"),
    Status.FAILURE: ("✗", "bold red"),
    Status.RUNNING: ("▶", "bold yellow"),
    Status.INVALID: ("·", "dim"),
}
STOPPED = ("–", "magenta")
WORDS = {"SUCCESS": "ok", "FAILURE": "FAILED", "INVALID": "stopped"}
# Characters on each side of a bar's middle, and the vertical force, N, of a full bar. A kilogram
# and a contact are both visible.
BAR, BAR_FORCE = 5, 20.0


class LiveTree:
    """Draws a run on a console, by default on stderr. A context manager and an `Observer`.

    On a terminal the tree is redrawn in place. Elsewhere every finished leaf gives one line.
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
        """Show the name of the present stage."""
        self.finish()
        log.info("%s", _clean(stage))
        self._console.print(Text(f"{_clean(stage)} …", "dim"))

    def on_tick(self, snapshot: Snapshot) -> None:
        """Record a tick; draw at most every 125 ms."""
        self._latest = snapshot
        self._print_finished_leaves(snapshot)
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

    def _print_finished_leaves(self, snapshot: Snapshot) -> None:
        """Log the leaves that have ended since the last tick. Print them where no tree is drawn."""
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
    """Render a snapshot: header, at most `room` lines of the tree, and the stop, if any.

    A taller tree is cut to the lines around the active leaf. `left` is the remaining time, s, if
    known.
    """
    # Header: robot time, step, remaining time, force and running leaves.
    step, steps = step_of(snapshot)
    figures = f"{snapshot.elapsed:7.1f} s robot time   step {step}/{steps}"
    if left is not None:
        figures += f"   about {left:.0f} s left"
    header = Text(figures, "bold", no_wrap=True, overflow="ellipsis")
    force = float(snapshot.robot.wrench[2])
    header.append(f"   Fz {bar(force)} {force:+6.1f} N", "cyan")
    running = [leaf.name for leaf in steps_of(snapshot) if leaf.status is Status.RUNNING]
    header.append(f"   {_clean(', '.join(running))}", "yellow")

    # Tree: centre the visible lines on the last active node.
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
    """Format a node with its status, and a leaf with its duration so far."""
    run = ended.get(node.node) if isinstance(node, PrimitiveLeaf) else None
    # An ended leaf that is INVALID was stopped.
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
    """Draw a vertical force, N, as a bar to the right of the middle, or to the left if it is negative."""
    # A force that is not finite has no bar.
    filled = 0
    if np.isfinite(force):
        filled = min(BAR, round(BAR * abs(force) / BAR_FORCE))
    right = "█" * filled if force > 0 else ""
    left = "█" * filled if force < 0 else ""
    return f"{left:>{BAR}}│{right:<{BAR}}"


def _clean(text: str) -> str:
    """Put text on one line and make terminal commands visible: names may come from a model."""
    return visible(text.replace("\n", " "))
