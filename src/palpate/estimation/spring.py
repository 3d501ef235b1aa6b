"""Compliant surface as a spring and damper, fitted to the loading curve; its coefficient of restitution.

The force of a press at the tip height z follows

    f = f0 + k max(z0 - z, 0) - m z'' - d z' + s r

f0 is a bias, k the stiffness, z0 the height of first contact, m the apparent mass of the arm. The damping d acts in
contact only. s is the joint friction as the arm comes to rest (r from 0 to 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.descent import BLOCK_ROWS, EASED, SOFT, SWING, UNSEEN, Descent, block_means
from palpate.estimation.drag_causes import GAIN_RATIO
from palpate.estimation.estimate import FitView
from palpate.estimation.joint_friction import CURVE_ROWS
from palpate.estimation.load_equations import FORCE_BIAS
from palpate.estimation.motion import Mask
from palpate.estimation.wrench_observation import force_gain
from palpate.trace.recording import NominalHand

FALLING_MASS = 1.0
"""kg. Mass of the body for which the restitution is stated. Sensitive: no, by definition."""


def restitution(zeta: float) -> float:
    """Coefficient of restitution at a damping ratio `zeta`: speed after contact over speed before.

    A negative `zeta`, by measurement errors, continues the curve by its tangent 1 - pi zeta.
    """
    if zeta < 0.0:
        return 1.0 - float(np.pi) * zeta
    if zeta < 1.0:
        root = float(np.sqrt(1.0 - zeta**2))
        # Underdamped: contact time multiplied by omega, from the branch of the arc tangent in (0, pi).
        contact = float(np.arctan2(2.0 * zeta * root, 2.0 * zeta**2 - 1.0)) / root
        return float(np.exp(-zeta * contact))
    # Overdamped, with the limit at critical damping kept finite.
    root = float(np.sqrt(max(zeta**2 - 1.0, 1e-12)))
    contact = float(np.log((zeta + root) / (zeta - root))) / root
    return float(np.exp(-zeta * contact))


def damping_ratio(stiffness: float, damping: float, mass: float = FALLING_MASS) -> float:
    """Damping ratio of a `mass`, kg, on a spring, N/m, with a damper, N s/m."""
    return damping / (2.0 * float(np.sqrt(stiffness * mass)))


# Compliant surface: fit to the whole loading curve of a guarded descent


FREE_SLOPE_STD = 0.5
"""N/m (1 sigma). Error of the force trend of free air, extrapolated into the contact. Sensitive: stiffness below 200
N/m, std ×0.7–1.6."""
POSTURE = 0.2
"""m of descent over which the force of joint friction, beyond the force repeatability, changes by its full size
(1 sigma): levers are some tenths of a metre. Sensitive: stiffness below 500 N/m, std of arms with joint friction."""
RUBBED = 0.3
"""Relative error (1 sigma) of the predicted force of joint friction. Friction changes by some tenth with place, load
and motion, and unmodelled gravity with the posture. Sensitive: stiffness below 500 N/m, std of arms with joint
friction."""
CONTRADICTS = 3.0
"""Standard deviations by which the depth at rest must exceed the loading curve's to contradict it. Friction that varies
in free air resembles an early first contact. Sensitive: of 52 rigid tables at `measured`, two counted as compliant at
1, one at 3."""
ALIKE = 3.0
"""Rows of a descent per independent row: the torque signal is correlated, and the model omits the arm's oscillation.
Sensitive: stiffness std ×0.8–1.3."""
APART_IN_TIME = 2.6e-3
"""s (1 sigma). Delay between force and motion of a sample: a cycle of 1 ms and a filter of 100 Hz, 1.6 ms. A delayed
spring force resembles damping. Sensitive: damping std above 3 kN/m."""
FRICTION_SLOWS = 0.15
"""Relative change (1 sigma) of joint friction between the start of a motion and its end in a press. Static over
dynamic friction is 1.1, and friction changes with place by 0.1 to 0.25 (noise models `hardware`, `measured`).
Sensitive: damping std ×1.1–2.0 of arms with joint friction."""
ENCODER_WAVE = 0.4
"""Encoder ripple (1 sigma) within a press, as a fraction of the pose repeatability. It adds an error to the spring
force. Sensitive: damping std above 2 kN/m ×1.2–2.0."""
DAMPED = 0.1
"""Relative error (1 sigma) of a damping. Pads and their contact act in series with the surface, and a pyramidal
friction cone yields up to a quarter less. Sensitive: damping std ×1.0–1.3."""
WILD = 6.0
"""Standard deviations from the running median beyond which a sample is rejected. Sensitive: no."""
RESTING_SPEED = 0.002
"""m/s. Speed below which joint friction begins to relax. Sensitive: stiffness hardly."""
ARM_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma. Apparent vertical mass at the TCP, wide enough for any seven-axis arm. Sensitive: stiffness
hardly."""
DISSIPATING_MASS = 1.0
"""kg. The critical damping of this mass on the surface is the 1 sigma of the damping. Sensitive: stiffness hardly."""
STIFFEST = 1e9
"""N/m (1 sigma) of a surface: an uninformative prior. Sensitive: no."""
WEAKEST = 1.0
"""N/m. Smallest stiffness: 8 N would press such a surface 8 m deep. It keeps the compliance finite. Sensitive: no."""
SEARCHES = (25, 25, 25, 25)
"""Number of heights of first contact tried in each round. Each round surrounds the best of the last, to a thousandth
of a millimetre within 20 mm. Sensitive: no."""
HARDENS = 1.0 / 3.0
"""Relative change of stiffness over the depth up to which one number describes a spring. Sensitive: no."""
BEYOND_DOUBT = 4.0
"""Standard deviations beyond which a surface certainly hardens at some depth, or flows. Sensitive: no."""
LOOKED_FOR = 3.0
"""Standard deviations by which the largest of many tried hardenings is off by chance. Sensitive: no."""
HINGES = 17
"""Number of depths, each a twentieth of the greatest apart, at which hardening is tested. Sensitive: no."""
VIEW_FREE_AIR = 0.25
"""Fraction of the depth that the chart of a press shows as free air. Sensitive: no."""

STIFFNESS, DAMPING = 1, 3
"""Indices of k and d among the unknowns."""


@dataclass(frozen=True, slots=True)
class Onset:
    """Model-free onset of contact in the loading curve."""

    first: float  # m, tip height at which the force began to rise
    first_std: float  # m, its standard deviation
    # m, tip height at which a soft layer reached a stiff support; None without such a support.
    bottomed: float | None
    secant: float  # m/N, compliance of the whole loading curve


@dataclass(frozen=True, slots=True, eq=False)
class Spring:
    """Spring and damper model of a surface, from one press."""

    compliance: float  # m/N, of the surface alone
    compliance_std: float  # its standard deviation
    # held, held_std: m/N, compliance at rest: depth of the resting tip below contact onset, over the force
    held: float
    held_std: float
    damping: float  # N s/m, of the surface; negative only by noise
    damping_std: float  # its standard deviation
    first: float  # m, tip height of first contact
    depth: Array  # (n,) m below `first` in each row used
    bearing: Array  # (n,) N, force of the spring, without inertia, friction and damping
    sinking: Array  # (n,) m/s, downward speed of the tip
    drag: Array  # (n,) N, force of the damping
    hardening: float  # largest relative growth of the stiffness beyond some depth
    hardening_std: float  # its standard deviation

    @property
    def deepest(self) -> float:
        """m, greatest fitted depth of the tips below first contact, surface and fingertips together."""
        return float(self.depth.max())

    @property
    def unevenness(self) -> float:
        """Test statistic of a constant stiffness: above 1, hardening or softening is certain and too large."""
        size = abs(self.hardening)
        return min(size / HARDENS, size / self.hardening_std / BEYOND_DOUBT)

    @property
    def flow(self) -> float:
        """Excess of the depth at rest over that of a spring, in standard deviations."""
        doubt = float(np.hypot(self.held_std, self.compliance_std))
        return (self.held - self.compliance) / doubt

    def at_most(self, sigmas: float) -> float:
        """Upper bound of the compliance, m/N, at the given number of standard deviations."""
        # The whole curve decides, unless the depth at rest contradicts it: a flowing surface sinks deeper.
        curve = self.compliance + sigmas * self.compliance_std
        deeper = self.held - CONTRADICTS * self.held_std
        return min(max(curve, deeper), self.held + sigmas * self.held_std)

    def at_least(self, sigmas: float) -> float:
        """Lower bound of the compliance, m/N, at the given number of standard deviations."""
        curve = self.compliance - sigmas * self.compliance_std
        return max(curve, self.held - CONTRADICTS * self.held_std)


@dataclass(frozen=True, eq=False)
class _Curve:
    """Loading curve of a descent, with the terms of the model that do not depend on z0.

    Acceleration is noisy, so every row is a mean over `CURVE_ROWS` on both sides of the equation. This keeps the
    simultaneous jump of force and acceleration at the contact with a dissipating surface.
    """

    z: Array  # (n,) m, tip height
    force: Array  # (n,) N, without predicted joint friction
    # speed, acceleration: (n,) m/s, m/s², vertical
    speed: Array
    acceleration: Array
    resting: Array  # (n,) 0 to 1, degree of rest
    rows: Mask  # (n,) mask of the m rows used
    noise: float  # N, of a row
    prior: Array  # (5,) prior standard deviations of f0, k, m, d, s
    believed: Array  # (5,) prior means

    @cached_property
    def felt(self) -> Array:
        """(m,) N, smoothed `force` in the rows used."""
        return self.mean(self.force)

    def design(self, first: float) -> Array:
        """Design matrix (m, 5): force per unit of f0, k, m, d and s."""
        depth = np.maximum(first - self.z, 0.0)
        drag = -self.speed * (depth > 0.0)
        columns = (depth, -self.acceleration, drag, self.resting)
        return np.column_stack([np.ones(int(self.rows.sum())), *map(self.mean, columns)])

    def mean(self, column: Array) -> Array:
        """Moving averages (m,) of a column (n,), in the rows used."""
        # Repeat the end values, so that the average keeps its length.
        half = CURVE_ROWS // 2
        ends = np.concatenate([np.repeat(column[0], half), column, np.repeat(column[-1], half)])
        window = np.full(CURVE_ROWS, 1.0 / CURVE_ROWS)
        return np.convolve(ends, window, mode="valid")[self.rows]

    def solve(self, first: float) -> tuple[Array, float]:
        """Solve for the unknowns (5,) at a height `first` of first contact, m; also return the sum of squares."""
        design = self.design(first)
        found, squares = self._least_squares(design)
        if found[DAMPING] >= 0.0:
            return found, squares
        # A surface dissipates and cannot drive the hand: solve again without damping.
        design[:, DAMPING] = 0.0  # a surface dissipates, it does not drive the hand
        return self._least_squares(design)

    def part(self, one: int, found: Array, first: float) -> Array:
        """Force (m,), N, of one of the unknowns `found` (5,), plus the residual of the fit."""
        others = found.copy()
        others[one] = 0.0
        return self.felt - self.design(first) @ others

    def _least_squares(self, design: Array) -> tuple[Array, float]:
        """Bayesian least squares for a design (m, 5): the unknowns (5,) and the sum of squares."""
        # Normal equations with normal priors.
        precision = np.diag(self.prior**-2.0)
        normal = design.T @ design / self.noise**2 + precision
        right = design.T @ self.felt / self.noise**2 + precision @ self.believed
        found = np.linalg.solve(normal, right).astype(np.float64)
        misfit = (self.felt - design @ found) / self.noise
        off = (found - self.believed) / self.prior
        return found, float(misfit @ misfit + off @ off)

    def variances(self, found: Array, first: float) -> Array:
        """Variances (6,) of f0, k, m, d, s and z0."""
        design = self.design(first)
        # Derivative of the force by z0: the stiffness in the rows in contact.
        edge = found[STIFFNESS] * (design[:, STIFFNESS] > 0.0)
        full = np.column_stack([design, edge]) / self.noise
        precision = np.diag([*self.prior**-2.0, 0.0])
        # Neighbouring rows are correlated.
        normal = full.T @ full / ALIKE + precision
        return np.diag(np.linalg.inv(normal)).astype(np.float64)

    def damping(self, first: float) -> float:
        """Damping d of either sign, N s/m."""
        found, _ = self._least_squares(self.design(first))
        return float(found[DAMPING])


def fit_spring(descent: Descent, onset: Onset, hand: NominalHand) -> Spring:
    """Fit the spring that a descent pressed on, above a stiffer support below it if there is one.

    The standard deviation combines the fit with joint friction at the stop, sensor gains, and the change of force
    with place. It also contains the certain change of stiffness with depth, and the error of the pads.
    """
    # Nonlinear in z0 alone: search z0, with a linear fit of the other unknowns at each.
    curve = _curve(descent, onset, hand)
    first = _first(descent, onset, curve)
    found, _ = curve.solve(first)
    stiffness = max(float(found[STIFFNESS]), WEAKEST)
    variances = curve.variances(found, first)
    relative = np.sqrt(variances[STIFFNESS]) / stiffness
    gain = GAIN_RATIO * force_gain(hand)
    total = 1.0 / stiffness
    # Slope errors of the force, N/m: the trend of free air may change on the way down, and joint friction changes
    # with the posture, predicted or not.
    rubs = max(abs(float(descent.set_out[2])) - 2.0 * hand.force_repeatability, 0.0)
    if descent.joint_friction.any():
        rubs *= RUBBED
    slopes = (FREE_SLOPE_STD, descent.slope / 2, rubs / POSTURE)
    slope = np.linalg.norm(slopes) / stiffness
    # Errors of the friction reversal, and test of a stiffness that grows with depth.
    reversing = RUBBED * float(np.std(descent.joint_friction[descent.onset :]))
    hardening, hardening_std = _hardening(
        curve, found, first, np.hypot(descent.wander[2], reversing)
    )
    # A change of the stiffness shifts the mean by half of it. A larger change contradicts a spring.
    certain = max(abs(hardening) - LOOKED_FOR * hardening_std, 0.0)
    uneven = min(certain, HARDENS) / 2
    # Relative to the force of the spring alone: a stiff support below carries the rest.
    wander = descent.wander[2] / (stiffness * float(curve.design(first)[:, STIFFNESS].max()))
    shares = total * np.array([relative, gain, slope, wander, uneven])
    std = np.linalg.norm([*shares, hand.tip_compliance_std])
    # Damping: drift of the free-air force, delay, friction and ripple while the tip sinks all resemble it.
    sinking = max(float(-np.median(curve.speed[curve.z > first])), RESTING_SPEED)
    damping = curve.damping(first)
    drags = (
        np.sqrt(variances[DAMPING]),
        descent.wander[2] / sinking,
        APART_IN_TIME * stiffness,
        reversing / sinking,
        FRICTION_SLOWS * abs(float(descent.set_out[2])) / sinking,
        ENCODER_WAVE * hand.pose_repeatability * stiffness / sinking,
        np.hypot(DAMPED, GAIN_RATIO * force_gain(hand)) * damping,
    )
    # Error of the compliance at rest: the onset height and the friction at the stop, over the whole force.
    at_rest = np.array([onset.first_std, descent.friction * onset.secant]) / descent.full
    return Spring(
        total - hand.tip_compliance,
        float(std),
        onset.secant - hand.tip_compliance,
        float(np.linalg.norm([*at_rest, hand.tip_compliance_std])),
        damping,
        float(np.linalg.norm(drags)),
        first,
        first - curve.mean(curve.z),
        curve.part(STIFFNESS, found, first),
        curve.design(first)[:, DAMPING],
        curve.part(DAMPING, found, first),
        hardening,
        hardening_std,
    )


def spring_view(spring: Spring, compliance: float, tips: float, start: float) -> FitView:
    """View of a press that began at `start`, s: the spring force over depth.

    `compliance` is that estimated for the surface, `tips` that of the fingertips, both in m/N.
    """
    # Show the contact and a little of the free air before it.
    shown = spring.depth > -VIEW_FREE_AIR * spring.depth.max()
    depth = spring.depth[shown]
    # Surface and fingertips in series: k = 1 / (c + c_tips). Its derivative by the surface's 1 / c is (k c)².
    stiffness = 1.0 / (compliance + tips)
    pressed = 1e3 * np.maximum(depth, 0.0)
    most = float(pressed.max())
    alone = (
        f"{1.0 / spring.compliance:.0f} N/m" if spring.compliance > 0.0 else "no measurable depth"
    )
    return FitView(
        name=f"The press at {start:.1f} s.",
        note=f"Both fingertips pressed {most:.2f} mm deep; this press alone shows {alone}. "
        "The arm's inertia and friction and what the surface dissipates are taken out of the force.",
        axes=("depth of the fingertips (mm)", "force of the spring (N)"),
        x=1e3 * depth,
        measured=spring.bearing[shown],
        predicted=1e-3 * stiffness * pressed,
        slopes=(1e-3 * (stiffness * compliance) ** 2 * pressed)[:, None],
    )


def damping_view(spring: Spring, damping: float, start: float, slope: float = 1.0) -> FitView:
    """View of a press that began at `start`, s: the damping force over speed.

    `damping` is the estimate for the surface, N s/m; `slope` its derivative by the component of the estimate.
    """
    # Rows in contact.
    pressing = spring.depth > 0.0
    sinking = spring.sinking[pressing]
    return FitView(
        name=f"The press at {start:.1f} s.",
        note=f"The fingertips sank in with {1e3 * float(sinking.max(initial=0.0)):.1f} mm/s and came to rest; this "
        f"press alone shows {spring.damping:.0f} N·s/m. The spring and the arm's inertia and friction are taken "
        "out of the force.",
        axes=("speed of the fingertips (mm/s)", "force that comes with it (N)"),
        x=1e3 * sinking,
        measured=spring.drag[pressing],
        predicted=damping * sinking,
        slopes=(slope * sinking)[:, None],
    )


def _hardening(curve: _Curve, found: Array, first: float, wander: float) -> tuple[float, float]:
    """Relative growth of the stiffness from the depth that explains most of the residuals, and its std.

    This is an F-test of one additional slope at an unknown depth (Hudson 1966), in block means. The noise is that
    of the residuals of the two-slope fit, at least the `wander` in free air, N. A curve that is rough everywhere,
    by delays and outliers, then does not count as hardening.
    """
    design = curve.design(first)
    # Columns of the fitted model, linearised in z0, and the smallest noise of a block mean.
    depth = design[:, STIFFNESS]
    edge = found[STIFFNESS] * (depth > 0.0)
    chance = float(np.hypot(curve.noise * np.sqrt(ALIKE / BLOCK_ROWS), wander))
    # Append the priors as rows, and remove the model from the residuals.
    beliefs = np.diag(np.append(chance / curve.prior, 0.0))
    known = np.vstack([block_means(np.column_stack([design, edge])), beliefs])
    nothing = np.zeros(len(beliefs))
    left = orthogonal_part(known, np.append(block_means(curve.felt - design @ found), nothing))
    pressing = block_means(depth) > 0.0
    best, most = (0.0, np.inf), 0.0
    # Try a hinge at each depth: regress the residuals on the additional slope, orthogonal to the model.
    for share in np.linspace(0.1, 0.9, HINGES):
        further = np.maximum(depth - share * depth.max(), 0.0)
        steeper = orthogonal_part(known, np.append(block_means(further), nothing))
        size = float(steeper @ steeper)
        if size <= UNSEEN**2:
            continue
        grows = float(steeper @ left) / size
        if grows**2 * size <= most:
            continue
        # Noise of the pressing blocks after the additional slope gives the standard deviation.
        most, noise = grows**2 * size, (left - grows * steeper)[: len(pressing)][pressing]
        spread = max(float(np.sqrt(noise @ noise / max(len(noise) - 4, 1))), chance)
        best = (grows / found[STIFFNESS], spread / np.sqrt(size) / found[STIFFNESS])
    return best


def orthogonal_part(known: Array, column: Array) -> Array:
    """Component of a column (n,) orthogonal to the columns of `known` (n, m), by least squares."""
    share = np.linalg.lstsq(known, column, rcond=None)[0].astype(np.float64)
    return column - known @ share


def _curve(descent: Descent, onset: Onset, hand: NominalHand) -> _Curve:
    """Build the loading curve of a descent, with the priors of the unknowns."""
    # Noise, vertical motion, and the degree of rest in contact.
    noise = float(np.hypot(descent.noise, hand.force_resolution))
    samples, rows = descent.samples, _rows(descent, onset, noise)
    speed = samples.twist[:, 2]
    acceleration = np.gradient(speed, samples.t)
    contact = np.arange(len(samples)) > descent.onset
    resting = contact * np.clip(1.0 - np.abs(speed) / RESTING_SPEED, 0.0, 1.0)
    # Priors: apparent mass of the arm, friction at the stop, critical damping of a reference mass.
    apparent, spread = ARM_MASS
    stick = float(np.hypot(hand.force_repeatability, descent.set_out[2]))
    dissipated = 2.0 * (DISSIPATING_MASS / max(onset.secant, UNSEEN)) ** 0.5
    return _Curve(
        descent.z,
        descent.force - descent.joint_friction,
        speed,
        acceleration,
        resting,
        rows,
        noise=noise,
        prior=np.array([FORCE_BIAS, STIFFEST, spread, dissipated, stick]),
        believed=np.array([0.0, 0.0, apparent, 0.0, 0.0]),
    )


def _rows(descent: Descent, onset: Onset, noise: float) -> Mask:
    """Rows of the loading curve, from the start of the motion.

    Outliers and the rows on a stiff support below a soft layer are excluded. A probe that was eased ends at its
    greatest force, as joint friction reverses there.
    """
    samples = descent.samples
    # Drop the oscillation at the start of the motion, and outliers.
    rows = samples.t > descent.leaf.start + SWING
    rows &= np.abs(descent.force - descent.smooth) < WILD * noise
    # A probe that was eased ends at its greatest force.
    target = samples.target_world_tcp[:, 2]
    if target[-1] - target.min() > EASED:
        rows &= np.arange(len(rows)) <= int(np.argmax(descent.smooth))
    # Rows on a stiff support below a soft layer do not belong to the spring.
    if onset.bottomed is None:
        return rows
    return rows & (descent.z > onset.bottomed)


def _first(descent: Descent, onset: Onset, curve: _Curve) -> float:
    """Height of first contact, m, with the least sum of squares, by a nested grid search."""
    # First grid: from the resting tip to half of the depth above the apparent onset.
    held = descent.held
    depth = max(onset.first - held, UNSEEN)
    low, high = held, min(onset.first + max(depth / 2, SOFT), float(descent.z.max()))
    best = onset.first
    # Each further grid spans the two neighbours of the best height.
    for candidates in SEARCHES:
        heights = np.linspace(low, high, candidates)
        sums = [curve.solve(float(height))[1] for height in heights]
        best, step = float(heights[int(np.argmin(sums))]), float(heights[1] - heights[0])
        low, high = best - step, best + step
    return best
