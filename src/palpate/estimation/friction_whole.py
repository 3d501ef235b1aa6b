"""Sliding friction from all motion around the drags, joint by joint.

The fit of drags alone refers each force to a rest in the air. That force also contains the change of the arm's
biases between the two places. Only its growth with the normal force then separates friction from bias. But the
same link errors, zeros, gains and joint friction act in all free motion around the drags (`load_causes`). A
joint fit to all of it makes the whole sliding force usable. In each block of a drag the other support forces
are unknown: the normal force with its friction, a lateral force, and moments.

The result depends on the model of the arm. Its remaining error is a coloured residual, learned from the
recording (`coloured_residual`).
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

UNEVEN, HOLDS, LEAN, PULLS, STEP = (
    "unevenness",
    "what holds",
    "lean of support",
    "what pulls",
    "step",
)
"""Prefixes of the names of the causes in the scene."""


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
    support: Array  # (k, FIRST) columns of `drag_causes.of_support`

    @property
    def normal(self) -> Array:
        """(k,) N, normal force."""
        return self.support[:, MU]

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
    free = free_rows(trace, name) if observed.knows_links else []
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
    load = list(of_load(seen, pull))
    # Force of the support on the hand at `about`, as torques; the gains act on the measured sum.
    rubs = pressed.normal[:, None] * (about * pressed.way - slides * UP)
    borne = force * load[0].columns[:, 0] + by_signal(seen.torques(rubs))
    free = int(np.sum(pressed.slides == 0.0))
    # Causes of the torques: scene, load, and arm.
    scene = [*of_scene(seen, pressed, about), of_steps(seen, free)]
    causes = [
        *scene,
        *load,
        of_turning(seen),
        *of_arm(trace, observed, seen, force * pull[:, 2], borne),
    ]
    # Forces of the support have no prior, so they are projected out.
    support = np.column_stack([by_signal(one) for one in _of_support(seen, pressed, about)])
    sensors, y = free_noise(seen, drags[0].hanging.noise), by_signal(seen.observed)
    pressing = Cause("support", support, np.full(int(support.shape[1]), np.inf))
    # Noise: the sensors' and the coloured residual of the arm model.
    left = learn_residual([*causes, pressing], sensors, y, seen.spans)
    noise = Projected.of(with_residual(sensors, left, seen.spans), support)
    found = fit(causes, noise, y, [*scales(causes), *_SCALES])
    # The posterior step of the coefficient, and the variation of friction that the fit leaves possible.
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
    """Support forces in `free` blocks of free motion, and in the blocks of the drags."""
    middle, usual = middle_of(drags), usual_speed(drags)
    way: list[Array] = [np.zeros((free, 3))]
    support: list[Array] = [np.zeros((free, FIRST))]
    for drag in drags:
        own = of_support(drag, middle, usual)
        support.append(np.array([own[block].mean(axis=0) for block in drag.slid]))
        way.append(np.tile([*drag.way, 0.0], (len(drag.slid), 1)))
    return _Pressed(np.concatenate(way), np.concatenate(support))


def of_scene(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Cause]:
    """Yield the causes along a drag: friction beyond `about`, its variation relative to `about`, other forces."""
    assert AXES.stop == PLACES.start
    assert PLACES.stop == SPEED.start
    for name, which, prior, of in (
        ("friction", slice(MU, MU + 1), FRICTION_PRIOR, None),
        (UNEVEN, slice(AXES.start, SPEED.stop), 1.0, None),
        (LEAN, WAYS, SUPPORT_LEAN_STD, "scene"),
        (HOLDS, HELD, HELD_FORCE_STD, "scene"),
        (PULLS, SPRING, PULL, "scene"),
    ):
        # Each column is a force along the drag, as joint torques.
        unit = about if name == UNEVEN else 1.0
        along = unit * pressed.support[:, which].T
        columns = [seen.torques(one[:, None] * pressed.way) for one in along]
        yield replace(cause(name, columns, prior), of=of)


def of_steps(seen: Blocks, free: int) -> Cause:
    """Change of each sensor's zero after the mean time of the drags."""
    after = (seen.t > seen.t[free:].mean())[:, None]
    return cause(STEP, [after * joint for joint in np.eye(seen.observed.shape[1])], ZERO_STEP_STD)


_SCALES = (
    PriorScale((UNEVEN,), UNEVEN_SHARES, LIKELY_UNEVEN),
    PriorScale((HOLDS,), HOLDING_MORE, LIKELY_HOLDING),
    PriorScale((LEAN,), LEANING, LIKELY_LEANING),
    PriorScale((PULLS,), (0.0, 1.0), LIKELY_PULL),
    PriorScale((STEP,), (0.0, 1.0), LIKELY_STEP),
)
"""Prior scales of the scene's causes; the fit learns them from the recording."""


def _of_support(seen: Blocks, pressed: _Pressed, about: float) -> Iterator[Array]:
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
