"""A package as an installer leaves it: modules, and the entry points that name them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def install(folder: Path, name: str, points: Mapping[str, str], modules: Mapping[str, str]) -> None:
    """Lay a distribution `name` into a folder of the path: `points` are lines such as `bench = my_driver`
    by their group, `modules` texts by their module's name."""
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    groups = [f"[{group}]\n{line}\n" for group, line in points.items()]
    (metadata / "entry_points.txt").write_text("".join(groups))
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
