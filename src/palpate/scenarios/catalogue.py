"""The bundled scenarios: one folder each, read like a user's own files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from palpate.errors import InputError, unknown_name
from palpate.parameter import Parameter
from palpate.settings import Settings

ROOT = Path(__file__).parent
FIRST = "bottle_and_table"
"""The paper's first scenario, which is also the demo."""
FILES = {"scene": "scene.xml", "poses": "poses.yaml", "world": "world.xml"}
"""Files of a scenario's folder, by field of `Settings`. A sub-case shares the files that only its
parent's folder has."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A bundled scenario.

    Attributes:
        name: its folder.
        title, story: for people.
        request: R or None.
        expects: the parameters that a right plan measures.
        planner: the planner it is meant for.
        status: how a run of it ends.
        images: the pictures that a model is shown; without any, one is taken of the simulated
            world.
        may_touch: what has to be moved besides that of which something is measured.
        only_seen: nothing but a picture tells what is meant.
    """

    name: str
    title: str
    story: str
    request: str | None
    expects: tuple[Parameter, ...]
    planner: str
    status: str
    images: tuple[Path, ...] = ()
    may_touch: tuple[str, ...] = ()
    only_seen: bool = False

    @property
    def asks(self) -> bool:
        """The scenario asks a planner, and is not about a recorded plan."""
        return self.request is not None or bool(self.expects)

    @property
    def folder(self) -> Path:
        return ROOT / self.name

    @property
    def plans(self) -> dict[str, Path]:
        """Recorded plans by name: `paper` is a figure's tree, `model` is in the style of a model's
        answer."""
        return {file.stem: file for file in sorted(self.folder.glob("plans/*"))}

    def settings(self, **changes: Any) -> Settings:
        """The run it stands for; `changes` override single fields of the `Settings`.

        `planner="replay:NAME"` names one of `plans`.
        """
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
        fields["planner"] = self._planner(fields["planner"])
        return Settings(**fields)

    def _planner(self, planner: str) -> str:
        """The planner's name, with the file of the recorded plan that it may name."""
        recorded = self.plans.get(planner.removeprefix("replay:"))
        if recorded is None or not planner.startswith("replay:"):
            return planner
        return f"replay:{recorded}"


@cache
def scenarios() -> Mapping[str, Scenario]:
    """All bundled scenarios by name, the paper's first one first."""
    files = ROOT.rglob("scenario.yaml")
    names = sorted(file.parent.relative_to(ROOT).as_posix() for file in files)
    names.remove(FIRST)
    return MappingProxyType({name: _read(name) for name in (FIRST, *names)})


def scenario(name: str) -> Scenario:
    """The scenario `name`.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    found = scenarios()
    if name in found:
        return found[name]
    cases = [other for other in found if other.startswith(f"{name}/")]
    if cases:
        raise InputError(f"'{name}' is a group of scenarios; choose one: {', '.join(cases)}")
    raise unknown_name("scenario", name, found)


def _read(name: str) -> Scenario:
    file = ROOT / name / "scenario.yaml"
    content: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return Scenario(
        name=name,
        title=content["title"],
        story=content["story"].strip(),
        request=(content.get("request") or "").strip() or None,
        expects=tuple(Parameter(name) for name in content.get("expects", [])),
        planner=_located(name, content.get("planner", "symbolic")),
        status=content.get("status", "complete"),
        images=tuple(_file(name, image) for image in content.get("images", [])),
        may_touch=tuple(content.get("may_touch", [])),
        only_seen=content.get("only_seen", False),
    )


def _located(name: str, planner: str) -> str:
    """The planner as the scenario names it; a recorded answer is a file of the scenario."""
    if not planner.startswith("replay:"):
        return planner
    return f"replay:{_file(name, planner.removeprefix('replay:'))}"


def _file(name: str, file: str) -> Path:
    """A scenario's file: its own, or its parent's where it has none."""
    own = ROOT / name / file
    if own.exists():
        return own
    return ROOT / Path(name).parent / file
