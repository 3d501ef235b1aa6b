"""Worlds as a user's poses describe them: every object stands as far from where the scene has it as
they are stated to be right.

One world per scene would have them all exactly there, and what an interval holds for their being
elsewhere would look too much.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.cells.cell import Cell
from palpate.cells.simulated import SimulatedCell
from palpate.estimation.balance import accuracy
from palpate.geometry.pose import Pose
from palpate.scene.load import rearranged
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.stages.workplace import cell_for

STREAM = 16
"""Sets these draws apart from all others of a seed."""


def about_there(settings: Settings, scene: Scene | None, seen: bool = False) -> Cell:
    """The cell that the settings name, with the objects of its world about where the scene has them:
    off in the plane by its stated accuracy (1 sigma an axis), by the settings' seed. What was `seen` in
    a picture is off already.

    Raises:
        InputError: as `cell_for`.
    """
    cell = cell_for(settings, scene, seen)
    if scene is None or seen or not isinstance(cell, SimulatedCell):
        return cell
    random = np.random.default_rng([settings.seed, STREAM])
    poses: dict[str, Pose] = {}
    for name, believed in scene.objects.items():
        aside = accuracy(believed) * random.standard_normal(2)
        poses[name] = cell.world.body(name).pose_world.translated(np.array([*aside, 0.0]))
    return replace(cell, world=rearranged(cell.world, poses), scene=scene)
