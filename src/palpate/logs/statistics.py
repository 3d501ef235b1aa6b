"""Statistics of the errors of an arm's joint torques, from a recording of free motion.

One function for a recording of a real arm and of a simulated one. It knows the nominal arm, and no noise
model.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from palpate.errors import InputError
from palpate.estimation.arm.explained import explained_upright
from palpate.geometry.pose import Array
from palpate.logs.figure import Figure
from palpate.logs.ripple import ripple
from palpate.logs.slow_torque import slow_torque
from palpate.robots.description import RobotDescription
from palpate.trace.log import ArmLog

SHORTEST = 5.0  # s of recording
LEAST_RATE = 250.0  # Hz, slowest recording that shows the noise of samples
REST, LEAST_REST = 0.02, 100  # rad/s, norm over the joints; samples at rest
ALIKE, RECURS = 1.08, 0.005  # ratio of equal steps; share of all differences
FREEDOM = 18 / 35  # of a variance of second differences, for each of them


@dataclass(frozen=True, slots=True, eq=False)
class LogStatistics:
    """Errors of the joint torques in a recording; N m where nothing else is said."""

    white: Figure  # standard deviation of a sample at rest
    quantisation: Figure  # step of a sample
    offset: Figure
    coulomb: Figure
    presliding: Figure  # rad
    position: Figure  # 1, relative variation of the Coulomb friction over a turn: root mean square
    residual: Figure  # root mean square of what all these leave below 5 Hz
    ripple: Figure  # root mean square at `cycles` a turn, with a resonance's gain
    second: Figure  # of its second harmonic
    cycles: Figure  # 1
    encoder_ripple: Figure  # rad, root mean square at `cycles` a turn, as the velocities show it
    shaking: Figure  # root mean square from 8 to 30 Hz, without gravity
    shaking_left: Figure  # likewise without M ddq of the velocities
    drift: Figure  # N m/min

    def figures(self) -> dict[str, Figure]:
        """Return all figures by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def statistics(log: ArmLog, arm: RobotDescription) -> LogStatistics:
    """Measure the errors of the joint torques of `arm` in a recording of free motion.

    A load beyond the nominal hand, or a hand that is not there, is fitted and counts as no error.

    Raises:
        InputError: the recording is too short, or the described arm does not explain it.
    """
    if len(log) < 2 or log.t[-1] - log.t[0] < SHORTEST:
        raise InputError(
            f"{log.source}: give at least {SHORTEST:g} s of free motion; a minute is better"
        )
    found = explained_upright(log, arm)
    if not found.passed:
        raise InputError(f"{log.source}: {found.finding}")
    chain = arm.nominal.chain
    assert chain is not None
    return LogStatistics(
        white=white(log),
        quantisation=quantisation(log.tau),
        **slow_torque(log, chain),
        **ripple(log, chain),
    )


def white(log: ArmLog) -> Figure:
    """Measure the white noise of samples at rest by second differences, which hide what is slow."""
    resting = np.linalg.norm(log.dq, axis=1) < REST
    middle = resting[:-2] & resting[1:-1] & resting[2:]
    count = int(middle.sum())
    if count < LEAST_REST or 1.0 / float(np.median(np.diff(log.t))) < LEAST_RATE:
        return Figure.unseen()
    second = (log.tau[1:-1] - (log.tau[:-2] + log.tau[2:]) / 2)[middle]
    value = np.sqrt((second**2).mean(0) / 1.5)
    return Figure.about(value, value / np.sqrt(2 * FREEDOM * count))


def quantisation(tau: Array) -> Figure:
    """Find the step of the samples: their least difference, where it recurs."""
    found = np.array([_step(np.abs(np.diff(values))) for values in tau.T])
    return Figure.about(found[:, 0], found[:, 1])


def _step(apart: Array) -> tuple[float, float]:
    """Find the least of distances (n,), and its standard deviation; NaN where they are continuous."""
    apart = np.sort(apart[apart > 1e-9])
    least = apart[apart < ALIKE * apart[0]] if len(apart) else apart
    if len(least) < max(5, RECURS * len(apart)):
        return np.nan, np.nan
    return float(np.median(least)), float(least.std() / np.sqrt(len(least)))
