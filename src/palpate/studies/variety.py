"""Scenes of many kinds, written as a user would write them: other objects, other heights, other
gaps.

Each is a pair of MJCF files from one description: the scene, in which the unknowns are left out,
and the hidden world, in which they are not.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory

from palpate.parameter import Parameter
from palpate.settings import Settings
from palpate.studies.accuracy import SeedRun, run_seed

FRUSTUM_SIDES = 12


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
        return self.size[1] if self.shape == "cylinder" else self.size[2]


@dataclass(frozen=True, slots=True)
class Variety:
    """A scene: things on a table at `height` m with the arm's base at `base` m, and what is
    missing."""

    name: str
    height: float
    base: float
    things: tuple[Thing, ...]
    missing: tuple[Parameter, ...]

    def write(self, folder: Path) -> Settings:
        """Scene and world in `folder`, and the settings that measure what is missing."""
        folder.mkdir(parents=True, exist_ok=True)
        for thing in self.things:
            if thing.shape == "frustum":
                (folder / f"{thing.name}.obj").write_text(frustum(*thing.size), encoding="utf-8")
        (folder / "world.xml").write_text(self._mjcf(hidden=()), encoding="utf-8")
        (folder / "scene.xml").write_text(self._mjcf(hidden=self.missing), encoding="utf-8")
        return Settings(scene=folder / "scene.xml", world=folder / "world.xml")

    def _mjcf(self, hidden: tuple[Parameter, ...]) -> str:
        unknown = Parameter("table", "height") in hidden
        top = "?" if unknown else f"{self.height - 0.02:.4f}"
        bodies = "\n".join(
            self._body(t, Parameter(t.name, "mass") in hidden, 0.002 if unknown else 0.0)
            for t in self.things
        )
        meshes = "\n".join(
            f'    <mesh name="{t.name}" file="{t.name}.obj"/>'
            for t in self.things
            if t.shape == "frustum"
        )
        return (
            f'<mujoco model="{self.name}">\n  <asset>\n{meshes}\n  </asset>\n  <worldbody>\n'
            f'    <light pos="0.4 0 {self.height + 2}"/>\n'
            f'    <site name="robot_base" pos="0 0 {self.base}"/>\n    <body name="table" pos="0.6 0 {top}">\n'
            '      <geom type="box" size="0.42 0.5 0.02" friction="0.6 0.005 0.0001" rgba="0.8 0.7 0.55 1"/>\n'
            f"    </body>\n{bodies}\n  </worldbody>\n</mujoco>\n"
        )

    def _body(self, thing: Thing, massless: bool, raised: float) -> str:
        z = self.height + thing.half_height + raised
        mass = "" if massless else f' mass="{thing.mass}"'
        size = " ".join(f"{s:g}" for s in thing.size)
        mesh = thing.shape == "frustum"
        shape = (
            f'type="mesh" mesh="{thing.name}"' if mesh else f'type="{thing.shape}" size="{size}"'
        )
        return (
            f'    <body name="{thing.name}" pos="{thing.at[0]} {thing.at[1]} {z:.4f}" euler="0 0 {thing.yaw:g}">\n'
            f'      <freejoint/>\n      <geom {shape}{mass} friction="0.7 0.005 0.0001" rgba="0.3 0.5 0.8 1"/>\n'
            "    </body>"
        )


def frustum(bottom: float, top: float, half_height: float) -> str:
    """A closed frustum as Wavefront OBJ: radii and half height in m, axis z."""
    ring = [
        (cos(2 * pi * i / FRUSTUM_SIDES), sin(2 * pi * i / FRUSTUM_SIDES))
        for i in range(FRUSTUM_SIDES)
    ]
    lines = [
        f"v {r * x:.6f} {r * y:.6f} {z:.6f}"
        for r, z in ((bottom, -half_height), (top, half_height))
        for x, y in ring
    ]
    lower = [i + 1 for i in range(FRUSTUM_SIDES)]
    upper = [i + 1 + FRUSTUM_SIDES for i in range(FRUSTUM_SIDES)]
    lines.append("f " + " ".join(map(str, reversed(lower))))
    lines.append("f " + " ".join(map(str, upper)))
    for i in range(FRUSTUM_SIDES):
        j = (i + 1) % FRUSTUM_SIDES
        lines.append(f"f {lower[i]} {lower[j]} {upper[j]} {upper[i]}")
    return "\n".join(lines) + "\n"


def _mass(*names: str) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, "mass") for name in names)


HEIGHT = Parameter("table", "height")

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


def run_all(noise: str, seed: int, workers: int = 1) -> dict[str, SeedRun]:
    """Every scene once, by name."""
    with TemporaryDirectory() as folder:
        every = [replace(s.write(Path(folder) / s.name), noise=noise).checked() for s in SCENES]
        if workers == 1:
            return {
                s.name: run_seed(settings, seed) for s, settings in zip(SCENES, every, strict=True)
            }
        with ProcessPoolExecutor(workers) as pool:
            return dict(
                zip(
                    (s.name for s in SCENES),
                    pool.map(partial(run_seed, seed=seed), every),
                    strict=True,
                )
            )


def crowd(folder: Path, count: int) -> Path:
    """A scene file of `count` small boxes on a table, every mass missing."""
    spots = [(0.35 + 0.11 * (i % 4), -0.32 + 0.16 * (i // 4)) for i in range(count)]
    things = tuple(
        Thing(f"box_{i + 1}", "box", (0.02, 0.02, 0.025), 0.05 + 0.02 * i, spot)
        for i, spot in enumerate(spots)
    )
    settings = Variety("crowd", 0.0, 0.0, things, _mass(*(t.name for t in things))).write(folder)
    assert settings.scene is not None
    return settings.scene
