"""The cell a run happens in: the embedded world, or a real robot.

The simulated world is hidden. Its truth is a separate question, `truth`, which the pipeline asks
only after the estimates are made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.errors import InputError, Unavailable
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Job

if TYPE_CHECKING:
    from palpate.robots.simulated.robot import MujocoRobot

SIZE_TOLERANCE = 0.02
"""m: how far an object's extents in scene and world may differ and still be the same object."""

SEEN_TOLERANCE = 0.06
"""m: the same for a scene made of what was seen in a picture, where a block is taken for a square
one."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedCell:
    """A world made of MJCF, with what is true in it.

    Attributes:
        world: the world as a scene, nothing missing but what does not matter.
        drawn: values that were drawn from priors, for a world made from D.
        description: for the report.
    """

    world: Scene
    drawn: Mapping[Parameter, tuple[float, ...]]
    description: str

    def robot(self, job: Job) -> MujocoRobot:
        """The embedded arm in this world."""
        from palpate.pictures.renderer import add_lights
        from palpate.robots.simulated.robot import MujocoRobot

        spec = self.world.spec(self.drawn)
        add_lights(spec)
        return MujocoRobot(
            spec, self.world.pose_world_base, self.world.arm, noise=job.noise, seed=job.seed
        )

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """What is true in the world, or None where it is not defined. Ask after estimating."""
        if parameter in self.drawn:
            return self.drawn[parameter]
        body = self.world.bodies.get(parameter.object)
        return body.known.get(parameter.quantity) if body else None


def simulated_cell(job: Job, scene: Scene) -> SimulatedCell:
    """The hidden world of a job.

    Raises:
        InputError: the world does not match the scene.
        Unavailable: the job names a real robot, which this build cannot reach.
    """
    if job.robot is not None:
        raise Unavailable(f"no driver for '{job.robot}': leave --robot out to use the embedded FR3")
    if job.world is None:
        from palpate.cells.draw import draw_truth

        drawn = draw_truth(scene, job.seed)
        return SimulatedCell(
            scene, drawn, "simulated from the scene, its unknowns drawn from priors"
        )
    world = load_scene(job.world, arm=scene.arm)
    _match(scene, world, SIZE_TOLERANCE if job.scene else SEEN_TOLERANCE)
    return SimulatedCell(world, {}, f"simulated world {job.world.name}")


def _match(scene: Scene, world: Scene, tolerance: float) -> None:
    """The world holds every object and surface of the scene, at about the same size."""
    absent = [name for name in scene.bodies if name not in world.bodies]
    if absent:
        raise InputError(
            f"scene and world do not match: the world has no {', '.join(absent)}; "
            f"it has {', '.join(world.bodies)}"
        )
    for name, body in scene.objects.items():
        _match_body(body, world.bodies[name], tolerance)


def _match_body(mine: Body, theirs: Body, tolerance: float) -> None:
    if mine.role != theirs.role:
        raise InputError(
            f"scene and world do not match: '{mine.name}' is an {mine.role} in the scene and a "
            f"{theirs.role} in the world"
        )
    if (abs(mine.size - theirs.size) > tolerance).any():
        raise InputError(
            f"scene and world do not match: '{mine.name}' measures {mine.size.round(3).tolist()} m in the "
            f"scene and {theirs.size.round(3).tolist()} m in the world"
        )
