"""Sliding friction from drags of a held object along its support.

All drags follow one linear model (`columns`), whose unknowns have normal priors, apart from the friction
itself (Bayesian linear regression, e.g. Bishop, Pattern Recognition and Machine Learning, section 3.3). A
normal force that rises and falls along the way separates friction from all other unknowns; where it is
constant, their priors are part of the standard deviation.

The variation of the object's friction between axes, places and speeds is learned from the drags: a few values
are averaged by their evidence (ibid., sections 3.4 and 14.1). The noise follows from the scatter within short
stretches, never from the residuals, which would let the priors outweigh the recordings; the misfit is added
to the standard deviation at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import Spans
from palpate.estimation.drag_causes import MU, Columns, columns
from palpate.estimation.drags import Drag
from palpate.estimation.estimate import FitView, Shared, constant, round_to_std, unit_slopes
from palpate.estimation.load_noise import flicker
from palpate.estimation.motion import Mask
from palpate.estimation.wrench_observation import WrenchObservation
from palpate.trace.recording import NominalHand

UNEVEN_SHARES = (0.0, 0.03, 0.1, 0.3)
"""parts (1 sigma) by which friction may differ between axes, places or speeds ... Sensitive: friction 0.07 σ, std
×0.7–1.2."""
LIKELY_UNEVEN = (0.91, 0.03, 0.03, 0.03)
"""... and how likely that is before it is felt. Sensitive: friction 0.1 σ, std ×0.8–1.2."""
FRICTION_ITERATIONS = 2
"""solutions: what gains and joints do depends on the coefficient. Sensitive: no."""
CORRELATED_BLOCKS = 3.0
"""blocks: what the model of a drag leaves out is the same in about so many neighbouring ones. Sensitive: friction
std ×0.8–1.3."""
SLIDING_NOISE = 1e-3
"""N: noise of a block that is always assumed. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPosterior:
    """Normal posterior of all unknowns.

    Attributes:
        mean, covariance: (p,), (p, p).
        errors: (p,) effects on the estimated friction of one prior deviation of each unknown.
        evidence: log evidence of the forces.
    """

    mean: Array
    covariance: Array
    errors: Array
    evidence: float = 0.0


@dataclass(frozen=True, eq=False)
class TangentialForces:
    """Tangential forces in blocks of steady sliding.

    Attributes:
        force: (m,) N, tangential.
        design: (m, p), a column for each unknown.
        noise: (m,) N², variance within a block.
        root: (m, m) N, Cholesky factor of the covariance of all noise.
    """

    force: Array
    design: Array
    noise: Array
    root: Array

    @cached_property
    def white(self) -> tuple[Array, Array]:
        """Force (m,) and design (m, p) with independent noise of unit variance."""
        both = np.column_stack([self.force, self.design])
        solved = np.linalg.solve(self.root, both).astype(np.float64)
        return solved[:, 0], solved[:, 1:]

    def given(self, expected: Array, prior: Array) -> FrictionPosterior:
        """Posterior for prior means and standard deviations (p,)."""
        force, design = self.white
        # In units of the prior deviations, which are further rows; by QR, as perfect sensors make the normal
        # equations singular.
        rows = np.vstack([design * prior, np.eye(len(prior))])
        beyond = np.concatenate([force - design @ expected, np.zeros(len(prior))])
        turned, triangle = np.linalg.qr(rows)
        inverse = np.linalg.inv(triangle).astype(np.float64)
        found = inverse @ (turned.T @ beyond)
        misfit = float(np.sum((beyond - rows @ found) ** 2))
        size = 2.0 * float(np.log(np.abs(np.diag(triangle))).sum())
        spread = prior[:, None] * inverse
        mean, errors = expected + prior * found, -spread[MU] @ inverse.T
        return FrictionPosterior(mean, spread @ spread.T, errors, -0.5 * (misfit + size))


@dataclass(frozen=True, slots=True)
class Difference:
    """Wald test of some unknowns: their size, the statistic (χ² without them), and its degrees of
    freedom."""

    size: float
    statistic: float
    freedom: int


@dataclass(frozen=True, slots=True, eq=False)
class Sliding:
    """Fit of all drags.

    Attributes:
        columns: of the unknowns.
        forces: in blocks of steady sliding.
        found: posterior of the unknowns, averaged over their priors.
        uneven: variation (1 sigma) of the friction between axes, places and speeds.
        misfit: N, root mean square of the residuals beyond the noise.
        disagreement, freedom: of a chi-squared test of the residuals.
    """

    columns: Columns
    forces: TangentialForces
    found: FrictionPosterior
    uneven: float
    misfit: float
    disagreement: float
    freedom: int

    @property
    def shared(self) -> tuple[Shared, ...]:
        """Errors of mu_d shared by measurements with that arm or of that object."""
        effects = self.columns.shared(self.found.errors)
        causes = [Shared(cause, of, (effect,)) for cause, of, effect in effects]
        return *causes, Shared("unevenness of the friction", "scene", (self.uneven,))

    @property
    def friction(self) -> tuple[float, float]:
        """mu_d and its standard deviation, with its variation."""
        std = float(np.hypot(np.sqrt(self.found.covariance[MU, MU]), self.uneven))
        return float(self.found.mean[MU]), std

    def knowing(self, friction: float, std: float) -> Sliding:
        """Condition on a friction that is known better from elsewhere."""
        own = self.found.covariance[MU, MU]
        follows = self.found.covariance[MU] / own
        mean = self.found.mean + follows * (friction - self.found.mean[MU])
        covariance = self.found.covariance + np.outer(follows, follows) * (std**2 - own)
        return replace(self, found=replace(self.found, mean=mean, covariance=covariance))

    def views(self, drags: Sequence[Drag], static: tuple[float, float] | None) -> Iterator[FitView]:
        """Tangential over normal force in each block of steady sliding; and their quotient over time."""
        normal, mu = self.forces.design[:, MU], float(self.found.mean[MU])
        others = self.forces.design @ self.found.mean - normal * mu
        yield FitView(
            name="Force along the drag over the force that presses.",
            note=f"Means of {len(normal)} stretches of {len(drags)} drags, less what the fit ascribes to other causes "
            "than one coefficient of friction; the slope is that coefficient.",
            axes=("pressing (N)", "along the drag (N)"),
            x=normal,
            measured=self.forces.force - others,
            predicted=mu * normal,
            std=np.sqrt(self.forces.noise),
            groups="sliding steadily",
            slopes=normal[:, None],
        )
        note = (
            "Tangential over normal force in each drag: the object sticks, breaks away and slides. Friction in the "
            "joints, which the fit separates, is still in it."
        )
        if static is not None:
            note += f" Static, of the breakaways: {' ± '.join(round_to_std(*static))}."
        begun = [(drag, drag.breakaway) for drag in drags if drag.breakaway is not None]
        # NaN separates the drags, so that no line leads from one to the next.
        t = np.concatenate(
            [*(np.append(one.t, np.nan) for one in drags), [d.t[i] for d, i in begun]]
        )
        rows = [np.append(one.quotient, np.nan) for one in drags]
        sliding = [np.append(one.steady, False) for one in drags]
        yield FitView(
            name="The quotient over time.",
            note=note,
            axes=("robot time (s)", "along / pressing"),
            x=t,
            measured=np.concatenate([*rows, [d.quotient[i] for d, i in begun]]),
            predicted=constant(mu, t),
            used=np.concatenate([*sliding, np.ones(len(begun), dtype=bool)]),
            groups=["smoothed"] * (len(t) - len(begun)) + ["breakaway"] * len(begun),
            slopes=unit_slopes(t),
        )

    def aside(self, drag: int, rows: slice) -> tuple[float, float]:
        """Mean force over rows of a drag by other causes than friction of the object, N, and its standard
        deviation."""
        row = self.columns.of[drag][rows].mean(axis=0)
        row[MU] = 0.0
        return float(row @ self.found.mean), float(np.sqrt(row @ self.found.covariance @ row))

    def other_causes(self, drag: int) -> Array:
        """(n,) N, force by other causes than friction of the object in each row of a drag."""
        others = self.found.mean.copy()
        others[MU] = 0.0
        return self.columns.of[drag] @ others

    def turning(self, drag: int, rows: slice, steady: Mask) -> float:
        """Root sum of squares over joints of the mean friction in rows of a drag against that in steady rows,
        in which the joints have reversed, N."""
        joints = self.columns.joints
        own = self.columns.of[drag][:, joints]
        less = own[rows].mean(axis=0) - own[steady].mean(axis=0)
        return float(np.linalg.norm(less * self.found.mean[joints]))

    def apart(self, shares: Sequence[tuple[int, slice, float]]) -> float:
        """Standard deviation of a weighted sum over drags (number, rows, weight) of the mean force by other
        causes than friction of the object."""
        row = np.zeros(len(self.found.mean))
        for drag, rows, share in shares:
            row += share * self.columns.of[drag][rows].mean(axis=0)
        row[MU] = 0.0
        return float(np.sqrt(row @ self.found.covariance @ row))

    def difference(self, what: slice, likely: float, small: float) -> Difference:
        """Test the unknowns `what`, of prior size `likely`, against tolerated values `small` (1 sigma each); all
        other friction is even."""
        fixed, even = self.columns.fixed.copy(), np.zeros_like(self.columns.uneven)
        fixed[what] = likely
        found, _ = average_over_shares(self.forces, replace(self.columns, fixed=fixed, uneven=even))
        mean = found.mean[what]
        spread = found.covariance[what, what] + small**2 * np.eye(len(mean))
        statistic = float(mean @ np.linalg.solve(spread, mean))
        return Difference(float(np.linalg.norm(mean)), statistic, len(mean))


def fit_sliding(drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand) -> Sliding:
    """Fit the friction of steady sliding."""
    # Initial value: mean tangential over mean normal force.
    tangential = sum(float(drag.tangential[drag.steady].sum()) for drag in drags)
    mu = max(0.0, tangential / sum(float(drag.normal[drag.steady].sum()) for drag in drags))
    for _ in range(FRICTION_ITERATIONS - 1):
        mu = max(float(_fit_drags(drags, observed, hand, mu)[2].mean[MU]), 0.0)
    unknowns, forces, found, uneven = _fit_drags(drags, observed, hand, mu)
    force, design = forces.white
    excess = max(0.0, float(np.mean((force - design @ found.mean) ** 2)) - 1.0)
    squares = (forces.force - forces.design @ found.mean) ** 2
    # Allowed within one drag: half of the repeatability of an approach, and half of the change of joint friction.
    each = slice(unknowns.joints.stop, unknowns.gains.start)
    dahl = forces.design[:, each] @ unknowns.fixed[each]
    allowed = forces.noise + (hand.force_repeatability / 2) ** 2 + (dahl / 2) ** 2
    # The weights did not include a white variance of the misfit in every block.
    gain = found.covariance @ design.T
    wider = found.covariance + CORRELATED_BLOCKS * excess * (gain @ gain.T)
    # Blocks that err alike count as one: the square of the trace of their covariance over the trace of its square.
    alike = forces.root @ forces.root.T / np.sqrt(np.outer(allowed, allowed))
    independent = float(np.trace(alike) ** 2 / np.sum(alike**2))
    freedom = max(1, round(min(independent, len(squares) / CORRELATED_BLOCKS)))
    return Sliding(
        unknowns,
        forces,
        replace(found, covariance=wider),
        uneven,
        misfit=float(np.sqrt(max(0.0, float(np.mean(squares - forces.noise))))),
        disagreement=freedom * float(np.mean(squares / allowed)),
        freedom=freedom,
    )


def _fit_drags(
    drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand, mu: float
) -> tuple[Columns, TangentialForces, FrictionPosterior, float]:
    """Columns, forces, posterior and variation of the friction, linearised at a friction of `mu`."""
    unknowns = columns(drags, observed, hand, mu)
    forces = _forces(drags, unknowns, mu)
    return unknowns, forces, *average_over_shares(forces, unknowns)


def average_over_shares(
    forces: TangentialForces, unknowns: Columns
) -> tuple[FrictionPosterior, float]:
    """Posterior and variation of the friction (1 sigma), averaged over the shares of uneven friction by their
    evidence."""
    each = [forces.given(unknowns.expected, unknowns.prior(share)) for share in UNEVEN_SHARES]
    uneven = [share * float(unknowns.uneven.max()) for share in UNEVEN_SHARES]
    evidence = np.array([one.evidence for one in each]) + np.log(LIKELY_UNEVEN)
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    mean = sum(w * one.mean for w, one in zip(weights, each, strict=True))
    errors = sum(w * one.errors for w, one in zip(weights, each, strict=True))
    covariance = np.zeros_like(each[0].covariance)
    for weight, one in zip(weights, each, strict=True):
        covariance += weight * (one.covariance + np.outer(one.mean - mean, one.mean - mean))
    found = FrictionPosterior(np.asarray(mean), covariance, np.asarray(errors))
    return found, float(np.sqrt(weights @ np.square(uneven)))


def _forces(drags: Sequence[Drag], unknowns: Columns, mu: float) -> TangentialForces:
    force: list[float] = []
    design: list[Array] = []
    noise: list[float] = []
    levers: list[Array] = []
    spans: list[Spans] = []
    for drag, own, lever in zip(drags, unknowns.of, unknowns.levers, strict=True):
        pressed = mu**2 * drag.pressing[1]
        for block in drag.blocks:
            force.append(float(drag.tangential[block].mean()))
            design.append(own[block].mean(axis=0))
            noise.append(drag.noise / len(block) + pressed + SLIDING_NOISE**2)
            levers.append(lever)
        spans.append(Spans.of(drag.t, drag.path, drag.blocks))
    every, each, hanging = Spans.concatenate(spans), np.array(levers), drags[0].hanging
    slow = (each * hanging.noise.flicker) @ each.T * flicker(np.abs(every.t[:, None] - every.t))
    left = np.zeros_like(slow)
    if hanging.left is not None:
        # What the model of the arm leaves in each joint, in each block and in the reference.
        for joint, there in enumerate(each.T):
            own = hanging.left.covariance(every, joint) + hanging.left.total[joint]
            left += np.outer(there, there) * own
    variance = np.array(noise)
    root = np.linalg.cholesky(np.diag(variance) + slow + left).astype(np.float64)
    return TangentialForces(np.array(force), np.array(design), variance + np.diag(left), root)
