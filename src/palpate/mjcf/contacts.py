"""Interactions of an object beyond its own attributes: contact parameters decided by another geom or a
`<pair>`, constraints, and forces other than weight.

MuJoCo takes friction and `condim` from a `<pair>` of the two geoms, else from the geom of higher
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
"""Share of an object's weight: about the accuracy of a measured mass."""
CANCELLING = 0.05
"""Share of its weight, for resistance to its motion: it has opposite signs in passes up and down."""
LIFTING = 0.1
"""m/s, usual speed of a carried object."""
FRICTIONAL = 3
"""Least `condim` of a contact with friction."""


def highest_priority(body: BodyDescription) -> int:
    """Highest `priority` of the static colliding geoms, at least 0."""
    standing = static_geoms(body)
    return max([0, *body.shapes.model.geom_priority[standing].tolist()])


def what_decides(body: BodyDescription) -> str:
    """Name the statement that decides the contact friction in place of the object's own; empty if
    its own does."""
    model = body.shapes.model
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        return "<option> overrides the friction of every contact"
    standing = static_geoms(body)
    priorities, frictions = model.geom_priority[standing], model.geom_friction[standing, 0]
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
    for geom in body.elements.colliding:
        i = body.shapes.geom_ids[geom]
        # A `<pair>` of this geom and a static one, with another friction or none.
        mine = (pairs == i).any(axis=1) & np.isin(pairs, standing).any(axis=1)
        other = ~np.isclose(model.pair_friction[:, 0], model.geom_friction[i, 0], rtol=1e-6)
        if (mine & (other | (model.pair_dim < FRICTIONAL))).any():
            return "a <pair> decides how it rubs on what it stands on"
        above = priorities > model.geom_priority[i]
        above |= (priorities == model.geom_priority[i]) & (frictions > model.geom_friction[i, 0])
        if above.any():
            return "what it stands on decides, by its priority or its larger friction"
        if model.geom_condim[i] < FRICTIONAL:
            return 'its contacts are without friction (condim="1")'
    return ""


def pair_friction(body: BodyDescription) -> float | None:
    """Sliding friction of an object on its supporting surface, by MuJoCo's rules for a pair of geoms;
    None without such a surface."""
    model, foot = body.shapes.model, body.footing()
    for surface in body.surfaces():
        if surface.reaches_over(foot) and abs(foot[2] - surface.top_z) < RESTING:
            below = body.shapes.geom_ids[surface.carrier]
            own = [body.shapes.geom_ids[geom] for geom in body.elements.colliding]
            return max(friction_of_geoms(model, geom, below) for geom in own)
    return None


def friction_of_geoms(model: mujoco.MjModel, geom: int, other: int) -> float:
    """Sliding friction between two geoms: of their `<pair>`, their priority, or the larger one."""
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
    geoms = [body.shapes.geom_ids[geom] for geom in body.elements.geoms]
    own = {int(model.body(body.name).id), *model.geom_bodyid[geoms].tolist()}
    ties = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
    for equality in range(model.neq):
        if model.eq_type[equality] not in ties or not model.eq_active0[equality]:
            continue
        ends = (int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]))
        if model.eq_objtype[equality] == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = (int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]]))
        if len(own.intersection(ends)) == 1:
            (other,) = set(ends) - own
            name = model.body(other).name or "something without a name"
            return f"it is tied to '{name}' (<equality>), with which it was lifted"
    return carried(body)


def carried(body: BodyDescription) -> str:
    """Name the force beside its weight that acts on an object hanging in the hand; empty if it is below
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
    friction = float(model.dof_frictionloss[moved].max())
    # At rest, then on the way up, where damping and joint friction resist.
    for speed, resists, bound in ((0.0, 0.0, NEGLIGIBLE), (LIFTING, friction, CANCELLING)):
        data.qvel[moved] = (0.0, 0.0, speed)
        mujoco.mj_forward(model, data)
        others = data.qfrc_passive[moved] + data.qfrc_actuator[moved]
        if np.linalg.norm(others) + resists > bound * weight:
            return (
                "more than its weight acts on it while it is carried: gravcomp, a tendon, an actuator, "
                "its own joint's damping or friction, or a fluid"
            )
    # At LIFTING without rotation the bias force is gravity alone.
    pull = -data.qfrc_bias[moved] - (0.0, 0.0, -weight)
    if np.linalg.norm(pull) > NEGLIGIBLE * weight:
        return "gravity does not pull it straight down (<option gravity>, or its flag)"
    return ""


def static_geoms(body: BodyDescription) -> NDArray[np.intp]:
    """Ids of the colliding geoms that belong to no object."""
    model = body.shapes.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    for thing in body.objects():
        touching[[thing.shapes.geom_ids[geom] for geom in thing.elements.geoms]] = False
    return np.flatnonzero(touching)
