"""Block means of the joint signals in free air, around a weighing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, rotations
from palpate.estimation.coloured_residual import Spans
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
from palpate.estimation.rigid_bodies import wrench_columns
from palpate.estimation.wrench_observation import FOLLOWED, WrenchObservation
from palpate.trace.recording import RECORDED
from palpate.trace.samples import Samples, Trace, once

CLEARANCE = 0.015
"""m of the path above the grasp left out: there the support may still carry part of the object. Sensitive: mass 0.7
σ, std ×0.9–1.1; com 0.2 σ, std ×0.8–1.4."""
WHOLE_BLOCK = 0.1
"""s of a block of a whole run: white noise averages out and nothing moves far. Sensitive: no."""
WHOLE_MOST = 400
"""such blocks at most; longer runs have longer ones. Sensitive: no."""
WHOLE_AROUND = 15.0
"""s before and after an object hung on the hand, in which motions of the empty hand are used. Sensitive: mass 0.1 σ."""
WHOLE_SLOW = 0.02
"""rad/s of all joints together: slower than that, an arm is about to rest. Sensitive: no."""
WHOLE_SHAKEN = 0.01
"""rad, likewise, after which residual stiction of a rest and reversing friction have decayed: five times
`PRESLIDING`. Sensitive: mass 0.1 σ."""
WHOLE_SETTLED = 0.3
"""s after which the residual stiction of an approach has built up. Sensitive: no; without it rests leave a misfit
where they stick."""
WHOLE_NEAR = 0.03
"""m from the place of a load, within which motions of the empty hand certainly count: on its way home, in a turn of
all joints, a model of the arm is off by some mN m. Sensitive: mass 0.3–0.6 σ at 0.1 to 0.2, to one side."""
FREE_ABOVE = 5e-3
"""m above the grasp, from which an object is in free air. Sensitive: no."""

TOUCHING = ("contact", "sliding")

UP = np.array([0.0, 0.0, 1.0])

Rows = NDArray[np.intp]
"""Of a trace's samples."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Blocks:
    """Means of k blocks of time, each so short that nothing moves far.

    Attributes:
        rows: (k,) samples in each.
        t: (k,) s.
        q, dq: (k, m) rad, rad/s.
        path: (k, m) rad that each joint has turned, to and fro alike.
        observed: (k, m) N m, without the torque that moves the arm's links.
        moved: (k, m) N m, that torque.
        maps: (k, m, 6) as `WrenchObservation.maps`.
        tool: (k, 3, 3) the hand's axes in the world.
        acceleration: (k, 3) m/s² of the TCP.
        pull: (k, 3) force of the load in units of its weight, upward; 0 where it does not hang.
        swung: (k, 3, 3) part of that per metre of lever beside the TCP, as the hand turns.
        turning: (k, 3, 6) moment in the world, N m, per kg m² of an inertia in the axes of the hand, xx yy zz xy
            xz yz, as it turns; 0 where the load does not hang.
        grasp: (k,) s, of the load.
        dahl: (k, m, 2 e) as `estimation.joint_friction.slip_states`.
        resting: (k, rests) 1 where the arm is at a rest.
    """

    rows: Array
    t: Array
    q: Array
    dq: Array
    path: Array
    observed: Array
    moved: Array
    maps: Array
    tool: Array
    acceleration: Array
    pull: Array
    swung: Array
    turning: Array
    grasp: Array
    dahl: Array
    resting: Array

    def torques(self, force: Array) -> Array:
        """(k, m) N m of forces (k, 3) N at the TCP."""
        return np.einsum("kji,ki->kj", self.maps[:, :, :3], force)

    def turned(self, moment: Array) -> Array:
        """(k, m) N m of moments (k, 3) N m."""
        return np.einsum("kji,ki->kj", self.maps[:, :, 3:], moment)

    @property
    def spans(self) -> Spans:
        """Stretches of which the blocks are means."""
        lasts = np.full(len(self.t), float(np.median(np.diff(self.t))) + FOLLOWED)
        return Spans(self.t, lasts, self.path, np.abs(self.dq) * lasts[:, None])

    @property
    def grasps(self) -> tuple[float, ...]:
        """s, when the hand had closed on what hung on it."""
        found: list[float] = self.grasp[self.pull[:, 2] > 0.0].tolist()
        return tuple(sorted(set(found)))


def blocks(
    trace: Trace,
    observed: WrenchObservation,
    name: str,
    groups: Sequence[Rows],
    surely: bool = False,
) -> Blocks:
    """Block means over the rows of each group, in which the hand is empty or holds `name`, of signals smoothed
    over `FOLLOWED`."""
    samples, load, over = trace.samples, load_rows(trace, name), FOLLOWED
    rows, t = np.concatenate(groups), samples.t
    count = np.array([len(group) for group in groups])
    place = np.repeat(np.arange(len(groups)), count)

    def mean(signal: Array) -> Array:
        sums = np.zeros((len(groups), *signal.shape[1:]))
        np.add.at(sums, place, signal[rows])
        return sums / count.reshape(-1, *[1] * (signal.ndim - 1))

    used = np.zeros(len(t), dtype=bool)
    used[rows] = True
    gaining = acceleration(samples, over)
    hangs = _hangs(trace, load, surely)
    pull = hangs[:, None] * (UP + gaining / trace.gravity)
    motion = observed.own_motion(samples, used, over)
    net = smoothed_with_rate(observed.signals, t, over)[0] - motion
    middle = np.array([group[len(group) // 2] for group in groups])
    grasp = [max([g for g in load.grasps if g <= time], default=-np.inf) for time in t[middle]]
    q = mean(samples.q)
    resting: list[Mask] = []
    for rest in runs(at_rest(samples)):
        here = np.zeros(len(t))
        here[rest] = 1.0
        resting.append(mean(here) > 0.0)
    turn, change = smoothed_with_rate(samples.twist[:, 3:], t, over)
    rate, spin = mean(turn), mean(change)
    swung = np.einsum("ki,kj->kij", rate, rate) - (rate**2).sum(axis=1)[:, None, None] * np.eye(3)
    swung = swung + np.cross(spin[:, None, :], np.eye(3)).swapaxes(1, 2)
    tool = rotations(samples.pose_world_tcp[middle, 3:])
    own = (np.einsum("kji,kj->ki", tool, one) for one in (np.zeros_like(rate), rate, spin))
    turning = tool @ wrench_columns(*own)[:, 3:, 4:]
    return Blocks(
        rows=count.astype(float),
        t=mean(t),
        q=q,
        dq=mean(samples.dq),
        path=mean(joint_travel(samples)),
        observed=mean(net),
        moved=mean(motion),
        maps=observed.maps(q),
        tool=tool,
        acceleration=mean(gaining),
        pull=mean(pull),
        swung=swung / trace.gravity,
        turning=mean(hangs.astype(float))[:, None, None] * turning,
        grasp=np.array(grasp),
        dahl=mean(slip_states(samples)),
        resting=np.array(resting, dtype=float).reshape(-1, len(groups)).T,
    )


@once
def joint_travel(samples: Samples) -> Array:
    """(n, m) rad that each joint has turned, to and fro alike, beyond the noise of its encoder."""
    rate = smoothed_with_rate(samples.dq, samples.t, SPEED_SMOOTH)[0]
    return np.cumsum(np.abs(rate) * np.gradient(samples.t)[:, None], axis=0)


def free_rows(trace: Trace, name: str, surely: bool = False) -> list[Rows]:
    """Rows of each block of free motion in which the hand is empty or `name` hangs on it, around the time that
    it hangs; `surely`: only motion that certainly is free; none where it never hung free."""
    load, samples = load_rows(trace, name), trace.samples
    hangs, t = _hangs(trace, load, surely), samples.t
    if not hangs.any():
        return []
    used = hangs | (load.empty & rows_in_free_air(trace))
    # Ripple and friction of the gears differ in swings of some mrad from those in all other motion.
    for one in trace.recordings:
        if one.context.activity == "swinging":
            used &= (t < one.start) | (t > one.end)
    # The window counts free motion alone: contact between lift and return takes nothing from the evidence.
    free = np.cumsum(used * np.gradient(t))
    first, last = free[hangs][0] - WHOLE_AROUND, free[hangs][-1] + WHOLE_AROUND
    used &= (first <= free) & (free <= last)
    length = max(WHOLE_BLOCK, float(np.ptp(free[used])) / WHOLE_MOST)
    if surely:
        # Near the places where the load hung.
        position = samples.pose_world_tcp[:, :3]
        low, high = position[hangs].min(axis=0), position[hangs].max(axis=0)
        beyond = np.maximum(np.maximum(low - position, position - high), 0.0)
        used &= np.linalg.norm(beyond, axis=1) < WHOLE_NEAR
        used &= _settled_or_away(samples)
    place = ((t - t[0]) / length).astype(int)
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(place)) + 1)
    return [rows for rows in parts if used[rows].all()]


def _hangs(trace: Trace, load: LoadRows, surely: bool) -> Mask:
    above = CLEARANCE if surely else FREE_ABOVE
    return load.loaded & rows_in_free_air(trace) & rows_above_lift(trace, load, above)


@once
def _settled_or_away(samples: Samples) -> Mask:
    """Rows at rests without their beginnings, or after the arm has moved away from a rest: the residual
    stiction of a rest builds up as the arm settles and decays as it leaves."""
    t, resting = samples.t, at_rest(samples)
    settled = resting.copy()
    for rows in runs(resting):
        settled[rows] &= t[rows] - t[rows.start] > WHOLE_SETTLED
    speed = np.linalg.norm(smoothed_with_rate(samples.dq, t, FOLLOWED)[0], axis=1)
    slow = speed < WHOLE_SLOW
    gone = np.cumsum(speed * np.gradient(t))
    since = gone - np.maximum.accumulate(np.where(slow, gone, -np.inf))
    return settled | (~slow & (since > WHOLE_SHAKEN))


@once
def rows_in_free_air(trace: Trace) -> Mask:
    """Rows in free air: the hand is away from the place where a leaf began or ended in contact, and no leaf
    that begins and ends in contact runs."""
    t, position = trace.samples.t, trace.samples.pose_world_tcp[:, :3]
    found = np.ones(len(t), dtype=bool)
    touched = False
    leaves = sorted(trace.leaves, key=lambda run: run.end)
    for leaf, until in zip(leaves, [*(other.start for other in leaves[1:]), np.inf], strict=True):
        touches = leaf.context is not None and leaf.context.activity in TOUCHING
        rows = slice(*np.searchsorted(t, [leaf.start, max(until, leaf.end)]).tolist())
        if touched and touches:
            found[rows] = False
        elif touched or touches:
            place = position[row_at(trace.samples, leaf.start if touched else leaf.end)]
            found[rows] &= np.linalg.norm(position[rows] - place, axis=1) > FREE_ABOVE
        touched = touches
    return found


def rows_above_lift(trace: Trace, load: LoadRows, above: float = FREE_ABOVE) -> Mask:
    """Rows in which the hand is `above` m or more over the place where it took the object; in a recording of
    free motion, all in which it holds it."""
    if any(conversion.primitive == RECORDED for conversion in trace.conversions):
        return load.loaded
    z = trace.samples.pose_world_tcp[:, 2]
    found = np.zeros(len(z), dtype=bool)
    for rows in runs(load.loaded):
        found[rows] = z[rows] > z[rows.start] + above
    return found
