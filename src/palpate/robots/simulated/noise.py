"""Sensor worlds: how an arm's signals, and the arm itself, differ from the nominal model.

Everything random comes from one seeded generator. Which worlds there are says `noise_models`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Imperfections:
    """The size of every imperfection; zero is perfect.

    Sizes come from an arm's description. The distances and times over which they act are of the
    usual order for harmonic drives, bearings and strain gauges; no maker publishes them.

    Attributes:
        torque_noise: (7,) N m, standard deviation of a 1 kHz sample.
        friction: (7,) N m, what the bearings, seals and cables behind the sensor hold back at most.
        presliding: rad, motion over which that friction turns round.
        drift: N m, standard deviation of the slow wander of a torque signal. drift_time: s, its
            time constant.
        repeatability: N, per axis at the TCP, of the torque that stays in the joints when the arm
            comes to rest.
        release: rad, motion over which that torque is shaken off.
        pose_repeatability: m, per axis, between the TCP's true place and the reported one.
        resettling: rad, motion over which that deviation changes into the next one.
        gain: relative, half width of a joint torque sensor's gain error.
        link_mass: relative, standard deviation of a link's true mass. link_com: m, likewise of its
            centre, per axis.
    """

    torque_noise: Array
    friction: Array
    presliding: float = 2e-3
    drift: float = 0.0
    drift_time: float = 300.0
    repeatability: float = 0.0
    release: float = 1.5e-3
    pose_repeatability: float = 0.0
    resettling: float = 2e-2
    gain: float = 0.0
    link_mass: float = 0.0
    link_com: float = 0.0


SHARE = 0.3
"""Share of a link's mass that `perturb_links` may move to put its centre elsewhere."""


def perturb_links(
    robot: mujoco.MjSpec,
    links: Collection[str],
    kinds: Imperfections,
    random: np.random.Generator,
) -> None:
    """Compensate the nominal weight of every body natively, and give the links their true mass and
    centre.

    MuJoCo's `gravcomp` acts at a body's own centre with its own mass. So each link is split: a part
    at the nominal centre, whose compensation is that of the whole nominal link, and an
    uncompensated part that makes up the rest.
    """
    for body in [b for b in robot.bodies if b.name != "world"]:
        body.gravcomp = 1.0
        if body.name not in links or not (kinds.link_mass or kinds.link_com):
            continue
        _split(body, kinds, random)


def _split(body: mujoco.MjsBody, kinds: Imperfections, random: np.random.Generator) -> None:
    """A compensated part at the nominal centre, and one that makes up the true mass and centre."""
    nominal, centre = body.mass, np.array(body.ipos)
    mass = nominal * (1.0 + kinds.link_mass * random.standard_normal())
    shift = kinds.link_com * random.standard_normal(3)
    rest = mass - (1.0 - SHARE) * nominal
    other = body.add_body(
        name=f"{body.name}_rest",
        mass=rest,
        ipos=centre + shift * mass / rest,
        explicitinertial=True,
    )
    body.mass, body.gravcomp = (1.0 - SHARE) * nominal, 1 / (1 - SHARE)
    if np.isnan(body.fullinertia[0]):  # a file gives principal moments or all six
        other.iquat, other.inertia = body.iquat, SHARE * body.inertia
        body.inertia = (1.0 - SHARE) * body.inertia
    else:
        other.fullinertia = SHARE * body.fullinertia
        body.fullinertia = (1.0 - SHARE) * body.fullinertia


REST_SPEED = 3e-3
"""rad/s, norm over the joints: below it the arm is coming to rest."""
SETTLING = 0.08
"""s: time constant with which the joints stick once they rest."""
SHAKEN_OFF = 0.05
"""Share of the sticking torque left at which the next rest is a new approach."""


class Sensors:
    """Turns true joint torques into measured ones, and keeps the deviation of the reported pose.

    Its state follows the joints' motion, one log period at a time.
    """

    def __init__(
        self,
        kinds: Imperfections,
        period: float,
        samples_per_period: int,
        random: np.random.Generator,
    ) -> None:
        self._kinds, self._period, self._random = kinds, period, random
        self._cycles = random.spawn(1)[0]
        self._noise = kinds.torque_noise / np.sqrt(samples_per_period)  # of a block's mean
        self._perfect = not kinds.torque_noise.any()
        self._gain = 1.0 + kinds.gain * random.uniform(-1.0, 1.0, 7)
        self._friction = kinds.friction * random.uniform(-1.0, 1.0, 7)
        self._drift = kinds.drift * random.standard_normal(7)
        self._stick, self._stuck, self._resting = np.zeros(7), 0.0, False
        self._zero = np.zeros(7)
        self._pose_goal = np.zeros(3)
        self.pose_error = kinds.pose_repeatability * random.standard_normal(3)
        """(3,) m, world axes: reported less true position of the TCP."""
        self._pose_goal[:] = self.pose_error

    def zero(self, torque: Array, nominal: Array) -> None:
        """Zero the torque sensors at rest: with the true `torque` (7,) they now show the `nominal`
        one."""
        self._zero[:] = self._gain * torque + self._friction + self._drift - nominal

    def measure(self, torque: Array, dq: Array, jacobian: Array) -> Array:
        """Measured joint torques (n, 7) of n log periods, N m.

        Args:
            torque: (n, 7) true mean torques behind the gears. dq: (n, 7) rad/s.
            jacobian: (6, 7) of the last of them.
        """
        if self._perfect:
            return torque
        n, kinds = len(torque), self._kinds
        step = np.abs(dq) * self._period
        keep = np.exp(step * (-1.0 / kinds.presliding))
        pull = np.copysign(kinds.friction * (1.0 - keep), dq)
        extra = np.empty((n, 7))
        for i in range(n):
            self._friction *= keep[i]
            self._friction += pull[i]
            extra[i] = self._friction
        if kinds.repeatability:
            self._settle(extra, step, jacobian)
        noise = self._random.standard_normal((n + 1, 7))
        fade = n * self._period / kinds.drift_time
        self._drift += kinds.drift * (2 * fade) ** 0.5 * noise[n] - fade * self._drift
        extra += noise[:n] * self._noise
        extra += self._drift - self._zero
        extra += self._gain * torque
        return extra

    def cycles(self, count: int) -> Array:
        """(count, 7) N m: the noise of single samples, for those who look at every one."""
        if self._perfect:
            return np.zeros((count, 7))
        return self._kinds.torque_noise * self._cycles.standard_normal((count, 7))

    def _settle(self, extra: Array, step: Array, jacobian: Array) -> None:
        """Add the torque that sticks in resting joints, and let the pose's deviation follow the
        motion."""
        distance = np.sqrt((step * step).sum(1))
        left = np.exp(distance * (-1.0 / self._kinds.release)).tolist()
        for i, slid in enumerate(distance.tolist()):
            self._stuck *= left[i]
            if slid < REST_SPEED * self._period:
                if self._stuck < SHAKEN_OFF and not self._resting:
                    self._approach(jacobian)
                self._resting = True
                self._stuck += (1.0 - self._stuck) * self._period / SETTLING
            elif self._stuck < SHAKEN_OFF:
                self._resting = False
            extra[i] += self._stuck * self._stick
        moved = 1.0 - float(np.exp(-distance.sum() / self._kinds.resettling))
        self.pose_error += (self._pose_goal - self.pose_error) * moved

    def _approach(self, jacobian: Array) -> None:
        """A new rest: what stays in the joints now looks like a force at the TCP."""
        force = self._kinds.repeatability * self._random.standard_normal(3)
        self._stick = jacobian[:3].T @ force
        self._pose_goal = self._kinds.pose_repeatability * self._random.standard_normal(3)
