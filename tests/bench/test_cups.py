"""Hidden cups are drawn by their seed, from the stated ranges."""

from __future__ import annotations

import numpy as np

from bench import cups
from palpate.common.parameter import Parameter
from palpate.execution.simulated_cell import SimulatedCell
from palpate.scene.load import parse_scene


def test_cups_have_the_drawn_size_and_friction() -> None:
    frictions: list[float] = []
    for seed in range(20):
        text = cups.hidden(seed)
        world = parse_scene(text)
        model = world.spec().compile()
        radius, half, _ = model.geom_size[model.body_geomadr[model.body("cup").id]].tolist()
        assert cups.RADIUS[0] <= radius <= cups.RADIUS[1]
        assert cups.HEIGHT[0] <= 2.0 * half <= cups.HEIGHT[1]
        truth = SimulatedCell(world, scene=world).truth(Parameter("cup", "friction"))
        assert truth is not None
        (friction,) = truth
        assert cups.FRICTION[0] <= friction <= cups.FRICTION[1]
        frictions.append(friction)
    assert np.ptp(frictions) > 0.5
    assert cups.hidden(3) == cups.hidden(3)
