"""Interactions of an object beyond its own attributes: contact parameters decided by another geom or a
`<pair>`, constraints, and forces other than weight.

MuJoCo takes friction and `condim` from a `<pair>` of the two geoms, else from the geom of higher
`priority`, else the larger value of both (documentation, "Computation", contact). Softness follows the
same order, but that of two geoms of equal priority is mixed: negative `solref` by the smaller numbers,
`solimp` by the mean with the weights `solmix`.

A contact with solref = (-k, -b) and a constant impedance solimp = (d, d, …) is a spring and a damper with
a small inertia ("Solver parameters"). The force of a contact point is

    f = (k depth - b v - d a) / ((1 - d) w)

with the inverse mass w of the two bodies, as MuJoCo rates it (`body_invweight0`). So the stiffness in N/m
grows with the mass of the pressing body and the number of contact points.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.mjcf.body import BodyDescription
from palpate.mjcf.document import Element
from palpate.mjcf.edits import Edit, number
from palpate.mjcf.inertial import mass_of
from palpate.mjcf.shapes import RESTING

# Share of an object's weight that counts as negligible: about the accuracy of a measured mass.
NEGLIGIBLE = 0.01
# Share of the weight that is accepted for resistance to motion. This force has opposite signs in
# passes up and down.
CANCELLING = 0.05
LIFT, LIFTING = 0.1, 0.1  # m and m/s, usual height and speed of a carried object
FRICTIONAL = 3  # Least `condim` of a contact with friction
UPWARD = 0.7  # Smallest vertical component of the normal of a contact that carries
SAME_TOP = 0.001  # m: largest difference in distance of tops that carry an object together
# kg: mass as which MuJoCo rates both fingertips of palpate's arms in a contact. They have 16
# points, the corners of two boxes per finger, with 2.98 /kg each. A test compares it with their
# models.
FINGERTIPS = 5.37
# Sliding friction of the fingertips: with a pyramidal cone the stiffness depends on it.
RUBBER = 1.0
# Impedance d of soft contacts. It is small, so that the contact adds no inertia. It cannot be
# smaller, as the simulation step must be shorter than 2 / sqrt(n k / (1 - d + n d)) for n points.
IMPEDANCE = 0.1
# `solmix` of soft contacts: weight of their impedance against that of other geoms (1).
SOLMIX = "1000000"
SOLIMP = "0.9 0.95 0.001 0.5 2"  # MuJoCo's default
# m. MuJoCo 4.0.0 inverts the normal of a contact where a curved shape enters a box or a mesh by
# less than a fifth of this tolerance. The contact then pulls (findings/mujoco_contact_normal.sh).
# The default is 1e-6 m; a sliding cup enters its support by less.
CCD_TOLERANCE = 1e-12
BALL = 0.01  # m: radius of the ball that presses in place of the fingertips
PRESSED = 1e-3  # m: depth at which the force of a contact is computed


def highest_priority(body: BodyDescription) -> int:
    """Return the highest `priority` of the static colliding geoms, at least 0."""
    standing = static_geoms(body)
    return max([0, *body.shapes.model.geom_priority[standing].tolist()])


def deciding_geom(model: mujoco.MjModel, one: int, other: int) -> int:
    """Return the geom whose friction acts in a contact of two: that of higher priority, else the rougher one."""
    return max(
        (one, other), key=lambda geom: (model.geom_priority[geom], model.geom_friction[geom, 0])
    )


def contact_friction(model: mujoco.MjModel, one: int, other: int) -> float:
    """Compute the sliding friction of a contact of two geoms, as MuJoCo combines it; 0 for `condim="1"`.

    A `<pair>` may state two coefficients: the smaller one.
    """
    deciding = deciding_geom(model, one, other)
    friction, condim = float(model.geom_friction[deciding, 0]), int(model.geom_condim[deciding])
    if model.geom_priority[one] == model.geom_priority[other]:
        condim = int(model.geom_condim[[one, other]].max())
    for i in range(len(model.pair_dim)):
        if {int(model.pair_geom1[i]), int(model.pair_geom2[i])} == {one, other}:
            friction, condim = min(model.pair_friction[i, :2].tolist()), int(model.pair_dim[i])
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        options: Any = model.opt  # `o_friction` is missing in MuJoCo's stubs
        friction = min(options.o_friction[:2].tolist())
    return float(friction) if condim >= FRICTIONAL else 0.0


def standing_contacts(body: BodyDescription) -> tuple[tuple[int, float], ...]:
    """Find the contacts of an object with its support, at most `RESTING` below it, as compiled.

    MuJoCo itself combines their parameters: `<pair>`, priority, the larger of two, overrides.

    Returns:
        Id of the object's geom and coefficient of sliding friction, 0 for a contact without it (`condim="1"`).
    """
    # Geoms of the object; contacts between two of them do not count.
    own = [body.shapes.geom_ids[geom] for geom in body.elements.colliding]
    # A margin lets MuJoCo find a support that the object does not quite touch.
    model = copy(body.shapes.model)
    model.geom_margin[own] = model.opt.o_margin = RESTING
    model.body_margin[model.geom_bodyid[own]] = RESTING
    model.pair_margin[:] = RESTING
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    # Contacts between the object and another body whose normal carries the object.
    is_own = np.isin(data.contact.geom, own)
    # The normal points from the first geom to the second: upwards into the object.
    up = data.contact.frame[:, 2] * np.where(is_own[:, 1], 1.0, -1.0)
    carrying = is_own.any(axis=1) & ~is_own.all(axis=1) & (up > UPWARD)
    # Of several tops above each other, the nearest carries.
    distances = data.contact.dist
    nearest = distances.min(where=carrying, initial=np.inf)
    contacts: list[tuple[int, float]] = []
    for i in np.flatnonzero(carrying & (distances < nearest + SAME_TOP)).tolist():
        (geom,) = data.contact.geom[i, is_own[i]].tolist()
        # A pair may state two coefficients, along two axes.
        has_friction = bool(data.contact.dim[i] >= FRICTIONAL)
        for sliding in data.contact.friction[i, :2].tolist():
            contacts.append((geom, sliding * has_friction))
    return tuple(dict.fromkeys(contacts))


def find_friction_override(body: BodyDescription) -> str:
    """Name the statement that overrides the object's own contact friction; empty if there is none."""
    model = body.shapes.model
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        return "<option> overrides the friction of every contact"
    for geom, sliding in standing_contacts(body):
        own = float(model.geom_friction[geom, 0])
        if sliding == 0.0 < own:
            return 'its contact with its support has no friction (condim="1")'
        if not np.isclose(sliding, own, rtol=1e-6):
            return "its support decides, by priority or larger friction"
    return ""


def acting_friction(body: BodyDescription) -> float | None:
    """Return the sliding friction between an object and its support; None without one, and where contacts differ."""
    frictions = [sliding for _, sliding in standing_contacts(body)]
    return frictions[0] if frictions and np.ptp(frictions) < 1e-9 else None


def static_pairs(body: BodyDescription) -> tuple[Element, ...]:
    """Find the explicit `<pair>`s of an object's colliding geoms with static geoms.

    MuJoCo takes the friction of their contacts from the pair, regardless of the geoms' own values.
    """
    model, geoms = body.shapes.model, body.shapes.geom_ids
    if not len(model.pair_dim):
        return ()
    # Pairs are in the main file and in attached models.
    static = set(static_geoms(body).tolist())
    roots = dict.fromkeys(geom.getroottree().getroot() for geom in geoms)
    pairs: list[Element] = []
    for pair in (pair for root in roots for pair in root.iterfind("contact/pair")):
        root, ends = pair.getroottree().getroot(), {pair.get("geom1"), pair.get("geom2")}
        # The main file names geoms as compiled; an attached model uses its own names.
        ids = {
            i
            for geom, i in geoms.items()
            if model.geom(i).name in ends
            or (geom.get("name") in ends and geom.getroottree().getroot() is root)
        }
        if ids & static and ids & {geoms[geom] for geom in body.elements.colliding}:
            pairs.append(pair)
    return tuple(pairs)


def surface_friction(surface: BodyDescription) -> float:
    """Return the sliding friction of a surface, stated by its carrying geom."""
    return float(surface.shapes.model.geom_friction[surface.shapes.geom_ids[surface.carrier], 0])


def spring_of(body: BodyDescription) -> tuple[float, float] | None:
    """Compute stiffness, N/m, and damping, N s/m, of a surface under the fingertips.

    None where its contact is no linear spring: no direct `solref`, or an impedance that depends on the
    depth.
    """
    model, geom = body.shapes.model, body.shapes.geom_ids[body.carrier]
    # A direct `solref` is negative: -stiffness and -damping per unit of mass.
    (stiffness, damping), (least, most) = model.geom_solref[geom], model.geom_solimp[geom][:2]
    if stiffness >= 0.0 or not np.isclose(least, most):
        return None
    scale = fingertip_mass(body) / (1.0 - float(most))
    return float(-stiffness) * scale, max(float(-damping), 0.0) * scale


def soften_surface(body: BodyDescription, stiffness: float, std: float | None) -> Iterator[Edit]:
    """Yield the changes that make a surface a spring of `stiffness`, N/m, under the fingertips.

    The damping is critical, as by MuJoCo's default. `std` sets the number of written digits. No `priority`
    is set, so that friction stays that of the pair.
    """
    # Invert the force law at rest: k = stiffness (1 - d) / m; critical damping is 2 sqrt(k).
    per_unit = (1.0 - IMPEDANCE) / fingertip_mass(body)
    own, digits = stiffness * per_unit, None if std is None else std * per_unit
    numbers = {0: f"-{number(own, digits)}", 1: f"-{2.0 * own**0.5:.4g}"}
    for geom in body.elements.colliding:
        yield Edit(geom, "solref", numbers, "0 0")
        yield Edit(geom, "solimp", {0: str(IMPEDANCE), 1: str(IMPEDANCE)}, SOLIMP)
        yield Edit(geom, "solmix", {0: SOLMIX}, "1")


def damp_surface(body: BodyDescription, damping: float, std: float | None) -> Iterator[Edit]:
    """Yield the changes that give a softened surface a damping under the fingertips, N s/m."""
    per_unit = (1.0 - IMPEDANCE) / fingertip_mass(body)
    digits = None if std is None else std * per_unit
    for geom in body.elements.colliding:
        yield Edit(geom, "solref", {1: f"-{number(damping * per_unit, digits)}"}, "0 0")


def find_softness_override(body: BodyDescription) -> str:
    """Name the statement that overrides the softness of all contacts; empty if there is none."""
    if body.shapes.model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        return "<option> overrides the softness of every contact"
    return ""


def fingertip_mass(body: BodyDescription) -> float:
    """Compute the effective mass, kg, of the fingertips in MuJoCo's contact with a surface.

    It is `FINGERTIPS`, except with a pyramidal cone, whose edges carry 2 / (mu² (1 + mu²)) of it at
    friction mu. MuJoCo computes it here: the force at rest, aref / R of every row, of a ball of that
    mass on a plate with the contact parameters of the surface.
    """
    model, geom = body.shapes.model, body.shapes.geom_ids[body.carrier]
    # A plate with the surface's contact parameters, and a ball pressed into it.
    spec = mujoco.MjSpec()
    spec.option.cone, spec.option.impratio = model.opt.cone, model.opt.impratio
    box = mujoco.mjtGeom.mjGEOM_BOX
    plate = spec.worldbody.add_geom(type=box, size=(1.0, 1.0, 1.0), pos=(0.0, 0.0, -1.0))
    plate.friction, plate.condim = model.geom_friction[geom], int(model.geom_condim[geom])
    plate.priority, plate.solmix = int(model.geom_priority[geom]), float(SOLMIX)
    plate.solref[:], plate.solimp[:2] = (-1.0, 0.0), IMPEDANCE
    add_ball(spec, (0.0, 0.0, BALL - PRESSED))
    # Force at rest: the sum of aref / R over the rows of the contact.
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    return float(data.efc_aref @ data.efc_D) / PRESSED * (1.0 - IMPEDANCE)


def add_ball(world: mujoco.MjSpec, at: tuple[float, float, float]) -> mujoco.MjsBody:
    """Add a free rubber ball that acts like the fingertips in a contact, with the mass that MuJoCo rates."""
    body = world.worldbody.add_body(pos=at)
    body.gravcomp = 1.0
    body.add_freejoint()
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(BALL, 0.0, 0.0))
    geom.mass, geom.friction = FINGERTIPS, (RUBBER, 0.005, 0.0001)
    return body


def find_constraint(body: BodyDescription) -> str:
    """Name the body that a constraint ties to the object, or else an extra force (`hanging_force`).

    Empty if there is neither. A tied body is lifted and turned together with the object.
    """
    model = body.shapes.model
    # Constraints with one end on the object and one end on another body.
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
            name = model.body(other).name or "a body without a name"
            return f"it is tied to '{name}' (<equality>), and was lifted with it"
    return hanging_force(body)


def hanging_force(body: BodyDescription) -> str:
    """Name a force other than weight on an object in the hand; empty below `NEGLIGIBLE` of the weight."""
    model = body.shapes.model
    # Only a free object hangs in the hand.
    joint = int(model.body(body.name).jntadr[0])
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        return ""
    # Compare forces on the free joint's translation with the weight.
    dofs = slice(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + 3)
    weight = mass_of(body) * float(np.linalg.norm(model.opt.gravity))
    if weight == 0.0:
        return "there is no gravity (<option gravity>)"
    if model.body_gravcomp[model.body(body.name).id]:
        return "gravcomp carries a part of its weight"
    data = mujoco.MjData(model)
    friction = float(model.dof_frictionloss[dofs].max())
    # First at rest, standing and lifted, where springs pull. Then on the way up, where damping and joint
    # friction resist.
    height = model.jnt_qposadr[joint] + 2
    for lift, speed, resists, bound in (
        (0.0, 0.0, 0.0, NEGLIGIBLE),
        (LIFT, 0.0, 0.0, NEGLIGIBLE),
        (LIFT, LIFTING, friction, CANCELLING),
    ):
        data.qpos[height] = model.qpos0[height] + lift
        data.qvel[dofs] = (0.0, 0.0, speed)
        mujoco.mj_forward(model, data)
        others = data.qfrc_passive[dofs] + data.qfrc_actuator[dofs]
        if np.linalg.norm(others) + resists > bound * weight:
            return (
                "forces other than its weight act on it: a tendon, an actuator, its own joint's "
                "stiffness, damping or friction, or a fluid"
            )
    # At LIFTING without rotation the bias force is gravity alone.
    pull = -data.qfrc_bias[dofs] - (0.0, 0.0, -weight)
    if np.linalg.norm(pull) > NEGLIGIBLE * weight:
        return "gravity is not vertical (<option gravity>, or its flag)"
    return ""


def static_geoms(body: BodyDescription) -> NDArray[np.intp]:
    """Return the ids of the colliding geoms that no free joint moves; copies of an object have one."""
    model = body.shapes.model
    # Geoms that can collide, on bodies whose root has no free joint.
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    # A body without a joint has index -1, which selects the appended -1.
    joints = model.body_jntadr[model.body_rootid[model.geom_bodyid]]
    is_free = np.append(model.jnt_type, -1)[joints] == int(mujoco.mjtJoint.mjJNT_FREE)
    return np.flatnonzero(touching & ~is_free)
