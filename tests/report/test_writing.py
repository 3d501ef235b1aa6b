"""Film and pictures in processes of their own."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import cast

import pytest

from palpate.beside import can_copy
from palpate.pictures.film import Film
from palpate.report import writing
from palpate.report.writing import Darkroom, Pictures
from palpate.runs.run import Run


def whose(pictures: bytes) -> int:
    return int(pictures.decode())


@pytest.fixture(autouse=True)
def _signed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Films and pictures that state the process which made them."""

    def mine() -> bytes:
        return str(os.getpid()).encode()

    monkeypatch.setattr(writing, "gl_available", lambda: (True, "egl"))
    monkeypatch.setattr(writing, "take_film", lambda _: Film(mine(), 1.0))
    monkeypatch.setattr(writing, "take_stills", lambda _, taken: replace(taken, before=mine()))


@pytest.mark.skipif(not can_copy(), reason="this process has threads, or there is one processor")
def test_film_and_pictures_are_made_by_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing.Painter, "used", False)
    film, before = made()
    assert len({film, before, os.getpid()}) == 3


def test_a_process_that_has_drawn_makes_them_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing.Painter, "used", True)
    assert made() == (os.getpid(), os.getpid())


def made() -> tuple[int, int]:
    """Processes that make the film and the pictures."""
    run = cast("Run", None)
    with Darkroom(run) as darkroom:
        darkroom.begin_stills(run)
        film, stills = darkroom.film.result(), darkroom.stills(run, Pictures())
    assert film is not None
    assert stills.before is not None
    return whose(film.mp4), whose(stills.before)
