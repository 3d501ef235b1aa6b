"""Breakaway: MuJoCo has one coefficient of sliding friction, a real pair of surfaces holds better
than it slides.

A world declares it per object with `<custom><numeric name="static_friction_NAME"
data="0.41"/></custom>`; the `friction` of the object's geoms is the dynamic coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, unknown_name

PREFIX = "static_friction_"
SLIP = 0.002
"""m/s at which an object counts as sliding: well above MuJoCo's creep, well below any commanded
slide."""


OWN, FIXED = 1, 2
"""Geoms of the object, and of what never moves."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiction:
    """Static and dynamic coefficient of an object, and where they apply.

    Attributes:
        geoms: the object's geom ids.
        dof: first of its free joint's degrees of freedom.
        static, dynamic: coefficients of sliding friction, the latter per geom.
        sides: per geom of the world: `OWN`, `FIXED`, else 0.
    """

    geoms: tuple[int, ...]
    dof: int
    static: float
    dynamic: tuple[float, ...]
    sides: NDArray[np.int8]

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Set the coefficient that holds at the speed at which the object slides on what it
        touches. What hops lands at the one that it left with: it has not come to rest in the air."""
        slip = self._slip(model, data)
        if slip is None:
            return
        for geom, dynamic in zip(self.geoms, self.dynamic, strict=True):
            model.geom_friction[geom, 0] = dynamic if slip > SLIP else self.static

    def _slip(self, model: mujoco.MjModel, data: mujoco.MjData) -> float | None:
        """Largest horizontal speed, m/s, of the object's contact points with static things; None where it
        touches none.

        At the contact, not at the body's origin: an object turns in the fingers' grip before its
        base slips.
        """
        sides = self.sides.take(data.contact.geom)
        on_fixed = sides[:, 0] + sides[:, 1] == OWN + FIXED
        if not on_fixed.any():
            return None
        body = model.geom_bodyid[self.geoms[0]]
        linear, turning = data.qvel[self.dof : self.dof + 3], data.qvel[self.dof + 3 : self.dof + 6]
        wx, wy, wz = data.xmat[body].reshape(3, 3) @ turning
        x, y, z = (data.contact.pos[on_fixed] - data.xpos[body]).T
        return float(np.hypot(linear[0] + (wy * z - wz * y), linear[1] + (wz * x - wx * z)).max())


def declared(model: mujoco.MjModel) -> tuple[Stiction, ...]:
    """Read the declarations in the model's `<custom>`.

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
    sides = np.where(model.body_weldid[model.geom_bodyid] == 0, FIXED, 0).astype(np.int8)
    sides[list(geoms)] = OWN
    return Stiction(geoms, int(model.body_dofadr[body]), static, dynamic, sides)
