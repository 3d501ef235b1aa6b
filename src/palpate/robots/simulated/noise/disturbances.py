"""Disturbances of joint torques: cable, vibration, sticking, joint friction, gear ripple."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.robots.simulated.noise.model import (
    EncoderRipple,
    FrictionNoise,
    PoseErrors,
    Resonance,
    Sticking,
    Streams,
    Vibration,
)
from palpate.trace.samples import STANDARD_GRAVITY

REACH = 0.3  # m, correlation length of the cable's force
WAVES = 48  # random waves that make up its field
REST_SPEED = 3e-3  # rad/s, norm over the joints: slower joints come to rest
# rad of motion, norm over the joints, after which the next rest is a new approach. It is three
# times the usual release, which leaves 5 % of the torque that had stuck.
NEW_APPROACH = 4.5e-3


@dataclass(frozen=True, slots=True, eq=False)
class LoggedMotion:
    """Motion of an arm over n consecutive log periods, as input of the sensor models."""

    q: Array  # (n, 7) rad
    dq: Array  # (n, 7) rad/s
    jacobian: Array  # (6, 7) of the last period, world axes about the TCP
    position: Array  # (n, 3) m, the TCP's

    def __len__(self) -> int:
        return len(self.q)


class Cable:
    """Force at the TCP that varies smoothly over the workspace.

    It is a Gaussian random field with the covariance exp(-d^2 / 2 REACH^2), by random Fourier features (A.
    Rahimi, B. Recht, "Random features for large-scale kernel machines", NIPS 2007).
    """

    def __init__(self, size: float, streams: Streams) -> None:
        random = streams("model.payload_cable")
        self._waves = random.standard_normal((3, WAVES)) / REACH
        self._phases = random.uniform(-np.pi, np.pi, WAVES)
        self._pull = size * math.sqrt(2.0 / WAVES) * random.standard_normal((WAVES, 3))

    def add(self, torque: Array, motion: LoggedMotion) -> None:
        """Add the pull to the link-side torques (n, 7), N m."""
        force = np.cos(motion.position @ self._waves + self._phases) @ self._pull  # (n, 3) N
        torque += force @ motion.jacobian[:3]


class BaseVibration:
    """Vertical acceleration of the base, which scales the weight of arm and load."""

    def __init__(self, vibration: Vibration, period: float, streams: Streams) -> None:
        self._omega = 2 * math.pi * vibration.frequency
        self._phase = streams.run("environment.vibration").uniform(-np.pi, np.pi)
        within = self._omega * period / 2  # a block's mean is below its middle
        self._size = math.sqrt(2.0) * vibration.acceleration * np.sinc(within / np.pi)
        self._period, self._t = period, 0.0

    def add(self, torque: Array) -> None:
        """Add the vibration to the link-side torques (n, 7), N m, which are nearly all weight."""
        times = self._t + self._period * (np.arange(len(torque)) + 0.5)
        self._t += len(torque) * self._period
        acceleration = self._size * np.sin(self._omega * times + self._phase)
        torque += torque * (acceleration / STANDARD_GRAVITY)[:, None]


class Rests:
    """Errors drawn at every rest of the arm: sticking torque of the joints, and the TCP's true resting
    position.

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
        self.torque, self._goal = np.zeros((2, *sticking.torque.size.shape))
        self.pose_error = pose.repeatability.draw(self._places)
        self._place = self.pose_error.copy()
        self._resting, self._moved = False, math.inf
        self.none = not (sticking.force.any or sticking.torque.any or pose.repeatability.any)

    def add(self, torque: Array, motion: LoggedMotion) -> None:
        """Add the sticking torque to the link-side torques (n, 7), N m, and update `pose_error`."""
        # Motion per period, and the share of the sticking torque that survives it.
        model, period = self._model, self._period
        steps = np.linalg.norm(motion.dq, axis=1) * period
        left = np.exp(-steps / model.release).tolist()
        builds = min(1.0, period / model.settling)
        stays = math.exp(-period / model.relaxation)
        # The torque decays with motion, and builds up to its new value at rest.
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
        """Draw the errors of a new rest; `memory` is their correlation with the last rest."""
        memory = self._model.memory
        new = jacobian[:3].T @ self._model.force.draw(self._force)  # like a force at the TCP
        new += self._model.torque.draw(self._own)
        self._goal = memory * self._goal + math.sqrt(1.0 - memory * memory) * new
        self._place = self._pose.repeatability.draw(self._places)


# Joint friction behind the torque sensor, in bearings, seals and cables.


class JointFriction:
    """Dahl friction, whose level may depend on speed (Stribeck), load and angle.

    The torque approaches plus or minus its level exponentially with the distance moved:
    d tau / d|q| = (level sgn(dq) - tau) / presliding (P. Dahl, "Solid friction damping of mechanical
    vibrations", AIAA Journal 14, 1976).
    """

    def __init__(self, friction: FrictionNoise, period: float, streams: Streams) -> None:
        # The individual robot's level, phases and initial torque.
        self._model, self._period = friction, period
        spread = 1.0 + friction.spread.draw(streams("friction.spread"))
        self._level = friction.coulomb * np.maximum(spread, 0.0)
        self._phase = streams("friction.position").uniform(-np.pi, np.pi, len(self._level))
        # (7,) N m now, in the direction of the last motion.
        random = streams.run("friction.coulomb")
        self.torque = self._level * random.uniform(-1.0, 1.0, len(self._level))
        self._varies = friction.static > 1 or friction.load.any() or friction.position.any()
        self._viscous = bool(friction.viscous.any())
        self.none = not (self._level.any() or self._viscous or friction.load.any())

    def add(self, torque: Array, motion: LoggedMotion) -> None:
        """Add the friction to the link-side torques (n, 7), N m."""
        dq, model = motion.dq, self._model
        torque += self._held(dq, self._levels(torque, motion) if self._varies else self._level)
        if self._viscous:
            torque += model.viscous * dq
        if model.compensated:
            torque -= model.compensated * model.coulomb * np.sign(dq)

    def _held(self, dq: Array, level: Array) -> Array:
        """Compute the torques (n, 7), N m, at rates (n, 7), rad/s, and levels (n, 7) or (7,)."""
        # Exact solution over each period: tau <- keep tau + (1 - keep) level sgn(dq).
        keep = np.exp(np.abs(dq) * (-self._period / self._model.presliding))
        pull, held = np.copysign(level * (1.0 - keep), dq), np.empty_like(dq)
        for i in range(len(dq)):
            self.torque = np.add(keep[i] * self.torque, pull[i], out=held[i])
        return held

    def _levels(self, torque: Array, motion: LoggedMotion) -> Array:
        """Compute the level (n, 7), N m, that the friction approaches.

        level (1 + ripple) + load |tau|, raised by the Stribeck effect at low speed.
        """
        model = self._model
        ripple = math.sqrt(2.0) * model.position * np.sin(motion.q + self._phase)
        level = self._level * np.maximum(1.0 + ripple, 0.0) + model.load * np.abs(torque)
        slow = np.exp(-((motion.dq / model.stribeck_speed) ** 2))
        return level * (1.0 + (model.static - 1.0) * slow)


# Ripple: errors periodic in a joint's angle, and the resonance of a control loop that they excite.


class Waves:
    """Two harmonics of a ripple, with the phases of a robot."""

    def __init__(self, ripple: EncoderRipple, random: np.random.Generator) -> None:
        sizes = [ripple.size, ripple.second] if ripple.second.any() else [ripple.size]
        self.none = not np.any(sizes)  # True if the ripple is zero
        self._parts = [
            (math.sqrt(2.0) * size, k * ripple.cycles, random.uniform(-np.pi, np.pi, len(size)))
            for k, size in enumerate(sizes, start=1)
        ]

    def at(self, q: Array) -> Array:
        """Compute the ripple (n, 7) at joint angles (n, 7), rad."""
        total = np.zeros(q.shape)
        for size, cycles, phase in self._parts:
            total += size * np.sin(cycles * q + phase)
        return total


class Resonator:
    """Second-order low pass of the joints, by the bilinear transform prewarped to the natural
    frequency.
    """

    def __init__(self, resonance: Resonance, period: float) -> None:
        # A joint without a resonance passes its ripple on.
        self._acts = np.isfinite(resonance.frequency)
        omega = 2 * np.pi * np.where(self._acts, resonance.frequency, 1.0)
        # Coefficients of the biquad (b, 2 b, b) / (1, a1, a2).
        g = np.tan(np.minimum(omega * period, 0.95 * np.pi) / 2)
        scale = 1.0 / (1.0 + 2.0 * resonance.damping * g + g * g)
        self._b = g * g * scale
        self._a1 = 2.0 * (g * g - 1.0) * scale
        self._a2 = (1.0 - 2.0 * resonance.damping * g + g * g) * scale
        self._state = np.zeros((2, len(omega)))
        self._maps: dict[int, Array] = {}

    def passed(self, ripple: Array) -> Array:
        """Filter the next inputs (n, 7)."""
        # A linear map from state and inputs to new state and outputs, computed once per length.
        given = np.concatenate([self._state, ripple])
        if len(ripple) not in self._maps:
            self._maps[len(ripple)] = self._map(len(ripple))
        out = (self._maps[len(ripple)] @ given.T[:, :, None])[:, :, 0].T
        self._state = out[:2]
        return np.where(self._acts, out[2:], ripple)

    def _map(self, count: int) -> Array:
        """Compute the matrices (7, 2 + count, 2 + count) from state and inputs to the new state and the
        outputs.

        They contain the filter's response to each unit input.
        """
        each = np.broadcast_to(np.eye(2 + count)[:, None], (2 + count, len(self._b), 2 + count))
        s1, s2, out = each[0], each[1], list[Array]()
        b, a1, a2 = (one[:, None] for one in (self._b, self._a1, self._a2))
        # Transposed direct form II, with unit vectors as inputs.
        for now in each[2:]:
            here = b * now + s1
            s1, s2 = 2.0 * b * now - a1 * here + s2, b * now - a2 * here
            out.append(here)
        return np.stack([s1, s2, *out], axis=1)
