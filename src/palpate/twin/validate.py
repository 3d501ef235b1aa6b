"""Validation of a twin: it compiles, comes to rest, and yields to a press as measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from palpate.common.errors import PalpateError
from palpate.common.pose import Array
from palpate.estimation.estimate import Estimate
from palpate.mjcf.contacts import BALL, FINGERTIPS, add_ball
from palpate.scene.scene import Scene
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import FORCES, Trace

# Shares of the largest measured depth at which the surface is pressed.
SHARES = (1.0 / 3.0, 2.0 / 3.0, 1.0)
# Duration of a press, in units of 1 / omega. The ball and the surface are both critically damped,
# and the ball is then at rest to 0.03 % of its depth.
PERIODS = 30.0
# Largest count of steps in the simulation of one press, for any time step of the scene.
MOST_STEPS = 20_000
SETTLED = 2.0  # s: time in which objects on a surface come to rest
# Tolerances of the depth to which an object sinks in: share of the depth, and m.
ALIKE, SEEN = 0.2, 2e-4
BALL_BODY = "palpate_ball"


@dataclass(frozen=True, slots=True)
class Press:
    """Press of the twin's surface with one force."""

    force: float  # N
    depth: float  # m, at rest
    # low, high: m, the 95 % interval of the measured depth at that force
    low: float
    high: float

    @property
    def agrees(self) -> bool:
        """True if the depth in the twin is within the measured interval."""
        return self.low <= self.depth <= self.high


def press_notes(twin: Scene, estimates: Sequence[Estimate]) -> Iterator[str]:
    """Yield a remark on the presses of each surface of measured stiffness, with their limits of validity."""
    for estimate in estimates:
        name = estimate.parameter.object
        if estimate.parameter.quantity != "stiffness" or name not in twin.surfaces:
            continue
        if "stiffness" not in twin.body(name).known:
            continue
        presses = press(twin, estimate)
        if not presses:
            continue
        # Word the presses: as measured, or with the interval that they miss.
        forces = ", ".join(f"{p.force:.2g}" for p in presses)
        depths = ", ".join(f"{1e3 * p.depth:.3g}" for p in presses)
        text = f"{name} under the fingertips with {forces} N yields by {depths} mm in the twin"
        if not all(p.agrees for p in presses):
            wanted = ", ".join(f"{1e3 * p.low:.3g} to {1e3 * p.high:.3g}" for p in presses)
            yield f"{text}, where {wanted} mm were measured: its shapes or other contacts prevent it"
            continue
        yield (
            f"{text}, as measured; in MuJoCo a contact's stiffness grows with the mass and the number of points of "
            f"the pressing body: for a free body of m kg at n points it is n m / {FINGERTIPS:g} of this"
        )
        yield from sinking_notes(twin, name, float(estimate.values[0]))


def press(twin: Scene, estimate: Estimate) -> tuple[Press, ...]:
    """Press the surface at shares of the largest measured depth; none if the estimate states no depth."""
    if "depth" not in estimate.parts:
        return ()
    ((low, high),) = estimate.intervals.tolist()
    stiffness, deepest = float(estimate.values[0]), estimate.parts["depth"].value
    presses: list[Press] = []
    # Hooke's law: the stiffness interval gives the interval of the depth at each force.
    for share in SHARES:
        force = share * stiffness * deepest
        depth = rest_depth(twin, estimate.parameter.object, force, stiffness)
        presses.append(Press(force, depth, force / high, force / low))
    return tuple(presses)


def rest_depth(twin: Scene, surface: str, force: float, stiffness: float) -> float:
    """Simulate a ball that presses a surface of `stiffness`, N/m, with `force`, N; return its depth at rest, m."""
    spec = twin.spec()
    # Put the ball on the top of the surface, at its free place or its centre.
    free = twin.symbols.poses.get(f"{surface}_approach")
    body = twin.body(surface)
    x, y, _ = (free.position if free is not None else body.pose_world.apply(body.centre)).tolist()
    top = body.top_z()
    add_ball(spec, (x, y, top + BALL)).name = BALL_BODY
    model = spec.compile()
    data = mujoco.MjData(model)
    ball = int(model.body(BALL_BODY).id)
    # Damp the ball critically: c = 2 omega m, with omega = sqrt(k / m).
    omega = (stiffness / FINGERTIPS) ** 0.5
    first = int(model.body_dofadr[ball])
    model.dof_damping[first : first + 6] = 2.0 * omega * FINGERTIPS
    data.xfrc_applied[ball, 2] = -force
    # Simulate until it is at rest.
    steps = min(round(PERIODS / omega / model.opt.timestep), MOST_STEPS)
    mujoco.mj_step(model, data, nstep=steps)
    return top + BALL - float(data.xpos[ball, 2])


def sinking_notes(twin: Scene, surface: str, stiffness: float) -> Iterator[str]:
    """Yield a remark on each object whose sinking differs from its weight over the stiffness, N/m.

    MuJoCo scales the contact by the object's mass and its count of contact points. An object of
    higher priority determines the contact itself.
    """
    # Let the objects settle in the twin.
    model = twin.spec().compile()
    data = mujoco.MjData(model)
    carried = twin.body(surface).carries
    before = {name: float(model.body_pos[model.body(name).id, 2]) for name in carried}
    mujoco.mj_step(model, data, nstep=min(round(SETTLED / model.opt.timestep), MOST_STEPS))
    for name in carried:
        # Compare the sinking with weight over stiffness.
        mass = float(model.body_subtreemass[model.body(name).id])
        sinks = before[name] - float(data.body(name).xpos[2])
        wanted = mass * twin.gravity / stiffness
        if abs(sinks - wanted) > ALIKE * wanted + SEEN:
            yield (
                f"{name} sinks {1e3 * sinks:.1f} mm into {surface} in the twin; its weight over the measured "
                f"stiffness is {1e3 * wanted:.1f} mm"
            )


# Validation of a twin: it must compile, come to rest, and reproduce the recorded forces and
# positions.


# Means (3,) of a trace's recordings. Forces, N, are less those of the empty hand at the same pose;
# positions of the TCP are in m.
Means = list[Array]
Replay = Callable[[Scene], Means]  # Execute the plan again in a scene
ReplayResult = Callable[[], Means]  # Wait for a replay
SETTLE_TIME = 2.0  # s: free simulation before the twin's objects must be at rest
FINEST_STEP = 1e-4  # s: least time step of that simulation
REST_SPEED = 0.01  # m/s and rad/s: upper bound of the speed of an object at rest
REST = 0.3  # s: rest of the arm at the end of a motion


@dataclass(frozen=True, slots=True)
class ReplayResidual:
    """Distance of a replay from the recording."""

    # N, root mean square over the force recordings of the difference of mean wrench forces.
    force: float | None
    position: float | None  # m, the same for the TCP positions of the pose recordings
    note: str = ""  # reason for missing figures, or empty


@dataclass(frozen=True, slots=True)
class Validation:
    """Result of a validation."""

    settled: bool  # every object is at rest after `SETTLE_TIME`
    drift: float  # m, largest displacement of an object while settling
    # twin, template: residuals of the twin and of the template (unknowns at their priors)
    twin: ReplayResidual
    template: ReplayResidual


NOT_REPLAYED = ReplayResidual(None, None, "not replayed")  # Residual of a twin without a replay


def validate(
    twin: Scene, template: Scene, recorded: Trace | None, replay: Replay | None
) -> Validation:
    """Test that a twin's scene comes to rest. With a recording and a replay, compare these."""
    # Rest needs no recording.
    settled, drift = settle(twin)
    validation = Validation(settled, drift, NOT_REPLAYED, NOT_REPLAYED)
    if recorded is None or replay is None:
        return validation
    return compare_touch(validation, twin, template, recorded, replay)


def compare_touch(
    validation: Validation,
    twin: Scene,
    template: Scene,
    recorded: Trace,
    replay: Replay,
    given: ReplayResult | None = None,
) -> Validation:
    """Add the residuals of twin and template; `given` is the template's replay, if it was started before."""
    return replace(
        validation,
        twin=residual_of(recorded, lambda: replay(twin)),
        template=residual_of(recorded, given or (lambda: replay(template))),
    )


def settle(scene: Scene) -> tuple[bool, float]:
    """Simulate `SETTLE_TIME` s; return if all objects are at rest, and the largest displacement, m."""
    model = scene.spec().compile()
    # Bound the duration: a scene with smaller steps would take minutes.
    model.opt.timestep = max(model.opt.timestep, FINEST_STEP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # Displacement and speed of the objects.
    bodies = [model.body(name).id for name in scene.objects]
    start = data.xpos[bodies].copy()
    mujoco.mj_step(model, data, nstep=round(SETTLE_TIME / model.opt.timestep))
    drift = float(np.linalg.norm(data.xpos[bodies] - start, axis=1).max(initial=0.0))
    moving = [data.qvel[first : first + 6] for first in model.body_dofadr[bodies]]
    speed = float(np.abs(moving).max(initial=0.0))
    # The speed of an unstable simulation is NaN: it is not at rest.
    return bool(np.isfinite(speed) and speed < REST_SPEED), drift


def residual_of(recorded: Trace, replay: ReplayResult) -> ReplayResidual:
    try:
        replayed = replay()
    except PalpateError as error:
        return ReplayResidual(None, None, str(error))
    kept, wanted = len(replayed), len(recorded.recordings)
    if kept < wanted:
        return ReplayResidual(None, None, f"the replay stopped after {kept} of {wanted} recordings")
    return compare(recorded, replayed)


def compare(recorded: Trace, replayed: Means) -> ReplayResidual:
    """Residual between a trace and a replay of the same plan, recording by recording."""
    # Root mean squares, separately for forces and positions.
    buffers = np.array([recording.buffer for recording in recorded.recordings])
    offsets = np.reshape(np.subtract(mean_recordings(recorded), replayed[: len(buffers)]), (-1, 3))
    return ReplayResidual(rms(offsets[buffers == FORCES]), rms(offsets[buffers != FORCES]))


def mean_recordings(trace: Trace) -> Means:
    """Means of the recordings that are compared."""
    return [
        mean_force(trace, recording)
        if recording.buffer == FORCES
        else trace.of(recording).pose_world_tcp[:, :3].mean(axis=0)
        for recording in trace.recordings
    ]


def mean_force(trace: Trace, recording: Recording) -> Array:
    """Mean force (3,), N, less that of the empty hand at rest at the same pose, the arm's bias."""
    force: Array = trace.of(recording).wrench[:, :3].mean(axis=0)
    empty: list[Array] = []
    for leaf in empty_motions(trace, recording):
        at_rest = trace.samples.between(leaf.end - REST, leaf.end)
        empty.append(at_rest.wrench[:, :3].mean(axis=0))
    return force - np.mean(empty, axis=0) if empty else force


def empty_motions(trace: Trace, recording: Recording) -> Iterator[LeafRun]:
    """Yield the motions that ended with the empty hand at the pose of the recording."""
    for leaf in trace.leaf_runs("MovePose"):
        after = leaf.context
        if after is not None and after.holding is None and after.at == recording.context.at:
            yield leaf


def rms(differences: Array) -> float | None:
    """Root mean square of the lengths of vectors (n, 3)."""
    if not len(differences):
        return None
    return float(np.sqrt(float(np.sum(differences**2)) / len(differences)))
