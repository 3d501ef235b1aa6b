"""What a run shows: its pictures, and the rows of its page."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from palpate import __version__
from palpate.parameter import Parameter
from palpate.pictures.moments import (
    Film,
    film,
    frames_of,
    render_before_after,
    render_moment,
    render_scene,
)
from palpate.pictures.renderer import gl_available, png
from palpate.report.data import Measured, ParameterRow, ReportData
from palpate.scene.camera import load_image

if TYPE_CHECKING:
    from palpate.runs.run import Run
    from palpate.twin.validate import Residual, Validation

LIBRARIES = ("mujoco", "mink", "py_trees", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Pictures:
    """PNG and MP4 of a run; None where there is nothing to show or no OpenGL to show it with."""

    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    film: Film | None = None


def take_pictures(run: Run) -> Pictures:
    """Workspace, before, after and film, as far as there is something to see and a way to see
    it."""
    workspace = png(load_image(run.settings.images[0])) if run.settings.images else run.picture
    if not gl_available()[0]:
        return Pictures(workspace)
    names = tuple(run.scene.bodies)
    before = run.scene.spec()
    if run.twin is None or run.twin.scene is None or run.footage is None:
        return Pictures(workspace or render_scene(before, names))
    pair = render_before_after(before, run.twin.scene.spec(), names)
    t, qpos = frames_of(run.footage.frames)
    workspace = workspace or render_moment(run.footage.model, qpos[0])
    moving = film(run.footage.model, t, qpos, run.trace)
    return Pictures(workspace, *pair, moving)


def write_images(pictures: Pictures, folder: Path) -> None:
    """The pictures as files of their own."""
    folder.mkdir()
    contents = {
        "workspace.png": pictures.workspace,
        "before.png": pictures.before,
        "after.png": pictures.after,
        "execution.mp4": pictures.film.mp4 if pictures.film else None,
    }
    for name, content in contents.items():
        if content is not None:
            (folder / name).write_bytes(content)


def report_data(run: Run, pictures: Pictures, scratch: Path) -> ReportData:
    """What the page shows."""
    settings, done, twin = run.settings, run.execution, run.twin
    gl, remedy = gl_available()
    return ReportData(
        request=settings.request,
        status=run.status,
        plan=run.plan,
        world=run.world or "nothing was moved",
        parameters=tuple(_parameter_rows(run)),
        measured=tuple(_measured(run)),
        findings=tuple(f"{f.path}: {f.message}" for f in run.findings),
        trace=run.trace,
        stopped_by=done.stopped_by if done else None,
        robot_seconds=done.robot_seconds if done else None,
        wall_seconds=done.wall_seconds if done else None,
        workspace=pictures.workspace,
        before=pictures.before,
        after=pictures.after,
        video=pictures.film.mp4 if pictures.film else None,
        video_speed=pictures.film.speed if pictures.film else 1.0,
        twin_diff=twin.diff if twin else "",
        twin_notes=twin.notes if twin else (),
        twin_checks=twin_checks(twin.validation) if twin and twin.validation else {},
        versions={"palpate": __version__, **{name: version(name) for name in LIBRARIES}},
        seed=settings.seed,
        noise=settings.noise,
        warnings=() if gl else (remedy,),
        files=tuple(sorted(str(p.relative_to(scratch)) for p in scratch.rglob("*") if p.is_file())),
    )


def _parameter_rows(run: Run) -> list[ParameterRow]:
    asked = set(run.plan.parameters)
    rows: list[ParameterRow] = []
    for body in run.scene.bodies.values():
        rows += [
            ParameterRow(body.name, q, "missing", Parameter(body.name, q) in asked)
            for q in sorted(body.missing)
        ]
        rows += [
            ParameterRow(body.name, q, "known", Parameter(body.name, q) in asked, v)
            for q, v in body.known.items()
        ]
        rows += [
            ParameterRow(body.name, q, "assumed", Parameter(body.name, q) in asked)
            for q in sorted(body.assumed)
        ]
    return rows


def _measured(run: Run) -> list[Measured]:
    return [Measured(e, run.truth.get(e.parameter)) for e in run.estimates]


def twin_checks(marks: Validation) -> dict[str, str]:
    """The twin's marks in words and figures."""
    return {
        "Comes to rest": f"{'yes' if marks.settled else 'no'}, after moving {1e3 * marks.drift:.2f} mm",
        "Recorded touch replayed in the twin": _shown(marks.twin),
        "Recorded touch replayed in the untouched template": _shown(marks.template),
    }


def _shown(residual: Residual) -> str:
    parts = [
        f"{residual.force:.3f} N" if residual.force is not None else "",
        f"{1e3 * residual.position:.2f} mm" if residual.position is not None else "",
        residual.note,
    ]
    return "off by " + ", ".join(p for p in parts if p) if any(parts) else "nothing to compare"
