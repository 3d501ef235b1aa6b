"""A point-mass arm that writes traces: the physics and the sensor errors the estimators must cope
with.

Written independently of the simulated robot: quintic motions, a spring between commanded and
measured pose, and a wrench of load + inertia + configuration-dependent bias + direction-dependent
friction + a residual drawn whenever the arm comes to rest + drift + white noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from palpate.common.pose import Array, Pose
from palpate.trace.recording import Activity, Context, Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace

DT = 0.01
STIFFNESS = 1200.0
APPARENT = 3.5
HAND = NominalHand(
    tip_offset=0.009,
    force_repeatability=0.15,
    torque_gain=0.01,
    pose_repeatability=1e-4,
)
DOWN = Pose.top_down((0.0, 0.0, 0.0), 0.3).quaternion


@dataclass(frozen=True)
class Noise:
    """Sensor errors, in N (moments 0.3 m times that): per-row white noise, bias, bias slope per m,
    friction, residual per rest, drift per square root second."""

    white: float = 0.0
    bias: float = 0.0
    slope: float = 0.0
    friction: float = 0.0
    stick: float = 0.0
    drift: float = 0.0


NOISES = {
    "none": Noise(),
    "lab": Noise(white=0.08, bias=0.3, slope=0.5, friction=0.12, drift=0.002),
    "datasheet": Noise(white=0.08, bias=0.3, slope=1.0, friction=0.15, stick=0.15, drift=0.003),
}

Ground = Callable[[Array, Array], Array]
"""Wrench (6,) that the surroundings take, from the tip's position and the velocity."""


def _nothing(_: Array) -> Array:
    return np.zeros(3)


@dataclass
class Bench:
    """Write a trace motion by motion."""

    noise: Noise = field(default_factory=Noise)
    seed: int = 0
    position: Array = field(default_factory=lambda: np.array([0.5, 0.0, 0.5]))

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        scale = np.array([1.0] * 3 + [0.3] * 3)
        self.scale = scale
        self.bias = self.rng.normal(0, 1, 6) * self.noise.bias * scale
        self.slope = self.rng.normal(0, 1, (6, 3)) * self.noise.slope * scale[:, None]
        self.friction = self.rng.normal(0, 1, (6, 3)) * self.noise.friction * scale[:, None]
        self.stick = np.zeros(6)
        self.drift = np.zeros(6)
        self.last_direction = np.zeros(3)
        self.resting = False
        self.t = 0.0
        self.load = np.zeros(6)
        self.payload = 0.0
        self.holding: str | None = None
        self.grasp: str | None = None
        self.at: str | None = None
        self.rows: list[tuple[float, Array, Array, Array, Array, float]] = []
        self.leaves: list[LeafRun] = []
        self.recordings: list[Recording] = []
        self.conversions: list[Conversion] = []
        self.width = 0.08
        self.contact: Array = np.zeros(6)
        self.floor = -1.0
        self.beside = (0.0, 0.0)

    def row(
        self, target: Array, position: Array, velocity: Array, acceleration: Array, extra: Array
    ) -> None:
        """One log row."""
        moving = np.linalg.norm(velocity) > 1e-4
        if moving:
            self.last_direction = velocity / np.linalg.norm(velocity)
            self.resting = False
            self.stick *= 0.8
        elif not self.resting:
            self.resting = True
            self.stick = self.rng.normal(0, 1, 6) * self.noise.stick * self.scale
        self.drift += self.rng.normal(0, 1, 6) * self.noise.drift * self.scale * np.sqrt(DT)
        inertial = np.concatenate([(APPARENT + self.payload) * acceleration, np.zeros(3)])
        inertial[3:] = self.load[3:] * acceleration[2] / 9.81
        wrench = (
            self.load
            + extra
            + inertial
            + self.bias
            + self.slope @ (position - 0.3)
            + self.friction @ self.last_direction
            + self.stick
            + self.drift
            + self.rng.normal(0, 1, 6) * self.noise.white * self.scale
        )
        self.rows.append((self.t, position, target, velocity, wrench, self.width))
        self.t += DT

    def sag(self, extra: Array) -> Array:
        return -(self.load[:3] + extra[:3]) / STIFFNESS

    def go(self, at: str, target: Sequence[float], speed: float = 0.15) -> None:
        """A quintic motion in free air, then 0.4 s of standing still."""
        start, goal = self.position.copy(), np.array(target, dtype=float)
        begin = self.t
        distance = float(np.linalg.norm(goal - start))
        duration = max(1.875 * distance / speed, 0.3)
        for s in np.arange(DT, duration, DT) / duration:
            p = 10 * s**3 - 15 * s**4 + 6 * s**5
            v = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration
            a = (60 * s - 180 * s**2 + 120 * s**3) / duration**2
            line = goal - start
            here = start + p * line
            extra = self.contact if self.holding and here[2] < self.floor + 0.003 else np.zeros(6)
            self.row(here, here + self.sag(extra), v * line, a * line, extra)
        self.position, self.at = goal, at
        self.dwell(0.4)
        self.leaf("MovePose", begin, "still")

    def dwell(self, duration: float, extra: Array | None = None) -> None:
        """Stand still."""
        if extra is None:
            extra = self.contact if self.position[2] <= self.floor else np.zeros(6)
        for _ in range(round(duration / DT)):
            self.row(
                self.position, self.position + self.sag(extra), np.zeros(3), np.zeros(3), extra
            )

    def close(self, name: str, mass: float, com: Sequence[float] = (0.0, 0.0)) -> None:
        """Grasp what stands on its support; `com` is its centre of mass from the TCP, world x-y,
        m."""
        begin, self.floor = self.t, float(self.position[2]) + 0.001
        self.contact = np.array(
            [0.0, 0.0, -mass * 9.81, -com[1] * mass * 9.81, com[0] * mass * 9.81, 0.0]
        )
        self.load, self.payload = -self.contact, mass
        self.holding, self.grasp, self.width = name, self.at, 0.05
        self.dwell(0.8)
        self.leaf("CloseGripper", begin, "contact")

    def open(self) -> None:
        """Let go of what stands on its support."""
        begin = self.t
        self.dwell(0.4)
        self.load, self.payload, self.contact = np.zeros(6), 0.0, np.zeros(6)
        self.holding, self.grasp, self.width = None, None, 0.08
        self.dwell(0.4)
        self.leaf("OpenGripper", begin, "still")

    def descend(
        self,
        press: Callable[[float], float],
        support: str,
        speed: float = 0.015,
        threshold: float = 8.0,
        beside: Sequence[float] = (0.0, 0.0),
    ) -> Recording:
        """A guarded descent on what pushes the tip back with `press(tip_z)` N, `beside` its middle
        (world x-y, m), a recorded pose, and the retreat."""
        self.beside = (float(beside[0]), float(beside[1]))
        begin, equilibrium = self.t, self.position.copy()
        height, z, force = equilibrium[2], equilibrium[2], 0.0
        path: list[float] = []
        while force < threshold:
            height -= speed * DT
            path.append(height)
            z, force = self.balance(height, press)
            self.pressed(equilibrium, height, z, force)
        for _ in range(40):
            self.pressed(equilibrium, height, z, force)
        self.leaf("MoveUntilContact", begin, "contact")
        measured = self.t
        for _ in range(30):
            self.pressed(equilibrium, height, z, force)
        recording = self.record(measured, "contact", support, POSE)
        for higher in np.arange(height, equilibrium[2], 0.05 * DT):
            z, force = self.balance(float(higher), press)
            self.pressed(equilibrium, float(higher), z, force)
        self.go(str(self.at), equilibrium.tolist())
        return recording

    def drag(
        self,
        at: str,
        goal: Sequence[float],
        static: float,
        dynamic: float | Callable[[Array], float],
        press: tuple[float, float],
        support: str = "table",
        speed: float = 0.02,
        pull: Callable[[Array], Array] = _nothing,
        attraction: float = 0.0,
    ) -> None:
        """Drag the grasped object along its support; `press` (m) is how deep the equilibrium is,
        first and last.

        It sticks until the arm's spring and damper exceed static times normal force, then slides
        against dynamic, which may depend on where it is (world, m). `pull` (N, world) is what else
        pulls on it there, `attraction` (N) what presses it on its support besides the hand.
        """
        start, end = self.position.copy(), np.array(goal, dtype=float)
        begin, distance = self.t, float(np.linalg.norm(end - start))
        way = (end - start) / distance
        rise, duration = 0.1, distance / speed + 0.1
        weight = self.payload * 9.81
        moving = APPARENT + self.payload
        damping = 2 * np.sqrt(STIFFNESS * moving)
        on, x, velocity, sliding = 0.0, 0.0, 0.0, False
        for time in np.arange(-0.5, duration + 0.4, DT):
            commanded = speed * np.clip(min(time, duration - time) / rise, 0.0, 1.0)
            before, on = on, on + commanded * DT
            depth = (press[0] + (press[1] - press[0]) * on / distance) * min(
                1.0, (time + 0.5) / 0.3
            )
            normal = STIFFNESS * depth + weight
            here = start + way * x
            mu = dynamic(here) if callable(dynamic) else dynamic
            pressed, aside = normal + attraction, float(pull(here) @ way)
            for part in np.arange(1, 11) / 10:
                push = STIFFNESS * (before + part * (on - before) - x) + damping * (
                    commanded - velocity
                )
                sliding = sliding or push + aside > static * pressed
                velocity = (
                    max(velocity + (push + aside - mu * pressed) / moving * DT / 10, 0.0)
                    if sliding
                    else 0.0
                )
                x += velocity * DT / 10
            force = np.concatenate([push * way, np.zeros(3)])
            force[2] = -normal
            target = start + way * on - np.array([0.0, 0.0, depth])
            self.row(target, start + way * x, way * velocity, np.zeros(3), force)
        self.position, self.at = end, at
        self.leaf("MovePose", begin, "contact")
        self.record(begin, "sliding", support)

    def balance(self, height: float, press: Callable[[float], float]) -> tuple[float, float]:
        """Where the arm's spring and the surface are in balance: TCP z and the pressing force."""
        low, high = height - 1e-6, height + 0.2
        for _ in range(50):
            z = (low + high) / 2
            low, high = (
                (z, high) if press(z - HAND.tip_offset) > STIFFNESS * (z - height) else (low, z)
            )
        return high, press(high - HAND.tip_offset)

    def pressed(self, column: Array, height: float, z: float, force: float) -> None:
        last = self.rows[-1][1][2]
        target, position = column.copy(), column.copy()
        target[2], position[2] = height, z
        self.row(
            target,
            position,
            np.array([0, 0, (z - last) / DT]),
            np.zeros(3),
            np.array([0, 0, -force, -self.beside[1] * force, self.beside[0] * force, 0]),
        )

    def measure(
        self,
        duration: float = 1.5,
        activity: Activity = "still",
        support: str | None = None,
        buffer: str = FORCES,
    ) -> Recording:
        """Log while standing still."""
        begin = self.t
        self.dwell(duration)
        return self.record(begin, activity, support, buffer)

    def record(
        self, begin: float, activity: Activity, support: str | None = None, buffer: str = FORCES
    ) -> Recording:
        """Mark what was written since `begin` as measured."""
        recording = Recording(buffer, begin, self.t, self.context(activity, support))
        self.recordings.append(recording)
        self.leaf("MeasureForces" if buffer == FORCES else "MeasureGripperPose", begin, activity)
        return recording

    def convert(self, primitive: str, object: str, quantity: str, recording: Recording) -> None:
        """Declare what a recording stands for."""
        self.conversions.append(Conversion(primitive, object, quantity, recording, self.t))

    def context(self, activity: Activity, support: str | None = None) -> Context:
        return Context(activity, self.at, self.holding, self.grasp, support)

    def leaf(self, primitive: str, begin: float, activity: Activity) -> None:
        self.leaves.append(
            LeafRun(
                f"tree.children[{len(self.leaves)}]",
                primitive,
                primitive,
                begin,
                self.t,
                "SUCCESS",
                context=self.context(activity),
            )
        )

    def trace(self, hand: NominalHand = HAND) -> Trace:
        """Everything so far."""
        t, position, target, velocity, wrench, width = (
            np.array(column) for column in zip(*self.rows, strict=True)
        )
        n = len(t)
        turn = np.tile(DOWN, (n, 1))
        samples = Samples(
            t,
            np.zeros((n, 7)),
            np.zeros((n, 7)),
            np.zeros((n, 7)),
            wrench,
            np.hstack([position, turn]),
            np.hstack([velocity, np.zeros((n, 3))]),
            np.hstack([target, turn]),
            width,
        )
        marks = (tuple(self.leaves), tuple(self.recordings), tuple(self.conversions))
        return Trace(samples, *marks, hand)


def weigh(mass: float, noise: Noise, seed: int = 0, com: Sequence[float] = (0.0, 0.0)) -> Trace:
    """The project's weighing plan: approach, grasp, lift, measure, put back, leave."""
    bench = Bench(noise, seed)
    above, grasp = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2)
    bench.go("bottle_pose + z_offset", above)
    bench.go("bottle_pose", grasp)
    bench.close("bottle", mass, com)
    bench.go("bottle_pose + z_offset", above)
    recording = bench.measure()
    bench.convert("Force2Mass", "bottle", "mass", recording)
    bench.go("bottle_pose", grasp)
    bench.open()
    bench.go("bottle_pose + z_offset", above)
    bench.go("home", (0.4, 0.0, 0.5), 0.25)
    return bench.trace()


@pytest.fixture
def noises() -> dict[str, Noise]:
    return NOISES


@pytest.fixture
def weighing() -> Callable[..., Trace]:
    return weigh


@pytest.fixture
def bench() -> type[Bench]:
    return Bench
