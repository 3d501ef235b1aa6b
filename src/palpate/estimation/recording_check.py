"""Test that a described arm explains the joint torques of a recording, with the likely cause of a failure.

One linear-Gaussian fit predicts the torques from the described links. Its unknowns are errors of link masses and
centres, a hand and a load up to the payload, friction, and sensor zeros. Three statistics are compared with limits:

- |residual|² + |unknowns / prior deviations|² (prior predictive check: G. Box, Journal of the Royal Statistical
  Society A 143, 1980),
- a Wald test of the gravity in the torques, a vector in base axes,
- masses on the hand.

The torques of a wrist are too small for these. So each joint is also fitted alone, for a dead, reversed or exchanged
one. If a test fails, each likely mistake is corrected in turn. The first correction that passes names the cause.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.arm_fit import (
    HAND_REACH,
    LINK_INERTIA,
    USUAL_FRICTION,
    VISCOUS_PRIOR,
    Bodies,
)
from palpate.estimation.arm_motion import LOG_GAP, SpectralNoise
from palpate.estimation.estimate import FitTest, chi_squared
from palpate.estimation.joint_causes import per_joint
from palpate.estimation.load_blocks import WHOLE_BLOCK, WHOLE_SLOW, Rows
from palpate.estimation.load_fit import LOAD_ITERATIONS
from palpate.estimation.motion import Mask
from palpate.estimation.regression import Cause, Posterior, fit
from palpate.estimation.rigid_bodies import load_torques, own_motion, regressor
from palpate.robots.description import RobotDescription
from palpate.trace.recording import ArmLog, Chain, NominalHand
from palpate.trace.samples import STANDARD_GRAVITY

CLAIM_TORQUE = 0.45
"""N m (1 sigma) of sensor zeros, of friction about its usual size, and of the residual. Real arms leave 0.05 to 0.3.
Sensitive: no wrong arm or unit passes at 0.3 to 0.5."""
CLAIM_SHARE = 0.02
"""Fraction of the gravity torque, added to `CLAIM_TORQUE`. Sensitive: no wrong arm or unit passes at 0.02 to 0.03."""
CLAIM_LINKS = (0.03, 3e-3)
"""Error (1 sigma) of a described link: fraction of its mass, and m of its centre. A real Panda passes as an FR3, an
iiwa 14 does not. Sensitive: no wrong arm or unit passes from half of it to 0.05 and 5 mm."""
CLAIM_GRAVITY = (0.015, 0.015, 0.03)
"""Tolerated fraction of gravity (1 sigma) along each base axis. Real arms show 0.02 horizontally, other arms 0.2 and
more. Sensitive: no wrong arm or unit passes at twice of it."""
CLAIM_MASS = 0.1
"""Fraction of the payload (1 sigma) by which a mass on the hand may exceed it. Sensitive: no."""
PARTS_OF_LOG, SAME_LOAD = 4, 0.03
"""Equal parts of a recording that are compared; kg (1 sigma) by which the mass on the hand may differ between them.
Real and simulated recordings reach 0.05 of the limit, a load of 0.5 kg more than twice. Sensitive: no."""
BEYOND_RANGE = 0.2
"""rad beyond a joint's range that are impossible: ranges of different makes differ by less. Sensitive: no."""
BEYOND_SPEED = 1.5
"""Factor on a joint's largest speed that is impossible, and on the ratio of velocities to the change of angles. Real
recordings differ by less than 1.01. Sensitive: no."""
MOVED = 1e-3
"""rad in 0.1 s above which velocities are compared with the change of angles. Sensitive: no."""

JOINT_GAIN, JOINT_EVIDENCE = 0.4, 5.0
"""Limits on the gain by another order or sign of joints: sum over joints of the logarithms of residuals, and that
times the seconds. Real and simulated recordings reach 0.4 of the smaller ratio. Sensitive: no."""
DEAD, DEAD_LEAST = 0.1, 0.05
"""Smallest ratio of the deviation of a torque to that of the described one; and N m, the largest deviation of a dead
torque, and the smallest described one. Real and simulated recordings show a ratio of 0.5. Sensitive: no."""
FROZEN = (1.0, 0.1)
"""s without a change of a joint's torque, and rad of its path in them, together impossible. Sensitive: no."""
POOR = 0.3
"""Ratio of a joint's residual to its torque from which other signs and places are tried. Sensitive: no."""
JOINT_PRIOR = np.array([1.0, USUAL_FRICTION, VISCOUS_PRIOR])
"""N m, N m and N m s/rad (1 sigma): offset, Coulomb and viscous friction of one joint. Sensitive: no."""
JOINT_NOISE, JOINT_LEAST = 0.1, 0.02
"""N m: residual of one joint's fit, and its smallest size that counts. Sensitive: no."""

HAND, LOAD = "hand", "load"
ROWS = 300
"""Largest number of block means in a test."""
JUMPS = 20
"""Smallest number of angle changes that count as a motion, not as jumps from rest to rest."""
STRONG, ALIKE, HEAVIER = 2, 10, 4
"""N m (rms) that show a joint's unit; largest ratio of two units; largest factor on the payload that is tried."""
UPRIGHT: Array = np.array([0.0, 0.0, -STANDARD_GRAVITY])
SIGN = "the torques have the opposite sign: negate them"
MOUNT = (
    "the base is mounted otherwise ({}): gravity acts along ({:.2f}, {:.2f}, {:.2f}) of its axes; state its pose by "
    "the site robot_base of a scene (scene=D.xml)"
)
UNIT = (
    "the torques are {} times what holds the arm up: give N m at the joints, not mN m, motor currents or torques "
    "before the gears"
)
REMOVED = (
    "the arm's own weight is not in the torques, as in external or commanded ones: give the sensed ones, gravity "
    "included (libfranka's tau_J)"
)
CHANGED = (
    "the hand carries a load in a part of the recording (in {} equal parts {} kg, relative to the first): give a part "
    "with the same mass on the hand"
)
PAYLOAD = "the hand carries more than the arm's payload of {:g} kg"
DEAD_JOINT = (
    "the torque of joint {} varies by {:.2g} N m, and its motion takes {:.2g} N m: its sensor or its column "
    "is dead"
)
SWAPPED = "joints are in another order: the {} logged for joints {} are those of joints {}"
REVERSED = "the {} of joint {} have the opposite sign: negate them"
UNKNOWN = (
    "no other sign, unit or mounting does. Its joints are in another order, something touches or loads it outside of "
    "the stated windows (loaded=A-B)"
)
OTHER = ", or the recording is of another arm (arm=NAME or a folder with its description)."


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """Joint signals at n times, and the arm that is claimed to have produced them."""

    t: Array  # (n,) s
    # q, dq, tau: (n, 7) rad, rad/s, N m; the torques include gravity
    q: Array
    dq: Array
    tau: Array
    loaded: Array  # (n,) 1 where a load is carried, else 0
    hand: NominalHand  # chain and payload of the arm
    gravity: Array  # (3,) m/s², in base axes

    @classmethod
    def of(
        cls,
        log: ArmLog,
        hand: NominalHand,
        gravity: Array,
        loaded: Mask,
        used: Mask,
        held: bool = False,
    ) -> Claim:
        """Build block means of a recording over `WHOLE_BLOCK`, at most `ROWS` of them.

        Only blocks whose rows are all `used` (n,) and all or none `loaded` (n,) count. `held` means that the
        torques exclude the gravity of the described arm.
        """
        # First row and row count of each block of `WHOLE_BLOCK` s.
        blocks = np.floor((log.t - log.t[0]) / WHOLE_BLOCK + 1e-6)
        starts = np.flatnonzero(np.diff(blocks, prepend=-1.0))
        counts = np.diff(np.append(starts, len(blocks)))

        def mean(signal: Array) -> Array:
            """Means of a signal over the blocks."""
            return np.add.reduceat(signal, starts) / counts.reshape(-1, *[1] * (signal.ndim - 1))

        # Select the uniform blocks, evenly over time if there are too many.
        share, whole = mean(loaded.astype(float)), mean(used.astype(float)) == 1.0
        rows = np.flatnonzero(whole & ((share == 0.0) | (share == 1.0)))
        if len(rows) > ROWS:
            rows = rows[np.linspace(0, len(rows) - 1, ROWS).astype(int)]
        # Torques logged without gravity get that of the described arm back.
        t, q, dq, tau = (mean(signal)[rows] for signal in (log.t, log.q, log.dq, log.tau))
        made = cls(t, q, dq, tau, share[rows], hand, gravity)
        return replace(made, tau=tau + made.holding(gravity)) if held else made

    @property
    def chain(self) -> Chain:
        """Kinematics and links of the arm."""
        assert self.hand.chain is not None
        return self.hand.chain

    def holding(self, gravity: Array) -> Array:
        """(n, 7) N m, gravity torques of the described links."""
        still = np.zeros_like(self.q)
        return own_motion(self.chain, self.q, still, still, gravity)


def explained(claim: Claim, is_steady: bool = False) -> FitTest:
    """Test that the described arm explains the torques; the finding names the likely mistake.

    `is_steady` claims that the mass on the hand is the same in all parts of the recording.
    """
    found = _test(claim)
    joints, ways = _find_joint_mistakes(claim, found.passed)
    load, steady = _find_load_change(claim) if is_steady else (0.0, [])
    found = replace(found, statistic=max(found.statistic, joints, load))
    if found.passed:
        return found
    ways = itertools.chain(ways, steady if load > 1.0 else (), _mended(claim))
    likely = next((text for mended, text in ways if _test(mended).passed), UNKNOWN)
    return replace(
        found, finding=f"The described arm does not explain the torques: {likely}{OTHER}"
    )


def explained_upright(log: ArmLog, arm: RobotDescription) -> FitTest:
    """Test that an upright `arm` with the same mass on its hand, at most its payload, explains a recording.

    Raises InputError: angles or velocities are impossible for the arm (`require_within_limits`).
    """
    require_within_limits(log, arm)
    everywhere = np.ones(len(log), dtype=bool)
    return explained(Claim.of(log, arm.nominal, UPRIGHT, ~everywhere, everywhere), True)


def require_within_limits(log: ArmLog, arm: RobotDescription) -> None:
    """Check that angles and velocities are possible for `arm`.

    Raises InputError: they are not; the message names the joint.
    """
    # Angles against joint ranges.
    limits, low, high = arm.limits, log.q.min(axis=0), log.q.max(axis=0)
    beyond = np.maximum(limits.q_min - low, high - limits.q_max) > BEYOND_RANGE
    for i in np.flatnonzero(beyond):
        raise InputError(
            f"{log.source}: joint {i + 1} is at {low[i]:.2f} to {high[i]:.2f} rad, and '{arm.name}' turns it from "
            f"{limits.q_min[i]:.2f} to {limits.q_max[i]:.2f}: its angles are not in rad (angles: deg in "
            f"columns=MAP.yaml), its joints are in another order{OTHER}"
        )
    # Speeds, without outliers, against the largest joint speeds.
    fast = np.quantile(np.abs(log.dq), 0.99, axis=0)
    for i in np.flatnonzero(fast > BEYOND_SPEED * limits.dq_max):
        raise InputError(
            f"{log.source}: joint {i + 1} turns at {fast[i]:.3g} rad/s, and that of '{arm.name}' at most at "
            f"{limits.dq_max[i]:.3g}: state the unit of the clock (time: ms in columns=MAP.yaml), or mend velocities"
        )
    # Velocities against the change of angles, over intervals that average out noise, without gaps and jumps.
    dt = np.diff(log.t)
    step = max(1, round(WHOLE_BLOCK * len(dt) / max(float(dt.sum()), 1e-9)))
    turns = np.concatenate([np.zeros((1, 7)), log.dq[:-1] * dt[:, None]])
    travel, path = np.cumsum(turns, axis=0), np.cumsum(np.abs(turns), axis=0)
    moved, told = (np.diff(signal[::step], axis=0) for signal in (log.q, travel))
    used = (np.abs(moved) > MOVED) & (np.diff(log.t[::step]) < LOG_GAP)[:, None]
    # All joints together show a wrong unit, one of them alone a wrong column.
    every = list(range(used.shape[1]))
    for joints in (every, *([i] for i in every)):
        rows = used[:, joints].any(axis=1)
        a, b = moved[rows][:, joints], told[rows][:, joints]
        share = float((a * b).sum() / max(float((a**2).sum()), 1e-12))
        if rows.sum() > JUMPS and not 1.0 / BEYOND_SPEED < share < BEYOND_SPEED:
            of = "" if joints is every else f" of joint {joints[0] + 1}"
            way = "give its own columns, or state" if of else "state"
            raise InputError(
                f"{log.source}: the velocities{of} are {share:.2g} times the change of the angles: {way} the units "
                "of clock and angles (time: and angles: in columns=MAP.yaml), or leave the velocities out"
            )
    # A torque that does not change while its joint turns is no measurement.
    for i in every:
        starts = np.flatnonzero(np.diff(log.tau[:, i], prepend=np.nan) != 0.0)
        ends = np.append(starts[1:], len(log)) - 1
        still = (log.t[ends] - log.t[starts] > FROZEN[0]) & (
            path[ends, i] - path[starts, i] > FROZEN[1]
        )
        if still.any():
            first = starts[still][0], ends[still][0]
            raise InputError(
                f"{log.source}: the torque of joint {i + 1} stays at {log.tau[first[0], i]:.3g} N m from "
                f"{log.t[first[0]]:.1f} to {log.t[first[1]]:.1f} s while the joint turns: its sensor or its column is "
                "dead; state its column in columns=MAP.yaml, or cut the recording"
            )


def _test(claim: Claim) -> FitTest:
    """Largest of the three statistics, each relative to its limit."""
    if not len(claim.t):
        return FitTest("torques of the described arm", 0.0, 1.0, "")
    posterior = _fitted(claim)
    # Prior predictive chi-squared of the misfit, and the Wald test of gravity.
    unknowns = (posterior.mean / posterior.model.prior)[posterior.model.prior > 0.0]
    misfit = float(posterior.residual @ posterior.residual + unknowns @ unknowns)
    tests = [
        chi_squared("misfit", misfit, 7 * _seconds(claim), ""),
        posterior.test(_gravity(claim, 1.0), np.array(CLAIM_GRAVITY), ""),
    ]
    # Masses on the hand relative to the described one: a permanent one, and loads.
    payload, least = claim.hand.payload, -float(Bodies.of(claim.chain, 0.0, 0.0, 0.0).hand[0])
    for name, usual in ((HAND, 0.0), (LOAD, payload / 2.0)):
        mean, covariance = posterior[name]
        beyond = usual + mean[0] - np.clip(usual + mean[0], least, payload)
        spread = covariance[0, 0] + (CLAIM_MASS * payload) ** 2
        tests.append(chi_squared("mass", float(beyond**2 / spread), 1, ""))
    return FitTest(
        "torques of the described arm", max(one.statistic / one.limit for one in tests), 1.0, ""
    )


def _find_joint_mistakes(claim: Claim, is_explained: bool) -> tuple[float, list[tuple[Claim, str]]]:
    """Find dead joints, joints in another order, and joints with the opposite sign.

    If the claim `is_explained`, only joints that fit poorly alone are examined.

    Returns:
        Statistic with limit 1; and, if it exceeds that, the claim with each likely mistake corrected, and a
        description of the mistake, the likeliest first.
    """
    from scipy.optimize import linear_sum_assignment

    fits, friction, described = _fit_joints(claim)
    order = linear_sum_assignment(fits)[1]
    sorted_torques = claim.tau[:, np.argsort(order)]

    def weakness(tau: Array) -> Array:
        """Ratio of the deviation that a live torque has at least to that of `tau`, by joint."""
        least = np.minimum(DEAD * taken, DEAD_LEAST) * (taken > DEAD_LEAST)
        return least / np.maximum(tau.std(axis=0), 1e-3)

    # A dead column varies less than its described torque, with the usual friction of this arm. No order mends it.
    usual = described + max(0.0, float(np.median(friction))) * np.tanh(claim.dq / WHOLE_SLOW)
    shown, taken = claim.tau.std(axis=0), usual.std(axis=0)
    shares = weakness(claim.tau)
    if 0 < (shares > 1.0).sum() < len(shown) / 2 and (weakness(sorted_torques) > 1.0).any():
        i, mended = int(shares.argmax()), np.where(shares > 1.0, described, claim.tau)
        text = DEAD_JOINT.format(i + 1, shown[i], taken[i])
        return float(shares[i]), [(replace(claim, tau=mended), text)]
    # Torques in the order that fits best; then signs, and exchanged angles, of each joint that fits poorly.
    ways = [(replace(claim, tau=sorted_torques), _order_in_words("torques", order))]
    every, poor = np.arange(len(shown)), np.diag(fits) > np.log(POOR * np.maximum(shown, 1e-9))
    for i in np.flatnonzero(poor | (not is_explained)).tolist():
        sign = np.where(every == i, -1.0, 1.0)
        ways.append((replace(claim, tau=sign * claim.tau), REVERSED.format("torques", i + 1)))
        turned = replace(claim, q=sign * claim.q, dq=sign * claim.dq)
        ways.append((turned, REVERSED.format("angles", i + 1)))
        for k in every[poor[i] & (every != i)].tolist():
            order = np.where(every == i, k, np.where(every == k, i, every))
            moved = replace(claim, q=claim.q[:, order], dq=claim.dq[:, order])
            ways.append((moved, _order_in_words("angles", order)))
    gains = float(np.trace(fits)) - np.array([np.trace(_fit_joints(way)[0]) for way, _ in ways])
    statistics = np.minimum(gains / JOINT_GAIN, gains * _seconds(claim) / JOINT_EVIDENCE)
    best: list[int] = np.argsort(-gains).tolist()
    return max(float(statistics.max()), 0.0), [ways[k] for k in best if statistics[k] > 1.0]


def _find_load_change(claim: Claim) -> tuple[float, list[tuple[Claim, str]]]:
    """Find masses on the hand that differ between equal parts of a recording.

    Returns:
        Statistic with limit 1; and the claim without the additional masses, with their description.
    """
    if len(claim.t) < PARTS_OF_LOG:
        return 0.0, []
    # Torque of a unit mass at the TCP from the beginning of each part on.
    since, still = (claim.t - claim.t[0]) / np.ptp(claim.t), np.zeros_like(claim.q)
    load = load_torques(claim.chain, claim.q, still, still, claim.gravity)[:, :, 0]
    starts = np.arange(1, PARTS_OF_LOG) / PARTS_OF_LOG
    columns = load[:, :, None] * (since[:, None, None] >= starts)
    cause = Cause.build("change", columns, 1e3)
    test = _fitted(claim).test(cause, np.full(len(starts), SAME_LOAD), "")
    # The mass of each part relative to the first.
    changes = _fitted(claim, cause)["change"][0]
    masses = ", ".join(f"{mass:.2f}" for mass in [0.0, *np.cumsum(changes)])
    steady = replace(claim, tau=claim.tau - columns @ changes)
    return test.statistic / test.limit, [(steady, CHANGED.format(PARTS_OF_LOG, masses))]


def _order_in_words(what: str, order: Rows) -> str:
    """Describe the joints whose columns belong to other joints."""
    moved = np.flatnonzero(order != np.arange(len(order)))
    names = (", ".join(str(i + 1) for i in joints.tolist()) for joints in (moved, order[moved]))
    return SWAPPED.format(what, *names)


def _fit_joints(claim: Claim) -> tuple[Array, Array, Array]:
    """Fit each torque alone, by the described torque, hand, friction and offset of each joint.

    Returns:
        (7, 7) logarithm of the residual, N m, of column i by joint k; (7,) N m, Coulomb friction of the joints; and
        (n, 7) N m, described torques.
    """
    n, still = len(claim.t), np.zeros_like(claim.q)
    ddq = np.gradient(claim.dq, claim.t, axis=0) if n > 1 else still
    described = own_motion(claim.chain, claim.q, claim.dq, ddq) + claim.holding(claim.gravity)
    load = load_torques(claim.chain, claim.q, still, still, claim.gravity)[:, :, :4]
    mass = claim.hand.payload / 2.0 * np.array([1.0, *[2.0 * HAND_REACH] * 3])
    prior = np.array([*JOINT_PRIOR, *mass, *mass])
    rows = JOINT_NOISE**2 * max(1.0, n / max(_seconds(claim), 1))
    sizes, coulomb = np.empty((2, 7, 7)), np.empty((7, 7))
    for k in range(7):
        own = [np.ones(n), np.tanh(claim.dq[:, k] / WHOLE_SLOW), claim.dq[:, k]]
        columns = np.column_stack([*own, load[:, k], claim.loaded[:, None] * load[:, k]]) * prior
        target = claim.tau - described[:, k : k + 1]
        # Fit without and with Coulomb friction.
        for i, used in enumerate((columns * (np.arange(len(prior)) != 1), columns)):
            found = np.linalg.solve(used.T @ used + rows * np.eye(len(prior)), used.T @ target)
            sizes[i, :, k] = ((target - used @ found) ** 2).mean(axis=0)
            coulomb[:, k] = found[1] * prior[1]
    # Friction opposes the motion: where its coefficient is negative, take the fit without it. Most joints have the
    # opposite sign only where friction is compensated for.
    friction: Array = np.diag(coulomb)
    is_opposed = (coulomb >= 0.0) | (np.median(friction) < 0.0)
    fits = 0.5 * np.log(sizes[0] + is_opposed * (sizes[1] - sizes[0]) + JOINT_LEAST**2)
    return fits, friction, described


def _fitted(claim: Claim, *more: Cause) -> Posterior:
    """Fit the unknowns that a description leaves open, about their prior means."""
    # Torques of the described arm: gravity, and inertia.
    chain, n, still = claim.chain, len(claim.t), np.zeros_like(claim.q)
    ddq = np.gradient(claim.dq, claim.t, axis=0) if n > 1 else still
    held, moved = claim.holding(claim.gravity), own_motion(chain, claim.q, claim.dq, ddq)
    # Friction acts along the motion. Its prior mean distinguishes a reversed sign from a hanging arm.
    turning = np.tanh(claim.dq / WHOLE_SLOW)
    size = CLAIM_TORQUE + CLAIM_SHARE * np.sqrt((held**2).mean(axis=0))
    # Errors of link mass and centre, which gravity shows.
    bodies = Bodies.of(chain, *CLAIM_LINKS, 0.0)
    links = regressor(chain, claim.q, still, still, claim.gravity)
    weights = [links[:, :, i] @ bodies.link_frame(i)[:, :4] for i in range(len(bodies.links))]
    # A hand that differs from the described one, and loads between zero and the payload.
    mass, load = claim.hand.payload / 2.0, load_torques(chain, claim.q, still, still, claim.gravity)
    carried = claim.loaded[:, None, None] * load[:, :, :4]
    of_load = mass * np.array([1.0, *[2.0 * HAND_REACH] * 3])
    parts = [
        ("links", np.concatenate(weights, axis=2), bodies.errors[:, :4].ravel()),
        (HAND, load[:, :, :4], of_load),
        (LOAD, carried, of_load),
        ("inertia", moved[:, :, None], LINK_INERTIA),
        ("offset", per_joint(np.ones_like(held)), size),
        ("coulomb", per_joint(turning), size),
        ("viscous", per_joint(claim.dq), VISCOUS_PRIOR),
    ]
    causes = [Cause.build(*part) for part in parts]
    # The residual is correlated over about a second, so the rows of a second count as one.
    std = np.tile(size * np.sqrt(max(1.0, n / max(_seconds(claim), 1))), n)
    expected = held + moved + USUAL_FRICTION * turning + mass * carried[:, :, 0]
    noise = SpectralNoise(std, float(held.size))
    return fit([*causes, *more], noise, (claim.tau - expected).ravel())


def _seconds(claim: Claim) -> int:
    """Number of seconds that contain a row."""
    return len(np.unique(np.floor(claim.t)))


def _gravity(claim: Claim, prior: float) -> Cause:
    """Cause of gravity beyond the stated one, as fractions of it, along the base axes."""
    size = float(np.linalg.norm(claim.gravity))
    columns = np.stack([claim.holding(size * axis) for axis in np.eye(3)], axis=2)
    return Cause.build("gravity", columns, prior)


def _mended(claim: Claim) -> Iterator[tuple[Claim, str]]:
    """Yield the claim with each likely mistake corrected, and a description of the mistake."""
    size = float(np.linalg.norm(claim.gravity))
    # Gravity as the torques show it, without a prior; a reversed sign looks like a hanging arm.
    shown = claim.gravity / size + _fitted(claim, _gravity(claim, 1e5))["gravity"][0]
    shown /= np.linalg.norm(shown)
    place = ("upright, or tilted", "on a wall, or tilted", "on a ceiling")[
        round(float(shown[2])) + 1
    ]
    # Sign or mounting, the likelier first; then units, missing gravity, and a heavy load.
    ways = [
        (replace(claim, tau=-claim.tau), SIGN),
        (replace(claim, gravity=size * shown), MOUNT.format(place, *shown.tolist())),
    ]
    yield from sorted(ways, key=lambda way: -_fitted(way[0]).density)
    for scales in (_scales(claim, alike=True), _scales(claim, alike=False)):
        if scales.max() < ALIKE * scales.min():
            listed = ", ".join(dict.fromkeys(f"{part:.3g}" for part in scales.tolist()))
            yield replace(claim, tau=claim.tau / scales), UNIT.format(listed)
    yield replace(claim, tau=claim.tau + claim.holding(claim.gravity)), REMOVED
    stronger = replace(claim.hand, payload=HEAVIER * claim.hand.payload)
    yield replace(claim, hand=stronger), PAYLOAD.format(claim.hand.payload)


def _scales(claim: Claim, alike: bool) -> Array:
    """Ratios (7,) of the torques to the gravity torques of the described arm.

    The ratio is common to all joints if `alike`, else one a joint. Joints with too little gravity torque take the
    median of the others.
    """
    held, scales = claim.holding(claim.gravity), np.ones(7)
    strong = np.sqrt((held**2).mean(axis=0)) > STRONG
    cause = Cause.build("scale", held[:, :, None] if alike else per_joint(held), 1e5)
    # Iterate: priors are in N m, so the first round is inaccurate where the unit differs.
    for _ in range(LOAD_ITERATIONS):
        mended = replace(claim, tau=claim.tau / scales)
        found = 1.0 + _fitted(mended, cause)["scale"][0] * np.ones(7)
        if strong.any():
            found = np.where(strong, found, np.median(found[strong]))
        scales = scales * np.where(found > 1e-6, found, 1.0)
    return scales
