"""Sliding friction from drags of a held object along its support.

The fit of the drags alone (`fit_sliding`) refers each force to a rest in the air. That force also contains the change
of the arm's biases between the two places. Only its growth with the normal force then separates friction from bias.

But the same link errors, zeros, gains and joint friction act in all free motion around the drags (`joint_causes`). A
joint fit to all of it (`fit_whole`) makes the whole sliding force usable. In each block of a drag the other support
forces are unknown: the normal force with its friction, a lateral force, and moments.

Both are linear regressions with the causes of `drag_causes`. They learn how the friction varies with direction,
position and speed. The noise follows from the scatter within short blocks. Noise from the residuals would let the
priors outweigh the recordings. What the models leave is added: the misfit of the drags alone, and the coloured
residual of the arm in the joint fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import Spans
from palpate.estimation.drag_causes import (
    BEND,
    BIAS,
    FRICTION,
    HOLDS,
    JOINTS,
    LEAN,
    ONE_DRAG,
    PULLS,
    UNEVEN,
    UNEVEN_SCALE,
    build_drag_arm,
    build_support,
    middle_of,
    signal_levers,
    support_columns,
    usual_speed,
)
from palpate.estimation.drags import Drag
from palpate.estimation.estimate import (
    KNOWN,
    FitTest,
    FitView,
    Shared,
    chi_squared,
    constant,
    round_to_std,
    unit_slopes,
)
from palpate.estimation.joint_causes import (
    build_cause,
    build_free_motion,
    build_load,
    by_signal,
    fit_blocks,
    per_joint,
)
from palpate.estimation.load_blocks import UP, Blocks, Rows, blocks, free_rows
from palpate.estimation.load_noise import flicker
from palpate.estimation.motion import Mask, row_at
from palpate.estimation.regression import (
    Cause,
    Posterior,
    PriorScale,
    SignalNoise,
    fit,
    place_unknowns,
)
from palpate.estimation.wrench_observation import WrenchObservation
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Trace

FRICTION_ITERATIONS = 2
"""Number of solutions: the effect of gains and joint friction depends on the coefficient. Sensitive: no."""
CORRELATED_BLOCKS = 3.0
"""Number of neighbouring blocks that share one model error of a drag. Sensitive: friction std ×0.8–1.3."""
SLIDING_NOISE = 1e-3
"""N. Smallest noise of a block. Sensitive: no."""


@dataclass(frozen=True, eq=False)
class Sliding:
    """Fit of steady sliding to all drags, in m blocks and p unknowns."""

    rows: tuple[Array, ...]  # for each drag (n, p), effects of the unknowns on each of its rows
    force: Array  # (m,) N, tangential force of the blocks
    noise: Array  # (m,) N², variance within a block
    posterior: Posterior  # of the unknowns, about their prior means
    # mean, covariance: (p,) and (p, p) of the unknowns, widened by the misfit
    mean: Array
    covariance: Array
    misfit: float  # N, root mean square of the residuals beyond the noise
    disagreement: float  # chi-squared statistic of the residuals
    freedom: int  # its degrees of freedom

    def place(self, name: str) -> slice:
        """Indices of the unknowns of a cause."""
        return place_unknowns(self.posterior.causes)[name]

    @property
    def design(self) -> Array:
        """(m, p) effects of the unknowns on the blocks."""
        return np.concatenate([one.columns for one in self.posterior.causes], axis=1)

    @property
    def uneven(self) -> float:
        """Variation (1 sigma) of the friction with direction, position and speed."""
        return friction_variation(self.posterior)

    @property
    def shared(self) -> tuple[Shared, ...]:
        """Errors of mu_d that are shared with measurements by the same arm or of the same object."""
        return shared_errors(self.posterior)

    @property
    def friction(self) -> tuple[float, float]:
        """mu_d and its standard deviation, which includes the variation `uneven`."""
        return float(self.mean[0]), float(np.hypot(np.sqrt(self.covariance[0, 0]), self.uneven))

    def knowing(self, friction: float, std: float) -> Sliding:
        """Condition the posterior on a friction known better from another source."""
        # Gaussian conditioning: regress all unknowns on the friction, then insert its better value.
        own = self.covariance[0, 0]
        follows = self.covariance[0] / own
        mean = self.mean + follows * (friction - self.mean[0])
        covariance = self.covariance + np.outer(follows, follows) * (std**2 - own)
        return replace(self, mean=mean, covariance=covariance)

    def views(self, drags: Sequence[Drag], static: tuple[float, float] | None) -> Iterator[FitView]:
        """Yield the views of the report: tangential over normal force, and the force quotient over time."""
        # Subtract all causes but friction: the slope of the remainder is the coefficient.
        normal, mu = self.design[:, 0], float(self.mean[0])
        others = self.design @ self.mean - normal * mu
        yield FitView(
            name="Force along the drag over the force that presses.",
            note=f"Means of {len(normal)} stretches of {len(drags)} drags, less what the fit ascribes to other causes "
            "than one coefficient of friction; the slope is that coefficient.",
            axes=("pressing (N)", "along the drag (N)"),
            x=normal,
            measured=self.force - others,
            predicted=mu * normal,
            std=np.sqrt(self.noise),
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
        """Mean force, N, of causes other than the object's friction in rows of a drag, and its standard deviation."""
        row = self._others(drag)[rows].mean(axis=0)
        return float(row @ self.mean), float(np.sqrt(row @ self.covariance @ row))

    def other_causes(self, drag: int) -> Array:
        """Force (n,), N, of causes other than the object's friction in each row of a drag."""
        return self._others(drag) @ self.mean

    def turning(self, drag: int, rows: slice, steady: Mask) -> float:
        """Change of joint friction between rows of a drag and its steady rows, N: a root sum of squares over joints.

        The joints have reversed by the steady rows."""
        joints = self.place(JOINTS)
        own = self.rows[drag][:, joints]
        less = own[rows].mean(axis=0) - own[steady].mean(axis=0)
        return float(np.linalg.norm(less * self.mean[joints]))

    def apart(self, shares: Sequence[tuple[int, slice, float]]) -> float:
        """Standard deviation of a weighted sum of mean forces by causes other than the object's friction.

        `shares` holds a drag's number, its rows and its weight.
        """
        row = np.zeros(len(self.mean))
        for drag, rows, share in shares:
            row += share * self._others(drag)[rows].mean(axis=0)
        return float(np.sqrt(row @ self.covariance @ row))

    def _others(self, drag: int) -> Array:
        """Effects (n, p) of the unknowns on the rows of a drag, without the object's friction."""
        return np.column_stack([np.zeros(len(self.rows[drag])), self.rows[drag][:, 1:]])

    def test(
        self, cause: str, likely: float, small: float, title: str, finding: Callable[[float], str]
    ) -> FitTest:
        """Test whether the unknowns of a `cause`, of prior size `likely`, exceed the tolerance `small` (1 sigma each).

        It is a Wald test, in which all other friction is uniform. The `finding` is a function of their norm.
        """
        prior = self.posterior.model.prior.copy()
        for other in UNEVEN:
            prior[self.place(other)] = 0.0
        here = self.place(cause)
        prior[here] = likely
        model = replace(self.posterior.model, prior=prior, hyperpriors=())
        every, covariances, *_ = model.solve()
        mean, covariance = every[here], covariances[here, here]
        # Wald statistic; the tolerance widens the posterior.
        spread = covariance + small**2 * np.eye(len(mean))
        statistic = float(mean @ np.linalg.solve(spread, mean))
        return chi_squared(title, statistic, len(mean), finding(float(np.linalg.norm(mean))))


def friction_variation(posterior: Posterior) -> float:
    """Variation (1 sigma) of the friction with direction, position and speed that a fit leaves possible."""
    most = [
        mean**2 + np.diag(covariance) for mean, covariance in map(posterior.__getitem__, UNEVEN)
    ]
    return float(np.sqrt(np.max(np.concatenate(most))))


def shared_errors(posterior: Posterior) -> tuple[Shared, ...]:
    """Errors of the coefficient that other runs of the arm or of the object share."""
    variation = Shared("unevenness of the friction", "scene", (friction_variation(posterior),))
    return (*posterior.shared(FRICTION), variation)


def fit_sliding(drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand) -> Sliding:
    """Fit the friction of steady sliding to all drags by Gauss-Newton iterations."""
    # Initial value: total tangential over total normal force.
    tangential = sum(float(drag.tangential[drag.steady].sum()) for drag in drags)
    mu = max(0.0, tangential / sum(float(drag.normal[drag.steady].sum()) for drag in drags))
    for _ in range(FRICTION_ITERATIONS - 1):
        mu = max(_fit_drags(drags, observed, hand, mu).friction[0], 0.0)
    return _fit_drags(drags, observed, hand, mu)


def _fit_drags(
    drags: Sequence[Drag], observed: WrenchObservation, hand: NominalHand, mu: float
) -> Sliding:
    """Fit the friction, linearised at `mu`."""
    # Causes in every row of the drags, and in the blocks of steady sliding.
    middle, usual = middle_of(drags), usual_speed(drags)
    support = np.concatenate([support_columns(drag, middle, usual) for drag in drags])
    arm, expected = build_drag_arm(drags, observed, hand, mu)
    every = [*build_support(support, mu), *arm]
    first = np.cumsum([0, *(len(drag.t) for drag in drags)])
    steady = [
        start + block for start, drag in zip(first, drags, strict=False) for block in drag.blocks
    ]
    causes = [
        replace(one, columns=np.array([one.columns[block].mean(axis=0) for block in steady]))
        for one in every
    ]
    force = np.concatenate([[drag.tangential[b].mean() for b in drag.blocks] for drag in drags])
    variance, root = _block_noise(drags, observed, mu)
    # Joint friction has a prior mean, so the fit is about the forces by it.
    known = np.zeros(sum(len(one.prior) for one in causes))
    joints = place_unknowns(causes)[JOINTS]
    known[joints] = expected
    design = np.concatenate([one.columns for one in causes], axis=1)
    noise = SignalNoise([root], KNOWN)
    found = fit(causes, noise, force - design @ known, [UNEVEN_SCALE])
    # Whitened residual variance beyond 1: the misfit of the model.
    excess = max(0.0, float(np.mean(found.residual**2)) - 1.0)
    mean = known + found.mean
    squares = (force - design @ mean) ** 2
    # Deviations allowed within one drag: half of the force repeatability, and half of the change of joint friction.
    each = next(one for one in causes if one.name == ONE_DRAG)
    allowed = variance + (hand.force_repeatability / 2) ** 2 + (each.columns @ each.prior / 2) ** 2
    # Add a white variance of the misfit in every block, which the weights did not include.
    gain = found.covariance @ found.model.design.T
    wider = found.covariance + CORRELATED_BLOCKS * excess * (gain @ gain.T)
    # Effective number of independent blocks: squared trace of their covariance over the trace of its square.
    alike = root @ root.T / np.sqrt(np.outer(allowed, allowed))
    independent = float(np.trace(alike) ** 2 / np.sum(alike**2))
    freedom = max(1, round(min(independent, len(squares) / CORRELATED_BLOCKS)))
    rows = np.concatenate([one.columns for one in every], axis=1)
    return Sliding(
        tuple(np.split(rows, first[1:-1])),
        force,
        variance,
        found,
        mean,
        wider,
        misfit=float(np.sqrt(max(0.0, float(np.mean(squares - variance))))),
        disagreement=freedom * float(np.mean(squares / allowed)),
        freedom=freedom,
    )


def _block_noise(
    drags: Sequence[Drag], observed: WrenchObservation, mu: float
) -> tuple[Array, Array]:
    """Variance (m,), N², within each block of steady sliding, and the Cholesky factor (m, m) of all noise."""
    variance: list[float] = []
    levers: list[Array] = []
    spans: list[Spans] = []
    # White noise of each block, with that of the normal force.
    for drag in drags:
        pressed = mu**2 * drag.pressing[1]
        variance += [drag.noise / len(b) + pressed + SLIDING_NOISE**2 for b in drag.blocks]
        levers += [signal_levers(drag.q, drag, observed, mu)] * len(drag.blocks)
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
    white = np.array(variance)
    root = np.linalg.cholesky(np.diag(white) + slow + left).astype(np.float64)
    return white + np.diag(left), root


# Joint fit to the drags and all free motion around them


HOLDING_MORE = (0.0, 1.0, 10.0)
"""Factors on `HELD_FORCE_STD`, where the arm's own forces are known. Sensitive: friction 0.5 σ, std ×0.5–1.1."""
LIKELY_HOLDING = (0.9, 0.08, 0.02)
"""Prior probabilities of `HOLDING_MORE`. Dry friction is proportional to the normal force (Amontons); one object in
ten is assumed to adhere. Chosen, without a source. Sensitive: friction 0.5 σ, std ×0.9–1.9."""
LIKELY_PULL = (0.9, 0.1)
"""Prior probabilities that no force depends on position, and that one does, where the arm's own forces are known.
Chosen, without a source, as `LIKELY_HOLDING`. Sensitive: no at 0.95 (`lab`)."""
LEANING = (0.2, 1.0)
"""Factors on `SUPPORT_LEAN_STD`. Sensitive: friction std ×0.85 or so without it."""
LIKELY_LEANING = (0.7, 0.3)
"""Prior probabilities of `LEANING`. Arms are mounted on a base levelled to 1 mm/m with a spirit level, or on a floor.
Chosen, without a source. Sensitive: hardly."""
ZERO_STEP_STD = 0.1
"""N m (1 sigma). Change of a sensor's zero after the drags if it jumped. A model without a jump is rejected from this
value. A jump of 1 N at the hand is 0.2 to 0.24 N m over all joints. Sensitive: no."""
LIKELY_STEP = (0.9, 0.1)
"""Prior probabilities that no zero changed, and that some did. Chosen, without a source. Sensitive: no."""
WHOLE_ITERATIONS = 3
"""Iterations of the fit to all motion. The first is up to two deviations from the last if the initial coefficient is
15 % off. Sensitive: no from 3 on (0.1 σ)."""

STEP = "step"
"""Name of the change of the sensors' zeros."""
WHOLE_SCALES = (
    UNEVEN_SCALE,
    PriorScale((HOLDS,), HOLDING_MORE, LIKELY_HOLDING),
    PriorScale((LEAN,), LEANING, LIKELY_LEANING),
    PriorScale((PULLS,), (0.0, 1.0), LIKELY_PULL),
    PriorScale((STEP,), (0.0, 1.0), LIKELY_STEP),
)
"""Prior scales of the scene's causes; the joint fit learns them from the recording."""


@dataclass(frozen=True, slots=True, eq=False)
class WholeFriction:
    """Friction coefficient from a whole section of a trace."""

    friction: float  # the coefficient
    std: float  # its standard deviation
    # Errors shared with measurements by the same arm, or of the same object.
    shared: tuple[Shared, ...]
    stepped: float  # N m, change of the sensors' zeros after the drags, root mean square

    @property
    def explains(self) -> bool:
        """True if the sensors' zeros are the same before and after the drags."""
        return self.stepped < ZERO_STEP_STD


@dataclass(frozen=True, slots=True, eq=False)
class _Pressed:
    """Support forces in k blocks: first those of free motion, then those of the drags."""

    way: Array  # (k, 3) unit vector along the drag, 0 in free motion
    support: Array  # (k, 18) see `drag_causes.support_columns`; 0 in free motion

    @property
    def normal(self) -> Array:
        """(k,) N, normal force."""
        return self.support[:, 0]

    @property
    def slides(self) -> Array:
        """(k,) 1 in drags, 0 in free motion."""
        return np.linalg.norm(self.way, axis=1).round()


def fit_whole(
    trace: Trace, name: str, drags: Sequence[Drag], observed: WrenchObservation, about: float
) -> WholeFriction | None:
    """Fit the coefficient with which `name` slid in all drags, near `about`.

    Returns None if the arm's links are unknown, or if the object never hung free.
    """
    free = free_rows(trace, name) if observed.chain is not None and observed.knows_links else []
    if not free:
        return None
    # Row numbers of the sliding blocks in the whole trace.
    slid: list[Rows] = []
    for drag in drags:
        first = row_at(trace.samples, float(drag.t[0]))
        slid += [first + block for block in drag.slid]
    seen = blocks(trace, observed, name, [*free, *slid])
    pressed = _support_forces(drags, len(free))
    found: WholeFriction | None = None
    # Gauss-Newton: the measured normal force, with all its errors, multiplies the step of the coefficient.
    for _ in range(WHOLE_ITERATIONS):
        found = _fitted(trace, drags, observed, seen, pressed, about)
        about = max(found.friction, 0.0)
    return found


def _fitted(
    trace: Trace,
    drags: Sequence[Drag],
    observed: WrenchObservation,
    seen: Blocks,
    pressed: _Pressed,
    about: float,
) -> WholeFriction:
    """Fit the coefficient, linearised at `about`."""
    force = drags[0].mass * trace.gravity
    slides = pressed.slides[:, None]
    # In a drag, hand and support together carry the weight, and the hand accelerates it.
    along = seen.acceleration * [1.0, 1.0, 0.0] / trace.gravity
    pull = seen.pull + slides * (UP + along)
    load = list(build_load(seen, pull))
    # Force of the support on the hand at `about`, as torques; the gains act on the measured sum.
    rubs = pressed.normal[:, None] * (about * pressed.way - slides * UP)
    borne = force * load[0].columns[:, 0] + by_signal(seen.torques(rubs))
    free = int(np.sum(pressed.slides == 0.0))
    # Causes of the torques: scene, load, and arm. Forces of the support have no prior.
    scene = [*_build_scene(seen, pressed, about), _build_steps(seen, free)]
    torques = build_free_motion(trace, observed, seen, load, force * pull[:, 2], borne)
    support = np.column_stack([by_signal(one) for one in _support_torques(seen, pressed, about)])
    noise = drags[0].hanging.noise
    found = fit_blocks([*scene, *torques], seen, noise, WHOLE_SCALES, support)
    # The posterior step of the coefficient, and the variation of friction that the fit leaves possible.
    (more,), ((variance,),) = found[FRICTION]
    steps, _ = found[STEP]
    return WholeFriction(
        friction=about + float(more),
        std=float(np.hypot(np.sqrt(variance), friction_variation(found))),
        shared=shared_errors(found),
        stepped=float(np.sqrt(np.mean(steps**2))),
    )


def _support_forces(drags: Sequence[Drag], free: int) -> _Pressed:
    """Support forces in `free` blocks of free motion, and in the blocks of the drags."""
    middle, usual = middle_of(drags), usual_speed(drags)
    way: list[Array] = [np.zeros((free, 3))]
    support: list[Array] = []
    for drag in drags:
        own = support_columns(drag, middle, usual)
        support.append(np.array([own[block].mean(axis=0) for block in drag.slid]))
        way.append(np.tile([*drag.way, 0.0], (len(drag.slid), 1)))
    slid = np.concatenate(support)
    return _Pressed(np.concatenate(way), np.concatenate([np.zeros((free, slid.shape[1])), slid]))


def _build_scene(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Cause]:
    """Yield the causes along a drag as joint torques: friction beyond `about`, and other forces.

    The bias of the arm and its bend are errors of the arm's model, which has causes of its own here.
    """
    for one in build_support(pressed.support, about):
        if one.name not in (BIAS, BEND):
            along = (column[:, None] * pressed.way for column in one.columns.T)
            torques = [by_signal(seen.torques(force)) for force in along]
            yield replace(one, columns=np.column_stack(torques))


def _build_steps(seen: Blocks, free: int) -> Cause:
    """Change of each sensor's zero after the mean time of the drags."""
    after = (seen.t > seen.t[free:].mean())[:, None]
    return build_cause(STEP, per_joint(after * np.ones_like(seen.observed)), ZERO_STEP_STD)


def _support_torques(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Array]:
    """Yield joint torques (k, m), N m, of each unit support force; each force acts in one block of a drag only."""
    for block in np.flatnonzero(pressed.slides).tolist():
        maps, way = seen.maps[block], pressed.way[block]
        # Normal force with its friction, lateral force, and three moments.
        sideways = np.cross(UP, way)
        forces = maps[:, :3] @ np.column_stack([UP - about * way, sideways])
        for torque in (*forces.T, *maps[:, 3:].T):
            alone = np.zeros_like(seen.observed)
            alone[block] = torque
            yield alone
