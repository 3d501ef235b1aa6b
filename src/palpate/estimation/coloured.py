"""Coloured residual: what a model leaves beyond the noise of the sensors, learned from the recording itself.

Models of an arm leave more than sensor noise: ripple of gears, friction that changes with the place, links that
bend. That is not white: neighbouring rows err alike, and a mean over them is worse than their number promises.
In each signal

    residual ~ sensor noise + Σ_i a_i² exp(-d_i / l_i)

a sum of Ornstein-Uhlenbeck processes, one over time and one over the path that the joint has turned (at rest it
stays as it is). Amplitudes a and lengths l maximise the likelihood of the rows with all causes integrated out
(restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971), signal by signal. A process without
evidence is left out, so that a recording of a perfect arm is not punished.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.regression import Cause, SignalNoise
from palpate.geometry.pose import Array

AMPLITUDES = (0.0, *(tuning.COLOUR_LEAST * tuning.COLOUR_STEP**i for i in range(19)))
"""In the unit of the signal: from nothing to more than any joint rubs."""
START = 9
"""Amplitude from which the search sets out."""


@dataclass(frozen=True, slots=True, eq=False)
class Process:
    """Ornstein-Uhlenbeck process that may be in a signal.

    Attributes:
        apart: (k, k) distance between its rows.
        lengths: over which it may change, in ascending order.
    """

    apart: Array
    lengths: Sequence[float]


def coloured(
    causes: Sequence[Cause], noise: SignalNoise, y: Array, processes: Sequence[Sequence[Process]]
) -> SignalNoise:
    """Noise with a coloured residual of each signal, learned from its rows of `y` (n,); `processes`: of each
    signal those that may be in it."""
    design = np.concatenate([cause.columns for cause in causes], axis=1)
    # Diffuse, but not so much that nothing is left of the digits.
    prior = np.minimum(np.concatenate([cause.prior for cause in causes]), tuning.DIFFUSE)
    ends = np.cumsum([len(root) for root in noise.roots])[:-1]
    parts = zip(
        noise.roots, np.split(design * prior, ends), np.split(y, ends), processes, strict=True
    )
    found = [
        _Signal(root @ root.T, columns, rows, own).learned() for root, columns, rows, own in parts
    ]
    freedom = float(np.mean([min(one, noise.freedom) for _, one in found]))
    return SignalNoise([root for root, _ in found], freedom)


State = tuple[tuple[int, int], ...]
"""Of each process the number of its length and of its amplitude, 0 where there is none."""


class _Signal:
    """Rows of one signal, with all causes integrated out, and the processes that may be in them."""

    def __init__(
        self, noise: Array, columns: Array, rows: Array, processes: Sequence[Process]
    ) -> None:
        used = columns[:, np.abs(columns).max(axis=0) > 0.0]
        self._noise, self._rows, self._processes = noise, rows, processes
        self._covariance: Array = noise + used @ used.T
        self._known: dict[State, float] = {}

    def learned(self) -> tuple[Array, float]:
        """Root of the covariance with the likeliest processes, and the degrees of freedom of that."""
        state: State = tuple((len(one.lengths) // 2, START) for one in self._processes)
        while (better := max(self._around(state), key=self._evidence)) != state:
            state = better
        freedom = min((self._freedom(state, i) for i in range(len(state))), default=np.inf)
        # The states that were seen on the way, by their evidence: how slow the residual is, is known badly.
        most, more = self._known[state], np.zeros_like(self._noise)
        seen = {one: np.exp(found - most) for one, found in self._known.items()}
        whole = sum(seen.values())
        for one, weight in seen.items():
            if weight > tuning.COUNTED * whole:
                more += weight / whole * self._more(one)
        return np.linalg.cholesky(self._noise + more).astype(np.float64), freedom

    def _around(self, state: State) -> Iterator[State]:
        """The state and its neighbours."""
        yield state
        for i, (length, amplitude) in enumerate(state):
            near = {(length, 0), (length, amplitude - 1), (length, amplitude + 1)}
            if amplitude:
                near |= {(length - 1, amplitude), (length + 1, amplitude)}
            for one in sorted(near):
                inside = 0 <= one[0] < len(self._processes[i].lengths) and one[1] >= 0
                if inside and one[1] < len(AMPLITUDES):
                    yield (*state[:i], one, *state[i + 1 :])

    def _more(self, state: State) -> Array:
        found = np.zeros_like(self._noise)
        for process, (length, amplitude) in zip(self._processes, state, strict=True):
            if amplitude:
                far = process.apart / process.lengths[length]
                found += AMPLITUDES[amplitude] ** 2 * np.exp(-far)
        return found

    def _evidence(self, state: State) -> float:
        """Logarithm of the likelihood and of the prior of a state."""
        from scipy.linalg.lapack import dpotrf, dtrtrs

        if state not in self._known:
            root = dpotrf(self._covariance + self._more(state), lower=True)[0]
            white = dtrtrs(root, self._rows, lower=True)[0]
            there = sum(amplitude > 0 for _, amplitude in state)
            found = -0.5 * float(white @ white) - float(np.log(np.diag(root)).sum())
            self._known[state] = found - tuning.COLOUR_CHANCE * there
        return self._known[state]

    def _freedom(self, state: State, i: int) -> float:
        """Degrees of freedom of the variance of a process: twice the information on its logarithm."""
        length, amplitude = state[i]
        if not 0 < amplitude < len(AMPLITUDES) - 1:
            return np.inf
        less, more = ((*state[:i], (length, amplitude + d), *state[i + 1 :]) for d in (-1, 1))
        there = amplitude > 1
        bend = 2.0 * self._evidence(state) - self._evidence(less) - self._evidence(more)
        bend -= 0.0 if there else tuning.COLOUR_CHANCE
        return max(2.0 * bend / np.log(tuning.COLOUR_STEP**2) ** 2, tuning.COLOUR_FREEDOM)
