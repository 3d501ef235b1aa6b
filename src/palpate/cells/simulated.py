"""The embedded cell: a hidden world made of MJCF, with a simulated arm in it.

The world is hidden. Its truth is a separate question, `truth`, which the pipeline asks only after
the estimates are made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.cells.draw import draw_truth
from palpate.cells.view import closer_png, workspace_png
from palpate.errors import InputError
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.pictures.film import Footage
from palpate.pictures.renderer import gl_available
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.geometry.pose import Array
    from palpate.robots.description import RobotDescription
    from palpate.robots.simulated.robot import MujocoRobot
    from palpate.scene.poses import CameraEntry

SIZE_TOLERANCE = 0.02
"""m: how far an object's extents in scene and world may differ and still be the same object."""

BASE_TOLERANCE = 0.05
"""m: how far the arm may stand beside where the scene has it."""

TURNED = float(np.cos(np.radians(2.5)))
"""And how far it may be turned: 5°, as the cosine of half of it."""

DRAWN = "simulated from the scene, its unknowns drawn from priors"
"""Description of a cell whose truth nobody knows, for there is none."""

NEAR = 0.10
"""m: how far from where it was seen a thing may stand and still be the one that was seen."""


@dataclass(slots=True, eq=False)
class SimulatedCell:
    """A world made of MJCF, with what is true in it. Implements `palpate.cells.cell.Cell`.

    Attributes:
        world: the world as a scene, nothing missing but what does not matter.
        drawn: values that were drawn from priors, for a world made from D.
        description: for the report.
        noise: noise model of the robot, by name or file.
        seed: of everything random in it.
        scene: D, all that the robot's owner knows of the workplace; None: the world itself.
        visit: the same robot on another day, see `MujocoRobot`.
        names: what the world calls the scene's bodies, where that is not what the scene does.
    """

    world: Scene
    drawn: Mapping[Parameter, tuple[float, ...]] = field(
        default_factory=dict[Parameter, tuple[float, ...]]
    )
    description: str = "simulated world"
    noise: str = "lab"
    seed: int = 0
    scene: Scene | None = None
    visit: int = 0
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    _robot: MujocoRobot | None = field(default=None, init=False, repr=False)
    _spec: MjSpec | None = field(default=None, init=False, repr=False)

    @property
    def simulated(self) -> bool:
        """Always."""
        return True

    def picture(self, camera: CameraEntry | None = None) -> bytes | None:
        """See `Cell`. None without a usable OpenGL."""
        if not gl_available()[0]:
            return None
        return workspace_png(self.world.spec(self.drawn), camera)

    def closer(self) -> bytes | None:
        """See `Close`. None without a usable OpenGL."""
        if not gl_available()[0]:
            return None
        known = self.scene or self.world
        names: dict[str, Array] = {}
        for name, body in known.bodies.items():
            if body.carries:  # things stand where its name would
                continue
            x, y, _ = body.pose_world.apply(body.centre)
            names[name] = np.array([x, y, body.top_z()])
        return closer_png(self.world.spec(self.drawn), names)

    def robot(self) -> MujocoRobot:
        """A new arm in a new copy of the world; it knows of the world what the scene says."""
        from palpate.robots.simulated.robot import MujocoRobot

        spec = self.world.spec(self.drawn)
        known, down = self.scene or self.world, np.array([0.0, 0.0, -1.0])
        self._robot = MujocoRobot(
            spec,
            known.pose_world_base,
            known.arm,
            noise=self.noise,
            seed=self.seed,
            stands=self.world.pose_world_base,
            gravity=known.gravity * down,
            visit=self.visit,
        )
        self._spec = spec
        return self._robot

    def footage(self) -> Footage | None:
        """See `Cell`: the 30 Hz camera's configurations of the world."""
        if self._robot is None:
            return None
        world = self._robot.world
        return Footage(world.model, tuple(world.frames), self._spec)

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """Return the true value in the world, None where undefined. Call it after estimating only."""
        if parameter in self.drawn:
            return self.drawn[parameter]
        body = self.world.bodies.get(self.names.get(parameter.object, parameter.object))
        if body is None:
            return None
        quantity = self.world.catalogue.get(parameter.quantity)
        shown = quantity.shown(body) if quantity is not None else None
        if quantity is not None and quantity.stands_for is not None:
            return self.truth(Parameter(parameter.object, quantity.stands_for))
        stated = body.known.get(parameter.quantity, shown)
        if quantity is None or stated is None:
            return stated
        return quantity.acting(self.world.resolved.description.bodies[body.name], stated)


def simulated_cell(
    scene: Scene | None,
    world: Path | Scene | None = None,
    *,
    noise: str = "lab",
    seed: int = 0,
    tolerance: float = SIZE_TOLERANCE,
    seen: bool = False,
    arm: RobotDescription | None = None,
    root: Path | None = None,
    robot_body: Sequence[str] = (),
) -> SimulatedCell:
    """The hidden world for a scene: an MJCF file, or a scene made of one, or, without either, the
    scene itself with its unknowns drawn from priors.

    Without a scene the world is taken as it is, with `arm` in it, to be looked at. A scene that was
    `seen` in a picture has names and shapes of its own: its things are those that stand nearest in
    the world, and what is not there the arm will not find. `root` is the
    folder outside of which none of the world's files is read, `robot_body` as `load_scene` takes it.

    Raises:
        InputError: neither scene nor world; or the world does not match the scene within
            `tolerance` m.
    """
    if world is not None:
        arm, named = scene.arm if scene is not None else arm, world.name
        if isinstance(world, Path):
            world = load_scene(world, arm=arm, root=root, robot_body=robot_body)
        names: dict[str, str] = {}
        if scene is not None and seen:
            _match_bases(scene, world)
            names = _names_by_place(scene, world)
        elif scene is not None:
            _match(scene, world, tolerance)
        made_of = f"simulated world {named}"
        return SimulatedCell(world, {}, made_of, noise, seed, scene, names=names)
    if scene is None:
        raise InputError("a simulated cell needs a scene or a world to be made of")
    drawn = draw_truth(scene, seed)
    return SimulatedCell(scene, drawn, DRAWN, noise, seed)


def _match(scene: Scene, world: Scene, tolerance: float) -> None:
    """The world holds every object and surface of the scene, at about the same size."""
    absent = [name for name in scene.bodies if name not in world.bodies]
    if absent:
        raise InputError(
            f"scene and world do not match: the world has no {', '.join(absent)}; "
            f"it has {', '.join(world.bodies)}"
        )
    _match_bases(scene, world)
    for name, body in scene.objects.items():
        _match_body(body, world.bodies[name], tolerance)


def _names_by_place(scene: Scene, world: Scene) -> dict[str, str]:
    """Map each body of the scene to its name in the world. Objects are paired by horizontal distance,
    nearest pair first; a surface takes the highest one below its middle. "" without a partner."""
    pairs = [
        (_apart(mine, theirs), mine.name, theirs.name)
        for mine in scene.objects.values()
        for theirs in world.objects.values()
    ]
    names = dict.fromkeys(scene.bodies, "")
    for distance, mine, theirs in sorted(pairs):
        if distance < NEAR and not names[mine] and theirs not in names.values():
            names[mine] = theirs
    for name, body in scene.bodies.items():
        below = [each for each in world.bodies.values() if _is_under(each, body)]
        if body.role == "surface" and below:
            names[name] = max(below, key=lambda each: each.top_z()).name
    return names


def _apart(one: Body, other: Body) -> float:
    """m between the middles of two bodies, seen from above."""
    middles = [body.pose_world.apply(body.centre)[:2] for body in (one, other)]
    return float(np.linalg.norm(middles[0] - middles[1]))


def _is_under(surface: Body, seen: Body) -> bool:
    """Test if the middle of the scene's body `seen` lies within the world's `surface`, from above."""
    middle = seen.pose_world.apply(seen.centre)[:2]
    mine = surface.pose_world.apply(surface.centre)[:2]
    return surface.role == "surface" and bool((abs(middle - mine) < surface.size[:2] / 2).all())


def _match_bases(scene: Scene, world: Scene) -> None:
    """The arm stands about where it is thought to stand; how far off it is, is the world's secret."""
    mine, theirs = scene.pose_world_base, world.pose_world_base
    turned = abs(float(mine.quaternion @ theirs.quaternion))
    if mine.distance_to(theirs) > BASE_TOLERANCE or turned < TURNED:
        raise InputError(
            f"scene and world do not match: the arm stands at {mine.position.round(3).tolist()} in "
            f"the scene and at {theirs.position.round(3).tolist()} in the world; give both the same "
            "site 'robot_base'"
        )


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
