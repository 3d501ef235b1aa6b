"""A look at the workspace, in one call."""

from __future__ import annotations

from pathlib import Path

from palpate.api.given import known_keywords
from palpate.robots.registry import DEFAULT
from palpate.scene.scene import Scene
from palpate.seeing.look import Seen


@known_keywords
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
    pose_estimator: str | None = None,
    robot_config: str | Path | None = None,
) -> Seen:
    """Find a scene's objects in one look of a camera: by the tags on them, by a pose estimator, or both.

    Args:
        scene: a file, MJCF text, or a scene at hand, with a site `tag_12` for every tag.
        camera: a picture or a video, the number of a camera, or `world:NAME`, a camera of the simulated world.
        intrinsics: YAML with the camera's lens, where it is no simulated one.
        world: MJCF of the simulated world; the scene itself without one.
        poses, arm, root, robot_config: as `load` takes them, where the scene is read here.
        seed: of the simulated camera's errors.
        pose_estimator: a command, or `http://HOST:PORT/PATH`, that is asked for the poses of the objects.

    Returns:
        The poses that were seen, with a covariance each; `save` writes them to a poses.yaml.

    Raises:
        InputError: no such camera, nothing to see by, or a file or an answer that cannot be used.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
    """
    from palpate.api.scenes import load
    from palpate.stages.looking import seen_from

    known = (
        scene
        if isinstance(scene, Scene)
        else load(scene, poses, arm, root=root, robot_config=robot_config)
    )
    lens, hidden = (None if file is None else Path(file) for file in (intrinsics, world))
    return seen_from(known, str(camera), lens, hidden, seed, pose_estimator)
