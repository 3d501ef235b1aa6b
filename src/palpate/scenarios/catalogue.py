"""The bundled scenarios: one folder each, read like a user's own files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from palpate.errors import unknown_name
from palpate.job import Job
from palpate.quantities import Gap

ROOT = Path(__file__).parent
FILES = {"scene": "scene.xml", "poses": "poses.yaml", "world": "world.xml"}
"""What a scenario's folder may hold, by field of the `Job`."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A bundled scenario.

    Attributes:
        name: its folder. title, story: for people. request: R or None.
        expects: the gaps a right plan measures.
        planner: the planner it is meant for.
        status: how a run of it ends.
    """

    name: str
    title: str
    story: str
    request: str | None
    expects: tuple[Gap, ...]
    planner: str
    status: str

    @property
    def folder(self) -> Path:
        return ROOT / self.name

    def job(self, **changes: Any) -> Job:
        """The run it stands for; `changes` override single fields of the `Job`."""
        files = {name: self.folder / file for name, file in FILES.items() if (self.folder / file).exists()}
        fields: dict[str, Any] = {"request": self.request, "planner": self.planner, **files}
        return Job(**(fields | changes))


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
        raise unknown_name("scenario", name, names())
    text: dict[str, Any] = yaml.safe_load((ROOT / name / "scenario.yaml").read_text(encoding="utf-8"))
    planner = text.get("planner", "symbolic")
    if planner.startswith("replay:"):
        planner = f"replay:{ROOT / name / planner.removeprefix('replay:')}"
    return Scenario(
        name=name, title=text["title"], story=text["story"].strip(),
        request=(text.get("request") or "").strip() or None,
        expects=tuple(Gap(*e.rsplit(".", 1)) for e in text.get("expects", [])), planner=planner,
        status=text.get("status", "complete"),
    )
