"""The last stage of a run: its pictures, its film and its page, each of which may fail alone."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.report.contents import (
    Pictures,
    pictures_in,
    report_data,
    take_film,
    take_stills,
    write_images,
)
from palpate.report.page import write_report
from palpate.runs.folder import replacing
from palpate.runs.keeper import shortfall

if TYPE_CHECKING:
    from palpate.pictures.filming import Filming
    from palpate.runs.run import Run


def write_all(run: Run, folder: Path, filming: Filming | None = None) -> tuple[str, ...]:
    """Write pictures, film and page of `run` into `folder`; what could not be made is told, a line
    each. `filming`: the film is in the making."""
    missing: list[str] = []
    pictures = Pictures()
    with _forgiven("the pictures were not read again", missing):
        pictures = pictures_in(folder, run)
    with _forgiven("the pictures were not made", missing):
        pictures = take_stills(run, pictures)
    with _forgiven("the film was not made", missing):
        pictures = take_film(run, pictures, filming)
    with _forgiven("the pictures were not written", missing):
        write_images(pictures, folder)
    with (
        _forgiven("report.html was not written", missing),
        replacing(folder / "report.html") as part,
    ):
        write_report(part, report_data(run, pictures, folder))
    return tuple(missing)


@contextmanager
def _forgiven(what: str, missing: list[str]) -> Generator[None]:
    """A failure costs what it would have made, and a line."""
    try:
        yield
    except Exception as error:
        missing.append(shortfall(what, error))
