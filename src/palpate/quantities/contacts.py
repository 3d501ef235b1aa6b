"""Which of several statements decides how an object rubs on what stands still.

MuJoCo takes friction and `condim` from a `<pair>` that names both shapes, else from the shape of higher
`priority`, else the larger of both (documentation, "Computation", contact).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.mjcf.body import BodyDescription

FRICTIONAL = 3
"""The least `condim` of a contact with friction."""


def highest_priority(body: BodyDescription) -> int:
    """Of all that can touch and is no object, 0 at least."""
    standing = _standing(body)
    return max([0, *body.shapes.model.geom_priority[standing].tolist()])


def what_decides(body: BodyDescription) -> str:
    """What else than the object's own friction acts where it touches what stands still; empty for
    nothing."""
    model = body.shapes.model
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        return "<option> overrides the friction of every contact"
    standing = _standing(body)
    priorities, frictions = model.geom_priority[standing], model.geom_friction[standing, 0]
    for geom in body.elements.colliding:
        i = body.shapes.geom_ids[geom]
        if _is_paired(model, i, standing):
            return "a <pair> decides how it rubs on what it stands on"
        above = priorities > model.geom_priority[i]
        above |= (priorities == model.geom_priority[i]) & (frictions > model.geom_friction[i, 0])
        if above.any():
            return "what it stands on decides, by its priority or its larger friction"
        if model.geom_condim[i] < FRICTIONAL:
            return 'its contacts are without friction (condim="1")'
    return ""


def _standing(body: BodyDescription) -> NDArray[np.intp]:
    """Ids of the shapes that can touch something and are of no object."""
    model = body.shapes.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    for thing in body.objects():
        touching[[thing.shapes.geom_ids[geom] for geom in thing.elements.geoms]] = False
    return np.flatnonzero(touching)


def _is_paired(model: mujoco.MjModel, geom: int, standing: NDArray[np.intp]) -> bool:
    """Whether a `<pair>` states another friction of a shape on one that stands still."""
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
    mine = (pairs == geom).any(axis=1) & np.isin(pairs, standing).any(axis=1)
    other = ~np.isclose(model.pair_friction[:, 0], model.geom_friction[geom, 0], rtol=1e-6)
    return bool((mine & (other | (model.pair_dim < FRICTIONAL))).any())
