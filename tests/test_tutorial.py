"""The tutorial, followed literally in an empty folder: its commands run, and print what it says."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.app import app

PAGE = (Path(__file__).parents[1] / "docs" / "tutorial.md").read_text(encoding="utf-8")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Step:
    """A command of the page, and what the page says that it prints; empty where it does not say."""

    command: str
    printed: str = ""


def steps() -> Iterator[Step]:
    """The commands of palpate, in order; a block without any is what the last one prints."""
    last: str | None = None
    for language, block in FENCE.findall(PAGE):
        first, _, rest = block.partition("\n")
        if language:
            continue
        if first.startswith("$ palpate "):
            yield Step(first.removeprefix("$ "), rest)
        elif first.startswith("palpate "):
            if last is not None:
                yield Step(last)
            last = first
        elif last is not None:
            yield Step(last, block)
            last = None


def follow(last: str) -> str:
    """Run the page's commands up to and with the one of this name; what that prints."""
    for step in steps():
        arguments = shlex.split(step.command)[1:]
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, done.output
        said = lines(step.printed)
        assert lines(done.stdout)[: len(said)] == said
        if arguments[0] == last:
            return done.stdout
    raise AssertionError(f"the tutorial has no palpate {last}")


def lines(text: str) -> list[str]:
    """Without what depends on how a value came out: its digits."""
    return [re.sub(r"\d", "0", line.rstrip()) for line in text.rstrip().splitlines()]


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


def test_the_commands_before_anything_moves_print_what_the_page_says() -> None:
    assert [step.command.split()[1] for step in steps()] == ["init", "gap", "plan", "run"]
    planned = follow("plan")
    assert "mug.mass" in planned
    assert "red_box" not in planned.replace("red_box_pose", "")


@pytest.mark.long
def test_the_mug_is_measured_and_its_twin_is_read() -> None:
    """The values of the table are the page's own; its `truth` is drawn by the seed, to the digit."""
    printed = follow("run")
    truth = re.search(r"identified\s+([\d.]+)", PAGE)
    assert truth is not None
    assert truth.group(1) in printed
    (program,) = [block for language, block in FENCE.findall(PAGE) if language == "python"]
    said: list[object] = []
    exec(program, {"print": said.append})
    assert said == [pytest.approx(float(truth.group(1)), rel=0.05)]
