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

GROUP = "palpate.robots"  # entry points: packages with a `description.yaml`, named like the arm
DEFAULT = "fr3"


@dataclass(frozen=True, slots=True)
class Arms:
    """Arms by name, with their folders."""

    folders: Mapping[str, Path]
    _read: dict[tuple[Path, int], RobotDescription] = field(
        default_factory=dict[tuple[Path, int], RobotDescription], repr=False, compare=False
    )

    def load(self, name_or_path: str) -> RobotDescription:
        """Load the arm of that name or folder; an unchanged file is the same object.

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
            names = {path.resolve(): name for name, path in self.folders.items()}
            name = names.get(folder, folder.name)
            self._read[version] = read_description(folder, name, self.folders)
        return self._read[version]


@cache
def arms() -> Arms:
    """Return all arms: those of this folder, and those of the entry-point group `palpate.robots`.

    Raises:
        InputError: an entry point's package cannot be loaded; the message names it.
    """
    found = {path.parent.name: path.parent for path in Path(__file__).parent.glob(f"*/{FILE}")}
    for module in extensions(GROUP):
        found.setdefault(module.__name__.rpartition(".")[2], Path(str(module.__file__)).parent)
    return Arms(dict(sorted(found.items())))


def load_description(name_or_path: str = DEFAULT, cautious: bool = False) -> RobotDescription:
    """Load the arm of `--arm NAME|PATH/`; `cautious` limits its pace, as `--cautious`.

    Raises:
        InputError: as `Arms.load`.
    """
    arm = arms().load(name_or_path)
    return _cautious(arm) if cautious else arm


@cache  # results computed for an arm are cached by its identity
def _cautious(arm: RobotDescription) -> RobotDescription:
    return arm.cautious()
