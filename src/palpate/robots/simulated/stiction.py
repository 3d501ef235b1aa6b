"""Breakaway: MuJoCo has one coefficient of sliding friction, a real pair of surfaces holds better
than it slides.

A world declares it per object with `<custom><numeric name="static_friction_NAME"
data="0.41"/></custom>`; the `friction` of the object's geoms is the dynamic coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.errors import InputError, unknown_name

PREFIX = "static_friction_"
SLIP = 0.002
"""m/s at which an object counts as sliding: well above MuJoCo's creep, well below any commanded
slide."""


@dataclass(frozen=True, slots=True)
class Stiction:
    """One object's two coefficients, and where they go.

    Attributes:
        geoms: the object's geom ids. dof: first of its free joint's degrees of freedom.
        static, dynamic: coefficients of sliding friction, the latter per geom.
    """

    geoms: tuple[int, ...]
    dof: int
    static: float
    dynamic: tuple[float, ...]

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Set the coefficient that holds at the speed at which the object slides on what it
        touches."""
        slips = self._slip(model, data) > SLIP
        for geom, dynamic in zip(self.geoms, self.dynamic, strict=True):
            model.geom_friction[geom, 0] = dynamic if slips else self.static

    def _slip(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Largest horizontal speed, m/s, of the object's contact points with static things.

        At the contact, not at the body's origin: an object turns in the fingers' grip before its
        base slips.
        """
        pairs, points = data.contact.geom, data.contact.pos
        touching = [
            p
            for pair, p in zip(pairs, points, strict=True)
            if self._on_static(model, *map(int, pair))
        ]
        if not touching:
            return 0.0
        body = model.geom_bodyid[self.geoms[0]]
        linear, turning = data.qvel[self.dof : self.dof + 3], data.qvel[self.dof + 3 : self.dof + 6]
        angular = data.xmat[body].reshape(3, 3) @ turning
        speed = linear + np.cross(angular, np.array(touching) - data.xpos[body])
        return float(np.hypot(speed[:, 0], speed[:, 1]).max())

    def _on_static(self, model: mujoco.MjModel, geom1: int, geom2: int) -> bool:
        """Whether a contact is between the object and something that never moves."""
        if (geom1 in self.geoms) == (geom2 in self.geoms):
            return False
        other = geom2 if geom1 in self.geoms else geom1
        return int(model.body_weldid[model.geom_bodyid[other]]) == 0


def declared(model: mujoco.MjModel) -> tuple[Stiction, ...]:
    """What the model's `<custom>` declares.

    Raises:
        InputError: it names no object of the world.
    """
    numerics = [model.numeric(i) for i in range(model.nnumeric)]
    return tuple(
        _stiction(model, n.name.removeprefix(PREFIX), float(n.data[0]))
        for n in numerics
        if n.name.startswith(PREFIX)
    )


def _stiction(model: mujoco.MjModel, name: str, static: float) -> Stiction:
    free = {
        model.body(i).name: i
        for i in range(model.nbody)
        if model.body_jntnum[i] == 1
        and model.jnt_type[model.body_jntadr[i]] == mujoco.mjtJoint.mjJNT_FREE
    }
    if name not in free:
        raise unknown_name(
            "object", name, free, f"It is named by the world's numeric '{PREFIX}{name}'."
        )
    body, first = free[name], int(model.body_geomadr[free[name]])
    geoms = tuple(range(first, first + int(model.body_geomnum[body])))
    dynamic = tuple(float(model.geom_friction[g, 0]) for g in geoms)
    if any(static < d for d in dynamic):
        raise InputError(
            f"'{PREFIX}{name}' is {static:g}, below the object's friction {max(dynamic):g}: what "
            "holds must not be less than what slides"
        )
    return Stiction(geoms, int(model.body_dofadr[body]), static, dynamic)
