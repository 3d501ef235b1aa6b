"""What is true in a simulated world made from the scene alone: its unknowns, drawn from priors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.geometry.pose import Array
from palpate.mjcf.document import UNKNOWN, tokens
from palpate.parameter import Parameter
from palpate.scene.priors import PRIOR_MASS, RESTING

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


TRUE_FRICTION = (0.25, 0.7)
"""Range in which a hidden friction is drawn."""


TRUE_SHIFT = 0.003
"""m: how far a hidden position is from the believed one, per axis."""


def draw_truth(scene: Scene, seed: int) -> dict[Parameter, tuple[float, ...]]:
    """Values for everything missing, for a hidden world made from D itself; the same for the same
    seed.

    Masses within a factor of two of the prior, friction in `TRUE_FRICTION`. A surface is a little
    lower than believed where things stand on it (they must not start inside it), else up to 3 cm
    off; a position up to `TRUE_SHIFT` off; a centre of mass up to a tenth of the object's size off.
    """
    random = np.random.default_rng(seed)
    return {parameter: _drawn(scene, parameter, random) for parameter in scene.missing()}


def _drawn(scene: Scene, parameter: Parameter, random: np.random.Generator) -> tuple[float, ...]:
    prior = np.array(scene.priors[parameter])
    if parameter.quantity == "mass":
        return (float(np.clip(prior[0] * 2 ** random.uniform(-1, 1), *PRIOR_MASS)),)
    if parameter.quantity == "friction":
        return (float(random.uniform(*TRUE_FRICTION)),)
    if parameter.quantity == "height":
        return (float(prior[0] + _height_error(scene, parameter.object, random)),)
    if parameter.quantity in ("com", "position"):
        scale = (
            0.1 * scene.body(parameter.object).size
            if parameter.quantity == "com"
            else np.full(2, TRUE_SHIFT)
        )
        shift = random.uniform(-scale, scale) * _open_numbers(scene, parameter)
        return tuple(float(v) for v in prior + shift)
    return scene.priors[parameter]


def _open_numbers(scene: Scene, parameter: Parameter) -> Array:
    """1 for each number of a `pos` that is `?`, 0 for those that are stated."""
    thing = scene.source.found.objects[parameter.object]
    element = thing.inertial if parameter.quantity == "com" else thing.element
    count = len(scene.priors[parameter])
    stated = tokens(element.get("pos") if element is not None else None) or [UNKNOWN] * count
    return np.array([float(part == UNKNOWN) for part in stated[:count]])


def _height_error(scene: Scene, surface: str, random: np.random.Generator) -> float:
    top = scene.body(surface)
    used = any(
        top.covers(float(o.pose_world.position[0]), float(o.pose_world.position[1]))
        and abs(o.bottom_z() - top.top_z()) < RESTING
        for o in scene.objects.values()
    )
    return float(random.uniform(-0.003, 0.0) if used else random.uniform(-0.03, 0.03))
