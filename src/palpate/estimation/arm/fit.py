"""Fit of an arm's torques: causes with priors, noise and presliding learnt from the recording itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.arm.causes import COULOMB, LINKS, Bodies, Rows
from palpate.estimation.arm.spectrum import Residual, SpectralNoise
from palpate.estimation.regression import Cause, Posterior, Scale, fit
from palpate.estimation.rigid import PARAMETERS, placed_at
from palpate.geometry.pose import Array

HAND, GAIN, COMMON = "hand", "gain", "common gain"
WEIGHT, INERTIA = "weight", "inertia"
PARTS = {WEIGHT: slice(0, 4), INERTIA: slice(4, PARAMETERS)}
"""Of the links: masses and first moments, which gravity shows, and inertias."""
FRICTION = ("offset", COULOMB, "strained", "viscous")
DETAILS = (
    "presliding",
    "uneven",
    "loaded",
    "stribeck",
    "armature",
    "cable",
    GAIN,
    "lean",
    "delay",
)
PRIORS = {
    "offset": tuning.OFFSET_PRIOR,
    COULOMB: tuning.COULOMB_PRIOR,
    "strained": tuning.OFFSET_PRIOR,
    "viscous": tuning.VISCOUS_PRIOR,
    "presliding": tuning.PRESLIDING_SHARE,
    "uneven": tuning.UNEVEN_FRICTION,
    "loaded": tuning.LOADED_FRICTION,
    "stribeck": tuning.SLOW_FRICTION,
    "armature": tuning.ARMATURE_PRIOR,
    "cable": tuning.CABLE_PRIOR,
    "lean": tuning.LEAN_PRIOR,
    "delay": tuning.DELAY_PRIOR,
}
"""Standard deviation of each unknown of a cause, about 0 ..."""
LABELS = {
    GAIN: tuple(f"gain of joint {joint}" for joint in range(1, 8)),
    COMMON: ("gain of all joints",),
    WEIGHT: tuple(
        f"link {kind} at joint {joint}"
        for joint in range(1, 8)
        for kind in ("mass", *(f"centre along {axis}" for axis in "xyz"))
    ),
}
"""Names of unknowns whose errors other runs of the arm share."""
RELATIVE = ("presliding", "uneven", "stribeck")
"""... of these times the joint's friction."""


@dataclass(frozen=True, slots=True, eq=False)
class Assumed:
    """Prior of an arm's parameters.

    Attributes:
        bodies: as described.
        hand: (10,) known parameters of all that the last joint carries; None: to be found.
        gains: (7, 7) effects of one standard deviation of each cause on the relative errors of the torque sensors.
        common: standard deviation of one that all of them share.
    """

    bodies: Bodies
    hand: Array | None
    gains: Array
    common: float = 0.0

    def described(self, rows: Rows, hand: Array | None) -> Array:
        """(k, 7) torques of the described links and of a hand."""
        links = self.bodies.links.copy()
        if hand is not None:
            links[-1] += hand
        return rows.columns[LINKS] @ links.ravel()

    def causes(self, rows: Rows, names: Sequence[str], level: Array) -> list[Cause]:
        """Causes by name; `level` (7,) N m is the joints' friction."""
        return [self._cause(rows, name, level) for name in names]

    def _cause(self, rows: Rows, name: str, level: Array) -> Cause:
        if name in PARTS:
            columns = rows.of_bodies(self.bodies)[..., PARTS[name]]
            prior = self.bodies.errors[:, PARTS[name]].ravel()
        elif name == HAND:
            columns = rows.columns[LINKS][:, :, -PARAMETERS:] @ placed_at(self.bodies.reach)
            prior = self.bodies.hand_prior()
        elif name == GAIN:
            columns, prior = rows.columns[GAIN] @ self.gains, np.ones(len(self.gains))
        elif name == COMMON:
            columns = rows.columns[GAIN].sum(axis=2, keepdims=True)
            prior = np.array([self.common])
        else:
            columns = rows.columns[name]
            prior = np.full(columns.shape[2], PRIORS[name])
        if name in RELATIVE:
            prior *= np.tile(level, len(prior) // len(level))
        shared = LABELS.get(name)
        of = None if shared is None else "arm"
        return Cause(name, columns.reshape(rows.tau.size, -1), prior, of, shared or ())


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Fit of an arm's torques.

    Attributes:
        assumed: before it.
        posterior: of its causes.
        level: (7,) N m of the joints' friction, for the priors of what depends on it.
    """

    assumed: Assumed
    posterior: Posterior
    level: Array

    def predicted(self, rows: Rows) -> Array:
        """(k, 7) torques of other rows."""
        names = [cause.name for cause in self.posterior.causes]
        causes = self.assumed.causes(rows, names, self.level)
        caused = sum(cause.columns @ self.posterior[cause.name][0] for cause in causes)
        return self.assumed.described(rows, self.assumed.hand) + np.reshape(caused, rows.tau.shape)


def fitted(
    rows: Rows,
    assumed: Assumed,
    names: Sequence[str],
    loads: Sequence[Cause] = (),
    others: Sequence[Cause] = (),
    learned: Sequence[Scale] = (),
) -> Fitted:
    """Fit causes to rows, among them further `loads`, on which the sensors' gains act, and `others`, with further
    scales to be `learned`; in rounds, as the residual's size by frequency is learnt from what the last round left."""
    y = rows.tau - assumed.described(rows, assumed.hand)
    shape, std = Residual(rows.frequency), np.full(y.shape, tuning.FIRST_RESIDUAL)
    scales = [*learned]
    if WEIGHT in names:
        scales.append(Scale((WEIGHT,), tuning.LINK_FACTORS, tuning.LIKELY_LINKS))
    level, felt = np.full(y.shape[1], tuning.USUAL_FRICTION), rows

    def solved() -> Posterior:
        noise = SpectralNoise(std.ravel(), float(y.size))
        causes = [*loads, *others, *assumed.causes(felt, names, level)]
        return fit(causes, noise, y.ravel(), scales)

    for _ in range(tuning.NOISE_ROUNDS):
        posterior = solved()
        known = posterior.leverage.reshape(y.shape)
        left = posterior.residual.reshape(y.shape) * std
        pairs = zip(left.T, known.T, strict=True)
        std = np.stack([shape.std(*pair) for pair in pairs], axis=1)
        level = np.abs(posterior[COULOMB][0]) + tuning.SMALLEST_RESIDUAL
        felt = rows.bearing(
            sum((one.columns @ posterior[one.name][0] for one in loads), np.zeros(y.size))
        )
    return Fitted(assumed, solved(), level)
