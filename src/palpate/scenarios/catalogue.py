"""The bundled scenarios: one folder each, read like a user's own files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from palpate.errors import InputError, unknown_name
from palpate.parameter import Parameter
from palpate.settings import Settings

ROOT = Path(__file__).parent
FILES = {"scene": "scene.xml", "poses": "poses.yaml", "world": "world.xml"}
"""What a scenario's folder may hold, by field of the `Settings`. A sub-case shares what only its
parent's folder holds."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A bundled scenario.

    Attributes:
        name: its folder. title, story: for people. request: R or None.
        expects: the gaps a right plan measures.
        planner: the planner it is meant for.
        status: how a run of it ends.
        images: the pictures that a model is shown; without any, one is taken of the simulated
            world.
    """

    name: str
    title: str
    story: str
    request: str | None
    expects: tuple[Parameter, ...]
    planner: str
    status: str
    images: tuple[Path, ...] = ()

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
        found = {name: _file(self.name, file) for name, file in FILES.items()}
        files = {name: file for name, file in found.items() if file.exists()}
        mine = {"request": self.request, "planner": self.planner, "images": self.images}
        fields: dict[str, Any] = {**mine, **files, **changes}
        recorded = self.plans.get(fields["planner"].removeprefix("replay:"))
        if fields["planner"].startswith("replay:") and recorded:
            fields["planner"] = f"replay:{recorded}"
        return Settings(**fields)


def names() -> list[str]:
    """All bundled scenarios, the paper's first one first."""
    found = sorted(p.parent.relative_to(ROOT).as_posix() for p in ROOT.rglob("scenario.yaml"))
    return sorted(found, key=lambda n: n != "bottle_and_table")


def scenario(name: str) -> Scenario:
    """The scenario `name`.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    if name not in names():
        if cases := [other for other in names() if other.startswith(f"{name}/")]:
            raise InputError(f"'{name}' is a group of scenarios; choose one: {', '.join(cases)}")
        raise unknown_name("scenario", name, names())
    text: dict[str, Any] = yaml.safe_load(
        (ROOT / name / "scenario.yaml").read_text(encoding="utf-8")
    )
    planner = text.get("planner", "symbolic")
    if planner.startswith("replay:"):
        planner = f"replay:{_file(name, planner.removeprefix('replay:'))}"
    return Scenario(
        name=name,
        title=text["title"],
        story=text["story"].strip(),
        request=(text.get("request") or "").strip() or None,
        expects=tuple(Parameter(e) for e in text.get("expects", [])),
        planner=planner,
        status=text.get("status", "complete"),
        images=tuple(_file(name, image) for image in text.get("images", [])),
    )


def _file(name: str, file: str) -> Path:
    """A scenario's file: its own, or its parent's where it has none."""
    own = ROOT / name / file
    return own if own.exists() else ROOT / Path(name).parent / file
