"""Option groups: a command has the fields of a dataclass as options, its function gets the dataclass."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import typer

from palpate.cli import console
from palpate.cli.command import command
from palpate.common.errors import InputError, Unavailable
from palpate.robots.owner import DEFAULT
from palpate.runs.settings import Settings

Loud = Annotated[bool, typer.Option("--loud", help="Louder.")]
Times = Annotated[int, typer.Option("--times", min=1)]
AsJson = Annotated[bool, typer.Option("--json")]


@dataclass(frozen=True)
class Manner:
    times: Times = 2
    loud: Loud = False


def made(fails: Exception | None = None) -> tuple[typer.Typer, list[tuple[str, Manner, bool]]]:
    app, calls = typer.Typer(), list[tuple[str, Manner, bool]]()
    app.callback()(lambda: None)

    @command(app)
    def greet(
        name: Annotated[str, typer.Argument()], *, manner: Manner, as_json: AsJson = False
    ) -> None:
        """Greet."""
        calls.append((name, manner, as_json))
        if fails is not None:
            raise fails

    return app, calls


def test_the_fields_of_a_group_are_options_and_come_as_the_group() -> None:
    app, calls = made()
    app(["greet", "Ada", "--times", "3", "--loud"], standalone_mode=False)
    app(["greet", "Bob"], standalone_mode=False)
    assert calls == [("Ada", Manner(3, True), False), ("Bob", Manner(), False)]


def test_an_option_of_one_value_is_given_once() -> None:
    app, calls = made()
    with pytest.raises(Exception, match="given twice: give it once"):
        app(["greet", "Ada", "--times", "1", "--times", "2"], standalone_mode=False)
    assert not calls


def test_declarations_of_options_are_valid(capsys: pytest.CaptureFixture[str]) -> None:
    app, _ = made()
    app(["greet", "--help"], standalone_mode=False)
    assert "Louder." in capsys.readouterr().out
    with pytest.raises(Exception, match="greater than or equal to 1"):
        app(["greet", "Ada", "--times", "0"], standalone_mode=False)


@pytest.mark.parametrize(("error", "status"), [(InputError("no"), 2), (Unavailable("no"), 5)])
def test_an_error_is_its_exit_status_and_one_line(
    error: Exception, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    app, _ = made(error)
    assert app(["greet", "Ada"], standalone_mode=False) == status
    assert tuple(capsys.readouterr()) == ("", "palpate: no\n")


def test_an_error_is_json_only_where_the_command_was_asked_for_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    app, _ = made(InputError("no"))
    app(["greet", "--", "--json"], standalone_mode=False)
    assert capsys.readouterr().out == ""
    app(["greet", "Ada", "--json"], standalone_mode=False)
    document = json.loads(capsys.readouterr().out)
    assert document == {"status": "failed", "error": {"message": "no", "exit_status": 2}}


def test_the_arm_that_the_help_names_is_the_librarys() -> None:
    assert Settings().arm == DEFAULT


def spoken(*options: str) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)

    @command(app)
    def think(*, as_json: AsJson = False) -> None:
        """Think."""
        logging.getLogger("palpate.thoughts").debug("a thought")
        logging.getLogger("palpate.thoughts").warning("a doubt")
        console.err.print("progress")

    app(["think", *options], standalone_mode=False)


def test_quiet_shows_no_progress_and_verbose_what_goes_on_inside(
    capsys: pytest.CaptureFixture[str],
) -> None:
    spoken()
    assert "progress" in capsys.readouterr().err
    spoken("-q")
    assert "progress" not in capsys.readouterr().err
    spoken("-v")
    assert "a thought" in capsys.readouterr().err
    spoken()
    assert "a thought" not in capsys.readouterr().err


def test_a_log_has_it_all_without_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "a thought")
    spoken("--log", str(tmp_path / "log"))
    text = (tmp_path / "log").read_text("utf-8")
    assert "a doubt" in text
    assert "DEBUG palpate.thoughts: " in text
    assert "a thought" not in text
    assert "a doubt" in capsys.readouterr().err
    spoken("--log", str(tmp_path))
    assert "cannot write --log" in capsys.readouterr().err
