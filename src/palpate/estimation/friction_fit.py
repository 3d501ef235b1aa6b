"""Sliding friction from drags of a held object along its support.

All drags follow one linear model (`drag_causes`), whose unknowns have normal priors, except the friction
itself (Bayesian linear regression: Bishop, Pattern Recognition and Machine Learning, section 3.3). A normal
force that varies along the path separates friction from all other unknowns. Where it is constant, their priors
add to the standard deviation.

The fit learns how the object's friction varies with direction, position and speed: a few values of the prior
scale are averaged by their evidence (ibid., sections 3.4 and 14.1). The noise follows from the scatter within
short blocks. Noise from the residuals would let the priors outweigh the recordings. The misfit is added to the
standard deviation at the end.
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
"""Fractions (1 sigma) by which friction may vary with direction, position or speed. Sensitive: friction 0.07 σ, std
×0.7–1.2."""
LIKELY_UNEVEN = (0.91, 0.03, 0.03, 0.03)
"""Prior probabilities of `UNEVEN_SHARES`. Sensitive: friction 0.1 σ, std ×0.8–1.2."""
FRICTION_ITERATIONS = 2
"""Number of solutions: the effect of gains and joint friction depends on the coefficient. Sensitive: no."""
CORRELATED_BLOCKS = 3.0
"""Number of neighbouring blocks that share one model error of a drag. Sensitive: friction std ×0.8–1.3."""
SLIDING_NOISE = 1e-3
"""N. Smallest noise of a block. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPosterior:
    """Normal posterior of all unknowns."""

    mean: Array  # (p,) posterior mean
    covariance: Array  # (p, p)
    errors: Array  # (p,) error of the estimated friction by one prior deviation of each unknown
    evidence: float = 0.0  # log evidence of the forces


@dataclass(frozen=True, eq=False)
class TangentialForces:
    """Tangential forces in m blocks of steady sliding."""

    force: Array  # (m,) N, tangential
    design: Array  # (m, p), one column for each unknown
    noise: Array  # (m,) N², variance within a block
    root: Array  # (m, m) N, Cholesky factor of the covariance of all noise

    @cached_property
    def white(self) -> tuple[Array, Array]:
        """Whitened force (m,) and design (m, p), with independent noise of unit variance."""
        both = np.column_stack([self.force, self.design])
        solved = np.linalg.solve(self.root, both).astype(np.float64)
        return solved[:, 0], solved[:, 1:]

    def given(self, expected: Array, prior: Array) -> FrictionPosterior:
        """Posterior for prior means and standard deviations (p,), by QR decomposition."""
        force, design = self.white
        # Scale the unknowns by their prior deviations and append the priors as rows. QR is used, as noise-free
        # sensors make the normal equations singular.
        rows = np.vstack([design * prior, np.eye(len(prior))])
        beyond = np.concatenate([force - design @ expected, np.zeros(len(prior))])
        turned, triangle = np.linalg.qr(rows)
        inverse = np.linalg.inv(triangle).astype(np.float64)
        # Solution and log evidence; the triangle has the square root of the determinant.
        found = inverse @ (turned.T @ beyond)
        misfit = float(np.sum((beyond - rows @ found) ** 2))
        size = 2.0 * float(np.log(np.abs(np.diag(triangle))).sum())
        # Covariance in original units, and the error of the friction that each unit prior deviation causes.
        spread = prior[:, None] * inverse
        mean, errors = expected + prior * found, -spread[MU] @ inverse.T
        return FrictionPosterior(mean, spread @ spread.T, errors, -0.5 * (misfit + size))


@dataclass(frozen=True, slots=True)
class Difference:
    """Wald test of a group of unknowns.

    `size` is their norm. `statistic` is χ² distributed with `freedom` degrees of freedom if they are zero.
    """

    size: float
    statistic: float
    freedom: int


@dataclass(frozen=True, slots=True, eq=False)
class Sliding:
    """Fit of steady sliding to all drags."""

    columns: Columns  # columns of the unknowns
    forces: TangentialForces  # forces in blocks of steady sliding
    found: FrictionPosterior  # posterior of the unknowns, averaged over the prior scales
    uneven: float  # variation (1 sigma) of the friction with direction, position and speed
    misfit: float  # N, root mean square of the residuals beyond the noise
    disagreement: float  # chi-squared statistic of the residuals
    freedom: int  # its degrees of freedom

    @property
    def shared(self) -> tuple[Shared, ...]:
        """Errors of mu_d that are shared with measurements by the same arm or of the same object."""
        effects = self.columns.shared(self.found.errors)
        causes = [Shared(cause, of, (effect,)) for cause, of, effect in effects]
        return *causes, Shared("unevenness of the friction", "scene", (self.uneven,))

    @property
    def friction(self) -> tuple[float, float]:
        """mu_d and its standard deviation, which includes the variation `uneven`."""
        std = float(np.hypot(np.sqrt(self.found.covariance[MU, MU]), self.uneven))
        return float(self.found.mean[MU]), std

    def knowing(self, friction: float, std: float) -> Sliding:
        """Condition the posterior on a friction known better from another source."""
        # Gaussian conditioning: regress all unknowns on the friction, then insert its better value.
        own = self.found.covariance[MU, MU]
        follows = self.found.covariance[MU] / own
        mean = self.found.mean + follows * (friction - self.found.mean[MU])
        covariance = self.found.covariance + np.outer(follows, follows) * (std**2 - own)
        return replace(self, found=replace(self.found, mean=mean, covariance=covariance))

    def views(self, drags: Sequence[Drag], static: tuple[float, float] | None) -> Iterator[FitView]:
        """Yield the views of the report: tangential over normal force, and the force quotient over time."""
        # Subtract all causes but friction: the slope of the remainder is the coefficient.
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
        # Time series of the quotient, with a marker at each breakaway.
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
        """Mean force, N, of causes other than the object's friction in rows of a drag, and its standard
        deviation."""
        row = self.columns.of[drag][rows].mean(axis=0)
        row[MU] = 0.0
        return float(row @ self.found.mean), float(np.sqrt(row @ self.found.covariance @ row))

    def other_causes(self, drag: int) -> Array:
        """Force (n,), N, of causes other than the object's friction in each row of a drag."""
        others = self.found.mean.copy()
        others[MU] = 0.0
        return self.columns.of[drag] @ others

    def turning(self, drag: int, rows: slice, steady: Mask) -> float:
        """Change of joint friction between rows of a drag and its steady rows, N: a root sum of squares over joints.

        The joints have reversed by the steady rows."""
        joints = self.columns.joints
        own = self.columns.of[drag][:, joints]
        less = own[rows].mean(axis=0) - own[steady].mean(axis=0)
        return float(np.linalg.norm(less * self.found.mean[joints]))

    def apart(self, shares: Sequence[tuple[int, slice, float]]) -> float:
        """Standard deviation of a weighted sum of mean forces by causes other than the object's friction.

        `shares` holds a drag's number, its rows and its weight.
        """
        row = np.zeros(len(self.found.mean))
        for drag, rows, share in shares:
            row += share * self.columns.of[drag][rows].mean(axis=0)
        row[MU] = 0.0
        return float(np.sqrt(row @ self.found.covariance @ row))

    def difference(self, what: slice, likely: float, small: float) -> Difference:
        """Test whether the unknowns `what`, of prior size `likely`, exceed the tolerance `small` (1 sigma each).

        All other friction is assumed uniform in this test.
        """
        fixed, even = self.columns.fixed.copy(), np.zeros_like(self.columns.uneven)
        fixed[what] = likely
        found, _ = average_over_shares(self.forces, replace(self.columns, fixed=fixed, uneven=even))
        # Wald statistic; the tolerance widens the posterior.
        mean = found.mean[what]
        spread = found.covariance[what, what] + small**2 * np.eye(len(mean))
        statistic = float(mean @ np.linalg.solve(spread, mean))
        return Difference(float(np.linalg.norm(mean)), statistic, len(mean))


def fit_sliding(drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand) -> Sliding:
    """Fit the friction of steady sliding to all drags by Gauss-Newton iterations."""
    # Initial value: total tangential over total normal force.
    tangential = sum(float(drag.tangential[drag.steady].sum()) for drag in drags)
    mu = max(0.0, tangential / sum(float(drag.normal[drag.steady].sum()) for drag in drags))
    for _ in range(FRICTION_ITERATIONS - 1):
        mu = max(float(_fit_drags(drags, observed, hand, mu)[2].mean[MU]), 0.0)
    unknowns, forces, found, uneven = _fit_drags(drags, observed, hand, mu)
    # Whitened residual variance beyond 1: the misfit of the model.
    force, design = forces.white
    excess = max(0.0, float(np.mean((force - design @ found.mean) ** 2)) - 1.0)
    squares = (forces.force - forces.design @ found.mean) ** 2
    # Deviations allowed within one drag: half of the force repeatability, and half of the change of joint friction.
    each = slice(unknowns.joints.stop, unknowns.gains.start)
    dahl = forces.design[:, each] @ unknowns.fixed[each]
    allowed = forces.noise + (hand.force_repeatability / 2) ** 2 + (dahl / 2) ** 2
    # Add a white variance of the misfit in every block, which the weights did not include.
    gain = found.covariance @ design.T
    wider = found.covariance + CORRELATED_BLOCKS * excess * (gain @ gain.T)
    # Effective number of independent blocks: squared trace of their covariance over the trace of its square.
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
    """Posterior and variation of the friction (1 sigma), averaged over `UNEVEN_SHARES` by their evidence.

    This is Bayesian model averaging.
    """
    each = [forces.given(unknowns.expected, unknowns.prior(share)) for share in UNEVEN_SHARES]
    uneven = [share * float(unknowns.uneven.max()) for share in UNEVEN_SHARES]
    # Posterior probability of each share; the largest exponent is subtracted against underflow.
    evidence = np.array([one.evidence for one in each]) + np.log(LIKELY_UNEVEN)
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    # Moments of the mixture: its covariance includes the scatter of the means.
    mean = sum(w * one.mean for w, one in zip(weights, each, strict=True))
    errors = sum(w * one.errors for w, one in zip(weights, each, strict=True))
    covariance = np.zeros_like(each[0].covariance)
    for weight, one in zip(weights, each, strict=True):
        covariance += weight * (one.covariance + np.outer(one.mean - mean, one.mean - mean))
    found = FrictionPosterior(np.asarray(mean), covariance, np.asarray(errors))
    return found, float(np.sqrt(weights @ np.square(uneven)))


def _forces(drags: Sequence[Drag], unknowns: Columns, mu: float) -> TangentialForces:
    """Block means of the tangential force and the design, with the covariance of all noise."""
    force: list[float] = []
    design: list[Array] = []
    noise: list[float] = []
    levers: list[Array] = []
    spans: list[Spans] = []
    # Block means of the force and the design, with the white noise of each block.
    for drag, own, lever in zip(drags, unknowns.of, unknowns.levers, strict=True):
        pressed = mu**2 * drag.pressing[1]
        for block in drag.blocks:
            force.append(float(drag.tangential[block].mean()))
            design.append(own[block].mean(axis=0))
            noise.append(drag.noise / len(block) + pressed + SLIDING_NOISE**2)
            levers.append(lever)
        spans.append(Spans.of(drag.t, drag.path, drag.blocks, drag.q))
    # Correlated noise: flicker of the sensors, over the time between two blocks.
    every, each, hanging = Spans.concatenate(spans), np.array(levers), drags[0].hanging
    slow = (each * hanging.noise.flicker) @ each.T * flicker(np.abs(every.t[:, None] - every.t))
    left = np.zeros_like(slow)
    if hanging.left is not None:
        # Residual of the arm model in each joint, correlated over blocks, and its part in the reference.
        for joint, there in enumerate(each.T):
            own = hanging.left.covariance(every, joint) + hanging.left.total[joint]
            left += np.outer(there, there) * own
    variance = np.array(noise)
    root = np.linalg.cholesky(np.diag(variance) + slow + left).astype(np.float64)
    return TangentialForces(np.array(force), np.array(design), variance + np.diag(left), root)
