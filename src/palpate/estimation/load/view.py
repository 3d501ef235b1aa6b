"""Mass from each part of a recording, beside the fit of all parts.

A part is a rest or a pass of a weighing, or half a second of free motion. Its value is the fitted mass
plus the posterior mean of a load of its own in that part alone, one further coefficient of the same
model (`Model.each_alone`); its standard deviation is that coefficient's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.around.blocks import Blocks
from palpate.estimation.load.around.causes import Cause, of_load, whitened
from palpate.estimation.load.around.whole import Whole
from palpate.estimation.load.equations import FORCE_Z, TORQUE_X, TORQUE_Y, each_its_own, in_each
from palpate.estimation.load.fit import Load
from palpate.estimation.load.segments import Segment
from palpate.estimation.view import FitView, constant, unit_slopes
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array

KINDS = {"up": "on the way up", "down": "on the way down", "rest": "at rest", "turn": "turning"}


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
        columns.append(row.white(own))
        parts += [weighing.segments[i] for i in loaded]
    wide = np.concatenate(each_its_own(columns))
    mean, variance = load.model.each_alone(wide, tuning.LOAD_PRIOR)
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
    load = np.array([cause.torque for cause in of_load(seen, seen.pull)])
    borne = np.tensordot(whole.value, load, 1) / whole.force
    parts = list(_stretches(seen))
    causes = [Cause("part", borne * part[:, None], tuning.LOAD_PRIOR) for part in parts]
    columns, _ = whitened(causes, seen, whole.noise)
    resting = seen.resting.sum(axis=1)
    return _view(
        np.array([float(seen.t[part].mean()) for part in parts]),
        whole.force,
        whole.model.each_alone(columns, tuning.LOAD_PRIOR),
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
