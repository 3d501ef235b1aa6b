"""A load from all that an arm did in free air around its weighing, not from passes along one path.

Away from the path of a lift there is nothing to compare with place by place. But what the joints feel
there is made by few causes, each linear in unknown numbers: what the load weighs and where it hangs,
masses and centres of the arm's links that are not quite what they are said to be, zeros and gains of
the sensors, friction (Dahl's, and what grows with the speed), what rests leave, and how gravity leans.
All are fitted together by generalised least squares. It tells more, and holds only where that is all there is:
its residuals have to be no more than the noise (`Whole.explains`), else the contrast along the path stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.gains import gain_root
from palpate.estimation.load.biases import flicker
from palpate.estimation.load.equations import Model, Unsure
from palpate.estimation.load.feeling import Feeling, feeling
from palpate.estimation.load.free import apart, lifted
from palpate.estimation.load.hinges import Hinge, hinges
from palpate.estimation.load.noise import Noise
from palpate.estimation.load.rubbing import rubbing
from palpate.estimation.windows import Load, Mask, acceleration, at_rest, gained, load_of, runs
from palpate.geometry.pose import Array, rotations
from palpate.trace.samples import Samples, Trace

UP = np.array([0.0, 0.0, 1.0])
LINK, REST, GAIN = "link", "rest", "gain"
"""How names of causes begin: errors of the arm's links, what rests leave, and what the sensors' gains are off
by."""

Rows = NDArray[np.intp]
"""Of a trace's samples."""


class Cause(NamedTuple):
    """What is in proportion to one unknown: its name, (k, m) N m that a unit of it makes of m signals, and its
    standard deviation beforehand."""

    name: str
    torque: Array
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A load from a whole stretch of a trace, which in n grasps hung on the hand.

    Attributes:
        grasps: s, when the hand had closed on it.
        value: (1 + 3n,) what it pulls down with, N, and where it hangs in each grasp times that, N m
            along the hand's axes.
        covariance: (1 + 3n, 1 + 3n) of it.
        gains: (1 + 3n, m) what one standard deviation of each cause of the sensors' gains makes of it.
        links: (1 + 3n,) what one of each error of the arm's links makes of it, by its name.
        misfit: mean square of what is left, in units of the noise.
    """

    grasps: tuple[float, ...]
    value: Array
    covariance: Array
    gains: Array
    links: Mapping[str, Array]
    misfit: float

    @property
    def force(self) -> float:
        """N."""
        return float(self.value[0])

    @property
    def std(self) -> float:
        """N, of the force."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def explains(self) -> bool:
        """Whether the noise accounts for what is left."""
        return self.misfit < tuning.WHOLE_MISFIT

    def at(self, grasps: Sequence[float], tools: Sequence[Array]) -> Array | None:
        """(1 + 2n, 1 + 3n) what makes force and moments as `estimation.load.fit.Load` has them of `value`,
        in n grasps, s, with the hand's axes in the world (3, 3); None where it did not hang free in one."""
        if not set(grasps) <= set(self.grasps):
            return None
        turned = np.zeros((1 + 2 * len(grasps), len(self.value)))
        turned[0, 0] = 1.0
        for i, (grasp, tool) in enumerate(zip(grasps, tools, strict=True)):
            first = 1 + 3 * self.grasps.index(grasp)
            turned[1 + 2 * i, first : first + 3] = tool[1]
            turned[2 + 2 * i, first : first + 3] = -tool[0]
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Means over stretches of time in which nothing moves far.

    Attributes:
        rows: (k,) samples in each.
        t: (k,) s.
        q, dq: (k, m) rad, rad/s.
        felt: (k, m) N m less what moves the arm's links.
        moved: (k, m) N m of that.
        maps: (k, m, 6) as `Feeling.maps`.
        tool: (k, 3, 3) the hand's axes in the world.
        acceleration: (k, 3) m/s² of the TCP.
        pull: (k, 3) what the load pulls with where it hangs, in units of its weight, upward.
        grasp: (k,) s, of the load.
        rubbed: (k, m, 2) as `estimation.load.rubbing`.
        resting: (k, rests) 1 where the arm is at a rest.
    """

    rows: Array
    t: Array
    q: Array
    dq: Array
    felt: Array
    moved: Array
    maps: Array
    tool: Array
    acceleration: Array
    pull: Array
    grasp: Array
    rubbed: Array
    resting: Array

    def torques(self, force: Array) -> Array:
        """(k, m) N m of forces (k, 3) N at the TCP."""
        return np.einsum("kji,ki->kj", self.maps[:, :, :3], force)

    def turned(self, moment: Array) -> Array:
        """(k, m) N m of moments (k, 3) N m."""
        return np.einsum("kji,ki->kj", self.maps[:, :, 3:], moment)


def fit_whole(trace: Trace, name: str, noise: Noise, about_force: float) -> Whole | None:
    """What `name` was with all the time that it hung on the hand, near `about_force` N; None where the
    arm's links are not known, or it never hung free.

    Of all free motion, if the noise accounts for what is left there; else of what is surely free: so high
    that what hangs askew has left its support with its far end, too, close to where it hung, and settled at
    rests or well away from them.
    """
    felt = feeling(trace)
    if felt.chain is None or not felt.knows_links:
        return None
    found: Whole | None = None
    for surely in (False, True):
        free = free_rows(trace, name, surely)
        if free:
            found = _fitted(
                trace, felt, blocks(trace, felt, name, free, surely), noise, about_force
            )
        if found is None or found.explains:
            break
    return found


def _fitted(trace: Trace, felt: Feeling, seen: Blocks, noise: Noise, about_force: float) -> Whole:
    load = list(of_load(seen, seen.pull))
    hangs = np.array([cause.torque for cause in load])
    about = np.zeros(len(load))
    about[0] = about_force
    # What gains do is in proportion to the moments, too, which are not known at first.
    model, _ = _model(trace, felt, seen, noise, load, about[0], np.tensordot(about, hangs, 1))
    about = model.solve(len(about))[0][: len(about)]
    model, causes = _model(trace, felt, seen, noise, load, about[0], np.tensordot(about, hangs, 1))
    mean, covariance = model.solve(len(about))
    left = model.y - model.design @ mean
    effects = -covariance / model.prior
    of_links: dict[str, Array] = {}
    for cause, effect in zip(causes, effects.T, strict=True):
        if cause.name.startswith(LINK):
            of_links[cause.name] = effect
    misfit = float(left @ left) / len(left)
    value, square = mean[: len(about)], covariance[:, : len(about)]
    gains = effects[:, named(causes, GAIN)]
    return Whole(tuple(_grasps(seen)), value, square, gains, of_links, misfit)


def _model(
    trace: Trace,
    felt: Feeling,
    seen: Blocks,
    noise: Noise,
    load: Sequence[Cause],
    about_force: float,
    borne: Array,
) -> tuple[Model, Sequence[Cause]]:
    """All causes, of signals whose noise is known, where a load is about `about_force` N and makes `borne`
    (k, m) N m."""
    causes = [*load, *of_arm(trace, felt, seen, about_force * seen.pull[:, 2], borne)]
    design, y = whitened(causes, seen, noise)
    return Model(design, y, sizes(causes), noise.freedom, unsure(causes)), causes


def free_rows(trace: Trace, name: str, surely: bool = False) -> list[Rows]:
    """Rows of each block of free motion, or of what is surely that, in which the hand is empty or `name` hangs on
    it, around the time that it does; none where it never hung free."""
    load, samples = load_of(trace, name), trace.samples
    hangs, t = _hangs(trace, load, surely), samples.t
    if not hangs.any():
        return []
    first, last = t[hangs][0] - tuning.WHOLE_AROUND, t[hangs][-1] + tuning.WHOLE_AROUND
    used = (hangs | (load.empty & apart(trace))) & (first <= t) & (t <= last)
    if surely:
        used &= _about(samples, hangs) & (_settled(samples) | _shaken(samples))
    length = max(tuning.WHOLE_BLOCK, float(min(last, t[-1]) - max(first, t[0])) / tuning.WHOLE_MOST)
    place = ((t - t[0]) / length).astype(int)
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(place)) + 1)
    return [rows for rows in parts if used[rows].all()]


def _hangs(trace: Trace, load: Load, surely: bool) -> Mask:
    above = tuning.CLEARANCE if surely else tuning.FREE_ABOVE
    return load.loaded & apart(trace) & lifted(trace, load, above)


def blocks(
    trace: Trace, felt: Feeling, name: str, groups: Sequence[Rows], surely: bool = False
) -> Blocks:
    """Of the rows of each group, in which at most `name` is held."""
    samples, load = trace.samples, load_of(trace, name)
    rows, t = np.concatenate(groups), samples.t
    count = np.array([len(group) for group in groups])
    place = np.repeat(np.arange(len(groups)), count)

    def mean(signal: Array) -> Array:
        sums = np.zeros((len(groups), *signal.shape[1:]))
        np.add.at(sums, place, signal[rows])
        return sums / count.reshape(-1, *[1] * (signal.ndim - 1))

    used = np.zeros(len(t), dtype=bool)
    used[rows] = True
    gaining = acceleration(samples, tuning.SPEED_SHORT)
    pull = _hangs(trace, load, surely)[:, None] * (UP + gaining / trace.gravity)
    motion = felt.own_motion(samples, used)
    net = gained(felt.signals, t, tuning.SPEED_SHORT)[0] - motion
    middle = np.array([group[len(group) // 2] for group in groups])
    grasp = [max([g for g in load.grasps if g <= time], default=-np.inf) for time in t[middle]]
    q = mean(samples.q)
    resting = [mean(rest) > 0.0 for rest in _rests(at_rest(samples))]
    return Blocks(
        count.astype(float),
        mean(t),
        q,
        mean(samples.dq),
        mean(net),
        mean(motion),
        felt.maps(q),
        rotations(samples.pose_world_tcp[middle, 3:]),
        mean(gaining),
        mean(pull),
        np.array(grasp),
        mean(rubbing(samples.q)),
        np.array(resting, dtype=float).reshape(-1, len(groups)).T,
    )


def _about(samples: Samples, hangs: Mask) -> Mask:
    """Rows in which the hand is about where a load hung on it."""
    position = samples.pose_world_tcp[:, :3]
    low, high = position[hangs].min(axis=0), position[hangs].max(axis=0)
    beyond = np.maximum(np.maximum(low - position, position - high), 0.0)
    return np.linalg.norm(beyond, axis=1) < tuning.WHOLE_NEAR


def _settled(samples: Samples) -> Mask:
    """Rows at rests, but for their beginnings."""
    found = at_rest(samples).copy()
    for rows in runs(at_rest(samples)):
        found[rows] &= samples.t[rows] - samples.t[rows.start] > tuning.WHOLE_SETTLED
    return found


def _shaken(samples: Samples) -> Mask:
    """Rows in which the arm has moved away from where it stood: as it comes to a rest and leaves it, what the
    rest leaves in its joints comes and goes."""
    t = samples.t
    speed = np.linalg.norm(gained(samples.dq, t, tuning.SPEED_SHORT)[0], axis=1)
    slow = speed < tuning.WHOLE_SLOW
    gone = np.cumsum(speed * np.gradient(t))
    since = gone - np.maximum.accumulate(np.where(slow, gone, -np.inf))
    return ~slow & (since > tuning.WHOLE_SHAKEN)


def _rests(still: Mask) -> Iterator[Array]:
    """(n,) 1 in each rest."""
    for rest in runs(still):
        rows = np.zeros(len(still))
        rows[rest] = 1.0
        yield rows


def of_load(seen: Blocks, pull: Array) -> Iterator[Cause]:
    """A newton of weight, which pulls with `pull` (k, 3), upward; and of where it hangs in each grasp along the
    hand's axes."""
    yield Cause("weight", seen.torques(pull), tuning.LOAD_PRIOR)
    for grasp in _grasps(seen):
        here = (seen.grasp == grasp)[:, None]
        for axis in range(3):
            moment = np.cross(seen.tool[:, :, axis] * here, seen.pull)
            yield Cause("lever", seen.turned(moment), tuning.LOAD_PRIOR)


def _grasps(seen: Blocks) -> list[float]:
    """s, when the hand had closed on what hung on it."""
    found: list[float] = seen.grasp[seen.pull[:, 2] > 0.0].tolist()
    return sorted(set(found))


def of_arm(trace: Trace, felt: Feeling, seen: Blocks, lifted: Array, borne: Array) -> list[Cause]:
    """All that the arm itself may be off by, where its hand lifts (k,) N and what acts on that makes `borne`
    (k, m) N m."""
    hand, signals = trace.hand, seen.felt.shape[1]
    weight, links, lean = _links(felt, seen.q, trace.gravity)
    found = [Cause(*link) for link in links]
    for axis in range(2):
        pulled = seen.maps[:, :, axis] * lifted[:, None]
        found.append(Cause("lean", lean[axis] + pulled, tuning.TILT))
    for own, size in _of_joints(seen):
        for joint in range(signals):
            alone = np.zeros_like(seen.felt)
            alone[:, joint] = own[:, joint]
            found.append(Cause("joint", alone, size))
    for rest in seen.resting.T:
        for axis in range(3):
            left = rest[:, None] * seen.maps[:, :, axis]
            found.append(Cause(REST, left, hand.force_repeatability + tuning.FLOOR))
    shown = weight - weight[0] + borne
    found += [Cause(GAIN, shown * cause, 1.0) for cause in gain_root(hand, signals).T]
    return found


def named(causes: Sequence[Cause], name: str) -> slice:
    """Which causes have names that begin so."""
    found = [i for i, cause in enumerate(causes) if cause.name.startswith(name)]
    return slice(found[0], found[-1] + 1) if found else slice(0, 0)


def sizes(causes: Sequence[Cause]) -> Array:
    """(p,) standard deviations beforehand."""
    return np.array([cause.size for cause in causes])


def unsure(causes: Sequence[Cause]) -> tuple[Unsure, ...]:
    """What of those of the arm is learned from the recordings."""
    even = [1.0 / len(tuning.LEFT_SHARES)] * len(tuning.LEFT_SHARES)
    left = Unsure(named(causes, REST), tuning.LEFT_SHARES, even)
    return left, Unsure(named(causes, GAIN), *tuning.GAINS_OFF)


def _of_joints(seen: Blocks) -> list[tuple[Array, float]]:
    """What each joint makes in its own signal: (k, m) N m of a unit, and how large it may be."""
    return [
        (np.ones_like(seen.felt), tuning.ANY_ZERO),
        (seen.rubbed[:, :, 0], tuning.JOINT_LEVEL),
        (seen.rubbed[:, :, 1], tuning.JOINT_LEVEL),
        (seen.dq, tuning.JOINT_VISCOUS),
        (seen.moved, tuning.INERTIA_SHARE),
    ]


def _links(
    felt: Feeling, q: Array, gravity: float
) -> tuple[Array, list[tuple[str, Array, float]], Array]:
    """N m (k, m) that hold up the arm's links; what errors of what moves with each joint add to that,
    with the name and size of each; and (2, k, m) what a radian adds by which gravity leans along world x or y."""
    assert felt.chain is not None
    joints = hinges(felt.chain, q)
    holds = np.zeros((3, *q.shape))
    errors: list[tuple[str, Array, float]] = []
    for i, joint in enumerate(joints):
        parts = [link for link in felt.chain.links if link.joint == i]
        mass = sum(part.mass for part in parts)
        if not mass:
            continue
        com = sum((part.mass * np.array(part.com) for part in parts), np.zeros(3)) / mass
        centre = joint.frame @ com + joint.origin
        borne = gravity * _borne(joints[: i + 1], q.shape, felt.turn, centre)
        holds += mass * borne
        errors.append((f"{LINK} mass at joint {i + 1}", borne[2], tuning.LINK_MASS * mass))
        for axis, letter in enumerate("xyz"):
            moved = _turned(joints[: i + 1], q.shape, felt.turn, joint.frame[:, :, axis])
            name = f"{LINK} centre along {letter} at joint {i + 1}"
            errors.append((name, mass * gravity * moved, tuning.LINK_CENTRE))
    return holds[2], errors, holds[:2]


def _borne(before: Sequence[Hinge], shape: tuple[int, ...], turn: Array, place: Array) -> Array:
    """(3, k, m) what a newton along each of the world's axes at a place (k, 3) takes in the joints before
    it; `turn`: the base's axes in the world."""
    torque = np.zeros((3, *shape))
    for j, joint in enumerate(before):
        torque[:, :, j] = turn @ np.cross(joint.axis, place - joint.anchor).T
    return torque


def _turned(before: Sequence[Hinge], shape: tuple[int, ...], turn: Array, lever: Array) -> Array:
    """(k, m) what a newton upward takes more in them where it lies farther along a lever (k, 3)."""
    torque = np.zeros(shape)
    for j, joint in enumerate(before):
        torque[:, j] = np.cross(joint.axis, lever) @ turn[2]
    return torque


def whitened(causes: Sequence[Cause], seen: Blocks, noise: Noise) -> tuple[Array, Array]:
    """What the causes make (m k, p), and what was felt, joint by joint in rows of unit variance."""
    columns = np.array([cause.torque for cause in causes])
    between = np.abs(seen.t[:, None] - seen.t)
    drift = tuning.DRIFT**2 * np.exp(-between / tuning.DRIFT_TIME) * tuning.TORQUE_LEVER**2
    slow = flicker(between)
    design: list[Array] = []
    found: list[Array] = []
    for joint, felt in enumerate(seen.felt.T):
        own = noise.white[joint] / seen.rows + (tuning.UNSTEADY_SHARE * seen.moved[:, joint]) ** 2
        covariance: Array = drift + noise.flicker[joint] * slow + np.diag(own + tuning.FLOOR**2)
        root: Array = np.linalg.cholesky(covariance).astype(np.float64)
        rows = np.column_stack([columns[:, :, joint].T, felt])
        white: Array = np.linalg.solve(root, rows).astype(np.float64)
        design.append(white[:, :-1])
        found.append(white[:, -1])
    return np.concatenate(design), np.concatenate(found)
