"""Weighing of a held object: shared by mass, momentum and centre of mass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest
from palpate.estimation.estimate import Part, Shared
from palpate.estimation.load.blocks import Blocks
from palpate.estimation.load.causes import by_signal, of_load
from palpate.estimation.load.equations import FORCE_Z, TORQUE_X, TORQUE_Y, each_its_own, in_each
from palpate.estimation.load.fit import Load, fit_load, untested
from palpate.estimation.load.in_hand import load_rows
from palpate.estimation.load.segments import Segment, Weighing, referenced, weighings
from palpate.estimation.load.whole import Whole, fit_whole
from palpate.estimation.motion import Mask
from palpate.estimation.view import FitView, constant, unit_slopes
from palpate.geometry.pose import Array
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

ALONE = "no rest or pass of the empty hand at the same pose was recorded for comparison"
KINDS = {"up": "on the way up", "down": "on the way down", "rest": "at rest", "turn": "turning"}


@dataclass(frozen=True, slots=True, eq=False)
class Weight:
    """Mass of the object held during a recording.

    Attributes:
        mass, std: kg, unconstrained: the mass of a light object may be negative.
        doubt: why the mass is prior-dominated, a phrase; empty where the empty hand was recorded.
        weighings: of which it is the mass.
        tests: for other forces on the object.
        shared: errors in common with other weighings on that arm.
        freedom: degrees of freedom of the noise.
        load: the fit of the weighings.
        whole: the fit to all free motion, where that is more precise and gives the mass.
    """

    mass: float
    std: float
    doubt: str
    weighings: Sequence[Weighing]
    tests: tuple[FitTest, ...]
    shared: tuple[Shared, ...]
    freedom: float
    load: Load
    whole: Whole | None = None

    @property
    def part(self) -> Part:
        """Estimate of the mass as a part of another estimate."""
        return Part(self.mass, self.std, "kg")

    def view(self, gravity: float) -> FitView:
        """The fit that made `mass`, by parts of the recording."""
        if self.whole is None:
            return weighing_view(self.load, gravity)
        return whole_view(self.whole, gravity)

    @property
    def segments(self) -> Sequence[Segment]:
        """All rests and passes."""
        return [segment for weighing in self.weighings for segment in weighing.segments]


def weigh(trace: Trace, recording: Recording, by_all_motion: bool = True) -> Weight:
    """The load's vertical force over g, against the same rests and passes without the object, from
    every weighing of what was held during `recording`; and `by_all_motion` in free air around them, with what the
    model of the arm leaves there.

    Raises:
        ValueError: the recording holds no samples or no held object.
    """
    found = weighings(trace, recording, learned=by_all_motion)
    load = fit_load(found, trace.gravity, trace.hand)
    whole = whole_of(trace, recording, found, load) if by_all_motion else None
    force, std = (load.force, load.force_std) if whole is None else (whole.force, whole.std)
    made = load if whole is None else whole
    shared = shared_sensors(made.gains[:1] / trace.gravity, made.crosstalk[:1] / trace.gravity)
    if whole is not None:
        links = {name: effect[:1] / trace.gravity for name, effect in whole.links.items()}
        shared += shared_links(links)
    mass, std = force / trace.gravity, std / trace.gravity
    freedom = load.freedom if whole is None else whole.posterior.freedom
    # Without a reference the bias of the arm has its prior.
    doubt = "" if any(referenced(weighing.segments) for weighing in found) else ALONE
    return Weight(mass, std, doubt, found, load.tests, shared, freedom, load, whole)


def whole_of(
    trace: Trace, recording: Recording, found: Sequence[Weighing], load: Load
) -> Whole | None:
    """Load fitted to all free motion around its weighings, where that is more precise, no test failed, and
    both agree; else None."""
    name = recording.context.holding
    if name is None or not load.agrees:
        return None
    whole = fit_whole(trace, name, found[0].noise, load.force)
    if whole is None or whole.std >= load.force_std:
        return None
    apart = abs(whole.force - load.force)
    return whole if apart < tuning.WHOLE_APART * load.force_std else None


def shared_sensors(gains: Array, crosstalk: Array) -> tuple[Shared, ...]:
    """Shared causes: effects of one standard deviation of each joint sensor's gain and of its cross-talk, (n, joints)
    each, common to all measurements of an arm."""
    found: list[Shared] = []
    for name, effects in (("gain of", gains), ("cross-talk in", crosstalk)):
        for i, effect in enumerate(effects.T.tolist()):
            found.append(Shared(f"{name} joint {i + 1}", "arm", tuple(effect)))
    return tuple(found)


def shared_links(links: Mapping[str, Array]) -> tuple[Shared, ...]:
    """Shared causes: effects of link model errors by name, common to all measurements of an arm."""
    return tuple(Shared(name, "arm", tuple(effect.tolist())) for name, effect in links.items())


def hangs_free(trace: Trace, name: str) -> tuple[FitTest, ...]:
    """Tests for other forces than its weight on an object held in the air; empty without such a
    recording."""
    for recording in trace.recordings:
        context = recording.context
        still = recording.buffer == FORCES and context.activity == "still"
        if still and context.holding == name:
            return fit_load(weighings(trace, recording), trace.gravity, trace.hand).tests
    return ()


def single_shot(trace: Trace, recording: Recording) -> Part:
    """Mean of F_z / g of a recording's samples, kg: the paper's Force2Mass.

    It contains the bias of a force without a reference, whose standard deviation is that of all F_z of the empty
    hand about zero (robust), and at least `tuning.FORCE_BIAS`.
    """
    force = trace.of(recording).wrench[:, FORCE_Z]
    empty = np.abs(trace.samples.wrench[load_rows(trace, None).empty, FORCE_Z])
    shown = 1.4826 * float(np.median(empty)) if len(empty) else 0.0
    std = float(np.hypot(force.std(), max(shown, tuning.FORCE_BIAS)))
    return Part(float(force.mean()) / trace.gravity, std / trace.gravity, "kg")


def alone(trace: Trace, found: Sequence[Weighing]) -> Mapping[str, Part]:
    """Estimates of the mass from `rests` alone and `passes` alone, kg, where they have a reference."""
    parts: dict[str, Part] = {}
    for name, at_rest in (("rests", True), ("passes", False)):
        group = [weighing.only(at_rest) for weighing in found]
        group = [weighing for weighing in group if referenced(weighing.segments)]
        if group:
            force, std = untested(group, trace.gravity, trace.hand)
            parts[name] = Part(force / trace.gravity, std / trace.gravity, "kg")
    return parts


def weighing_view(load: Load, gravity: float) -> FitView:
    """Mass by rests and passes of the fit `load`."""
    columns: list[Array] = []
    parts: list[Segment] = []
    for weighing, row in zip(load.weighings, load.rows, strict=True):
        vertical = np.column_stack(
            [row.wrench[:, FORCE_Z], in_each(row, load.grasps, (TORQUE_X, TORQUE_Y))]
        )
        borne = vertical @ load.value / load.force
        count = [len(segment.t) for segment in weighing.segments]
        owner = np.tile(np.repeat(np.arange(len(count)), count), len(borne) // sum(count))
        loaded = [i for i, segment in enumerate(weighing.segments) if segment.loaded]
        own = np.array([borne * (owner == i) for i in loaded]).T
        columns.append(own)
        parts += [weighing.segments[i] for i in loaded]
    wide = np.concatenate(each_its_own(columns))
    mean, variance = load.posterior.each_alone(wide, tuning.LOAD_PRIOR)
    return _view(
        np.array([(part.start + part.end) / 2.0 for part in parts]),
        load.force,
        (mean, variance),
        [KINDS.get(part.kind.split()[0], part.kind) for part in parts],
        gravity,
        "Each rest and each pass with the object, fitted with a mass of its own, less the empty hand's",
    )


def whole_view(whole: Whole, gravity: float) -> FitView:
    """Mass by stretches of free motion of the fit `whole`."""
    seen = whole.seen
    load = np.hstack([cause.columns for cause in of_load(seen, seen.pull)])
    borne = load @ whole.value / whole.force
    parts = list(_stretches(seen))
    signals = seen.observed.shape[1]
    shares = np.column_stack(
        [by_signal(np.tile(part[:, None], signals).astype(float)) for part in parts]
    )
    columns = borne[:, None] * shares
    resting = seen.resting.sum(axis=1)
    return _view(
        np.array([float(seen.t[part].mean()) for part in parts]),
        whole.force,
        whole.posterior.each_alone(columns, tuning.LOAD_PRIOR),
        [KINDS["rest"] if float(resting[part].mean()) > 0.5 else "in motion" for part in parts],
        gravity,
        "Each half second in which the object hung free, fitted with a mass of its own",
    )


def _view(
    x: Array,
    force: float,
    own: tuple[Array, Array],
    groups: Sequence[str],
    gravity: float,
    parts: str,
) -> FitView:
    mean, variance = own
    mass = force / gravity
    return FitView(
        name="Mass by part of the recording.",
        note=f"{parts}, ± 1 std with all error causes. Parts share causes, such as gains of the joints' "
        "sensors, so that their common fit is not their plain mean.",
        axes=("robot time (s)", "mass (kg)"),
        x=x,
        measured=mass + mean / gravity,
        predicted=constant(mass, x),
        std=np.sqrt(variance) / gravity,
        groups=groups,
        slopes=unit_slopes(x),
    )


def _stretches(seen: Blocks) -> Iterator[Mask]:
    """(k,) blocks of each stretch in which the load hung free."""
    hanging = np.flatnonzero(seen.pull[:, 2] > 0.0)
    for run in np.split(
        hanging, np.flatnonzero(np.diff(seen.t[hanging]) > tuning.VIEW_STRETCH) + 1
    ):
        lasted = float(np.ptp(seen.t[run]))
        for rows in np.array_split(run, max(1, round(lasted / tuning.VIEW_STRETCH))):
            part = np.zeros(len(seen.t), dtype=bool)
            part[rows] = True
            yield part
