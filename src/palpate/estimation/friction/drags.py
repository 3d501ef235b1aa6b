"""Drags of a held object along its support, row by row.

While the hand drags the object, the sensed wrench holds the tangential force and, as what is
missing from the object's weight, the normal force: N = (f_z with the object in the air) - f_z. The
object sticks, breaks away, and slides; `sliding` fits what the drags have in common.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.joint_friction import TURNED, joint_friction, joint_states
from palpate.estimation.load.noise import Noise, block_noise
from palpate.estimation.load.observation import WrenchObservation
from palpate.estimation.load.segments import LoadRows, load_rows
from palpate.estimation.motion import Mask, acceleration, at_rest, row_at, runs, smoothed
from palpate.geometry.pose import Array
from palpate.trace.samples import Samples, Trace


@dataclass(frozen=True, slots=True, eq=False)
class Hanging:
    """Reference state of a drag: the object hanging in free air.

    Attributes:
        force: (3,) N.
        q: (7,) rad.
        turned: (7,) which way each joint was turned last.
        friction: (7,) N m in each joint, as free motions show it.
        unsure: its standard deviation.
        noise: of each signal, as the arm moves slowly through free air, or rests.
    """

    force: Array
    q: Array
    turned: Array
    friction: Array
    unsure: Array
    noise: Noise


@dataclass(frozen=True, eq=False)
class Drag:
    """Drag of the object along its support, row by row.

    Attributes:
        t: s.
        way: (2,) its direction, world.
        place: (n, 2) m, of the hand, world.
        tangential, normal: N, along the drag and on the support; what moves the arm's links and the
            object is taken off.
        inertial: N, what was taken off of the tangential force.
        acceleration: m/s², along the drag.
        speed: m/s, commanded.
        q: (n, 7) rad.
        torque: (n, 7) N m, beyond the arm's own.
        turned: (n, 7) which way each joint was turned last: -1 to 1, between them as it turns round.
        cruising: the motion is commanded at its full speed.
        moving: the hand follows it.
        begins: row at which the hand is told to set out; before, the object rests on its support.
        mass: kg, of the object.
        unsure_mass: kg (1 sigma), what the arm may have besides what was taken off.
        quiet: N², what `noise` is of the force in this direction while the object hangs at rest, and of
            the vertical force.
        hanging: what it is referred to.
    """

    t: Array
    way: Array
    place: Array
    tangential: Array
    normal: Array
    inertial: Array
    acceleration: Array
    speed: Array
    q: Array
    torque: Array
    turned: Array
    cruising: Mask
    moving: Mask
    begins: int
    mass: float
    unsure_mass: float
    quiet: tuple[float, float]
    hanging: Hanging

    @property
    def period(self) -> float:
        """s between two rows."""
        return float(np.median(np.diff(self.t)))

    @property
    def _smooth(self) -> int:
        """Rows over which forces are averaged."""
        return max(1, round(tuning.SMOOTH / self.period))

    @cached_property
    def quotient(self) -> Array:
        """(n,) tangential over normal force, smoothed."""
        tangential = smoothed(self.tangential, self._smooth)
        normal = smoothed(self.normal, self._smooth)
        pressed = normal > tuning.NORMAL_MIN
        return np.where(pressed, tangential / np.maximum(normal, tuning.NORMAL_MIN), 0.0)

    @cached_property
    def breakaway(self) -> int | None:
        """Row at which the object begins to slide; None when it never does.

        The quotient of forces rises while the object sticks, and falls to the level of sliding as it
        breaks away: where it falls most, since what joints rub drifts along the way.
        """
        if self._strained is None:
            return None
        start = self.t[self._strained]
        window = (self.t >= start) & (self.t <= start + tuning.PEAK_WITHIN)
        later = np.minimum(np.arange(len(self.t)) + self._smooth, len(self.t) - 1)
        falls = self.quotient - self.quotient[later]
        return int(np.argmax(np.where(window, falls, -np.inf)))

    @cached_property
    def _strained(self) -> int | None:
        """The first row in which the object may be sliding; None when it never does."""
        start, end = self.t[self.begins], self.t[-1]
        late = self.cruising & (self.t > start + tuning.LATE * (end - start))
        if not late.any():
            return None
        enough = tuning.SLIDING * np.median(self.quotient[late])
        begun = np.flatnonzero(self.quotient[self.begins :] >= enough)
        return self.begins + int(begun[0]) if len(begun) else None

    @cached_property
    def swung_out(self) -> Mask:
        """Rows after breakaway that are commanded at full speed, now and for a while longer:
        deceleration shows in the force before it shows in the speed."""
        if self.breakaway is None:
            return np.zeros(len(self.t), dtype=bool)
        ahead = np.searchsorted(self.t, self.t + tuning.SLOWING, side="right") - 1
        on = self.cruising & self.cruising[ahead] & (ahead > np.arange(len(self.t)))
        return on & (self.t > self.t[self.breakaway] + tuning.TRANSIENT)

    @cached_property
    def steady(self) -> Mask:
        """Rows of steady sliding."""
        return self.swung_out & self.moving & self._presses

    @property
    def _presses(self) -> Mask:
        """Rows in which there is a quotient of forces."""
        return self.normal > tuning.NORMAL_MIN

    @property
    def _parted(self) -> Mask:
        """Rows in which it has broken away, and the hand follows."""
        if self.breakaway is None:
            return np.zeros(len(self.t), dtype=bool)
        since = self.t > self.t[self.breakaway] + tuning.PARTED
        return since & self.moving & (np.arange(len(self.t)) >= self.follows)

    @property
    def blocks(self) -> list[NDArray[np.intp]]:
        """Rows of each block of steady sliding."""
        return self._split(self.steady)

    @property
    def slid(self) -> list[NDArray[np.intp]]:
        """Rows of each block of sliding, at full speed or not; what nearly chatters may stick before it is steady."""
        if self.roughness > tuning.NEARLY_ROUGH:
            return self.blocks
        return self._split(self.steady | (self._parted & self._presses))

    def _split(self, rows: Mask) -> list[NDArray[np.intp]]:
        """In parts of about `tuning.BLOCK` s."""
        found, size = np.flatnonzero(rows), max(1, round(tuning.BLOCK / self.period))
        return np.array_split(found, max(1, len(found) // size))

    @cached_property
    def pressing(self) -> tuple[Array, float]:
        """Shrunken normal force (n,) N, and its remaining variance in a block, N².

        What blocks scatter about a line is noise as far as sensors at rest have it, and rows differ.
        Friction told from a force with its noise would seem less than it is (regression calibration:
        Carroll, Ruppert, Stefanski, Crainiceanu, Measurement Error in Nonlinear Models, 2006,
        chapter 4).
        """
        blocks = self.blocks
        if len(blocks) <= 2:
            return self.normal, 0.0
        means = np.array([self.normal[block].mean() for block in blocks])
        off = _detrended(means)
        white = float(np.diff(self.normal[self.steady]).var()) / 2.0
        noise = min(self.quiet[1], white) * len(blocks) / sum(map(len, blocks))
        scatter = float(off @ off) / (len(blocks) - 2)
        real = max(0.0, 1.0 - noise / max(scatter, tuning.FLOOR**2))
        normal = self.normal.copy()
        for block, stray in zip(blocks, off.tolist(), strict=True):
            normal[block] -= (1.0 - real) * stray
        return normal, real * noise

    @property
    def slowing(self) -> slice:
        """Rows after those of steady sliding in which the hand slows down and is still fast enough
        for the object to slide."""
        first = int(np.flatnonzero(self.steady)[-1]) + 1
        usual = float(np.median(self.speed[self.steady]))
        speed = usual + np.cumsum(self.acceleration[first:]) * self.period
        slides = (speed > tuning.STILL_SLIDING * usual) & (self.normal[first:] > tuning.NORMAL_MIN)
        # Up to the first row in which it may have stuck.
        return slice(first, first + int(np.argmin(np.append(slides, False))))

    @property
    def follows(self) -> int:
        """The first row from which the hand follows for a while: what it holds slides by then."""
        ahead = np.lib.stride_tricks.sliding_window_view(self.moving[self.begins :], self._smooth)
        on = np.flatnonzero(ahead.all(axis=1))
        return self.begins + int(on[0]) if len(on) else len(self.t)

    def row_variance(self) -> float:
        """N², of the tangential force in a row of steady sliding: half of that from row to row."""
        return float(np.diff(self.tangential[self.steady]).var()) / 2.0

    @cached_property
    def noise(self) -> float:
        """N², variance that the mean of n steady rows has, times n."""
        return _density([self.tangential[self.steady]], self.period)

    @property
    def roughness(self) -> float:
        """Noise of steady sliding over that of hanging at rest; stick-slip raises it."""
        return self.noise / (self.quiet[0] + tuning.SMOOTH_NOISE)


def _density(forces: Iterable[Array], period: float) -> float:
    """N², variance that the mean of n rows has, times n: from the scatter of short means about a
    line through each block, so that nothing slower counts."""
    size = max(1, round(tuning.SMOOTH / period))
    count = max(4, round(tuning.BLOCK / period / size))
    pooled, freedom = 0.0, 0
    for force in forces:
        for start in range(0, len(force) - size * count + 1, size * count):
            means = force[start : start + size * count].reshape(count, size).mean(axis=1)
            pooled += size * float(np.sum(_detrended(means) ** 2))
            freedom += count - 2
    return pooled / freedom if freedom else tuning.UNKNOWN_NOISE


def _detrended(y: Array) -> Array:
    """Residuals of a straight line fitted to `y`."""
    basis = np.vander(np.linspace(-1.0, 1.0, len(y)), 2)
    return y - basis @ (np.linalg.pinv(basis) @ y)


def steady_drags(trace: Trace, name: str, observed: WrenchObservation) -> list[Drag]:
    """Drags of the object `name` in which it slid steadily for long enough; those in which it
    chatters only where it does in all."""
    drags = _drags(trace, load_rows(trace, name), observed)
    found = [drag for drag in drags if drag.steady.sum() >= tuning.STEADY_ROWS]
    return [drag for drag in found if drag.roughness < tuning.ROUGH] or found


def _drags(trace: Trace, load: LoadRows, observed: WrenchObservation) -> Iterator[Drag]:
    """Drags of the loaded hand, commanded horizontally at the height of the grasp."""
    samples = trace.samples
    if not load.grasps:
        return
    floor = min(_height_at(samples, time) for time in load.grasps)
    hanging = _at_rest(samples, load, floor)
    if not hanging.any():
        return
    ways = joint_states(samples)[:, :, TURNED]
    free = Hanging(
        samples.wrench[hanging, :3].mean(axis=0),
        samples.q[hanging].mean(axis=0),
        ways[hanging].mean(axis=0),
        *joint_friction(samples, ways, load.empty, floor + tuning.HANGING),
        _noise(samples, observed, load, floor),
    )
    step = np.gradient(samples.target_world_tcp[:, :3], samples.t, axis=0)
    horizontal = np.linalg.norm(step[:, :2], axis=1)
    # Soft springs are lowered steeply to press; what counts is how level the hand itself goes.
    level = np.abs(_climbing(samples)) < tuning.DRAG_SLOPE * horizontal
    low = samples.pose_world_tcp[:, 2] < floor + tuning.DOWN
    mass = max(0.0, float(free.force[2]) / trace.gravity)
    ended = 0
    for told in runs(load.loaded & low & (horizontal > tuning.DRAG_SPEED) & level):
        if told.stop - told.start > tuning.DRAG_ROWS:
            rows = slice(_since(samples.t, told.start, load.loaded & low, ended), told.stop)
            moved = _moved(samples, rows, observed, mass)
            drag = _drag(samples, rows, step[:, :2], moved, hanging, ways, free)
            begins = told.start - _leading(horizontal[rows.start : told.start] > tuning.SETS_OUT)
            drag = replace(drag, begins=begins - rows.start, mass=mass)
            yield (
                drag
                if observed.knows_links
                else replace(drag, unsure_mass=tuning.HORIZONTAL_SPREAD)
            )
        ended = told.stop


def _leading(told: Mask) -> int:
    """Number of rows at the end of a mask that are True."""
    return len(told) - 1 - int(np.flatnonzero(~told)[-1]) if not told.all() else len(told)


def _since(t: Array, first: int, held: Mask, ended: int) -> int:
    """First row of a drag that is commanded from row `first`: some time earlier, to show the force
    rise before breakaway, unless the drag before `ended` too late."""
    before = (t > t[first] - tuning.STRAINING) & held & (np.arange(len(t)) >= ended)
    return int(np.flatnonzero(before[: first + 1])[0])


def _climbing(samples: Samples) -> Array:
    """(n,) m/s upwards, measured."""
    size = max(1, round(tuning.BLOCK / float(np.median(np.diff(samples.t)))))
    return np.gradient(smoothed(samples.pose_world_tcp[:, 2], size), samples.t)


def _noise(samples: Samples, observed: WrenchObservation, load: LoadRows, floor: float) -> Noise:
    """Of each signal, as the arm moves slowly through free air, or rests."""
    high = samples.pose_world_tcp[:, 2] > floor + tuning.HANGING
    gaining = acceleration(samples, tuning.SPEED_SMOOTH)
    even = np.linalg.norm(gaining, axis=1) < tuning.STEADY
    slow = np.linalg.norm(samples.twist[:, :3], axis=1) < tuning.SLOW
    calm = high & even & slow & (load.loaded | load.empty)
    return block_noise(observed.signals, samples.t, gaining[:, 2], list(runs(calm)))


def _height_at(samples: Samples, time: float) -> float:
    return float(samples.pose_world_tcp[row_at(samples, time), 2])


def _at_rest(samples: Samples, load: LoadRows, floor: float) -> Mask:
    """Rows in which the object hangs free: what is sensed with nothing tangential and no support."""
    high = samples.pose_world_tcp[:, 2] > floor + tuning.HANGING
    return at_rest(samples) & load.loaded & high


def _stretches(t: Array, rows: Mask) -> list[NDArray[np.intp]]:
    """Rows that follow each other, but for short gaps: at rest, noisy encoders seem to move."""
    found = np.flatnonzero(rows)
    return np.split(found, np.flatnonzero(np.diff(t[found]) > tuning.PAUSE) + 1)


def _gained(values: Array, t: Array, rows: slice) -> Array:
    """(k, n) that values (m, n) gain a second in each of `rows`.

    A row is the mean over a log period: what is gained from one to the next belongs to the boundary
    between them, and to a row the mean of both its boundaries.
    """
    period = float(np.median(np.diff(t)))
    steps = np.diff(values, axis=0, prepend=values[:1], append=values[-1:]) / period
    gained: Array = ((steps[1:] + steps[:-1]) / 2.0)[rows]
    return gained


def _moved(samples: Samples, rows: slice, observed: WrenchObservation, mass: float) -> Array:
    """(k, 3) N, world axes, that moving the arm's own links and a held `mass`, kg, takes in `rows`.

    An arm on soft springs sways for a second after a breakaway. Links of which nothing is known are
    `HORIZONTAL_MASS` at the TCP.
    """
    rising = _gained(samples.twist[:, :3], samples.t, rows)
    if not observed.knows_links:
        return rising * [tuning.HORIZONTAL_MASS, tuning.HORIZONTAL_MASS, 0.0]
    q, dq = samples.q[rows], samples.dq[rows]
    torques = observed.links_motion(q, dq, _gained(samples.dq, samples.t, rows))
    wrenches: Array = np.linalg.pinv(observed.maps(q)) @ torques[:, :, None]
    return wrenches[:, :3, 0] + mass * rising


def _drag(
    samples: Samples,
    rows: slice,
    step: Array,
    moved: Array,
    hanging: Mask,
    ways: Array,
    free: Hanging,
) -> Drag:
    """The drag in `rows`; `step` is the commanded horizontal velocity, `moved` (k, 3) the force that
    was needed to move the arm and what it holds, `hanging` where the force is that without support,
    `ways` which way the joints were turned last."""
    velocity = step[rows]
    way = velocity.sum(axis=0) / np.linalg.norm(velocity.sum(axis=0))
    force = samples.wrench[rows, :3] - free.force - moved
    commanded = velocity @ way
    still = [samples.wrench[part, :3] for part in _stretches(samples.t, hanging)]
    period = float(np.median(np.diff(samples.t)))
    return Drag(
        samples.t[rows],
        way,
        samples.pose_world_tcp[rows, :2],
        force[:, :2] @ way,
        -force[:, 2],
        moved[:, :2] @ way,
        _gained(samples.twist[:, :2] @ way, samples.t, rows),
        np.maximum(commanded, tuning.DRAG_SPEED),
        samples.q[rows],
        samples.tau_ext[rows],
        ways[rows],
        commanded > tuning.CRUISE * float(np.median(commanded)),
        samples.twist[rows, :2] @ way > tuning.FOLLOWING * commanded,
        0,
        0.0,
        0.0,
        (
            _density([part[:, :2] @ way for part in still], period),
            _density([part[:, 2] for part in still], period),
        ),
        free,
    )
