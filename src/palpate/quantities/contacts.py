"""Interactions of an object beyond its own attributes: contact parameters that another geom or a
`<pair>` decides, constraints, and forces other than weight.

MuJoCo takes friction and `condim` from a `<pair>` that names both shapes, else from the shape of higher
`priority`, else the larger of both (documentation, "Computation", contact).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.mjcf.body import BodyDescription
from palpate.mjcf.inertial import mass_of
from palpate.mjcf.shapes import RESTING

NEGLIGIBLE = 0.01
"""Of an object's weight: about what a mass is measured to."""

CANCELLING = 0.05
"""Of its weight, for what resists its motion: passes up and down have it with opposite signs."""

LIFTING = 0.1
"""m/s at which things are carried."""

FRICTIONAL = 3
"""The least `condim` of a contact with friction."""


def highest_priority(body: BodyDescription) -> int:
    """Of all that can touch and is no object, 0 at least."""
    standing = _standing(body)
    return max([0, *body.shapes.model.geom_priority[standing].tolist()])


def what_decides(body: BodyDescription) -> str:
    """Name the statement that decides the contact friction in place of the object's own; empty if
    its own does."""
    model = body.shapes.model
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
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


def pair_friction(body: BodyDescription) -> float | None:
    """Sliding friction of an object on the surface that it stands on, by MuJoCo's rules for a pair of
    geoms; None where it stands on no surface."""
    model, foot = body.shapes.model, body.footing()
    for surface in body.surfaces():
        if surface.reaches_over(foot) and abs(foot[2] - surface.top_z) < RESTING:
            below = body.shapes.geom_ids[surface.carrier]
            own = [body.shapes.geom_ids[geom] for geom in body.elements.colliding]
            return max(_pair_friction(model, geom, below) for geom in own)
    return None


def _pair_friction(model: mujoco.MjModel, geom: int, other: int) -> float:
    pairs = np.sort(np.column_stack([model.pair_geom1, model.pair_geom2]), axis=1)
    stated = np.flatnonzero((pairs == sorted((geom, other))).all(axis=1))
    if len(stated):
        return float(model.pair_friction[stated[0], 0])
    first, second = model.geom_priority[[geom, other]].tolist()
    if first == second:
        return float(model.geom_friction[[geom, other], 0].max())
    return float(model.geom_friction[geom if first > second else other, 0])


def tied_to(body: BodyDescription) -> str:
    """Name the body that a constraint ties to the object, or else the force beside its weight
    (`carried`); empty if there is neither. A tied body is lifted and turned with the object."""
    model = body.shapes.model
    own = {int(model.body(body.name).id)}
    for geom in body.elements.geoms:
        own.add(int(model.geom_bodyid[body.shapes.geom_ids[geom]]))
    for equality in range(model.neq):
        ends = _ends(model, equality)
        if len(own.intersection(ends)) == 1:
            (other,) = set(ends) - own
            name = model.body(other).name or "something without a name"
            return f"it is tied to '{name}' (<equality>), with which it was lifted"
    return carried(body)


def carried(body: BodyDescription) -> str:
    """Name the force beside its weight that acts on an object hanging in the hand; empty below
    `NEGLIGIBLE` of the weight."""
    model = body.shapes.model
    joint = int(model.body(body.name).jntadr[0])
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        return ""
    moved = slice(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + 3)
    weight = mass_of(body) * float(np.linalg.norm(model.opt.gravity))
    if weight == 0.0:
        return "there is no gravity (<option gravity>)"
    data = mujoco.MjData(model)
    rubbing = float(model.dof_frictionloss[moved].max())
    for speed, resists, bound in ((0.0, 0.0, NEGLIGIBLE), (LIFTING, rubbing, CANCELLING)):
        data.qvel[moved] = (0.0, 0.0, speed)
        mujoco.mj_forward(model, data)
        others = data.qfrc_passive[moved] + data.qfrc_actuator[moved]
        if np.linalg.norm(others) + resists > bound * weight:
            return (
                "more than its weight acts on it while it is carried: gravcomp, a tendon, an actuator, "
                "its own joint's damping or friction, or a fluid"
            )
    pull = -data.qfrc_bias[moved] - (0.0, 0.0, -weight)
    if np.linalg.norm(pull) > NEGLIGIBLE * weight:
        return "gravity does not pull it straight down (<option gravity>, or its flag)"
    return ""


def _ends(model: mujoco.MjModel, equality: int) -> tuple[int, ...]:
    """The two bodies that an active constraint ties to each other; none of others."""
    ties = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
    if model.eq_type[equality] not in ties or not model.eq_active0[equality]:
        return ()
    ends = (int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]))
    if model.eq_objtype[equality] == int(mujoco.mjtObj.mjOBJ_SITE):
        ends = (int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]]))
    return ends


def _standing(body: BodyDescription) -> NDArray[np.intp]:
    """Ids of the shapes that can touch something and are of no object."""
    model = body.shapes.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    for thing in body.objects():
        touching[[thing.shapes.geom_ids[geom] for geom in thing.elements.geoms]] = False
    return np.flatnonzero(touching)


def _is_paired(model: mujoco.MjModel, geom: int, standing: NDArray[np.intp]) -> bool:
    """A `<pair>` states another friction, or none, for the geom on a static geom."""
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
    mine = (pairs == geom).any(axis=1) & np.isin(pairs, standing).any(axis=1)
    other = ~np.isclose(model.pair_friction[:, 0], model.geom_friction[geom, 0], rtol=1e-6)
    return bool((mine & (other | (model.pair_dim < FRICTIONAL))).any())
