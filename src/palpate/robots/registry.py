"""Registry of arms: palpate's own folders, installed packages', and any folder by its path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from palpate.errors import unknown_name
from palpate.extensions import extensions
from palpate.robots.description import RobotDescription, read_description
from palpate.robots.sheet import FILE

GROUP = "palpate.robots"
"""Entry points: packages whose folder has a `description.yaml`, named like the arm."""
DEFAULT = "fr3"


@dataclass(frozen=True, slots=True)
class Arms:
    """The arms that are known by name, and their folders."""

    folders: Mapping[str, Path]
    _read: dict[tuple[Path, int], RobotDescription] = field(
        default_factory=dict[tuple[Path, int], RobotDescription], repr=False, compare=False
    )

    def load(self, name_or_path: str) -> RobotDescription:
        """The arm of that name, or the one that a folder describes; the same object as long as
        the file does not change.

        Raises:
            InputError: unknown; the message lists the valid names. Or the folder's description is
                not valid.
        """
        folder = self.folders.get(name_or_path, Path(name_or_path)).resolve()
        if not (folder / FILE).is_file():
            raise unknown_name(
                "arm", name_or_path, self.folders, f"Or give a folder with a {FILE}: PATH/"
            )
        version = (folder, (folder / FILE).stat().st_mtime_ns)
        if version not in self._read:
            self._read[version] = read_description(folder, self._name(folder), self.folders)
        return self._read[version]

    def _name(self, folder: Path) -> str:
        known = {path.resolve(): name for name, path in self.folders.items()}
        return known.get(folder, folder.name)


@cache
def arms() -> Arms:
    """Every arm by name: those in this folder, and those of the entry-point group
    `palpate.robots`.

    Raises:
        InputError: an entry point's package cannot be loaded; the message names it.
    """
    found = {path.parent.name: path.parent for path in Path(__file__).parent.glob(f"*/{FILE}")}
    for module in extensions(GROUP):
        found.setdefault(module.__name__.rpartition(".")[2], Path(str(module.__file__)).parent)
    return Arms(dict(sorted(found.items())))


def load_description(name_or_path: str = DEFAULT, cautious: bool = False) -> RobotDescription:
    """The arm that `--arm NAME|PATH/` means, and with `--cautious` its slow self.

    Raises:
        InputError: as `Arms.load`.
    """
    arm = arms().load(name_or_path)
    return _slow(arm) if cautious else arm


@cache
def _slow(arm: RobotDescription) -> RobotDescription:
    """Return the cautious arm; cached, because results computed for it are cached by identity."""
    return arm.cautious()
