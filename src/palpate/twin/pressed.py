"""Presses of the compiled twin: does a surface of measured stiffness give way in it as it was measured?

A ball that touches as the fingertips do is pressed on each such surface with a third, two thirds and all of the
largest force, in the file's own time step, solver and friction cone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco

from palpate.estimation.estimate import Estimate
from palpate.mjcf.contacts import BALL, FINGERTIPS, add_ball
from palpate.scene.scene import Scene

SHARES = (1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Parts of the largest measured depth."""
PERIODS = 30.0
"""1 / omega in which the ball comes to rest: damped critically itself and by the surface, to 0.03 % of its depth."""
MOST_STEPS = 20_000
"""Steps of the simulation of one press, at any time step of the scene."""
SETTLED = 2.0
"""s in which objects on a surface come to rest."""
ALIKE, SEEN = 0.2, 2e-4
"""Part of a depth, and m, by which an object may sink in otherwise."""
BALL_BODY = "palpate_ball"


@dataclass(frozen=True, slots=True)
class Press:
    """Press of the twin's surface by one force.

    Attributes:
        force: N.
        depth: m, at which the ball came to rest.
        low, high: m, the 95 % interval of the measured depth at that force.
    """

    force: float
    depth: float
    low: float
    high: float

    @property
    def agrees(self) -> bool:
        """True if the twin gives way as measured."""
        return self.low <= self.depth <= self.high


def press_notes(twin: Scene, estimates: Sequence[Estimate]) -> Iterator[str]:
    """A remark on each surface of measured stiffness in the twin: its presses, and what they do not hold for."""
    for estimate in estimates:
        name = estimate.parameter.object
        if estimate.parameter.quantity != "stiffness" or name not in twin.surfaces:
            continue
        if "stiffness" not in twin.body(name).known:
            continue
        presses = press(twin, estimate)
        if not presses:
            continue
        forces = ", ".join(f"{one.force:.2g}" for one in presses)
        depths = ", ".join(f"{1e3 * one.depth:.3g}" for one in presses)
        text = f"{name} pressed as by the fingertips with {forces} N gives way by {depths} mm in the twin"
        if not all(one.agrees for one in presses):
            wanted = ", ".join(f"{1e3 * one.low:.3g} to {1e3 * one.high:.3g}" for one in presses)
            yield f"{text}, where {wanted} mm were measured: its shapes or other contacts do not let it"
            continue
        yield (
            f"{text}, as measured; MuJoCo makes a contact stiffer with the mass of what presses and with its number "
            f"of points: a free body of m kg at n points meets n m / {FINGERTIPS:g} of it"
        )
        yield from sinking_notes(twin, name, float(estimate.values[0]))


def press(twin: Scene, estimate: Estimate) -> tuple[Press, ...]:
    """Press the surface of a stiffness `estimate`, N/m, to parts of the depth to which it was measured; of an
    estimate that states none, nothing is pressed."""
    if "depth" not in estimate.parts:
        return ()
    ((low, high),) = estimate.intervals.tolist()
    stiffness, deepest = float(estimate.values[0]), estimate.parts["depth"].value
    found: list[Press] = []
    for share in SHARES:
        force = share * stiffness * deepest
        depth = rest_depth(twin, estimate.parameter.object, force, stiffness)
        found.append(Press(force, depth, force / high, force / low))
    return tuple(found)


def rest_depth(twin: Scene, surface: str, force: float, stiffness: float) -> float:
    """Depth, m, at which the ball comes to rest under `force`, N, on a surface of about `stiffness`, N/m."""
    spec = twin.spec()
    free = twin.symbols.poses.get(f"{surface}_approach")
    body = twin.body(surface)
    x, y, _ = (free.position if free is not None else body.pose_world.apply(body.centre)).tolist()
    top = body.top_z()
    add_ball(spec, (x, y, top + BALL)).name = BALL_BODY
    model = spec.compile()
    data = mujoco.MjData(model)
    ball = int(model.body(BALL_BODY).id)
    omega = (stiffness / FINGERTIPS) ** 0.5
    first = int(model.body_dofadr[ball])
    model.dof_damping[first : first + 6] = 2.0 * omega * FINGERTIPS
    data.xfrc_applied[ball, 2] = -force
    steps = min(round(PERIODS / omega / model.opt.timestep), MOST_STEPS)
    mujoco.mj_step(model, data, nstep=steps)
    return top + BALL - float(data.xpos[ball, 2])


def sinking_notes(twin: Scene, surface: str, stiffness: float) -> Iterator[str]:
    """A remark on each object on a surface of `stiffness`, N/m, that does not sink into it by its weight over that,
    as MuJoCo rates its contact by its mass and its points, or takes it from its higher priority."""
    model = twin.spec().compile()
    data = mujoco.MjData(model)
    carried = twin.body(surface).carries
    before = {name: float(model.body_pos[model.body(name).id, 2]) for name in carried}
    mujoco.mj_step(model, data, nstep=min(round(SETTLED / model.opt.timestep), MOST_STEPS))
    for name in carried:
        mass = float(model.body_subtreemass[model.body(name).id])
        sinks = before[name] - float(data.body(name).xpos[2])
        wanted = mass * twin.gravity / stiffness
        if abs(sinks - wanted) > ALIKE * wanted + SEEN:
            yield (
                f"{name} sinks {1e3 * sinks:.1f} mm into {surface} in the twin, where its weight over the measured "
                f"stiffness is {1e3 * wanted:.1f} mm"
            )
