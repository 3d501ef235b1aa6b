"""Errors drawn at every rest of the arm: a torque that sticks in the joints, and the TCP's
true resting position."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import PoseErrors, Sticking
from palpate.robots.simulated.noise.motion import Motion
from palpate.robots.simulated.noise.values import JOINTS, Streams

REST_SPEED = 3e-3
"""rad/s, norm over the joints: below it the arm is coming to rest."""
NEW_APPROACH = 4.5e-3
"""rad of motion, norm over the joints, after which the next rest is a new approach: three times
the usual release, which leaves 5 % of what had stuck."""


class Rests:
    """Follows the arm's motion and rests, one log period at a time.

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
        """Add what sticks to the link-side torques (n, 7), N m, and let the deviation of the pose
        follow the motion."""
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
                    self._approach(motion.jacobian)
                    self._moved = 0.0
                self._resting = True
                self.torque += (self._goal - self.torque) * builds
                self._goal *= stays
            elif self._moved > NEW_APPROACH:
                self._resting = False
            torque[i] += self.torque
        moved = -math.expm1(-float(steps.sum()) / self._pose.resettling)
        self.pose_error += (self._place - self.pose_error) * moved

    def _approach(self, jacobian: Array) -> None:
        """A new rest: what stays in the joints now looks like a force at the TCP, besides what it
        has in common with the last one."""
        memory, before = self._model.memory, self._goal
        new = jacobian[:3].T @ self._model.force.draw(self._force)
        new += self._model.torque.draw(self._own)
        self._goal = memory * before + math.sqrt(1.0 - memory * memory) * new
        self._place = self._pose.repeatability.draw(self._places)
