"""Objects that hang a little above what they are to stand on, let down onto it.

Many files, and the code that draws poses for them, place objects a few millimetres too high and leave
it to the simulator to drop them. Where they come to stand is where the arm has to look for them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import has_unknown, tokens
from palpate.mjcf.edits import Edit
from palpate.mjcf.shapes import RESTING, Shapes

HANGING = 0.001
"""m: what is less above its support stands on it."""

SECONDS = 0.5
"""s in which things come to rest: a fall of `RESTING` takes 0.06 s."""

MOST_STEPS = 2_000
"""Of the simulation, whatever the scene's timestep."""

ASIDE = 0.005
"""m: what moves farther to the side falls over or rolls, and is left where the file has it."""

UPRIGHT = float(np.cos(np.radians(3.0)))
"""Likewise of what turns by more than that."""


def let_down(bodies: Mapping[str, BodyDescription], shapes: Shapes) -> Iterator[tuple[str, Edit]]:
    """The changes, by name, that put those objects onto their support which hang less than `RESTING`
    above one of known height: where MuJoCo lets them fall to, straight down."""
    hanging = [body for body in bodies.values() if _hangs(body)]
    if not hanging:
        return
    data = mujoco.MjData(shapes.model)
    steps = min(int(SECONDS / shapes.model.opt.timestep), MOST_STEPS)
    mujoco.mj_step(shapes.model, data, steps)
    for body in hanging:
        before, fallen = shapes.body_pose(body.name), data.body(body.name)
        after = Pose.of(fallen.xpos, fallen.xquat)
        drop = float(before.position[2] - after.position[2])
        aside = float(np.linalg.norm((before.position - after.position)[:2]))
        turned = float(np.abs(before.rotation.T @ after.rotation).diagonal().min())
        if 0.0 < drop < 2 * RESTING and aside < ASIDE and turned > UPRIGHT:
            z = _stated_z(body) - drop
            yield body.name, Edit(body.elements.element, "pos", {2: repr(z)}, "0 0 0")


def _stated_z(body: BodyDescription) -> float:
    """World z of an object's frame by its poses, else by its file, m."""
    if body.given is not None:
        return float(body.given.position[2])
    return float(tokens(body.elements.element.get("pos") or "0 0 0")[2])


def _hangs(body: BodyDescription) -> bool:
    """True if an object is placed in the world's axes, by its poses or its file, and just above a
    surface."""
    if body.role != "object" or body.elements.moved_by() is not None:
        return False
    if has_unknown(body.elements.element, "pos"):
        return False
    if any(surface.top_is_open for surface in body.surfaces_below()):
        return False
    gaps = list(_gaps(body))
    return bool(gaps) and HANGING < min(gaps, key=abs) < RESTING


def _gaps(body: BodyDescription) -> Iterator[float]:
    """Gaps between its bottom and each body that reaches under its middle, m."""
    for surface in body.surfaces_below():
        yield body.bottom_z - surface.top_z
    foot = body.footing()
    for other in body.objects():
        if other is not body and other.bottom_z < body.bottom_z and other.reaches_over(foot):
            yield body.bottom_z - other.top_z
