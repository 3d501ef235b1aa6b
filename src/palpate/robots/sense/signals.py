"""Plausibility of a robot's signals: time stamps, numbers, jumps, and spikes of the forces."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.robot import RobotState
from palpate.trace.samples import Samples

STALLED = 5  # advances after which a clock that has not moved stands
BY_ITSELF = 30.0
"""s that may pass unasked on a real arm, whose time goes on while a computer is busy: no fault of
the clock."""
OVERSPEED = 1.5  # times a joint's speed limit: a faster encoder jumps
ENCODER_SLACK = 2e-3  # rad of tolerance between two samples of an encoder
OVERSHOOT = 2.0  # times the TCP's speed limit: a faster reported pose jumps
POSE_SLACK = 0.01  # m of tolerance between two reported poses
OVERLOAD = 2.0  # times a joint's torque limit: no joint bears more
WIDTH_SLACK = 0.005  # m that the reported width may lie beyond closed and open fingers
WIDTH_SPEED = 2.0  # m/s: no finger is as fast
SIGNALS = ("q", "dq", "tau_ext", "wrench", "pose_world_tcp", "twist", "width")
FORCE, TORQUE = 4.0, 2.0
"""N, N m by which a contact may grow from one state to the next without confirmation: at 20 mm/s it
grows by 1 N. A hard one grows by more, and is confirmed 20 ms late; the robot's own reflex is not.
An object that is pressed and rubbed may slip and stick: changes up to the largest contact within
`RUBBED` need no confirmation either."""
RUBBED = 0.3
"""s, time constant with which the largest contact is forgotten; stick-slip repeats within 0.1 s."""
SHAKEN = 20.0, 5.0
"""N, N m per rad/s of the joints' speed (norm) by which ripple of the gears shakes a contact from one
state to the next: recordings of an FR3 in a soft loop jump by 11 N (95 %) in 20 ms at 0.6 rad/s."""
LOAD = 0.25  # of a joint's torque limit: the same for its torque
MOST, WINDOW = 4, 1.0  # spikes within so many s are a fault


@dataclass(frozen=True, slots=True)
class Fault:
    """Reason to distrust the signals."""

    name: str
    what: str  # one sentence, with figures
    since: float  # s, robot time: nothing that was sensed after it is evidence

    def __str__(self) -> str:
        return f"{self.name} since {self.since:.2f} s: {self.what}"


class Clock:
    """Check of the robot's time, and of the stamps of its samples: they must neither stand, go back
    nor leap."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._state: RobotState | None = None
        self._asked, self._waits = 0.0, 0
        self._sample: float | None = None

    def ask(self, duration: float) -> None:
        """Note that the robot is asked to let `duration` s pass."""
        self._asked += duration
        self._waits += 1

    def follow(self, state: RobotState) -> Fault | None:
        """Check the next state. Old samples are left to the safety predicate."""
        before, self._state = self._state, state
        if before is None:
            self._asked, self._waits = 0.0, 0
            return None
        passed, late = state.t - before.t, self._limits.stale_after
        stale = state.t - state.stamp > late
        if passed < 0.0 or (state.stamp < before.stamp and not stale):
            what = f"from {before.stamp:.3f} s to {state.stamp:.3f} s"
            return Fault("time goes back", what, before.t)
        if state.stamp > state.t + late:
            what = f"sensor data is stamped {state.stamp - state.t:.2f} s ahead of its time"
            return Fault("time leaps", what, before.t)
        if passed > self._asked + (BY_ITSELF if state.mode else late):
            what = f"{passed:.2f} s passed where {self._asked:.2f} s were asked for"
            return Fault("time leaps", what, before.t)
        if passed == 0.0 and self._waits >= STALLED:
            what = f"{self._asked:.2f} s were asked for, and none passed"
            return Fault("time stands", what, before.t)
        if passed > 0.0:
            self._asked, self._waits = 0.0, 0
        return None

    def order(self, samples: Samples, now: float) -> Fault | None:
        """Check the stamps of new samples at robot time `now`."""
        last = self._sample
        for t in samples.t.tolist():
            if last is not None and t <= last:
                return Fault("time goes back", f"a sample of {t:.3f} s after {last:.3f} s", last)
            last = t
        self._sample = last
        late = self._limits.stale_after
        if last is not None and last > now + late:
            return Fault("time leaps", f"a sample of {last:.3f} s at {now:.3f} s", now)
        if last is not None and now - last > late:
            return Fault("no samples", f"none for {now - last:.2f} s", last)
        return None


class Spikes:
    """Filter of the forces, a median over three states where they jump: a change that only one
    state shows is held back, and counted."""

    def __init__(self, limits: Limits) -> None:
        self._scale = LOAD * limits.tau_max
        self._believed: RobotState | None = None
        self._doubted: RobotState | None = None
        self._times: deque[float] = deque(maxlen=MOST)
        self._pressed, self._twisted = 0.0, 0.0  # N, N m: largest recent contact

    def follow(self, state: RobotState) -> Fault | None:
        """Filter the next state."""
        if self._believed is not None:
            left = math.exp(min(self._believed.t - state.t, 0.0) / RUBBED)
            contact = self._believed.contact
            self._pressed = max(norm(contact[:3]), left * self._pressed)
            self._twisted = max(norm(contact[3:]), left * self._twisted)
        if self._doubted is not None and self._believed is not None:
            if self._apart(state, self._doubted) <= self._apart(state, self._believed):
                self._believed = state
            else:
                self._times.append(self._doubted.t)
        self._doubted = None
        if self._believed is None or self._apart(state, self._believed) <= 1.0:
            self._believed = state
        else:
            self._doubted = state
        times = self._times
        if len(times) < MOST or state.t - times[0] > WINDOW:
            return None
        what = f"the forces jumped and came back {MOST} times within {state.t - times[0]:.2f} s"
        return Fault("spikes", what, times[0])

    @property
    def doubting(self) -> bool:
        """True if the next state decides whether a force has jumped."""
        return self._doubted is not None

    def believable(self, state: RobotState) -> RobotState:
        """Return the state with filtered forces."""
        last = self._believed
        if self._doubted is None or last is None:
            return state
        return replace(
            state, tau=last.tau, tau_ext=last.tau_ext, wrench=last.wrench, contact=last.contact
        )

    def _apart(self, state: RobotState, other: RobotState) -> float:
        """Compute the distance of two states' forces, in units of the change that needs no
        confirmation."""
        speed, force = norm(state.dq), np.abs(state.contact - other.contact)
        force[:3] /= max(FORCE, self._pressed, SHAKEN[0] * speed)
        force[3:] /= max(TORQUE, self._twisted, SHAKEN[1] * speed)
        torque = np.abs(state.tau - other.tau) / self._scale
        return float(np.concatenate([force, torque]).max())  # not a number, if any is none


def norm(v: Array) -> float:
    """Compute the Euclidean norm of a short vector, faster than numpy."""
    return math.sqrt(v @ v)


def not_finite(samples: Samples) -> Fault | None:
    """Find NaN and infinity in the samples."""
    signals: list[Array] = [getattr(samples, name) for name in SIGNALS]
    if np.isfinite(np.concatenate([values.ravel() for values in signals])).all():
        return None
    for name, values in zip(SIGNALS, signals, strict=True):
        bad = ~np.isfinite(values.reshape(len(samples), -1)).all(axis=1)
        if bad.any():
            count = f"{int(bad.sum())} of {len(samples)} samples of {name}"
            return Fault("not a number", count, float(samples.t[bad.argmax()]))
    return None


def impossible(samples: Samples, last: Samples, limits: Limits) -> Fault | None:
    """Find joints that jump, and torques that no joint bears; `last` are the samples before."""
    t = np.concatenate([last.t[-1:], samples.t])
    q = np.concatenate([last.q[-1:], samples.q])
    dt = np.maximum(t[1:] - t[:-1], 0.0)[:, None]
    steps = np.abs(q[1:] - q[:-1])
    beyond = steps - OVERSPEED * limits.dq_max * dt - ENCODER_SLACK
    if beyond.max(initial=-1.0) > 0.0:
        row, i = np.unravel_index(int(beyond.argmax()), beyond.shape)
        what = (
            f"joint {i + 1} by {steps[row, i]:.3f} rad in {1e3 * dt[row, 0]:.0f} ms, more than "
            f"{limits.dq_max[i]:.2f} rad/s allow"
        )
        return Fault("encoders jump", what, float(t[row + 1]))
    share = np.abs(samples.tau_ext) / limits.tau_max
    if share.max(initial=0.0) > OVERLOAD:
        row, i = np.unravel_index(int(share.argmax()), share.shape)
        what = f"{samples.tau_ext[row, i]:.0f} N m in joint {i + 1}, which bears {limits.tau_max[i]:.0f}"
        return Fault("impossible torque", what, float(samples.t[row]))
    return None


def pose_jumps(state: RobotState, before: RobotState, limits: Limits) -> Fault | None:
    """Find a jump of the reported TCP."""
    way = state.pose_world_tcp.distance_to(before.pose_world_tcp)
    possible = OVERSHOOT * limits.speed_max * (state.t - before.t) + POSE_SLACK
    if way <= possible:
        return None
    what = f"the TCP by {1e3 * way:.0f} mm in {1e3 * (state.t - before.t):.0f} ms"
    return Fault("the pose jumps", what, before.t)


def wrong_width(state: RobotState, before: RobotState, arm: RobotDescription) -> Fault | None:
    """Find an impossible width of the fingers, or a jump of it."""
    width, opening = state.width, arm.hand.opening
    if not -WIDTH_SLACK <= width <= opening + WIDTH_SLACK:
        what = f"{1e3 * width:.1f} mm, of fingers that open {1e3 * opening:.0f} mm"
        return Fault("impossible width", what, before.t)
    way = abs(width - before.width)
    if way > WIDTH_SPEED * (state.t - before.t) + WIDTH_SLACK:
        what = f"by {1e3 * way:.0f} mm in {1e3 * (state.t - before.t):.0f} ms"
        return Fault("the width jumps", what, before.t)
    return None
