"""A load from all that an arm did in free air around its weighing, not from passes along one path.

Away from the path of a lift there is nothing to compare with place by place. But what the joints feel
there is made by few causes, each linear in unknown numbers: what the load weighs and where it hangs,
masses and centres of the arm's links that are not quite what they are said to be, zeros and gains of
the sensors, friction (Dahl's, and what grows with the speed), what rests leave, and how gravity leans.
All are fitted together by generalised least squares. It tells more, and holds only where that is all there is:
its residuals have to be no more than the noise (`Whole.explains`), else the contrast along the path stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
from palpate.estimation.windows import Mask, acceleration, at_rest, gained, load_of, runs
from palpate.geometry.pose import Array, rotations
from palpate.trace.samples import Samples, Trace

UP = np.array([0.0, 0.0, 1.0])
LINK = "link"
"""How names of causes begin that are errors of the arm's links."""


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
class _Blocks:
    """Means over stretches of time in which nothing moves far.

    Attributes:
        rows: (k,) samples in each.
        t: (k,) s.
        q, dq: (k, m) rad, rad/s.
        felt: (k, m) N m less what moves the arm's links.
        moved: (k, m) N m of that.
        maps: (k, m, 6) as `Feeling.maps`.
        tool: (k, 3, 3) the hand's axes in the world.
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
    pull: Array
    grasp: Array
    rubbed: Array
    resting: Array


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
        blocks = _blocks(trace, felt, name, surely)
        if blocks is not None:
            found = _fitted(trace, felt, blocks, noise, about_force)
        if found is None or found.explains:
            break
    return found


def _fitted(
    trace: Trace, felt: Feeling, blocks: _Blocks, noise: Noise, about_force: float
) -> Whole:
    grasps = tuple(sorted(set(blocks.grasp[blocks.pull[:, 2] > 0.0].tolist())))
    about = np.zeros(1 + 3 * len(grasps))
    about[0] = about_force
    # What gains do is in proportion to the moments, too, which are not known at first.
    model, _ = _model(trace, felt, blocks, noise, grasps, about)
    about = model.solve(len(about))[0][: len(about)]
    model, links = _model(trace, felt, blocks, noise, grasps, about)
    mean, covariance = model.solve(len(about))
    left = model.y - model.design @ mean
    effects = -covariance / model.prior
    signals = blocks.felt.shape[1]
    of_links = {name: effects[:, column] for name, column in links.items()}
    misfit = float(left @ left) / len(left)
    value, square = mean[: len(about)], covariance[:, : len(about)]
    return Whole(grasps, value, square, effects[:, -signals:], of_links, misfit)


def _blocks(trace: Trace, felt: Feeling, name: str, surely: bool) -> _Blocks | None:
    """Of free motion, or of what is surely that."""
    samples, load = trace.samples, load_of(trace, name)
    away = apart(trace)
    above = tuning.CLEARANCE if surely else tuning.FREE_ABOVE
    hangs = load.loaded & away & lifted(trace, load, above)
    if not hangs.any():
        return None
    t = samples.t
    first, last = t[hangs][0] - tuning.WHOLE_AROUND, t[hangs][-1] + tuning.WHOLE_AROUND
    used = (hangs | (load.empty & away)) & (first <= t) & (t <= last)
    if surely:
        used &= _about(samples, hangs) & (_settled(samples) | _shaken(samples))
    length = max(tuning.WHOLE_BLOCK, float(min(last, t[-1]) - max(first, t[0])) / tuning.WHOLE_MOST)
    place = ((t - t[0]) / length).astype(int)
    place = np.cumsum(np.diff(place, prepend=place[0]) > 0, dtype=np.intp)
    count = int(place[-1]) + 1
    rows = np.bincount(place, minlength=count).astype(float)

    def mean(signal: Array) -> Array:
        sums = np.zeros((count, *signal.shape[1:]))
        np.add.at(sums, place, signal)
        return sums / rows.reshape(-1, *[1] * (signal.ndim - 1))

    kept = mean(used.astype(float)) > 1.0 - 1e-9
    pull = hangs[:, None] * (UP + acceleration(samples, tuning.SPEED_SHORT) / trace.gravity)
    motion = felt.own_motion(samples, used)
    net = gained(felt.signals, t, tuning.SPEED_SHORT)[0] - motion
    grasp = np.array([max([g for g in load.grasps if g <= time], default=-np.inf) for time in t])
    middle = np.searchsorted(place, np.arange(count)) + (rows // 2).astype(int)
    q = mean(samples.q)
    return _Blocks(
        rows[kept],
        mean(t)[kept],
        q[kept],
        mean(samples.dq)[kept],
        mean(net)[kept],
        mean(motion)[kept],
        felt.maps(q[kept]),
        rotations(samples.pose_world_tcp[middle[kept], 3:]),
        mean(pull)[kept],
        grasp[middle[kept]],
        mean(rubbing(samples.q))[kept],
        _resting(at_rest(samples), place, count)[kept],
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


def _resting(still: Mask, place: NDArray[np.intp], count: int) -> Array:
    """(count, rests) which blocks are of each rest."""
    columns: list[Array] = []
    for rows in runs(still):
        column = np.zeros(count)
        np.add.at(column, place[rows], 1.0)
        columns.append(np.minimum(column, 1.0))
    return np.array(columns).reshape(-1, count).T


def _model(
    trace: Trace,
    felt: Feeling,
    blocks: _Blocks,
    noise: Noise,
    grasps: Sequence[float],
    about: Array,
) -> tuple[Model, Mapping[str, int]]:
    """All causes, of signals whose noise is known, and which of them are errors of the arm's links, by
    their names. `about`: where a load is, as `Whole.value`."""
    hand, gravity, signals = trace.hand, trace.gravity, blocks.felt.shape[1]
    weight, links, lean = _links(felt, blocks.q, gravity)
    columns = _hanging(blocks, grasps)
    prior = [tuning.LOAD_PRIOR] * len(columns)
    borne = np.einsum("p,pkj->kj", about, np.array(columns))
    of_links: dict[str, int] = {}
    for link_error, torque, size in links:
        of_links[link_error] = len(columns)
        columns.append(torque)
        prior.append(size)
    for axis in range(2):
        pulled = about[0] * blocks.maps[:, :, axis] * blocks.pull[:, 2:]
        columns.append(lean[axis] + pulled)
        prior.append(tuning.TILT)
    for own, size in _of_joints(blocks):
        for joint in range(signals):
            alone = np.zeros_like(blocks.felt)
            alone[:, joint] = own[:, joint]
            columns.append(alone)
            prior.append(size)
    first = len(columns)
    for rest in blocks.resting.T:
        for axis in range(3):
            columns.append(rest[:, None] * blocks.maps[:, :, axis])
            prior.append(hand.force_repeatability + tuning.FLOOR)
    left = slice(first, len(columns))
    shown = weight - weight[0] + borne
    for cause in gain_root(hand, signals).T:
        columns.append(shown * cause)
        prior.append(1.0)
    gains = slice(left.stop, len(columns))
    design, y = _whitened(np.array(columns), blocks, noise)
    even = [1.0 / len(tuning.LEFT_SHARES)] * len(tuning.LEFT_SHARES)
    unsure = Unsure(left, tuning.LEFT_SHARES, even), Unsure(gains, *tuning.GAINS_OFF)
    return Model(design, y, np.array(prior), noise.freedom, unsure), of_links


def _hanging(blocks: _Blocks, grasps: Sequence[float]) -> list[Array]:
    """(k, m) N m that each unit of `Whole.value` makes."""
    columns = [np.einsum("kji,ki->kj", blocks.maps[:, :, :3], blocks.pull)]
    for grasp in grasps:
        here = (blocks.grasp == grasp)[:, None]
        for axis in range(3):
            moment = np.cross(blocks.tool[:, :, axis] * here, blocks.pull)
            columns.append(np.einsum("kji,ki->kj", blocks.maps[:, :, 3:], moment))
    return columns


def _of_joints(blocks: _Blocks) -> list[tuple[Array, float]]:
    """What each joint makes in its own signal: (k, m) N m of a unit, and how large it may be."""
    return [
        (np.ones_like(blocks.felt), tuning.ANY_ZERO),
        (blocks.rubbed[:, :, 0], tuning.JOINT_LEVEL),
        (blocks.rubbed[:, :, 1], tuning.JOINT_LEVEL),
        (blocks.dq, tuning.JOINT_VISCOUS),
        (blocks.moved, tuning.INERTIA_SHARE),
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


def _whitened(columns: Array, blocks: _Blocks, noise: Noise) -> tuple[Array, Array]:
    """Columns (p, k, m) and what was felt, in rows of unit variance."""
    between = np.abs(blocks.t[:, None] - blocks.t)
    drift = tuning.DRIFT**2 * np.exp(-between / tuning.DRIFT_TIME) * tuning.TORQUE_LEVER**2
    slow = flicker(between)
    design: list[Array] = []
    found: list[Array] = []
    for joint, felt in enumerate(blocks.felt.T):
        own = (
            noise.white[joint] / blocks.rows + (tuning.UNSTEADY_SHARE * blocks.moved[:, joint]) ** 2
        )
        covariance: Array = drift + noise.flicker[joint] * slow + np.diag(own + tuning.FLOOR**2)
        root: Array = np.linalg.cholesky(covariance).astype(np.float64)
        rows = np.column_stack([columns[:, :, joint].T, felt])
        white: Array = np.linalg.solve(root, rows).astype(np.float64)
        design.append(white[:, :-1])
        found.append(white[:, -1])
    return np.concatenate(design), np.concatenate(found)
