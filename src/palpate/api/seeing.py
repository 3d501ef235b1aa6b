"""A look at the workspace, in one call."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import InputError
from palpate.robots.registry import DEFAULT
from palpate.scene.scene import Scene
from palpate.seeing.look import Seen

WORLD = "world:"
"""Beginning of the source that is a camera of the simulated world."""


def see(
    scene: str | Path | Scene,
    camera: str | int,
    *,
    intrinsics: str | Path | None = None,
    world: str | Path | None = None,
    poses: str | Path | None = None,
    arm: str | Path = DEFAULT,
    root: str | Path | None = None,
    seed: int = 0,
) -> Seen:
    """Find a scene's objects by the tags on them, in one look of a camera.

    Args:
        scene: a file, MJCF text, or a scene at hand, with a site `tag_12` for every tag.
        camera: a picture or a video, the number of a camera, or `world:NAME`, a camera of the simulated world.
        intrinsics: YAML with the camera's lens, where it is no simulated one.
        world: MJCF of the simulated world; the scene itself without one.
        poses, arm, root: as `load` takes them, where the scene is read here.
        seed: of the simulated camera's errors.

    Returns:
        The poses that were seen, with a covariance each; `save` writes them to a poses.yaml.

    Raises:
        InputError: no such camera, no tags, or a file that cannot be used.
        Unavailable: OpenCV is not installed, or a camera does not answer.
    """
    from palpate.api.scenes import load
    from palpate.seeing.look import look
    from palpate.seeing.sources import pictures

    known = scene if isinstance(scene, Scene) else load(scene, poses, arm, root=root)
    source = str(camera)
    if not source.startswith(WORLD):
        if world is not None:
            raise InputError(
                f"world= goes with camera={WORLD}NAME, a camera of the simulated world"
            )
        taken, lens, mount = pictures(source, None if intrinsics is None else Path(intrinsics))
        return look(known, taken, lens, mount)
    if intrinsics is not None:
        raise InputError(
            "a camera of the simulated world has its own intrinsics: leave out intrinsics="
        )
    from palpate.cells.simulated import simulated_cell
    from palpate.seeing.rendered import take

    cell = simulated_cell(known, None if world is None else Path(world), seed=seed)
    picture = take(cell.world.spec(cell.drawn), source.removeprefix(WORLD), seed=seed)
    return look(known, [picture.pixels], picture.lens, picture.mount)
