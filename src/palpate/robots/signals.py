"""Plausibility of signals: time stamps, numbers, jumps, spikes, and values that stop changing."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.robot import RobotState
from palpate.trace.samples import Samples

STALLED = 5  # advances without progress, after which a clock is called stopped
# s: time that may pass unrequested on a real arm. Its clock goes on while the computer is busy,
# which is no fault of the clock.
BY_ITSELF = 30.0
OVERSPEED = 1.5  # times a joint's speed limit: a faster encoder jumps
ENCODER_SLACK = 2e-3  # rad of tolerance between two samples of an encoder
OVERSHOOT = 2.0  # times the TCP's speed limit: a faster reported pose jumps
POSE_SLACK = 0.01  # m of tolerance between two reported poses
OVERLOAD = 2.0  # times a joint's torque limit: no joint carries more
WIDTH_SLACK = 0.005  # m that the reported width may lie beyond closed and open fingers
WIDTH_SPEED = 2.0  # m/s: no finger is as fast
SIGNALS = ("q", "dq", "tau_ext", "wrench", "pose_world_tcp", "twist", "width")
# N, N m: change of a contact from one state to the next that needs no confirmation. At 20 mm/s a
# contact grows by 1 N. A hard contact grows by more, and is confirmed 20 ms late; the robot's own
# reflex has no such delay. An object that is pressed and rubbed may slip and stick. So changes up
# to the largest contact within `RUBBED` need no confirmation either.
FORCE, TORQUE = 4.0, 2.0
# s: time constant with which the largest contact is forgotten. Stick-slip repeats within 0.1 s.
RUBBED = 0.3
SWINGS = 2.0  # Ratio of the change from one extreme to the other to the largest contact, as it sticks and slips
# N, N m per rad/s of joint speed (norm): change of a contact from state to state by ripple of the
# gears. Recordings of an FR3 in a soft loop jump by 11 N (95 %) in 20 ms at 0.6 rad/s.
SHAKEN = 20.0, 5.0
LOAD = 0.25  # of a joint's torque limit: change of its torque that needs no confirmation
MOST, WINDOW = 4, 1.0  # number of spikes within that many s that is a fault


@dataclass(frozen=True, slots=True)
class Fault:
    """Reason to distrust the signals."""

    name: str
    what: str  # one sentence, with figures
    since: float  # s, robot time: nothing that was sensed after it is evidence

    def __str__(self) -> str:
        return f"{self.name} since {self.since:.2f} s: {self.what}"


class Clock:
    """Check of the robot's time and of its samples' stamps: they must not stop, go back or leap."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._state: RobotState | None = None
        self._asked, self._waits = 0.0, 0
        self._sample: float | None = None

    def ask(self, duration: float) -> None:
        """Record the request to let `duration` s pass."""
        self._asked += duration
        self._waits += 1

    def follow(self, state: RobotState) -> Fault | None:
        """Check the next state. The safety predicate handles old samples."""
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
    """Filter of the forces: a median over three states where they jump.

    A change that only one state shows is held back and counted.
    """

    def __init__(self, limits: Limits) -> None:
        self._scale = LOAD * limits.tau_max
        self._believed: RobotState | None = None
        self._doubted: RobotState | None = None
        self._times: deque[float] = deque(maxlen=MOST)
        self._pressed, self._twisted = 0.0, 0.0  # N, N m: largest recent contact

    def follow(self, state: RobotState) -> Fault | None:
        """Filter the next state."""
        # The largest recent contact decays with the time constant RUBBED.
        if self._believed is not None:
            left = math.exp(min(self._believed.t - state.t, 0.0) / RUBBED)
            contact = self._believed.contact
            self._pressed = max(norm(contact[:3]), left * self._pressed)
            self._twisted = max(norm(contact[3:]), left * self._twisted)
        # The new state confirms the doubted one, or shows that it was a spike.
        if self._doubted is not None and self._believed is not None:
            if self._force_distance(state, self._doubted) <= self._force_distance(
                state, self._believed
            ):
                self._believed = state
            else:
                self._times.append(self._doubted.t)
        self._doubted = None
        # Doubt a state whose forces jump away from the accepted ones.
        if self._believed is None or self._force_distance(state, self._believed) <= 1.0:
            self._believed = state
        else:
            self._doubted = state
        # Many spikes in a short time are a fault.
        times = self._times
        if len(times) < MOST or state.t - times[0] > WINDOW:
            return None
        what = f"the forces jumped and came back {MOST} times within {state.t - times[0]:.2f} s"
        return Fault("spikes", what, times[0])

    @property
    def doubting(self) -> bool:
        """Test if the next state decides whether a force has jumped."""
        return self._doubted is not None

    def believable(self, state: RobotState) -> RobotState:
        """Return the state with filtered forces."""
        last = self._believed
        if self._doubted is None or last is None:
            return state
        return replace(
            state, tau=last.tau, tau_ext=last.tau_ext, wrench=last.wrench, contact=last.contact
        )

    def _force_distance(self, state: RobotState, other: RobotState) -> float:
        """Compute the distance of two states' forces, relative to the change that needs no confirmation."""
        # Scale each part by its permitted change: largest of fixed, recent contact, and ripple at this speed.
        speed, force = norm(state.dq), np.abs(state.contact - other.contact)
        force[:3] /= max(FORCE, SWINGS * self._pressed, SHAKEN[0] * speed)
        force[3:] /= max(TORQUE, SWINGS * self._twisted, SHAKEN[1] * speed)
        torque = np.abs(state.tau - other.tau) / self._scale
        return float(np.concatenate([force, torque]).max())  # NaN if any signal is NaN


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
    """Find joints that jump, and torques that no joint can carry; `last` are the preceding samples."""
    # A joint may move by its speed limit times the time between samples, plus a slack.
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
    # The external torque may not exceed a multiple of the joint's limit.
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


# Signals that stop changing although their stamps advance.


FROZEN = 0.1  # s without a change in the last bit, before a signal is called frozen
REPEATS = 4  # equal samples in a row: a noisy signal in coarse steps repeats now and then
MOVED = 2e-4  # rad: turn of a joint that changes every torque by at least the last bit
# m: motion of the commanded equilibrium that the arm's encoders must show. A quaternion's change
# counts with the factor 0.1.
LED = 1e-3
# N m (N): change from sample to sample, in nine of ten samples. A signal with so much noise never
# repeats. Torque sensors change by about 20 times as much in 5 ms.
NOISY = 1e-3
LEARNT = 100  # changes in a row from which the noise is known
ENCODERS = "encoders"  # the signal that forces do not cause

Mask = NDArray[np.bool_]


class Constancy:
    """Time for which each column of some signals, in one array, has been constant."""

    def __init__(self, widths: Mapping[str, int]) -> None:
        """`widths`: signals by name, with their number of columns, in order."""
        ends = np.cumsum(list(widths.values())).tolist()
        self._columns = {
            name: slice(end - width, end)
            for (name, width), end in zip(widths.items(), ends, strict=True)
        }
        self.names = tuple(widths)  # names of the signals
        self._since, self._repeats = np.zeros(ends[-1]), np.zeros(ends[-1], dtype=np.intp)
        self._changes = np.zeros((LEARNT, ends[-1]))
        self._goes_on = np.ones(ends[-1], dtype=np.bool_)  # columns that changed with the last row
        self._goes_on_all = True
        self._row = 0
        self._last: Array | None = None
        # Joints and equilibrium at each signal's last change.
        self._marks: dict[str, tuple[Array, Array]] = {}

    def follow(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """Process the next `values` (m, n) of the signals at times `t` (m,), with joints `q` (m, 7) and commanded
        equilibrium `target` (m, 7).
        """
        if self._last is None:
            self._last = values[:1]
            self._since[:] = t[0]
            self._marks = dict.fromkeys(self.names, (q[0], target[0]))
        for first in range(0, len(t), LEARNT):
            rows = slice(first, first + LEARNT)
            self._take(t[rows], values[rows], q[rows], target[rows])

    def stands(self, t: float) -> bool:
        """Test if any column has been constant for so long that it may be frozen."""
        return t - float(self._since.min()) >= FROZEN

    def constant_since(self, name: str, t: float) -> Array:
        """Return the time (n,), s, for which each column of a signal has been constant; 0 before enough repeats."""
        columns = self._columns[name]
        return np.where(self._repeats[columns] < REPEATS, 0.0, t - self._since[columns])

    def since(self, name: str) -> Array:
        """Return the robot time (n,), s, since which each column of a signal has been the same."""
        return self._since[self._columns[name]]

    def noisy(self, name: str) -> Mask:
        """Select the columns of a signal whose noise changed every sample before they became constant."""
        return np.quantile(self._changes[:, self._columns[name]], 0.1, axis=0) > NOISY

    def moved(self, name: str) -> float:
        """Return the largest turn of a joint, rad, since the signal changed."""
        return float(np.abs(self._q - self._marks[name][0]).max())

    def led(self, name: str) -> float:
        """Return the motion of the commanded equilibrium, m, since the signal changed."""
        way = np.abs(self._target - self._marks[name][1])
        return max(float(way[:3].max()), 0.1 * float(way[3:].max()))

    def _take(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """Process at most `LEARNT` rows."""
        assert self._last is not None
        # Change of each column from row to row.
        before = np.concatenate([self._last, values[:-1]]) if len(t) > 1 else self._last
        steps = np.abs(values - before)
        self._last, self._q, self._target = values[-1:], q[-1], target[-1]
        # Usual case: every column changes in every row, so that the ring buffer takes all changes.
        row, self._row = self._row % LEARNT, self._row + len(t)
        if steps.min() > 0.0 and self._goes_on_all:
            end = row + len(t)
            self._changes[row:end] = steps[: LEARNT - row]
            self._changes[: max(0, end - LEARNT)] = steps[LEARNT - row :]
            self._since[:], self._repeats[:] = t[-1], 0
            self._marks = dict.fromkeys(self.names, (q[-1], target[-1]))
            return
        changed, into = values != before, (row + np.arange(len(t))) % LEARNT
        # A constant column keeps its noise figures. A column that changes again may have
        # rested, and its noise is measured from the start.
        resumed = latest_row(changed & ~np.concatenate([self._goes_on[None], changed[:-1]]))
        self._changes[:, resumed >= 0] = 0.0
        known = changed & (np.arange(len(changed))[:, None] >= resumed)
        self._changes[into] = np.where(known, steps, self._changes[into])
        self._goes_on = changed[-1]
        self._goes_on_all = bool(self._goes_on.all())
        # Count equal rows since the latest change of each column, and note its time.
        latest = latest_row(changed)
        self._repeats = np.where(latest < 0, self._repeats, -1) + len(t) - np.maximum(latest, 0)
        went_on = latest >= 0
        self._since[went_on] = t[latest[went_on]]
        # A signal's mark is the arm's state at the latest change of any of its columns.
        for name, columns in self._columns.items():
            row = int(latest[columns].max())
            if row >= 0:
                self._marks[name] = q[row], target[row]


def frozen(signals: Constancy, t: float) -> Fault | None:
    """Find the first frozen signal: `encoders`, or a signal that forces cause."""
    if not signals.stands(t):
        return None
    found = frozen_encoders(signals, t)
    for name in signals.names:
        if name != ENCODERS:
            found = found or frozen_torques(name, signals, t)
    return found


def frozen_torques(name: str, signals: Constancy, t: float) -> Fault | None:
    """Test a signal that forces cause: it changes with the arm's posture, or by its noise."""
    since, lasted, moved = signals.since(name), signals.constant_since(name, t), signals.moved(name)
    # All columns are constant while the arm turns.
    if lasted.min() >= FROZEN and moved > MOVED:
        why = f"while a joint turned by {1e3 * moved:.1f} mrad"
        return frozen_fault(name, t, float(since.max()), why)
    # Some columns are constant although their noise changed every sample before.
    stands = lasted >= FROZEN
    if stands.any():
        stands &= signals.noisy(name)
    if not stands.any():
        return None
    columns = ", ".join(str(i + 1) for i in np.flatnonzero(stands))
    why = f"in column {columns}, whose noise let it never rest before"
    return frozen_fault(name, t, float(since[stands].min()), why)


def frozen_encoders(signals: Constancy, t: float) -> Fault | None:
    """Test the joint positions: they change when the commanded equilibrium moves, even against an obstacle."""
    since, led = signals.since(ENCODERS), signals.led(ENCODERS)
    if signals.constant_since(ENCODERS, t).min() < FROZEN or led < LED:
        return None
    why = f"while the arm was led on by {1e3 * led:.1f} mm"
    return frozen_fault(ENCODERS, t, float(since.max()), why)


def frozen_fault(name: str, t: float, since: float, why: str) -> Fault:
    """Describe a frozen signal."""
    return Fault(f"frozen {name}", f"the same to the last bit for {t - since:.2f} s {why}", since)


def latest_row(changed: Mask) -> NDArray[np.intp]:
    """Return the last row in which each column of `changed` (m, n) is True; -1 for none."""
    rows = np.arange(len(changed))[:, None]
    return np.where(changed, rows, -1).max(axis=0)
