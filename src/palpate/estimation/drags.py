"""Drags of a held object along its support, row by row.

While the hand drags the object, the sensed wrench contains the tangential and the normal force. The support
relieves the hand of the normal force: N = (f_z with the object in the air) - f_z. The object sticks, breaks
away, and slides. `friction_fit` fits all drags together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import ColouredResidual
from palpate.estimation.joint_causes import learn_arm_residual
from palpate.estimation.joint_friction import FLOOR, SMOOTH, joint_friction, joint_ways
from palpate.estimation.load_blocks import joint_travel, rows_in_free_air
from palpate.estimation.load_noise import UNKNOWN_NOISE, SignalLevels, block_noise, load_rows
from palpate.estimation.motion import (
    SPEED_SMOOTH,
    Mask,
    acceleration,
    at_rest,
    row_at,
    runs,
    smooth_rows,
    steady,
)
from palpate.estimation.segments import PAUSE
from palpate.estimation.wrench_observation import WrenchObservation
from palpate.trace.samples import Samples, Trace

BLOCK = 0.1
"""s. Samples of a drag are averaged over blocks of this length before their scatter is computed, so that correlated
noise is counted. Sensitive: friction 0.07 σ, std ×1.0–1.1."""
DRAG_SPEED = 0.002
"""m/s, commanded horizontal speed above which a row belongs to a drag. Sensitive: no."""
SETS_OUT = 0.0005
"""m/s, commanded horizontal speed above which a resting hand starts to move. Sensitive: no."""
DRAG_SLOPE = 0.3
"""Largest ratio of vertical to horizontal speed in a drag. Sensitive: friction 0.7 σ, std ×0.6–1.0."""
DRAG_ROWS = 20
"""Rows. A drag must have more, so that it has a beginning and a later half. Sensitive: no."""
STEADY_ROWS = 10
"""Rows. Smallest count of steady sliding in an accepted drag. Sensitive: no."""
CRUISE = 0.95
"""Fraction of the median commanded speed above which the motion has its full speed. Sensitive: friction 1.5 σ, std
×1.0–2.0."""
SLOWING = 0.02
"""s. The motion must stay at full speed this long: jerk-limited deceleration begins before the speed shows it.
Sensitive: friction 0.2 σ."""
LATE = 0.5
"""Fraction of a drag after which its force quotient is taken as the sliding level. Sensitive: friction 1.7 σ, std
×0.9–1.0."""
SLIDING = 0.85
"""Fraction of the sliding force quotient above which the object may slide. Below it, the object turns in the fingers'
grip. Sensitive: friction 0.8 σ, std ×1.0–1.9; `static` 2.6 σ."""
FOLLOWING = 0.7
"""Fraction of the commanded speed above which the hand follows. A slower object may have stuck again. Sensitive: no."""
PEAK_WITHIN = 0.3
"""s. The breakaway is sought this long after the quotient reaches `SLIDING`. Sensitive: friction 1.7 σ, std
×0.9–1.7."""
TRANSIENT = 0.25
"""s after breakaway during which the elastic coupling of arm and object oscillates. Sensitive: friction 2.7 σ, std
×0.8–1.3."""
PARTED = 0.05
"""s after breakaway from which the fit to all joints uses the rows, steady or not: it separates friction from the
inertia of the arm's links. Sensitive: 0.02 to 0.25 s change a friction by 0.2 σ, its std by ×1.0–1.05."""
DOWN = 0.006
"""m. Largest height of the hand above the grasp while the object is on its support. Sensitive: no."""
HANGING = 0.02
"""m. Smallest height of the hand above the grasp at which the object hangs free. Sensitive: no."""
HORIZONTAL_MASS = 6.0
"""kg. Horizontal apparent mass of a 7-axis arm at its TCP. It gives the inertial part of the force at breakaway.
Sensitive: friction 0.6 σ; `static` 1.5 σ."""
NORMAL_MIN = 0.5
"""N. Normal force below which the force quotient carries no information. Sensitive: no."""
HORIZONTAL_SPREAD = 4.0
"""kg (1 sigma) of `HORIZONTAL_MASS`. Towards and away from its base, an arm seems to have twice its sideways mass.
Sensitive: `static` hardly."""
STILL_SLIDING = 0.4
"""Fraction of the usual speed above which a decelerating object certainly slides. Sensitive: `static` hardly."""
STRAINING = 0.1
"""s. A drag includes the rows this long before the motion: a preloaded grip breaks away at once. Sensitive: no."""
ROUGH = 10.0
"""Ratio of the sliding noise to its expected value from which a drag counts as chatter. Sensitive: no."""
NEARLY_ROUGH = 2.5
"""Ratio of the sliding noise to its expected value above which only steady rows of a drag count. Few drags without
chatter exceed it. Sensitive: friction no from 1.5 to 3. Without it, a drag that nearly chattered gave a friction 0.08
(5 standard deviations) too low. With it, the result was 0.20, against a stated 0.21."""
SMOOTH_NOISE = 0.03
"""N² per row. Ripple of gears and encoders in motion adds this noise to that at rest: 0.04 N in means of 0.1 s.
Sensitive: no."""
SLOW = 0.08
"""m/s. Below this speed the arm's own motion adds little to its torques. Sensitive: friction 0.3 σ, std ×0.9–1.2."""


@dataclass(frozen=True, slots=True, eq=False)
class Hanging:
    """Reference state of a drag: the object hanging in free air."""

    force: Array  # (3,) N
    q: Array  # (7,) rad
    turned: Array  # (7,) mean direction (-1 to 1) of the last motion of each joint
    friction: Array  # (7,) N m in each joint, from free motions
    unsure: Array  # (7,) N m, standard deviation of `friction`
    noise: SignalLevels  # noise of each signal, at rest or in slow motion through free air
    # Residual of the arm model with an empty hand; None where none was recorded, and for a six-axis sensor.
    left: ColouredResidual | None


@dataclass(frozen=True, eq=False)
class Drag:
    """Time series of one drag of the object along its support, with n rows.

    t: (n,) s.
    way: (2,) unit vector along the drag, world.
    place: (n, 2) m, position of the hand, world.
    tangential, normal: (n,) N, along the drag and on the support, without the inertial forces of the arm's
        links and the object.
    inertial: (n,) N, inertial part that was subtracted from the tangential force.
    acceleration: (n,) m/s², along the drag.
    speed: (n,) m/s, commanded.
    q: (n, 7) rad.
    torque: (n, 7) N m, without the gravity of the arm.
    turned: (n, 7) direction of the last motion of each joint, -1 or 1; between them during a reversal.
    path: (n, 7) rad, travel of each joint.
    cruising: (n,) the motion is commanded at its full speed.
    moving: (n,) the hand follows the command.
    begins: row at which the command starts to move; before it, the object rests on its support.
    mass: kg, of the object.
    unsure_mass: kg (1 sigma), error of the apparent mass of the arm that was subtracted.
    quiet: N², `noise` of the force along the drag, and of the vertical force, while the object hangs at
        rest.
    hanging: reference state.
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
    path: Array
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
        """Number of rows over which forces are averaged."""
        return max(1, round(SMOOTH / self.period))

    @cached_property
    def quotient(self) -> Array:
        """(n,) tangential over normal force, smoothed; 0 where the normal force is below `NORMAL_MIN`."""
        tangential = smooth_rows(self.tangential, self._smooth)
        normal = smooth_rows(self.normal, self._smooth)
        pressed = normal > NORMAL_MIN
        return np.where(pressed, tangential / np.maximum(normal, NORMAL_MIN), 0.0)

    @cached_property
    def breakaway(self) -> int | None:
        """Row at which the object begins to slide; None if it never does."""
        # Sliding level: the median quotient in the later part of the drag at full speed.
        start, end = self.t[self.begins], self.t[-1]
        late = self.cruising & (self.t > start + LATE * (end - start))
        if not late.any():
            return None
        # First row near that level: the breakaway lies at most `PEAK_WITHIN` later.
        enough = SLIDING * np.median(self.quotient[late])
        strained = np.flatnonzero(self.quotient[self.begins :] >= enough)
        if not len(strained):
            return None
        # The quotient rises while the object sticks and falls to the sliding level at breakaway. The steepest
        # fall marks it; the largest value does not, as joint friction drifts along the path.
        start = self.t[self.begins + int(strained[0])]
        window = (self.t >= start) & (self.t <= start + PEAK_WITHIN)
        later = np.minimum(np.arange(len(self.t)) + self._smooth, len(self.t) - 1)
        falls = self.quotient - self.quotient[later]
        return int(np.argmax(np.where(window, falls, -np.inf)))

    @cached_property
    def swung_out(self) -> Mask:
        """Rows after the transient of the breakaway that are at full commanded speed, now and `SLOWING` later."""
        if self.breakaway is None:
            return np.zeros(len(self.t), dtype=bool)
        # Deceleration appears in the force before it appears in the speed.
        ahead = np.searchsorted(self.t, self.t + SLOWING, side="right") - 1
        on = self.cruising & self.cruising[ahead] & (ahead > np.arange(len(self.t)))
        return on & (self.t > self.t[self.breakaway] + TRANSIENT)

    @cached_property
    def steady(self) -> Mask:
        """Rows of steady sliding under sufficient normal force."""
        return self.swung_out & self.moving & (self.normal > NORMAL_MIN)

    @property
    def blocks(self) -> list[NDArray[np.intp]]:
        """Rows of each block of steady sliding."""
        return self._split(self.steady)

    @property
    def slid(self) -> list[NDArray[np.intp]]:
        """Rows of each block of sliding, also below full speed."""
        if self.breakaway is None or self.roughness > NEARLY_ROUGH:
            # A drag close to chatter may stick again before it slides steadily.
            return self.blocks
        # All rows shortly after breakaway in which the hand follows, and the steady rows.
        parted = self.t > self.t[self.breakaway] + PARTED
        parted &= self.moving & (np.arange(len(self.t)) >= self.follows)
        return self._split(self.steady | (parted & (self.normal > NORMAL_MIN)))

    def _split(self, rows: Mask) -> list[NDArray[np.intp]]:
        """Split rows into parts of about `BLOCK` s."""
        found, size = np.flatnonzero(rows), max(1, round(BLOCK / self.period))
        return np.array_split(found, max(1, len(found) // size))

    @cached_property
    def pressing(self) -> tuple[Array, float]:
        """Normal force shrunk towards its trend (n,), N, and its remaining variance in a block, N².

        Noise in the regressor would bias the friction low. The remedy is regression calibration: Carroll,
        Ruppert, Stefanski, Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 4.
        """
        # Deviation of each block mean from a straight line through all blocks of the drag.
        blocks = self.blocks
        if len(blocks) <= 2:
            return self.normal, 0.0
        means = np.array([self.normal[block].mean() for block in blocks])
        off = remove_trend(means)
        # Noise of a block mean: the sensor noise at rest, at most the white noise between neighbouring rows.
        white = float(np.diff(self.normal[self.steady]).var()) / 2.0
        noise = min(self.quiet[1], white) * len(blocks) / sum(map(len, blocks))
        scatter = float(off @ off) / (len(blocks) - 2)
        # Reliability ratio: fraction of the scatter that noise does not explain. Deviations shrink to it.
        real = max(0.0, 1.0 - noise / max(scatter, FLOOR**2))
        normal = self.normal.copy()
        for block, stray in zip(blocks, off.tolist(), strict=True):
            normal[block] -= (1.0 - real) * stray
        return normal, real * noise

    @property
    def slowing(self) -> slice:
        """Rows after steady sliding in which the hand decelerates and the object certainly still slides."""
        # Speed after the last steady row, integrated from the acceleration.
        first = int(np.flatnonzero(self.steady)[-1]) + 1
        usual = float(np.median(self.speed[self.steady]))
        speed = usual + np.cumsum(self.acceleration[first:]) * self.period
        slides = (speed > STILL_SLIDING * usual) & (self.normal[first:] > NORMAL_MIN)
        # End at the first row in which the object may have stuck.
        return slice(first, first + int(np.argmin(np.append(slides, False))))

    @property
    def follows(self) -> int:
        """First row from which the hand follows over a whole smoothing window, so that the object slides."""
        ahead = np.lib.stride_tricks.sliding_window_view(self.moving[self.begins :], self._smooth)
        on = np.flatnonzero(ahead.all(axis=1))
        return self.begins + int(on[0]) if len(on) else len(self.t)

    def row_variance(self) -> float:
        """Variance of the tangential force in a row of steady sliding, N².

        It is half the variance of the differences of neighbouring rows."""
        return float(np.diff(self.tangential[self.steady]).var()) / 2.0

    @cached_property
    def noise(self) -> float:
        """Noise density of steady sliding: n times the variance of the mean of n rows, N²."""
        return noise_density([self.tangential[self.steady]], self.period)

    @property
    def roughness(self) -> float:
        """Ratio of the noise of steady sliding to that of hanging at rest. Stick-slip raises it."""
        return self.noise / (self.quiet[0] + SMOOTH_NOISE)


def noise_density(forces: Iterable[Array], period: float) -> float:
    """Noise density of forces (n,), one array a stretch: n times the variance of the mean of n rows, N².

    The scatter of short means about a line through each block gives it, so that slow changes do not count.
    Returns `UNKNOWN_NOISE` where no stretch is long enough; `period` in s.
    """
    size = max(1, round(SMOOTH / period))
    count = max(4, round(BLOCK / period / size))
    # Pool the squared residuals and the degrees of freedom (two lost to each line) over all blocks.
    pooled, freedom = 0.0, 0
    for force in forces:
        for start in range(0, len(force) - size * count + 1, size * count):
            means = force[start : start + size * count].reshape(count, size).mean(axis=1)
            pooled += size * float(np.sum(remove_trend(means) ** 2))
            freedom += count - 2
    return pooled / freedom if freedom else UNKNOWN_NOISE


def remove_trend(y: Array) -> Array:
    """Residuals of a straight line fitted to `y`."""
    basis = np.vander(np.linspace(-1.0, 1.0, len(y)), 2)
    return y - basis @ (np.linalg.pinv(basis) @ y)


def steady_drags(trace: Trace, name: str, observed: WrenchObservation) -> list[Drag]:
    """Drags of the object `name` with enough steady sliding; drags with chatter only if all have chatter."""
    drags = _drags(trace, name, observed)
    found = [drag for drag in drags if drag.steady.sum() >= STEADY_ROWS]
    return [drag for drag in found if drag.roughness < ROUGH] or found


def _drags(trace: Trace, name: str, observed: WrenchObservation) -> Iterator[Drag]:
    """Yield the drags of the loaded hand, commanded horizontally at the height of the grasp."""
    samples, load = trace.samples, load_rows(trace, name)
    if not load.grasps:
        return
    # Reference: the object at rest in the air, well above the lowest grasp.
    height = samples.pose_world_tcp[:, 2]
    floor = min(float(height[row_at(samples, time)]) for time in load.grasps)
    high = height > floor + HANGING
    hanging = at_rest(samples) & load.loaded & high
    if not hanging.any():
        return
    # Noise of each signal in free air, at rest or in slow steady motion.
    gaining = acceleration(samples, SPEED_SMOOTH)
    slow = np.linalg.norm(samples.twist[:, :3], axis=1) < SLOW
    calm = high & steady(samples) & slow & (load.loaded | load.empty) & rows_in_free_air(trace)
    noise = block_noise(observed.signals, samples.t, gaining[:, 2], list(runs(calm)))
    # Joint friction and its direction, from motions of the empty hand in free air.
    ways = joint_ways(samples, load.empty, floor + HANGING)
    free = Hanging(
        samples.wrench[hanging, :3].mean(axis=0),
        samples.q[hanging].mean(axis=0),
        ways[hanging].mean(axis=0),
        *joint_friction(samples, ways, load.empty, floor + HANGING),
        noise,
        None if observed.sensed else learn_arm_residual(trace, name),
    )
    # Commanded horizontal velocity: it selects the drags.
    step = np.gradient(samples.target_world_tcp[:, :3], samples.t, axis=0)
    horizontal = np.linalg.norm(step[:, :2], axis=1)
    # Compliant control commands a steep descent to press, so the measured climb decides whether a motion is level.
    size = max(1, round(BLOCK / float(np.median(np.diff(samples.t)))))
    climbing = np.gradient(smooth_rows(samples.pose_world_tcp[:, 2], size), samples.t)
    level = np.abs(climbing) < DRAG_SLOPE * horizontal
    low = height < floor + DOWN
    # Mass of the hanging object: the hand accelerates it along the drag.
    mass = max(0.0, float(free.force[2]) / trace.gravity)
    ended = 0
    for dragged in runs(load.loaded & low & (horizontal > DRAG_SPEED) & level):
        if dragged.stop - dragged.start > DRAG_ROWS:
            # Include the rows before the motion, in which the force rises, but none of the previous drag.
            early = samples.t > samples.t[dragged.start] - STRAINING
            early &= load.loaded & low & (np.arange(len(samples)) >= ended)
            rows = slice(int(np.flatnonzero(early[: dragged.start + 1])[0]), dragged.stop)
            # Count the preceding rows in which the command already moves slowly.
            slowly = horizontal[rows.start : dragged.start] > SETS_OUT
            leading = (
                len(slowly) if slowly.all() else len(slowly) - 1 - int(np.flatnonzero(~slowly)[-1])
            )
            begins = dragged.start - leading - rows.start
            yield _drag(samples, rows, step[:, :2], observed, hanging, ways, free, begins, mass)
        ended = dragged.stop


def central_rate(values: Array, t: Array, rows: slice) -> Array:
    """Rate of change per second (k, n) of values (m, n) in each of `rows`, by central differences.

    A row is the mean over a log period. A difference therefore belongs to the boundary of two rows, and a row
    takes the mean of its two boundaries.
    """
    period = float(np.median(np.diff(t)))
    steps = np.diff(values, axis=0, prepend=values[:1], append=values[-1:]) / period
    rate: Array = ((steps[1:] + steps[:-1]) / 2.0)[rows]
    return rate


def inertial_force(
    samples: Samples, rows: slice, observed: WrenchObservation, mass: float
) -> Array:
    """Inertial force (k, 3), N, world axes, of the arm's links and a held `mass`, kg, in `rows`.

    A compliant arm oscillates for a second after a breakaway. Unknown links count as `HORIZONTAL_MASS` at the TCP.
    """
    # Without a link model, a point mass moves horizontally with the TCP.
    rising = central_rate(samples.twist[:, :3], samples.t, rows)
    if not observed.knows_links:
        return rising * [HORIZONTAL_MASS, HORIZONTAL_MASS, 0.0]
    # With it, inverse dynamics give the joint torques, mapped to a wrench at the TCP.
    q, dq = samples.q[rows], samples.dq[rows]
    torques = observed.links_motion(q, dq, central_rate(samples.dq, samples.t, rows))
    wrenches = observed.wrenches(q) @ torques[:, :, None]
    return wrenches[:, :3, 0] + mass * rising


def _drag(
    samples: Samples,
    rows: slice,
    step: Array,
    observed: WrenchObservation,
    hanging: Mask,
    ways: Array,
    free: Hanging,
    begins: int,
    mass: float,
) -> Drag:
    """Build the drag in `rows`, k of them.

    Args:
        samples: of the whole trace.
        rows: of the drag.
        step: (m, 2) m/s, commanded horizontal velocity.
        hanging: rows of the reference without support.
        ways: (m, 7) direction of the last motion of each joint.
        free: reference state.
        begins: row of the drag at which the command starts to move.
        mass: kg, of the object.
    """
    # Inertial forces of the links and the object.
    moved = inertial_force(samples, rows, observed, mass)
    # Direction of the drag, and the support's force: the change against free air without inertia.
    velocity = step[rows]
    way = velocity.sum(axis=0) / np.linalg.norm(velocity.sum(axis=0))
    force = samples.wrench[rows, :3] - free.force - moved
    commanded = velocity @ way
    # Stretches at rest for the noise, joined across short gaps in which noisy encoders seem to move.
    found = np.flatnonzero(hanging)
    breaks = np.flatnonzero(np.diff(samples.t[found]) > PAUSE) + 1
    still = [samples.wrench[part, :3] for part in np.split(found, breaks)]
    period = float(np.median(np.diff(samples.t)))
    # Project all series on the direction of the drag.
    return Drag(
        samples.t[rows],
        way,
        place=samples.pose_world_tcp[rows, :2],
        tangential=force[:, :2] @ way,
        normal=-force[:, 2],
        inertial=moved[:, :2] @ way,
        acceleration=central_rate(samples.twist[:, :2] @ way, samples.t, rows),
        speed=np.maximum(commanded, DRAG_SPEED),
        q=samples.q[rows],
        torque=samples.tau_ext[rows],
        turned=ways[rows],
        path=joint_travel(samples)[rows],
        cruising=commanded > CRUISE * float(np.median(commanded)),
        moving=samples.twist[rows, :2] @ way > FOLLOWING * commanded,
        begins=begins,
        mass=mass,
        unsure_mass=0.0 if observed.knows_links else HORIZONTAL_SPREAD,
        quiet=(
            noise_density([part[:, :2] @ way for part in still], period),
            noise_density([part[:, 2] for part in still], period),
        ),
        hanging=free,
    )
