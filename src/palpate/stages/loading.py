"""The first stage: what the settings name is read, and the robot is asked whether it is there."""

from __future__ import annotations

from palpate.scene.camera import load_image
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.stages.workplace import connected


def preflight(settings: Settings) -> None:
    """Require an answer of the robot that the settings name, before anything is planned for it.

    Raises:
        InputError: no such URL.
        Unavailable: it does not answer.
    """
    if settings.robot is not None:
        connected(settings, None)


def load(settings: Settings) -> Scene | None:
    """D and the poses that came with it, or None without D; the pictures are checked on the way.

    Raises:
        InputError: a file that cannot be used.
    """
    for image in settings.images:
        load_image(image)
    if settings.scene is None:
        return None
    return load_scene(
        settings.scene,
        settings.poses,
        settings.described_arm(),
        root=settings.root,
        robot_body=settings.robot_body,
    )
