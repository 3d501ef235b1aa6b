"""Interactions of an object beyond its own attributes: contact parameters decided by another geom or a
`<pair>`, constraints, and forces other than weight.

MuJoCo takes friction and `condim` from a `<pair>` of the two geoms, else from the geom of higher
`priority`, else the larger of both (documentation, "Computation", contact). Softness goes the same way, but
that of two geoms of one priority is mixed: of negative `solref` the smaller numbers count, of `solimp` the
mean weighted by `solmix`.

A contact with solref = (-k, -b) and a constant impedance solimp = (d, d, …) is a spring and a damper with a
little inertia ("Solver parameters"): per contact point

    f = (k depth - b v - d a) / ((1 - d) w)

with w the inverse mass of the two bodies, as MuJoCo rates it (`body_invweight0`). So its stiffness in N/m grows
with the mass of what presses and the number of points at which it touches.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.mjcf.body import BodyDescription
from palpate.mjcf.edits import Edit, number
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
FINGERTIPS = 5.37
"""kg as which MuJoCo rates both fingertips of palpate's arms in a contact: 16 points, the corners of two boxes a
finger, of 2.98 /kg each. A test compares it with their models."""
RUBBER = 1.0
"""Sliding friction of the fingertips: with a pyramidal cone the stiffness depends on it."""
IMPEDANCE = 0.1
"""d of soft contacts. Small, so that the contact adds no inertia; not smaller, as the step of the simulation has to
be shorter than 2 / sqrt(n k / (1 - d + n d)) for n points."""
DECIDES = "1000000"
"""`solmix` of soft contacts, by which their impedance counts against that of others (1)."""
SOLIMP = "0.9 0.95 0.001 0.5 2"
"""MuJoCo's default."""
CCD_TOLERANCE = 1e-12
"""m. MuJoCo 4.0.0 turns the normal of a contact over where a curved shape enters a box or a mesh by less than a fifth
of this tolerance, so that the contact pulls (findings/mujoco_contact_normal.sh). Its default is 1e-6 m: a cup that
slides enters its support by less."""
BALL = 0.01
"""m: radius of the ball that presses in place of the fingertips."""
PRESSED = 1e-3
"""m of depth at which a contact's force is computed."""


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


def surface_friction(surface: BodyDescription) -> float:
    """Sliding friction that a surface states, of the geom that carries."""
    return float(surface.shapes.model.geom_friction[surface.shapes.geom_ids[surface.carrier], 0])


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


def spring_of(body: BodyDescription) -> tuple[float, float] | None:
    """Stiffness, N/m, and damping, N s/m, of a surface under the fingertips; None where its contact is no
    linear spring: no direct `solref`, or an impedance that changes with the depth."""
    model, geom = body.shapes.model, body.shapes.geom_ids[body.carrier]
    (stiffness, damping), (least, most) = model.geom_solref[geom], model.geom_solimp[geom][:2]
    if stiffness >= 0.0 or not np.isclose(least, most):
        return None
    scale = fingertip_mass(body) / (1.0 - float(most))
    return float(-stiffness) * scale, max(float(-damping), 0.0) * scale


def softened(body: BodyDescription, stiffness: float, std: float | None) -> Iterator[Edit]:
    """Changes that make a surface a spring of `stiffness`, N/m, under the fingertips, critically damped as by
    MuJoCo's default; `std` decides how many digits are written.

    Without `priority`, so that friction is that of the pair as before.
    """
    per_unit = (1.0 - IMPEDANCE) / fingertip_mass(body)
    own, digits = stiffness * per_unit, None if std is None else std * per_unit
    numbers = {0: f"-{number(own, digits)}", 1: f"-{2.0 * own**0.5:.4g}"}
    for geom in body.elements.colliding:
        yield Edit(geom, "solref", numbers, "0 0")
        yield Edit(geom, "solimp", {0: str(IMPEDANCE), 1: str(IMPEDANCE)}, SOLIMP)
        yield Edit(geom, "solmix", {0: DECIDES}, "1")


def damped(body: BodyDescription, damping: float, std: float | None) -> Iterator[Edit]:
    """Changes that give a softened surface a damping under the fingertips, N s/m."""
    per_unit = (1.0 - IMPEDANCE) / fingertip_mass(body)
    digits = None if std is None else std * per_unit
    for geom in body.elements.colliding:
        yield Edit(geom, "solref", {1: f"-{number(damping * per_unit, digits)}"}, "0 0")


def what_hardens(body: BodyDescription) -> str:
    """Name the statement that decides the softness of all contacts; empty if there is none."""
    if body.shapes.model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        return "<option> overrides the softness of every contact"
    return ""


def fingertip_mass(body: BodyDescription) -> float:
    """Mass, kg, as which the fingertips count in a contact with a surface: `FINGERTIPS`, but for a pyramidal
    cone, whose edges bear 2 / (mu² (1 + mu²)) of it with friction mu.

    By MuJoCo itself: the force at rest, aref / R of every row, of a ball of that mass on a plate with the surface's
    contact parameters.
    """
    model, geom = body.shapes.model, body.shapes.geom_ids[body.carrier]
    spec = mujoco.MjSpec()
    spec.option.cone, spec.option.impratio = model.opt.cone, model.opt.impratio
    box = mujoco.mjtGeom.mjGEOM_BOX
    plate = spec.worldbody.add_geom(type=box, size=(1.0, 1.0, 1.0), pos=(0.0, 0.0, -1.0))
    plate.friction, plate.condim = model.geom_friction[geom], int(model.geom_condim[geom])
    plate.priority, plate.solmix = int(model.geom_priority[geom]), float(DECIDES)
    plate.solref[:], plate.solimp[:2] = (-1.0, 0.0), IMPEDANCE
    add_ball(spec, (0.0, 0.0, BALL - PRESSED))
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    return float(data.efc_aref @ data.efc_D) / PRESSED * (1.0 - IMPEDANCE)


def add_ball(world: mujoco.MjSpec, at: tuple[float, float, float]) -> mujoco.MjsBody:
    """Add a free ball that touches as the fingertips do: their mass as MuJoCo rates it, and rubber."""
    body = world.worldbody.add_body(pos=at)
    body.gravcomp = 1.0
    body.add_freejoint()
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(BALL, 0.0, 0.0))
    geom.mass, geom.friction = FINGERTIPS, (RUBBER, 0.005, 0.0001)
    return body


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
    """Ids of the colliding geoms that move with no free joint; copies of an object do."""
    model = body.shapes.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    joints = model.body_jntadr[model.body_rootid[model.geom_bodyid]]
    is_free = (joints >= 0) & (
        np.append(model.jnt_type, -1)[joints] == int(mujoco.mjtJoint.mjJNT_FREE)
    )
    return np.flatnonzero(touching & ~is_free)
