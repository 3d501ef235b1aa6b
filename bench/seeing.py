"""Looks at tags: are errors as large as their covariance says, and how large are they?

    python -m bench.seeing [LOOKS] [PICTURES]

Drawn looks have corners with noise, from a camera, a lens and things drawn from their priors; pictures are
rendered by the simulated camera, with tags and a box exactly where the scene has them, and as a person puts them
there: tags off their places, the box leaning and not quite at its height, as the fit takes them to be.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import mujoco
import numpy as np

from bench.photograph import take
from palpate.common.pose import Array, Pose
from palpate.perception.lens import FACING, Lens, Mount
from palpate.perception.look import Seen, look, things_of
from palpate.perception.rendered import Imperfections
from palpate.perception.solve import (
    GLUED,
    LEVEL,
    UPRIGHT,
    Problem,
    Solution,
    move_pose,
    pose_difference,
    solve,
)
from palpate.perception.tags import corners, tags_of
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

SCENE = """<mujoco><worldbody>
<camera name="over" pos="0.9 -0.5 1.1" xyaxes="0.6 0.8 0 -0.45 0.35 0.8" fovy="45"/>
<body name="table" pos="0.5 0 {table}"><geom type="box" size=".4 .4 .02"/>
  <site name="tag_0" pos="-.15 -.25 .02" size=".03"/><site name="tag_1" pos="-.15 .25 .02" size=".03"/>
  <site name="tag_2" pos=".25 .25 .02" size=".03"/></body>
<body name="box" pos="{place}" euler="{lean} {turn}"><freejoint/>
  <geom type="box" size=".03 .03 .03" mass=".1"/><site name="tag_7" pos="0 0 .03" size=".02"/>
  <site name="tag_8" pos="0 -.03 0" euler="90 0 0" size=".02"/></body>
</worldbody></mujoco>"""
GIVEN = parse_scene(SCENE.format(table="0.38", place="0.45 0.05 0.43", lean="0 0", turn="0"))
BOX = GIVEN.body("box").pose_world


def drawn_look(
    random: np.random.Generator,
    lens: Lens,
    mount: Mount,
    noise: float,
    known: bool = True,
    shifted: int | None = None,
) -> tuple[Solution, Pose]:
    """A fit to corners drawn as the fit takes them to be, of which those of one tag may be shifted, and
    where the box is."""
    around = np.array([0.04, 0.04, LEVEL, UPRIGHT, UPRIGHT, 0.4]) * random.standard_normal(6)
    truth = move_pose(BOX, around)
    step = np.linalg.cholesky(mount.covariance) @ random.standard_normal(6)
    camera = move_pose(mount.pose_world_camera @ FACING, step)
    zoom = float(np.exp(lens.focal_std * random.standard_normal()))
    tags, seen = tags_of(GIVEN), dict[int, Array]()
    for number, tag in tags.items():
        place = truth @ BOX.inverse() @ tag.pose_world if tag.body == "box" else tag.pose_world
        glued = place.rotation[:, :2] @ (GLUED * random.standard_normal(2))
        local = (corners(tag.half, place) + glued - camera.position) @ camera.rotation
        seen[number] = lens.project(local, zoom) + noise * random.standard_normal((4, 2))
        seen[number] += 25.0 * (number == shifted)
    return solve(Problem(lens, seen, tags, things_of(GIVEN), mount if known else None)), truth


def main(looks: int, pictures: int) -> None:
    """Print the figures."""
    told = take(GIVEN.spec(), "over", imperfections=Imperfections(focal=0, place=0, turn=0))
    assert told.mount is not None
    matrix, size, distortion = told.lens.matrix, told.lens.size, told.lens.distortion
    for noise, focal, place, known in (
        (0.2, 0.002, 0.002, True),
        (2.0, 0.01, 0.005, True),
        (0.2, 0.002, 0.002, False),
    ):
        random = np.random.default_rng(0)
        lens = Lens(matrix, size, distortion, focal)
        mount = Mount(told.mount.pose_world_camera, np.diag([place**2] * 3 + [place**2] * 3))
        rows: list[tuple[Solution, Pose]] = []
        for _ in range(looks):
            rows.append(drawn_look(random, lens, mount, noise, known))
        head = f"corners {noise:g} px, lens {focal:.1%}, camera {1e3 * place:g} mm"
        _print(f"{head}, {'stated' if known else 'not stated'}", rows)
    for head, askew in (("rendered pictures", 0.0), ("rendered pictures, put there by hand", 1.0)):
        random, spent = np.random.default_rng(1), 0.0
        rendered: list[tuple[Seen | Solution, Pose]] = []
        for seed in range(pictures):
            world, spec = world_by_hand(random, askew)
            picture = take(spec, "over", seed=seed)
            began = time.process_time()
            seen = look(GIVEN, [picture.pixels], picture.lens, picture.mount)
            spent += time.process_time() - began
            rendered.append((seen, world.body("box").pose_world))
        _print(head, rendered)
        print(f"one look takes {spent / max(pictures, 1):.2f} s of a processor")


def world_by_hand(random: np.random.Generator, askew: float) -> tuple[Scene, mujoco.MjSpec]:
    """A world whose box is somewhere, and, `askew` times as much as the fit takes them to be, leans and stands
    higher than the scene says, and whose tags are off their places."""
    x, y, turn = *random.uniform((0.42, -0.08), (0.58, 0.08)), random.uniform(-40, 40)
    lean = askew * np.degrees(UPRIGHT) * random.standard_normal(2)
    z = 0.43 + askew * LEVEL * random.standard_normal()
    where = {"place": f"{x} {y} {z}", "lean": f"{lean[0]} {lean[1]}", "turn": str(turn)}
    world = parse_scene(SCENE.format(table="0.38", **where))
    spec = world.spec()
    model = spec.compile()
    sites: list[mujoco.MjsSite] = list(spec.sites)
    for site in sites:
        axes = Pose.of(np.zeros(3), model.site(site.name).quat).rotation[:, :2]
        site.pos = site.pos + axes @ (askew * GLUED * random.standard_normal(2))
    return world, spec


def _print(head: str, rows: Sequence[tuple[Seen | Solution, Pose]]) -> None:
    off = np.array([pose_difference(found.poses["box"], truth) for found, truth in rows])
    spread = np.array([np.sqrt(np.diag(found.covariances["box"])) for found, _ in rows])
    z = np.sqrt(np.mean((off / spread) ** 2, axis=0))
    level = 1e3 * np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1)))
    turn = np.degrees(np.sqrt(np.mean(off[:, 5] ** 2)))
    whole = [
        o @ np.linalg.solve(found.covariances["box"], o) / 6
        for o, (found, _) in zip(off, rows, strict=True)
    ]
    print(
        f"{head}: {len(rows)} looks, level {level:.2f} mm, turn {turn:.2f}° rms; z by axis", end=" "
    )
    print(" ".join(f"{one:.2f}" for one in z), f"together {np.sqrt(np.mean(whole)):.2f}")


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:3]]
    main(*asked, *(200, 40)[len(asked) :])
