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
from palpate.estimation.arm.causes import LINKS, Bodies, Rows, Setup
from palpate.estimation.arm.fit import DETAILS, FRICTION, PARTS, Assumed, fitted
from palpate.estimation.arm.motion import Motion, cut, uniform_runs
from palpate.estimation.arm.spectrum import transformed
from palpate.estimation.load.chain import regressor
from palpate.estimation.load.observation import gain_root, observe
from palpate.estimation.load.segments import load_rows
from palpate.estimation.motion import Mask
from palpate.estimation.regression import Cause, Posterior
from palpate.estimation.rigid import PARAMETERS, in_axes, placed_at
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
    """

    value: Array
    covariance: Array
    motions: Sequence[Motion]
    hanging: Mask
    torques: Sequence[Array]
    posterior: Posterior

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
            step = float(motion.t[1] - motion.t[0])
            rows.append(transformed(here[:, None] * (torque @ share), step))
        return np.concatenate(rows).ravel()


@once
def carried(trace: Trace, name: str) -> Carried | None:
    """Fit the load `name` to all the time in which it was carried, and the hand was empty; None where the arm's
    links are unknown, or it never was. A recording that stands for the mass of the hand has that fitted, too."""
    observed, rows = observe(trace), load_rows(trace, name)
    chain = observed.chain
    if chain is None or not chain.links or not rows.loaded.any():
        return None
    bodies = Bodies.of(chain, tuning.LINK_MASS, tuning.LINK_CENTRE, 0.0)
    gravity = -trace.gravity * observed.turn[2]
    setup = Setup(chain, bodies, trace.samples.q[0], gravity, held=True)
    samples = trace.samples
    log = ArmLog(samples.t, samples.q, samples.dq, observed.signals, None, "")
    found = [(motion, True) for motion in _stretches(trace, log, rows.loaded)]
    if not found:
        return None
    found += [(motion, False) for motion in _stretches(trace, log, rows.empty)]
    motions, hanging = [motion for motion, _ in found], np.array([hung for _, hung in found])
    seen = Rows.of(motions, setup)
    # About the TCP, in the axes of the tool.
    place = placed_at(np.array(chain.tcp) - chain.anchors[-1]) @ in_axes(np.array(chain.tool))
    every = (seen.columns[LINKS][:, :, -PARAMETERS:] @ place).reshape(-1, PARAMETERS)
    torques = [
        regressor(chain, one.q, one.dq, one.ddq, gravity)[:, :, -1] @ place for one in motions
    ]
    counts = [
        len(transformed(one, float(m.t[1] - m.t[0]))) * 7
        for one, m in zip(torques, motions, strict=True)
    ]
    hung = np.repeat(hanging, counts)
    loads = [Cause(LOAD, every * hung[:, None], _prior(tuning.CARRIED_PRIOR))]
    if trace.converted(Parameter(HAND, "mass")) is not None:
        loads.append(Cause(HAND, every, _prior(tuning.HAND_PRIOR)))
    assumed = Assumed(bodies, bodies.hand, gain_root(trace.hand, len(chain.axes)))
    fit = fitted(seen, assumed, (*FRICTION, *DETAILS, *PARTS), loads)
    value, covariance = fit.posterior[LOAD]
    return Carried(value, covariance, motions, hanging, torques, fit.posterior)


def _prior(sizes: tuple[float, float, float]) -> Array:
    return np.repeat(sizes, (1, 3, 6))


def _stretches(trace: Trace, log: ArmLog, rows: Mask) -> Iterator[Motion]:
    """Stretches of a trace in `rows` (n,)."""
    for motion in uniform_runs(log):
        nearest = np.searchsorted(log.t, motion.t).clip(0, len(log.t) - 1)
        used = rows[nearest]
        edges = np.flatnonzero(np.diff(used)) + 1
        for part in np.split(np.arange(len(motion)), edges):
            if used[part[0]]:
                yield from cut(motion, int(part[0]), int(part[-1]) + 1, tuning.CARRIED_SHORTEST)
