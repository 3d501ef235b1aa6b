"""Does the twin behave as was measured? It must compile, come to rest, and give back the recorded
forces and positions."""

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

Replay = Callable[[mujoco.MjSpec], Trace]
"""Executes the plan again in a world made of the given model, and returns what is recorded there."""
Replayed = Callable[[], Trace]
"""The same in a world of its own."""

SETTLE_TIME = 2.0
"""s of free simulation before the twin's objects must rest."""
FINEST_STEP = 1e-4
"""s: a scene that asks for smaller steps is settled with these, or it would take minutes."""
REST_SPEED = 0.01
"""m/s and rad/s."""
REST = 0.3
"""s at the end of a motion in which the arm stands still."""


@dataclass(frozen=True, slots=True)
class Residual:
    """Distance of a replay from the recording.

    Attributes:
        force: N, root mean square over the force recordings of the difference of mean wrench
            forces.
        position: m, the same for the TCP positions of the pose recordings.
        note: why there are no figures, or empty.
    """

    force: float | None
    position: float | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Validation:
    """The twin's marks.

    Attributes:
        settled: every object rests after `SETTLE_TIME`.
        drift: m, largest way an object moved while settling.
        twin, template: residuals of the twin and of the untouched template (unknowns at their
            priors).
    """

    settled: bool
    drift: float
    twin: Residual
    template: Residual


NOT_REPLAYED = Residual(None, None, "not replayed")
"""Of a twin that nobody has touched in simulation."""


def validate(
    twin: Scene, template: Scene, recorded: Trace | None, replay: Replay | None
) -> Validation:
    """All marks of a twin scene against what was recorded; without that or a replay, whether it
    rests."""
    settled, drift = settle(twin)
    marks = Validation(settled, drift, NOT_REPLAYED, NOT_REPLAYED)
    if recorded is None or replay is None:
        return marks
    return touched(marks, twin, template, recorded, replay)


def touched(
    marks: Validation,
    twin: Scene,
    template: Scene,
    recorded: Trace,
    replay: Replay,
    given: Replayed | None = None,
) -> Validation:
    """The marks with the residuals of twin and template; `given`: the template's replay, where that
    has begun elsewhere."""
    return replace(
        marks,
        twin=_residual(recorded, lambda: replay(restful(twin))),
        template=_residual(recorded, given or (lambda: replay(restful(template)))),
    )


def restful(scene: Scene) -> mujoco.MjSpec:
    """The scene, in which what stands still and is not touched takes no time to simulate."""
    spec = scene.spec()
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    return spec


def settle(scene: Scene) -> tuple[bool, float]:
    """Test for rest of all objects after `SETTLE_TIME` s, with the largest displacement, m."""
    model = scene.spec().compile()
    model.opt.timestep = max(model.opt.timestep, FINEST_STEP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in scene.objects]
    start = data.xpos[bodies].copy()
    mujoco.mj_step(model, data, nstep=round(SETTLE_TIME / model.opt.timestep))
    drift = float(np.linalg.norm(data.xpos[bodies] - start, axis=1).max(initial=0.0))
    moving = [data.qvel[first : first + 6] for first in model.body_dofadr[bodies]]
    speed = float(np.abs(moving).max(initial=0.0))
    return bool(np.isfinite(speed) and speed < REST_SPEED), drift


def _residual(recorded: Trace, replay: Replayed) -> Residual:
    try:
        replayed = replay()
    except PalpateError as error:
        return Residual(None, None, str(error))
    if len(replayed.recordings) < len(recorded.recordings):
        return Residual(
            None,
            None,
            f"the replay stopped after {len(replayed.recordings)} of "
            f"{len(recorded.recordings)} recordings",
        )
    return compare(recorded, replayed)


def compare(recorded: Trace, replayed: Trace) -> Residual:
    """The residual between two traces of the same plan, recording by recording."""
    force: list[Array] = []
    position: list[Array] = []
    for then, now in zip(recorded.recordings, replayed.recordings, strict=False):
        if then.buffer == FORCES:
            force.append(_mean_force(recorded, then) - _mean_force(replayed, now))
        else:
            position.append(_mean_position(recorded, then) - _mean_position(replayed, now))
    return Residual(_rms(force), _rms(position))


def compared_until(trace: Trace) -> float:
    """s: end of the last motion or recording that `compare` looks at; 0 where there is none."""
    ends = [0.0]
    for recording in trace.recordings:
        ends.append(recording.end)
        if recording.buffer == FORCES:
            ends += [leaf.end for leaf in _empty(trace, recording)]
    return max(ends)


def _mean_force(trace: Trace, recording: Recording) -> Array:
    """The recording's mean force less the empty hand's at rest at the same pose: the arm's own
    bias."""
    force: Array = trace.of(recording).wrench[:, :3].mean(axis=0)
    empty: list[Array] = []
    for leaf in _empty(trace, recording):
        at_rest = trace.samples.between(leaf.end - REST, leaf.end)
        empty.append(at_rest.wrench[:, :3].mean(axis=0))
    if not empty:
        return force
    return force - np.mean(empty, axis=0)


def _empty(trace: Trace, recording: Recording) -> Iterator[LeafRun]:
    """Motions that ended with the empty hand where the recording was made."""
    for leaf in trace.leaf_runs("MovePose"):
        after = leaf.context
        if after is not None and after.holding is None and after.at == recording.context.at:
            yield leaf


def _mean_position(trace: Trace, recording: Recording) -> Array:
    return trace.of(recording).pose_world_tcp[:, :3].mean(axis=0)


def _rms(differences: list[Array]) -> float | None:
    if not differences:
        return None
    return float(np.sqrt(np.mean([d @ d for d in differences])))
