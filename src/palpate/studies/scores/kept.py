"""Seed runs of scenarios, kept in a folder one by one: a campaign that was stopped can be continued."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from palpate.errors import InputError
from palpate.robots.simulated.noise.models import noise_models
from palpate.settings import Settings, request_json
from palpate.studies.accuracy import Case, Question, SeedRun, crashed, survived
from palpate.studies.lines import Lines
from palpate.studies.workers import Crew, Lost, Progress

FILE = "rows.jsonl"
FILES = ("scene", "poses", "world", "robot_config")
"""Settings that name a file: its content identifies a run, not its path."""
PLACES = "drawn by their accuracy"
"""Placement of objects. Rows without this entry are of worlds with all objects exactly at their
stated poses."""
APART = ("seed", "palpate", "images")
"""Keys of `request.json` that do not describe the run."""


@dataclass(frozen=True, slots=True)
class Group:
    """A scenario at a noise model, by its title."""

    scenario: str
    noise: str


@dataclass(frozen=True, slots=True)
class Row:
    """Seed of a group, with all other settings of its run in `about`, by name."""

    group: Group
    about: dict[str, str]
    run: SeedRun

    @property
    def key(self) -> tuple[Group, int]:
        return self.group, self.run.seed


Runs = dict[Group, list[SeedRun]]


def measure(
    questions: Iterable[Question],
    seeds: Sequence[int],
    crew: Crew,
    folder: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Runs:
    """Return the runs of every question with every seed. Runs in `folder` are reused, the others
    are made by `crew` and appended; `say` receives the progress.

    Raises:
        InputError: bad settings, or the folder holds runs with other settings.
    """
    known = {row.key: row for row in read(folder)} if folder else {}
    asked: dict[Group, dict[str, str]] = {}
    todo: list[tuple[Group, Case]] = []
    wanted: list[tuple[Group, int]] = []
    for question in questions:
        settings = question.settings.checked()
        group = Group(question.scenario, noise_models().title(settings.noise))
        asked[group] = about(settings)
        wanted += [(group, seed) for seed in seeds]
        todo += [(group, Case(question, seed)) for seed in seeds if (group, seed) not in known]
    refuse_other_settings(known.values(), asked)
    lines = Lines(folder / FILE) if folder else None
    if lines is not None:
        lines.add()  # fails before anything is computed, if the file cannot be written
    progress = Progress(len(wanted), len(wanted) - len(todo))
    say(str(progress))
    for place, found in crew.each(survived, [case for _, case in todo]):
        group, case = todo[place]
        run = crashed(case.seed, str(found)) if isinstance(found, Lost) else found
        row = Row(group, asked[group], run)
        if lines is not None:
            lines.add(asdict(row))
        known[row.key] = row
        say(progress.step())
    return grouped(known[key] for key in wanted)


def about(settings: Settings) -> dict[str, str]:
    """Settings that identify a group, without the seed; files are represented by their digest."""
    asked = {name: value for name, value in request_json(settings).items() if name not in APART}
    for name in FILES:
        path: Path | None = getattr(settings, name)
        asked[name] = short_digest(path.read_bytes()) if path else None
    # A noise file of the same name may have another content.
    asked["noise"] = short_digest(repr(noise_models().load(settings.noise)).encode())
    asked["places"] = PLACES
    return {name: str(value) for name, value in asked.items() if value is not None}


def read(folder: Path) -> list[Row]:
    """Read all rows of a folder.

    Raises:
        InputError: its file holds something else.
    """
    return Lines(folder / FILE).read_as(Row)


def grouped(rows: Iterable[Row]) -> Runs:
    """The runs of each group, in order of first appearance."""
    found: Runs = {}
    for row in rows:
        found.setdefault(row.group, []).append(row.run)
    return found


def refuse_other_settings(rows: Iterable[Row], asked: dict[Group, dict[str, str]]) -> None:
    """Raise InputError if a group's kept rows have other settings than those asked for."""
    for row in rows:
        now = asked.get(row.group, row.about)
        other = [name for name in {**row.about, **now} if row.about.get(name) != now.get(name)]
        if other:
            raise InputError(
                f"the folder holds runs of {row.group.scenario} at {row.group.noise} with another "
                f"{' and '.join(sorted(other))}; choose another out="
            )


def short_digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:12]
