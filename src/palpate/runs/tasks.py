"""Tasks with the twin: push, topple and throw an object; open a drawer or a door."""

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
from palpate.runs.trial import FINEST, LONGEST, REST, PhysicsTrial, Values, disable_body
from palpate.scene.scene import Scene

# Directions in which a task is tried, world axes. The first possible one is taken.
DIRECTIONS = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
BISECTIONS = 11  # Bisection steps in the search for an action: they determine it to 5e-4
LARGEST_FORCE = 100.0  # Largest force that is tried, as a multiple of the object's weight
LOW = 0.1  # Height of a push, as a share of the object's height
# rad: largest tilt of an object that has slid. With more it has tipped over.
UPRIGHT = float(np.radians(20))
GRIP = 10.0  # Friction coefficient that holds a foot in place
# Largest distance from the goal of a planned force in its own world, as a share of the goal.
NEAR = 0.02

Unit = Literal["m", "N"]
World = TypeVar("World")


@dataclass(frozen=True)
class Task(ABC, Generic[World]):
    """Task in a world, with one planned number: the action."""

    direction: Array  # (3,) unit vector of its direction, world axes
    name: ClassVar[str]  # as in tables
    says: ClassVar[str]  # description
    unit: ClassVar[Unit]  # unit of the result
    goal: ClassVar[float]  # result to reach
    ways: ClassVar[Array] = DIRECTIONS  # (n, 3) directions in which it is tried

    def plan(self, world: World) -> float | None:
        """Plan the action that ends at the goal in a world; None if the object tips over before, or
        cannot be moved.
        """
        # Find the threshold action, and require that it ends near the goal: the result may jump
        # over it.
        action = find_smallest_action(
            lambda action: self.outcome(world, action) >= self.goal, *self.action_range(world)
        )
        if action is None or abs(self.outcome(world, action) - self.goal) > NEAR * self.goal:
            return None
        return action

    @abstractmethod
    def action_range(self, world: World) -> tuple[float, float]:
        """First and largest action that a plan tries in a world."""

    @abstractmethod
    def outcome(self, world: World, action: float) -> float:
        """Result of an action in a world, in `unit`; not finite if the task fails in another way."""


class ThresholdTask(Task[World]):
    """Base of tasks whose plan is the smallest force that suffices."""

    unit = "N"
    goal = 0.0

    def outcome(self, world: World, action: float) -> float:
        """Force in excess of the threshold of a world, N."""
        threshold = self.plan(world)
        return np.inf if threshold is None else action - threshold


class OfObject(Task[PhysicsTrial]):
    """Base of tasks with an object. The action is a force, unless stated otherwise."""

    def action_range(self, world: PhysicsTrial) -> tuple[float, float]:
        """Forces in proportion to the object's weight, N."""
        return 0.1 * world.weight, LARGEST_FORCE * world.weight


class Slide(OfObject):
    """Slide to a mark after a push. The action is the force, N. Mass and friction determine where it stops."""

    name = "push to a mark"
    says = "a push of 0.2 s near its foot shall slide it 100 mm"
    unit = "m"
    goal = 0.1

    def outcome(self, world: PhysicsTrial, action: float) -> float:
        """Distance in the direction of the push; infinite for an object that tips over or falls off."""
        done = world.run(
            lambda data: action * self.direction * (data.time < 0.2),
            world.at(LOW),
            lambda data: data.time > 0.2 and world.is_at_rest(data),
        )
        return slide_distance(world, done, self.direction)


class SpringPush(OfObject):
    """Push to a mark through a damped spring, as a compliant arm does.

    The action is the travel of the arm, m. The object lags behind by the friction force over the
    stiffness.
    """

    name = "push to a mark"
    says = "an arm that gives way by 1 mm for each 0.2 N shall push it 100 mm, near its foot"
    unit = "m"
    goal = 0.1
    stiffness = 200.0
    damping = 28.0
    speed = 0.1

    def action_range(self, world: PhysicsTrial) -> tuple[float, float]:
        """Distances of the arm, m."""
        del world
        return self.goal / 2, 4 * self.goal

    def outcome(self, world: PhysicsTrial, action: float) -> float:
        """Distance in the direction of the push; infinite for an object that tips over or falls off."""

        def force(data: mujoco.MjData) -> Array:
            # Force of spring and damper between arm and object; it only pushes.
            arm = min(self.speed * data.time, action)
            stretch = self.stiffness * (arm - float(world.displacement(data) @ self.direction))
            pace = self.speed * (arm < action) - float(world.velocity(data) @ self.direction)
            return max(stretch + self.damping * pace, 0.0) * self.direction

        # Stop when the arm has arrived and the object is at rest.
        arrival = action / self.speed + 0.1
        done = world.run(
            force, world.at(LOW), lambda data: data.time > arrival and world.is_at_rest(data)
        )
        return slide_distance(world, done, self.direction)


class Topple(ThresholdTask[PhysicsTrial], OfObject):
    """Tip the object over the edge of its foot. The action is the force at the top, N. It depends
    on mass and centre of mass.
    """

    name = "topple"
    says = "the smallest force at its top that tips it, its foot held"

    def plan(self, world: PhysicsTrial) -> float | None:
        """Threshold force of a world, N."""
        with hold_foot(world):
            return find_smallest_action(
                partial(self._tips, world), 0.1 * world.weight, 5 * world.weight
            )

    def _tips(self, world: PhysicsTrial, force: float) -> bool:
        """True if the force turns the object by 5°. The force grows to its full value in 0.2 s."""
        done = world.run(
            lambda data: force * self.direction * min(data.time / 0.2, 1.0),
            world.at(1.0),
            lambda data: data.time > 1.0 or world.tilt(data) > np.radians(5),
        )
        return world.tilt(done) > np.radians(5)


class Throw(OfObject):
    """Throw to a mark on the floor. The action is the force, N. The result depends on mass and on
    the height of the support.
    """

    name = "throw to a mark"
    says = "a force of 50 ms upwards at 45° shall throw it 500 mm, through free air to the floor"
    unit = "m"
    goal = 0.5

    def outcome(self, world: PhysicsTrial, action: float) -> float:
        """Distance of the centre of mass, m, where it passes the floor: z = 0, or the object's
        lowest point if that is lower.
        """
        # The floor is at z = 0, or at the object's foot if that is lower.
        floor = min(0.0, float(world.low[2]))
        upwards = np.array([0.0, 0.0, 1.0])
        places: list[tuple[float, float]] = []

        def is_on_ground(data: mujoco.MjData) -> bool:
            places.append(
                (float(data.xipos[world.body][2]), float(world.displacement(data) @ self.direction))
            )
            return data.time > 0.05 and places[-1][0] < floor

        def force(data: mujoco.MjData) -> Array:
            return action * (self.direction + upwards) / np.sqrt(2) * (data.time < 0.05)

        # Fly without contacts, pushed at the middle.
        world.run(force, world.at(0.5), is_on_ground, touching=False)
        # Interpolate between the two physics steps at which it passes the floor.
        (below, before), (above, after) = places[-1], places[-2]
        return float(np.interp(floor, (below, above), (before, after)))


# Tasks of a kind of world. Each is followed by tasks that replace it where it is not possible.
Tasks = Sequence[Sequence[type[Task[World]]]]
# Tasks with an object. Slender objects tip over when friction stops them: for these, `SpringPush`
# replaces `Slide`.
TASKS: Tasks[PhysicsTrial] = ((Slide, SpringPush), (Topple,), (Throw,))


def slide_distance(world: PhysicsTrial, done: mujoco.MjData, direction: Array) -> float:
    """Distance along `direction`, m; infinite for an object that tipped over or fell."""
    # An upright object at its former height has slid.
    displacement = world.displacement(done)
    stands = world.tilt(done) < UPRIGHT and abs(displacement[2]) < 0.01
    return float(displacement @ direction) if stands else np.inf


def find_smallest_action(
    suffices: Callable[[float], bool], first: float, most: float
) -> float | None:
    """Find the smallest action that suffices, by doubling from `first` and bisection; None if `most` is too small."""
    # Bracket the threshold by doubling.
    low, high = 0.0, first
    while not suffices(high):
        low, high = high, 2 * high
        if high > most:
            return None
    # Bisect the bracket.
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high


@contextmanager
def hold_foot(world: PhysicsTrial) -> Generator[None]:
    """Hold the foot of the object in place by a friction that no force at its top exceeds.

    The contact cones are elliptic meanwhile: with pyramidal ones a foot with such a friction
    creeps.
    """
    # Change friction, priority and cone of the object's geoms, and restore them afterwards.
    model, cone = world.model, world.model.opt.cone
    feet = np.flatnonzero(model.body_rootid[model.geom_bodyid] == world.body)
    saved = {name: getattr(model, name)[feet].copy() for name in ("geom_friction", "geom_priority")}
    model.geom_friction[feet, 0] = GRIP
    model.geom_priority[feet] = model.geom_priority.max() + 1
    model.opt.cone = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    try:
        yield
    finally:
        model.opt.cone = cone
        for name, values in saved.items():
            getattr(model, name)[feet] = values


# Tasks with a drawer or a door: coast to an opening, open steadily.

FIRST, MOST = 0.1, 1000.0  # N: first and largest force at a handle that a plan tries
PUSHED = 0.2  # s: duration of a push


@dataclass(frozen=True, slots=True, eq=False)
class JointTrial:
    """A compiled world with a fixture at its pose in the scene."""

    model: mujoco.MjModel  # MuJoCo's model
    qpos: int  # index of the joint's position
    dof: int  # index of its rate
    lever: float  # m at the handle per unit of the joint, towards the farther limit

    def run(
        self, force: Callable[[float], float], until: Callable[[float, float, float], bool]
    ) -> tuple[float, float]:
        """Apply a force, N by time, at the handle until a condition holds, or for `LONGEST`.

        The condition depends on time, s, travel, m, and speed, m/s, of the handle. Return travel and speed at the end.
        """
        model, data = self.model, mujoco.MjData(self.model)
        start = float(data.qpos[self.qpos])
        while True:
            # Handle coordinates: the joint's position and rate times the lever.
            travel = self.lever * (float(data.qpos[self.qpos]) - start)
            speed = self.lever * float(data.qvel[self.dof])
            if data.time > LONGEST or until(data.time, travel, speed):
                return travel, speed
            data.qfrc_applied[self.dof] = force(data.time) * self.lever
            mujoco.mj_step(model, data)


class JointTask(Task[JointTrial]):
    """Base of tasks with a joint. The action is a force at its handle, N."""

    ways: ClassVar[Array] = DIRECTIONS[:1]  # along the joint, in its own direction

    def action_range(self, world: JointTrial) -> tuple[float, float]:
        """The same range of forces in every world, N."""
        del world
        return FIRST, MOST


class Coast(JointTask):
    """Coast to an opening after a push. The action is the force, N. The result depends on friction,
    damping and mass.
    """

    name = "coast to an opening"
    says = "a push of 0.2 s at its handle shall let it coast 100 mm"
    unit = "m"
    goal = 0.1

    def outcome(self, world: JointTrial, action: float) -> float:
        """Travel of the handle to the point where it stops or reverses."""
        travel, _ = world.run(
            lambda time: action * (time < PUSHED),
            lambda time, _, speed: time > PUSHED and speed < REST,
        )
        return travel


class Steady(ThresholdTask[JointTrial], JointTask):
    """Open at a speed. The action is the force, N. The result depends on friction and damping."""

    name = "open steadily"
    says = "the smallest force at its handle with which this passes 100 mm at 0.1 m/s"
    distance: ClassVar = 0.1
    speed: ClassVar = 0.1

    def plan(self, world: JointTrial) -> float | None:
        """Threshold force of a world, N."""
        return find_smallest_action(
            lambda force: self._passes(world, force), *self.action_range(world)
        )

    def _passes(self, world: JointTrial, force: float) -> bool:
        # A constant force, until the handle has passed the distance.
        travel, speed = world.run(lambda _: force, lambda _, travel, __: travel > self.distance)
        return travel > self.distance and speed > self.speed


JOINT_TASKS: Tasks[JointTrial] = ((Coast,), (Steady,))


def joint_trial_of(scene: Scene, name: str, values: Values) -> JointTrial:
    """Build the world of a scene with these values, in which only the fixture `name` moves.
    Raises InputError: the values make no world, as a friction below zero."""
    # Friction, damping and stiffness must not be negative.
    for parameter, value in values.items():
        if parameter.object == name and parameter.quantity != Range.id and min(value) < 0.0:
            raise InputError(f"no joint has a {parameter.quantity} of {value}")
    # Free objects have no weight and no contacts, and the fixture moves without contacts as well.
    spec = scene.spec(values)
    for other in scene.objects:
        disable_body(spec.body(other))
    model = spec.compile()
    model.opt.timestep = max(model.opt.timestep, FINEST)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    # The force acts towards the limit with more room.
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
