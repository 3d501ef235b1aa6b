"""Inertial parameters of a rigid load that was carried through a recording of free motion.

Its ten parameters about the TCP (`estimation.rigid`) are further unknowns beside those of the arm itself (`arm/`): a
load is what the last link has more of in some stretches of the recording. Friction, links, sensors and noise are those
of the arm's dynamics, learned from the recording with and without the load.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest
from palpate.estimation.arm.causes import Bodies, Rows, Setup
from palpate.estimation.arm.explained import Claim, explained
from palpate.estimation.arm.fit import COMMON, DETAILS, FRICTION, PARTS, Assumed, fitted
from palpate.estimation.arm.motion import Motion, cut, uniform_runs
from palpate.estimation.arm.spectrum import kept, transformed
from palpate.estimation.load.chain import load_torques
from palpate.estimation.load.in_hand import load_rows
from palpate.estimation.load.observation import common_gain, gain_root, observe
from palpate.estimation.motion import Mask
from palpate.estimation.regression import Cause, Posterior, Scale
from palpate.estimation.rigid import PARAMETERS
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.log import ArmLog
from palpate.trace.samples import Trace, once

LOAD, HAND = "load", "hand"
"""Names of causes."""


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """Load of a recording.

    Attributes:
        value: (10,) kg, kg m and kg m², in the tool's axes, the inertia about the TCP.
        covariance: (10, 10) of it.
        motions: stretches of the recording, each loaded or empty throughout.
        hanging: (s,) stretches in which it was carried.
        torques: (s,) of each, (n, 7, 10) joint torques of a unit of each parameter, carried or not.
        posterior: of the fit.
        explained: test that the described arm explains the recording.
    """

    value: Array
    covariance: Array
    motions: Sequence[Motion]
    hanging: Mask
    torques: Sequence[Array]
    posterior: Posterior
    explained: FitTest

    @property
    def compared(self) -> bool:
        """The empty hand is in the recording, too."""
        return not self.hanging.all()

    def seconds(self, hanging: bool) -> float:
        """Time with or without the load."""
        pairs = zip(self.motions, self.hanging, strict=True)
        return sum(float(np.ptp(motion.t)) for motion, hung in pairs if hung == hanging)

    def part(self, start: float, end: float, hanging: bool = True) -> Array:
        """(7 k,) rows of a load of one kilogram of these proportions, carried from `start` to `end` alone, in
        stretches in which it was `hanging`, or in the others."""
        share = self.value / max(float(self.value[0]), 1e-3)
        rows: list[Array] = []
        for motion, hung, torque in zip(self.motions, self.hanging, self.torques, strict=True):
            here = (start <= motion.t) & (motion.t <= end) & (hung == hanging)
            rows.append(transformed(here[:, None] * (torque @ share), motion.step))
        return np.concatenate(rows).ravel()


@once
def carried(trace: Trace, name: str) -> Carried | None:
    """Fit the load `name` to all the time in which it was carried, and the hand was empty; None where the arm's
    links are unknown, or it never was. A recording that stands for the mass of the hand has that fitted, too."""
    observed, rows = observe(trace), load_rows(trace, name)
    chain = observed.chain
    if chain is None or not chain.links or not rows.loaded.any():
        return None
    samples, gravity = trace.samples, -trace.gravity * observed.turn[2]
    log = ArmLog(samples.t, samples.q, samples.dq, observed.signals, None, "")
    found = [(motion, True) for motion in _stretches(log, rows.loaded)]
    if not found:
        return None
    found += [(motion, False) for motion in _stretches(log, rows.empty)]
    used = rows.loaded | rows.empty
    claim = Claim.of(log, trace.hand, gravity, rows.loaded, used, held=True)
    motions, hanging = [motion for motion, _ in found], np.array([hung for _, hung in found])
    torques = [load_torques(chain, one.q, one.dq, one.ddq, gravity) for one in motions]
    bodies = Bodies.of(chain, tuning.LINK_MASS, tuning.LINK_CENTRE, 0.0)
    seen = Rows.of(motions, Setup(chain, bodies, samples.q[0], gravity, held=True))
    loads = list(_loads(trace, motions, hanging, torques))
    begun = list(_restarts(seen, log, motions))
    alike = Scale(tuple(one.name for one in begun), (0.0, 1.0), tuning.LIKELY_RESTART)
    gains, common = gain_root(trace.hand, len(chain.axes)), common_gain(trace.hand)
    names = (*FRICTION, *DETAILS, *([COMMON] if common else []), *PARTS)
    learned = [alike] if begun else []
    assumed = Assumed(bodies, bodies.hand, gains, common)
    posterior = fitted(seen, assumed, names, loads, begun, learned).posterior
    value, covariance = posterior[LOAD]
    return Carried(value, covariance, motions, hanging, torques, posterior, explained(claim))


def _loads(
    trace: Trace, motions: Sequence[Motion], hanging: Mask, torques: Sequence[Array]
) -> Iterator[Cause]:
    """The load in the stretches in which it hung, and in a recording that stands for its mass the hand in all."""
    parts = [transformed(torque, one.step) for torque, one in zip(torques, motions, strict=True)]
    borne = [hung * part for hung, part in zip(hanging, parts, strict=True)]
    columns = np.concatenate(borne).reshape(-1, PARAMETERS)
    yield Cause(LOAD, columns, _prior(tuning.CARRIED_PRIOR))
    if trace.converted(Parameter(HAND, "mass")) is not None:
        every = np.concatenate(parts).reshape(-1, PARAMETERS)
        yield Cause(HAND, every, _prior(tuning.HAND_PRIOR))


def _prior(sizes: tuple[float, float, float]) -> Array:
    return np.repeat(sizes, (1, 3, 6))


def _restarts(seen: Rows, log: ArmLog, motions: Sequence[Motion]) -> Iterator[Cause]:
    """Zeros of the sensors, and friction at the start, that are others after each long gap."""
    later = np.concatenate([np.full(kept(len(one), one.step), one.t[0]) for one in motions])
    own = np.concatenate([seen.columns["offset"], seen.columns["strained"]], axis=2)
    for i in np.flatnonzero(np.diff(log.t) > tuning.RESTARTED).tolist():
        columns = own * (later > log.t[i])[:, None, None]
        prior = np.full(int(own.shape[2]), tuning.OFFSET_PRIOR)
        yield Cause(f"start at {log.t[i + 1]:g} s", columns.reshape(-1, len(prior)), prior)


def _stretches(log: ArmLog, rows: Mask) -> Iterator[Motion]:
    """Stretches of a recording in `rows` (n,)."""
    for motion in uniform_runs(log):
        nearest = np.searchsorted(log.t, motion.t).clip(0, len(log.t) - 1)
        used = rows[nearest]
        edges = np.flatnonzero(np.diff(used)) + 1
        for part in np.split(np.arange(len(motion)), edges):
            if used[part[0]]:
                yield from cut(motion, int(part[0]), int(part[-1]) + 1, tuning.CARRIED_SHORTEST)
