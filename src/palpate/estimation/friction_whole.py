"""Sliding friction from all motion around the drags, joint by joint.

Referred to a rest in the air, the force of a drag contains the change of the arm's biases from there to
here, and only the growth of the force with the pressure separates friction from it. But the same links,
zeros, gains and friction of the joints show in all free motion around the drags (`estimation.load.causes`).
Fitted together, the whole sliding force counts. In each block of a drag the other forces of the support are
unknown: the normal force with its friction, a sideways force, and moments.

The result depends on the model of the arm. What that leaves is a coloured residual, learned from the recording
(`estimation.coloured`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import learn_residual, with_residual
from palpate.estimation.drag_causes import (
    AXES,
    FIRST,
    FRICTION_PRIOR,
    HELD,
    HELD_FORCE_STD,
    MU,
    PLACES,
    PULL,
    SPEED,
    SPRING,
    SUPPORT_LEAN_STD,
    WAYS,
    middle_of,
    of_support,
    usual_speed,
)
from palpate.estimation.drags import Drag
from palpate.estimation.estimate import Shared
from palpate.estimation.friction_fit import LIKELY_UNEVEN, UNEVEN_SHARES
from palpate.estimation.load_blocks import UP, Blocks, Rows, blocks, free_rows
from palpate.estimation.load_causes import (
    by_signal,
    cause,
    free_noise,
    of_arm,
    of_load,
    of_turning,
    scales,
)
from palpate.estimation.motion import row_at
from palpate.estimation.regression import Cause, PriorScale, Projected, fit
from palpate.estimation.wrench_observation import WrenchObservation
from palpate.trace.samples import Trace

HOLDING_MORE = (0.0, 1.0, 10.0)
"""times `HELD_FORCE_STD` that it may be, where the arm's own forces are known. Sensitive: friction 0.5 σ, std
×0.5–1.1."""
LIKELY_HOLDING = (0.9, 0.08, 0.02)
"""... and how likely each is before it is felt. Dry friction is in proportion to pressure (Amontons); one thing in
ten is taken to cling. Chosen, without a source. Sensitive: friction 0.5 σ, std ×0.9–1.9."""
LIKELY_PULL = (0.9, 0.1)
"""how likely nothing pulls with the place, and something does, where the arm's own forces are known. Chosen, without
a source, as `LIKELY_HOLDING`. Sensitive: no at 0.95 (`lab`)."""
LEANING = (0.2, 1.0)
"""times `SUPPORT_LEAN_STD` that a support may be out of level ... Sensitive: friction std ×0.85 or so without it."""
LIKELY_LEANING = (0.7, 0.3)
"""... and how likely each is before it is felt: arms stand on what was levelled with a spirit level, to 1 mm/m, or
on what stands on a floor. Chosen, without a source. Sensitive: hardly."""
ZERO_STEP_STD = 0.1
"""N m (1 sigma) that a sensor's zero may be another after the drags where it jumped, and from which a model without
a jump does not hold: a jump of 1 N at the hand is 0.2 to 0.24, of all joints. Sensitive: no."""
LIKELY_STEP = (0.9, 0.1)
"""how likely none has, and some have. Chosen, without a source. Sensitive: no."""
WHOLE_ITERATIONS = 3
"""solutions of the fit to all motion: the first is up to two deviations from the last where the coefficient that it
begins with is 15 % off. Sensitive: no from 3 on (0.1 σ)."""

UNEVEN, HOLDS, LEAN, PULLS, STEP = (
    "unevenness",
    "what holds",
    "lean of support",
    "what pulls",
    "step",
)
"""Prefixes of the names of the scene's causes."""


@dataclass(frozen=True, slots=True, eq=False)
class WholeFriction:
    """A friction from a whole stretch of a trace.

    Attributes:
        friction, std: the coefficient, and its standard deviation.
        shared: errors in common with measurements with that arm, or of that object.
        stepped: N m, change of the sensors' zeros after the drags, root mean square.
    """

    friction: float
    std: float
    shared: tuple[Shared, ...]
    stepped: float

    @property
    def explains(self) -> bool:
        """Zeros of the sensors are the same before and after the drags."""
        return self.stepped < ZERO_STEP_STD


@dataclass(frozen=True, slots=True, eq=False)
class _Pressed:
    """Support forces in the blocks: first those of free motion, then those of the drags; `way` (k, 3): direction
    of the drag, 0 in free motion; `support` (k, FIRST) as `columns.of_support`."""

    way: Array
    support: Array

    @property
    def normal(self) -> Array:
        """(k,) N."""
        return self.support[:, MU]

    @property
    def slides(self) -> Array:
        """(k,) 1 in drags."""
        return np.linalg.norm(self.way, axis=1).round()


def fit_whole(
    trace: Trace, name: str, drags: Sequence[Drag], observed: WrenchObservation, about: float
) -> WholeFriction | None:
    """Fit the coefficient with which `name` slid in all drags, near `about`; None where the arm's links are
    unknown, or it never hung free."""
    free = free_rows(trace, name) if observed.knows_links else []
    if not free:
        return None
    slid: list[Rows] = []
    for drag in drags:
        first = row_at(trace.samples, float(drag.t[0]))
        slid += [first + block for block in drag.slid]
    seen = blocks(trace, observed, name, [*free, *slid])
    pressed = _support_forces(drags, len(free))
    found: WholeFriction | None = None
    # Gauss-Newton: the measured normal force, with all its errors, counts times the step of the coefficient.
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
    # In a drag hand and support bear its weight together, and the hand accelerates it.
    along = seen.acceleration * [1.0, 1.0, 0.0] / trace.gravity
    pull = seen.pull + slides * (UP + along)
    load = list(of_load(seen, pull))
    rubs = pressed.normal[:, None] * (about * pressed.way - slides * UP)
    borne = force * load[0].columns[:, 0] + by_signal(seen.torques(rubs))
    free = int(np.sum(pressed.slides == 0.0))
    scene = [*of_scene(seen, pressed, about), of_steps(seen, free)]
    causes = [
        *scene,
        *load,
        of_turning(seen),
        *of_arm(trace, observed, seen, force * pull[:, 2], borne),
    ]
    # Forces of the support have no prior.
    support = np.column_stack([by_signal(one) for one in _of_support(seen, pressed, about)])
    sensors, y = free_noise(seen, drags[0].hanging.noise), by_signal(seen.observed)
    pressing = Cause("support", support, np.full(int(support.shape[1]), np.inf))
    left = learn_residual([*causes, pressing], sensors, y, seen.spans)
    noise = Projected.of(with_residual(sensors, left, seen.spans), support)
    found = fit(causes, noise, y, [*scales(causes), *_SCALES])
    (more,), ((variance,),) = found["friction"]
    steps, _ = found[STEP]
    uneven, doubt = found[UNEVEN]
    off = float(np.max(uneven**2 + np.diag(doubt))) ** 0.5 * about
    return WholeFriction(
        friction=about + float(more),
        std=float(np.sqrt(variance + off**2)),
        shared=(
            *found.shared("friction"),
            Shared("unevenness of the friction", "scene", (off,)),
        ),
        stepped=float(np.sqrt(np.mean(steps**2))),
    )


def _support_forces(drags: Sequence[Drag], free: int) -> _Pressed:
    """Support forces in so many blocks of free motion, and in those of the drags."""
    middle, usual = middle_of(drags), usual_speed(drags)
    way: list[Array] = [np.zeros((free, 3))]
    support: list[Array] = [np.zeros((free, FIRST))]
    for drag in drags:
        own = of_support(drag, middle, usual)
        support.append(np.array([own[block].mean(axis=0) for block in drag.slid]))
        way.append(np.tile([*drag.way, 0.0], (len(drag.slid), 1)))
    return _Pressed(np.concatenate(way), np.concatenate(support))


def of_scene(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Cause]:
    """Causes along a drag: first friction beyond `about`; its variation, in parts of `about`; other forces."""
    assert AXES.stop == PLACES.start
    assert PLACES.stop == SPEED.start
    for name, which, prior, of in (
        ("friction", slice(MU, MU + 1), FRICTION_PRIOR, None),
        (UNEVEN, slice(AXES.start, SPEED.stop), 1.0, None),
        (LEAN, WAYS, SUPPORT_LEAN_STD, "scene"),
        (HOLDS, HELD, HELD_FORCE_STD, "scene"),
        (PULLS, SPRING, PULL, "scene"),
    ):
        unit = about if name == UNEVEN else 1.0
        along = unit * pressed.support[:, which].T
        columns = [seen.torques(one[:, None] * pressed.way) for one in along]
        yield replace(cause(name, columns, prior), of=of)


def of_steps(seen: Blocks, free: int) -> Cause:
    """Changes of the sensors' zeros after the drags."""
    after = (seen.t > seen.t[free:].mean())[:, None]
    return cause(STEP, [after * joint for joint in np.eye(seen.observed.shape[1])], ZERO_STEP_STD)


_SCALES = (
    PriorScale((UNEVEN,), UNEVEN_SHARES, LIKELY_UNEVEN),
    PriorScale((HOLDS,), HOLDING_MORE, LIKELY_HOLDING),
    PriorScale((LEAN,), LEANING, LIKELY_LEANING),
    PriorScale((PULLS,), (0.0, 1.0), LIKELY_PULL),
    PriorScale((STEP,), (0.0, 1.0), LIKELY_STEP),
)
"""Prior scales of the scene's causes that are learned from the recording."""


def _of_support(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Array]:
    """(k, m) N m of each unit force of the support, in one block of a drag."""
    for block in np.flatnonzero(pressed.slides).tolist():
        maps, way = seen.maps[block], pressed.way[block]
        sideways = np.cross(UP, way)
        forces = maps[:, :3] @ np.column_stack([UP - about * way, sideways])
        for torque in (*forces.T, *maps[:, 3:].T):
            alone = np.zeros_like(seen.observed)
            alone[block] = torque
            yield alone
