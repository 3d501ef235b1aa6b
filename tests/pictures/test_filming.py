"""A film in the making: beside other work, and given up at once."""

from __future__ import annotations

import threading
from typing import Any

import mujoco
import numpy as np
import pytest

from palpate.pictures import filming
from palpate.pictures.filming import Filming
from palpate.pictures.footage import Footage
from palpate.pictures.moments import Film

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
FOOTAGE = Footage(MODEL, ((0.0, np.zeros(0)), (1.0, np.zeros(0))))


@pytest.fixture(autouse=True)
def usable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filming, "gl_available", lambda: (True, "egl"))


def test_it_is_made_on_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def film(*_: Any, **__: Any) -> Film:
        return Film(threading.current_thread().name.encode(), 1.0)

    monkeypatch.setattr(filming, "film", film)
    with Filming(FOOTAGE, None) as made:
        found = made.film()
    assert found is not None
    assert found.mp4.startswith(b"film")


def test_other_work_follows_the_film_and_is_given_up_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[str] = []

    def film(*_: Any, given_up: Any, **__: Any) -> None:
        while not given_up() and len(done) < 1:
            pass

    monkeypatch.setattr(filming, "film", film)
    with Filming(FOOTAGE, None) as made:
        after = made.next(lambda: done.append("pictures"))
        done.append("film")
        after.result()
    assert done == ["film", "pictures"]
    done.clear()
    with Filming(FOOTAGE, None) as made:
        never = made.next(lambda: done.append("pictures"))
    assert never.cancelled()
    assert done == []


def test_what_goes_wrong_is_raised_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise OSError("no encoder")

    monkeypatch.setattr(filming, "film", broken)
    with Filming(FOOTAGE, None) as made, pytest.raises(OSError, match="no encoder"):
        made.film()


def test_it_is_given_up_when_nobody_waits_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended = threading.Event(), threading.Event()

    def film(*_: Any, given_up: Any, **__: Any) -> None:
        begun.set()
        while not given_up():
            pass
        ended.set()

    monkeypatch.setattr(filming, "film", film)
    with Filming(FOOTAGE, None):
        assert begun.wait(10)
    assert ended.is_set()


def test_without_opengl_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filming, "gl_available", lambda: (False, "none"))
    with Filming(FOOTAGE, None) as made:
        assert made.film() is None
