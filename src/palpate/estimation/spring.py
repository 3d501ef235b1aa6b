"""Compliant surface as a spring, fitted to the loading curve; its coefficient of restitution."""

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
from palpate.trace.recording import NominalHand

FALLING_MASS = 1.0
"""kg of the body whose rebound is stated. Sensitive: no, by definition."""


def restitution(zeta: float) -> float:
    """Speed after over speed before the contact, at a damping ratio `zeta`. Below zero, where only errors lead, it is
    continued by its tangent, 1 - pi zeta."""
    if zeta < 0.0:
        return 1.0 - float(np.pi) * zeta
    if zeta < 1.0:
        root = float(np.sqrt(1.0 - zeta**2))
        # The time of contact times omega; of both branches of the arc tangent the one in (0, pi).
        contact = float(np.arctan2(2.0 * zeta * root, 2.0 * zeta**2 - 1.0)) / root
        return float(np.exp(-zeta * contact))
    root = float(np.sqrt(max(zeta**2 - 1.0, 1e-12)))
    contact = float(np.log((zeta + root) / (zeta - root))) / root
    return float(np.exp(-zeta * contact))


def damping_ratio(stiffness: float, damping: float, mass: float = FALLING_MASS) -> float:
    """Damping ratio of `mass`, kg, on a spring, N/m, and a damper, N s/m."""
    return damping / (2.0 * float(np.sqrt(stiffness * mass)))


# Compliant surface as a spring, fitted to the whole loading curve of a guarded descent.


FREE_SLOPE_STD = 0.5
"""N/m (1 sigma): how well the change of the force on the way down is known to go on. Sensitive: stiffness below 200
N/m, std ×0.7–1.6."""
POSTURE = 0.2
"""m of descent over which what the joints' friction makes of a force, beyond what a force repeats to, becomes
another (1 sigma of all of it): levers are some tenths of a metre. Sensitive: stiffness below 500 N/m, std of arms
whose joints rub."""
RUBBED = 0.3
"""part (1 sigma) of that where it is foreseen, joint by joint: friction changes by some tenth with the place, the
load and from one motion to another, and gravity that a model leaves with the posture. Sensitive: stiffness below 500
N/m, std of arms whose joints rub."""
CONTRADICTS = 3.0
"""standard deviations by which the depth of the held tip must exceed what the loading curve says of it, to count
against it: friction that wanders in free air passes for an early first contact. Sensitive: of 52 rigid tables at
`measured` two were taken for compliant ones at 1, one at 3."""
ALIKE = 3.0
"""rows of a descent per independent one: the torque sensors' signal wanders, and the model leaves the arm's swing
out. Sensitive: stiffness std ×0.8–1.3."""
APART_IN_TIME = 2.6e-3
"""s (1 sigma) by which force and motion of a sample are apart: a cycle of 1 ms, and a filter of 100 Hz, 1.6 ms. A
spring's force that comes late is damping. Sensitive: damping std above 3 kN/m."""
FRICTION_SLOWS = 0.15
"""part (1 sigma) of the friction that joints show as the arm sets out, by which it is another as they slow down in a
press: static over dynamic friction is 1.1, and friction changes with the place by 0.1 to 0.25 (noise models `hardware`,
`measured`). Sensitive: damping std ×1.1–2.0 of arms whose joints rub."""
ENCODER_WAVE = 0.4
"""part of a pose's repeatability by which encoders ripple within a press (1 sigma): a spring's force that is as much
off. Sensitive: damping std above 2 kN/m ×1.2–2.0."""
DAMPED = 0.1
"""part (1 sigma) of a damping: pads and their contact give way in series with the surface, and a pyramidal cone gives
up to a quarter less. Sensitive: damping std ×1.0–1.3."""
WILD = 6.0
"""standard deviations of the noise off its running median from which a sample is left out. Sensitive: no."""
RESTING_SPEED = 0.002
"""m/s below which the joints' friction begins to let go. Sensitive: stiffness hardly."""
ARM_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma: apparent vertical mass at the TCP, wide enough for any seven-axis arm. Sensitive: stiffness
hardly."""
DISSIPATING_MASS = 1.0
"""kg, whose critical damping on the surface is the 1 sigma of what it dissipates. Sensitive: stiffness hardly."""
STIFFEST = 1e9
"""N/m (1 sigma) of a surface: nothing is known of it. Sensitive: no."""
WEAKEST = 1.0
"""N/m: a surface that 8 N press 8 m down is none; it keeps a compliance finite. Sensitive: no."""
SEARCHES = (25, 25, 25, 25)
"""places of the first contact that are tried in each of several rounds, the next one about the best of the last: to
a thousandth of a millimetre within 20 mm. Sensitive: no."""
HARDENS = 1.0 / 3.0
"""part by which a spring's stiffness may change on the way and still be one number. Sensitive: no."""
BEYOND_DOUBT = 4.0
"""standard deviations of what is certain of a spring: that it hardens somewhere, wherever that is looked for, or
flows. Sensitive: no."""
LOOKED_FOR = 3.0
"""standard deviations by which the largest of so many hardenings is off by chance. Sensitive: no."""
HINGES = 17
"""depths, every twentieth of the greatest, from which on a surface may be stiffer. Sensitive: no."""
VIEW_FREE_AIR = 0.25
"""part of the depth: so much free air a chart of a press shows. Sensitive: no."""

STIFFNESS, DAMPING = 1, 3
"""Places of k and d among the unknowns."""


@dataclass(frozen=True, slots=True)
class Onset:
    """Onset of contact as the loading curve shows it, without a model.

    Attributes:
        first: m, tip height at which the force began to rise, with its standard deviation.
        bottomed: m, tip height at which something soft had been pressed through; None without such.
        secant: m/N, of the whole loading curve.
    """

    first: float
    first_std: float
    bottomed: float | None
    secant: float


@dataclass(frozen=True, slots=True, eq=False)
class Spring:
    """A surface as a spring.

    Attributes:
        compliance: m/N, of the surface alone, with its standard deviation.
        held, held_std: m/N, the same at rest: depth of the held tip below the onset of the force, over the
            force.
        damping: N s/m, of the surface; below zero by noise alone.
        damping_std: its standard deviation.
        first: m, tip height of the first contact.
        depth, bearing: (n,) m below `first` and N in each row used; of the force, the spring's part, without
            what inertia, friction and damping make of it.
        sinking, drag: (n,) m/s at which the tip sinks in, and N of the force in each row used that comes with it.
        hardening: largest relative growth of the stiffness from some depth on, with its standard deviation.
    """

    compliance: float
    compliance_std: float
    held: float
    held_std: float
    damping: float
    damping_std: float
    first: float
    depth: Array
    bearing: Array
    sinking: Array
    drag: Array
    hardening: float
    hardening_std: float

    @property
    def deepest(self) -> float:
        """m of depth, of all that presses, up to which the spring was fitted."""
        return float(self.depth.max())

    @property
    def unevenness(self) -> float:
        """Statistic of a test of one spring: above 1 it certainly hardens or softens by too much."""
        size = abs(self.hardening)
        return min(size / HARDENS, size / self.hardening_std / BEYOND_DOUBT)

    @property
    def flow(self) -> float:
        """Standard deviations by which the tip is held deeper at rest than a spring allows."""
        doubt = float(np.hypot(self.held_std, self.compliance_std))
        return (self.held - self.compliance) / doubt

    def at_most(self, sigmas: float) -> float:
        """Upper bound of the compliance, m/N, at the given number of standard deviations."""
        # From the whole curve, unless the held force contradicts it: a surface that flows is held deeper.
        curve = self.compliance + sigmas * self.compliance_std
        deeper = self.held - CONTRADICTS * self.held_std
        return min(max(curve, deeper), self.held + sigmas * self.held_std)

    def at_least(self, sigmas: float) -> float:
        """Lower bound of the compliance, m/N, likewise."""
        curve = self.compliance - sigmas * self.compliance_std
        return max(curve, self.held - CONTRADICTS * self.held_std)


@dataclass(frozen=True, eq=False)
class _Curve:
    """A descent, with the columns of the model that do not depend on z0.

    Acceleration is noisy, so every row is a mean over `CURVE_ROWS`, on both sides of the equation: the jump of force
    and acceleration as a surface that dissipates is met is one still.

    Attributes:
        z, force: (n,) m, N.
        speed, acceleration: (n,) m/s, m/s².
        resting: (n,) 0 to 1.
        rows: (n,) rows of the descent that count.
        noise: N, of a row.
        prior: (5,) prior standard deviations of f0, k, m, d, s.
        believed: (5,) prior means.
    """

    z: Array
    force: Array
    speed: Array
    acceleration: Array
    resting: Array
    rows: Mask
    noise: float
    prior: Array
    believed: Array

    @cached_property
    def felt(self) -> Array:
        """(m,) N, the rows of `force` that count."""
        return self.mean(self.force)

    def design(self, first: float) -> Array:
        """(m, 5) force per unit of f0, k, m, d and s."""
        depth = np.maximum(first - self.z, 0.0)
        drag = -self.speed * (depth > 0.0)
        columns = (depth, -self.acceleration, drag, self.resting)
        return np.column_stack([np.ones(int(self.rows.sum())), *map(self.mean, columns)])

    def mean(self, column: Array) -> Array:
        """(m,) means over neighbours of a column (n,), where the rows count."""
        half = CURVE_ROWS // 2
        ends = np.concatenate([np.repeat(column[0], half), column, np.repeat(column[-1], half)])
        window = np.full(CURVE_ROWS, 1.0 / CURVE_ROWS)
        return np.convolve(ends, window, mode="valid")[self.rows]

    def solve(self, first: float) -> tuple[Array, float]:
        """Solve for the other unknowns (5,) at a height of the first contact; returns the sum of squares, too."""
        design = self.design(first)
        found, squares = self._least_squares(design)
        if found[DAMPING] >= 0.0:
            return found, squares
        design[:, DAMPING] = 0.0  # a surface dissipates, it does not drive the hand
        return self._least_squares(design)

    def part(self, one: int, found: Array, first: float) -> Array:
        """(m,) N of the force that one of the unknowns `found` (5,) makes, with what the model leaves."""
        others = found.copy()
        others[one] = 0.0
        return self.felt - self.design(first) @ others

    def _least_squares(self, design: Array) -> tuple[Array, float]:
        precision = np.diag(self.prior**-2.0)
        normal = design.T @ design / self.noise**2 + precision
        right = design.T @ self.felt / self.noise**2 + precision @ self.believed
        found = np.linalg.solve(normal, right).astype(np.float64)
        misfit = (self.felt - design @ found) / self.noise
        off = (found - self.believed) / self.prior
        return found, float(misfit @ misfit + off @ off)

    def variances(self, found: Array, first: float) -> Array:
        """(6,) variances of f0, k, m, d, s and z0."""
        design = self.design(first)
        edge = found[STIFFNESS] * (design[:, STIFFNESS] > 0.0)
        full = np.column_stack([design, edge]) / self.noise
        precision = np.diag([*self.prior**-2.0, 0.0])
        # Neighbouring rows are correlated.
        normal = full.T @ full / ALIKE + precision
        return np.diag(np.linalg.inv(normal)).astype(np.float64)

    def damping(self, first: float) -> float:
        """Damping d without regard to its sign, N s/m."""
        found, _ = self._least_squares(self.design(first))
        return float(found[DAMPING])


def fit_spring(descent: Descent, onset: Onset, hand: NominalHand) -> Spring:
    """Fit the spring that a descent pressed on, above a stiffer support below it if there is one.

    The standard deviation contains that of the fit with the friction of the joints as the arm stops, gains of
    the sensors, change and wander of the force with the place, certain changes of the stiffness with the
    depth, and the uncertainty of the pads.
    """
    curve = _curve(descent, onset, hand)
    first = _first(descent, onset, curve)
    found, _ = curve.solve(first)
    stiffness = max(float(found[STIFFNESS]), WEAKEST)
    variances = curve.variances(found, first)
    relative = np.sqrt(variances[STIFFNESS]) / stiffness
    gain = GAIN_RATIO * hand.torque_gain
    total = 1.0 / stiffness
    # The trend of free air may differ on the way through, and joint friction is another force in another
    # posture, whether predicted or not.
    rubs = max(abs(float(descent.set_out[2])) - 2.0 * hand.force_repeatability, 0.0)
    if descent.joint_friction.any():
        rubs *= RUBBED
    slopes = (FREE_SLOPE_STD, descent.slope / 2, rubs / POSTURE)
    slope = np.linalg.norm(slopes) / stiffness
    reversing = RUBBED * float(np.std(descent.joint_friction[descent.onset :]))
    hardening, hardening_std = _hardening(
        curve, found, first, np.hypot(descent.wander[2], reversing)
    )
    # A change of the stiffness is half of it off the mean; with a larger change it is no spring.
    certain = max(abs(hardening) - LOOKED_FOR * hardening_std, 0.0)
    uneven = min(certain, HARDENS) / 2
    # Of the force of the spring alone: a stiff support below bears the rest.
    wander = descent.wander[2] / (stiffness * float(curve.design(first)[:, STIFFNESS].max()))
    shares = total * np.array([relative, gain, slope, wander, uneven])
    std = np.linalg.norm([*shares, hand.tip_compliance_std])
    # What the force in free air wanders by as the tip sinks in is taken for damping.
    sinking = max(float(-np.median(curve.speed[curve.z > first])), RESTING_SPEED)
    damping = curve.damping(first)
    drags = (
        np.sqrt(variances[DAMPING]),
        descent.wander[2] / sinking,
        APART_IN_TIME * stiffness,
        reversing / sinking,
        FRICTION_SLOWS * abs(float(descent.set_out[2])) / sinking,
        ENCODER_WAVE * hand.pose_repeatability * stiffness / sinking,
        np.hypot(DAMPED, GAIN_RATIO * hand.torque_gain) * damping,
    )
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
    """Press that began at `start`, s, against the estimated `compliance` of the surface and that of the
    fingertips, m/N."""
    shown = spring.depth > -VIEW_FREE_AIR * spring.depth.max()
    depth = spring.depth[shown]
    # Surface and fingertips in series: k = 1 / (c + c_tips); by the surface's 1 / c it grows with (k c)².
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
    """Press that began at `start`, s, against the estimated `damping` of the surface, N s/m; `slope`: change of
    that with the component of the estimate."""
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
    """Relative growth of the stiffness from the depth at which it explains most of the residuals, and its
    standard deviation: an F-test of one more slope (Hudson 1966), in means over some rows.

    The noise is that of the residuals of the two slopes, at least that in free air `wander`, so that a curve
    which is rough all over, by delays and wild samples, does not count as hardening.
    """
    design = curve.design(first)
    depth = design[:, STIFFNESS]
    edge = found[STIFFNESS] * (depth > 0.0)
    chance = float(np.hypot(curve.noise * np.sqrt(ALIKE / BLOCK_ROWS), wander))
    # Priors count as further rows.
    beliefs = np.diag(np.append(chance / curve.prior, 0.0))
    known = np.vstack([block_means(np.column_stack([design, edge])), beliefs])
    nothing = np.zeros(len(beliefs))
    left = orthogonal_part(known, np.append(block_means(curve.felt - design @ found), nothing))
    pressing = block_means(depth) > 0.0
    best, most = (0.0, np.inf), 0.0
    for share in np.linspace(0.1, 0.9, HINGES):
        further = np.maximum(depth - share * depth.max(), 0.0)
        steeper = orthogonal_part(known, np.append(block_means(further), nothing))
        size = float(steeper @ steeper)
        if size <= UNSEEN**2:
            continue
        grows = float(steeper @ left) / size
        if grows**2 * size <= most:
            continue
        most, noise = grows**2 * size, (left - grows * steeper)[: len(pressing)][pressing]
        spread = max(float(np.sqrt(noise @ noise / max(len(noise) - 4, 1))), chance)
        best = (grows / found[STIFFNESS], spread / np.sqrt(size) / found[STIFFNESS])
    return best


def orthogonal_part(known: Array, column: Array) -> Array:
    """Component of a column (n,) orthogonal to the columns `known` (n, m)."""
    share = np.linalg.lstsq(known, column, rcond=None)[0].astype(np.float64)
    return column - known @ share


def _curve(descent: Descent, onset: Onset, hand: NominalHand) -> _Curve:
    noise = float(np.hypot(descent.noise, hand.force_resolution))
    samples, rows = descent.samples, _rows(descent, onset, noise)
    speed = samples.twist[:, 2]
    acceleration = np.gradient(speed, samples.t)
    contact = np.arange(len(samples)) > descent.onset
    resting = contact * np.clip(1.0 - np.abs(speed) / RESTING_SPEED, 0.0, 1.0)
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
    """Rows from the start of the motion to the end, without wild samples, without a stiff support below
    something soft, and until the greatest force of a probe that was eased, as joint friction reverses there."""
    samples = descent.samples
    rows = samples.t > descent.leaf.start + SWING
    rows &= np.abs(descent.force - descent.smooth) < WILD * noise
    target = samples.target_world_tcp[:, 2]
    if target[-1] - target.min() > EASED:
        rows &= np.arange(len(rows)) <= int(np.argmax(descent.smooth))
    if onset.bottomed is None:
        return rows
    return rows & (descent.z > onset.bottomed)


def _first(descent: Descent, onset: Onset, curve: _Curve) -> float:
    """Height of the first contact, m, with the least residuals."""
    held = descent.held
    depth = max(onset.first - held, UNSEEN)
    low, high = held, min(onset.first + max(depth / 2, SOFT), float(descent.z.max()))
    best = onset.first
    for candidates in SEARCHES:
        heights = np.linspace(low, high, candidates)
        sums = [curve.solve(float(height))[1] for height in heights]
        best, step = float(heights[int(np.argmin(sums))]), float(heights[1] - heights[0])
        low, high = best - step, best + step
    return best
