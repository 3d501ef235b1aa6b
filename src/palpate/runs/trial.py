"""Trial: physics of one object of a scene on its support.

All other free bodies float at their poses without contacts. A trial therefore depends on one object
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.mjcf.contacts import CCD_TOLERANCE
from palpate.scene.scene import Scene

# Values of missing parameters by name. The others have their priors.
Values = Mapping[Parameter, tuple[float, ...]]
Push = Callable[[mujoco.MjData], Array]  # Force (3,) N, world axes, in a state

SETTLING = 0.3  # s: time in which the object comes to rest on its support before the trial
REST = 2e-3  # m/s: the object is at rest below this speed
LONGEST = 3.0  # s: longest duration of a trial
FINEST = 1e-3  # s: shortest physics step of a trial. Scenes with finer steps would take minutes.


@dataclass(frozen=True, slots=True, eq=False)
class PhysicsTrial:
    """A compiled world with the object at rest."""

    model: mujoco.MjModel  # MuJoCo's model
    body: int  # index of the object's body
    state: Array  # qpos of the settled world
    centre: Array  # (3,) m, centre of mass then, world
    upright: Array  # (3,) vertical axis of the world in the body's frame then
    # low, high: (3,) m, corners of the box around the object's geoms in the world.
    low: Array
    high: Array

    @property
    def mass(self) -> float:
        """Mass of the object, kg."""
        return float(self.model.body_subtreemass[self.body])

    @property
    def weight(self) -> float:
        """Weight of the object, N."""
        return self.mass * float(np.linalg.norm(self.model.opt.gravity))

    def at(self, share: float) -> Array:
        """Point (3,) m, at the middle of the object in x and y, at a share of its height."""
        middle = (self.low + self.high) / 2
        return np.array([middle[0], middle[1], self.low[2] + share * (self.high - self.low)[2]])

    def run(
        self,
        force: Push,
        point: Array,
        until: Callable[[mujoco.MjData], bool],
        touching: bool = True,
    ) -> mujoco.MjData:
        """Apply a force, N by state, at a point of the body until a condition on the state holds, or for `LONGEST`.

        `point` (3,), m, is where it acts at first; it moves with the object. Without `touching`, the object flies
        through everything. Return the state at the end.
        """
        # Begin at the settled state, with or without contacts.
        model, data = self.model, mujoco.MjData(self.model)
        disabled, contacts = model.opt.disableflags, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.disableflags = disabled if touching else disabled | contacts
        data.qpos = self.state
        mujoco.mj_forward(model, data)
        # Keep the point fixed in the body's frame.
        local = data.xmat[self.body].reshape(3, 3).T @ (point - data.xpos[self.body])
        while data.time < LONGEST and not until(data):
            # Convert the force at the point to generalized forces.
            where = data.xpos[self.body] + data.xmat[self.body].reshape(3, 3) @ local
            data.qfrc_applied[:] = 0
            mujoco.mj_applyFT(
                model, data, force(data), np.zeros(3), where, self.body, data.qfrc_applied
            )
            mujoco.mj_step(model, data)
        model.opt.disableflags = disabled
        return data

    def velocity(self, data: mujoco.MjData) -> Array:
        """Velocity (3,) m/s of the body's origin, world axes."""
        first = int(self.model.body_dofadr[self.body])
        return data.qvel[first : first + 3]

    def is_at_rest(self, data: mujoco.MjData) -> bool:
        """True if no velocity component reaches `REST`."""
        return float(np.abs(self.velocity(data)).max()) < REST

    def displacement(self, data: mujoco.MjData) -> Array:
        """Displacement (3,) m of the centre of mass."""
        return np.asarray(data.xipos[self.body] - self.centre)

    def tilt(self, data: mujoco.MjData) -> float:
        """Angle between the object's vertical axis then and now, rad."""
        upright = data.xmat[self.body].reshape(3, 3) @ self.upright
        return float(np.arccos(np.clip(upright[2], -1.0, 1.0)))


def trial_of(scene: Scene, name: str, values: Values) -> PhysicsTrial:
    """Build the world of a scene with these values, in which only the object `name` moves.
    Raises InputError: the values make no world, as an inertia that no body has."""
    # Compile the world without the other free objects.
    spec = scene.spec(values)
    for other in scene.objects:
        if other != name:
            disable_body(spec.body(other))
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"no world has these values: {error}") from None
    # Bound the duration by the step. The fine tolerance keeps contacts of curved shapes from pulling.
    model.opt.timestep = max(model.opt.timestep, FINEST)
    model.opt.ccd_tolerance = min(model.opt.ccd_tolerance, CCD_TOLERANCE)
    # Let the object settle.
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING / model.opt.timestep))
    mujoco.mj_forward(model, data)
    body = model.body(name).id
    # Record the settled pose, to which all displacements refer.
    low, high = _box(model, data, body)
    centre, upright = data.xipos[body].copy(), data.xmat[body].reshape(3, 3)[2].copy()
    return PhysicsTrial(model, body, data.qpos.copy(), centre, upright, low, high)


def disable_body(body: mujoco.MjsBody) -> None:
    """Remove weight and contacts from a body and its children."""
    body.gravcomp = 1
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0
    for child in body.bodies:
        disable_body(child)


def _box(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> tuple[Array, Array]:
    """Corners of the box around a body's geoms, m, from their bounding boxes."""
    # All geoms of the body and of its children.
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == body)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8)
    points: list[Array] = []
    for geom in geoms:
        # Corners of the geom's bounding box, in world axes.
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        corners = middle[:, None] + half[:, None] * signs
        turn = data.geom_xmat[geom].reshape(3, 3)
        points.append((data.geom_xpos[geom][:, None] + turn @ corners).T)
    cloud = np.concatenate(points)
    return cloud.min(axis=0), cloud.max(axis=0)
