"""The embedded cell: a hidden world from MJCF, with a simulated arm in it.

Only `SimulatedCell.truth` reads the truth of the world. The pipeline calls it after the estimates are
made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.mjcf.body import Body, BodyDescription
from palpate.perception.annotate import closer_png
from palpate.perception.film import Footage
from palpate.perception.renderer import extent, gl_available
from palpate.perception.stage import render_workspace
from palpate.robots.noise_levels import DEFAULT_LEVEL
from palpate.scene.load import NO_QUANTITIES, as_world, load_scene
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.common.pose import Array
    from palpate.robots.description import RobotDescription
    from palpate.robots.simulated.robot import MujocoRobot
    from palpate.scene.poses import CameraEntry


SIZE_TOLERANCE = 0.02  # Largest difference of an object's extents in scene and world, m
# Largest distance of the arm's base in the world from its place in the scene, m.
BASE_TOLERANCE = 0.05
# Least dot product of the base's quaternions in world and scene, cos(5°/2): a rotation of 5°.
TURNED = float(np.cos(np.radians(2.5)))
# m, least depth of a shape of the world in the arm: less is the accuracy of shapes.
OVERLAPS = 0.002
NEAR = 0.10  # Largest horizontal distance of an object in the world from its place in a picture, m
# Description of a cell whose truth is drawn from priors.
DRAWN = "simulated from the scene, its unknowns drawn from priors"


@dataclass(slots=True, eq=False)
class SimulatedCell:
    """A world from MJCF, and its true values. Implements `palpate.execution.cell.Cell`."""

    world: Scene  # the world as a scene: a separate world (`palpate.scene.load.as_world`), or D
    # Values drawn from priors, for a world made from D.
    drawn: Mapping[Parameter, tuple[float, ...]] = field(
        default_factory=dict[Parameter, tuple[float, ...]]
    )
    description: str = "simulated world"  # for the report
    noise: str = DEFAULT_LEVEL  # noise model of the robot, by name or file
    seed: int = 0  # seed of all random numbers in it
    # D, the owner's knowledge of the workplace; None for the world itself.
    scene: Scene | None = None
    visit: int = 0  # the same robot on another day, see `MujocoRobot`
    # The world's names of the scene's bodies, where they differ.
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    _robot: MujocoRobot | None = field(default=None, init=False, repr=False)
    _spec: MjSpec | None = field(default=None, init=False, repr=False)
    _compiled: Mapping[str, BodyDescription] | None = field(default=None, init=False, repr=False)

    @property
    def simulated(self) -> bool:
        """True."""
        return True

    def picture(self, camera: CameraEntry | None = None) -> bytes | None:
        """See `Cell`. None without a usable OpenGL."""
        if not gl_available()[0]:
            return None
        return render_workspace(self.world.spec(self.drawn), camera, self._anchors())

    def closer(self) -> bytes | None:
        """See `Close`. None without a usable OpenGL."""
        if not gl_available()[0]:
            return None
        return closer_png(self.world.spec(self.drawn), self._anchors())

    def _anchors(self) -> dict[str, Array]:
        """Points (3,), m, of the names in pictures.

        A name is at the middle of a body's top, or at a free spot if the body carries others. Drawers
        and doors, which no plan touches, have names as well.
        """
        known = self.scene or self.world
        found: dict[str, Array] = {}
        for name, body in known.bodies.items():
            # Above the middle of the top, or at the approach pose of a body that carries others.
            x, y, _ = body.pose_world.apply(body.centre)
            if body.carries:
                free = known.symbols.poses.get(f"{name}_approach")
                if free is None:
                    continue
                x, y, _ = free.position
            found[name] = np.array([x, y, body.top_z()])
        # Bodies without a role: above the middle of their extent.
        roles, shapes = known.resolved.description.roles, known.resolved.shapes
        for element in roles.ignored:
            name = roles.compiled_name(element, element.get("name", ""))
            if name:
                points = extent(shapes.model, shapes.data, [name])
                found[name] = np.array([*points.mean(axis=0)[:2], points[:, 2].max()])
        return found

    def robot(self) -> MujocoRobot:
        """A new arm in a new copy of the world; base, arm and gravity are believed as in the scene."""
        from palpate.robots.simulated.robot import MujocoRobot

        self._spec = self.world.spec(self.drawn)
        known = self.scene or self.world
        self._robot = MujocoRobot(
            self._spec,
            known.pose_world_base,
            known.arm,
            noise=self.noise,
            seed=self.seed,
            stands=self.world.pose_world_base,
            gravity=known.gravity * np.array([0.0, 0.0, -1.0]),
            visit=self.visit,
        )
        name, depth = self._robot.world.deepest_overlap()
        if depth > OVERLAPS:
            raise InputError(
                f"{self.description}: '{name or 'a shape of the world'}' overlaps the arm by {1e3 * depth:.0f} mm "
                "where the arm begins; move one of them, or the site 'robot_base'"
            )
        return self._robot

    def footage(self) -> Footage | None:
        """See `Cell`: the 30 Hz camera's configurations of the world."""
        if self._robot is None:
            return None
        world = self._robot.world
        return Footage(world.model, tuple(world.frames), self._spec)

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """Return the value that acts in the compiled world, None where undefined. Call it after
        estimating only."""
        if self._compiled is None:
            self._compiled = self.world.resolved.compiled(self.drawn)
        # The compiled value takes precedence over the drawn one.
        body = self._compiled.get(self.names.get(parameter.object, parameter.object))
        quantity = (self.scene or self.world).catalogue.get(parameter.quantity)
        acting = None if body is None or quantity is None else quantity.compiled(body)
        return self.drawn.get(parameter) if acting is None else acting


def draw_truth(scene: Scene, seed: int) -> dict[Parameter, tuple[float, ...]]:
    """Draw values of all missing quantities from their priors, for a hidden world made from D.

    Equal seeds give equal values.
    """
    random = np.random.default_rng(seed)
    truth: dict[Parameter, tuple[float, ...]] = {}
    # In document order, so that a seed determines each value.
    for parameter in scene.missing:
        quantity, prior = scene.catalogue[parameter.quantity], scene.resolved.priors[parameter]
        truth[parameter] = quantity.draw(scene.body(parameter.object), prior, random)
    return truth


def simulated_cell(
    scene: Scene | None,
    world: Path | Scene | None = None,
    *,
    noise: str = DEFAULT_LEVEL,
    seed: int = 0,
    tolerance: float = SIZE_TOLERANCE,
    seen: bool = False,
    arm: RobotDescription | None = None,
    root: Path | None = None,
    robot_body: Sequence[str] = (),
) -> SimulatedCell:
    """Make the hidden world for a scene.

    The world is an MJCF file, or a scene read from one. Without a world, it is the scene itself, with
    unknowns drawn from priors.

    Args:
        scene: the scene; None for a world that is only looked at, with `arm` in it.
        tolerance: largest difference of an object's extents in scene and world, m.
        seen: the scene was detected in a picture, with other names and shapes. Its objects are the
            nearest ones of the world; the arm does not find an object without a partner.
        root: folder outside of which no file of the world is read.
        robot_body: see `load_scene`.

    Raises:
        InputError: neither scene nor world; or the world does not match the scene within
            `tolerance` m.
    """
    if world is None:
        if scene is None:
            raise InputError("a simulated cell needs a scene or a world to be made of")
        return SimulatedCell(scene, draw_truth(scene, seed), DRAWN, noise, seed)
    made_of = f"simulated world {world.name}"
    # A file is compiled exactly as it is: no prior fills its gaps.
    if isinstance(world, Path):
        arm = scene.arm if scene is not None else arm
        world = load_scene(world, None, arm, NO_QUANTITIES, root, robot_body)
    world = as_world(world)
    names: dict[str, str] = {}
    if scene is not None and seen:
        # A detected scene has other names and rough sizes: only the arm's place must agree.
        _require_same_base(scene, world)
        names = _names_by_place(scene, world)
    elif scene is not None:
        _require_match(scene, world, tolerance)
    return SimulatedCell(world, {}, made_of, noise, seed, scene, names=names)


def _require_match(scene: Scene, world: Scene, tolerance: float) -> None:
    """Require every object and surface of the scene in the world, with objects of similar size."""
    differs = "scene and world do not match:"
    # Names must agree exactly: they connect beliefs and truth.
    absent = [name for name in scene.bodies if name not in world.bodies]
    if absent:
        raise InputError(
            f"{differs} the world has no {', '.join(absent)}; it has {', '.join(world.bodies)}"
        )
    _require_same_base(scene, world)
    # Objects must agree in role and size; poses may differ.
    for name, mine in scene.objects.items():
        theirs = world.bodies[name]
        if mine.role != theirs.role:
            raise InputError(
                f"{differs} '{name}' is an {mine.role} in the scene and a {theirs.role} in the world"
            )
        if (abs(mine.size - theirs.size) > tolerance).any():
            raise InputError(
                f"{differs} '{name}' measures {mine.size.round(3).tolist()} m in the scene and "
                f"{theirs.size.round(3).tolist()} m in the world"
            )


def _require_same_base(scene: Scene, world: Scene) -> None:
    """Require the arm's base near the scene's pose; the exact difference stays hidden."""
    mine, theirs = scene.pose_world_base, world.pose_world_base
    # |q1 . q2| = cos of half the angle between two attitudes.
    turned = abs(float(mine.quaternion @ theirs.quaternion))
    if mine.distance_to(theirs) > BASE_TOLERANCE or turned < TURNED:
        raise InputError(
            f"scene and world do not match: the arm stands at {mine.position.round(3).tolist()} in "
            f"the scene and at {theirs.position.round(3).tolist()} in the world; give both the same "
            "site 'robot_base'"
        )


def _names_by_place(scene: Scene, world: Scene) -> dict[str, str]:
    """Map each body of the scene to its name in the world; "" without a partner.

    Objects are paired by horizontal distance, the nearest pair first. A surface takes the highest
    surface of the world below its middle.
    """

    def middle(body: Body) -> Array:
        """(2,) m, seen from above."""
        return body.pose_world.apply(body.centre)[:2]

    # Horizontal distances of all pairs of objects.
    pairs: list[tuple[float, str, str]] = []
    for mine, theirs in product(scene.objects.values(), world.objects.values()):
        distance = float(np.linalg.norm(middle(mine) - middle(theirs)))
        pairs.append((distance, mine.name, theirs.name))
    names = dict.fromkeys(scene.bodies, "")
    # Greedy: the nearest pair first, each body once.
    for distance, name, partner in sorted(pairs):
        if distance < NEAR and not names[name] and partner not in names.values():
            names[name] = partner
    # Surfaces of the world whose outline contains the middle of the scene's surface.
    for name, body in scene.surfaces.items():
        below = [
            surface
            for surface in world.surfaces.values()
            if (abs(middle(body) - middle(surface)) < surface.size[:2] / 2).all()
        ]
        if below:
            names[name] = max(below, key=lambda surface: surface.top_z()).name
    return names
