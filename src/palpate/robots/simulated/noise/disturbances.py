"""Disturbances of the link-side torque: cable, base vibration, sticking at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import (
    JOINTS,
    PoseErrors,
    Sticking,
    Streams,
    Vibration,
)
from palpate.trace.samples import STANDARD_GRAVITY

REACH = 0.3  # m, correlation length of the cable's pull
WAVES = 48  # random waves that make up its field
REST_SPEED = 3e-3  # rad/s, norm over the joints: slower is coming to rest
NEW_APPROACH = 4.5e-3
"""rad of motion, norm over the joints, after which the next rest is a new approach: three times
the usual release, which leaves 5 % of the torque that had stuck."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of an arm over n consecutive log periods, as input of the sensor models."""

    q: Array  # (n, 7) rad
    dq: Array  # (n, 7) rad/s
    jacobian: Array  # (6, 7) of the last period, world axes about the TCP
    position: Array  # (n, 3) m, the TCP's

    def __len__(self) -> int:
        return len(self.q)


class Cable:
    """A force at the TCP that varies smoothly over the workspace.

    A Gaussian random field with the covariance exp(-d^2 / 2 REACH^2), by random Fourier features
    (A. Rahimi, B. Recht, "Random features for large-scale kernel machines", NIPS 2007).
    """

    def __init__(self, size: float, streams: Streams) -> None:
        random = streams("model.payload_cable")
        self._waves = random.standard_normal((3, WAVES)) / REACH
        self._phases = random.uniform(-np.pi, np.pi, WAVES)
        self._pull = size * math.sqrt(2.0 / WAVES) * random.standard_normal((WAVES, 3))

    def add(self, torque: Array, motion: Motion) -> None:
        """Add the pull to the link-side torques (n, 7), N m."""
        force = np.cos(motion.position @ self._waves + self._phases) @ self._pull  # (n, 3) N
        torque += force @ motion.jacobian[:3]


class BaseVibration:
    """Vertical acceleration of the base, which scales the weight of arm and load."""

    def __init__(self, vibration: Vibration, period: float, streams: Streams) -> None:
        self._omega = 2 * math.pi * vibration.frequency
        self._phase = streams.run("environment.vibration").uniform(-np.pi, np.pi)
        within = self._omega * period / 2  # a block's mean is less than its middle
        self._size = math.sqrt(2.0) * vibration.acceleration * np.sinc(within / np.pi)
        self._period, self._t = period, 0.0

    def add(self, torque: Array) -> None:
        """Add the vibration to the link-side torques (n, 7), N m, nearly all of which are weight."""
        times = self._t + self._period * (np.arange(len(torque)) + 0.5)
        self._t += len(torque) * self._period
        acceleration = self._size * np.sin(self._omega * times + self._phase)
        torque += torque * (acceleration / STANDARD_GRAVITY)[:, None]


class Rests:
    """Errors drawn at every rest of the arm: torque that sticks in the joints, and the TCP's true
    resting position.

    Attributes:
        pose_error: (3,) m, world axes: reported less true position of the TCP.
        torque: (7,) N m that sticks now.
    """

    def __init__(
        self, sticking: Sticking, pose: PoseErrors, period: float, streams: Streams
    ) -> None:
        self._model, self._pose, self._period = sticking, pose, period
        self._force, self._own = streams.run("sticking.force"), streams.run("sticking.torque")
        self._places = streams.run("pose.repeatability")
        self.torque, self._goal = np.zeros(JOINTS), np.zeros(JOINTS)
        self.pose_error = pose.repeatability.draw(self._places)
        self._place = self.pose_error.copy()
        self._resting, self._moved = False, math.inf
        self.none = not (sticking.force.any or sticking.torque.any or pose.repeatability.any)

    def add(self, torque: Array, motion: Motion) -> None:
        """Add the sticking torque to the link-side torques (n, 7), N m, and update `pose_error`."""
        model, period = self._model, self._period
        steps = np.linalg.norm(motion.dq, axis=1) * period
        left = np.exp(-steps / model.release).tolist()
        builds = min(1.0, period / model.settling)
        stays = math.exp(-period / model.relaxation)
        for i, slid in enumerate(steps.tolist()):
            self._moved += slid
            self.torque *= left[i]
            if slid < REST_SPEED * period:
                if not self._resting and self._moved > NEW_APPROACH:
                    self._draw(motion.jacobian)
                    self._moved = 0.0
                self._resting = True
                self.torque += (self._goal - self.torque) * builds
                self._goal *= stays
            elif self._moved > NEW_APPROACH:
                self._resting = False
            torque[i] += self.torque
        # The position error follows the motion to that of the newest rest.
        moved = -math.expm1(-float(steps.sum()) / self._pose.resettling)
        self.pose_error += (self._place - self.pose_error) * moved

    def _draw(self, jacobian: Array) -> None:
        """Draw the errors of a new rest, correlated by `memory` with the last one."""
        memory = self._model.memory
        new = jacobian[:3].T @ self._model.force.draw(self._force)  # like a force at the TCP
        new += self._model.torque.draw(self._own)
        self._goal = memory * self._goal + math.sqrt(1.0 - memory * memory) * new
        self._place = self._pose.repeatability.draw(self._places)
