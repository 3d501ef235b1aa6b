"""Rehearsal of a plan in simulation before the robot moves, and its file in the run folder."""

from __future__ import annotations

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Collection
from contextlib import closing
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from palpate.common.errors import InputError
from palpate.common.files import MB, read_bytes
from palpate.common.processes import interrupts, shared_out
from palpate.common.version import __version__
from palpate.execution.foresight import Finite, Foresight, WorldComparison
from palpate.execution.harm import FALLING, MOVED, first_harm
from palpate.execution.runner import STOP_NODE, Execution, run
from palpate.execution.simulated_cell import draw_truth
from palpate.execution.witness import LOOK, Witness
from palpate.mjcf.contacts import deciding_geom
from palpate.planning.check.finding import Finding
from palpate.planning.plan import Plan, plan_json
from palpate.primitives.base import Blackboard
from palpate.primitives.gripper import CloseGripper
from palpate.primitives.rules.solids import solids
from palpate.primitives.state import RESTORED_POSITION, SymbolicState
from palpate.robots.description import PREFIX
from palpate.robots.owner import measured_arm
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.scene import Scene

# s of observation after the end of a run. An object released in the last moment falls or tips over
# in a shorter time.
AFTERWARDS = 1.0
# Factor on the friction of the pads in a drawn world: friction on rubber varies by this with dust or water
SMOOTHER = 0.5
FIRMER = "grasp it nearer to its centre of mass, and lift, tilt or swing it less"
DRAWS = 2  # Number of worlds drawn from the priors of open values, in addition to the believed one
# s, longest robot time of a rehearsal; a longer plan must be split into several runs.
LONGEST = 600.0
# Factor on `LONGEST` that the predicted time must exceed for an early stop of the rehearsal. The
# durations of motions of one kind vary by less than this factor.
LONGER = 1.5
ALIKE = 5  # Least number of motions of a kind for a prediction of its duration
# s before the run, at most, in which the objects come to rest. One that moves by itself is not at rest.
QUIET = 2.0
SETTLING = 0.2  # s between two tests if the objects are at rest


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Prediction of a run."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    actions: int  # number of leaves started in the believed world
    robot_seconds: Finite  # s, there
    peak_force: Finite  # N, largest external force at the TCP, there
    failure: str | None  # reason why the plan must not run, or None
    draws: int = 1  # worlds in which it was rehearsed
    path: str = "tree"  # leaf of the plan where the failure happened; the tree for the whole plan
    # Final poses of the objects after each leaf, in the believed world.
    foresight: Foresight = field(default=Foresight(), compare=False, repr=False)

    @property
    def finding(self) -> Finding | None:
        """Finding on the plan, None for one that may run."""
        if self.failure is None:
            return None
        return Finding(self.path, "rehearsal", f"in simulation the plan fails: {self.failure}")

    def figures(self) -> dict[str, Any]:
        """The prediction without the foresight, as in `result.json`."""
        return {one.name: getattr(self, one.name) for one in fields(self) if one.compare}

    def __str__(self) -> str:
        ending = f"would stop: {self.failure}" if self.failure else "no failure"
        worlds = f"in {self.draws} worlds, " if self.draws > 1 else ""
        return (
            f"{worlds}{self.actions} actions, {self.robot_seconds:.1f} s, at most "
            f"{self.peak_force:.1f} N, {ending}"
        )


class TimePrediction:
    """Prediction of the robot time of a whole plan from its motions so far.

    The time of a motion includes the sensing before it.
    """

    def __init__(self, plan: Plan, start: float) -> None:
        # Number of nodes of each kind in the plan.
        nodes = plan.tree.walk() if plan.tree is not None else ()
        self._kinds = {path: node.type for path, node in nodes}
        self._count = Counter(self._kinds.values())
        self._took: defaultdict[str, list[float]] = defaultdict(list)
        self._last = start

    def note_end(self, path: str, t: float) -> None:
        """Note that the motion at a path ended at `t`, s; motions of a controlled stop do not count."""
        if path in self._kinds:
            self._took[self._kinds[path]].append(t - self._last)
        self._last = t

    @property
    def is_too_slow(self) -> bool:
        """True if the plan certainly takes longer than `LONGEST`."""
        # Lower bound: mean duration times number of nodes, over the kinds seen often enough.
        known = {kind: took for kind, took in self._took.items() if len(took) >= ALIKE}
        seconds = sum(self._count[kind] * float(np.mean(took)) for kind, took in known.items())
        return seconds > LONGER * LONGEST


def rehearse(plan: Plan, scene: Scene, draws: int = DRAWS) -> Rehearsal:
    """Execute the plan without noise in the believed world and in `draws` others; cached.

    A stop in a drawn world is no failure: an arm that meets a table at another height has to stop.
    Harm is a failure in any world.
    """
    key = ("rehearsal", plan.parameters, repr(plan.tree), draws)
    return solids(scene).get_or_compute(key, lambda: _rehearse_once(plan, scene, draws))


def _rehearse_once(plan: Plan, scene: Scene, draws: int) -> Rehearsal:
    # In the first of the drawn worlds the pads are smoother than believed. If the scene has no unknowns, it is the
    # only one of a plan that grasps.
    seeds = range(1, 1 + draws) if scene.missing else range(min(draws, int(_grasps(plan))))
    worlds = [(0, 1.0), *((seed, 1.0 if i else SMOOTHER) for i, seed in enumerate(seeds))]
    # The worlds are shared out to the processors. A failure in the believed one, the first, ends the others.
    with (
        interrupts() as signals,
        signals.raise_in_block(),
        closing(shared_out(lambda world: _attempt(plan, scene, *world), worlds)) as attempts,
    ):
        believed = next(attempts)
        drawn = [] if believed.failure else [*attempts]
    # A drawn world may add a harm. Its observed weights widen the foresight.
    worst = next((other for other in drawn if other.failure), believed)
    return replace(
        believed,
        failure=worst.failure,
        path=worst.path,
        draws=1 + len(drawn),
        foresight=believed.foresight.among(*(other.foresight for other in drawn)),
    )


def _grasps(plan: Plan) -> bool:
    """True for a plan that closes the fingers on an object."""
    nodes = plan.tree.walk() if plan.tree is not None else ()
    return any(node.type == CloseGripper.__name__ for _, node in nodes)


def named_objects(plan: Plan, scene: Scene) -> frozenset[str]:
    """Objects that a plan names in its parameters or arguments, and that may be moved."""
    # Objects of the parameters, then those of all arguments.
    found = {parameter.object for parameter in plan.parameters}
    if plan.tree is not None:
        for _, node in plan.tree.walk():
            found.update(*(_subject(value, scene) for _, value in node.args))
    return frozenset(found & set(scene.objects))


def _subject(value: object, scene: Scene) -> set[str]:
    """Object that an argument names, directly or by one of its poses."""
    if not isinstance(value, str):
        return set()
    try:
        place = scene.symbols.parse(value).name
    except InputError:
        return {value}
    return {value, scene.symbols.subjects.get(place, place)}


def _attempt(plan: Plan, scene: Scene, seed: int, grip: float = 1.0) -> Rehearsal:
    """Rehearse in one world, in others than the believed one with harm as the only failure.

    Unknowns are as believed for seed 0. `grip` is a factor on the friction between pads and objects.
    """
    # A simulated robot in the drawn or believed world, observed by a witness.
    truth = draw_truth(scene, seed) if seed else {}
    robot = MujocoRobot(scene.spec(truth), scene.pose_world_base, measured_arm(scene.arm))
    scale_grip(robot.world.model, grip)
    witness, look = Witness.of(robot.world), WorldComparison(robot.world)
    named = named_objects(plan, scene)

    def settle_state(path: str, blackboard: Blackboard) -> SymbolicState:
        pace.note_end(path, blackboard.robot.state.t)
        return look.settled(path, blackboard)

    try:
        # The world must be at rest before the arm moves.
        _settle(robot, QUIET)
        robot.drain()
        if (moved := first_harm(witness)) is not None:
            # Drawn values with which the scene is not at rest are not the true ones.
            return _attempt_in_unrest(moved[1] if seed == 0 else None)
        pace = TimePrediction(plan, robot.world.t)
        done = run(
            plan,
            scene,
            robot,
            stop_requested=lambda: pace.is_too_slow or _is_harming(witness, named),
            max_robot_seconds=LONGEST,
            noiseless=True,
            settled=settle_state,
        )
        _settle(robot, AFTERWARDS)
    finally:
        robot.close()
    # The earliest harm counts before the reason of a stop.
    first = first_harm(witness, named)
    harmed = None if first is None else _at(done, *first)
    stop = None if done.stopped_by is None else _at(done, np.inf, done.stopped_by)
    if pace.is_too_slow or done.robot_seconds >= LONGEST:
        stop = "tree", f"it takes more than {LONGEST:g} s; make several plans of it"
    # A complete run must also restore all objects, as the plan promises.
    believed = seed == 0 and grip == 1.0
    if harmed is None and stop is None and believed:
        harmed = _first_displacement(done, witness, scene, look.foresight)
    # Largest external force at the TCP over the whole run.
    force = np.linalg.norm(done.trace.samples.wrench[:, :3], axis=1)
    peak = float(force.max(initial=0.0))
    path, failure = harmed or (stop if believed else None) or ("tree", None)
    if failure is not None and grip != 1.0:
        failure += f", if the pads are {100 * grip:.0f} % as rough as believed; {FIRMER}"
    return Rehearsal(
        done.actions, done.robot_seconds, peak, failure, path=path, foresight=look.foresight
    )


def _settle(robot: MujocoRobot, seconds: float) -> None:
    """Let at most `seconds` s pass, until all bodies but the arm are at rest."""
    end = robot.world.t + seconds
    robot.advance(SETTLING)
    while not robot.world.is_settled and robot.world.t < end:
        robot.advance(SETTLING)


def scale_grip(model: mujoco.MjModel, factor: float) -> None:
    """Scale the friction of the contacts between pads and objects in a compiled world."""
    slides = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    fingers = [b for b in model.jnt_bodyid[slides] if model.body(b).name.startswith(PREFIX)]
    pads = np.flatnonzero(np.isin(model.geom_bodyid, fingers)).tolist()
    # A pad decides, or the geom that it touches, or an explicit pair.
    touched = [
        g
        for g in range(model.ngeom)
        if not model.body(model.geom_bodyid[g]).name.startswith(PREFIX)
    ]
    deciding = {deciding_geom(model, *pair) for pair in product(pads, touched)}
    model.geom_friction[[*deciding.union(pads)]] *= factor
    of_pad = np.isin(model.pair_geom1, pads) | np.isin(model.pair_geom2, pads)
    model.pair_friction[of_pad] *= factor


def _attempt_in_unrest(what: str | None) -> Rehearsal:
    """Outcome in a world in which `what` moves while the arm rests; harmless for None."""
    why = what and (
        f"{what} while the arm rests: the scene does not settle; state it as it stands, and give what rolls "
        'condim="6" and rolling friction, or lay it against something'
    )
    return Rehearsal(0, 0.0, 0.0, why)


def _is_harming(witness: Witness, named: Collection[str]) -> bool:
    """Test if a free object falls, or an object moved that the plan does not name.

    The rest of the rehearsal would show nothing new then.
    """
    if len(witness.looks) < 2:
        return False
    first, before, now = witness.looks[0], *witness.looks[-2:]
    # Falls: speed downwards between the last two looks. Moves: distance from the first look.
    sunk = before.poses[:, 2] - now.poses[:, 2]
    loose = np.arange(len(sunk)) != now.held
    strange = np.array([name not in named for name in witness.objects], dtype=bool)
    moved = np.linalg.norm(now.poses[:, :3] - first.poses[:, :3], axis=1)
    falls = sunk[loose] > FALLING * LOOK * witness.period
    return bool(falls.any() or (moved[strange] > MOVED).any())


def _at(done: Execution, t: float, text: str) -> tuple[str, str]:
    """Path of the leaf that ran at time `t`, s, and the text with time and label."""
    # Latest leaf that began before the time; leaves of a controlled stop do not count.
    leaves = [leaf for leaf in done.trace.leaves if leaf.start <= t and leaf.node != STOP_NODE]
    if not leaves:
        return "tree", text
    leaf = leaves[-1]
    when = f" after {t - leaves[0].start:.1f} s" if np.isfinite(t) else ""
    said = text if text.startswith(leaf.label) else f"{text}{when}, in {leaf.label}"
    return leaf.node, said


def _first_displacement(
    done: Execution, witness: Witness, scene: Scene, seen: Foresight
) -> tuple[str, str] | None:
    """Path of a leaf, and reason: the first object that is not restored.

    The leaf is the one in which the object was displaced most.
    """
    for name, pose in zip(witness.objects, witness.looks[-1].poses, strict=True):
        if name not in scene.objects or name == done.final_state.holding:
            continue
        apart = pose[:3] - scene.body(name).pose_world.position
        if float(np.linalg.norm(apart)) > RESTORED_POSITION:
            # The leaf with the largest shift of the object is the cause to repair.
            x, y, z = (round(1e3 * away) for away in apart.tolist())
            path = seen.displaced_most(name)
            where = {leaf.node: f", displaced in {leaf.label}" for leaf in done.trace.leaves}
            return path, (
                f"'{name}' ends ({x:+d}, {y:+d}, {z:+d}) mm from where it was found"
                f"{where.get(path, '')}; grasp it at its middle, and set it down so that it stays there"
            )
    return None


# File of a rehearsal in a run folder: the folder's plan is not rehearsed again.


FILE = "rehearsal.json"
MOST = 2 * MB  # Bytes, largest size of such a file; fifteen objects take 0.2 MB


@dataclass(frozen=True, slots=True)
class StoredRehearsal:
    """Content of the file: a rehearsal, and the hash of its inputs."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    key: str
    rehearsal: Rehearsal


@cache
def _json() -> TypeAdapter[StoredRehearsal]:
    return TypeAdapter(StoredRehearsal)


def keep_rehearsal(folder: Path, plan: Plan, scene: Scene, rehearsal: Rehearsal) -> None:
    """Write the rehearsal of a plan into the folder of the plan."""
    # Weights are those of the objects of the scene only.
    weights = {n: w for n, w in rehearsal.foresight.weights.items() if n in scene.objects}
    foresight = replace(rehearsal.foresight, weights=weights)
    stored = StoredRehearsal(key(plan, scene), replace(rehearsal, foresight=foresight))
    (folder / FILE).write_bytes(_json().dump_json(stored))


def kept_rehearsal(folder: Path, plan: Plan, scene: Scene) -> Rehearsal | None:
    """The stored rehearsal of this plan in this scene; None without a valid one."""
    try:
        stored = _json().validate_json(read_bytes(folder / FILE, MOST, "a rehearsal"))
    except (InputError, ValidationError):
        return None
    return stored.rehearsal if stored.key == key(plan, scene) else None


def key(plan: Plan, scene: Scene) -> str:
    """Hash of all inputs of a rehearsal.

    They are the plan, the compiled scene and arm, priors, names of poses.yaml, and the version.
    """
    compiled = _binary(solids(scene).model)
    document: dict[str, Any] = plan_json(plan)
    priors = sorted((str(name), repr(prior)) for name, prior in scene.resolved.priors.items())
    # A change of any of these may change the result of the rehearsal.
    said = [__version__, document["parameters"], document["tree"], priors]
    said += [repr(scene.pose_world_base), _arm(scene), _names(scene)]
    return hashlib.sha256(json.dumps(said).encode() + compiled.tobytes()).hexdigest()


def _binary(model: mujoco.MjModel) -> NDArray[np.uint8]:
    """The compiled model as MuJoCo saves it, meshes included."""
    module: Any = mujoco  # these two are missing in its stubs
    compiled = np.empty(module.mj_sizeModel(model), dtype=np.uint8)
    module.mj_saveModel(model, None, compiled)
    return compiled


def _arm(scene: Scene) -> str:
    """The arm's figures that its compiled model does not contain."""
    arm = scene.arm
    return repr((arm.name, arm.pace, arm.stiffness, arm.limits.reflexes, arm.nominal))


def _names(scene: Scene) -> list[dict[str, Any]]:
    """Poses, joint configurations and offsets that a plan may name; poses.yaml states some of them."""
    # All as plain lists, so that the hash does not depend on the representation.
    symbols = scene.symbols
    poses = {name: pose.vector.tolist() for name, pose in symbols.poses.items()}
    joints, offsets = (
        {name: vector.tolist() for name, vector in named.items()}
        for named in (symbols.configurations, symbols.offsets)
    )
    own = {
        name: {offset: vector.tolist() for offset, vector in named.items()}
        for name, named in symbols.own_offsets.items()
    }
    return [poses, joints, offsets, own]
