"""Friction, damping and spring of a fixture's joint, from passes of its handle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array, Joint
from palpate.estimation.coloured_residual import Spans, learn_residual, with_residual
from palpate.estimation.estimate import FitTest
from palpate.estimation.evidence import once
from palpate.estimation.joint_causes import GAINS_OFF, INERTIA_SHARE, JOINT_VISCOUS, build_gain
from palpate.estimation.joint_friction import FLOOR, JOINT_LEVEL, TURNED, dahl_states
from palpate.estimation.motion import Mask, commanded_rows, mean_pose, runs, smoothed_with_rate
from palpate.estimation.regression import Cause, Posterior, PriorScale, SignalNoise, fit
from palpate.estimation.wrench_observation import (
    GAIN,
    WrenchObservation,
    gain_root,
    is_sensed,
    observe_wrench,
)
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace

HANDLE_BLOCK = 0.2
"""s. Length of the blocks over which the force along a joint is averaged. Two blocks have to fit into the shortest ramp
of a pass. Sensitive: dry friction and damping 1.8 σ at half of it, 2.7 σ at twice."""
HANDLE_MOVES = 0.004
"""m/s of the handle below which it counts as at rest: pads and springs deform before dry friction is complete.
Sensitive: 0.5 σ; slower blocks have less than the full dry friction."""
HANDLE_SETS_OUT = 0.003
"""m from the start of a pass in which no block counts, as the friction of joints, pads and rails reverses. Sensitive:
dry friction 1.4 σ, damping 2.2 σ. If shorter, reversing friction counts as dry friction."""
HANDLE_RATE = 0.05
"""s. Common smoothing window of speeds, torques and link motion. Different windows would turn ramps into apparent
inertia and damping. Sensitive: at twice it dry friction 0.3 σ, damping 0.3 σ."""

SETTING_OUT = 20  # rows, 0.1 s, at the start of a recording, in which the hand rests


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """Block means of k blocks, from passes with the handle in the hand and with the empty hand.

    Forces act along the joint: N for a slide, N m for a hinge. The arm has m joints.
    """

    t: Array  # (k,) s
    held: Array  # (k,) 1 with the handle in the hand, else 0
    recording: Array  # (k,) number of the recording
    travel: Array  # (k,) m or rad, from the start of the recording
    # rate, acceleration: (k,) travel per s, per s²
    rate: Array
    acceleration: Array
    force: Array  # (k,) force of the hand, from the torques of the arm's joints
    white: Array  # (k,) variance of `force` by white noise
    rubbing: Array  # (k, m) force per N m of friction in each joint, signed by its last motion
    viscous: Array  # (k, m) force per N m s/rad of viscous friction in each joint
    # (k, m) force by the inertial torque of the links, joint by joint; (k, 0) if unknown.
    moved: Array
    # (k, m) force per relative error of each torque sensor, for a unit force along the joint.
    shown: Array


def passes_of(trace: Trace, recordings: list[Recording], joint: Joint) -> Passes | None:
    """Blocks of all passes in recordings of one fixture; None if nothing moved."""
    observed = observe_wrench(trace)
    # Blocks of all recordings, transposed to one array a field.
    parts = [
        block
        for number, recording in enumerate(recordings)
        for block in _blocks(trace, recording, number, joint, observed)
    ]
    if not parts:
        return None
    return Passes(*(np.array(column) for column in zip(*parts, strict=True)))


def _blocks(
    trace: Trace, recording: Recording, number: int, joint: Joint, observed: WrenchObservation
) -> Iterator[tuple[Array | float, ...]]:
    """Yield the fields of `Passes` for each block of a recording."""
    samples = trace.of(recording)
    if len(samples) <= SETTING_OUT:
        return
    # Travel and rate of the handle along its joint, from the pose of the hand.
    first, last = np.searchsorted(trace.samples.t, [recording.start, recording.end + 1e-9])
    signals = observed.signals[int(first) : int(last)]
    moving = commanded_rows(samples)
    start = mean_pose(samples.where(slice(0, SETTING_OUT)))
    positions = samples.pose_world_tcp[:, :3]
    travel = joint.travels(start, positions)
    rates = (
        samples.twist[:, :3] @ joint.axis if joint.is_slide else samples.twist[:, 3:] @ joint.axis
    )
    rate, change = smoothed_with_rate(rates[:, None], samples.t, HANDLE_RATE)
    maps = observed.maps(samples.q)
    # Force along the joint per signal: its row of (J^T)^+.
    along = joint.along(positions)
    weights = np.einsum("ni,nij->nj", along, np.linalg.pinv(maps))
    # Torque that the arm's own links need, and Dahl's state of joint friction.
    states = dahl_states(samples.q)[:, :, TURNED]
    own = observed.own_motion(samples, np.ones(len(samples), dtype=bool), HANDLE_RATE)
    known_links = own.shape == weights.shape
    # Use the window of the rates, so that force and rate belong to the same time where the speed changes.
    felt, _ = smoothed_with_rate(signals, samples.t, HANDLE_RATE)
    force = np.einsum("nj,nj->n", weights, felt - own if known_links else felt)
    # Joint torques of a unit force along the joint: J^T of the unit wrench.
    unit = np.einsum("nij,nj->ni", maps, along) / (along**2).sum(axis=1)[:, None]
    joints = states.shape == weights.shape
    # Arm columns: joint friction, viscous friction, link inertia, sensor gains.
    none = np.zeros((len(samples), 0))
    columns = (
        weights * states if joints else none,
        weights * samples.dq if joints else none,
        weights * own if known_links else none,
        weights * unit,
    )
    # Average every column over the blocks in which the handle moves fast enough.
    lever = joint.lever(start.position)
    white = float(np.var(np.diff(force))) / 2.0 if len(force) > 2 else 0.0
    held = float(recording.context.holding is not None)
    for rows in blocks_of(samples.t, moving, travel * lever):
        if np.abs(rate[rows]).min() * lever < HANDLE_MOVES:
            continue
        scalars = samples.t, np.full(len(travel), held), np.full(len(travel), float(number))
        shown = (*scalars, travel, rate[:, 0], change[:, 0], force)
        count = rows.stop - rows.start
        yield (
            *(float(column[rows].mean()) for column in shown),
            white / count,
            *(column[rows].mean(axis=0) for column in columns),
        )


def blocks_of(t: Array, moving: Mask, way: Array) -> Iterator[slice]:
    """Yield equal blocks of about `HANDLE_BLOCK` s of each motion.

    `way` (n,), m, is the travel of the handle. Its first `HANDLE_SETS_OUT` of each motion is skipped.
    """
    for whole in runs(moving):
        # Skip the start of the motion, in which friction reverses, and divide the rest into equal blocks.
        gone = np.abs(way[whole] - way[whole.start])
        rows = slice(whole.start + int(np.argmax(gone > HANDLE_SETS_OUT)), whole.stop)
        duration = float(t[rows.stop - 1] - t[rows.start])
        count = round(duration / HANDLE_BLOCK)
        if count < 1:
            continue
        length = rows.stop - rows.start
        for i in range(count):
            yield slice(rows.start + i * length // count, rows.start + (i + 1) * length // count)


# Friction, damping and spring of a joint: linear regression of the force at its handle


HANDLE_ONSET = (0.004, 0.015, 0.019, 0.023, 0.028, 0.034, 0.041, 0.05)
"""m/s of the handle from which dry friction is complete. In MuJoCo this speed is about 0.001 m/s times friction over
moving mass (N/kg); grease has the same effect. Sensitive: with the first alone, the friction of a door of 0.6 kg was
40 % too low, contradicted."""
DECISIVE = 8.0
"""Logarithm of the ratio of evidence from which an onset within the speeds of the passes counts. A wrong one trades
damping for dry friction. Errors of single blocks made 3 to 5 for doors of 3 mm/s. Sensitive: at 0 the damping of two
of four doors at `measured` was 1.8 and 2.6 σ too low, with it 0.5 and 1.1."""
HANDLE_FORCE = 50.0
"""N (1 sigma). Uninformative prior of forces at a handle: dry friction, gravity or a spring. Sensitive: no, it is wider
than any handle's force."""
HANDLE_VISCOUS = 200.0
"""N s/m (1 sigma). Uninformative prior of a damping at the handle. Sensitive: no, it is wider than any rail's."""
HANDLE_STIFFNESS = 500.0
"""N/m (1 sigma). Uninformative prior of a stiffness at the handle. Sensitive: no, it exceeds any door closer's."""
HANDLE_MASS = 20.0
"""kg (1 sigma). Uninformative prior of the apparent mass at the handle. Sensitive: no, it is heavier than an arm can
move."""
HANDLE_DRIFT = 20.0
"""N per m (1 sigma). Change of the arm's own force along a path beyond the effect of joint friction, as `touch.DRIFT`.
Sensitive: no, friction and damping do not move."""
HANDLE_ELSEWHERE = 0.2
"""Fraction of `HANDLE_DRIFT` (1 sigma) by which it differs between the handle and above it. Sensitive: it dominates a
spring's std, which at 1 is that of the whole drift."""
HANDLE_LOADED = (0.1, 0.07)
"""Fractions (1 sigma) of joint friction by which it differs between the held handle and the empty hand: at any speed,
and in proportion to speed at the highest. Chosen: in 32 drawers at `measured` the error of the damping is 0.96 (rms)
of its stated deviation, with 0.05 for the second 1.11; in 60 doors at three noise levels it is less. Sensitive: std of
dry friction ×0.6–1.0 at half of both, of damping ×0.6–0.8; values move by less than 0.1 σ."""
HANDLE_EVEN = 0.1
"""N at the handle. Tolerated variation of friction along the path, or at higher speed. Sensitive: it affects only the
test of uniform friction."""
HANDLE_UNEVEN = 0.05
"""Tolerated variation of friction, as a fraction of the whole. Sensitive: it affects only the test of uniform
friction."""
HANDLE_LEVEL = 0.02
"""Cosine between the vertical and a slide's direction, or the horizontal and a hinge's axis. Below it gravity does not
depend on the position. Sensitive: no, 0.02 of a weight is less than the deviation of friction."""

DRY, DAMPING, SPRING, INERTIA, PULL = "dry friction", "damping", "spring", "inertia", "pull"
"""Names of causes."""
RUBBING = "joint friction"
ONSET = "onset of dry friction"
OF_JOINT = (DRY, DAMPING, SPRING, INERTIA, PULL, ONSET)


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """Fit of all passes of one fixture."""

    joint: Joint  # joint of the fixture
    lever: float  # m that the handle moves per unit of the joint's position
    # Recordings with the handle in the hand, and with the empty hand.
    recordings: tuple[Recording, ...]
    passes: Passes  # block means
    posterior: Posterior  # posterior of all causes
    tests: tuple[FitTest, ...]  # tests of the model

    def of(self, name: str) -> tuple[float, float]:
        """Value and standard deviation of a cause `name` with one unknown."""
        (value,), ((variance,),) = self.posterior[name]
        return float(value), float(np.sqrt(variance))

    @property
    def speeds(self) -> tuple[float, float]:
        """Smallest and largest mean speed of the handle's blocks, m/s or rad/s."""
        speeds = np.abs(self.passes.rate[self.passes.held > 0.0])
        return float(speeds.min()), float(speeds.max())

    def own(self) -> Array:
        """(k,) force of the blocks without the causes in the arm itself."""
        causes = self.posterior.causes
        return self.passes.force - sum_of(self.posterior, [c.name for c in causes[len(OF_JOINT) :]])

    def predicted(self) -> Array:
        """(k,) force of the joint as fitted."""
        return sum_of(self.posterior, OF_JOINT)


def sum_of(found: Posterior, names: Sequence[str]) -> Array:
    """Force (k,) by the causes `names` of a fit."""
    causes = [cause for cause in found.causes if cause.name in names]
    parts = [cause.columns @ found[cause.name][0] for cause in causes]
    return np.sum(parts, axis=0) if parts else np.zeros(len(found.model.y))


@once
def fit_joint(trace: Trace, name: str, joint: Joint) -> JointFit | None:
    """Fit the passes of fixture `name`; None if no recording shows its handle move."""
    # Passes with the handle, and the same passes with the empty hand.
    worked = [r for r in trace.recordings if r.context.activity == "working"]
    held = [r for r in worked if r.context.holding == name]
    empty = [r for r in worked if r.context.holding is None and r.context.place_of == name]
    passes = passes_of(trace, [*held, *empty], joint) if held else None
    if passes is None or not passes.held.any():
        return None
    lever = joint.lever(trace.of(held[0]).pose_world_tcp[0, :3])
    first = _likeliest(passes, joint, lever)
    causes, noise = list(first.causes), first.noise
    # Gain errors are proportional to the measured force, so they need a first fit.
    felt = sum_of(first, OF_JOINT)[:, None]
    gains = gain_root(trace.hand, int(passes.shown.shape[1]))
    if trace.hand.wrench_sensor is not None and is_sensed(trace):
        gains = trace.hand.wrench_sensor.gain * np.eye(len(gains))
    causes.append(build_gain((felt * passes.shown) @ gains))
    causes.append(_load_friction_cause(passes, first))
    scales = [PriorScale((GAIN,), *GAINS_OFF)]
    found = fit(causes, noise, passes.force, scales)
    tests = tuple(_tests(found, passes, lever))
    return JointFit(joint, lever, (*held, *empty), passes, found, tests)


def _likeliest(passes: Passes, joint: Joint, lever: float) -> Posterior:
    """Fit with the onset speed of dry friction of decisive evidence, else with the slowest; and with its
    uncertainty."""
    found: list[Posterior] = []
    noise: SignalNoise | None = None
    for number in range(len(HANDLE_ONSET)):
        causes = [*_of_joint(passes, joint, lever, number), *_of_arm(passes, lever)]
        # All candidates share the residual of the first, so that their evidence is comparable.
        noise = noise or _noise(passes, causes)
        found.append(fit(causes, noise, passes.force))
    # Linearise the dependence on the onset speed about the best candidate.
    evidence = np.array([one.evidence for one in found])
    best = int(np.argmax(evidence))
    if evidence[best] < evidence[0] + DECISIVE:
        # Friction is complete in all blocks: the fastest of the onsets that no block distinguishes from the slowest.
        best = int(np.flatnonzero(np.isclose(evidence, evidence[0], rtol=0.0, atol=1e-6))[-1])
    causes = list(found[best].causes)
    causes.insert(len(OF_JOINT) - 1, _onset(passes, lever, best, float(found[best][DRY][0][0])))
    return fit(causes, _noise(passes, causes), passes.force)


def _onset(passes: Passes, lever: float, number: int, dry: float) -> Cause:
    """Cause of another onset speed of dry friction than candidate `number`: half way to its neighbours.

    The dependence is linearised; `dry` is the dry friction.
    """
    last = len(HANDLE_ONSET) - 1
    near = [_come_in(passes, lever, min(max(number + i, 0), last)) for i in (-1, 1)]
    return Cause.build(ONSET, (dry * passes.held * (near[1] - near[0]))[:, None], 0.25)


def _come_in(passes: Passes, lever: float, number: int) -> Array:
    """(k,) fraction of the full dry friction in each block, signed as the rate."""
    full = HANDLE_ONSET[number] / lever
    return passes.rate / np.maximum(np.abs(passes.rate), full)


def _of_joint(passes: Passes, joint: Joint, lever: float, number: int) -> Iterator[Cause]:
    """Yield causes of the force along the joint; the handle moves by `lever` m per unit of its position."""
    # Dry friction, damping, spring and inertia, with priors in units of the joint.
    held = passes.held
    position = joint.position + passes.travel
    columns = (
        (DRY, _come_in(passes, lever, number), HANDLE_FORCE * lever),
        (DAMPING, passes.rate, HANDLE_VISCOUS * lever**2),
        (SPRING, position - joint.spring, HANDLE_STIFFNESS * lever**2),
        (INERTIA, passes.acceleration, HANDLE_MASS * lever**2),
    )
    for name, column, size in columns:
        yield Cause.build(name, (held * column)[:, None], size)
    # Gravity: a constant for a slide or an upright hinge.
    pulls = [np.ones_like(position)]
    if not joint.is_slide and abs(joint.axis[2]) < 1.0 - HANDLE_LEVEL**2 / 2:
        # About a tilted axis the moment of the weight is a sinusoid of the position.
        pulls += [np.sin(passes.travel), np.cos(passes.travel) - 1.0]
    yield Cause.build(PULL, held[:, None] * np.column_stack(pulls), HANDLE_FORCE * lever)


def _of_arm(passes: Passes, lever: float) -> Iterator[Cause]:
    """Yield causes of force in the arm itself: drift, zeros, joint friction and inertia of the links."""
    drift = HANDLE_DRIFT * lever**2
    # With and without the handle the arm has nearly the same poses, so most of its drift is common to both.
    yield Cause.build("drift", passes.travel[:, None], drift)
    # Each recording has its own zero and a small own slope.
    for number in np.unique(passes.recording).tolist():
        here = (passes.recording == number).astype(float)
        columns = np.column_stack([here, here * passes.travel])
        prior = [HANDLE_FORCE * lever, HANDLE_ELSEWHERE * drift]
        yield Cause.build(f"zero {number:.0f}", columns, prior)
    # Dry and viscous friction of the arm's joints, and inertia of its links; none where they are unknown.
    yield Cause.build(RUBBING, passes.rubbing, JOINT_LEVEL)
    yield Cause.build("viscous joint friction", passes.viscous, JOINT_VISCOUS)
    yield Cause.build("inertia of the arm", passes.moved, INERTIA_SHARE)


def _load_friction_cause(passes: Passes, first: Posterior) -> Cause:
    """Change of joint friction by the load; it cannot be separated from the fixture's own friction."""
    felt = sum_of(first, [RUBBING])
    size = float(np.sqrt(np.mean(felt**2)))
    way, fastest = passes.held * np.sign(passes.rate), float(np.abs(passes.rate).max())
    columns = np.column_stack([way, passes.held * passes.rate / fastest])
    prior = np.maximum(np.array(HANDLE_LOADED) * size, FLOOR)
    return Cause("joint friction with a load", columns, prior)


def _noise(passes: Passes, causes: Sequence[Cause]) -> SignalNoise:
    """White noise of the blocks, with a coloured residual."""
    # White noise of a block, and a residual that depends on time and travel.
    white = np.sqrt(passes.white + FLOOR**2)
    sensors = SignalNoise([np.diag(white)], float(len(white)))
    count = len(passes.t)
    spans = Spans(
        passes.t,
        np.full(count, HANDLE_BLOCK),
        passes.travel[:, None],
        np.abs(passes.rate[:, None]) * HANDLE_BLOCK,
    )
    return with_residual(sensors, learn_residual(causes, sensors, passes.force, spans), spans)


def _tests(found: Posterior, passes: Passes, lever: float) -> Iterator[FitTest]:
    """Yield tests of uniform dry and viscous friction; a deviation of a few per cent is tolerated."""
    # Scale of the tolerated deviation: dry friction plus viscous friction at the highest speed.
    way, held = np.sign(passes.rate), passes.held
    (dry,), _ = found[DRY]
    (damping,), _ = found[DAMPING]
    fastest = float(np.abs(passes.rate).max())
    size = abs(dry) + abs(damping) * fastest
    # Deviations that are tested: friction linear in the position, and quadratic in the speed.
    middle, half = passes.travel.mean(), max(float(np.ptp(passes.travel)) / 2, 1e-9)
    along = held * way * (passes.travel - middle) / half
    speed = (np.abs(passes.rate) / fastest) ** 2
    for name, column, finding in (
        ("friction along the way", along, "It rubs more at one end of its way than at the other."),
        (
            "slow against fast",
            held * way * (speed - speed[held > 0.0].mean()),
            "The force does not grow in proportion to the speed: it is no viscous friction.",
        ),
    ):
        cause = Cause.build(name, column[:, None], HANDLE_FORCE * lever)
        tolerated = np.array([HANDLE_UNEVEN * size + HANDLE_EVEN * lever])
        yield found.test(cause, tolerated, finding)
