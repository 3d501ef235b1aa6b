"""Two things to do with a drawer or a door: let it coast to an opening, open it steadily.

What is done acts at the handle, along the joint. Objects float where they are, and nothing touches: a trial tells of
the joint alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array
from palpate.quantities.fixture.range import Range
from palpate.scene.scene import Scene
from palpate.twin.tasks.tasks import WAYS, Task, Tasks, smallest
from palpate.twin.tasks.trial import FINEST, LONGEST, REST, Values, set_aside

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


class OfJoint(Task[JointTrial]):
    """Base of what is done with a joint: by a force at its handle, N."""

    ways: ClassVar[Array] = WAYS[:1]  # along the joint, whichever way that is

    def tried(self, world: JointTrial) -> tuple[float, float]:
        """Forces, N, whatever the world."""
        del world
        return FIRST, MOST


class Coast(OfJoint):
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


class Steady(OfJoint):
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
