"""Library of the causes of joint torque, and the fit of block means to them.

Each cause has a name, columns (torques of a unit of each unknown in the given rows) and prior deviations. Some prior
scales are learned from the recording (`arm_scales`). `regression` solves for all unknowns together.

    cause                          load, free motion   drags   drags alone   rests and passes   handles
    weight, lever, inertia                 x              x                       x
    links, tilt of gravity                 x              x                   tilt only
    zeros, drift, 1/f noise                x              x          x            x               zeros
    gains                                  x              x          x            x                 x
    cross-talk                             x              x                       x
    friction of the joints                 x              x          x            x                 x
    residual stiction of rests             x              x                       x
    coloured residual (ripple, cables)     x              x          x            x                 x

The estimators are `load_fit` (all free motion around a load; rests and passes), `friction_fit` (drags with the free
motion around them; drags alone) and `fixture_fit` (handles). They select causes and give the rows. Recordings of an arm
that moves all the time are fitted in the frequency domain, with the causes of `arm_fit`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import ColouredResidual, learn_residual, with_residual
from palpate.estimation.evidence import once
from palpate.estimation.joint_friction import FLOOR, JOINT_LEVEL, PRESLIDING, SLIP_ANGLES
from palpate.estimation.load_blocks import Blocks, blocks, free_rows, rows_in_free_air
from palpate.estimation.load_noise import SignalLevels, block_noise, flicker, load_rows
from palpate.estimation.motion import acceleration, at_rest, runs
from palpate.estimation.regression import Cause, Posterior, PriorScale, Projected, SignalNoise, fit
from palpate.estimation.rigid_bodies import link_parameters, regressor
from palpate.estimation.wrench_observation import (
    CROSSTALK,
    FOLLOWED,
    GAIN,
    TORQUE_LEVER,
    WrenchObservation,
    crosstalk,
    gain_root,
    observe,
)
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Trace

DRIFT = 0.033
"""N (1 sigma): drift of the sensors' zero; 0.01 N m in a joint. No published figure: about 0.2
permille of the range of a large joint's strain gauges. Sensitive: mass 0.3 σ, std ×1.0–1.1."""
DRIFT_TIME = 300.0
"""s: correlation time of that drift. No published figure. Sensitive: mass 0.15 σ."""
INERTIA_SHARE = 0.05
"""fraction (1 sigma): error of the torques that move the arm's links. Identified models are some per cent off (Gaz et
al., see `joint_friction.JOINT_LEVEL`). Sensitive: mass 0.2 σ where signals wander, else none."""
INERTIA_OFF = ((1.0, 10.0), (0.9, 0.1))
"""factors on `INERTIA_SHARE` where all free motion is fitted, with prior probabilities. On a real
arm half of the wrist's inertia was missing: its motors contribute much of it. Not sensitive."""
UNSTEADY_SHARE = 0.01
"""fraction (1 sigma): the same error, independent in each bin: links and gears bend a little.
Sensitive: mass 0.2 σ, std ×0.95–1.1."""
LEFT_SHARES = (1.0 / 64.0, 1.0 / 8.0, 1.0)
"""possible shares of the datasheet's `force_repeatability` that an approach leaves in the joints of
this arm, and shares of it that remain in motion. They range from almost none to all, and are
equally likely before a recording. Sensitive: mass std ×0.9–1.2."""
GAINS_OFF = ((1.0, 3.0), (0.95, 0.05))
"""factors on the datasheet's gain uncertainty, with prior probabilities. One arm in twenty is
assumed to have left its delivered state. Not sensitive."""
LOAD_PRIOR = 1e3
"""N (1 sigma): uninformative prior of the load. Not sensitive."""
LOAD_INERTIA = 0.01
"""kg m² (1 sigma): inertia of a load about the TCP, which acts where the hand turns unevenly; 1 kg
at 0.1 m. Not sensitive."""
ANY_ZERO = 10.0
"""N m (1 sigma): uninformative prior of a sensor's zero. Not sensitive."""
JOINT_VISCOUS = 0.3
"""N m s/rad (1 sigma): viscous friction in a joint; 0.07 was identified (Gaz et al.). Hardly sensitive."""
LINK_MASS = 0.05
"""fraction (1 sigma): error of the mass that moves with a joint. Identified models are some per
cent off (Gaz et al.). Hardly sensitive."""
LINK_CENTRE = 5e-3
"""m (1 sigma): error of its centre of mass. No published figure. Hardly sensitive."""
SLIPS_OTHERWISE = ((0.1, 1.0), (0.7, 0.3))
"""factors on the friction of elements with an unusual presliding distance, with prior
probabilities. Chosen, without a source. Sensitive: mass std ×1.08 where they always count."""
EMPTY_BLOCKS = 20
"""blocks (2 s): shortest motion with an empty hand from which the residual of the arm's model is
learned. Not sensitive."""
TILT = 0.009
"""rad (1 sigma): tilt of a support, half a degree. Slides in both directions observe it. Sensitive:
friction 0.1 σ; std of a slide one way ×0.8–1.7."""

WEIGHT, LEVER, LINK, INERTIA, REST = "weight", "lever", "link", "inertia", "rest"
SLIPS = "joint friction over another way"
"""Names of causes, or their prefixes: the load, errors of the link model and of the torque that
moves the links, residual stiction of rests."""
PLACE = {GAIN: "of", CROSSTALK: "in"}
"""Prepositions between these names and that of a joint."""


def by_signal(torque: Array) -> Array:
    """Reorder torques (k, m, ...) to rows by signal, (m k, ...)."""
    return torque.swapaxes(0, 1).reshape(-1, *torque.shape[2:])


def per_joint(*signals: Array) -> Array:
    """Build columns (k, m, m s) that give each joint its own coefficient of each of s signals (k, m)."""
    joints = np.eye(signals[0].shape[1])
    return np.concatenate([signal[:, :, None] * joints for signal in signals], axis=2)


def build_cause(name: str, columns: Array, prior: float) -> Cause:
    """Build a cause whose p unknowns have one prior deviation; `columns` are their torques (k, m, p)."""
    return Cause.build(name, by_signal(columns), prior)


def build_gain(columns: Array, name: str = GAIN) -> Cause:
    """Build the gains of m sensors, or their cross-talk; `columns` (..., m) are the effects of one deviation each."""
    labels = tuple(f"{name} {PLACE[name]} joint {i + 1}" for i in range(columns.shape[-1]))
    return Cause.build(name, columns, 1.0, "arm", labels)


def response_columns(read: Array) -> Array:
    """Build columns (k, m, m (m - 1)) of the response of each signal to each other one of signals (k, m)."""
    count = read.shape[1]
    pairs = [(i, j) for i in range(count) for j in range(count) if i != j]
    found = np.zeros((*read.shape, len(pairs)))
    for column, (i, j) in enumerate(pairs):
        found[:, i, column] = read[:, j]
    return found


def crosstalk_columns(hand: NominalHand, torque: Array, signals: int) -> Array:
    """Compute the cross-talk (n, signals) of torques (n,), ordered by signal, in each signal."""
    read = crosstalk(hand, torque.reshape(signals, -1).T)
    return read.T.ravel()[:, None] * np.repeat(np.eye(signals), len(read), axis=0)


def build_load(seen: Blocks, pull: Array) -> Iterator[Cause]:
    """Yield the weight of the load, and its lever in each grasp.

    Args:
        pull: (k, 3) upward force per newton of weight.
    """
    yield build_cause(WEIGHT, seen.torques(pull)[:, :, None], LOAD_PRIOR)
    for i, grasp in enumerate(seen.grasps):
        # First moment along each axis of the hand.
        here = (seen.grasp == grasp)[:, None, None]
        yield build_cause(f"{LEVER} {i + 1}", here * seen.held[:, :, :3], LOAD_PRIOR)


def build_load_inertia(seen: Blocks) -> Cause:
    """Build the inertia of the load about the TCP, in the axes of the hand."""
    return build_cause("inertia of the load", seen.held[:, :, 3:], LOAD_INERTIA)


def build_free_motion(
    trace: Trace,
    observed: WrenchObservation,
    seen: Blocks,
    load: Sequence[Cause],
    lifted: Array,
    borne: Array,
) -> list[Cause]:
    """Build all causes of the torques of an arm with a `load` (see `build_load`); other arguments as `build_arm`."""
    return [*load, build_load_inertia(seen), *build_arm(trace, observed, seen, lifted, borne)]


def fit_blocks(
    causes: Sequence[Cause],
    seen: Blocks,
    noise: SignalLevels,
    learned: Sequence[PriorScale] = (),
    free: Array | None = None,
) -> Posterior:
    """Fit causes to blocks, with the coloured residual that they leave.

    Args:
        learned: prior scales that are learned, beside those of the arm.
        free: (m k, p) columns of further unknowns without a prior.
    """
    sensors, y, every = build_noise(seen, noise), by_signal(seen.observed), list(causes)
    spans = seen.spans
    if free is not None:
        every.append(Cause.build("free", free, np.inf))
    left = with_residual(sensors, learn_residual(every, sensors, y, spans), spans)
    whole = left if free is None else Projected.of(left, free)
    return fit(causes, whole, y, [*arm_scales(causes), *learned])


def build_arm(
    trace: Trace, observed: WrenchObservation, seen: Blocks, lifted: Array, borne: Array
) -> Iterator[Cause]:
    """Yield the error causes of the arm itself.

    Args:
        lifted: (k,) N, force with which the hand lifts the load.
        borne: (m k,) N m, torques of the load.
    """
    hand, signals = trace.hand, int(seen.observed.shape[1])
    # Errors of the link model, and tilt of gravity for links and load.
    weight, links, lean = build_link_errors(seen, observed, trace.gravity)
    yield from links
    yield build_cause("lean", lean + seen.maps[:, :, :2] * lifted[:, None, None], TILT)
    # Zero, friction and inertia of each joint act on its own signal only.
    usual = SLIP_ANGLES.index(PRESLIDING)
    slips = seen.dahl.reshape(*seen.dahl.shape[:2], -1, 2)
    states = slips.transpose(2, 3, 0, 1)
    yield build_cause("zero", per_joint(np.ones_like(seen.observed)), ANY_ZERO)
    yield build_cause("joint friction", per_joint(*states[usual]), JOINT_LEVEL)
    others = np.delete(states, usual, axis=0).reshape(-1, *seen.dq.shape)
    yield build_cause(SLIPS, per_joint(*others), JOINT_LEVEL)
    yield build_cause("viscous friction", per_joint(seen.dq), JOINT_VISCOUS)
    yield build_cause(INERTIA, per_joint(seen.moved), INERTIA_SHARE)
    # Residual stiction as a force at the TCP, only for rests within these blocks: the time grows
    # with the cube of the unknowns.
    rests = [rest[:, None, None] * seen.maps[:, :, :3] for rest in seen.resting.T if rest.any()]
    if rests:
        yield build_cause(REST, np.dstack(rests), hand.force_repeatability + FLOOR)
    # Gains scale the torques of links and load; the zero absorbs their constant part.
    shown = by_signal(weight - weight[0]) + borne
    gains = shown[:, None] * np.repeat(gain_root(hand, signals), len(seen.t), axis=0)
    yield build_gain(gains)
    # Cross-talk of the load alone: that of the links' weight acts as an error in their masses.
    yield build_gain(crosstalk_columns(hand, borne, signals), CROSSTALK)


def arm_scales(causes: Sequence[Cause]) -> list[PriorScale]:
    """List the prior scales of the arm's causes that are learned from the recording."""
    found = [
        PriorScale((GAIN,), *GAINS_OFF),
        PriorScale((INERTIA,), *INERTIA_OFF),
        PriorScale((SLIPS,), *SLIPS_OTHERWISE),
    ]
    if any(one.name == REST for one in causes):
        even = [1.0 / len(LEFT_SHARES)] * len(LEFT_SHARES)
        found.append(PriorScale((REST,), LEFT_SHARES, even))
    return found


def link_deviations(link: Array, mass: float, centre: float) -> Array:
    """Compute the changes (4, 4) of mass and first moment of a `link` (4,) by one deviation of each of its errors.

    They are its mass, by the fraction `mass`, and its centre along each axis, by `centre` m.
    """
    return np.column_stack([mass * link, centre * link[0] * np.eye(4)[:, 1:]])


def label_link(joint: int) -> tuple[str, ...]:
    """Name the errors in the mass and in the centre of the links that move with a joint."""
    kinds = ("mass", *(f"centre along {axis}" for axis in "xyz"))
    return tuple(f"{LINK} {kind} at joint {joint + 1}" for kind in kinds)


@once
def build_link_errors(
    seen: Blocks, observed: WrenchObservation, gravity: float
) -> tuple[Array, list[Cause], Array]:
    """Compute the gravity torques of the arm's links and the effects of errors in their model.

    Returns:
        Gravity torques (k, m), N m.
        Causes: errors in the mass and the centre of mass of the links that move with each joint.
        Torques (k, m, 2) per radian of tilt of gravity along world x and y.
    """
    chain, q = observed.chain, seen.q
    still = np.zeros((3 * len(q), q.shape[1]))
    assert chain is not None
    # Torques of a unit of mass and of first moment of each link, for gravity along each world axis.
    pulls = np.repeat(-gravity * observed.turn, len(q), axis=0)
    columns = regressor(chain, np.tile(q, (3, 1)), still, still, pulls)[..., :4]
    held = columns.reshape(3, len(q), *columns.shape[1:])
    holds = np.zeros((3, *q.shape))
    errors: list[Cause] = []
    for i in range(len(chain.axes)):
        link = link_parameters(chain, i)[:4]
        if not link[0]:
            continue
        holds += [each[:, :, i] @ link for each in held]
        shown = by_signal(held[2][:, :, i] @ link_deviations(link, LINK_MASS, LINK_CENTRE))
        errors.append(Cause.build(f"{LINK} at joint {i + 1}", shown, 1.0, "arm", label_link(i)))
    return holds[2], errors, holds[:2].transpose(1, 2, 0)


@once
def learn_arm_residual(trace: Trace, name: str) -> ColouredResidual | None:
    """Learn the residual of the arm's model with an empty hand, around the time in which it holds
    `name`.

    No force on a load is in it. None where links are unknown or almost no such motion was recorded.
    """
    observed, load = observe(trace), load_rows(trace, name)
    free = free_rows(trace, name) if observed.knows_links else []
    empty = [rows for rows in free if load.empty[rows].all()]
    if len(empty) < EMPTY_BLOCKS:
        return None
    seen, samples = blocks(trace, observed, name, empty), trace.samples
    # Sensor noise from rests in free air, then the residual of all causes of the arm.
    windows = list(runs(at_rest(samples) & load.empty & rows_in_free_air(trace)))
    rising = acceleration(samples, FOLLOWED)[:, 2]
    noise = build_noise(seen, block_noise(observed.signals, samples.t, rising, windows))
    y = by_signal(seen.observed)
    causes = list(build_arm(trace, observed, seen, np.zeros(len(seen.t)), np.zeros(len(y))))
    return learn_residual(causes, noise, y, seen.spans)


def build_noise(seen: Blocks, noise: SignalLevels) -> SignalNoise:
    """Build the noise of block means: white and 1/f noise, drift, and errors of the links' inertia."""
    # Drift (Ornstein-Uhlenbeck process) and 1/f noise by the time between blocks.
    between = np.abs(seen.t[:, None] - seen.t)
    drift = DRIFT**2 * np.exp(-between / DRIFT_TIME) * TORQUE_LEVER**2
    slow = flicker(between)
    roots: list[Array] = []
    # White noise: blocks are means of signals smoothed over `FOLLOWED`, so that neighbours share a part.
    length = float(np.median(np.diff(seen.t)))
    overlap = min(FOLLOWED / max(length, FOLLOWED), 1.0)
    shared = np.where(between < 1.5 * length, overlap / 6.0, 0.0)
    np.fill_diagonal(shared, 1.0 - overlap / 3.0)
    shared = shared / np.sqrt(np.outer(seen.rows, seen.rows))
    # Covariance of each joint, with the error of its inertia bin by bin.
    for joint, moved in enumerate(seen.moved.T):
        own = np.diag((UNSTEADY_SHARE * moved) ** 2 + FLOOR**2)
        covariance: Array = drift + noise.flicker[joint] * slow + noise.white[joint] * shared + own
        roots.append(np.linalg.cholesky(covariance).astype(np.float64))
    return SignalNoise(roots, noise.freedom)
