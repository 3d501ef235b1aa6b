"""Tasks with the twin: push, topple, throw; open a drawer or a door."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Generic, Literal, TypeVar

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.quantities.fixture_range import Range
from palpate.runs.trial import FINEST, LONGEST, REST, PhysicsTrial, Values, set_aside
from palpate.scene.scene import Scene

WAYS = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
"""Directions in which a task is tried, world axes; the first one that can be planned is taken."""
BISECTIONS = 11
"""Steps of the search for an action: to 5e-4 of it."""
STRONGEST = 100.0
"""Largest force that is tried, as a multiple of the object's weight."""
LOW = 0.1
"""Share of an object's height at which it is pushed."""
UPRIGHT = float(np.radians(20))
"""rad: an object that has turned by more did not slide to where it is."""
GRIP = 10.0
"""Friction coefficient of a foot that is held."""
NEAR = 0.02
"""Share of a goal within which a planned force has to end in its own world."""

Unit = Literal["m", "N"]
World = TypeVar("World")


@dataclass(frozen=True)
class Task(ABC, Generic[World]):
    """Something to do in a world, by one number that is planned: the action.

    Attributes:
        way: (3,) unit vector along which it is done, world axes.
        name: as in tables.
        says: what is done, in words.
        unit: unit of what is reached.
        goal: what shall be reached.
        ways: (n, 3) directions in which it is tried.
    """

    way: Array
    name: ClassVar[str]
    says: ClassVar[str]
    unit: ClassVar[Unit]
    goal: ClassVar[float]
    ways: ClassVar[Array] = WAYS

    def plan(self, world: World) -> float | None:
        """Action that ends at the goal in a world; None if the object tips over on the way to it, or cannot
        be moved."""
        action = smallest(
            lambda action: self.reached(world, action) >= self.goal, *self.tried(world)
        )
        if action is None or abs(self.reached(world, action) - self.goal) > NEAR * self.goal:
            return None
        return action

    @abstractmethod
    def tried(self, world: World) -> tuple[float, float]:
        """First and largest action that a plan tries in a world."""

    @abstractmethod
    def reached(self, world: World, action: float) -> float:
        """Result of an action in a world, in `unit`; not finite where the task fails otherwise."""


class OfObject(Task[PhysicsTrial]):
    """Base of what is done with an object, by a force unless it says otherwise."""

    def tried(self, world: PhysicsTrial) -> tuple[float, float]:
        """Forces by its weight, N."""
        return 0.1 * world.weight, STRONGEST * world.weight


class Slide(OfObject):
    """Slide to a mark after a push; the action is its force, N. Mass and friction decide where it stops."""

    name = "push to a mark"
    says = "a push of 0.2 s near its foot shall slide it 100 mm"
    unit = "m"
    goal = 0.1

    def reached(self, world: PhysicsTrial, action: float) -> float:
        """Distance along the way; infinite for an object that tips over or falls off."""
        done = world.run(
            lambda data: action * self.way * (data.time < 0.2),
            world.at(LOW),
            lambda data: data.time > 0.2 and world.is_at_rest(data),
        )
        return slid(world, done, self.way)


class SpringPush(OfObject):
    """Push to a mark through a damped spring, as a compliant arm does; the action is how far the arm goes, m.
    The object stays behind by the friction force over the stiffness."""

    name = "push to a mark"
    says = "an arm that gives way by 1 mm for each 0.2 N shall push it 100 mm, near its foot"
    unit = "m"
    goal = 0.1
    stiffness = 200.0
    damping = 28.0
    speed = 0.1

    def tried(self, world: PhysicsTrial) -> tuple[float, float]:
        """Distances of the arm, m."""
        del world
        return self.goal / 2, 4 * self.goal

    def reached(self, world: PhysicsTrial, action: float) -> float:
        """Distance along the way; infinite for an object that tips over or falls off."""

        def force(data: mujoco.MjData) -> Array:
            arm = min(self.speed * data.time, action)
            stretch = self.stiffness * (arm - float(world.moved(data) @ self.way))
            pace = self.speed * (arm < action) - float(world.velocity(data) @ self.way)
            return max(stretch + self.damping * pace, 0.0) * self.way

        arrival = action / self.speed + 0.1
        done = world.run(
            force, world.at(LOW), lambda data: data.time > arrival and world.is_at_rest(data)
        )
        return slid(world, done, self.way)


class Topple(OfObject):
    """Tip over the edge of the foot; the action is the force at the top, N. Mass and centre of mass decide."""

    name = "topple"
    says = "the smallest force at its top that tips it, its foot held"
    unit = "N"
    goal = 0.0

    def plan(self, world: PhysicsTrial) -> float | None:
        """The threshold of a world."""
        with foot_held(world):
            return smallest(partial(self._tips, world), 0.1 * world.weight, 5 * world.weight)

    def reached(self, world: PhysicsTrial, action: float) -> float:
        """Force in excess of the threshold of a world, N."""
        threshold = self.plan(world)
        return np.inf if threshold is None else action - threshold

    def _tips(self, world: PhysicsTrial, force: float) -> bool:
        """The force, which grows to its full strength in 0.2 s, turns the object by 5°."""
        done = world.run(
            lambda data: force * self.way * min(data.time / 0.2, 1.0),
            world.at(1.0),
            lambda data: data.time > 1.0 or world.tilt(data) > np.radians(5),
        )
        return world.tilt(done) > np.radians(5)


class Throw(OfObject):
    """Throw to a mark on the floor; the action is the force, N. Mass and the height of its support decide."""

    name = "throw to a mark"
    says = "a force of 50 ms upwards at 45° shall throw it 500 mm, through free air to the floor"
    unit = "m"
    goal = 0.5

    def reached(self, world: PhysicsTrial, action: float) -> float:
        """Distance of its centre of mass along the way, at z = 0 or where its foot was below that."""
        floor = min(0.0, float(world.low[2]))
        upwards = np.array([0.0, 0.0, 1.0])
        places: list[tuple[float, float]] = []

        def is_on_ground(data: mujoco.MjData) -> bool:
            places.append((float(data.xipos[world.body][2]), float(world.moved(data) @ self.way)))
            return data.time > 0.05 and places[-1][0] < floor

        def force(data: mujoco.MjData) -> Array:
            return action * (self.way + upwards) / np.sqrt(2) * (data.time < 0.05)

        world.run(force, world.at(0.5), is_on_ground, touching=False)
        # It passes the floor between two physics steps.
        (below, there), (above, here) = places[-1], places[-2]
        return float(np.interp(floor, (below, above), (there, here)))


Tasks = Sequence[Sequence[type[Task[World]]]]
"""Tasks of a kind of world, each with what is done where it cannot be."""
TASKS: Tasks[PhysicsTrial] = ((Slide, SpringPush), (Topple,), (Throw,))
"""Of an object: tall things tip over when friction stops them."""


def slid(world: PhysicsTrial, done: mujoco.MjData, way: Array) -> float:
    """Distance along a way, m; infinite for an object that tipped over or fell."""
    moved = world.moved(done)
    stands = world.tilt(done) < UPRIGHT and abs(moved[2]) < 0.01
    return float(moved @ way) if stands else np.inf


def smallest(suffices: Callable[[float], bool], first: float, most: float) -> float | None:
    """Smallest action that suffices, by doubling from `first` and bisection; None if `most` does not."""
    low, high = 0.0, first
    while not suffices(high):
        low, high = high, 2 * high
        if high > most:
            return None
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high


@contextmanager
def foot_held(world: PhysicsTrial) -> Generator[None]:
    """Let the object not slide: a friction that no force at its top exceeds. Pyramidal cones let a
    foot with such a friction creep, elliptic ones do not."""
    model, cone = world.model, world.model.opt.cone
    mine = np.flatnonzero(model.body_rootid[model.geom_bodyid] == world.body)
    saved = {name: getattr(model, name)[mine].copy() for name in ("geom_friction", "geom_priority")}
    model.geom_friction[mine, 0] = GRIP
    model.geom_priority[mine] = model.geom_priority.max() + 1
    model.opt.cone = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    try:
        yield
    finally:
        model.opt.cone = cone
        for name, values in saved.items():
            getattr(model, name)[mine] = values


# Two things to do with a drawer or a door: let it coast to an opening, open it steadily.


FIRST, MOST = 0.1, 1000.0
"""N: first and largest force at a handle that a plan tries."""
PUSHED = 0.2
"""s of a push."""


@dataclass(frozen=True, slots=True, eq=False)
class JointTrial:
    """A compiled world with a fixture where the scene has it.

    Attributes:
        model: MuJoCo's model.
        qpos: index of the joint's position; dof: of its rate.
        lever: m at the handle per unit of the joint's, towards the farther limit.
    """

    model: mujoco.MjModel
    qpos: int
    dof: int
    lever: float

    def run(
        self, force: Callable[[float], float], until: Callable[[float, float, float], bool]
    ) -> tuple[float, float]:
        """Apply a force at the handle, N by time, until a condition of time, s, way, m, and speed, m/s, of the handle
        holds, or for `LONGEST`; return way and speed then."""
        model, data = self.model, mujoco.MjData(self.model)
        start = float(data.qpos[self.qpos])
        while True:
            way = self.lever * (float(data.qpos[self.qpos]) - start)
            speed = self.lever * float(data.qvel[self.dof])
            if data.time > LONGEST or until(data.time, way, speed):
                return way, speed
            data.qfrc_applied[self.dof] = force(data.time) * self.lever
            mujoco.mj_step(model, data)


class JointTask(Task[JointTrial]):
    """Base of what is done with a joint: by a force at its handle, N."""

    ways: ClassVar[Array] = WAYS[:1]  # along the joint, whichever way that is

    def tried(self, world: JointTrial) -> tuple[float, float]:
        """Forces, N, whatever the world."""
        del world
        return FIRST, MOST


class Coast(JointTask):
    """Coast to an opening after a push; the action is its force, N. Friction, damping and mass decide."""

    name = "coast to an opening"
    says = "a push of 0.2 s at its handle shall let it coast 100 mm"
    unit = "m"
    goal = 0.1

    def reached(self, world: JointTrial, action: float) -> float:
        """Way of the handle to where it comes to rest, or turns round."""
        way, _ = world.run(
            lambda time: action * (time < PUSHED),
            lambda time, _, speed: time > PUSHED and speed < REST,
        )
        return way


class Steady(JointTask):
    """Open at a speed; the action is the force, N. Friction and damping decide."""

    name = "open steadily"
    says = "the smallest force at its handle with which this passes 100 mm at 0.1 m/s"
    unit = "N"
    goal = 0.0
    distance: ClassVar = 0.1
    speed: ClassVar = 0.1

    def plan(self, world: JointTrial) -> float | None:
        """The threshold of a world."""
        return smallest(lambda force: self._passes(world, force), *self.tried(world))

    def reached(self, world: JointTrial, action: float) -> float:
        """Force in excess of the threshold of a world, N."""
        threshold = self.plan(world)
        return np.inf if threshold is None else action - threshold

    def _passes(self, world: JointTrial, force: float) -> bool:
        way, speed = world.run(lambda _: force, lambda _, way, __: way > self.distance)
        return way > self.distance and speed > self.speed


JOINT_TASKS: Tasks[JointTrial] = ((Coast,), (Steady,))


def joint_trial_of(scene: Scene, name: str, values: Values) -> JointTrial:
    """The world of a scene with these values, of which the fixture `name` alone is moved.

    Raises:
        InputError: the values make no world, as a friction below zero.
    """
    for parameter, value in values.items():
        if parameter.object == name and parameter.quantity != Range.id and min(value) < 0.0:
            raise InputError(f"no joint has a {parameter.quantity} of {value}")
    spec = scene.spec(values)
    for other in scene.objects:
        set_aside(spec.body(other))
    model = spec.compile()
    model.opt.timestep = max(model.opt.timestep, FINEST)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    joint, number = scene.body(name).joint, int(model.body(name).jntadr[0])
    assert joint is not None
    handle = scene.symbols.resolve(f"{name}_pose").position
    sign = 1.0 if joint.room(1.0) >= joint.room(-1.0) else -1.0
    return JointTrial(
        model,
        int(model.jnt_qposadr[number]),
        int(model.jnt_dofadr[number]),
        sign * joint.lever(handle),
    )
