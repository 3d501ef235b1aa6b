"""Film and pictures in processes of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest

from palpate.common.processes import Fork
from palpate.perception.film import Film
from palpate.runs.report import writing
from palpate.runs.report.data import Pictures
from palpate.runs.report.writing import Darkroom
from palpate.runs.run import Run


@pytest.mark.parametrize("drawn", [False, True])
def test_a_process_that_has_drawn_makes_film_and_pictures_itself(
    monkeypatch: pytest.MonkeyPatch, drawn: bool
) -> None:
    copies: list[bool] = []

    class Noted(Fork[Any]):
        """Work in this process, with a note of where it was wanted."""

        def __init__(self, work: Callable[[], Any], copied: bool = True) -> None:
            copies.append(copied)
            super().__init__(work, copied=False)

    monkeypatch.setattr(writing, "Fork", Noted)
    monkeypatch.setattr(writing, "gl_available", lambda: (True, "egl"))
    monkeypatch.setattr(writing.Painter, "used", drawn)
    monkeypatch.setattr(writing, "take_film", lambda _: Film(b"film", 1.0))
    monkeypatch.setattr(writing, "take_stills", lambda _, __: Pictures(before=b"before"))
    run = cast("Run", None)
    with Darkroom(run) as darkroom:
        darkroom.begin_stills(run)
        assert darkroom.film.result() == Film(b"film", 1.0)
        assert darkroom.stills(run, Pictures()).before == b"before"
    assert copies == [not drawn, not drawn]
