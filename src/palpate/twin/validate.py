"""Validation of a twin: it must compile, come to rest, and reproduce the recorded forces and
positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from palpate.errors import PalpateError
from palpate.geometry.pose import Array
from palpate.scene.scene import Scene
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import FORCES, Trace

Felt = list[Array]
"""Means of a trace's recordings (3,): of forces, N, less those of the empty hand at the same pose; of the TCP's
positions, m."""
Replay = Callable[[Scene], Felt]
"""Executes the plan again in a scene."""
Replayed = Callable[[], Felt]
"""Waits for a replay."""

SETTLE_TIME = 2.0
"""s of free simulation before the twin's objects must be at rest."""
FINEST_STEP = 1e-4
"""Least time step of that simulation, s."""
REST_SPEED = 0.01
"""Speed of an object at rest, m/s and rad/s."""
REST = 0.3
"""s at the end of a motion during which the arm stands still."""


@dataclass(frozen=True, slots=True)
class Residual:
    """Distance of a replay from the recording.

    Attributes:
        force: N, root mean square over the force recordings of the difference of mean wrench
            forces.
        position: m, the same for the TCP positions of the pose recordings.
        note: reason for missing figures, or empty.
    """

    force: float | None
    position: float | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Validation:
    """Result of a validation.

    Attributes:
        settled: every object is at rest after `SETTLE_TIME`.
        drift: m, largest displacement of an object while settling.
        twin, template: residuals of the twin and of the template (unknowns at their priors).
    """

    settled: bool
    drift: float
    twin: Residual
    template: Residual


NOT_REPLAYED = Residual(None, None, "not replayed")
"""Residual of a twin without a replay."""


def validate(
    twin: Scene, template: Scene, recorded: Trace | None, replay: Replay | None
) -> Validation:
    """Test a twin's scene for rest and, with a recording and a replay, compare these."""
    settled, drift = settle(twin)
    validation = Validation(settled, drift, NOT_REPLAYED, NOT_REPLAYED)
    if recorded is None or replay is None:
        return validation
    return touched(validation, twin, template, recorded, replay)


def touched(
    validation: Validation,
    twin: Scene,
    template: Scene,
    recorded: Trace,
    replay: Replay,
    given: Replayed | None = None,
) -> Validation:
    """The validation with the residuals of twin and template; `given`: the template's replay, if it
    was started before."""
    return replace(
        validation,
        twin=residual_of(recorded, lambda: replay(twin)),
        template=residual_of(recorded, given or (lambda: replay(template))),
    )


def settle(scene: Scene) -> tuple[bool, float]:
    """Test for rest of all objects after `SETTLE_TIME` s, with the largest displacement, m."""
    model = scene.spec().compile()
    # A scene that asks for smaller steps would take minutes.
    model.opt.timestep = max(model.opt.timestep, FINEST_STEP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in scene.objects]
    start = data.xpos[bodies].copy()
    mujoco.mj_step(model, data, nstep=round(SETTLE_TIME / model.opt.timestep))
    drift = float(np.linalg.norm(data.xpos[bodies] - start, axis=1).max(initial=0.0))
    moving = [data.qvel[first : first + 6] for first in model.body_dofadr[bodies]]
    speed = float(np.abs(moving).max(initial=0.0))
    # An unstable simulation is not at rest: its speed is no number.
    return bool(np.isfinite(speed) and speed < REST_SPEED), drift


def residual_of(recorded: Trace, replay: Replayed) -> Residual:
    try:
        replayed = replay()
    except PalpateError as error:
        return Residual(None, None, str(error))
    made, wanted = len(replayed), len(recorded.recordings)
    if made < wanted:
        return Residual(None, None, f"the replay stopped after {made} of {wanted} recordings")
    return compare(recorded, replayed)


def compare(recorded: Trace, replayed: Felt) -> Residual:
    """The residual between a trace and a replay of the same plan, recording by recording."""
    buffers = np.array([recording.buffer for recording in recorded.recordings])
    apart = np.reshape(np.subtract(felt(recorded), replayed[: len(buffers)]), (-1, 3))
    return Residual(rms(apart[buffers == FORCES]), rms(apart[buffers != FORCES]))


def felt(trace: Trace) -> Felt:
    """Means of the recordings that are compared."""
    return [
        mean_force(trace, one)
        if one.buffer == FORCES
        else trace.of(one).pose_world_tcp[:, :3].mean(axis=0)
        for one in trace.recordings
    ]


def mean_force(trace: Trace, recording: Recording) -> Array:
    """(3,) N, the recording's mean force less the empty hand's at rest at the same pose, which is the
    arm's own bias."""
    force: Array = trace.of(recording).wrench[:, :3].mean(axis=0)
    empty: list[Array] = []
    for leaf in empty_motions(trace, recording):
        at_rest = trace.samples.between(leaf.end - REST, leaf.end)
        empty.append(at_rest.wrench[:, :3].mean(axis=0))
    return force - np.mean(empty, axis=0) if empty else force


def empty_motions(trace: Trace, recording: Recording) -> Iterator[LeafRun]:
    """Motions that ended with the empty hand at the pose of the recording."""
    for leaf in trace.leaf_runs("MovePose"):
        after = leaf.context
        if after is not None and after.holding is None and after.at == recording.context.at:
            yield leaf


def rms(differences: Array) -> float | None:
    """Root mean square of the lengths of vectors (n, 3)."""
    if not len(differences):
        return None
    return float(np.sqrt(float(np.sum(differences**2)) / len(differences)))
