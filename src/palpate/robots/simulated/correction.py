"""The controller knows the reported arm; MuJoCo's springs act on the true one.

So set-points and feed-forward torques are given to the springs as the true arm must have them, for
the reported one to do as it is told.
"""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.encoders import Encoders
from palpate.robots.simulated.readout import Readout
from palpate.robots.simulated.world import World

BLEND = 0.5
"""Share of a new deviation that is taken over in a run of cycles. Where joints or pads give way,
the deviation follows the force and the force the set-point: all of it at once would swing up where
they give way more than the controller's springs do."""


class Correction:
    """True less reported, now and at the end of the next run of cycles.

    Attributes:
        torque: (7,) N m by which the nominal arm weighs more than what MuJoCo holds up.
    """

    def __init__(self, world: World, readout: Readout, encoders: Encoders, askew: bool) -> None:
        self._world, self._readout, self._encoders = world, readout, encoders
        self._needed = askew or not encoders.exact
        self.torque = np.zeros(7)
        self._turn = np.array([1.0, 0.0, 0.0, 0.0])
        self._before = self._after = self._now()

    def follow(self) -> None:
        """Before a run of cycles: where the arm is now."""
        self._before, new = self._after, self._now()
        if self._needed:
            self._after = self._before + BLEND * (new - self._before)
        else:
            self._before = self._after = new

    def joints(self, rows: Array) -> Array:
        """Set-points (n, 7), rad, of the joints' springs for the reported arm, for the true one."""
        if not self._needed:
            return rows
        return rows + self._ramp(len(rows), slice(3, 10))

    def positions(self, rows: Array) -> Array:
        """Likewise (n, 3), m, of the TCP's."""
        return rows + self._ramp(len(rows), slice(0, 3))

    def orientations(self, rows: Array) -> Array:
        """Likewise (n, 4) quaternions."""
        if not self._needed:
            return rows
        w, x, y, z = self._turn
        turned = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
        return rows @ turned.T

    def _ramp(self, count: int, part: slice) -> Array:
        """From where the last run ended, so that nothing jumps."""
        if self._before is self._after:
            return self._after[part]
        share = np.arange(1.0, count + 1)[:, None] / count
        return self._before[part] + share * (self._after - self._before)[part]

    def _now(self) -> Array:
        """(10,) true less reported place of the TCP, and joint angles."""
        readout, out = self._readout, np.zeros(10)
        if not self._needed:
            out[:3] = -self._encoders.pose_error
            return out
        true, told = self._world.true_tcp(), readout.pose_world_tcp
        self._turn = (true @ told.inverse()).quaternion
        self.torque = readout.gravity_torque - self._world.compensation
        out[:3], out[3:] = true.position - told.position, -readout.astray
        return out
