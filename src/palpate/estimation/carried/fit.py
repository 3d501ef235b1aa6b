"""Inertial parameters of a rigid load that was carried through a recording of free motion.

The wrench that moves a rigid body is linear in ten numbers: mass m, first moment h = m c and inertia I about the
TCP, in the tool's axes (C. Atkeson, C. An and J. Hollerbach, Estimation of inertial parameters of manipulator
loads and links, IJRR 5, 1986):

    f = m (a + g) + (α× + ω×ω×) R h
    n = R h × (a + g) + R I Rᵀ α + ω × R I Rᵀ ω

They are fitted together with all error causes of the arm (`load.causes`), on means over blocks of time of both
sides. What these leave is a coloured residual, learned from the recording (`estimation.coloured`): friction that no
column describes widens the interval by as much as it is seen to be, and for as long as it lasts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import KNOWN
from palpate.estimation.load.blocks import Blocks, Rows, blocks
from palpate.estimation.load.causes import by_signal, free_noise, of_arm, scales, with_residual
from palpate.estimation.load.noise import Noise
from palpate.estimation.load.observation import WrenchObservation, observe
from palpate.estimation.load.segments import load_rows
from palpate.estimation.motion import Mask, smoothed_with_rate
from palpate.estimation.regression import Cause, Posterior, fit
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
        columns: (m k, 10) torques of a unit of each.
        seen, posterior: of the fit.
    """

    value: Array
    covariance: Array
    compared: bool
    columns: Array
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
    seen = blocks(trace, observed, name, groups)
    every = _torques(trace, observed, groups)
    hanging = np.tile([bool(load.loaded[group[0]]) for group in groups], len(every) // len(groups))
    unknown = [Cause(LOAD, every * hanging[:, None], _prior(tuning.CARRIED_PRIOR))]
    if trace.converted(Parameter(HAND, "mass")) is not None:
        unknown.append(Cause(HAND, every, _prior(tuning.HAND_PRIOR)))
    return _fitted(trace, observed, seen, unknown, hanging)


def _prior(sizes: tuple[float, float, float]) -> Array:
    return np.repeat(sizes, (1, 3, 6))


def block_rows(t: Array, loaded: Mask, empty: Mask) -> list[Rows]:
    """Rows of each block, loaded or empty throughout, without a gap."""
    length = max(tuning.WHOLE_BLOCK, float(np.ptp(t)) / tuning.CARRIED_MOST)
    gap = np.diff(t) > max(tuning.GAP * float(np.median(np.diff(t))), length)
    changes = np.diff(((t - t[0]) / length).astype(int)).astype(bool) | gap
    changes |= np.diff(loaded) | np.diff(empty)
    parts = np.split(np.arange(len(t)), np.flatnonzero(changes) + 1)
    return [part for part in parts if (loaded | empty)[part[0]] and len(part) > 1]


def _torques(trace: Trace, observed: WrenchObservation, groups: Sequence[Rows]) -> Array:
    """(m k, 10) block means of the joint torques of a load with unit parameters."""
    samples = trace.samples
    twist, rates = smoothed_with_rate(samples.twist, samples.t, tuning.FOLLOWED)
    out: list[Array] = []
    for group in groups:
        tool = rotations(samples.pose_world_tcp[group, 3:])
        wrench = load_columns(twist[group], rates[group], tool, trace.gravity)
        out.append((observed.maps(samples.q[group]) @ wrench).mean(axis=0))
    return by_signal(np.array(out))


def _fitted(
    trace: Trace,
    observed: WrenchObservation,
    seen: Blocks,
    unknown: Sequence[Cause],
    hanging: Mask,
) -> Carried:
    y, nothing = by_signal(seen.observed), np.zeros(seen.observed.shape[1])
    # All noise is learned, the sensors' as well.
    sensors = free_noise(seen, Noise(nothing, nothing, KNOWN))
    borne, mass, rounds = np.zeros(len(y)), 0.0, 0
    while True:
        # Gains and tilt act on the torques of the load, too, which are unknown at first.
        lifted: Array = mass * trace.gravity * hanging[: len(seen.t)].astype(np.float64)
        causes = [*unknown, *of_arm(trace, observed, seen, lifted, borne)]
        posterior = fit(causes, with_residual(causes, sensors, seen), y, scales(causes))
        value, covariance = posterior[LOAD]
        if rounds == tuning.CARRIED_ROUNDS:
            columns = unknown[0].columns
            return Carried(value, covariance, not hanging.all(), columns, seen, posterior)
        borne = sum((one.columns @ posterior[one.name][0] for one in unknown), np.zeros(len(y)))
        mass, rounds = float(value[0]), rounds + 1
