"""Catalogue of the bundled scenarios. Each is a folder, read as a user's own files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.runs.settings import Settings

ROOT = Path(__file__).parent
FIRST = "bottle_and_table"  # The paper's first scenario, also used by the demo
# Files of a scenario's folder, by field of `Settings`. A sub-case shares files that only its
# parent's folder has.
FILES = {"scene": "scene.xml", "poses": "poses.yaml", "world": "world.xml"}


@dataclass(frozen=True, slots=True)
class Scenario:
    """A bundled scenario."""

    name: str  # its folder
    # title, story: for readers.
    title: str
    story: str
    request: str | None  # R or None
    expects: tuple[Parameter, ...]  # parameters that a correct plan measures
    planner: str  # planner of its run
    status: str  # status in which a run ends
    # Pictures for a model; without any, one of the simulated world is rendered.
    images: tuple[Path, ...] = ()
    # Objects that a plan must move in addition to those of the measured parameters.
    may_touch: tuple[str, ...] = ()
    only_seen: bool = False  # True where only a picture resolves the request's objects

    @property
    def asks(self) -> bool:
        """True for a scenario with a request or expected parameters; False for a recorded plan."""
        return self.request is not None or bool(self.expects)

    @property
    def folder(self) -> Path:
        return ROOT / self.name

    @property
    def plans(self) -> dict[str, Path]:
        """Recorded plans by name: `paper` is the tree of a figure, `model` a model's answer."""
        return {file.stem: file for file in sorted(self.folder.glob("plans/*"))}

    def settings(self, **changes: Any) -> Settings:
        """Settings of its run, with `changes` of single fields. `planner="replay:NAME"` names one of `plans`."""
        fields: dict[str, Any] = {
            "request": self.request,
            "planner": self.planner,
            "images": self.images,
        }
        for field, file in FILES.items():
            path = _file(self.name, file)
            if path.exists():
                fields[field] = path
        fields |= changes
        # Replace the name of a recorded plan by its file.
        kind, _, name = fields["planner"].partition("replay:")
        if not kind and name in self.plans:
            fields["planner"] = f"replay:{self.plans[name]}"
        return Settings(**fields)


@cache
def scenarios() -> Mapping[str, Scenario]:
    """All bundled scenarios by name, `FIRST` first."""
    files = ROOT.rglob("scenario.yaml")
    names = sorted(file.parent.relative_to(ROOT).as_posix() for file in files)
    names.remove(FIRST)
    return MappingProxyType({name: _read(name) for name in (FIRST, *names)})


def scenario(name: str) -> Scenario:
    """Return the scenario `name`. Raises InputError: unknown; the message lists the valid ones."""
    catalogue = scenarios()
    if name in catalogue:
        return catalogue[name]
    cases = [other for other in catalogue if other.startswith(f"{name}/")]
    if cases:
        raise InputError(f"'{name}' is a group of scenarios; choose one: {', '.join(cases)}")
    raise unknown_name("scenario", name, catalogue)


def _read(name: str) -> Scenario:
    file = ROOT / name / "scenario.yaml"
    # Bundled files are trusted: only missing keys have defaults.
    content: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    planner: str = content.get("planner", "symbolic")
    if planner.startswith("replay:"):  # a recorded answer is a file of the scenario
        planner = f"replay:{_file(name, planner.removeprefix('replay:'))}"
    return Scenario(
        name=name,
        title=content["title"],
        story=content["story"].strip(),
        request=(content.get("request") or "").strip() or None,
        expects=tuple(Parameter(name) for name in content.get("expects", [])),
        planner=planner,
        status=content.get("status", "complete"),
        images=tuple(_file(name, image) for image in content.get("images", [])),
        may_touch=tuple(content.get("may_touch", [])),
        only_seen=content.get("only_seen", False),
    )


def _file(name: str, file: str) -> Path:
    """Path of a scenario's file: its own, else its parent's."""
    own = ROOT / name / file
    if own.exists():
        return own
    return ROOT / Path(name).parent / file
