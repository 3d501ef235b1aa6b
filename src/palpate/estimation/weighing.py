"""Weighing of a held object, and the precision that planned passes will give."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import Spans
from palpate.estimation.estimate import (
    KNOWN,
    FitTest,
    FitView,
    FurtherValue,
    Shared,
    add_shared,
    constant,
    map_shared,
    unit_slopes,
)
from palpate.estimation.joint_causes import LOAD_PRIOR, build_load, by_signal
from palpate.estimation.load_blocks import CLEARANCE, Blocks
from palpate.estimation.load_equations import (
    FORCE_BIAS,
    FORCE_Z,
    TORQUE_X,
    TORQUE_Y,
    each_its_own,
    in_each,
)
from palpate.estimation.load_fit import (
    FittedLoad,
    LoadEstimate,
    WholeLoad,
    fit_load,
    fit_whole,
    foreseen,
)
from palpate.estimation.load_noise import SignalLevels, load_rows
from palpate.estimation.motion import Mask
from palpate.estimation.segments import (
    BINS,
    SHORT_LIFT,
    Segment,
    Weighing,
    has_reference,
    weighings,
)
from palpate.estimation.wrench_observation import WrenchObservation
from palpate.trace.recording import NominalHand, Recording
from palpate.trace.samples import FORCES, Trace

WHOLE_APART = 3.0
"""standard deviations of the contrast: largest accepted difference between the fit to all free
motion and the contrast. Not sensitive."""
VIEW_STRETCH = 0.5
"""s of free motion in one point of a chart. Not sensitive, as no value depends on a chart."""

ALONE = "no rest or pass of the empty hand at the same pose was recorded for comparison"
KINDS = {"up": "on the way up", "down": "on the way down", "rest": "at rest", "turn": "turning"}


@dataclass(frozen=True, slots=True, eq=False)
class Weight:
    """Mass of the object held during a recording."""

    gravity: float  # m/s²
    weighings: Sequence[Weighing]  # the segments that were compared
    load: LoadEstimate  # the fit of the weighings
    # The fit to all free motion, where it is more precise and gives the mass.
    whole: WholeLoad | None = None

    @property
    def best(self) -> FittedLoad:
        """The fit that gives the mass."""
        return self.whole or self.load

    @property
    def mass(self) -> float:
        """kg, unconstrained: the mass of a light object may be negative."""
        return self.best.force / self.gravity

    @property
    def std(self) -> float:
        """kg, standard deviation of `mass`."""
        return self.best.force_std / self.gravity

    @property
    def doubt(self) -> str:
        """Reason, a phrase, for a prior-dominated mass; empty where the empty hand was recorded."""
        # Without a reference the bias of the arm keeps its prior.
        return "" if any(has_reference(one.segments) for one in self.weighings) else ALONE

    @property
    def shared(self) -> tuple[Shared, ...]:
        """Errors of `mass` in common with other weighings on that arm."""
        return map_shared(self.best.shared, np.eye(1, len(self.best.value)) / self.gravity)

    def view(self) -> FitView:
        """Chart the fit that gave `mass`, by parts of the recording."""
        if self.whole is None:
            return weighing_view(self.load, self.gravity)
        return whole_view(self.whole, self.gravity)


def weigh(trace: Trace, recording: Recording, by_all_motion: bool = True) -> Weight:
    """Weigh the object held during `recording`: its vertical force over g.

    The reference is the same rests and passes without the object, in every weighing of it.

    Args:
        by_all_motion: also fit all free motion around them, with the residual of the arm's model.

    Raises:
        ValueError: the recording holds no samples or no held object.
    """
    found = weighings(trace, recording, learned=by_all_motion)
    load = fit_load(found, trace.gravity, trace.hand)
    # Use the fit to all free motion where it is accepted, else the contrast.
    whole = whole_of(trace, recording, found, load) if by_all_motion else None
    return Weight(trace.gravity, found, load, whole)


def whole_of(
    trace: Trace, recording: Recording, found: Sequence[Weighing], load: LoadEstimate
) -> WholeLoad | None:
    """Fit the load to all free motion around its weighings, and take the mean with theirs by inverse variances.

    Both share rows, so that the deviation remains that of the fit alone. The mean has no larger one unless the
    correlation of both errors exceeds the ratio of their deviations. In 72 weighings at `measured` the mean was 6.3 g
    off (rms), the fit alone 6.9 g.

    None where the fit is not more precise, a test failed, or both results disagree.
    """
    name = recording.context.holding
    if name is None or not load.agrees:
        return None
    whole = fit_whole(trace, name, found[0].noise, load.force)
    if whole is None or whole.force_std >= load.force_std:
        return None
    apart = load.force - whole.force
    if abs(apart) >= WHOLE_APART * load.force_std:
        return None
    # The levers follow the weight by their covariance.
    gain = whole.covariance[:, :1] / (whole.covariance[0, 0] + load.covariance[0, 0])
    kept = np.eye(len(gain)) - gain @ np.eye(1, len(gain))
    added = map_shared(load.shared, gain @ np.eye(1, len(load.value)))
    shared = add_shared(map_shared(whole.shared, kept), added)
    return replace(whole, value=whole.value + apart * gain[:, 0], shared=shared)


def hangs_free(trace: Trace, name: str) -> tuple[FitTest, ...]:
    """Test for forces other than its weight on an object held in the air; empty without such a recording."""
    for recording in trace.recordings:
        context = recording.context
        still = recording.buffer == FORCES and context.activity == "still"
        if still and context.holding == name:
            return fit_load(weighings(trace, recording), trace.gravity, trace.hand).tests
    return ()


def single_shot(trace: Trace, recording: Recording) -> FurtherValue:
    """Compute the mean of F_z / g over a recording's samples, kg: the paper's Force2Mass.

    It contains the bias of a force without a reference. The standard deviation of the bias is the
    robust one of all F_z of the empty hand about zero, and at least `FORCE_BIAS`.
    """
    force = trace.of(recording).wrench[:, FORCE_Z]
    # Bias: median absolute F_z of the empty hand, as a standard deviation.
    empty = np.abs(trace.samples.wrench[load_rows(trace, None).empty, FORCE_Z])
    shown = 1.4826 * float(np.median(empty)) if len(empty) else 0.0
    std = float(np.hypot(force.std(), max(shown, FORCE_BIAS)))
    return FurtherValue(float(force.mean()) / trace.gravity, std / trace.gravity, "kg")


def weighing_view(load: LoadEstimate, gravity: float) -> FitView:
    """Chart the mass by rests and passes of the fit `load`."""
    columns: list[Array] = []
    parts: list[Segment] = []
    for weighing, row in zip(load.weighings, load.rows, strict=True):
        # Signals per newton of the fitted load, moments included.
        vertical = np.column_stack(
            [row.wrench[:, FORCE_Z], in_each(row, load.grasps, (TORQUE_X, TORQUE_Y))]
        )
        borne = vertical @ load.value / load.force
        # One column for each loaded segment: the load in its rows only.
        count = [len(segment.t) for segment in weighing.segments]
        owner = np.tile(np.repeat(np.arange(len(count)), count), len(borne) // sum(count))
        loaded = [i for i, segment in enumerate(weighing.segments) if segment.loaded]
        own = np.array([borne * (owner == i) for i in loaded]).T
        columns.append(own)
        parts += [weighing.segments[i] for i in loaded]
    # Fit an extra load to each segment alone.
    wide = np.concatenate(each_its_own(columns))
    return mass_view(
        np.array([(part.start + part.end) / 2.0 for part in parts]),
        load.force / gravity,
        load.posterior.each_alone(gravity * wide, LOAD_PRIOR / gravity),
        "Each rest and each pass with the object, fitted with a mass of its own, less the empty hand's",
        [KINDS.get(part.kind.split()[0], part.kind) for part in parts],
    )


def whole_view(whole: WholeLoad, gravity: float) -> FitView:
    """Chart the mass by stretches of free motion of the fit `whole`."""
    seen = whole.seen
    # Signals per newton of the fitted load.
    load = np.hstack([cause.columns for cause in build_load(seen, seen.pull)])
    borne = load @ whole.value / whole.force
    parts = list(_stretches(seen))
    # One column for each stretch: the load in its blocks only.
    signals = seen.observed.shape[1]
    shares = np.column_stack(
        [by_signal(np.tile(part[:, None], signals).astype(float)) for part in parts]
    )
    columns = borne[:, None] * shares
    resting, about = seen.resting.sum(axis=1), whole.posterior.mean[0] - whole.force
    extra, variance = whole.posterior.each_alone(gravity * columns, LOAD_PRIOR / gravity)
    return mass_view(
        np.array([float(seen.t[part].mean()) for part in parts]),
        whole.force / gravity,
        (extra + about / gravity, variance),
        "Each half second in which the object hung free, fitted with a mass of its own",
        [KINDS["rest"] if float(resting[part].mean()) > 0.5 else "in motion" for part in parts],
    )


def mass_view(
    x: Array, mass: float, extra: tuple[Array, Array], parts: str, groups: Sequence[str] | str
) -> FitView:
    """Chart a mass by parts of a recording at times `x` (n,), s.

    Args:
        extra: means and variances (n,), kg and kg², of an extra mass in each part, fitted alone.
    """
    mean, variance = extra
    return FitView(
        name="Mass by part of the recording.",
        note=f"{parts}, ± 1 std with all error causes. Parts share causes, such as gains of the joints' "
        "sensors, so that their common fit is not their plain mean.",
        axes=("robot time (s)", "mass (kg)"),
        x=x,
        measured=mass + mean,
        predicted=constant(mass, x),
        std=np.sqrt(variance),
        groups=groups,
        slopes=unit_slopes(x),
    )


def _stretches(seen: Blocks) -> Iterator[Mask]:
    """Yield the blocks (k,) of each stretch in which the load hung free."""
    hanging = np.flatnonzero(seen.pull[:, 2] > 0.0)
    for run in np.split(hanging, np.flatnonzero(np.diff(seen.t[hanging]) > VIEW_STRETCH) + 1):
        # Split long runs into stretches of about `VIEW_STRETCH`.
        lasted = float(np.ptp(seen.t[run]))
        for rows in np.array_split(run, max(1, round(lasted / VIEW_STRETCH))):
            part = np.zeros(len(seen.t), dtype=bool)
            part[rows] = True
            yield part


# Predicted precision of a load after planned passes.


HANDLING = 1.0
"""s between two planned passes, in which the arm settles and the fingers close or open. Sensitive:
robot time only, by as much per pass."""

NEAR = 2.0 * CLEARANCE
"""m of a pass that are near a support."""
PASSES = (("down", False), ("up", True), ("down", True), ("up", False))
"""Direction of each pass of one cycle, and whether it is loaded. The order empty, loaded, loaded,
empty cancels a drift."""


@dataclass(frozen=True, slots=True, eq=False)
class Lift:
    """Planned straight lift, and the precision of a load that its passes give.

    The covariance of the fit needs the planned motion and the noise, but no measured values.
    """

    q: Array  # (2, m) rad, joint angles at the grasp and above it
    length: float  # m
    near_speed: float  # m/s, the largest near a support
    acceleration: float  # m/s²
    observed: WrenchObservation  # wrench observation of the arm; its signals are not used
    white: Array  # (m,) (N m)² s, variance of a signal's mean over 1 s
    flicker: Array  # (m,) see `SignalLevels`

    def seconds(self, speed: float) -> float:
        """Robot time of one cycle at `speed` m/s, s."""
        near = min(NEAR, self.length)
        slowly = near / min(speed, self.near_speed) + speed / self.acceleration
        return len(PASSES) * ((self.length - near) / speed + slowly + HANDLING)

    def noise(
        self, cycles: int, speed: float, weight: float, gravity: float, hand: NominalHand
    ) -> float:
        """Predict the standard deviation, N, by noise alone, of a load of `weight` N after some
        cycles at `speed` m/s."""
        exact = replace(hand, torque_gain=0.0, gain_covariance=None)
        return float(np.sqrt(foreseen(self._weighing(cycles, speed), weight, gravity, exact)))

    def floor(
        self, cycles: int, speed: float, weight: float, gravity: float, hand: NominalHand
    ) -> float:
        """Predict the standard deviation, N, of that load by the gains; further cycles do not reduce it."""
        noise = self.noise(cycles, speed, weight, gravity, hand)
        whole = foreseen(self._weighing(cycles, speed), weight, gravity, hand)
        return float(np.sqrt(max(whole - noise**2, 0.0)))

    def _weighing(self, cycles: int, speed: float) -> Weighing:
        """Build the segments of the planned cycles, without signals."""
        segments: list[Segment] = []
        start = 0.0
        for grasp in range(cycles):
            for kind, loaded in PASSES:
                segments.append(self._pass(kind, loaded, float(grasp), start, speed))
                start += self.length / speed + HANDLING
        noise = SignalLevels(self.white, self.flicker, KNOWN)
        return Weighing(segments, noise, self.observed.scale)

    def _pass(self, kind: str, loaded: bool, grasp: float, start: float, speed: float) -> Segment:
        """Build the steady part of a pass, in bins."""
        # Bin centres as shares of the lift, and the duration of a bin.
        clear = min(CLEARANCE, SHORT_LIFT * self.length) / self.length
        edges = np.linspace(clear, 1.0, BINS + 1)
        share = (edges[1:] + edges[:-1]) / 2.0
        part = (1.0 - clear) * self.length / BINS / speed
        gone = share if kind == "up" else 1.0 - share
        # Joint angles along the lift (linear), and the path of each joint so far.
        q = self.q[0] + share[:, None] * (self.q[1] - self.q[0])
        maps = self.observed.maps(q)
        count = len(self.white)
        t = start + gone * self.length / speed
        turns = np.abs(self.q[1] - self.q[0])
        path = (start * speed / self.length + gone)[:, None] * turns
        every = np.ones((BINS, 1))
        return Segment(
            kind,
            loaded,
            grasp,
            start=start,
            end=start + self.length / speed,
            t=t,
            path=share * self.length,
            acceleration=np.zeros(BINS),
            speed2=np.full(BINS, speed**2),
            maps=maps,
            observed=np.zeros((BINS, count)),
            variance=np.tile(self.white / part, (BINS, 1)),
            motion=np.zeros((BINS, 0)),
            dahl=np.zeros((BINS, 0, 0)),
            turned=np.zeros(BINS),
            spans=Spans(t, part * every[:, 0], path, every * turns / BINS),
        )
