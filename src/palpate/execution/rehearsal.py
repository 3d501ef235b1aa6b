"""Rehearsal: execution of a plan in physics before anything moves, watched for harm.

The world is the scene as believed, and some draws of what the scene leaves open. A `Witness` records
MuJoCo's contact forces and poses after every physics step; `harm` judges them: forces beyond the limits,
falls, tips, things moved that the plan does not name. Harm in any of these worlds, a failure in the
believed one, and a thing that ends elsewhere than it was found make the plan unfit. After every motion the
symbolic state is corrected by where things are in the simulation (`foresight`), so that later leaves, and the
run itself, go by it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.beside import Beside
from palpate.cells.simulated import draw_truth
from palpate.errors import InputError
from palpate.execution.foresight import Foresight, Look
from palpate.execution.harm.harm import FALLING, MOVED, harm
from palpate.execution.harm.witness import LOOK, Witness
from palpate.execution.runner import STOP_NODE, Execution, run
from palpate.interrupt import interrupts
from palpate.planning.check.case import Finding
from palpate.planning.plan import Plan
from palpate.robots.owner.arm import as_measured
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.state import RESTORED_POSITION, SymbolicState

AFTERWARDS = 1.0
"""s that the world is watched after the end of a run: an object released in the last moment falls, or
tips over, in less."""
DRAWS = 2
"""Worlds drawn from the priors of what the scene leaves open, beside the believed one."""
LONGEST = 600.0
"""s of robot time of a rehearsal; a longer plan is one for several runs."""
LONGER = 1.5
"""Factor by which a plan that is stopped early must exceed it, as predicted from its first motions ..."""
ALIKE = 5  # ... of each kind, as many as this: one kind's durations vary by less than that factor
QUIET = 2.0
"""s that the arm rests at first, which no count of the run includes: what moves then, moves by itself."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Prediction of a run.

    Attributes:
        actions: number of leaves started in the believed world.
        robot_seconds: s, there.
        peak_force: N, largest external force at the TCP, there.
        failure: reason why the plan must not run, or None.
        draws: worlds in which it was rehearsed.
        path: leaf of the plan where that happened; the tree for the whole.
        foresight: where things ended after each leaf, in the believed world.
    """

    actions: int
    robot_seconds: float
    peak_force: float
    failure: str | None
    draws: int = 1
    path: str = "tree"
    foresight: Foresight = field(default=Foresight(), compare=False, repr=False)

    @property
    def finding(self) -> Finding | None:
        """Finding on the plan, None for one that may run."""
        if self.failure is None:
            return None
        return Finding.of(self.path, "rehearsal", f"in simulation the plan fails: {self.failure}")

    def figures(self) -> dict[str, Any]:
        """The prediction without the foresight, as in `result.json`."""
        return {
            "actions": self.actions,
            "robot_seconds": self.robot_seconds,
            "peak_force": self.peak_force,
            "failure": self.failure,
            "draws": self.draws,
            "path": self.path,
        }

    def __str__(self) -> str:
        ending = f"would stop: {self.failure}" if self.failure else "no failure"
        worlds = f"in {self.draws} worlds, " if self.draws > 1 else ""
        return (
            f"{worlds}{self.actions} actions, {self.robot_seconds:.1f} s, at most "
            f"{self.peak_force:.1f} N, {ending}"
        )


@dataclass(frozen=True, slots=True)
class _Attempt:
    """Outcome of a rehearsal in one world, small enough to be sent between processes.

    Attributes:
        harm: path of a leaf and the harm that it did, None for a harmless run.
        stop: path of a leaf and the reason why the run stopped there.
        foresight: where things ended after each leaf.
    """

    actions: int
    robot_seconds: float
    peak_force: float
    harm: tuple[str, str] | None
    stop: tuple[str, str] | None
    foresight: Foresight


class Pace:
    """Prediction of the robot time of a whole plan from its motions so far, with what is sensed between them."""

    def __init__(self, plan: Plan, start: float) -> None:
        nodes = plan.tree.walk() if plan.tree is not None else ()
        self._kinds = {path: node.type for path, node in nodes}
        self._count = Counter(self._kinds.values())
        self._took: defaultdict[str, list[float]] = defaultdict(list)
        self._last = start

    def ended(self, path: str, t: float) -> None:
        """Note that the motion at a path ended at `t`, s; one of a controlled stop is none of the plan's."""
        if path in self._kinds:
            self._took[self._kinds[path]].append(t - self._last)
        self._last = t

    @property
    def is_too_slow(self) -> bool:
        """True if the plan certainly takes longer than `LONGEST`."""
        known = {kind: took for kind, took in self._took.items() if len(took) >= ALIKE}
        seconds = sum(self._count[kind] * float(np.mean(took)) for kind, took in known.items())
        return seconds > LONGER * LONGEST


def rehearse(plan: Plan, scene: Scene, draws: int = DRAWS) -> Rehearsal:
    """Execute the plan with perfect sensors in the believed world, and in `draws` others; once for each
    plan and scene.

    A stop in a drawn world is no failure: an arm that finds a table elsewhere has to stop.

    Raises:
        Interrupted: by a signal.
    """
    key = ("rehearsal", plan.parameters, repr(plan.tree), draws)
    return solids(scene).cached(key, lambda: _rehearsed(plan, scene, draws))


def _rehearsed(plan: Plan, scene: Scene, draws: int) -> Rehearsal:
    seeds = range(1, 1 + draws if scene.missing else 1)
    with (
        interrupts() as signals,
        signals.raised(),
        Beside(lambda: [_attempt(plan, scene, seed) for seed in seeds]) as beside,
    ):
        believed = _attempt(plan, scene, 0)
        failure = believed.harm or believed.stop
        drawn = [] if failure else beside.result()
    failure = failure or next((other.harm for other in drawn if other.harm), None)
    path, reason = failure or ("tree", None)
    return Rehearsal(
        believed.actions,
        believed.robot_seconds,
        believed.peak_force,
        reason,
        draws=1 + len(drawn),
        path=path,
        foresight=believed.foresight.among(*(other.foresight for other in drawn)),
    )


def named_objects(plan: Plan, scene: Scene) -> frozenset[str]:
    """Objects that a plan names, which may be moved: in its parameters and the arguments of its nodes."""
    found = {parameter.object for parameter in plan.parameters}
    if plan.tree is not None:
        for _, node in plan.tree.walk():
            found.update(*(_subject(value, scene) for _, value in node.args))
    return frozenset(found & set(scene.objects))


def _subject(value: object, scene: Scene) -> set[str]:
    """Object that an argument names, or whose pose it is."""
    if not isinstance(value, str):
        return set()
    try:
        place = scene.symbols.parse(value).name
    except InputError:
        return {value}
    return {value, scene.symbols.subjects.get(place, place)}


def _attempt(plan: Plan, scene: Scene, seed: int) -> _Attempt:
    """Rehearse in one world, the believed one for seed 0."""
    truth = draw_truth(scene, seed) if seed else {}
    robot = MujocoRobot(scene.spec(truth), scene.pose_world_base, as_measured(scene.arm))
    witness, look = Witness.of(robot.world), Look(robot.world)
    named, pace = named_objects(plan, scene), Pace(plan, QUIET)

    def settled(path: str, blackboard: Blackboard) -> SymbolicState:
        pace.ended(path, blackboard.robot.state.t)
        return look.settled(path, blackboard)

    try:
        robot.advance(QUIET)
        robot.drain()
        if (moved := harm(witness).first) is not None:
            # Nothing stands as the scene has it with the values drawn: they are not the true ones.
            return _unsettled(moved[1] if seed == 0 else None)
        done = run(
            plan,
            scene,
            robot,
            stop_requested=lambda: pace.is_too_slow or _is_harming(witness, named),
            max_robot_seconds=LONGEST,
            noiseless=True,
            settled=settled,
        )
        robot.advance(AFTERWARDS)
    finally:
        robot.close()
    first = harm(witness, named).first
    harmed = None if first is None else _at(done, *first)
    stop = None if done.stopped_by is None else _at(done, np.inf, done.stopped_by)
    if pace.is_too_slow or done.robot_seconds >= LONGEST:
        stop = "tree", f"it takes more than {LONGEST:g} s; make several plans of it"
    if harmed is None and stop is None and not seed:
        harmed = _displaced(done, witness, scene, look.foresight)
    force = np.linalg.norm(done.trace.samples.wrench[:, :3], axis=1)
    peak = float(force.max(initial=0.0))
    return _Attempt(done.actions, done.robot_seconds, peak, harmed, stop, look.foresight)


def _unsettled(what: str | None) -> _Attempt:
    """Outcome in a world in which something moves while the arm rests; None: a harmless one."""
    why = what and (
        f"{what} while the arm rests: the scene does not settle; state it as it stands, and give what rolls "
        'condim="6" and rolling friction, or lay it against something'
    )
    return _Attempt(0, 0.0, 0.0, ("tree", why) if why else None, None, Foresight())


def _is_harming(witness: Witness, named: Collection[str]) -> bool:
    """Test if something falls that the hand does not hold, or has moved that the plan does not name: the
    rest of the rehearsal shows nothing new."""
    if len(witness.looks) < 2:
        return False
    first, before, now = witness.looks[0], *witness.looks[-2:]
    sunk = before.poses[:, 2] - now.poses[:, 2]
    loose = np.arange(len(sunk)) != now.held
    strange = np.array([name not in named for name in witness.objects], dtype=bool)
    moved = np.linalg.norm(now.poses[:, :3] - first.poses[:, :3], axis=1)
    falls = sunk[loose] > FALLING * LOOK * witness.period
    return bool(falls.any() or (moved[strange] > MOVED).any())


def _at(done: Execution, t: float, text: str) -> tuple[str, str]:
    """Path of the leaf that ran at time `t`, s, and the text with its label."""
    leaves = [leaf for leaf in done.trace.leaves if leaf.start <= t and leaf.node != STOP_NODE]
    if not leaves:
        return "tree", text
    leaf = leaves[-1]
    when = f" after {t - QUIET:.1f} s" if np.isfinite(t) else ""
    said = text if text.startswith(leaf.label) else f"{text}{when}, in {leaf.label}"
    return leaf.node, said


def _displaced(
    done: Execution, witness: Witness, scene: Scene, seen: Foresight
) -> tuple[str, str] | None:
    """The first object that is not restored, with the leaf in which it was displaced most."""
    for name, pose in zip(witness.objects, witness.looks[-1].poses, strict=True):
        if name not in scene.objects or name == done.final_state.holding:
            continue
        apart = pose[:3] - scene.body(name).pose_world.position
        if float(np.linalg.norm(apart)) > RESTORED_POSITION:
            x, y, z = (round(1e3 * away) for away in apart.tolist())
            path = seen.displaced_most(name)
            where = {leaf.node: f", displaced in {leaf.label}" for leaf in done.trace.leaves}
            return path, (
                f"'{name}' ends ({x:+d}, {y:+d}, {z:+d}) mm from where it was found"
                f"{where.get(path, '')}; grasp it at its middle, and set it down so that it stays there"
            )
    return None
