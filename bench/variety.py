"""Scenes of other objects, heights and missing values, written as a user would write them.

Each is a pair of MJCF files from one description: the scene, without the unknowns, and the hidden
world, with them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from palpate.common.parameter import Parameter
from palpate.runs.settings import Settings
from palpate.studies.accuracy import SeedRun, run_seed
from palpate.studies.workers import spread

HEIGHT = Parameter("table", "height")
FRUSTUM_SIDES = 12
TABLE_HALF = 0.02
"""m: half the thickness of the table's top."""
RAISED = 0.002
"""m: error of the objects' heights if the table's height is missing."""
STREAM = 777
"""Random stream of drawn scenes, independent of all others of a seed."""
HEIGHTS, BELOW = (0.0, 0.1, 0.2, 0.4, 0.75), (0.0, 0.05, 0.1)
"""m: heights of drawn tables, and by how much the arm's base is lower, down to the ground."""
APART = 0.17
"""m between the middles of drawn things."""
ASKED = {"friction": 0.35, "com": 0.3, "com_3d": 0.1, "inertia": 0.12, "size": 0.08}
"""Probability that a quantity of a drawn thing is asked for."""

SCENE = """\
<mujoco model="{name}">
  <asset>
{meshes}
  </asset>
  <worldbody>
    <light pos="0.4 0 {lamp}"/>
    <site name="robot_base" pos="0 0 {base}"/>
    <body name="table" pos="0.6 0 {table}">
      <geom type="box" size="{half} 0.02" friction="0.6 0.005 0.0001" rgba="0.8 0.7 0.55 1"/>
    </body>
{bodies}
  </worldbody>
</mujoco>
"""
BODY = """\
    <body name="{name}" pos="{at}" euler="0 0 {yaw:g}">
      <freejoint/>
      <geom {shape} friction="0.7 0.005 0.0001" rgba="0.3 0.5 0.8 1"/>
    </body>"""


def tabletop(
    name: str,
    bodies: str,
    table: str,
    half: str = "0.42 0.5",
    base: float = 0.0,
    lamp: float = 2.0,
    meshes: str = "",
) -> str:
    """A scene: bodies on a table whose middle is at the height `table`, m or `?`, with the half
    extents `half`, before an arm whose base is at the height `base`."""
    return SCENE.format(
        name=name, bodies=bodies, table=table, half=half, base=base, lamp=lamp, meshes=meshes
    )


def standing(name: str, at: str, shape: str, yaw: float = 0.0) -> str:
    """A free body: its middle at `at`, `shape` the attributes of its geom, `yaw` degrees."""
    return BODY.format(name=name, at=at, shape=shape, yaw=yaw)


@dataclass(frozen=True, slots=True)
class Thing:
    """An object. `size` is MuJoCo's (half extents; radius and half height); a `frustum` is a mesh
    with radii and half height. `mass` kg; `at` x, y in m; `yaw` degrees."""

    name: str
    shape: str
    size: tuple[float, ...]
    mass: float
    at: tuple[float, float]
    yaw: float = 0.0

    @property
    def half_height(self) -> float:
        return self.size[-1]

    def mjcf(self, z: float, massless: bool) -> str:
        """Its body with the middle at height `z`, with or without its mass."""
        x, y = self.at
        mass = "" if massless else f' mass="{self.mass}"'
        return standing(self.name, f"{x} {y} {z:.4f}", self._shape() + mass, self.yaw)

    def _shape(self) -> str:
        if self.shape == "frustum":
            return f'type="mesh" mesh="{self.name}"'
        size = " ".join(f"{s:g}" for s in self.size)
        return f'type="{self.shape}" size="{size}"'


@dataclass(frozen=True, slots=True)
class Variety:
    """A scene: things on a table at `height` m with the arm's base at `base` m, what is missing, and
    what is asked beside that."""

    name: str
    height: float
    base: float
    things: tuple[Thing, ...]
    missing: tuple[Parameter, ...]
    asked: tuple[Parameter, ...] = ()

    def write(self, folder: Path) -> Settings:
        """Write scene and world into `folder`; return settings that measure all missing values."""
        folder.mkdir(parents=True, exist_ok=True)
        for thing in self.things:
            if thing.shape == "frustum":
                (folder / f"{thing.name}.obj").write_text(frustum(*thing.size), encoding="utf-8")
        (folder / "world.xml").write_text(self._mjcf(hidden=()), encoding="utf-8")
        (folder / "scene.xml").write_text(self._mjcf(hidden=self.missing), encoding="utf-8")
        settings = Settings(scene=folder / "scene.xml", world=folder / "world.xml")
        measured = (*self.missing, *self.asked) if self.asked else ()
        return replace(settings, measure=tuple(map(str, measured)))

    def _mjcf(self, hidden: tuple[Parameter, ...]) -> str:
        """The scene without the `hidden` values; without the table's height, objects are `RAISED`."""
        middle, raised = f"{self.height - TABLE_HALF:.4f}", 0.0
        if HEIGHT in hidden:
            middle, raised = "?", RAISED
        meshes: list[str] = []
        bodies: list[str] = []
        for thing in self.things:
            if thing.shape == "frustum":
                meshes.append(f'    <mesh name="{thing.name}" file="{thing.name}.obj"/>')
            z = self.height + thing.half_height + raised
            bodies.append(thing.mjcf(z, massless=Parameter(thing.name, "mass") in hidden))
        return tabletop(
            self.name,
            "\n".join(bodies),
            middle,
            base=self.base,
            lamp=self.height + 2,
            meshes="\n".join(meshes),
        )


def frustum(bottom: float, top: float, half_height: float) -> str:
    """A closed frustum as Wavefront OBJ: radii and half height in m, axis z.

    Vertices 1 to n are the lower ring, n + 1 to 2 n the upper one, both anticlockwise from above.
    """
    n = FRUSTUM_SIDES
    angles = [2 * pi * i / n for i in range(n)]
    lines: list[str] = []
    for (r, z), angle in product(((bottom, -half_height), (top, half_height)), angles):
        lines.append(f"v {r * cos(angle):.6f} {r * sin(angle):.6f} {z:.6f}")
    lines.append(_face(range(n, 0, -1)))  # seen from outside, the lower face runs clockwise
    lines.append(_face(range(n + 1, 2 * n + 1)))
    for i in range(1, n + 1):
        j = i % n + 1
        lines.append(_face((i, j, j + n, i + n)))
    return "\n".join(lines) + "\n"


def _face(vertices: Iterable[int]) -> str:
    return " ".join(["f", *map(str, vertices)])


def _mass(*names: str) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, "mass") for name in names)


SCENES: tuple[Variety, ...] = (
    Variety(
        "matchbox",
        0.0,
        0.0,
        (Thing("matchbox", "box", (0.027, 0.018, 0.02), 0.020, (0.5, 0.1), 20),),
        _mass("matchbox"),
    ),
    Variety(
        "brick",
        0.0,
        0.0,
        (Thing("brick", "box", (0.08, 0.035, 0.05), 1.5, (0.5, -0.1), -30),),
        _mass("brick"),
    ),
    Variety(
        "can",
        0.2,
        0.15,
        (Thing("can", "cylinder", (0.033, 0.06), 0.39, (0.45, 0.15)),),
        (*_mass("can"), HEIGHT),
    ),
    Variety(
        "cup",
        0.4,
        0.4,
        (Thing("cup", "frustum", (0.024, 0.036, 0.05), 0.21, (0.55, 0.0)),),
        _mass("cup"),
    ),
    Variety(
        "shelf",
        0.8,
        0.7,
        (Thing("jar", "cylinder", (0.035, 0.07), 0.62, (0.5, 0.2)),),
        (*_mass("jar"), HEIGHT),
    ),
    Variety(
        "pair",
        0.1,
        0.1,
        (
            Thing("left_box", "box", (0.03, 0.03, 0.04), 0.25, (0.5, 0.2), 45),
            Thing("right_box", "box", (0.05, 0.02, 0.03), 0.11, (0.5, -0.2), 10),
        ),
        _mass("left_box", "right_box"),
    ),
    Variety(
        "known_neighbour",
        0.3,
        0.25,
        (
            Thing("tin", "cylinder", (0.03, 0.04), 0.18, (0.6, 0.1)),
            Thing("crate", "box", (0.06, 0.036, 0.05), 0.9, (0.4, -0.15), 60),
        ),
        _mass("crate"),
    ),
    Variety(
        "low_table",
        0.05,
        0.0,
        (Thing("torch", "cylinder", (0.02, 0.09), 0.33, (0.48, -0.22)),),
        (*_mass("torch"), HEIGHT),
    ),
    Variety(
        "mesh_and_box",
        0.6,
        0.55,
        (
            Thing("bucket", "frustum", (0.02, 0.035, 0.06), 0.075, (0.45, 0.2)),
            Thing("block", "box", (0.03, 0.03, 0.03), 0.7, (0.6, -0.1), 75),
        ),
        _mass("bucket", "block"),
    ),
    Variety(
        "only_height",
        0.75,
        0.7,
        (Thing("vase", "cylinder", (0.028, 0.1), 0.4, (0.6, -0.2)),),
        (HEIGHT,),
    ),
)


def drawn(number: int) -> Variety:
    """A scene of one to three things of any shape, size, mass and place, always the same for a number."""
    random = np.random.default_rng([number, STREAM])
    height = float(random.choice(HEIGHTS))
    spots: list[tuple[float, float]] = []
    for _ in range(100):
        x, y = np.round(random.uniform((0.4, -0.28), (0.6, 0.28)), 3).tolist()
        if all(np.hypot(x - a, y - b) > APART for a, b in spots):
            spots.append((x, y))
    spots = spots[: int(random.integers(1, 4))]
    things = tuple(_thing(f"thing_{i}", spot, random) for i, spot in enumerate(spots))
    missing = [one for one in _mass(*(thing.name for thing in things)) if random.random() < 0.8]
    if random.random() < 0.3:
        missing.append(HEIGHT)
    asked = tuple(
        Parameter(thing.name, quantity)
        for thing in things
        for quantity, probability in ASKED.items()
        if random.random() < probability
    )
    base = max(height - float(random.choice(BELOW)), 0.0)
    missing = tuple(missing) or _mass(things[0].name)
    return Variety(f"drawn_{number}", height, base, things, missing, asked)


def _thing(name: str, spot: tuple[float, float], random: np.random.Generator) -> Thing:
    shape = str(random.choice(["box", "cylinder", "frustum"]))
    smallest, largest = {
        "box": ((0.015, 0.012, 0.02), (0.07, 0.036, 0.1)),
        "cylinder": ((0.015, 0.025), (0.036, 0.1)),
        "frustum": ((0.018, 0.018, 0.03), (0.036, 0.036, 0.08)),
    }[shape]
    size = tuple(np.round(random.uniform(smallest, largest), 4).tolist())
    mass = round(float(np.exp(random.uniform(np.log(0.03), np.log(1.6)))), 4)
    return Thing(name, shape, size, mass, spot, round(float(random.uniform(-80, 80))))


def run_all(noise: str, seed: int, workers: int = 1, count: int = 0) -> dict[str, SeedRun]:
    """Run every scene once, or `count` drawn ones; results by name."""
    scenes = [drawn(1000 * seed + number) for number in range(count)] or SCENES
    with TemporaryDirectory() as folder:
        todo: list[Settings] = []
        for variety in scenes:
            settings = variety.write(Path(folder) / variety.name)
            todo.append(replace(settings, noise=noise).check_values())
        runs = spread(partial(run_seed, seed=seed), todo, workers)
    return {variety.name: run for variety, run in zip(scenes, runs, strict=True)}


def crowd(folder: Path, count: int) -> Path:
    """Write a scene of `count` small boxes, up to 80, on a table in rows of four or eight; every mass is missing."""
    things: list[Thing] = []
    first, apart = (-0.32, 0.16) if count <= 20 else (-0.45, 0.1)
    columns, near, width = (4, 0.35, 0.11) if count <= 40 else (8, 0.29, 0.05)
    for i in range(count):
        row, column = divmod(i, columns)
        spot = (near + width * column, first + apart * row)
        things.append(Thing(f"box_{i + 1}", "box", (0.02, 0.02, 0.025), 0.05 + 0.02 * i, spot))
    missing = _mass(*(thing.name for thing in things))
    settings = Variety("crowd", 0.0, 0.0, tuple(things), missing).write(folder)
    assert settings.scene is not None
    return settings.scene
