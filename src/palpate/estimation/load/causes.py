"""Linear causes of joint torque in free air, one unknown each: the load, errors of the link model,
tilt of gravity, and of the sensors and joints zero, friction, gain and residual stiction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.biases import flicker
from palpate.estimation.load.blocks import Blocks
from palpate.estimation.load.chain import Hinge, hinges
from palpate.estimation.load.equations import ScaleHyperprior
from palpate.estimation.load.noise import Noise
from palpate.estimation.load.observation import WrenchObservation, gain_root
from palpate.geometry.pose import Array
from palpate.trace.samples import Trace

LINK, REST, GAIN = "link", "rest", "gain"
"""Prefixes of the names of causes: link model errors, residual stiction of rests, sensor gains."""


class Cause(NamedTuple):
    """Column of a linear model: name, (k, m) torque of m signals per unit of the unknown, N m, and
    prior standard deviation of the unknown."""

    name: str
    torque: Array
    size: float


def of_load(seen: Blocks, pull: Array) -> Iterator[Cause]:
    """Weight of the load, per newton with the force `pull` (k, 3), upward; and in each grasp its lever along
    the axes of the hand."""
    yield Cause("weight", seen.torques(pull), tuning.LOAD_PRIOR)
    for grasp in seen.grasps:
        here = (seen.grasp == grasp)[:, None]
        for axis in range(3):
            lever = seen.tool[:, :, axis] * here
            moment: Array = np.cross(lever, seen.pull).astype(np.float64)
            held = seen.torques(np.einsum("kij,kj->ki", seen.inward, lever))
            yield Cause("lever", seen.turned(moment) + held, tuning.LOAD_PRIOR)


def of_arm(
    trace: Trace, observed: WrenchObservation, seen: Blocks, lifted: Array, borne: Array
) -> list[Cause]:
    """Error causes of the arm itself, where its hand lifts `lifted` (k,) N and the load has the torques
    `borne` (k, m) N m."""
    hand, signals = trace.hand, seen.observed.shape[1]
    weight, links, lean = link_errors(observed, seen.q, trace.gravity)
    found = [Cause(*link) for link in links]
    for axis in range(2):
        pulled = seen.maps[:, :, axis] * lifted[:, None]
        found.append(Cause("lean", lean[axis] + pulled, tuning.TILT))
    # Each joint in its own signal: zero, Dahl friction and its initial state, viscous friction, inertia.
    own_columns = (
        (np.ones_like(seen.observed), tuning.ANY_ZERO),
        (seen.dahl[:, :, 0], tuning.JOINT_LEVEL),
        (seen.dahl[:, :, 1], tuning.JOINT_LEVEL),
        (seen.dq, tuning.JOINT_VISCOUS),
        (seen.moved, tuning.INERTIA_SHARE),
    )
    for own, size in own_columns:
        for joint in range(signals):
            alone = np.zeros_like(seen.observed)
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
    """Slice of the causes whose names begin with `name`."""
    found = [i for i, cause in enumerate(causes) if cause.name.startswith(name)]
    return slice(found[0], found[-1] + 1) if found else slice(0, 0)


def sizes(causes: Sequence[Cause]) -> Array:
    """(p,) prior standard deviations."""
    return np.array([cause.size for cause in causes])


def hyperpriors(causes: Sequence[Cause]) -> tuple[ScaleHyperprior, ...]:
    """Prior scales of the arm's causes that are learned from the recording."""
    even = [1.0 / len(tuning.LEFT_SHARES)] * len(tuning.LEFT_SHARES)
    left = ScaleHyperprior(named(causes, REST), tuning.LEFT_SHARES, even)
    return left, ScaleHyperprior(named(causes, GAIN), *tuning.GAINS_OFF)


def link_errors(
    observed: WrenchObservation, q: Array, gravity: float
) -> tuple[Array, list[tuple[str, Array, float]], Array]:
    """Gravity torques of the arm's links, N m (k, m); effects on them of errors in the mass and the centre of
    what moves with each joint, with name and prior size; and (2, k, m) per radian of tilt of gravity along
    world x or y."""
    assert observed.chain is not None
    joints = hinges(observed.chain, q)
    holds = np.zeros((3, *q.shape))
    errors: list[tuple[str, Array, float]] = []
    for i, joint in enumerate(joints):
        parts = [link for link in observed.chain.links if link.joint == i]
        mass = sum(part.mass for part in parts)
        if not mass:
            continue
        com = sum((part.mass * np.array(part.com) for part in parts), np.zeros(3)) / mass
        centre = joint.frame @ com + joint.origin
        borne = gravity * torques_of_force(joints[: i + 1], q.shape, observed.turn, centre)
        holds += mass * borne
        errors.append((f"{LINK} mass at joint {i + 1}", borne[2], tuning.LINK_MASS * mass))
        for axis, letter in enumerate("xyz"):
            # A shift of the centre along this axis of the link.
            moved = np.zeros(q.shape)
            for j, before in enumerate(joints[: i + 1]):
                lever = np.cross(before.axis, joint.frame[:, :, axis])
                moved[:, j] = lever @ observed.turn[2]
            name = f"{LINK} centre along {letter} at joint {i + 1}"
            errors.append((name, mass * gravity * moved, tuning.LINK_CENTRE))
    return holds[2], errors, holds[:2]


def torques_of_force(
    before: Sequence[Hinge], shape: tuple[int, ...], turn: Array, place: Array
) -> Array:
    """(3, k, m) torques of the joints `before` a place (k, 3) per newton there along each world axis; `turn`:
    axes of the base in the world."""
    torque = np.zeros((3, *shape))
    for j, joint in enumerate(before):
        torque[:, :, j] = turn @ np.cross(joint.axis, place - joint.anchor).T
    return torque


def whitened(causes: Sequence[Cause], seen: Blocks, noise: Noise) -> tuple[Array, Array]:
    """Whitened design (m k, p) and observation (m k,), joint by joint, in rows of unit variance."""
    columns = np.array([cause.torque for cause in causes])
    between = np.abs(seen.t[:, None] - seen.t)
    drift = tuning.DRIFT**2 * np.exp(-between / tuning.DRIFT_TIME) * tuning.TORQUE_LEVER**2
    slow = flicker(between)
    design: list[Array] = []
    found: list[Array] = []
    for joint, observed in enumerate(seen.observed.T):
        own = noise.white[joint] / seen.rows + (tuning.UNSTEADY_SHARE * seen.moved[:, joint]) ** 2
        covariance: Array = drift + noise.flicker[joint] * slow + np.diag(own + tuning.FLOOR**2)
        root: Array = np.linalg.cholesky(covariance).astype(np.float64)
        rows = np.column_stack([columns[:, :, joint].T, observed])
        white: Array = np.linalg.solve(root, rows).astype(np.float64)
        design.append(white[:, :-1])
        found.append(white[:, -1])
    return np.concatenate(design), np.concatenate(found)
