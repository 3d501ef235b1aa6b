"""A folder with a new scene; nothing that is there is overwritten."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate.errors import InputError
from palpate.scaffold.text import poses_text, scene_text
from palpate.scaffold.things import identifier, things_named

SCENE, POSES = "scene.xml", "poses.yaml"


@dataclass(frozen=True, slots=True)
class Scaffold:
    """A new scene's files, and what is in it."""

    scene: Path
    poses: Path
    objects: tuple[str, ...]


def new_scene(folder: Path, names: Sequence[str], surface: str = "table") -> Scaffold:
    """Write a scene of the named things on a surface.

    Raises:
        InputError: a name that cannot be one, a file that is there already, or a folder that cannot be
            written.
    """
    surface = identifier(surface)
    things = things_named(names)
    if surface in {thing.name for thing in things}:
        raise InputError(f"'{surface}' is the surface's name: give the object another one")
    texts = {
        SCENE: scene_text(_model(folder), surface, things),
        POSES: poses_text(things),
    }
    written(folder, texts)
    return Scaffold(folder / SCENE, folder / POSES, tuple(thing.name for thing in things))


def written(folder: Path, texts: Mapping[str, str]) -> None:
    """Write all files, or none where one of them is there already.

    Raises:
        InputError: one is there, or the folder cannot be written.
    """
    for name in texts:
        if (folder / name).exists():
            raise InputError(f"'{folder / name}' is there already: name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            with (folder / name).open("x", encoding="utf-8") as file:
                file.write(text)
    except OSError as error:
        raise InputError(f"cannot write into '{folder}': {error.strerror}") from error


def _model(folder: Path) -> str:
    """The scene's name, from its folder's."""
    letters = [letter for letter in folder.absolute().name if letter.isalnum() or letter in " _-"]
    return "".join(letters) or "scene"
