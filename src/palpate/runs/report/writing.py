"""Write pictures, film and page of a run. A failure of one does not prevent the others."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from palpate.common.processes import Fork
from palpate.perception.dress import looks_in
from palpate.perception.film import Film, Reel, film_of, film_speed
from palpate.perception.renderer import Painter, gl_available, png
from palpate.perception.stage import render_before_after, render_moment, render_scene
from palpate.runs.folder import replacing
from palpate.runs.keeper import shortfall
from palpate.runs.report.data import Pictures, report_data
from palpate.runs.report.page import write_report
from palpate.runs.run import Run
from palpate.scene.camera import load_image

# Folder of a run's pictures, and their names in it.
IMAGES, STILLS = "images", ("workspace.png", "before.png", "after.png", "seen.png")
# Names of films: seen by a camera (False), or rendered from the trace (True).
FILMS = {False: "execution.mp4", True: "played-again.mp4"}


def pictures_in(folder: Path, run: Run) -> Pictures:
    """Read the pictures that the folder of a run already holds."""

    def content(name: str) -> bytes | None:
        file = folder / IMAGES / name
        return file.read_bytes() if file.exists() else None

    workspace, before, after, seen = (content(name) for name in STILLS)
    stills = Pictures(workspace, before, after, seen)
    # Prefer a film by a camera to one rendered from the trace.
    for believed, name in FILMS.items():
        video = content(name)
        if video is not None and run.execution is not None:
            film = Film(video, film_speed(run.execution.robot_seconds), believed)
            return replace(stills, film=film)
    return stills


def take_stills(run: Run, taken: Pictures) -> Pictures:
    """Add pictures of the workspace, and of the scene before and after, to `taken`.

    Without OpenGL, only existing pictures are used.
    """
    # Prefer the user's picture, then the planner's, then the stored one, then a rendering.
    workspace = run.picture or taken.workspace
    if run.settings.images:
        workspace = png(load_image(run.settings.images[0]))
    taken = replace(taken, workspace=workspace, seen=run.looked or taken.seen)
    if not run.scene.bodies or not gl_available()[0]:
        return taken
    # Render the scene before the measurement, and after it if there is a twin.
    names = tuple(run.scene.bodies)
    before = run.scene.spec()
    if run.finished is None or run.finished.scene is None:
        return replace(taken, workspace=workspace or render_scene(before, names))
    footage, looks = run.footage, None
    if footage is not None and footage.spec is not None:
        # Use the materials of the world that the camera saw.
        looks = looks_in(footage.spec)
    pair = render_before_after(before, run.finished.scene.spec(), names, looks=looks)
    if workspace is None and footage is not None:
        workspace = render_moment(footage.model, footage.frames[0][1], footage.drawn())
    return Pictures(workspace, *pair, taken.seen, taken.film)


def take_film(run: Run) -> Film | None:
    """Make the film from the footage of the cell's camera; None without footage or OpenGL."""
    if run.footage is None or run.settings.fast or not gl_available()[0]:
        return None
    return film_of(run.footage, run.trace_if_any)


def write_images(pictures: Pictures, folder: Path) -> None:
    """Write the pictures as separate files into the run's folder."""
    folder = folder / IMAGES
    folder.mkdir(exist_ok=True)
    stills = (pictures.workspace, pictures.before, pictures.after, pictures.seen)
    contents = dict(zip(STILLS, stills, strict=True))
    if pictures.film is not None:
        contents[FILMS[pictures.film.believed]] = pictures.film.mp4
    for name, content in contents.items():
        if content is not None:
            with replacing(folder / name) as part:
                part.write_bytes(content)


class Darkroom:
    """Film and pictures of a run, rendered by copies of this process while other stages run.

    Use as a context manager: results that are not finished at its end are discarded. A process that
    has rendered is not copied, because a copy lacks the driver's threads.
    """

    def __init__(self, run: Run, reel: Reel | None = None) -> None:
        """Start with the film. `reel` has rendered a part of it."""
        # Wait here for the trial of the backends: it is a child of this process.
        self._copied = gl_available()[0] and not Painter.used
        film = None
        if reel is not None and run.footage is not None:
            film = reel.finish(run.footage, run.trace)
        self.film = film or Fork(lambda: take_film(run), self._copied)
        self._stills: Fork[Pictures] | None = None

    def begin_stills(self, run: Run) -> None:
        """Start the pictures of a run whose twin is built."""
        self._stills = Fork(lambda: take_stills(run, Pictures()), self._copied)

    def stills(self, run: Run, taken: Pictures) -> Pictures:
        """Wait for the pictures."""
        return self._stills.result() if self._stills else take_stills(run, taken)

    def __enter__(self) -> Darkroom:
        return self

    def __exit__(self, *_: object) -> None:
        self.film.close()
        if self._stills is not None:
            self._stills.close()


def write_all(
    run: Run, folder: Path, darkroom: Darkroom | None = None, place: Path | None = None
) -> tuple[str, ...]:
    """Write pictures, film and page of a run that is finished but for its report into `folder`.

    Without a `darkroom` with pictures and film in progress, they are made now. `place` is the final location of the
    folder. Return the shortfalls, one line for each part that could not be made.
    """
    # Each part runs in its own block: a failure is noted, and the next part begins.
    missing: list[str] = []
    pictures = Pictures()
    with collect_shortfalls("the pictures were not read again", missing):
        pictures = pictures_in(folder, run)
    with collect_shortfalls("the pictures were not made", missing):
        pictures = (darkroom.stills if darkroom else take_stills)(run, pictures)
    with collect_shortfalls("the film was not made", missing):
        film = darkroom.film.result() if darkroom else take_film(run)
        pictures = pictures if film is None else replace(pictures, film=film)
    with collect_shortfalls("the pictures were not written", missing):
        write_images(pictures, folder)
    with (
        collect_shortfalls("report.html was not written", missing),
        replacing(folder / "report.html") as part,
    ):
        write_report(part, report_data(run, pictures, folder, place or folder))
    return tuple(missing)


@contextmanager
def collect_shortfalls(failure: str, shortfalls: list[str]) -> Generator[None]:
    """Convert an exception of the block to a line of `shortfalls`."""
    try:
        yield
    except Exception as error:
        shortfalls.append(shortfall(failure, error))
