"""Block means of the joint signals in free air, around a weighing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, rotations
from palpate.estimation.coloured_residual import Spans
from palpate.estimation.evidence import once
from palpate.estimation.joint_friction import slip_states
from palpate.estimation.load_noise import LoadRows, load_rows
from palpate.estimation.motion import (
    SPEED_SMOOTH,
    Mask,
    acceleration,
    at_rest,
    row_at,
    runs,
    smoothed_with_rate,
)
from palpate.estimation.rigid_bodies import wrenches_of_load
from palpate.estimation.wrench_observation import FOLLOWED, WrenchObservation
from palpate.trace.recording import RECORDED
from palpate.trace.samples import Samples, Trace

CLEARANCE = 0.015
"""m of the path above the grasp that is left out, as the support may still carry part of the object
there. Sensitive: mass 0.7 σ, std ×0.9–1.1; com 0.2 σ, std ×0.8–1.4."""
WHOLE_BLOCK = 0.1
"""s: shortest block of a whole run. White noise averages out, and nothing moves far. Not sensitive."""
WHOLE_MOST = 400
"""largest number of such blocks; longer runs have longer blocks. Not sensitive."""
WHOLE_AROUND = 15.0
"""s before and after an object hung on the hand in which motions of the empty hand are used. Sensitive: mass 0.1 σ."""
WHOLE_SLOW = 0.02
"""rad/s, norm over all joints: below this speed an arm is about to rest. Not sensitive."""
WHOLE_SHAKEN = 0.01
"""rad, path of all joints after a rest. Residual stiction of the rest and reversing friction have
then decayed; five times `PRESLIDING`. Sensitive: mass 0.1 σ."""
WHOLE_SETTLED = 0.3
"""s after which the residual stiction of an approach has built up. Not sensitive; without it, rests
with stiction leave a misfit."""
WHOLE_NEAR = 0.03
"""m: distance from the place of a load within which motions of the empty hand certainly count.
Further away, in large joint motions, a model of the arm is off by some mN m. Sensitive: mass
0.3–0.6 σ at 0.1 to 0.2, biased to one side."""
FREE_ABOVE = 5e-3
"""m above the grasp from which an object is in free air. Not sensitive."""

TOUCHING = ("contact", "sliding")

UP = np.array([0.0, 0.0, 1.0])

Rows = NDArray[np.intp]
"""Row indices of a trace's samples."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Blocks:
    """Means over k blocks of time, each so short that nothing moves far."""

    rows: Array  # (k,) samples in each
    t: Array  # (k,) s
    # q, dq: (k, m) rad, rad/s
    q: Array
    dq: Array
    path: Array  # (k, m) rad, path length of each joint in both directions
    observed: Array  # (k, m) N m, without the torque that moves the arm's links
    moved: Array  # (k, m) N m, that torque
    maps: Array  # (k, m, 6) see `WrenchObservation.maps`
    acceleration: Array  # (k, 3) m/s² of the TCP
    pull: Array  # (k, 3) upward force of the load per unit of its weight; 0 where it does not hang
    # (k, m, 9) joint torques of the load: per N m of first moment of its weight, and where it hangs
    # per kg m² of inertia xx yy zz xy xz yz, about the TCP in the axes of the hand.
    held: Array
    grasp: Array  # (k,) s, of the load
    dahl: Array  # (k, m, 2 e) see `joint_friction.slip_states`
    resting: Array  # (k, rests) 1 where the arm is at a rest

    def torques(self, force: Array) -> Array:
        """Map forces (k, 3), N, at the TCP to joint torques (k, m), N m."""
        return np.einsum("kji,ki->kj", self.maps[:, :, :3], force)

    @property
    def spans(self) -> Spans:
        """Stretches that the blocks average."""
        lasts = np.full(len(self.t), float(np.median(np.diff(self.t))) + FOLLOWED)
        return Spans(self.t, lasts, self.path, np.abs(self.dq) * lasts[:, None], self.q)

    @property
    def grasps(self) -> tuple[float, ...]:
        """s, times at which the hand had closed on an object that then hung from it."""
        found: list[float] = self.grasp[self.pull[:, 2] > 0.0].tolist()
        return tuple(sorted(set(found)))


def blocks(
    trace: Trace,
    observed: WrenchObservation,
    name: str,
    groups: Sequence[Rows],
    surely: bool = False,
) -> Blocks:
    """Average the rows of each group, in which the hand is empty or holds `name`.

    The signals are smoothed over `FOLLOWED` first.

    Args:
        surely: count the load only where it certainly hangs free (`CLEARANCE`).
    """
    samples, load, over = trace.samples, load_rows(trace, name), FOLLOWED
    # Row indices of all groups, and the group of each row, for block means.
    rows, t = np.concatenate(groups), samples.t
    count = np.array([len(group) for group in groups])
    place = np.repeat(np.arange(len(groups)), count)

    def mean(signal: Array) -> Array:
        sums = np.zeros((len(groups), *signal.shape[1:]))
        np.add.at(sums, place, signal[rows])
        return sums / count.reshape(-1, *[1] * (signal.ndim - 1))

    used = np.zeros(len(t), dtype=bool)
    used[rows] = True
    # Upward force of the hanging load, its inertial force included.
    gaining = acceleration(samples, over)
    hangs = _hangs(trace, load, surely)
    pull = hangs[:, None] * (UP + gaining / trace.gravity)
    # Signals less the torque that moves the arm's links.
    motion = observed.own_motion(samples, used, over)
    net = smoothed_with_rate(observed.signals, t, over)[0] - motion
    middle = np.array([group[len(group) // 2] for group in groups])
    grasp = [max([g for g in load.grasps if g <= time], default=-np.inf) for time in t[middle]]
    q = mean(samples.q)
    # One column for each rest: 1 in the blocks that overlap it.
    resting: list[Mask] = []
    for rest in runs(at_rest(samples)):
        here = np.zeros(len(t))
        here[rest] = 1.0
        resting.append(mean(here) > 0.0)
    # Torques of the load by its first moment and inertia, as the hand accelerates and turns.
    maps, mean_pull = observed.maps(q), mean(pull)
    turn, change = (mean(one) for one in smoothed_with_rate(samples.twist[:, 3:], t, over))
    tool = rotations(samples.pose_world_tcp[middle, 3:])
    unit = wrenches_of_load(tool, mean_pull, turn, change)[:, :, 1:]
    unit[:, :3, :3] /= trace.gravity
    unit[:, :, 3:] *= mean(hangs.astype(float))[:, None, None]
    return Blocks(
        rows=count.astype(float),
        t=mean(t),
        q=q,
        dq=mean(samples.dq),
        path=mean(joint_travel(samples)),
        observed=mean(net),
        moved=mean(motion),
        maps=maps,
        acceleration=mean(gaining),
        pull=mean_pull,
        held=maps @ unit,
        grasp=np.array(grasp),
        dahl=mean(slip_states(samples)),
        resting=np.array(resting, dtype=float).reshape(-1, len(groups)).T,
    )


@once
def joint_travel(samples: Samples) -> Array:
    """Compute the path length (n, m), rad, of each joint in both directions, beyond encoder noise."""
    rate = smoothed_with_rate(samples.dq, samples.t, SPEED_SMOOTH)[0]
    return np.cumsum(np.abs(rate) * np.gradient(samples.t)[:, None], axis=0)


def free_rows(trace: Trace, name: str, surely: bool = False) -> list[Rows]:
    """List the rows of each block of free motion, around the time in which `name` hangs on the hand.

    The hand is empty or holds `name`. Empty where the load never hung free.

    Args:
        surely: only motion that certainly is free: high, near the places of the load, and settled.
    """
    load, samples = load_rows(trace, name), trace.samples
    hangs, t = _hangs(trace, load, surely), samples.t
    if not hangs.any():
        return []
    used = hangs | (load.empty & rows_in_free_air(trace))
    # Leave out swings of some mrad: gear ripple and friction differ there from all other motion.
    for one in trace.recordings:
        if one.context.activity == "swinging":
            used &= (t < one.start) | (t > one.end)
    # The window counts free motion only, so that contact between lift and return does not shorten it.
    free = np.cumsum(used * np.gradient(t))
    first, last = free[hangs][0] - WHOLE_AROUND, free[hangs][-1] + WHOLE_AROUND
    used &= (first <= free) & (free <= last)
    # Block length for at most `WHOLE_MOST` blocks.
    length = max(WHOLE_BLOCK, float(np.ptp(free[used])) / WHOLE_MOST)
    if surely:
        # Keep rows near the box of positions in which the load hung.
        position = samples.pose_world_tcp[:, :3]
        low, high = position[hangs].min(axis=0), position[hangs].max(axis=0)
        beyond = np.maximum(np.maximum(low - position, position - high), 0.0)
        used &= np.linalg.norm(beyond, axis=1) < WHOLE_NEAR
        used &= _settled_or_away(samples)
    # Keep the blocks that lie in free motion as a whole.
    place = ((t - t[0]) / length).astype(int)
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(place)) + 1)
    return [rows for rows in parts if used[rows].all()]


def _hangs(trace: Trace, load: LoadRows, surely: bool) -> Mask:
    """Return the rows in which the load hangs free."""
    above = CLEARANCE if surely else FREE_ABOVE
    return load.loaded & rows_in_free_air(trace) & rows_above_lift(trace, load, above)


@once
def _settled_or_away(samples: Samples) -> Mask:
    """Return the rows at settled rests, or after the arm has moved away from a rest.

    The residual stiction of a rest builds up as the arm settles and decays as it leaves.
    """
    t, resting = samples.t, at_rest(samples)
    settled = resting.copy()
    for rows in runs(resting):
        settled[rows] &= t[rows] - t[rows.start] > WHOLE_SETTLED
    # Path of all joints since they were last slow.
    speed = np.linalg.norm(smoothed_with_rate(samples.dq, t, FOLLOWED)[0], axis=1)
    slow = speed < WHOLE_SLOW
    gone = np.cumsum(speed * np.gradient(t))
    since = gone - np.maximum.accumulate(np.where(slow, gone, -np.inf))
    return settled | (~slow & (since > WHOLE_SHAKEN))


@once
def rows_in_free_air(trace: Trace) -> Mask:
    """Return the rows in free air.

    The hand is away from every place where a leaf began or ended in contact. No leaf that begins
    and ends in contact runs.
    """
    t, position = trace.samples.t, trace.samples.pose_world_tcp[:, :3]
    found = np.ones(len(t), dtype=bool)
    touched = False
    # Contact before and after each leaf, from the activities of consecutive leaves.
    leaves = sorted(trace.leaves, key=lambda run: run.end)
    for leaf, until in zip(leaves, [*(other.start for other in leaves[1:]), np.inf], strict=True):
        touches = leaf.context is not None and leaf.context.activity in TOUCHING
        rows = slice(*np.searchsorted(t, [leaf.start, max(until, leaf.end)]).tolist())
        if touched and touches:
            found[rows] = False
        elif touched or touches:
            # Contact at one end only: free from `FREE_ABOVE` away from that place.
            place = position[row_at(trace.samples, leaf.start if touched else leaf.end)]
            found[rows] &= np.linalg.norm(position[rows] - place, axis=1) > FREE_ABOVE
        touched = touches
    return found


def rows_above_lift(trace: Trace, load: LoadRows, above: float = FREE_ABOVE) -> Mask:
    """Return the rows in which the hand is `above` m or more over the place where it took the object.

    In a recording of free motion these are all rows in which it holds it.
    """
    if any(conversion.primitive == RECORDED for conversion in trace.conversions):
        return load.loaded
    z = trace.samples.pose_world_tcp[:, 2]
    found = np.zeros(len(z), dtype=bool)
    for rows in runs(load.loaded):
        found[rows] = z[rows] > z[rows.start] + above
    return found
