"""What the arm's encoders and torque sensors say, 1 kHz: palpate's own sensor models.

These live through blocks of cycles, as the embedded robot logs them; between two blocks their
deviations go on where they were, and each cycle has its own white noise.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.common.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import RIDGE, wrench
from palpate.robots.simulated.noise.disturbances import LoggedMotion
from palpate.robots.simulated.noise.model import JOINTS, NoiseModel, Streams
from palpate.robots.simulated.noise.sensors import PAD_TIME, Encoders, Sensors
from palpate.robots.simulated.readout import OBSERVER_TIME
from palpate.robots.simulated.timing import BLOCK, PERIOD, TIMESTEP

from .believed import BelievedArm
from .plant import Plant

YIELDS = -math.expm1(-TIMESTEP / PAD_TIME)
"""Links give way as slowly as pads do: what a joint bends under a torque moves inertias."""
KEEPS = math.exp(-TIMESTEP / OBSERVER_TIME)


class Sensing:
    """Reported joint angles, rates and torques.

    Attributes:
        q, dq: (7,) rad, rad/s. tau: (7,) N m. external: (7,) N m, filtered.
        peak: N, the largest mean of a block that contacts exerted at the stiffness frame so far;
            true, and told to nobody but at the side door.
    """

    def __init__(
        self,
        plant: Plant,
        believed: BelievedArm,
        arm: RobotDescription,
        noise: NoiseModel,
        streams: Streams,
    ) -> None:
        self._plant, self._believed = plant, believed
        quiet = noise.torque.model_copy(update={"white": np.zeros(JOINTS)})
        calm = noise.model_copy(update={"torque": quiet})
        self._sensors = Sensors(calm, arm.limits.tau_max, streams)
        self._white, self._looks = noise.torque.white, streams.run("torque.white.looks")
        self._encoders = Encoders(noise, self._sensors.rests, streams)
        self._fine, self._blur = noise.pose.encoder, streams.run("pose.encoder")
        self._deviation, self.external = np.zeros(7), np.zeros(7)
        self._sums, self._cycle, self.peak = np.zeros((4, 7)), 0, 0.0
        self._bearing = plant.true_gravity_torque()
        self._start()

    def _start(self) -> None:
        """At rest, the torque sensors zeroed."""
        plant, believed = self._plant, self._believed
        self.q, self.dq = plant.q.copy(), np.zeros(7)
        believed.update(self.q, self.dq, self.dq)
        self._next = np.zeros(7)
        self._step_block(np.zeros(3))
        self._astray = self._next
        off = self._astray + self._bent()
        self._late = [off] * BLOCK
        self.q = plant.q + off
        believed.update(self.q, self.dq, self.dq)
        place = believed.O_T_EE[None, :3, 3]
        start = LoggedMotion(self.q[None], np.zeros((1, 7)), believed.jacobian, place)
        self.tau = believed.gravity.copy()
        self._sensors.zero(self._bearing, self.tau, start)

    def update(self) -> None:
        """After a cycle."""
        plant, believed = self._plant, self._believed
        self._cycle += 1
        self._read_encoders()
        believed.update(self.q, self.dq, plant.ddq)
        self._sums += (plant.link, self.q, self.dq, plant.contact)
        if self._cycle % BLOCK == 0:
            self._live()
        self.tau = plant.link + self._deviation
        if self._white.any():
            self.tau += self._white * self._looks.standard_normal(JOINTS)
        residual = self.tau - believed.gravity - believed.moving
        self.external = KEEPS * self.external + (1.0 - KEEPS) * residual

    def _read_encoders(self) -> None:
        plant, part = self._plant, (self._cycle % BLOCK) / BLOCK
        q = plant.q + self._astray + part * (self._next - self._astray)
        if not self._encoders.exact:
            self._bearing += YIELDS * (plant.link - self._bearing)
            q += self._bent()
        if self._fine.any():
            q += self._fine * self._blur.standard_normal(JOINTS)
        q = self._encoders.quantise_angles(q)
        off = q - plant.q
        self.q, self.dq = q, plant.dq + (off - self._late[self._cycle % BLOCK]) / PERIOD
        self._late[self._cycle % BLOCK] = off

    def _bent(self) -> Array:
        """(7,) rad by which the encoders are off for joints that give way, and by themselves."""
        q = self._plant.q
        return self._encoders.reported(q[None], self._bearing[None])[0] - q

    def _live(self) -> None:
        """A block has passed."""
        torque, q, dq, contact = self._sums / BLOCK
        self._sums[:] = 0.0
        believed = self._believed
        position = believed.O_T_EE[None, :3, 3]
        motion = LoggedMotion(q[None], dq[None], believed.jacobian, position)
        shown, arrived, _ = self._sensors.measure(torque[None], motion)
        if arrived is None or arrived[0]:
            self._deviation = shown[0] - torque
        self._encoders.pass_time(1)
        touch = wrench(believed.jacobian, contact)[:3]
        self.peak = max(self.peak, float(np.linalg.norm(touch)))
        self._step_block(touch)

    def _step_block(self, touch: Array) -> None:
        """Where the reported angles are off to in the next block: what makes the TCP stand
        elsewhere than reported, and pads that give way under a force (3,), N, of contacts."""
        believed, encoders = self._believed, self._encoders
        self._astray = self._next
        jacobian = believed.jacobian
        error = np.concatenate([encoders.pose_error, np.zeros(3)])
        self._next = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + RIDGE, error)
        if encoders.soft:
            tool = believed.O_T_EE[:3, 2]
            self._next += encoders.pressed(jacobian, -touch[None] @ tool, tool)[0]
