"""Inertial parameters of a rigid load that was carried through a recording of free motion.

The wrench that moves a rigid body is linear in ten numbers: mass m, first moment h = m c and inertia I about the
TCP, in the tool's axes (C. Atkeson, C. An and J. Hollerbach, Estimation of inertial parameters of manipulator
loads and links, IJRR 5, 1986):

    f = m (a + g) + (α× + ω×ω×) R h
    n = R h × (a + g) + R I Rᵀ α + ω × R I Rᵀ ω

They are fitted together with all error causes of the arm (`load.causes`), on means over blocks of time of both
sides. The noise of each joint is white noise and Ornstein-Uhlenbeck processes of several lengths, whose variances
are those under which the recording itself is likeliest (restricted maximum likelihood, by the updates of H. Zhou
et al., MM algorithms for variance components models, J. Comput. Graph. Stat. 28, 2019): friction that no column
describes widens the interval by as much as it is seen to be, and for as long as it lasts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import KNOWN
from palpate.estimation.joint_friction import TURNED, dahl_states
from palpate.estimation.load.blocks import Blocks, Rows, blocks
from palpate.estimation.load.causes import by_signal, of_arm, scales
from palpate.estimation.load.chain import own_motion
from palpate.estimation.load.in_hand import load_rows
from palpate.estimation.load.observation import WrenchObservation, observe
from palpate.estimation.motion import Mask, smoothed_with_rate
from palpate.estimation.regression import Cause, Posterior, SignalNoise, fit
from palpate.geometry.pose import Array, rotations, tensor_of
from palpate.parameter import Parameter
from palpate.trace.samples import Trace, once

LOAD, HAND = "load", "hand"
"""Names of causes."""


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """Load of a recording.

    Attributes:
        value: (10,) kg, kg m and kg m², in the tool's axes, the inertia about the TCP.
        covariance: (10, 10) of it.
        compared: the empty hand is in the recording, too.
        columns: (m k, 10) torques of a unit of each, carried or not.
        hanging: (m k,) rows in which it was carried.
        seen, posterior: of the fit.
    """

    value: Array
    covariance: Array
    compared: bool
    columns: Array
    hanging: Mask
    seen: Blocks
    posterior: Posterior

    def part(self, start: float, end: float) -> Array:
        """(m k,) torques per kg of a load of these proportions, carried from `start` to `end` alone."""
        t = np.tile(self.seen.t, len(self.columns) // len(self.seen.t))
        here = (start <= t) & (t <= end)
        return here * (self.columns @ self.value) / max(float(self.value[0]), 1e-3)


def load_columns(twist: Array, rates: Array, tool: Array, gravity: float) -> Array:
    """(n, 6, 10) wrench that the hand exerts on a load, per unit of each of its parameters, N and N m in world axes
    about the TCP.

    Args:
        twist, rates: (n, 6) of the TCP, world axes, and their change per second.
        tool: (n, 3, 3) the tool's axes in the world.
        gravity: m/s².
    """
    pulled = rates[:, :3] + np.array([0.0, 0.0, gravity])
    turn, gain = twist[:, 3:], rates[:, 3:]
    out = np.zeros((len(twist), 6, 10))
    out[:, :3, 0] = pulled
    for axis in range(3):
        lever = tool[:, :, axis]
        out[:, :3, 1 + axis] = np.cross(gain, lever) + np.cross(turn, np.cross(turn, lever))
        out[:, 3:, 1 + axis] = np.cross(lever, pulled)
    for place, unit in enumerate(np.eye(6)):
        tensor = tool @ tensor_of(unit.tolist()) @ tool.transpose(0, 2, 1)
        moved = np.einsum("nij,nj->ni", tensor, turn)
        out[:, 3:, 4 + place] = np.einsum("nij,nj->ni", tensor, gain) + np.cross(turn, moved)
    return out


@once
def carried(trace: Trace, name: str) -> Carried | None:
    """Fit the load `name` to all the time in which it was carried, and the hand was empty; None where the arm's
    links are unknown, or it never was. A recording that stands for the mass of the hand has that fitted, too."""
    observed, load = observe(trace), load_rows(trace, name)
    if not observed.knows_links or not load.loaded.any():
        return None
    groups = block_rows(trace.samples.t, load.loaded, load.empty)
    seen = blocks(trace, observed, name, groups, over=tuning.CARRIED_SMOOTH)
    every = _torques(trace, observed, groups)
    hanging = np.tile([bool(load.loaded[group[0]]) for group in groups], len(every) // len(groups))
    unknown = [Cause(LOAD, every * hanging[:, None], _prior(tuning.CARRIED_PRIOR))]
    if trace.converted(Parameter(HAND, "mass")) is not None:
        unknown.append(Cause(HAND, every, _prior(tuning.HAND_PRIOR)))
    unknown += _friction(trace, groups)
    unknown.append(_inertias(trace, observed, groups))
    return _fitted(trace, observed, seen, every, unknown, hanging)


def _prior(sizes: tuple[float, float, float]) -> Array:
    return np.repeat(sizes, (1, 3, 6))


def block_rows(t: Array, loaded: Mask, empty: Mask) -> list[Rows]:
    """Rows of each block, loaded or empty throughout, away from gaps and from other rows by what is averaged."""
    length = max(tuning.WHOLE_BLOCK, float(np.ptp(t)) / tuning.CARRIED_MOST)
    breaks = np.diff(t) > tuning.GAP * float(np.median(np.diff(t)))
    breaks |= np.diff(loaded) | np.diff(empty)
    found: list[Rows] = []
    for rows in np.split(np.arange(len(t)), np.flatnonzero(breaks) + 1):
        if not (loaded | empty)[rows[0]]:
            continue
        since, until = t[rows] - t[rows[0]], t[rows[-1]] - t[rows]
        inner = rows[(since > tuning.CARRIED_SMOOTH) & (until > tuning.CARRIED_SMOOTH)]
        places = np.flatnonzero(np.diff((t[inner] / length).astype(int))) + 1
        found += [block for block in np.split(inner, places) if len(block) > 1]
    return found


def _torques(trace: Trace, observed: WrenchObservation, groups: Sequence[Rows]) -> Array:
    """(m k, 10) block means of the joint torques of a load with unit parameters."""
    samples = trace.samples
    twist, rates = smoothed_with_rate(samples.twist, samples.t, tuning.CARRIED_SMOOTH)
    out: list[Array] = []
    for group in groups:
        tool = rotations(samples.pose_world_tcp[group, 3:])
        wrench = load_columns(twist[group], rates[group], tool, trace.gravity)
        out.append((observed.maps(samples.q[group]) @ wrench).mean(axis=0))
    return by_signal(np.array(out))


def _friction(trace: Trace, groups: Sequence[Rows]) -> Iterator[Cause]:
    """Friction of the joints that turns round over other angles than the usual."""
    q = trace.samples.q
    for angle in tuning.CARRIED_PRESLIDING:
        states = dahl_states(q * (tuning.PRESLIDING / angle))[:, :, TURNED]
        shown = by_signal(_means(states, groups)[:, :, None] * np.eye(q.shape[1]))
        prior = np.full(q.shape[1], tuning.JOINT_LEVEL)
        yield Cause(f"joint friction over {1e3 * angle:g} mrad", shown, prior)


def _inertias(trace: Trace, observed: WrenchObservation, groups: Sequence[Rows]) -> Cause:
    """Torques that move each of the arm's links, whose inertia is known to a part."""
    chain, samples = observed.chain, trace.samples
    assert chain is not None
    rates, changes = smoothed_with_rate(samples.dq, samples.t, tuning.CARRIED_SMOOTH)
    columns: list[Array] = []
    for joint in range(len(chain.axes)):
        alone = replace(chain, links=tuple(link for link in chain.links if link.joint == joint))
        torque = own_motion(alone, samples.q, rates, changes)
        columns.append(by_signal(_means(torque, groups)))
    prior = np.full(len(columns), tuning.CARRIED_INERTIA)
    return Cause("inertia of links", np.column_stack(columns), prior)


def _means(values: Array, groups: Sequence[Rows]) -> Array:
    """Block means of samples."""
    return np.array([values[group].mean(axis=0) for group in groups])


def _fitted(
    trace: Trace,
    observed: WrenchObservation,
    seen: Blocks,
    every: Array,
    unknown: Sequence[Cause],
    hanging: Mask,
) -> Carried:
    y, noise = by_signal(seen.observed), Components.of(seen)
    borne, mass = np.zeros(len(y)), 0.0
    while True:
        # Gains and tilt act on the torques of the load, too, which are unknown at first.
        lifted = (mass * trace.gravity * hanging[: len(seen.t)]).astype(float)
        causes = [*unknown, *of_arm(trace, observed, seen, lifted, borne)]
        posterior = fit(causes, noise.signal_noise(), y, scales(causes))
        if noise.rounds == tuning.CARRIED_ROUNDS:
            value, covariance = posterior[LOAD]
            compared = not hanging.all()
            return Carried(value, covariance, compared, every, hanging, seen, posterior)
        bodies = [one for one in unknown if one.name in (LOAD, HAND)]
        borne = sum((one.columns @ posterior[one.name][0] for one in bodies), np.zeros(len(y)))
        mass = float(posterior[LOAD][0][0])
        noise = noise.likelier(posterior)


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Noise of m signals as a sum of components: white noise, Ornstein-Uhlenbeck processes in time, and functions of
    the joint's own angle and of the arm's configuration, in either direction alike or not: friction that differs from
    place to place, and what the model of the arm leaves, return where the arm returns.

    Attributes:
        kernels: (m, c, k, k) covariance of each component at unit variance.
        variances: (m, c) N² m².
        rounds: in which they were made likelier.
    """

    kernels: Array
    variances: Array
    rounds: int = 0

    @classmethod
    def of(cls, seen: Blocks) -> Components:
        """Components over the blocks, all alike."""
        between = np.abs(seen.t[:, None] - seen.t)
        white = np.diag(seen.rows.mean() / seen.rows)
        slow = [np.exp(-between / length) for length in tuning.CARRIED_LENGTHS]
        apart = np.abs(seen.q[:, None] - seen.q)
        posture = np.exp(-0.5 * (apart**2).sum(axis=2) / tuning.CARRIED_POSTURE**2)
        kernels: list[Array] = []
        for joint, way in enumerate(seen.dahl[:, :, TURNED].T):
            near = np.exp(-apart[:, :, joint] / tuning.CARRIED_PLACE)
            kernels.append(np.array([white, *slow, posture, near, near * np.outer(way, way)]))
        count = len(kernels[0])
        return cls(np.array(kernels), np.full((len(kernels), count), tuning.CARRIED_NOISE**2))

    def signal_noise(self) -> SignalNoise:
        """The noise."""
        floor = tuning.FLOOR**2 * np.eye(self.kernels.shape[2])
        pairs = zip(self.variances, self.kernels, strict=True)
        mixed = [np.tensordot(sizes, kernels, 1) + floor for sizes, kernels in pairs]
        return SignalNoise([np.linalg.cholesky(one).astype(float) for one in mixed], KNOWN)

    def likelier(self, posterior: Posterior) -> Components:
        """Components with variances under which the fitted rows are likelier: each times the root of the quotient
        of its share in what was left to what it was expected to leave."""
        noise = posterior.noise
        assert isinstance(noise, SignalNoise)
        left = np.split(posterior.residual, len(noise.roots))
        design = np.split(posterior.model.design, len(noise.roots))
        variances = self.variances.copy()
        for signal, root in enumerate(noise.roots):
            # Of y with all causes: P = V⁻¹ - V⁻¹ X C Xᵀ V⁻¹ and P y = V⁻¹ (y - X x̂).
            inverse = np.linalg.inv(root)
            weighted = inverse.T @ left[signal]
            known = inverse.T @ design[signal]
            precision = inverse.T @ inverse - known @ posterior.covariance @ known.T
            for place, kernel in enumerate(self.kernels[signal]):
                share = float(weighted @ kernel @ weighted)
                expected = max(float(np.sum(precision * kernel)), 1e-300)
                variances[signal, place] *= np.sqrt(share / expected)
        return Components(self.kernels, np.maximum(variances, tuning.FLOOR**2), self.rounds + 1)
