"""Causes of joint torque in free air: the load, errors of the link model, tilt of gravity, and of the sensors
and joints zero, friction, gain and residual stiction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.coloured import Residual, learned
from palpate.estimation.load.blocks import Blocks, apart, blocks, free_rows
from palpate.estimation.load.chain import link_parameters, regressor
from palpate.estimation.load.in_hand import load_rows
from palpate.estimation.load.noise import Noise, block_noise, flicker
from palpate.estimation.load.observation import (
    CROSSTALK,
    GAIN,
    WrenchObservation,
    crosstalk,
    gain_root,
    observe,
)
from palpate.estimation.motion import acceleration, at_rest, runs
from palpate.estimation.regression import Cause, Scale, SignalNoise
from palpate.geometry.pose import Array
from palpate.trace.samples import Trace, once

WEIGHT, LEVER, LINK, INERTIA, REST = "weight", "lever", "link", "inertia", "rest"
SLIPS = "joint friction over another way"
"""Names of causes, or their beginnings: of the load, errors of the model of the links and of what moves them,
residual stiction of rests."""


def by_signal(torque: Array) -> Array:
    """(m k, ...) rows ordered by signal, of torques (k, m, ...)."""
    return torque.swapaxes(0, 1).reshape(-1, *torque.shape[2:])


def cause(name: str, columns: Sequence[Array], prior: float) -> Cause:
    """Cause with unknowns of one prior deviation, each with its torques (k, m)."""
    return Cause(
        name, np.column_stack([by_signal(one) for one in columns]), np.full(len(columns), prior)
    )


def of_load(seen: Blocks, pull: Array) -> Iterator[Cause]:
    """Weight of the load, per newton with the force `pull` (k, 3), upward; and in each grasp its lever along
    the axes of the hand."""
    yield cause(WEIGHT, [seen.torques(pull)], tuning.LOAD_PRIOR)
    for i, grasp in enumerate(seen.grasps):
        here = (seen.grasp == grasp)[:, None]
        columns: list[Array] = []
        for axis in range(3):
            lever = seen.tool[:, :, axis] * here
            moment: Array = np.cross(lever, seen.pull).astype(np.float64)
            held = seen.torques(np.einsum("kij,kj->ki", seen.swung, lever))
            columns.append(seen.turned(moment) + held)
        yield cause(f"{LEVER} {i + 1}", columns, tuning.LOAD_PRIOR)


def of_turning(seen: Blocks) -> Cause:
    """Inertia of the load about the TCP, in the axes of the hand."""
    columns = [seen.turned(moment) for moment in seen.turning.transpose(2, 0, 1)]
    return cause("inertia of the load", columns, tuning.LOAD_INERTIA)


def of_arm(
    trace: Trace, observed: WrenchObservation, seen: Blocks, lifted: Array, borne: Array
) -> Iterator[Cause]:
    """Error causes of the arm itself, where its hand lifts `lifted` (k,) N and the load has the torques
    `borne` (m k,) N m."""
    hand, signals = trace.hand, int(seen.observed.shape[1])
    weight, links, lean = link_errors(seen, observed, trace.gravity)
    yield from links
    pulled = seen.maps[:, :, :2] * lifted[:, None, None]
    yield cause("lean", [*(lean + pulled.transpose(2, 0, 1))], tuning.TILT)
    # Each joint in its own signal.
    usual = tuning.SLIPS.index(tuning.PRESLIDING)
    slips = seen.dahl.reshape(*seen.dahl.shape[:2], -1, 2)
    others = np.delete(slips, usual, axis=2).reshape(len(slips), signals, -1)
    of_joints: tuple[tuple[str, Array, float], ...] = (
        ("zero", np.ones_like(seen.observed)[:, :, None], tuning.ANY_ZERO),
        ("joint friction", slips[:, :, usual], tuning.JOINT_LEVEL),
        (SLIPS, others, tuning.JOINT_LEVEL),
        ("viscous friction", seen.dq[:, :, None], tuning.JOINT_VISCOUS),
        (INERTIA, seen.moved[:, :, None], tuning.INERTIA_SHARE),
    )
    for name, own, prior in of_joints:
        columns = [one * joint for one in own.transpose(2, 0, 1) for joint in np.eye(signals)]
        yield cause(name, columns, prior)
    # Of all rests of the trace, those of these blocks: hundreds of unknowns would take cubed time for nothing.
    here = [rest[:, None, None] * seen.maps[:, :, :3] for rest in seen.resting.T if rest.any()]
    rests = [rest[:, :, axis] for rest in here for axis in range(3)]
    if rests:
        yield cause(REST, rests, hand.force_repeatability + tuning.FLOOR)
    shown = by_signal(weight - weight[0]) + borne
    gains = shown[:, None] * np.repeat(gain_root(hand, signals), len(seen.t), axis=0)
    labels = tuple(f"gain of joint {i + 1}" for i in range(signals))
    yield Cause(GAIN, gains, np.ones(signals), "arm", labels)
    # Of the load alone: the weight of the links, read so, is as an error in their masses.
    read = crosstalk(hand, borne.reshape(signals, -1).T)
    each = [read * joint for joint in np.eye(signals)]
    labels = tuple(f"cross-talk in joint {i + 1}" for i in range(signals))
    yield replace(cause(CROSSTALK, each, 1.0), of="arm", labels=labels)


def scales(causes: Sequence[Cause]) -> list[Scale]:
    """Prior scales of the arm's causes that are learned from the recording."""
    found = [
        Scale((GAIN,), *tuning.GAINS_OFF),
        Scale((INERTIA,), *tuning.INERTIA_OFF),
        Scale((SLIPS,), *tuning.SLIPS_OTHERWISE),
    ]
    if any(one.name == REST for one in causes):
        even = [1.0 / len(tuning.LEFT_SHARES)] * len(tuning.LEFT_SHARES)
        found.append(Scale((REST,), tuning.LEFT_SHARES, even))
    return found


@once
def link_errors(
    seen: Blocks, observed: WrenchObservation, gravity: float
) -> tuple[Array, list[Cause], Array]:
    """Gravity torques of the arm's links, N m (k, m); effects on them of errors in the mass and the centre of
    what moves with each joint; and (2, k, m) per radian of tilt of gravity along world x or y."""
    chain, q = observed.chain, seen.q
    still = np.zeros((3 * len(q), q.shape[1]))
    assert chain is not None
    # Torques of a unit of mass and first moment of each link, for gravity along each axis of the world.
    pulls = np.repeat(-gravity * observed.turn, len(q), axis=0)
    columns = regressor(chain, np.tile(q, (3, 1)), still, still, pulls)[..., :4]
    held = columns.reshape(3, len(q), *columns.shape[1:])
    holds = np.zeros((3, *q.shape))
    errors: list[Cause] = []
    for i in range(len(chain.axes)):
        mass, *moment = link_parameters(chain, i)[:4].tolist()
        if not mass:
            continue
        holds += [each[:, :, i] @ [mass, *moment] for each in held]
        # A mass at the centre, and a shift of the centre along each axis of the link.
        units = np.column_stack([[1.0, *np.array(moment) / mass], mass * np.eye(4)[:, 1:]])
        prior = np.array([tuning.LINK_MASS * mass, *[tuning.LINK_CENTRE] * 3])
        kinds = ("mass", *(f"centre along {letter}" for letter in "xyz"))
        labels = tuple(f"{LINK} {kind} at joint {i + 1}" for kind in kinds)
        shown = by_signal(held[2][:, :, i] @ units)
        errors.append(Cause(f"{LINK} at joint {i + 1}", shown, prior, "arm", labels))
    return holds[2], errors, holds[:2]


@once
def of_empty_hand(trace: Trace, name: str) -> Residual | None:
    """Coloured residual that the model of the arm leaves where its hand is empty, around the time in which it holds
    `name`: no force on a load is in it. None where links are unknown or hardly any such motion was recorded."""
    observed, load = observe(trace), load_rows(trace, name)
    free = free_rows(trace, name) if observed.knows_links else []
    empty = [rows for rows in free if load.empty[rows].all()]
    if len(empty) < tuning.EMPTY_BLOCKS:
        return None
    seen, samples = blocks(trace, observed, name, empty), trace.samples
    windows = list(runs(at_rest(samples) & load.empty & apart(trace)))
    rising = acceleration(samples, tuning.FOLLOWED)[:, 2]
    noise = free_noise(seen, block_noise(observed.signals, samples.t, rising, windows))
    y = by_signal(seen.observed)
    causes = list(of_arm(trace, observed, seen, np.zeros(len(seen.t)), np.zeros(len(y))))
    return learned(causes, noise, y, seen.spans)


def free_noise(seen: Blocks, noise: Noise) -> SignalNoise:
    """Noise of block means: white and 1/f noise, drift, and what moving the links leaves."""
    between = np.abs(seen.t[:, None] - seen.t)
    drift = tuning.DRIFT**2 * np.exp(-between / tuning.DRIFT_TIME) * tuning.TORQUE_LEVER**2
    slow = flicker(between)
    roots: list[Array] = []
    # White noise in means over blocks of means over `FOLLOWED`: neighbours share some of it.
    length = float(np.median(np.diff(seen.t)))
    overlap = min(tuning.FOLLOWED / max(length, tuning.FOLLOWED), 1.0)
    shared = np.where(between < 1.5 * length, overlap / 6.0, 0.0)
    np.fill_diagonal(shared, 1.0 - overlap / 3.0)
    shared = shared / np.sqrt(np.outer(seen.rows, seen.rows))
    for joint, moved in enumerate(seen.moved.T):
        own = np.diag((tuning.UNSTEADY_SHARE * moved) ** 2 + tuning.FLOOR**2)
        covariance: Array = drift + noise.flicker[joint] * slow + noise.white[joint] * shared + own
        roots.append(np.linalg.cholesky(covariance).astype(np.float64))
    return SignalNoise(roots, noise.freedom)
