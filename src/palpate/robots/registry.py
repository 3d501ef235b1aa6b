"""Which arms there are: palpate's own folders, installed packages', and any folder by its path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import EntryPoint, entry_points
from importlib.resources import files
from pathlib import Path

from palpate.errors import InputError, unknown_name
from palpate.robots.description import FILE, RobotDescription, read_description

GROUP = "palpate.robots"
"""Entry points: the arm's name, and a package whose folder has a `description.yaml`."""
DEFAULT = "fr3"


@dataclass(frozen=True, slots=True)
class Arms:
    """The arms that are known by name, and their folders."""

    folders: Mapping[str, Path]

    def load(self, name_or_path: str) -> RobotDescription:
        """The arm of that name, or the one that a folder describes.

        Raises:
            InputError: unknown; the message lists the valid names. Or the folder's description is
                not valid.
        """
        if name_or_path in self.folders:
            return _read(self.folders[name_or_path], name_or_path, 0)
        folder = Path(name_or_path)
        if not (folder / FILE).is_file():
            raise unknown_name(
                "arm", name_or_path, self.folders, f"Or give a folder with a {FILE}: PATH/"
            )
        return _read(folder.resolve(), folder.resolve().name, (folder / FILE).stat().st_mtime_ns)


@cache
def arms() -> Arms:
    """Every arm by name: those in this folder, and those of the entry-point group
    `palpate.robots`.

    Raises:
        InputError: an entry point's package cannot be loaded; the message names it.
    """
    found = {path.parent.name: path.parent for path in Path(__file__).parent.glob(f"*/{FILE}")}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        found.setdefault(entry.name, _folder(entry))
    return Arms(dict(sorted(found.items())))


def load_description(name_or_path: str = DEFAULT) -> RobotDescription:
    """The arm that `--arm NAME|PATH/` means.

    Raises:
        InputError: as `Arms.load`.
    """
    return arms().load(name_or_path)


def _folder(entry: EntryPoint) -> Path:
    try:
        return Path(str(files(entry.load())))
    except Exception as error:
        raise InputError(
            f"the arm '{entry.name}' ({entry.value}) cannot be loaded: {type(error).__name__}: "
            f"{error}; repair or uninstall the package that brings it"
        ) from error


@lru_cache(16)
def _read(folder: Path, name: str, _: int) -> RobotDescription:
    """The same object for the same folder; the last argument tells versions of a file apart."""
    return read_description(folder, name)
