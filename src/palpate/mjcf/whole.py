"""An object as one rigid body, as MuJoCo has it: its own body together with those that are fixed to
it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose, rotation


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """Mass, kg, centre of mass (3,), m, and inertia about it (3, 3), kg m², all in the frame of the
    object's body."""

    mass: float
    com: Array
    tensor: Array


def whole(model: mujoco.MjModel, name: str) -> Whole:
    """The object whose body is called `name`, its joints as the file has them; parts are added by the
    parallel axis theorem."""
    parts = list(_parts(model, int(model.body(name).id)))
    if len(parts) == 1:
        return parts[0]
    mass = sum(part.mass for part in parts)
    if mass == 0.0:
        return parts[0]
    com = np.sum([part.mass * part.com for part in parts], axis=0) / mass
    tensor = np.zeros((3, 3))
    for part in parts:
        tensor += part.tensor + part.mass * away(part.com - com)
    return Whole(mass, com, tensor)


def away(offset: Array) -> Array:
    """(3, 3) m², what a unit mass at an offset adds to an inertia."""
    return offset @ offset * np.eye(3) - np.outer(offset, offset)


def _parts(model: mujoco.MjModel, root: int) -> Iterator[Whole]:
    """Its bodies, each in the frame of the first."""
    poses = {root: Pose.of((0.0, 0.0, 0.0))}
    for body in range(root, model.nbody):
        parent = int(model.body_parentid[body])
        if body != root and parent not in poses:
            return
        if body != root:
            poses[body] = poses[parent] @ Pose.of(model.body_pos[body], model.body_quat[body])
        axes = poses[body].rotation @ rotation(model.body_iquat[body])
        com = (
            model.body_ipos[body].copy()
            if body == root
            else poses[body].apply(model.body_ipos[body])
        )
        tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
        yield Whole(float(model.body_mass[body]), com, tensor)
