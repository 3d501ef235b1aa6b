"""Everything a run leaves behind, written into its folder."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

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
from palpate.report.page import write_report
from palpate.runs.folder import write_json
from palpate.runs.result import plan_text, result_json
from palpate.scene.camera import load_image
from palpate.trace.mcap import write_mcap

if TYPE_CHECKING:
    from palpate.pipeline import Outcome
    from palpate.planning.model.session import ModelSettings
    from palpate.twin.validate import Residual, Validation

LIBRARIES = ("mujoco", "mink", "py_trees", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Pictures:
    """PNG and MP4 of a run; None where there is nothing to show or no OpenGL to show it with."""

    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    film: Film | None = None


def write_outcome(outcome: Outcome, scratch: Path, folder: Path) -> None:
    """Write all files of a run into `scratch`, which will become `folder`."""
    from palpate.execution.btcpp import tree_xml
    from palpate.vocabulary.registry import vocabulary

    write_json(scratch / "request.json", request_json(outcome))
    (scratch / "plan.json").write_text(plan_text(outcome), encoding="utf-8")
    if outcome.conversation is not None:
        (scratch / "conversation.json").write_text(outcome.conversation.dump(), encoding="utf-8")
    if outcome.seen is not None:
        (scratch / "scene.xml").write_text(outcome.scene.text, encoding="utf-8")
    if outcome.plan.tree is not None and not outcome.findings:
        (scratch / "tree.xml").write_text(tree_xml(outcome.plan, vocabulary()), encoding="utf-8")
    if outcome.execution is not None:
        write_mcap(scratch / "trace.mcap", outcome.execution.trace)
    if outcome.twin is not None:
        (scratch / "twin.xml").write_text(outcome.twin.text, encoding="utf-8", newline="")
    write_json(scratch / "result.json", result_json(outcome, folder))
    pictures = take_pictures(outcome)
    write_images(pictures, scratch / "images")
    write_report(scratch / "report.html", report_data(outcome, pictures, scratch))


def request_json(outcome: Outcome) -> dict[str, Any]:
    """What was asked: enough to run it again."""
    job = outcome.job

    def shown(path: Path | None) -> str | None:
        return str(path.absolute()) if path else None

    return {
        "request": job.request,
        "scene": shown(job.scene),
        "poses": shown(job.poses),
        "images": [shown(p) for p in job.images],
        "world": shown(job.world),
        "robot": job.robot,
        "planner": job.planner,
        "noise": job.noise,
        "seed": job.seed,
        "remeasure": job.remeasure,
        "on_failure": job.on_failure,
        "rehearse": job.rehearse,
        "asking": model_settings_json(job.model_settings),
        "palpate": __version__,
    }


def model_settings_json(model_settings: ModelSettings) -> dict[str, Any]:
    """How a model was asked, without whatever an address may hold besides the address."""
    url = urlsplit(model_settings.base_url or "")
    host = url.netloc.rpartition("@")[2]
    return asdict(model_settings) | {
        "without": sorted(model_settings.without),
        "base_url": urlunsplit((url.scheme, host, url.path, "", "")) or None,
    }


def take_pictures(outcome: Outcome) -> Pictures:
    """Workspace, before, after and film, as far as there is something to see and a way to see
    it."""
    workspace = png(load_image(outcome.job.images[0])) if outcome.job.images else outcome.picture
    if not gl_available()[0]:
        return Pictures(workspace)
    names = tuple(outcome.scene.bodies)
    before = outcome.scene.spec()
    if outcome.twin is None or outcome.twin.scene is None or outcome.footage is None:
        return Pictures(workspace or render_scene(before, names))
    pair = render_before_after(before, outcome.twin.scene.spec(), names)
    t, qpos = frames_of(outcome.footage.frames)
    workspace = workspace or render_moment(outcome.footage.model, qpos[0])
    moving = film(
        outcome.footage.model, t, qpos, outcome.execution.trace if outcome.execution else None
    )
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


def report_data(outcome: Outcome, pictures: Pictures, scratch: Path) -> ReportData:
    """What the page shows."""
    job, done, twin = outcome.job, outcome.execution, outcome.twin
    gl, remedy = gl_available()
    return ReportData(
        request=job.request,
        status=outcome.status,
        plan=outcome.plan,
        world=outcome.cell.description if outcome.cell else "nothing was moved",
        parameters=tuple(_parameter_rows(outcome)),
        measured=tuple(_measured(outcome)),
        findings=tuple(f"{f.path}: {f.message}" for f in outcome.findings),
        trace=done.trace if done else None,
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
        seed=job.seed,
        noise=job.noise,
        warnings=() if gl else (remedy,),
        files=tuple(sorted(str(p.relative_to(scratch)) for p in scratch.rglob("*") if p.is_file())),
    )


def _parameter_rows(outcome: Outcome) -> list[ParameterRow]:
    asked = set(outcome.plan.parameters)
    rows: list[ParameterRow] = []
    for body in outcome.scene.bodies.values():
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


def _measured(outcome: Outcome) -> list[Measured]:
    cell = outcome.cell
    return [
        Measured(e, e.unit, cell.truth(e.parameter) if cell else None) for e in outcome.estimates
    ]


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
