"""Ground truth of a simulated world made from the scene alone: unknowns drawn from their priors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.parameter import Parameter

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


def draw_truth(scene: Scene, seed: int) -> dict[Parameter, tuple[float, ...]]:
    """Values for everything missing, for a hidden world made from D itself; the same for the same
    seed. Each quantity says how it is drawn around what is believed of it."""
    random = np.random.default_rng(seed)
    truth: dict[Parameter, tuple[float, ...]] = {}
    for parameter in scene.missing:
        quantity = scene.catalogue[parameter.quantity]
        prior = scene.resolved.priors[parameter]
        truth[parameter] = quantity.draw(scene.body(parameter.object), prior, random)
    return truth
