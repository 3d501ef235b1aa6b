"""Load on a six-axis force/torque sensor, from its wrench and its poses.

No model of an arm is needed. In the axes of the sensor, about its origin, a rigid body needs the wrench

    f = m (a - g) + α × h + ω × (ω × h)        n = h × (a - g) + I α + ω × I ω

which is linear in its ten parameters (`rigid_bodies.wrench_columns`). The zero of the sensor is constant in its axes,
the weight is constant in the world. Poses with different directions of gravity therefore separate them. Gain,
cross-talk, mounting, tilt of the ground and delay act in proportion to the load, and are further causes. Noise is
white noise and a coloured residual, learned from the recording (`coloured_residual`).

Source: D. Kubus, T. Kröger and F. M. Wahl, On-line estimation of inertial parameters using a recursive total
least-squares approach, IROS 2008; the causes are those of the data sheets of such sensors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from palpate.common.pose import Array, Pose, rotations
from palpate.estimation.coloured_residual import Spans, learn_residual, with_residual
from palpate.estimation.estimate import FitTest
from palpate.estimation.evidence import once
from palpate.estimation.joint_causes import response_columns
from palpate.estimation.load_blocks import free_rows
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import Mask
from palpate.estimation.regression import Cause, Posterior, SignalNoise, fit
from palpate.estimation.rigid_bodies import BODY_PRIOR, PARAMETERS, wrench_columns
from palpate.estimation.wrench_observation import CROSSTALK, GAIN, is_sensed
from palpate.trace.recording import WrenchSensor
from palpate.trace.samples import STANDARD_GRAVITY as GRAVITY
from palpate.trace.samples import Samples, Trace

BLOCK = 0.1
"""s: shortest block of rows that is averaged. Not sensitive."""
MOST_BLOCKS = 300
"""largest number of blocks; longer recordings have longer blocks. Not sensitive."""
ZERO_PRIOR = (1e3, 1e2)
"""N and N m (1 sigma): wide prior of the sensor's zeros. Not sensitive."""
LEAN = 3e-3
"""rad (1 sigma): tilt of the ground on which the arm stands. Hardly sensitive."""
DELAY = 0.01
"""s (1 sigma): delay between poses and wrench, a filter of 16 Hz. Sensitive: inertia only."""
MOMENT_LEVER = 0.3
"""m: relates cross-talk between forces and moments. Not sensitive."""
APPARENT_NOISE = 0.1
"""Size to which the residual of a first fit is scaled, as the residual's search begins near it. Not sensitive."""
FINEST = 3e-4
"""N, N m: least misfit and white noise, below those of any sensor: less makes the equations singular. Not sensitive."""
ITERATIONS = 2
"""Solutions before the last: causes in proportion to the load need its value. Not sensitive."""
RESTART = 5.0
"""s: gap between rows after which the sensor may have a new zero. Not sensitive."""
PAUSES = 20.0
"""Times the usual time between rows: the same for a recording of single poses. Not sensitive."""
AT_REST = 0.2
"""s between rows, from which they are single poses at rest. Not sensitive."""
FASTEST = 15.0
"""rad/s: faster turns from row to row are cuts between poses at rest, not motions. Arms turn their tools by less than
8 rad/s. Not sensitive."""
RATE_HALF = 0.06
"""s: half width of the local quadratics that differentiate the poses. Sensitive: inertia std ×1.0–1.2."""
MISFIT = 0.15
"""Largest misfit of the weight, relative to it, with which a recording counts as explained. A gain error of 5 % and a
mounting error of 5° give 0.1. Not sensitive."""
BETTER = 0.4
"""Ratio of the misfits of another explanation and of the stated one, below which it is named. Not sensitive."""
LEAST_FORCE = 0.3
"""N. Scatter of the forces from pose to pose below which no explanation is tested. Not sensitive."""
TURNED = 0.1
"""Smallest spread (standard deviation) of the direction of gravity that separates weight and zero: two poses 12° apart.
Not sensitive."""
HEAVIEST = 100.0
"""kg: heaviest load on a robot's sensor. Not sensitive."""
FARTHEST = 1.0
"""m: largest distance from the sensor to the centre of mass of a load. Not sensitive."""
LEAST = 0.02
"""kg (1 sigma): a mass that is more negative is of the opposite sign. Not sensitive."""
ZERO_SHARE = 0.05
"""Fraction of the weight (1 sigma) by which the zero may differ with and without the load. Not sensitive."""
ZERO_LEAST = 0.1
"""N (1 sigma): the same for a load without weight. Not sensitive."""
LOAD, HAND, ZERO, SENSOR_GAIN = "load", "hand", "zero", "gain of the wrench sensor"
"""Names of causes."""


@dataclass(frozen=True, slots=True, eq=False)
class SensedBlocks:
    """Means over k blocks of rows in which the load is carried or not throughout."""

    t: Array  # (k,) s
    rows: Array  # (k,) number of rows
    spans: Spans  # time and rotation of each block, for the residual
    wrench: Array  # (k, 6) N, N m
    columns: Array  # (k, 6, 10) wrench per unit of each parameter
    changes: Array  # (k, 6, 10) its rate of change, per s
    leans: Array  # (2, k, 6, 10) its change per rad of tilt about world x and y
    pulled: Array  # (k, 3) m/s², acceleration less gravity, in the axes of the sensor
    up: Array  # (k, 3) direction against gravity in these axes
    turned: Array  # (k, 3, 3) axes of the sensor in the world
    speed: Array  # (k,) rad/s, of its rotation
    hanging: Mask  # (k,) the load is carried
    part: Array  # (k,) index of the part of the recording, between restarts
    white: Array  # (6,) variance of a row


@dataclass(frozen=True, slots=True, eq=False)
class SensedLoad:
    """Fitted load on a sensor."""

    # (10,) kg, kg m and kg m²: mass, first moment and inertia about the sensor's origin, in its axes.
    value: Array
    covariance: Array  # (10, 10)
    seen: SensedBlocks
    posterior: Posterior
    scale: Array  # (6,) factor of the rows of each axis in the fit
    explained: FitTest  # the forces are those of a weight
    near: FitTest  # the moments are those of this weight

    kinematic_error = 0.0
    """m: error of the load's place; it is that of the pose in the hand alone."""
    causes = "zeros, gain, cross-talk and mounting of the sensor"
    """Causes that are fitted together with the load, for texts."""

    @property
    def compared(self) -> bool:
        """True if the zero of the sensor is known from other poses, or from the empty hand."""
        return not self.seen.hanging.all() or _spread(self.seen.up) > TURNED

    def seconds(self, hanging: bool) -> float:
        """Duration of the blocks with (`hanging`) or without the load, s."""
        return float(self.seen.spans.lasts[self.seen.hanging == hanging].sum())

    def times(self, hanging: bool) -> Array:
        """Times, s, of the blocks with or without the load."""
        return self.seen.t[self.seen.hanging == hanging]

    def part(self, start: float, end: float, hanging: bool = True) -> Array:
        """Compute the rows (6 k,) of the load, scaled to 1 kg, present from `start` to `end` s only."""
        seen, share = self.seen, self.value / max(float(self.value[0]), 1e-3)
        here = (start <= seen.t) & (seen.t <= end) & (seen.hanging == hanging)
        return _by_axis(here[:, None] * (seen.columns @ share), self.scale)


@once
def fit_sensed_load(trace: Trace, name: str) -> SensedLoad | None:
    """Fit the load `name` to all time in which it was carried or the hand was empty.

    The hand below the sensor is fitted as well where it is seen empty. None where the load was never carried.
    """
    rows, sensor = load_rows(trace, name), trace.hand.wrench_sensor
    if not rows.loaded.any() or sensor is None:
        return None
    seen = _blocks(trace.samples, sensor, rows.loaded, rows.empty, trace.gravity)
    picks = {LOAD: seen.hanging[:, None, None] * np.eye(PARAMETERS)}
    found, scale = _fit_bodies(seen, picks, BODY_PRIOR, sensor)
    value, covariance = found[LOAD]
    return SensedLoad(value, covariance, seen, found, scale, _explain(seen), _locate(seen))


def _fit_bodies(
    seen: SensedBlocks, picks: dict[str, Array], prior: Array, sensor: WrenchSensor
) -> tuple[Posterior, Array]:
    """Fit the load and the hand below the sensor, with the sensor's zeros and errors.

    Args:
        picks: the load's ten parameters (k, 10, p) in each block, per unit of its p unknowns.
        prior: (p,) standard deviations of these.

    Returns:
        Posterior of all causes, and the factor (6,) of the rows of each axis.
    """
    if not seen.hanging.all():
        picks = {**picks, HAND: np.broadcast_to(np.eye(PARAMETERS), (len(seen.t), 10, 10))}
    priors = {LOAD: prior, HAND: BODY_PRIOR}
    bodies = {name: seen.columns @ pick for name, pick in picks.items()}
    # Scale each axis to one apparent noise, so that a single prior of the residual serves forces and moments.
    plain = np.hstack([_by_axis(one, np.ones(6)) for one in bodies.values()])
    design = np.hstack([plain, *(one.columns for one in _zeros(seen, np.ones(6)))])
    y = _by_axis(seen.wrench, np.ones(6))
    rough = np.linalg.lstsq(design, y, rcond=None)[0].astype(np.float64)
    misfit = (y - design @ rough).reshape(6, -1)
    scale = APPARENT_NOISE / np.maximum(misfit.std(axis=1), FINEST)
    y = _by_axis(seen.wrench, scale)
    fixed = [Cause(one, _by_axis(rows, scale), priors[one]) for one, rows in bodies.items()]
    fixed += _zeros(seen, scale)
    # Solve, linearised at the last solution; then learn the residual, and solve again with it.
    noise, about = _white_noise(seen, scale, misfit.var(axis=1)), rough[: plain.shape[1]]
    for _ in range(ITERATIONS):
        causes = [*fixed, *_sensor_causes(seen, picks, about, sensor, scale)]
        about = fit(causes, noise, y, first=plain.shape[1]).mean[: plain.shape[1]]
    causes = [*fixed, *_sensor_causes(seen, picks, about, sensor, scale)]
    left = learn_residual(causes, noise, y, seen.spans)
    return fit(causes, with_residual(noise, left, seen.spans), y), scale


def _by_axis(values: Array, scale: Array) -> Array:
    """Reorder (k, 6, …) to rows by axis, (6 k, …), in units of `scale` (6,)."""
    scaled = values * scale.reshape(6, *[1] * (values.ndim - 2))
    return scaled.swapaxes(0, 1).reshape(-1, *values.shape[2:])


def _zeros(seen: SensedBlocks, scale: Array) -> Iterator[Cause]:
    """Yield the zeros of the sensor in each part of the recording."""
    for part in np.unique(seen.part).tolist():
        here = (seen.part == part)[:, None, None] * np.eye(6)
        yield Cause.build(f"{ZERO} {part}", _by_axis(here, scale), np.repeat(ZERO_PRIOR, 3))


def _sensor_causes(
    seen: SensedBlocks, picks: dict[str, Array], about: Array, sensor: WrenchSensor, scale: Array
) -> Iterator[Cause]:
    """Yield the errors of the sensor in proportion to the wrench of all bodies with unknowns `about`."""
    # Parameters (k, 10) of all that is below the sensor in each block, and its wrench.
    body = np.dstack([*picks.values()]) @ about
    wrench = np.einsum("kip,kp->ki", seen.columns, body)
    # One gain of all axes, and the response of each axis to each other one.
    shown = _by_axis(wrench[:, :, None], scale)
    yield Cause.build(GAIN, shown, sensor.gain, "arm", (SENSOR_GAIN,))
    unit = np.repeat([1.0, MOMENT_LEVER], 3)
    crossed = unit[:, None] * response_columns(wrench / unit)
    labels = tuple(
        f"cross-talk of the wrench sensor, axis {j} in {i}" for i, j in permutations(range(1, 7), 2)
    )
    yield Cause.build(CROSSTALK, _by_axis(crossed, scale), sensor.crosstalk, "arm", labels)
    # A sensor that is turned by a small angle against its stated axes: -δ × f and -δ × n.
    turned = np.stack(
        [
            np.hstack([np.cross(wrench[:, :3], axis), np.cross(wrench[:, 3:], axis)])
            for axis in np.eye(3)
        ],
        axis=2,
    )
    yield Cause.build("mounting", _by_axis(turned, scale), sensor.mounting)
    lean = np.stack([np.einsum("kip,kp->ki", one, body) for one in seen.leans], axis=2)
    yield Cause.build("lean", _by_axis(lean, scale), LEAN)
    late = np.einsum("kip,kp->ki", seen.changes, body)
    yield Cause.build("delay", _by_axis(late[:, :, None], scale), DELAY)


def _white_noise(seen: SensedBlocks, scale: Array, misfit: Array) -> SignalNoise:
    """White noise of the block means; single poses show it by the `misfit` (6,) of a first fit alone."""
    white = np.maximum(np.where(seen.white > 0.0, seen.white, misfit), FINEST**2)
    roots = [np.diag(np.sqrt(variance / seen.rows)) for variance in (white * scale**2).tolist()]
    return SignalNoise(roots, float(seen.rows.sum()))


def _blocks(
    samples: Samples, sensor: WrenchSensor, loaded: Mask, empty: Mask, gravity: float
) -> SensedBlocks:
    """Average the rows of each block of time in which the hand is loaded or empty throughout."""
    t, used = samples.t, loaded | empty
    step = float(np.median(np.diff(t)))
    gaps = np.diff(t, prepend=t[0]) > max(RESTART, PAUSES * step)
    cuts = gaps | _cuts(samples)
    length = max(BLOCK, float(used.sum()) * step / MOST_BLOCKS)
    # A block ends with its time, at a gap, and where the load changes.
    place = np.floor((t - t[0]) / length).astype(int)
    edges = np.flatnonzero(np.diff(place) | cuts[1:] | np.diff(loaded) | np.diff(used)) + 1
    groups = [rows for rows in np.split(np.arange(len(t)), edges) if used[rows[0]]]
    # Poses of the sensor by those of the TCP.
    mounted = Pose.of(sensor.pose_tcp_sensor[:3], sensor.pose_tcp_sensor[3:])
    tool = rotations(samples.pose_world_tcp[:, 3:])
    turned = tool @ mounted.rotation
    place = samples.pose_world_tcp[:, :3] + tool @ mounted.position
    pulled, turn, spun, up = _kinematics(t, place, turned, gravity, cuts)
    travelled = np.cumsum(np.linalg.norm(turn, axis=1) * np.gradient(t))

    means: list[Array] = []
    changes: list[Array] = []
    leans: list[list[Array]] = [[], []]
    for rows in groups:
        own = wrench_columns(pulled[rows], turn[rows], spun[rows])
        means.append(own.mean(axis=0))
        lasts = max(float(t[rows[-1]] - t[rows[0]]), 1e-9)
        changes.append((own[-1] - own[0]) / lasts)
        # Tilt of gravity by 1 rad about a world axis: its change is horizontal.
        for axis, found in zip(np.eye(3)[:2], leans, strict=True):
            aside = gravity * np.cross(axis, [0.0, 0.0, 1.0])
            still = np.zeros((len(rows), 3))
            tilted = np.einsum("nji,j->ni", turned[rows], aside)
            found.append(wrench_columns(tilted, still, still).mean(axis=0))
    # White noise of a row from second differences within blocks; single poses do not show it.
    seconds = np.concatenate([np.diff(samples.wrench_sensor[rows], n=2, axis=0) for rows in groups])
    white = (seconds**2).sum(axis=0) / max(6.0 * len(seconds), 1.0)
    path = np.repeat(travelled[:, None], 6, axis=1)
    return SensedBlocks(
        np.array([t[rows].mean() for rows in groups]),
        np.array([float(len(rows)) for rows in groups]),
        Spans.of(t, path, groups),
        np.array([samples.wrench_sensor[rows].mean(axis=0) for rows in groups]),
        np.array(means),
        np.array(changes),
        np.array(leans),
        np.array([pulled[rows].mean(axis=0) for rows in groups]),
        np.array([up[rows].mean(axis=0) for rows in groups]),
        np.array([turned[rows[len(rows) // 2]] for rows in groups]),
        np.array([float(np.linalg.norm(turn[rows], axis=1).mean()) for rows in groups]),
        np.array([bool(loaded[rows[0]]) for rows in groups]),
        np.array([int(gaps[: rows[0] + 1].sum()) for rows in groups]),
        white,
    )


def _cuts(samples: Samples) -> Mask:
    """Find rows (n,) before which the sensor turns faster than any arm: poses at rest without the way between them."""
    q = samples.pose_world_tcp[:, 3:]
    cosine = np.abs((q[1:] * q[:-1]).sum(axis=1))
    angle = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    return np.append(False, angle > FASTEST * np.diff(samples.t))


def _kinematics(
    t: Array, place: Array, turned: Array, gravity: float, cuts: Mask
) -> tuple[Array, Array, Array, Array]:
    """Compute acceleration less gravity, angular velocity and acceleration, and the direction against gravity.

    All (n, 3), in the axes of the sensor. The poses are differentiated in each part between `cuts`.
    """
    n = len(t)
    moved, turn, spun = np.zeros((3, n, 3))
    for rows in np.split(np.arange(n), np.flatnonzero(cuts)):
        own = t[rows]
        # Rows far apart are poses at rest.
        if len(rows) < 5 or float(np.median(np.diff(own))) > AT_REST:
            continue
        moved[rows] = _rates(_rates(place[rows], own), own)
        # Angular velocity in the axes of the sensor: R^T R' is its cross-product matrix.
        rate = _rates(turned[rows].reshape(-1, 9), own).reshape(-1, 3, 3)
        skew = turned[rows].swapaxes(1, 2) @ rate
        turn[rows] = (
            np.stack([skew[:, i, j] - skew[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
            / 2.0
        )
        spun[rows] = _rates(turn[rows], own)
    up = turned[:, 2]
    pulled = np.einsum("nji,nj->ni", turned, moved) + gravity * up
    return pulled, turn, spun, up


def _rates(values: Array, t: Array) -> Array:
    """Differentiate values (n, k) by local quadratics about each row (Savitzky and Golay, 1964)."""
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(t)))
    half = max(1, min(round(RATE_HALF / max(step, 1e-6)), (len(t) - 1) // 2))
    even = np.arange(t[0], t[-1] + step / 2.0, step)
    if len(even) < 2 * half + 1:
        return np.zeros_like(values)
    # Uniform clock for the filter, and back to the rows.
    uniform: list[Array] = [np.interp(even, t, column) for column in values.T]
    rate = savgol_filter(np.column_stack(uniform), 2 * half + 1, 2, deriv=1, delta=step, axis=0)
    found: list[Array] = [np.interp(t, even, column) for column in rate.T]
    return np.column_stack(found)


def _spread(up: Array) -> float:
    """Standard deviation of the direction of gravity along its most spread axis, without unit."""
    return float(np.linalg.norm(up - up.mean(axis=0), 2) / np.sqrt(len(up)))


def observable(found: SensedLoad) -> str:
    """Reason why the poses do not separate weight and zero; empty where they do."""
    spread = _spread(found.seen.up)
    if found.compared:
        return ""
    degrees = np.degrees(2.0 * np.arcsin(min(spread, 1.0)))
    return (
        f"Weight and zero of the sensor are not observable: in its axes gravity turns by {degrees:.0f}° only. Hold the "
        "load in three or more poses, turned by 30° or more about two horizontal axes, or record the empty hand too "
        "(loaded=…, empty=LOG)."
    )


# Test that the wrench is that of a weight, in the stated axes and with the stated sign.


def _explain(seen: SensedBlocks) -> FitTest:
    """Test that the forces are those of a weight that hangs free, in the stated axes."""
    name, limit = "the wrench is that of a weight", MISFIT
    # The slower half of the blocks: there the load's own rotation hardly counts.
    used = seen.hanging & (seen.speed <= np.median(seen.speed[seen.hanging]))
    force, pulled, turned = seen.wrench[used, :3], seen.pulled[used], seen.turned[used]
    force, world = _centred(force, seen.part[used]), np.einsum("kij,kj->ki", turned, pulled)
    raw, back = seen.wrench[used, :3], turned.swapaxes(1, 2)
    # The forces in the axes of the world, if these were those of the sensor, and the reverse.
    of_world, of_sensor = (
        _centred(np.einsum("kij,kj->ki", axes, raw), seen.part[used]) for axes in (back, turned)
    )
    most = max(float(each.std()) for each in (force, of_world))
    if _spread(seen.up[used]) < TURNED or most < LEAST_FORCE:
        return FitTest(name, 0.0, limit, "")

    def misfit(force: Array, pulled: Array) -> float:
        """Residual of a weight and a zero, relative to the weight."""
        along = _centred(pulled, seen.part[used])
        square = float((along**2).sum())
        mass = float((along * force).sum()) / square
        left = force - mass * along
        return float(np.sqrt((left**2).sum() / square)) / max(abs(mass), 1e-9)

    from scipy.spatial.transform import Rotation  # slow to import

    # The same forces under other statements of axes and sign.
    found = _mounted(force, _centred(pulled, seen.part[used]))
    turn = Rotation.from_matrix(found.T)
    x, y, z, w = turn.as_quat().tolist()
    order = Rotation.from_quat(Rotation.from_matrix(turned).as_quat()[:, [1, 2, 3, 0]]).as_matrix()
    others = {
        "the wrench is in the axes of the world: state 'frame: world'": misfit(of_world, pulled),
        "the wrench is in the axes of the sensor: state 'frame: sensor'": misfit(of_sensor, pulled),
        "the orientations are those of the world in the sensor: log their inverse": misfit(
            force, np.einsum("kij,kj->ki", turned, world)
        ),
        "the quaternions are in the order w x y z: state 'quaternion: wxyz'": misfit(
            force, np.einsum("kji,kj->ki", order, world)
        ),
        f"the sensor is turned by {np.degrees(turn.magnitude()):.0f}° against the logged pose: state 'sensor: [0, 0, "
        f"0, {w:.4f}, {x:.4f}, {y:.4f}, {z:.4f}]'": misfit(force, pulled @ found.T),
    }
    stated, best = misfit(force, pulled), min(others, key=lambda one: others[one])
    if others[best] < min(BETTER * stated, MISFIT):
        text = (
            f"{min(stated, 1.0):.0%} of the weight are left unexplained, and {others[best]:.0%} if {best} "
            "(columns=MAP.yaml)."
        )
        return FitTest(name, stated, limit, text)
    # Forces that hardly change are those of a load without a weight.
    if float(force.std()) < LEAST_FORCE:
        return FitTest(name, 0.0, limit, "")
    text = (
        f"{min(stated, 1.0):.0%} of the weight are left unexplained in the stated axes: something touched the load, a "
        "cable pulls, wrench and pose have different clocks, or the wrench is in other axes."
    )
    return FitTest(name, stated, 2.0 * limit, text)


def _locate(seen: SensedBlocks) -> FitTest:
    """Test that the moments are those of the weight, at a centre of mass near the sensor."""
    # Mass by the forces alone, and first moment h by the moments h × (a - g) alone.
    used = seen.hanging & (seen.speed <= np.median(seen.speed[seen.hanging]))
    part, pulled = seen.part[used], _centred(seen.pulled[used], seen.part[used])
    force, moment = (_centred(each[used], part) for each in np.split(seen.wrench, 2, axis=1))
    mass = float((pulled * force).sum()) / max(float((pulled**2).sum()), 1e-12)
    columns = -np.cross(pulled[:, None, :], np.eye(3)).swapaxes(1, 2)
    lever = np.linalg.lstsq(columns.reshape(-1, 3), moment.ravel(), rcond=None)[0]
    left = moment - columns @ lever
    share = float(np.sqrt((left**2).sum() / max(float((moment**2).sum()), 1e-12)))
    is_shown = _spread(seen.up[used]) > TURNED and share < 0.5
    reach = float(np.linalg.norm(lever)) / max(abs(mass), LEAST) if is_shown else 0.0
    return FitTest(
        "a centre of mass is near the sensor",
        reach,
        FARTHEST,
        f"Moments and forces do not belong together: the centre of mass would be {reach:.1f} m from the sensor. The "
        "moments are in another unit than N m, or about another point.",
    )


def _centred(values: Array, part: Array) -> Array:
    """Subtract the mean of each part of the recording."""
    found = values.copy()
    for one in np.unique(part):
        found[part == one] -= values[part == one].mean(axis=0)
    return found


def _mounted(force: Array, pulled: Array) -> Array:
    """Find the rotation matrix (3, 3) from the logged axes to those of centred forces (Kabsch, 1976)."""
    left, _, right = np.linalg.svd(force.T @ pulled)
    sign = float(np.sign(np.linalg.det(left @ right)))
    return left @ np.diag([1.0, 1.0, sign]) @ right


def sensed_tests(found: SensedLoad, name: str) -> tuple[FitTest, ...]:
    """Tests that axes, sign and units of the recording are as stated."""
    if not found.explained.passed or not found.near.passed:
        return (found.explained, found.near)
    mean, covariance = found.posterior[name]
    mass, std = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    return (
        found.explained,
        found.near,
        *_same_zero(found, abs(mass)),
        FitTest(
            "a mass is plausible",
            mass - 4.0 * std,
            HEAVIEST,
            f"The {name} would weigh {mass:.0f} kg: the wrench is in another unit than N and N m.",
        ),
        FitTest(
            "a mass is not negative",
            -(mass + 4.0 * std),
            LEAST,
            f"The {name} weighs less than nothing: the wrench has the opposite sign (state 'sign: "
            "by_sensor' or 'sign: on_sensor' in columns=MAP.yaml), or the windows of the load and of the empty "
            "hand are exchanged.",
        ),
    )


def _same_zero(found: SensedLoad, mass: float) -> tuple[FitTest, ...]:
    """Test that the sensor has the same zero with and without the load, where the poses show both."""
    seen = found.seen
    if seen.hanging.all() or _spread(seen.up[seen.hanging]) < TURNED:
        return ()
    tolerated = np.repeat([ZERO_SHARE * mass * GRAVITY + ZERO_LEAST, ZERO_LEAST * MOMENT_LEVER], 3)
    columns = _by_axis(seen.hanging[:, None, None] * np.eye(6), found.scale)
    cause = Cause("same zero with the load", columns, np.repeat(ZERO_PRIOR, 3))

    def finding(mean: Array) -> str:
        force = float(np.linalg.norm(mean[:3]))
        return (
            f"The zero of the sensor differs by {force:.2g} N with and without the load: it was zeroed with the "
            "load in the hand, or something pushed. Zero it once, before the recording."
        )

    return (found.posterior.test(cause, tolerated, finding),)


# Load in the hand of an arm that has such a sensor, in several grasps.


@dataclass(frozen=True, slots=True, eq=False)
class SensedGrasps:
    """Load in n grasps by the sensor alone, in the form of `load_fit.WholeLoad`."""

    # (1 + 3n,) weight, N, and in each grasp the first moment of the weight about the TCP along the axes of the hand,
    # N m.
    value: Array
    covariance: Array  # (1 + 3n, 1 + 3n)
    gain: Array  # (1 + 3n,) effect of one standard deviation of the sensor's gain


@once
def fit_sensed_grasps(trace: Trace, name: str) -> SensedGrasps | None:
    """Fit the load `name` to the wrench of the sensor in free air, with a lever of its own in each grasp.

    None where the arm has no sensor, or no such motion of both the load and the empty hand was recorded.
    """
    sensor = trace.hand.wrench_sensor
    groups = free_rows(trace, name) if is_sensed(trace) else []
    if sensor is None or not groups:
        return None
    # Rows in free air with the load, and with the empty hand.
    rows, free = load_rows(trace, name), np.zeros(len(trace.samples), dtype=bool)
    free[np.concatenate(groups)] = True
    loaded, empty = rows.loaded & free, rows.empty & free
    if not (loaded.any() and empty.any()):
        return None
    seen = _blocks(trace.samples, sensor, loaded, empty, trace.gravity)
    # The load has one mass and one inertia, and a first moment in each grasp.
    grasp = np.array([max([g for g in rows.grasps if g <= t], default=-np.inf) for t in seen.t])
    grasps = sorted(set(grasp[seen.hanging].tolist()))
    count = 1 + 3 * len(grasps)
    pick = np.zeros((len(seen.t), PARAMETERS, count + 6))
    pick[:, 0, 0] = seen.hanging
    for i, time in enumerate(grasps):
        here = seen.hanging & (grasp == time)
        pick[:, 1:4, 1 + 3 * i : 4 + 3 * i] = here[:, None, None] * np.eye(3)
    pick[:, 4:, count:] = seen.hanging[:, None, None] * np.eye(6)
    prior = np.concatenate([BODY_PRIOR[:1], *[BODY_PRIOR[1:4]] * len(grasps), BODY_PRIOR[4:]])
    found, _ = _fit_bodies(seen, {LOAD: pick}, prior, sensor)
    # From the sensor's origin and axes to those of the TCP: h' = R h + m p, times g.
    mounted = Pose.of(sensor.pose_tcp_sensor[:3], sensor.pose_tcp_sensor[3:])
    turned = np.kron(np.eye(len(grasps)), mounted.rotation)
    to_tcp = np.zeros((count, count))
    to_tcp[0, 0], to_tcp[1:, 1:] = 1.0, turned
    to_tcp[1:, 0] = np.tile(mounted.position, len(grasps))
    to_tcp *= trace.gravity
    effects = found.effects(GAIN)[:count, 0]
    covariance = found.covariance[:count, :count]
    return SensedGrasps(
        to_tcp @ found.mean[:count], to_tcp @ covariance @ to_tcp.T, to_tcp @ effects
    )
