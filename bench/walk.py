"""Walk of a run's data through the rooms of the code.

    python -m bench.walk [plan|estimate]

A move is a call from a function in one room to a function in another one, counted once for each pair
of functions. A climb is a move to a room that stands higher in the table of `docs/architecture.md`:
a callback, or a method of an object that a lower room was handed.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stdout
from inspect import CO_OPTIMIZED
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType

from palpate.cli.app import app
from palpate.runs import pipeline
from palpate.runs.workplace import cell_for
from palpate.studies.scenarios.catalogue import scenario

ROOT = Path(__file__).parents[1]
SOURCE = Path(pipeline.__file__).parents[1]
Move = tuple[CodeType, CodeType]


def heights() -> dict[str, int]:
    """Height of each room: its row in the table of the architecture, the top one 0."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text[text.index("| room |") :].partition("\n\n")[0]
    names = re.findall(r"^\| `(\w+)`", table, re.MULTILINE)
    return {name: row for row, name in enumerate(names)}


def room(code: CodeType) -> str | None:
    """Room of a piece of palpate's code; `""` for the body of a module or class, None for other
    code."""
    file = Path(code.co_filename)
    if not file.is_relative_to(SOURCE):
        return None
    is_function = code.co_flags & CO_OPTIMIZED
    return file.relative_to(SOURCE).parts[0].removesuffix(".py") if is_function else ""


class Walk:
    """Moves between rooms while some work is done."""

    def __init__(self) -> None:
        self.moves: Counter[Move] = Counter()
        self._rooms: dict[CodeType, str | None] = {}

    def _room(self, code: CodeType) -> str | None:
        if code not in self._rooms:
            self._rooms[code] = room(code)
        return self._rooms[code]

    def note(self, frame: FrameType, event: str, _: object) -> None:
        """Note a call, as a function for `sys.setprofile`."""
        if event != "call" or not self._room(frame.f_code):
            return
        # The caller is the nearest frame of palpate: libraries in between do not count.
        caller = frame.f_back
        while caller is not None and self._room(caller.f_code) is None:
            caller = caller.f_back
        # Imports do not count.
        start = None if caller is None else self._room(caller.f_code)
        if caller is not None and start and start != self._room(frame.f_code):
            self.moves[caller.f_code, frame.f_code] += 1

    def during(self, work: Callable[[], object]) -> None:
        """Do the work, and note its calls."""
        sys.setprofile(self.note)
        try:
            work()
        finally:
            sys.setprofile(None)

    def __str__(self) -> str:
        rows, climbs = heights(), Counter[tuple[str, str]]()
        rooms = {str(self._room(code)) for move in self.moves for code in move}
        for one, other in self.moves:
            start, end = str(self._room(one)), str(self._room(other))
            if rows[end] < rows[start]:
                climbs[start, end] += 1
        lines = [f"{len(rooms)} rooms, {len(self.moves)} moves, {climbs.total()} climbs"]
        lines += [f"  {start} up to {end}: {n}" for (start, end), n in climbs.most_common()]
        return "\n".join(lines)


def main(which: str) -> None:
    """Walk from a command to its plan, or through the estimates of a run."""
    settings, walk = scenario("bottle_and_table").settings(seed=0), Walk()
    if which == "plan":
        command = ["plan", str(settings.scene), "-r", str(settings.request)]
        with redirect_stdout(StringIO()):
            walk.during(lambda: app(command, standalone_mode=False))
    else:
        made = pipeline.plan(settings, pipeline.load(settings))
        cell = cell_for(settings, made.scene)
        done = pipeline.execute(made, cell)
        walk.during(lambda: pipeline.estimate(done, cell))
    print(f"{which}: {walk}")


if __name__ == "__main__":
    for name in sys.argv[1:] or ("plan", "estimate"):
        main(name)
