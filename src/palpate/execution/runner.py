"""Runner of a plan on a robot: one loop, and a controlled stop in which nothing is dropped."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, cast

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.common.errors import InputError
from palpate.common.processes import Interrupts, interrupts
from palpate.execution.leaf import PrimitiveLeaf, build
from palpate.execution.stop import Fate, HeldObject, PutDown, let_slip, lost, state_after_release
from palpate.planning.plan import Plan
from palpate.primitives.base import Blackboard, Recorder, Settled, keep_state
from palpate.primitives.guarding import is_in_motion
from palpate.primitives.registry import Vocabulary, vocabulary
from palpate.primitives.state import SymbolicState
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import unexplained_force
from palpate.robots.watched import Watched
from palpate.scene.scene import Scene
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Samples, Trace

log = logging.getLogger(__name__)

TICK_PERIOD = 0.02  # s of robot time between two ticks
LONGEST_WAIT = 0.08  # s between two ticks while no leaf needs one: 1 mm of a probe's travel
MAX_ROBOT_SECONDS = 1800.0  # s, largest robot time of a whole run
STOP_SECONDS = 2.0  # s of robot time for the arm to come to rest after `hold`
EASINGS = 8  # Largest number of reductions of a pressing force; each leaves a fraction of it
# Estimators of the conversions during a run, by quantity; others are the defaults. Reported values
# are estimated after the run, from all recordings.
MEANWHILE: Mapping[str, str] = {"mass": "rests-and-passes"}
# Estimators for a robot without noise or with a wrist sensor, by quantity. Its forces have hardly any
# bias. The default estimator removes the bias of joint torques by a contrast, at a large cost.
UNBIASED: Mapping[str, str] = {"mass": "single-shot"}
# `LeafRun.node` of the runner's own leaves in a controlled stop; no plan has such a node.
STOP_NODE = "stop"

# Function that returns the origin of a request to stop the run; None without one.
StopRequest = Callable[[], str | None]
# Writer of a growing trace, called after every tick with the newest samples and all recordings. An
# exception of the writer ends only the writing.
Keep = Callable[[Samples, Recorder], None]


@dataclass(frozen=True, slots=True, eq=False)
class Execution:
    """Result of an execution."""

    trace: Trace  # everything recorded, up to and including a controlled stop
    status: Literal["complete", "stopped"]  # `complete` when the tree succeeded, else `stopped`
    stopped_by: str | None  # the reason, in one sentence; None when complete
    final_state: SymbolicState  # the believed cell at the end
    actions: int  # number of the plan's leaves that were started
    # robot_seconds, wall_seconds: duration.
    robot_seconds: float
    wall_seconds: float
    # Reasons of earlier stops after which the run was continued (see `palpate.execution.recovery`).
    setbacks: tuple[str, ...] = ()
    asked: bool = False  # a person or the caller requested the stop
    # Reason not to trust the robot's signals, or not to move the robot; None without a fault.
    fault: str | None = None
    reflex: str | None = None  # reason of the arm's own stop, which ended the run; None without one
    # Object in the fingers at the stop, and its fate; None without one.
    held: HeldObject | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """State shown to an observer after a tick."""

    root: Behaviour  # the plan's tree
    robot: RobotState  # the cached state
    elapsed: float  # robot time since the start, s
    leaves: Sequence[LeafRun]  # leaves that have ended so far
    stopping: str | None = None  # reason why the run is being stopped; None while it is not


class Observer(Protocol):
    """Observer of a run, e.g. to draw it. Called in the loop after every tick, so it must be quick;
    after an exception it is not called again."""

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
    noiseless: bool = False,
    settled: Settled = keep_state,
) -> Execution:
    """Run a checked plan to its end, or to a controlled stop.

    A failed leaf, an exception, a signal (`palpate.common.processes`; SIGINT by default),
    `stop_requested` and the time budget all end in a controlled stop. The arm stops. A held object is
    then put down or, if that is not safe, held still. A second signal skips the putting down and holds
    immediately. All recordings are returned in every case. `settled` corrects the symbolic state after
    the motion of the leaf at a path (`palpate.execution.foresight`).

    The robot is left holding its position; the caller closes it. `noiseless` marks a simulated robot,
    whose signals neither freeze nor get lost.
    Raises InputError: the plan has no tree, or one that cannot be built; nothing has moved then.
    """
    if plan.tree is None:
        raise InputError(f"the plan has no tree to run: {plan.explanation}")
    watched = Watched(robot, scene.arm, sound=noiseless)
    passing = cast(Robot, watched)  # it passes all other members of its robot
    sensed = scene.arm.nominal.wrench_sensor is not None
    choice = UNBIASED if noiseless or sensed else MEANWHILE
    blackboard = Blackboard(
        passing, SymbolicState(scene), Recorder(passing), choice=choice, settled=settled
    )
    root = build(plan.tree, words or vocabulary(), blackboard)
    began = time.perf_counter()
    with interrupts() as signals, signals.defer():
        loop = Loop(
            blackboard, watched, root, tick_period, observer=observer, keep=keep, signals=signals
        )

        # A signal comes before the caller's request.
        def stop_request() -> str | None:
            if reason := loop.interrupted():
                return reason
            return "stop requested" if stop_requested is not None and stop_requested() else None

        try:
            # Run to the end, then stop in a controlled way unless the tree succeeded.
            loop.stopping = result_or_error(
                lambda: loop.tick_to_end(root, max_robot_seconds, stop_request)
            )
            loop.stopping = loop.stopping or stop_request()
            if loop.stopping is not None:
                result_or_error(loop.stop)
        finally:
            # Hold in any case, and try twice: no exception may leave the arm moving.
            if result_or_error(robot.hold) is not None:
                result_or_error(robot.hold)
        return loop.execution(time.perf_counter() - began, stop_request() is not None)


@dataclass
class Loop:
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
    held: HeldObject | None = None
    start: float | None = None
    now: float = 0.0

    def tick_to_end(self, root: Behaviour, budget: float, asked: StopRequest) -> str | None:
        """Tick until `root` ends; None if it succeeded, else the reason.

        `budget` is robot time, s.
        """
        # The robot's clock starts with the first tick of the run.
        if self.start is None:
            self.start = self.now = self.blackboard.robot.state.t
        for _ in self.ticks(budget):
            if reason := asked():
                return reason
            root.tick_once()
            self.show()
            if root.status is Status.SUCCESS:
                return None
            # The failed leaf states the reason; a reflex of the arm is kept for recovery.
            if root.status is Status.FAILURE:
                self.reflex = self.reflex or self.blackboard.robot.state.reflex
                leaves = reversed(self.blackboard.recorder.leaves)
                failed = next(leaf for leaf in leaves if leaf.status == "FAILURE")
                return f"{failed.label}: {failed.message}"
        return f"not done after {budget:g} s of robot time, the budget of a run"

    def ticks(self, seconds: float) -> Iterator[None]:
        """Advance tick by tick for `seconds` of robot time."""
        until = self.now + seconds
        # A frozen clock ends the loop as well. A real robot's clock advances by more than a tick.
        for _ in range(math.ceil(seconds / self.tick_period)):
            if self.now >= until:
                return
            self.advance()
            yield

    def interrupted(self) -> str | None:
        """Reason of a first signal, which asks for a controlled stop."""
        return self.signals.reason if self.signals.count_new() else None

    def hold_reason(self) -> str | None:
        """Reason of a second signal, which asks to hold immediately."""
        return self.signals.reason if self.signals.count_new() > 1 else None

    def stop(self) -> None:
        """Bring all motion to rest, then put down a held object."""
        name = self.blackboard.state.holding
        holds = name is not None or self.is_gripping(default=False)
        try:
            try:
                self.interrupt()
            finally:
                self.blackboard.robot.hold()
            # An object that slips onto its support is released at once, before the arm rests.
            slipped = let_slip(self.blackboard)
            if not (slipped or self.hold_reason()):
                self.come_to_rest()
            if not self.hold_reason() and (slipped or self.blackboard.robot.state.gripping):
                self.put_down()
        finally:
            if holds:
                self.held = HeldObject(name, self.fate())

    def fate(self) -> Fate:
        """Fate of the held object; a lost one is believed to be at its place in the scene."""
        if self.is_gripping(default=True):
            return "held"
        if self.blackboard.state.holding is None:
            return "put down"
        # The fingers open only on a proven support. Fingers that lose an object close further.
        if self.blackboard.robot.state.width > self.blackboard.load.width:
            self.blackboard.state = state_after_release(self.blackboard)
            return "put down"
        self.blackboard.state = lost(self.blackboard)
        return "lost"

    def execution(self, wall_seconds: float, asked: bool) -> Execution:
        """The result so far."""
        result_or_error(self.drain)
        # A fault of the signals comes before one that the robot itself reports.
        fault = self.note_fault()
        if fault is None:
            try:
                fault = self.blackboard.robot.state.fault
            except Exception as error:
                fault = str(error)
        trace = self.blackboard.recorder.snapshot()
        stopped_by, warning = self.stopping, self.held.warning if self.held else None
        if stopped_by is not None and warning is not None:
            stopped_by = f"{stopped_by}; {warning}"
        return Execution(
            trace,
            status="complete" if self.stopping is None else "stopped",
            stopped_by=stopped_by,
            final_state=self.blackboard.state,
            actions=sum(leaf.node != STOP_NODE for leaf in trace.leaves),
            robot_seconds=self.elapsed(),
            wall_seconds=wall_seconds,
            asked=asked,
            fault=fault,
            reflex=self.reflex,
            held=self.held,
        )

    def note_fault(self) -> str | None:
        """Record a fault of the signals from its onset; later recordings are no evidence.

        The onset may be before the action that the fault ended.
        """
        fault = self.watched.fault
        if fault is None:
            return None
        # A separate entry from the onset of the fault marks all later samples.
        run = LeafRun(
            STOP_NODE,
            "Watch",
            "sensors",
            start=fault.since,
            end=self.now,
            status="FAILURE",
            message=str(fault),
            context=self.blackboard.state.context(),
        )
        self.blackboard.recorder.leaves.append(run)
        return str(fault)

    def put_down(self) -> None:
        self.blackboard.failed = False
        # The stop runs as a leaf, so that it is checked and recorded like others.
        down = PrimitiveLeaf(PutDown(), self.blackboard, STOP_NODE)
        try:
            self.tick_to_end(down, PutDown.timeout, self.hold_reason)
        finally:
            down.stop(Status.INVALID)
        if self.blackboard.robot.state.moving:
            self.rest()

    def come_to_rest(self) -> None:
        """Wait for the end of all motion, and stop pressing on an obstacle.

        `hold` keeps the force of a set-point ahead of the arm. A joint motion to the arm's own position
        reduces it.
        """
        robot = self.blackboard.robot
        for _ in range(EASINGS):
            # Each joint motion to the measured angles removes a part of the force.
            if self.is_pressing():
                robot.move_joints(robot.state.q)
            self.rest()
            if self.hold_reason() or not self.is_pressing():
                return

    def rest(self) -> None:
        for _ in self.ticks(STOP_SECONDS):
            self.show()
            state = self.blackboard.robot.state
            # After a reflex the arm still yields, without a commanded motion.
            moves = state.moving or state.gripper_moving or is_in_motion(state)
            if self.hold_reason() or not moves:
                return

    def is_pressing(self) -> bool:
        robot = self.blackboard.robot
        # Force beyond that of a held load: the arm presses on an obstacle.
        force = unexplained_force(robot.state, robot.limits, robot.state.gripping, robot.gravity)
        return bool(np.linalg.norm(force) > robot.limits.free_force)

    def advance(self) -> None:
        # Number of ticks that no leaf needs. The tolerance absorbs rounding errors.
        ticks = math.ceil(self.blackboard.wait(LONGEST_WAIT) / self.tick_period - 1e-6)
        self.watched.run_on(max(1, ticks), self.tick_period)
        now = self.blackboard.robot.state.t
        if math.isfinite(now):
            self.now = now
        if self.stopping is None:
            self.drain()
        else:
            # A stop continues even if the robot provides no samples any more.
            result_or_error(self.drain)

    def drain(self) -> None:
        # A failing writer must not stop the run.
        samples = self.blackboard.recorder.drain()
        if self.keep is None:
            return
        try:
            self.keep(samples, self.blackboard.recorder)
        except Exception as error:
            log.warning("the trace is no longer written down while it grows: %s", error)
            self.keep = None

    def show(self) -> None:
        if self.observer is None:
            return
        leaves, state = self.blackboard.recorder.leaves, self.blackboard.robot.state
        snapshot = Snapshot(self.root, state, self.elapsed(), leaves, self.stopping)
        try:
            self.observer.on_tick(snapshot)
        # Printing to a closed terminal may raise SystemExit (rich does).
        except (Exception, SystemExit) as error:
            log.warning("the run goes on unwatched: %s: %s", type(error).__name__, error)
            self.observer = None

    def elapsed(self) -> float:
        return self.now - (self.start or 0.0)

    def is_gripping(self, default: bool) -> bool:
        """True if the fingers hold an object; `default` for a robot that does not respond."""
        try:
            return self.blackboard.robot.state.gripping
        except Exception:
            return default

    def interrupt(self) -> None:
        """End running nodes; ended ones keep their status, which stopping the root would erase."""
        for node in self.root.iterate():
            if node.status is Status.RUNNING:
                if isinstance(node, PrimitiveLeaf):
                    node.stop(Status.INVALID)
                node.status = Status.INVALID


def result_or_error(step: Callable[[], str | None]) -> str | None:
    """The step's result, or its exception as text.

    No exception may keep the runner from stopping the robot.
    """
    try:
        return step()
    except KeyboardInterrupt:
        return "interrupted"
    except (Exception, SystemExit) as error:
        log.debug("the run failed", exc_info=True)
        return f"{type(error).__name__}: {error}"
