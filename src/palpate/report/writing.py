"""The last stage of a run: its pictures, its film and its page, each of which may fail alone."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.pictures.film import Filming
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
    from palpate.pictures.film import Footage
    from palpate.runs.run import Run
    from palpate.trace.samples import Trace


class Darkroom:
    """Film and pictures of a run in the making, beside other work, on a thread of their own. A context
    manager; what is not done when it is left is given up."""

    def __init__(self, footage: Footage, trace: Trace | None) -> None:
        """Begin with the film."""
        self.filming = Filming(footage, trace)
        self._stills: Future[Pictures] | None = None

    def begin_stills(self, run: Run) -> None:
        """Take the pictures of a run whose twin is built, when the film is done."""
        self._stills = self.filming.next(lambda: take_stills(run, Pictures()))

    def stills(self, run: Run, taken: Pictures) -> Pictures:
        """The pictures, when they are done.

        Raises:
            RuntimeError: OpenGL failed.
        """
        return self._stills.result() if self._stills else take_stills(run, taken)

    def __enter__(self) -> Darkroom:
        return self

    def __exit__(self, *raised: Any) -> None:
        self.filming.__exit__(*raised)


def write_all(
    run: Run, folder: Path, darkroom: Darkroom | None = None, place: Path | None = None
) -> tuple[str, ...]:
    """Write pictures, film and page of `run` into `folder`; what could not be made is told, a line
    each. `darkroom`: where pictures and film are in the making. `place`: where the folder will be."""
    missing: list[str] = []
    pictures = Pictures()
    with _forgiven("the pictures were not read again", missing):
        pictures = pictures_in(folder, run)
    with _forgiven("the pictures were not made", missing):
        pictures = (darkroom.stills if darkroom else take_stills)(run, pictures)
    with _forgiven("the film was not made", missing):
        pictures = take_film(run, pictures, darkroom.filming if darkroom else None)
    with _forgiven("the pictures were not written", missing):
        write_images(pictures, folder)
    with (
        _forgiven("report.html was not written", missing),
        replacing(folder / "report.html") as part,
    ):
        write_report(part, report_data(run, pictures, folder, place or folder))
    return tuple(missing)


@contextmanager
def _forgiven(what: str, missing: list[str]) -> Generator[None]:
    """A failure costs what it would have made, and a line."""
    try:
        yield
    except Exception as error:
        missing.append(shortfall(what, error))
