"""Equations of a weighing: signals in rows, and their covariance without the load."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.load.biases import covariance
from palpate.estimation.load.segments import Weighing
from palpate.estimation.motion import Mask
from palpate.geometry.pose import Array

FORCE_Z, TORQUE_X, TORQUE_Y, TORQUE_Z = 2, 3, 4, 5
"""Components of a wrench."""
LEANING = (0, 1)
"""Components that a weight has where gravity is tilted."""
SIDEWAYS = (0, 1, 5)
"""Components that a freely hanging object does not have."""
WAYS = {"up": 1.0, "down": -1.0}


class ResidualStiction(NamedTuple):
    """Columns of the joint torque that an approach leaves behind.

    Attributes:
        stuck: (n, 3 rests) of each rest, as a force at the TCP, per newton along each axis.
        forces: (n, 3 passes) of each pass, likewise.
        carried: (n, 3 pairs) common to a rest and the pass that begins at it.
        offsets: (n, m passes) of each pass, in each signal.
        paired: (3 rests + 3 passes,) the columns of `stuck` and `forces` that belong to such a pair.
    """

    stuck: Array
    forces: Array
    carried: Array
    offsets: Array
    paired: Mask

    @property
    def columns(self) -> tuple[Array, Array, Array, Array]:
        return self.stuck, self.forces, self.carried, self.offsets


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Linear equations of a weighing, ordered by signal, then by bin.

    Attributes:
        observed: (n,) the signals.
        root: (n, n) lower triangle whose square is their covariance without the load.
        wrench: (n, 6) signals per unit of each component of the load's wrench.
        grasp: (n,) s, of loaded rows.
        height: (n,) m about its mean, of loaded rows.
        way: (n,) 1 up, -1 down, 0 at rest.
        rest: (n,) 1 at rest.
        dahl: (n, p) signals per unit of friction level in each joint, and per unit of its initial
            state (`estimation.joint_friction`).
        stiction: columns of the torque that an approach leaves in the joints, per rest and pass.
        since: (n, k) signals per newton upward at the TCP, as a step that begins with the second segment in time,
            with the third, and so on.
        signal: (n,) which signal a row is of.
        freedom: degrees of freedom of the noise.
    """

    observed: Array
    root: Array
    wrench: Array
    grasp: Array
    height: Array
    way: Array
    rest: Array
    dahl: Array
    stiction: ResidualStiction
    since: Array
    signal: NDArray[np.intp]
    freedom: float


def equations(weighing: Weighing, gravity: float, apart: float = 1.0) -> Rows:
    """Equations of a weighing; `apart` is the share of the bias that each kind of segment has of its own
    (`estimation.load.biases`)."""
    found = weighing.segments
    # The load resists vertical acceleration, too.
    loaded = np.concatenate([s.loaded * (1.0 + s.acceleration / gravity) for s in found])
    maps = np.concatenate([segment.maps for segment in found])
    path = np.concatenate([segment.path for segment in found])
    signals = int(maps.shape[1])
    root: Array = np.linalg.cholesky(covariance(weighing, maps, apart)).astype(np.float64)

    def each(values: Iterable[float]) -> Array:
        """A number of each segment, in all its rows."""
        pairs = zip(found, values, strict=True)
        return np.tile(np.concatenate([np.full(len(s.t), v) for s, v in pairs]), signals)

    # Friction of a joint shows in its own signal: (signals x bins, 2 joints).
    states = np.concatenate([segment.dahl for segment in found])
    bins, joints, kinds = states.shape
    dahl = np.zeros((joints or signals, bins, joints, kinds))
    for joint in range(joints):
        dahl[joint, :, joint] = states[:, joint]
    # Steps upward that begin with the second segment in time, with the third, and so on.
    upward = maps[:, :, FORCE_Z].T
    start = np.concatenate([np.full(len(segment.t), segment.start) for segment in found])
    steps: list[Array] = []
    for moment in sorted({segment.start for segment in found})[1:]:
        steps.append((upward * (start >= moment)).ravel())
    return Rows(
        observed=np.concatenate([segment.observed for segment in found]).T.ravel(),
        root=root,
        wrench=(maps * loaded[:, None, None]).transpose(1, 0, 2).reshape(-1, 6),
        grasp=each(segment.grasp for segment in found),
        height=np.tile(path - path[loaded != 0.0].mean(), signals),
        way=each(WAYS.get(segment.kind, 0.0) for segment in found),
        rest=each(float(segment.at_rest) for segment in found),
        dahl=dahl.reshape(signals * bins, joints * kinds),
        stiction=residual_stiction(weighing, maps),
        since=np.array(steps).reshape(-1, signals * len(start)).T,
        signal=np.repeat(np.arange(signals), len(path)),
        freedom=weighing.freedom,
    )


def in_each(row: Rows, grasps: Sequence[float], components: Sequence[int]) -> Array:
    """(n, grasps x components): columns of `components` of the wrench, its own in each grasp."""
    columns = [row.wrench[:, components] * (row.grasp == grasp)[:, None] for grasp in grasps]
    return np.concatenate(columns, axis=1)


def each_its_own(blocks: Sequence[Array]) -> list[Array]:
    """The columns of each weighing beside those of the others, which are zero there."""
    width = sum(block.shape[1] for block in blocks)
    wide: list[Array] = []
    at = 0
    for block in blocks:
        own = np.zeros((len(block), width))
        own[:, at : at + block.shape[1]] = block
        at += block.shape[1]
        wide.append(own)
    return wide


def residual_stiction(weighing: Weighing, maps: Array) -> ResidualStiction:
    """Columns of the residual stiction, segment by segment."""
    found, signals, count = weighing.segments, int(maps.shape[1]), len(maps)
    own = np.eye(signals) * weighing.scale[:, None]
    forces: list[Array] = []
    offsets: list[Array] = []
    at = 0
    for segment in found:
        here = slice(at, at + len(segment.t))
        at = here.stop
        pushed, off = np.zeros((signals, count, 3)), np.zeros((signals, count, signals))
        pushed[:, here] = maps[here, :, :3].transpose(1, 0, 2)
        off[:, here] = own[:, None, :]
        forces.append(pushed.reshape(signals * count, 3))
        offsets.append(off.reshape(signals * count, signals))
    rests = [i for i, segment in enumerate(found) if segment.at_rest]
    passes = [i for i, segment in enumerate(found) if not segment.at_rest]
    # Each rest with the pass that begins at it.
    pairs = [
        (i, j) for i in rests for j in passes if 0.0 < found[j].start - found[i].end < tuning.PAUSE
    ]
    both = {i for pair in pairs for i in pair}
    nothing = np.zeros((signals * count, 0))
    return ResidualStiction(
        np.hstack([nothing, *(forces[i] for i in rests)]),
        np.hstack([nothing, *(forces[i] for i in passes)]),
        np.hstack([nothing, *(forces[i] + forces[j] for i, j in pairs)]),
        np.hstack([nothing, *(offsets[i] for i in passes)]),
        np.repeat([i in both for i in [*rests, *passes]], 3),
    )
