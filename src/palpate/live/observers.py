"""Progress of a running tree, and observers that draw nothing: a simulated run at real-time pace, and
several views of one run."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from statistics import fmean
from typing import Protocol

from py_trees.behaviour import Behaviour

from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import Observer, Snapshot

FEWEST = 3
"""Least number of finished steps for an estimate of the remaining time."""


def walk(node: Behaviour, depth: int = 0) -> Iterator[tuple[Behaviour, int]]:
    """This node and its descendants, depth first, each with its depth."""
    yield node, depth
    for child in node.children:
        yield from walk(child, depth + 1)


def steps_of(snapshot: Snapshot) -> list[PrimitiveLeaf]:
    """The plan's leaves."""
    return [node for node, _ in walk(snapshot.root) if isinstance(node, PrimitiveLeaf)]


def step_of(snapshot: Snapshot) -> tuple[int, int]:
    """Number of the running step, and of all steps."""
    steps = len(steps_of(snapshot))
    return min(len(snapshot.leaves) + 1, steps), steps


class Remaining:
    """Estimate of a run's remaining time: each step to come takes the mean time of its primitive so
    far, and robot time passes as fast as so far."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def seconds(self, snapshot: Snapshot) -> float | None:
        """s of wall time; None after few steps, or while the run is being stopped."""
        if len(snapshot.leaves) < FEWEST or snapshot.stopping is not None or not snapshot.elapsed:
            return None
        took: dict[str, list[float]] = defaultdict(list)
        for leaf in snapshot.leaves:
            took[leaf.primitive].append(leaf.end - leaf.start)
        usual = fmean(leaf.end - leaf.start for leaf in snapshot.leaves)
        ended = {leaf.node for leaf in snapshot.leaves}
        robot_time = 0.0
        for step in steps_of(snapshot):
            if step.node not in ended:
                kind = took.get(type(step.primitive).__name__)
                robot_time += fmean(kind) if kind else usual
        return robot_time * (time.monotonic() - self._began) / snapshot.elapsed


class View(Protocol):
    """An observer that also names stages."""

    def on_tick(self, snapshot: Snapshot) -> None: ...

    def progress(self, stage: str) -> None: ...


class Observers:
    """Passes a run on to several observers. An `Observer`."""

    def __init__(self, *observers: Observer) -> None:
        self._observers = observers

    def on_tick(self, snapshot: Snapshot) -> None:
        """See `Observer`."""
        for observer in self._observers:
            observer.on_tick(snapshot)


class Views(Observers):
    """Passes a run on to several views."""

    def __init__(self, *views: View) -> None:
        super().__init__(*views)
        self._views = views

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        for view in self._views:
            view.progress(stage)


class RealTime:
    """Holds robot time to wall time, so that a person can follow. An `Observer` of simulated arms alone:
    a real one must not be delayed."""

    def __init__(self) -> None:
        self._root: object = None
        self._began = 0.0

    def progress(self, stage: str) -> None:
        """Do nothing: only motions are paced."""

    def on_tick(self, snapshot: Snapshot) -> None:
        """Sleep until as much time has passed as on the robot's clock."""
        if snapshot.root is not self._root:
            self._root, self._began = snapshot.root, time.monotonic() - snapshot.elapsed
        early = snapshot.elapsed - (time.monotonic() - self._began)
        if early > 0:
            time.sleep(early)
