"""Runs a plan on a robot: one loop, and however it ends, a robot that stands still and drops
nothing."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.errors import InputError
from palpate.execution.build import build
from palpate.execution.held import Fate, Held
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.stop import PutDown, lost, released
from palpate.interrupt import Interrupts, interrupts
from palpate.planning.plan import Plan
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import unexplained_force
from palpate.robots.sense.watched import Watched
from palpate.scene.scene import Scene
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Samples, Trace
from palpate.vocabulary.base import Blackboard, Recorder
from palpate.vocabulary.registry import Vocabulary, vocabulary
from palpate.vocabulary.state import SymbolicState

log = logging.getLogger(__name__)

TICK_PERIOD = 0.02
"""s of robot time between two ticks."""
MAX_ROBOT_SECONDS = 1800.0
"""s of robot time that a whole run may take."""
STOP_SECONDS = 2.0
"""s of robot time for the arm to come to rest after `hold`."""
EASINGS = 8
"""Largest number of easings of a press; each leaves a fraction of the force."""
STOP_NODE = "stop"
"""`LeafRun.node` of what the runner itself runs on the way to a controlled stop; no plan has such a
node."""

Asked = Callable[[], str | None]
"""Request to stop the run, with its origin."""
Keep = Callable[[Samples, Recorder], None]
"""Handed the newest samples, and all that is recorded, after every tick: writes them down while the
run goes on. What it raises ends nothing but its own work."""


@dataclass(frozen=True, slots=True, eq=False)
class Execution:
    """Result of an execution.

    Attributes:
        trace: everything recorded, up to and including a controlled stop.
        status: `complete` when the tree succeeded, else `stopped`.
        stopped_by: why, in one sentence; None when complete.
        final_state: what is believed about the cell now.
        actions: leaves of the plan that were started.
        robot_seconds, wall_seconds: how long it took.
        setbacks: why earlier attempts stopped that were gone on from (see `palpate.execution.recovery`).
        asked: whether somebody wanted it to stop.
        fault: why the robot's signals cannot be believed any more, or why it does not move any more;
            None while all is well.
        reflex: why the arm stopped itself, and so the run; None if it did not.
        held: what the fingers held when it was stopped, and what became of it; None for nothing.
    """

    trace: Trace
    status: Literal["complete", "stopped"]
    stopped_by: str | None
    final_state: SymbolicState
    actions: int
    robot_seconds: float
    wall_seconds: float
    setbacks: tuple[str, ...] = ()
    asked: bool = False
    fault: str | None = None
    reflex: str | None = None
    held: Held | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """State shown to an observer after a tick.

    Attributes:
        root: the plan's tree.
        robot: the cached state.
        elapsed: robot time since the start, s.
        leaves: lives that have ended so far.
        stopping: why the run is being stopped, None while it is not.
    """

    root: Behaviour
    robot: RobotState
    elapsed: float
    leaves: Sequence[LeafRun]
    stopping: str | None = None


class Observer(Protocol):
    """Watches a run, e.g. to draw it. Called in the loop after every tick, so it must be quick; once
    it has raised, it is not called again."""

    def on_tick(self, snapshot: Snapshot) -> None: ...


def run(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    *,
    tick_period: float = TICK_PERIOD,
    observer: Observer | None = None,
    stop_requested: Callable[[], bool] | None = None,
    max_robot_seconds: float = MAX_ROBOT_SECONDS,
    words: Vocabulary | None = None,
    keep: Keep | None = None,
) -> Execution:
    """Run a checked plan to its end, or to a controlled stop.

    A failed leaf, an exception, a signal (`palpate.interrupt`; SIGINT where nobody takes any),
    `stop_requested` and the time budget all end in a controlled stop: the arm comes to rest, then a
    held object is put down, or, where that is not safe, held still. A second signal abandons the
    putting down and holds at once. What was recorded is returned in every case.

    The robot is left holding its position; closing it is up to the caller who opened it.

    Raises:
        InputError: the plan has no tree, or one that cannot be built; nothing has moved then.
    """
    if plan.tree is None:
        raise InputError(f"the plan has no tree to run: {plan.explanation}")
    watched = Watched(robot, scene.arm)
    blackboard = Blackboard(watched, SymbolicState(scene), Recorder(watched))
    root = build(plan.tree, words or vocabulary(), blackboard)
    began = time.perf_counter()
    with interrupts() as signals, signals.deferred():
        loop = _Loop(blackboard, watched, root, tick_period, observer, keep, signals)
        asked = _either(loop.interrupted, stop_requested)
        try:
            loop.stopping = _reason(lambda: loop.tick_to_end(root, max_robot_seconds, asked))
            loop.stopping = loop.stopping or asked()
            if loop.stopping is not None:
                _reason(loop.stop)
        finally:
            if _reason(robot.hold) is not None:
                _reason(robot.hold)
        return loop.execution(time.perf_counter() - began, asked() is not None)


@dataclass
class _Loop:
    """Execution in progress: the tree and its blackboard."""

    blackboard: Blackboard
    watched: Watched
    root: Behaviour
    tick_period: float
    observer: Observer | None
    keep: Keep | None
    signals: Interrupts
    stopping: str | None = None
    reflex: str | None = None
    held: Held | None = None
    start: float | None = None
    now: float = 0.0

    def tick_to_end(self, root: Behaviour, budget: float, asked: Asked) -> str | None:
        """Tick until `root` ends: None when it succeeded, else why not. `budget` is robot time in
        s."""
        if self.start is None:
            self.start = self.now = self.blackboard.robot.state.t
        until = self.now + budget
        for _ in range(math.ceil(budget / self.tick_period)):
            if self.now >= until:
                break  # more time passed than was asked for: a real robot's does
            self._advance()
            if reason := asked():
                return reason
            root.tick_once()
            self._show()
            if root.status is Status.SUCCESS:
                return None
            if root.status is Status.FAILURE:
                self.reflex = self.reflex or self.blackboard.robot.state.reflex
                return self._failure()
        return f"not done after {budget:g} s of robot time, the budget of a run"

    def interrupted(self) -> str | None:
        """Signal handler: request a controlled stop."""
        return self.signals.reason if self.signals.pressed() else None

    def hurried(self) -> str | None:
        """Second signal: hold at once."""
        return self.signals.reason if self.signals.pressed() > 1 else None

    def stop(self) -> None:
        """Bring everything to rest, then put down what is held."""
        name = self.blackboard.state.holding
        holds = name is not None or self._gripping(unanswered=False)
        try:
            self._bring_to_rest()
        finally:
            if holds:
                self.held = Held(name, self._fate())

    def _bring_to_rest(self) -> None:
        try:
            self._interrupt()
        finally:
            self.blackboard.robot.hold()
        if not self.hurried():
            self._come_to_rest()
        if not self.hurried() and self.blackboard.robot.state.gripping:
            self._put_down()

    def _fate(self) -> Fate:
        """Fate of the held object; one that slipped out is believed at its place again."""
        if self._gripping():
            return "held"
        if self.blackboard.state.holding is None:
            return "put down"
        if self._let_go():
            self.blackboard.state = released(self.blackboard)
            return "put down"
        self.blackboard.state = lost(self.blackboard)
        return "lost"

    def _let_go(self) -> bool:
        """True if the fingers were opening: they do where a support is proven alone. Those that
        lose something close further."""
        return self.blackboard.robot.state.width > self.blackboard.load.width

    def execution(self, wall_seconds: float, asked: bool) -> Execution:
        """The result as it stands."""
        _reason(self._drain)
        fault = self._note_fault()
        trace = self.blackboard.recorder.snapshot()
        return Execution(
            trace,
            "complete" if self.stopping is None else "stopped",
            self._stopped_by(),
            self.blackboard.state,
            sum(leaf.node != STOP_NODE for leaf in trace.leaves),
            self._elapsed(),
            wall_seconds,
            asked=asked,
            fault=fault or self._lost(),
            reflex=self.reflex,
            held=self.held,
        )

    def _lost(self) -> str | None:
        """Reason why the robot does not move any more."""
        try:
            return self.blackboard.robot.state.fault
        except Exception as error:
            return str(error)

    def _note_fault(self) -> str | None:
        """Note a fault of the signals in the trace from its onset, which may be before the action
        that it ended: nothing recorded since is evidence."""
        fault = self.watched.fault
        if fault is None:
            return None
        context = self.blackboard.state.context()
        run = LeafRun(
            STOP_NODE, "Watch", "sensors", fault.since, self.now, "FAILURE", str(fault), context
        )
        self.blackboard.recorder.leaves.append(run)
        return str(fault)

    def _put_down(self) -> None:
        self.blackboard.failed = False
        down = PrimitiveLeaf(PutDown(), self.blackboard, STOP_NODE)
        try:
            self.tick_to_end(down, PutDown.timeout, self.hurried)
        finally:
            down.stop(Status.INVALID)
        if self.blackboard.robot.state.moving:
            self._rest()

    def _come_to_rest(self) -> None:
        """Wait for the end of all motion, and stop pressing on what was run into: `hold` keeps the
        force of the set-point that the arm lags behind, a joint motion to where the arm is gives
        way."""
        for _ in range(EASINGS):
            if self._pressing():
                self.blackboard.robot.move_joints(self.blackboard.robot.state.q)
            self._rest()
            if self.hurried() or not self._pressing():
                return

    def _rest(self) -> None:
        until = self.now + STOP_SECONDS
        for _ in range(math.ceil(STOP_SECONDS / self.tick_period)):
            if self.now >= until:
                return
            self._advance()
            self._show()
            state = self.blackboard.robot.state
            if self.hurried() or not (state.moving or state.gripper_moving):
                return

    def _pressing(self) -> bool:
        robot = self.blackboard.robot
        force = unexplained_force(robot.state, robot.limits, robot.state.gripping, robot.gravity)
        return bool(np.linalg.norm(force) > robot.limits.free_force)

    def _advance(self) -> None:
        self.blackboard.robot.advance(self.tick_period)
        now = self.blackboard.robot.state.t
        if math.isfinite(now):
            self.now = now
        if self.stopping is None:
            self._drain()
        else:
            # A stop goes on without the samples of a robot that no longer hands them out.
            _reason(self._drain)

    def _drain(self) -> None:
        samples = self.blackboard.recorder.drain()
        if self.keep is None:
            return
        try:
            self.keep(samples, self.blackboard.recorder)
        except Exception as error:
            log.warning("the trace is no longer written down while it grows: %s", error)
            self.keep = None

    def _show(self) -> None:
        if self.observer is None:
            return
        leaves, state = self.blackboard.recorder.leaves, self.blackboard.robot.state
        snapshot = Snapshot(self.root, state, self._elapsed(), leaves, self.stopping)
        try:
            self.observer.on_tick(snapshot)
        # Printing to a terminal that is gone may raise SystemExit (rich does).
        except (Exception, SystemExit) as error:
            log.warning("the run goes on unwatched: %s: %s", type(error).__name__, error)
            self.observer = None

    def _elapsed(self) -> float:
        return self.now - (self.start or 0.0)

    def _failure(self) -> str:
        failed = next(
            leaf for leaf in reversed(self.blackboard.recorder.leaves) if leaf.status == "FAILURE"
        )
        return f"{failed.label}: {failed.message}"

    def _stopped_by(self) -> str | None:
        warning = self.held.warning if self.held else None
        if self.stopping is None or warning is None:
            return self.stopping
        return f"{self.stopping}; {warning}"

    def _gripping(self, unanswered: bool = True) -> bool:
        """True if the fingers hold something; what is taken for so where nobody answers."""
        try:
            return self.blackboard.robot.state.gripping
        except Exception:
            return unanswered

    def _interrupt(self) -> None:
        """End what still runs; what has ended keeps its status, which stopping the root would
        erase."""
        for node in self.root.iterate():
            if node.status is Status.RUNNING:
                if isinstance(node, PrimitiveLeaf):
                    node.stop(Status.INVALID)
                node.status = Status.INVALID


def _either(interrupted: Asked, stop_requested: Callable[[], bool] | None) -> Asked:
    """Asks both: an interrupt, and whoever else may want the run to stop."""

    def asked() -> str | None:
        if reason := interrupted():
            return reason
        if stop_requested is not None and stop_requested():
            return "stop requested"
        return None

    return asked


def _reason(step: Callable[[], str | None]) -> str | None:
    """The step's own result, or what it raised, in words: nothing may keep the runner from stopping
    the robot."""
    try:
        return step()
    except KeyboardInterrupt:
        return "interrupted"
    except (Exception, SystemExit) as error:
        log.debug("the run failed", exc_info=True)
        return f"{type(error).__name__}: {error}"
