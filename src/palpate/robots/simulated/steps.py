"""Records of consecutive control cycles: a row a cycle, and a row a block of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.timing import BLOCK


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Record of the robot over some blocks of steps.

    Attributes:
        q, dq: (n, 7) at the end of each block.
        torque: (n, 7) mean commanded joint torques, N m.
        contact: (n, 7) mean N m that contacts exert at the joints, where the world `feels`.
        fingers, finger_speed: (n, 2) at the end of each block, m, m/s.
    """

    q: Array
    dq: Array
    torque: Array
    contact: Array
    fingers: Array
    finger_speed: Array


class Cycles:
    """Room for n cycles of a world with nq positions and nv velocities.

    Attributes:
        torque: (n, 7) N m commanded at the joints.
        weight: (n, 7) N m of these that hold the nominal arm up.
        dq: (n, 7) rad/s at the end of each cycle.
        contact: (n, 7) N m that contacts exert at the joints; zero unless somebody writes them down.
        qpos, qvel: (n / BLOCK, nq) and (n / BLOCK, nv) at the end of each block.
    """

    def __init__(self, n: int, nq: int, nv: int) -> None:
        self.torque, self.weight, self.dq = np.empty((n, 7)), np.empty((n, 7)), np.empty((n, 7))
        self.contact = np.zeros((n, 7))
        self.qpos, self.qvel = np.empty((n // BLOCK, nq)), np.empty((n // BLOCK, nv))

    def felt(self, first: int, last: int) -> tuple[Array, Array]:
        """Return the inputs of `Guard.feels`, of the cycles from `first` to `last`."""
        rows = slice(first, last)
        return self.torque[rows] - self.weight[rows], self.dq[rows]


def block_means(values: Array) -> Array:
    """(n / BLOCK, 7) of values (n, 7), a row a cycle."""
    return np.add.reduce(values.reshape(-1, BLOCK, 7), axis=1) / BLOCK
